#!/usr/bin/env bash
# The Debian packages, from nothing: built in a clean chroot, looked at by lintian, installed into a fresh chroot, used
# there (the README's tour, a project with CMake and pkg-config, Python), and taken away again.
#   tests/packages/debian.sh FOLDER [build] [lint] [install]
# All three steps by default; the packages stay in FOLDER. As root on Debian, with a mirror at hand (MIRROR, SUITE; by default
# deb.debian.org and what this machine runs). TOUR_WITHOUT: commands of the tour that are left out. KERNELS: a cache of
# PoCL for the same release of Debian, which saves compiling. About a quarter of an hour on two cores.
set -euo pipefail
[ $# -ge 1 ] || { sed -n '4s/^# *//p' "$0" >&2; exit 2; }
folder=$(realpath -m "$1")
shift
steps=${*:-build lint install}
cd "$(dirname "$0")/../.."
source=$PWD
if [ "$(id -u)" != 0 ] || ! command -v dpkg >/dev/null; then
    echo "The packages are built as root on Debian: skipped."
    exit 77
fi
source examples/install.sh
hadalens_install packages
# shellcheck source=/dev/null
suite=${SUITE:-$(. /etc/os-release && echo "$VERSION_CODENAME")}
mirror=${MIRROR:-http://deb.debian.org/debian}
mkdir -p "$folder" "$folder/archives/partial"
work=$(mktemp -d -p "$folder")
trap 'rm -rf --one-file-system "$work"' EXIT
say() { printf '== %s (%d s)\n' "$*" "$SECONDS"; }

# A chroot with nothing but what is essential; the second one comes out of the same archive.
fresh() { # FOLDER
    if [ ! -e "$folder/base-$suite.tar" ]; then
        say "a clean $suite"
        mmdebstrap --quiet --variant=apt --mode=root "$suite" "$folder/part-$suite.tar" "$mirror" ||
            { echo "no $suite from $mirror: skipped"; exit 77; }
        mv "$folder/part-$suite.tar" "$folder/base-$suite.tar"
    fi
    mkdir -p "$1"
    tar -xpf "$folder/base-$suite.tar" -C "$1" --numeric-owner
    cp /etc/resolv.conf /etc/hosts "$1/etc/" 2>/dev/null || true
    printf '#!/bin/sh\nexit 101\n' >"$1/usr/sbin/policy-rc.d" # no service is started
    chmod +x "$1/usr/sbin/policy-rc.d"
}
# Runs in it, with mounts of its own that end with the command; packages are fetched once for all chroots.
within() { # FOLDER COMMAND...
    local root=$1
    shift
    mkdir -p "$root/var/cache/apt/archives"
    unshare --mount --pid --fork --kill-child -- bash -c '
        set -e
        root=$1 archives=$2
        shift 2
        mount -t proc proc "$root/proc"
        mount -t sysfs -o ro sysfs "$root/sys" # PoCL counts cores there
        mount --rbind --make-rslave /dev "$root/dev"
        mount --bind "$archives" "$root/var/cache/apt/archives"
        exec chroot "$root" env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 \
            DEBIAN_FRONTEND=noninteractive TERM=dumb "$@"' within "$root" "$folder/archives" "$@"
}
# Every file, but what package managers and programs keep about themselves.
contents() {
    local others=(-path ./tmp)
    for place in proc dev sys root run var/cache var/lib/apt var/lib/dpkg var/log; do others+=(-o -path "./$place"); done
    (cd "$1" && find . -xdev \( "${others[@]}" \) -prune -o -print | LC_ALL=C sort)
}

build() {
    rm -rf "$folder"/*.deb "$folder"/*.changes
    say "the source package"
    bindings/packaging/deb.sh "$work/source" --source
    fresh "$work/build"
    mv "$work/source" "$work/build/build"
    say "what building needs"
    within "$work/build" sh -c 'apt-get update -qq; apt-get install -qqy --no-install-recommends build-essential >/dev/null
        cd /build/hadalens-*/ && apt-get build-dep -qqy --no-install-recommends . >/dev/null'
    say "building"
    within "$work/build" sh -c 'cd /build/hadalens-*/ && dpkg-buildpackage -us -uc' >"$folder/build.log" 2>&1 ||
        { tail -n 40 "$folder/build.log"; exit 1; }
    cp "$work"/build/build/*.{deb,changes,dsc,buildinfo,debian.tar.*,orig.tar.gz} "$folder"
    rm -rf --one-file-system "$work/build"
}

lint() {
    say "lintian"
    ls "$folder"/*.changes >/dev/null
    for package in libhadalens2 libhadalens-dev hadalens hadalens-mpi python3-hadalens; do ls "$folder/${package}"_*.deb >/dev/null; done
    # lintian likes to be nobody in particular
    lintian --allow-root --fail-on error --display-level '>=warning' "$folder"/*.changes
}

install() {
    local root=$work/install
    fresh "$root"
    mkdir -p "$root/tmp/packages" "$root/tmp/source"
    cp "$folder"/*.deb "$root/tmp/packages"
    rm -f "$root"/tmp/packages/*-dbgsym_*
    tar -xzf "$folder"/hadalens_*.orig.tar.gz -C "$root/tmp/source" --strip-components=1
    within "$root" apt-get update -qq
    contents "$root" >"$folder/before.list"
    say "apt install ./*.deb"
    within "$root" sh -c 'cd /tmp/packages && apt-get install -qqy ./*.deb >/dev/null'
    # what tests need beside the packages, as debian/tests/control says
    local needed
    needed=$(sed -n 's/^Depends: //p' bindings/packaging/debian/tests/control | tr -s ', \n' '\n' | grep -v hadalens | sort -u | tr '\n' ' ')
    # shellcheck disable=SC2086
    within "$root" apt-get install -qqy --no-install-recommends $needed >/dev/null
    # others may be at work in it, and lose files that are theirs for a moment
    [ -z "${KERNELS:-}" ] || cp -r "$KERNELS/." "$root/tmp/pocl" 2>/dev/null || true
    for one in $(sed -n 's/^Tests: //p' bindings/packaging/debian/tests/control); do
        say "debian/tests/$one"
        mkdir "$root/tmp/$one"
        within "$root" env AUTOPKGTEST_TMP="/tmp/$one" POCL_CACHE_DIR=/tmp/pocl TOUR_WITHOUT="${TOUR_WITHOUT:-}" \
            sh -c 'mkdir -p /tmp/pocl; cd /tmp/source && bindings/packaging/debian/tests/'"$one" >"$folder/$one.log" 2>&1 ||
            { tail -n 40 "$folder/$one.log"; echo "debian/tests/$one failed"; exit 1; }
    done
    # only the program for ranks brings MPI
    for package in libhadalens2 libhadalens-dev hadalens python3-hadalens; do
        ! dpkg-deb --field "$folder/${package}"_*.deb Depends | grep -i mpi || { echo "$package depends on MPI"; exit 1; }
    done
    say "dpkg -r"
    within "$root" dpkg -r python3-hadalens hadalens-mpi hadalens libhadalens-dev libhadalens2 >/dev/null
    # what dpkg -r keeps by its own rule is configuration, which these packages have none of
    (cd "$root" && find . -xdev \( -path ./tmp -o -path ./proc -o -path ./dev -o -path ./var/cache/apt -o -path ./root \) -prune \
        -o -iname '*hadalens*' -print) >"$folder/left.list"
    [ ! -s "$folder/left.list" ] || { echo "dpkg -r left behind:"; cat "$folder/left.list"; exit 1; }
    # nor does dpkg remember any, as it does where something is left to purge
    ! within "$root" dpkg-query -W -f '${Package} ${db:Status-Status}\n' '*hadalens*' 2>/dev/null | grep -v ' not-installed$' ||
        { echo "dpkg -P would have something to do"; exit 1; }
    # and with what came for them
    # shellcheck disable=SC2086
    within "$root" sh -c "apt-get purge -qqy $needed >/dev/null; apt-get autoremove --purge -qqy >/dev/null"
    contents "$root" >"$folder/after.list"
    diff "$folder/before.list" "$folder/after.list" >"$folder/changed.list" || { echo "other packages changed:"; head -n 20 "$folder/changed.list"; }
}

for step in $steps; do
    case $step in
    build | lint | install) "$step" ;;
    *) echo "no step $step" >&2; exit 2 ;;
    esac
done
say "all as expected"
