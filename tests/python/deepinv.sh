#!/usr/bin/env bash
# Makes the environment of the tests with deepinv and benchopt in build/python-deepinv, with PyTorch (several GB).
set -euo pipefail
cd "$(dirname "$0")/../.."
source examples/install.sh
hadalens_install python
tests/python/beside.sh deepinv 'benchopt, cffi, deepinv, pytest, safetensors' 'benchopt cffi deepinv pytest safetensors tifffile'
