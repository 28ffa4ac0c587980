#!/usr/bin/env bash
# run.sh [FOLDER] [ARGUMENTS of budget.py]: the budgets, with the tools of the environment in FOLDER (build/budget).
# Without the tools: exit code 77, skipped.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
folder=$here/../../build/budget
if [ $# -gt 0 ] && [ "${1#-}" = "$1" ]; then
    folder=$1
    shift
fi
skip() {
    echo "skipped: $1; tests/budget/environment.sh build/budget installs what the budgets need"
    exit 77
}
clang=$(command -v clang-15) || skip "no clang-15"
library=/usr/lib/clc/nvptx64--nvidiacl.bc
[ -f "$library" ] || skip "no libclc-15 ($library)"
[ -x "$folder/bin/ptxas" ] && [ -x "$folder/bin/nvdisasm" ] || skip "no ptxas and nvdisasm in $folder"
exec python3 "$here/budget.py" --clang "$clang" --libclc "$library" --tools "$folder/bin" --cache "$folder/cache" "$@"
