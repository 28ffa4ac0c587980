#!/bin/sh
# Every test has one of the labels quick, full, long, oracle, stress, python, mpi and devices, so that none is left out of the tiers.
# Each promise of the page on security has its number and tests that are there: of ctest, or of a file of unit tests.
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
cd "$(dirname "$0")/../.."
page=docs/reference/security.md status=0
rows=$(sed -nE 's/^\| ([0-9]+) \| .* \| (`[^|]*`) \|$/\1 \2/p' $page | tr -d '`,')
[ "$(echo "$rows" | cut -d' ' -f1)" = "$(seq "$(grep -cE '^\| [0-9]+ \|' $page)")" ] ||
    { echo "$page: a promise without its number or without a test"; status=1; }
for name in $(echo "$rows" | cut -d' ' -f2-); do
    echo "$all" | grep -qx "$name" || grep -qrF "TEST($name)" tests/unit tests/faults ||
        { echo "$page names the test $name, which is not there"; status=1; }
done
exit $status
