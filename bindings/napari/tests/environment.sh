#!/usr/bin/env bash
# Makes the environment of the plugin's tests in build/python-napari: napari with Qt, from PyPI (500 MB), the wheel that
# tests/python/environment.sh made, and the plugin.
set -euo pipefail
cd "$(dirname "$0")/../../.."
folder=$PWD/build/python-napari
source examples/install.sh
hadalens_install napari
ls build/python/wheel/hadalens-*.whl >/dev/null 2>&1 || tests/python/environment.sh build/python
if ! "$folder/bin/python" -c 'import cffi, napari, pytestqt, PyQt6.QtWidgets, safetensors, zarr' 2>/dev/null; then
    /usr/bin/python3 -m venv --clear "$folder"
    "$folder/bin/pip" install --quiet cffi mypy napari PyQt6 pytest-qt safetensors tifffile zarr
fi
"$folder/bin/pip" install --quiet --no-deps --force-reinstall build/python/wheel/hadalens-*.whl bindings/napari
