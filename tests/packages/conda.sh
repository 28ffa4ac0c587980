#!/usr/bin/env bash
# The conda recipe, as far as it goes without conda's channels: read by rattler-build, rendered for each platform.
#   tests/packages/conda.sh FOLDER
# The tools come from PyPI into FOLDER/venv; where that cannot be made, the test is skipped.
set -euo pipefail
[ $# = 1 ] || { sed -n '3s/^# *//p' "$0" >&2; exit 2; }
folder=$(realpath -m "$1")
cd "$(dirname "$0")/../.."
source examples/install.sh
hadalens_install packages
if ! "$folder/venv/bin/python" -c 'import rattler_build' 2>/dev/null; then
    /usr/bin/python3 -m venv --clear "$folder/venv"
    "$folder/venv/bin/pip" install --quiet py-rattler-build || { echo "py-rattler-build cannot be had: skipped"; exit 77; }
fi
"$folder/venv/bin/python" tests/packages/conda_render.py bindings/packaging/conda/recipe.yaml "$(bindings/packaging/version.sh)"
