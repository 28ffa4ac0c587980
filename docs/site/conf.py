"""The pages as a site: cmake --build build/release --target site, or

sphinx-build -W --keep-going -c docs/site . OUTPUT      from the root of the tree

The source folder is the root, so that links between docs, results and READMEs work. A link to a page or file that does
not exist is a warning, and -W makes it an error. The pages of the Python package are made where it is installed, those
of the C headers are linked where REFERENCE is set."""

import importlib.util
import os
import pathlib
import re

project = "Hadalens"
copyright = "the authors of Hadalens"
extensions = ["myst_parser"]
root_doc = "README"
include_patterns = ["*.md", "docs/site/*.rst", "kernels/*.md"]
include_patterns += [f"{folder}{inside}/*.md" for folder in ("docs", "perf", "lib", "bindings", "examples", "tests")
                     for inside in ("", "/**")]
exclude_patterns = ["build*", "**/build", ".*", "**/.*", "tests/abi/frozen-*", "tests/fuzz/corpus"]
source_suffix = {".rst": "restructuredtext", ".md": "markdown"}
myst_heading_anchors = 4
myst_enable_extensions = []

if importlib.util.find_spec("hadalens"):
    import hadalens

    version = release = hadalens.__version__
    extensions += ["sphinx.ext.autodoc", "sphinx.ext.napoleon"]
    # whoever builds the pages need not have what the optional modules use
    autodoc_mock_imports = ["PIL", "dask", "deepinv", "distributed", "h5py", "pyarrow", "safetensors", "tifffile", "torch", "zarr"]
    autodoc_member_order = "bysource"
    autodoc_typehints = "description"
    autodoc_typehints_description_target = "documented"
    napoleon_google_docstring = True
    napoleon_use_ivar = True
else:
    exclude_patterns += ["docs/site/python-*.rst"]

html_theme = "alabaster"
html_theme_options = {"page_width": "1280px", "sidebar_width": "240px", "body_max_width": "none", "code_font_size": "0.8em",
                      "font_size": "16px", "show_powered_by": False}
html_sidebars = {"**": ["about.html", "searchbox.html", "navigation.html"]}
smartquotes = False
html_show_sourcelink = False
html_copy_source = False
html_extra_path = ["index.html"]
suppress_warnings = ["ref.python", "myst.header"]  # bytes beside members of that name; levels that are left out

# The contents in the side bar are the groups of docs/README.md; pages that are not listed there are reached by links.
CONTENTS = {"Get started": "start", "How to": "how-to", "Reference": "reference", "Explanation": "explanation"}

# Where the reference of the C headers is, seen from the pages that link to it; the target site puts it there.
REFERENCE = {"docs/README": "../c/index.html", "docs/how-to/write-a-c-program": "../../c/index.html"}


def pages_of(folder):
    listed = pathlib.Path(__file__).parents[1].joinpath("README.md").read_text(encoding="utf-8")
    names = ["docs/" + name for name in re.findall(rf"\(({folder}/[a-z-]+)\.md\)", listed)]
    return list(dict.fromkeys(names))


def add_contents(app, name, source):
    if name in REFERENCE and os.environ.get("REFERENCE"):
        source[0] += f'\n<a href="{REFERENCE[name]}">The headers as pages</a>\n'
    if name == root_doc:
        for caption, folder in CONTENTS.items():
            pages = pages_of(folder) + (["docs/site/python"] if folder == "reference" else [])
            source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n" + "\n".join(pages) + "\n```\n"
    elif name == "docs/site/python" and "sphinx.ext.autodoc" in extensions:
        source[0] += "\n.. toctree::\n\n   python-api\n   python-tools\n"
    elif name.rpartition("/")[0].removeprefix("docs/") not in [*CONTENTS.values(), "site"]:
        source[0] = "---\norphan: true\n---\n\n" + source[0]


def setup(app):
    app.connect("source-read", add_contents)
