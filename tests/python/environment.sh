#!/usr/bin/env bash
# Builds the Python package from this tree and installs it with what its tests need into a virtual environment.
#   tests/python/environment.sh FOLDER
# Packages come from PyPI; with all that is needed there already, only what has changed is built again.
set -euo pipefail
[ $# = 1 ] || { sed -n '3s/^# *//p' "$0"; exit 2; }
folder=$(realpath -m "$1")
cd "$(dirname "$0")/../.."
needed=tests/python/requirements.txt

source examples/install.sh
hadalens_install python
if ! cmp -s "$needed" "$folder/requirements.txt"; then
    echo "Making the environment of the Python package's tests: $folder"
    /usr/bin/python3 -m venv --clear "$folder"
    "$folder/bin/python" -m pip install --quiet --requirement "$needed"
    cp "$needed" "$folder/requirements.txt"
fi
# the wheel that a user gets, by the tools that are there; objects stay in the build folder
rm -rf "$folder/wheel"
"$folder/bin/python" -m pip wheel --quiet --no-build-isolation --no-deps --wheel-dir "$folder/wheel" \
    --config-settings build-dir="$folder/build" .
"$folder/bin/python" -m pip install --quiet --no-deps --force-reinstall "$folder"/wheel/hadalens-*.whl
"$folder/bin/python" -c 'import hadalens'

# PyTorch is the distribution's, as for the oracles, with the NumPy that it was built for: an environment of its own
torch=$folder-torch
/usr/bin/python3 -c 'import tifffile, torch' 2>/dev/null || { echo "Without python3-torch, its tests are skipped."; exit 0; }
if ! "$torch/bin/python" -c 'import cffi, h5py, pytest, safetensors, torch' 2>/dev/null; then
    /usr/bin/python3 -m venv --clear --system-site-packages "$torch"
    "$torch/bin/python" -m pip install --quiet cffi h5py pytest 'safetensors==0.5.3' 'numpy<2'
fi
"$torch/bin/python" -m pip install --quiet --no-deps --force-reinstall "$folder"/wheel/hadalens-*.whl
cp "$needed" "$torch/requirements.txt" # the mark that it is whole
