# Installs what is missing from Debian or Ubuntu. To be sourced: hadalens_install [tests]
# Packages that are there already are left alone; with nothing missing, nothing is asked.
hadalens_install() {
    local packages="cmake ninja-build gcc libc6-dev pkg-config ocl-icd-opencl-dev libclfft-dev libtiff-dev
        libpng-dev libjansson-dev libxxhash-dev libpopt-dev"
    local missing="" package run=""
    # any OpenCL driver will do; without one, PoCL runs on the CPU
    ls /etc/OpenCL/vendors/*.icd >/dev/null 2>&1 || packages="$packages pocl-opencl-icd"
    [ "${1:-}" != tests ] || packages="$packages libcmocka-dev g++ pocl-opencl-icd python3"
    for package in $packages; do
        dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing="$missing $package"
    done
    [ -n "$missing" ] || return 0
    echo "Installing from your distribution:$missing"
    [ "$(id -u)" = 0 ] || run="sudo"
    $run apt-get update -qq
    $run env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null
}
