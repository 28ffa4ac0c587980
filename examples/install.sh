# Installs what is missing, from Debian or Ubuntu. To be sourced: hadalens_install [tests|oracle|budget|python|mpi|imagej|napari|devices|packages|cluster|lint|memcheck|docs]
# What is there already is left alone; with nothing missing, nothing is asked.
hadalens_install() {
    local packages="gcc libc6-dev cmake ninja-build pkg-config python3 ocl-icd-opencl-dev libclfft-dev libtiff-dev
        libcairo2-dev libjansson-dev libxxhash-dev libpopt-dev libpng-dev libturbojpeg0-dev libraw-dev
        zlib1g-dev"
    local missing="" package root=""
    if ! command -v dpkg-query >/dev/null; then
        echo "This is not Debian or Ubuntu: docs/start/install.md lists what has to be installed."
        return 0
    fi
    # any OpenCL driver serves; without one, PoCL runs on the CPU
    ls /etc/OpenCL/vendors/*.icd >/dev/null 2>&1 || packages="$packages pocl-opencl-icd"
    case ${1:-} in
    # the tests run on PoCL whatever else is there; the C++ compiler and doxygen read the public headers, abigail-tools
    # compare them with earlier ones, zsh tries its completion
    tests) packages="$packages pocl-opencl-icd libmatio-dev libaravis-dev libusb-1.0-0-dev libcmocka-dev g++ doxygen
        abigail-tools zsh" ;;
    # independent software that checks results and files (tests/oracle/environment.sh)
    oracle) packages="python3-venv python3-numpy python3-scipy python3-skimage python3-tifffile python3-torch" ;;
    # what looks at kernels as a GPU's compiler makes them (tests/budget/environment.sh)
    budget) packages="python3-venv clang-15 libclc-15" ;;
    # the Python package (tests/python/environment.sh): what pip does not bring
    python) packages="$packages python3-venv python3-dev" ;;
    # the program that ranks share
    mpi) packages="libopenmpi-dev openmpi-bin" ;;
    # the ImageJ macro in ImageJ, before a screen in memory
    imagej) packages="imagej xvfb" ;;
    # the napari plugin (bindings/napari/tests/environment.sh): a screen in memory, and what Qt and OpenGL need
    napari) packages="$packages python3-venv python3-dev xauth xvfb libdbus-1-3 libegl1 libfontconfig1 libgl1 libgl1-mesa-dri
        libxcb-cursor0 libxcb-icccm4 libxcb-image0 libxcb-keysyms1 libxcb-render-util0 libxcb-shape0 libxkbcommon-x11-0" ;;
    # a simulator of a device, and Python to bring another implementation of OpenCL (tests/devices/environment.sh)
    devices) packages="python3-venv oclgrind" ;;
    # what packages are made and looked at with (tests/packages)
    packages) packages="mmdebstrap dpkg-dev lintian git python3-venv zsh" ;;
    # a batch system on this machine (tests/cluster)
    cluster) packages="$packages slurmctld slurmd slurm-client munge" ;;
    # these pages as a site (target site), with the reference of the headers
    docs) packages="$packages python3-sphinx python3-myst-parser doxygen" ;;
    # reads of what was never written (tests/valgrind.sh)
    memcheck) packages="valgrind" ;;
    # a second compiler, what reads the sources (tests/house/lint.sh), what packs seeds (tests/fuzz/oss-fuzz)
    lint) packages="clang clang-format clang-tidy cppcheck zip unzip" ;;
    esac
    for package in $packages; do
        dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing="$missing $package"
    done
    [ -n "$missing" ] || return 0
    if [ "$(id -u)" != 0 ]; then
        root=sudo
        command -v sudo >/dev/null || { echo "Please install, as root: apt-get install$missing" >&2; return 1; }
    fi
    echo "Installing:$missing"
    $root apt-get update -qq
    $root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null
}
