#!/usr/bin/env bash
# Makes what tests/budget needs: clang and libclc from the distribution; NVIDIA's assembler and disassembler, which need
# no GPU, from PyPI in a virtual environment.
#   tests/budget/environment.sh FOLDER
# The versions are fixed, since figures are compared with a committed table. With an environment that is there and whole,
# nothing is done.
set -euo pipefail
[ $# = 1 ] || { sed -n '4s/^# *//p' "$0"; exit 2; }
folder=$1
version=13.5.37

source "$(dirname "$0")/../../examples/install.sh"
hadalens_install budget
[ -f "$folder/version" ] && [ "$(cat "$folder/version")" = "$version" ] && exit 0
echo "Making the environment of the budgets: $folder"
python=python3
[ -x /usr/bin/python3 ] && python=/usr/bin/python3 # the distribution's own, as python3-venv is
"$python" -m venv --clear "$folder"
"$folder/bin/pip" install --quiet --no-deps "nvidia-cuda-nvcc==$version" "nvidia-cuda-nvdisasm==$version"
bin=$(cd "$folder"/lib/python3*/site-packages/nvidia/cu*/bin && pwd)
ln -sfn "$bin/ptxas" "$folder/bin/ptxas"
ln -sfn "$bin/nvdisasm" "$folder/bin/nvdisasm"
"$folder/bin/ptxas" --version >/dev/null
"$folder/bin/nvdisasm" --version >/dev/null
echo "$version" >"$folder/version"
