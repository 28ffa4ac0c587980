#!/usr/bin/env bash
# Makes an environment beside that of environment.sh, in build/python-NAME: packages from PyPI, and the wheel that
# environment.sh made.
#   tests/python/beside.sh NAME MODULES PACKAGES [PATH...]
# MODULES: what can be imported where it is whole, "a, b"; PATH: further packages of this tree.
set -euo pipefail
[ $# -ge 3 ] || { sed -n '4,5s/^# *//p' "$0" >&2; exit 2; }
cd "$(dirname "$0")/../.."
folder=$PWD/build/python-$1
read -ra packages <<<"$3"
ls build/python/wheel/hadalens-*.whl >/dev/null 2>&1 || tests/python/environment.sh build/python
if ! "$folder/bin/python" -c "import $2" 2>/dev/null; then
    /usr/bin/python3 -m venv --clear "$folder"
    "$folder/bin/python" -m pip install --quiet "${packages[@]}"
fi
"$folder/bin/python" -m pip install --quiet --no-deps --force-reinstall build/python/wheel/hadalens-*.whl "${@:4}"
cp tests/python/requirements.txt "$folder/requirements.txt" # the mark that it is whole
