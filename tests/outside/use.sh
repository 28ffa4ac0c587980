#!/bin/sh
# Builds the outside project with find_package(hadalens), and again with pkg-config, and runs both.
set -eu
source=$1 work=$2 libdir=$3 generator=$4
rm -rf "$work/build"
cmake -G "$generator" -S "$source" -B "$work/build" -DCMAKE_PREFIX_PATH="$work/prefix" -DCMAKE_C_FLAGS="${SANITIZE:-}" >/dev/null
cmake --build "$work/build" >/dev/null
"$work/build/use_hadalens"
export PKG_CONFIG_PATH="$work/prefix/$libdir/pkgconfig"
prefix=$(pkg-config --variable=prefix hadalens)
[ -n "$prefix" ]
cc -std=c11 ${SANITIZE:-} "$source/use_hadalens.c" -o "$work/use_pkg_config" \
    -I"$work/prefix/include" -L"$work/prefix/$libdir" $(pkg-config --libs-only-l hadalens)
LD_LIBRARY_PATH="$work/prefix/$libdir" "$work/use_pkg_config"
