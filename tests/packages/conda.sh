#!/usr/bin/env bash
# The conda recipe, as far as it goes without conda's channels: read by its schema, rendered for each platform.
#   tests/packages/conda.sh FOLDER
# The tools come from PyPI into FOLDER/venv; where that cannot be made, the test is skipped.
set -euo pipefail
[ $# = 1 ] || { sed -n '3s/^# *//p' "$0" >&2; exit 2; }
