"""The pages for Python users: sphinx-build -W docs/python OUTPUT, where the package is installed."""

import hadalens

project = "hadalens"
version = release = hadalens.__version__
copyright = "the authors of Hadalens"
extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon"]
# whoever builds the pages need not have what the optional modules stand on
autodoc_mock_imports = ["dask", "distributed", "h5py", "safetensors", "tifffile", "torch", "zarr"]
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
napoleon_google_docstring = True
napoleon_use_ivar = True
html_theme = "alabaster"
suppress_warnings = ["ref.python"]  # the built-in bytes beside members of that name
