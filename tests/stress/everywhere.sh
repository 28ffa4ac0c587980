#!/usr/bin/env bash
# The stress table on every OpenCL implementation at hand, by hand: it takes many minutes.
#
#   tests/stress/everywhere.sh STRESS [full|brief] >TABLE.md
#
# STRESS: the program, as build/release/tests/stress/stress.
#
# PoCL with threads and without (full), Mesa's rusticl on llvmpipe and the simulator Oclgrind (tiny; where they are).
# HADALENS_MESA names a folder into which mesa-opencl-icd was unpacked, as perf/device_packages.sh does ("/" where it is
# installed); rusticl also wants libclc-15 at /usr/lib/clc. Exit code 1 when a condition failed anywhere.
set -uo pipefail
[ $# -ge 1 ] || { sed -n '2,10s/^# \{0,1\}//p' "$0"; exit 2; }
stress=$(realpath "$1") form=${2:-full}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export HADALENS_CACHE=off POCL_CACHE_DIR=$work/pocl
mkdir "$POCL_CACHE_DIR"
names=() bad=0

# run NAME COMMAND...: rows of one implementation
run() {
    local name=$1
    shift
    echo "$name: $*" >&2
    "$@" --csv "$work/$name" >"$work/log" 2>&1
    local code=$?
    [ $code = 0 ] || bad=1
    if [ -s "$work/$name" ]; then
        names+=("$name")
    else
        echo "$name did not run (exit code $code)" >&2
        tail -5 "$work/log" >&2
    fi
    # a group that stopped early has no rows
    grep -h '^\[  FAILED' "$work/log" | sort -u >&2
}

run pthread env POCL_DEVICES=pthread "$stress" --form "$form"
run basic env POCL_DEVICES=basic "$stress" --form "$form"
mesa=${HADALENS_MESA:-}
icd=$(ls "$mesa"/etc/OpenCL/vendors/rusticl.icd 2>/dev/null)
if [ -n "$icd" ]; then
    mkdir "$work/vendors"
    find "$mesa/usr/lib" -name "$(basename "$(cat "$icd")")" -print -quit >"$work/vendors/rusticl.icd"
    # llvmpipe compiles some kernels for many minutes: a group that is not done in time must not cost the others
    for group in focus sums filters fit refinement frames broken sizes convolutions transforms; do
        run rusticl-$group env RUSTICL_ENABLE=llvmpipe OCL_ICD_VENDORS="$work/vendors" \
            LD_LIBRARY_PATH="$mesa/usr/lib/x86_64-linux-gnu" timeout 900 "$stress" --form tiny --only "stress_$group"
    done
    cat "$work"/rusticl-* >"$work/rusticl" 2>/dev/null
    names=($(printf '%s\n' "${names[@]}" | grep -v rusticl-) rusticl)
fi
command -v oclgrind >/dev/null && run Oclgrind oclgrind "$stress" --form tiny

files=()
for name in "${names[@]}"; do files+=("$work/$name"); done
awk -F';' -v names="${names[*]}" '
    BEGIN { count = split(names, name, " ") }
    FNR == 1 { file++ }
    {
        key = $5 ";" $4
        if (!(key in seen)) { seen[key] = ++rows; order[rows] = key }
        if (!(key in bound) || $3 > bound[key]) bound[key] = $3
        cell[key, file] = $2 ($1 == "pass" ? "" : " FAIL")
        if ($1 != "pass") failed[key] = 1
    }
    END {
        line = "| Condition |"; under = "|---|"
        for (f = 1; f <= count; f++) { line = line " " name[f] " |"; under = under "---|" }
        print line " Bound | By | Verdict |\n" under "---|---|---|"
        for (r = 1; r <= rows; r++) {
            split(order[r], part, ";")
            line = "| " part[1] " |"
            for (f = 1; f <= count; f++) line = line " " cell[order[r], f] " |"
            print line " " bound[order[r]] " | " part[2] " | " (failed[order[r]] ? "FAIL" : "pass") " |"
        }
    }' "${files[@]}"
exit $bad
