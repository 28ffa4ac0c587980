#!/usr/bin/env bash
# Debian packages from the commit at hand: libhadalens2, libhadalens-dev, hadalens, hadalens-mpi, python3-hadalens.
#   bindings/packaging/deb.sh FOLDER [--source]
# Makes the source archive in FOLDER (bindings/packaging/dist.sh), unpacks it, lays bindings/packaging/debian into it as debian/, and runs
# dpkg-buildpackage, which says what is missing. --source: stops there, so that another machine can build.
# tests/packages/debian.sh builds in a clean chroot.
set -euo pipefail
[ $# -ge 1 ] || { sed -n '3s/^# *//p' "$0" >&2; exit 2; }
folder=$(realpath -m "$1") what=${2:-}
here=$(realpath "$(dirname "$0")")
version=$("$here/version.sh")
"$here/dist.sh" "$folder" >/dev/null
cd "$folder"
mv "hadalens-$version.tar.gz" "hadalens_$version.orig.tar.gz"
rm -rf "hadalens-$version"
tar -xf "hadalens_$version.orig.tar.gz"
cp -r "hadalens-$version/bindings/packaging/debian" "hadalens-$version/debian"
[ "$what" != --source ] || exit 0
cd "hadalens-$version"
dpkg-buildpackage -us -uc
