#!/bin/sh
# Every test has one of the labels quick, full, long, oracle, stress, python, mpi and devices, so that none is left out of the tiers.
set -eu
ctest=$1 build=$2
names() { "$ctest" --test-dir "$build" -N -FS . "$@" | sed -n 's/^ *Test *#[0-9]*: //p' | sort; }
all=$(names)
[ -n "$all" ] || { echo "no tests in $build"; exit 1; }
tiers=$(for tier in quick full long oracle stress python mpi devices; do names -L "^$tier\$"; done | sort)
[ "$all" = "$tiers" ] || {
    echo "tests in no tier or in two (hadalens_tier in tests/CMakeLists.txt):"
    { echo "$all"; echo "$tiers"; } | sort | uniq -c | awk '$1 != 2 { print "  " $2 }'
    exit 1
}
