#!/usr/bin/env bash
# Makes the environment of the tests with deepinv and benchopt in build/python-deepinv: PyTorch and both from PyPI (several
# GB), and the wheel that environment.sh made.
set -euo pipefail
cd "$(dirname "$0")/../.."
folder=$PWD/build/python-deepinv
source examples/install.sh
hadalens_install python
ls build/python/wheel/hadalens-*.whl >/dev/null 2>&1 || tests/python/environment.sh build/python
if ! "$folder/bin/python" -c 'import benchopt, cffi, deepinv, pytest, safetensors' 2>/dev/null; then
    /usr/bin/python3 -m venv --clear "$folder"
    "$folder/bin/pip" install --quiet benchopt cffi deepinv pytest safetensors tifffile
fi
"$folder/bin/pip" install --quiet --no-deps --force-reinstall build/python/wheel/hadalens-*.whl
cp tests/python/requirements.txt "$folder/requirements.txt" # the mark that it is whole
