#!/usr/bin/env bash
# Brings other implementations of OpenCL for the tests of the tier devices:
#   tests/devices/environment.sh FOLDER
# Intel's runtime for CPUs comes from PyPI into FOLDER/intel, seen by those alone who ask for it (OCL_ICD_VENDORS);
# Oclgrind, which simulates a device and finds races and reads beyond ends, from Debian or Ubuntu; the compilers of GPUs'
# vendors from Debian's archive, unpacked into FOLDER/compilers and installed nowhere. What cannot be had is said, and its
# tests are skipped. With all of it there, nothing is done.
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

# Debian 12's packages of that component, on whatever distribution: compiler VENDOR COMPONENT PACKAGE...
compiler() {
    local to=$folder/compilers/$1 component=$2 keys=/usr/share/keyrings/debian-archive-keyring.gpg
    local apt=$folder/compilers/apt-$component
    shift 2
    [ ! -e "$to/versions" ] || return 0
    [ "$(uname -m)" = x86_64 ] || { echo "Compilers of GPUs' vendors are brought for x86-64."; return 1; }
    [ -e "$keys" ] || { echo "The keys of Debian's archive are not here (package debian-archive-keyring)."; return 1; }
    rm -rf "$to.part"
    mkdir -p "$to.part" "$apt/lists/partial" "$apt/archives/partial"
    echo "deb [signed-by=$keys] http://deb.debian.org/debian bookworm $component" >"$apt/sources"
    local from=(-qq -o Dir::Etc::sourcelist="$apt/sources" -o Dir::Etc::sourceparts=- -o Dir::State::lists="$apt/lists"
        -o Dir::Cache="$apt" -o Dir::State::status=/dev/null -o APT::Sandbox::User=)
    [ -e "$apt/updated" ] || apt-get "${from[@]}" update || return 1
    touch "$apt/updated"
    (cd "$to.part" && apt-get "${from[@]}" download "$@") || return 1
    for package in "$to.part"/*.deb; do
        dpkg -x "$package" "$to.part" || return 1
    done
    (cd "$to.part" && ls -- *.deb) >"$to.part/versions"
    rm -rf "$to.part"/*.deb "$to"
    mv "$to.part" "$to"
}

source "$(dirname "$0")/../../examples/install.sh"
hadalens_install devices || echo "Oclgrind cannot be had: what it tests is skipped."
[ -e "$folder/intel/vendors/intel.icd" ] || intel ||
    echo "Intel's runtime cannot be had (PyPI: intel-opencl-rt $runtime): what it tests is skipped."
compiler nvidia non-free libnvidia-nvvm4 libnvidia-ptxjitcompiler1 ||
    echo "NVIDIA's compiler cannot be had: that it takes the kernels is not tested."
{ hadalens_install budget && compiler amd main rocm-device-libs; } || # the former for clang-15
    echo "AMD's compiler cannot be had: that it takes the kernels is not tested."
compiler intel main intel-opencl-icd libigc1 libigdfcl1 libigdgmm12 libopencl-clang14 libllvmspirvlib14 libclang-cpp14 libllvm14 ||
    echo "Intel's compiler for GPUs cannot be had: that it takes the kernels is not tested."
