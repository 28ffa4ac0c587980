#!/usr/bin/env bash
# Brings other implementations of OpenCL for the tests of the tier devices:
#   tests/devices/environment.sh FOLDER
# Intel's runtime for CPUs comes from PyPI into FOLDER/intel, seen by those alone who ask for it (OCL_ICD_VENDORS);
# Oclgrind, which simulates a device and finds races and reads beyond ends, from Debian or Ubuntu. What cannot be had is
# said, and its tests are skipped. With all of it there, nothing is done.
set -euo pipefail
[ $# = 1 ] || { sed -n '3s/^# *//p' "$0"; exit 2; }
mkdir -p "$1"
folder=$(realpath "$1")
runtime=2026.2.0

intel() {
    [ "$(uname -m)" = x86_64 ] || { echo "Intel's runtime is for x86-64."; return 1; }
    python3 -m venv --clear "$folder/intel.part"
    "$folder/intel.part/bin/pip" install --quiet --disable-pip-version-check "intel-opencl-rt==$runtime" \
        "intel-cmplr-lib-rt==$runtime" || return 1
    mkdir "$folder/intel.part/vendors"
    echo "$folder/intel/lib/libintelocl.so" >"$folder/intel.part/vendors/intel.icd"
    rm -rf "$folder/intel"
    mv "$folder/intel.part" "$folder/intel"
}

source "$(dirname "$0")/../../examples/install.sh"
hadalens_install devices || echo "Oclgrind cannot be had: what it tests is skipped."
[ -e "$folder/intel/vendors/intel.icd" ] || intel ||
    echo "Intel's runtime cannot be had (PyPI: intel-opencl-rt $runtime): what it tests is skipped."
