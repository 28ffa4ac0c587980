#!/usr/bin/env python3
"""What pip would note of an installed package, for packages that are made without pip: python_metadata.py PYPROJECT VERSION FOLDER.

Writes FOLDER/hadalens-VERSION.dist-info/METADATA from pyproject.toml, so that importlib.metadata and dh_python3 find name,
version and what is needed.
"""

import sys
import tomllib
from pathlib import Path


def metadata(project: dict, version: str) -> str:
    """The text of METADATA (core metadata 2.1)."""
    lines = ["Metadata-Version: 2.1", f"Name: {project['name']}", f"Version: {version}", f"Summary: {project['description']}",
             f"License: {project['license']}", f"Requires-Python: {project['requires-python']}"]
    lines += [f"Classifier: {text}" for text in project["classifiers"]]
    lines += [f"Requires-Dist: {text}" for text in project["dependencies"]]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write it."""
    pyproject, version, folder = sys.argv[1:]
    project = tomllib.loads(Path(pyproject).read_text(encoding="utf-8"))["project"]
    target = Path(folder) / f"{project['name']}-{version}.dist-info"
    target.mkdir()
    (target / "METADATA").write_text(metadata(project, version), encoding="utf-8")


main()
