#!/usr/bin/env bash
# run.sh VENDOR FOLDER [ARGUMENT...]: compilers.py with what tests/devices/environment.sh FOLDER has brought, in the form that
# DEVICES_FORM names (full; brief). Without that vendor's compiler: exit code 77, skipped.
set -euo pipefail
vendor=$1 folder=$2/compilers/$1
shift 2
[ -d "$folder" ] && { [ "$vendor" != amd ] || command -v clang-15 >/dev/null; } ||
    { echo "skipped: no compiler of $vendor in $folder; tests/devices/environment.sh build/devices brings it"; exit 77; }
folder=$(realpath "$folder")
versions=$folder/versions
case $vendor in
nvidia) folder=$folder/usr/lib/x86_64-linux-gnu/nvidia/current ;;
amd) folder=$folder/usr/lib/x86_64-linux-gnu/amdgcn/bitcode ;;
esac
exec python3 "$(dirname "$0")/compilers.py" --form "${DEVICES_FORM:-full}" --versions "$versions" "$vendor" "$folder" "$@"
