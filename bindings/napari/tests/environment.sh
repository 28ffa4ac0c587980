#!/usr/bin/env bash
# Makes the environment of the plugin's tests in build/python-napari: napari with Qt (500 MB), and the plugin.
set -euo pipefail
cd "$(dirname "$0")/../../.."
source examples/install.sh
hadalens_install napari
tests/python/beside.sh napari 'cffi, napari, pytestqt, PyQt6.QtWidgets, safetensors, zarr' \
    'cffi mypy napari PyQt6 pytest-qt safetensors tifffile zarr' bindings/napari
