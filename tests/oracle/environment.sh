#!/usr/bin/env bash
# Makes the Python environment in which the oracles run: a virtual environment with PyTorch, NumPy, SciPy,
# scikit-image, tifffile and safetensors.
#   tests/oracle/environment.sh FOLDER
# On Debian and Ubuntu all but safetensors come from the distribution: its PyTorch is built for CPUs and 80 MB with all
# it needs, while PyPI's wheel for x86-64 brings gigabytes of CUDA. Elsewhere everything comes from PyPI.
# With an environment that is there and whole, nothing is done.
set -euo pipefail
[ $# = 1 ] || { sed -n '4s/^# *//p' "$0"; exit 2; }
folder=$1
modules='import numpy, safetensors.torch, scipy, skimage, tifffile, torch'
"$folder/bin/python" -c "$modules" 2>/dev/null && exit 0

source "$(dirname "$0")/../../examples/install.sh"
hadalens_install oracle
echo "Making the oracles' environment: $folder"
if command -v dpkg-query >/dev/null; then
    # the distribution's own interpreter, which sees the distribution's packages
    /usr/bin/python3 -m venv --clear --system-site-packages "$folder"
    "$folder/bin/pip" install --quiet 'safetensors==0.5.3'
else
    python3 -m venv --clear "$folder"
    "$folder/bin/pip" install --quiet numpy scipy scikit-image tifffile torch safetensors
fi
"$folder/bin/python" -c "$modules"
