#!/usr/bin/env bash
# Fetches what Hadalens is built with, as Debian packages unpacked into a folder, so that perf/device.sh can build and
# measure on a machine that has a compiler and CMake but neither these packages nor a network. Needs apt, not root.
#
#   perf/device_packages.sh PREFIX [--no-pocl] [further packages]
#
# PREFIX then holds usr/include, usr/lib/x86_64-linux-gnu and so on: carry it along (tar -C PREFIX -cz . >prefix.tgz).
# PoCL is among them, so that a machine without any OpenCL driver can run as well; without it PREFIX is small. The C
# library and the compiler's own libraries are left out: those of the machine are used, which must be as new as those
# of this distribution.
set -euo pipefail
[ $# -ge 1 ] || { sed -n '2,10s/^# \{0,1\}//p' "$0"; exit 2; }
mkdir -p "$1"
prefix=$(cd "$1" && pwd)
shift
pocl=pocl-opencl-icd
[ "${1:-}" != --no-pocl ] || { pocl=; shift; }
wanted="ocl-icd-opencl-dev libclfft-dev libtiff-dev libcairo2-dev libjansson-dev libxxhash-dev libpopt-dev libcmocka-dev
    libfftw3-dev libpng-dev libturbojpeg0-dev libraw-dev libmatio-dev pkg-config ninja-build $pocl $*"
# what belongs to the machine: C library, compiler, package management, and programs that no library is needed from
left_out='
    libc6 libc6-dev libc-bin libc-dev-bin libc6-i386 lib32.* libx32.* linux-libc-dev libcrypt1 libcrypt-dev
    libgcc.* gcc.* cpp.* g\+\+.* binutils.* libbinutils libctf.* libgprofng.* libstdc\+\+.* libobjc.* libgomp.*
    libitm.* lib.san.* libasan.* libubsan.* libtsan.* liblsan.* libquadmath.* libatomic.* libcc1.* libisl.*
    libmpc.* libmpfr.* libgmp.* libgfortran.* gfortran.* libnsl.* libtirpc.* libdpkg-perl dpkg.* perl.*
    libperl.* debconf.* cdebconf.* tar coreutils install-info libgdbm.* libdb5.* libgssapi.* libkrb.*
    libk5crypto.* libcom-err.* libkeyutils.* libssl.* rpcsvc.* python3.* libpython3.* media-types libacl1
    libattr1 libselinux1 libpam.* sensible-utils ucf fonts-.* ttf-.* xfonts-.* lsb-base mailcap mime-support
    sysvinit-utils x11-common'
left_out="^($(echo $left_out | tr ' ' '|'))\$"

closure=$(apt-cache depends --recurse --no-recommends --no-suggests --no-conflicts --no-breaks --no-replaces \
    --no-enhances $wanted | grep -o '^[a-z0-9][a-z0-9.+-]*' | sort -u)
# virtual packages have no version of their own
packages=$(apt-cache policy $closure |
    awk '/^[^ ]/ { name = $1 } /Candidate: [^(]/ { sub(":$", "", name); print name }' |
    grep -Ev "$left_out")
debs=$(mktemp -d)
trap 'rm -rf "$debs"' EXIT
echo Fetching $packages | fold -s -w 118
(cd "$debs" && apt-get -qq -o APT::Sandbox::User=root download $packages)
for deb in "$debs"/*.deb; do
    dpkg -x "$deb" "$prefix"
done
# LLVM looks for its libraries in ../lib from where it lies, and so nowhere else
multiarch=$(basename "$(find "$prefix/usr/lib" -name 'libOpenCL.so*' -printf '%h\n' -quit)")
[ -e "$prefix/usr/lib/lib" ] || ln -s "$multiarch" "$prefix/usr/lib/lib"
rm -rf "$prefix"/usr/share/{doc,man,locale,lintian,bug,doc-base,info}
echo "$(ls "$debs" | wc -l) packages, $(du -sm "$prefix" | cut -f1) MB, in $prefix"
