#!/usr/bin/env bash
# Time and measured change of skipping against max_error, on simulated cameras: sim512 with learned and with matched
# filters, paper2022 with learned ones (perf/perf_skip.c).
#   perf/skip.sh BUILD WORK [ROUNDS]       WORK: a folder for the data sets, 1.5 GB; what is there is used again
set -euo pipefail
build=$(realpath "$1") work=$2 rounds=${3:-5}
hadalens=$build/bindings/cli/hadalens
mkdir -p "$work"
cd "$work"
[ -d sim512 ] || "$hadalens" simulate -q -o sim512 --preset sim512 --pairs 3 --test 3
[ -e sim512.model ] || "$hadalens" fit -q sim512 -o sim512.model
[ -d grey512 ] || "$hadalens" simulate -q -o grey512 --preset sim512 --channels 1 --pairs 1 --test 3
[ -e matched512.model ] ||
    "$hadalens" fit -q --psf grey512/psf.tif -o matched512.model --window 192x192 --form matched --boundary circular
[ -d paper2022 ] || "$hadalens" simulate -q -o paper2022 --preset paper2022 --pairs 2 --test 2
[ -e paper2022.model ] || "$hadalens" fit -q paper2022 -o paper2022.model
errors=(band=0.668 3e-1 1e-1 3e-2 1e-2 3e-3 1e-3)
table() {
    printf '\n%s\n\n' "$1"
    "$build/perf/perf_skip" "$2" "$rounds" "${@:3}" -- "${errors[@]}"
}
table 'sim512, learned filters' sim512.model sim512/test/raw/*.tif sim512/z100mm/raw/*.tif
table 'sim512 in grey, matched filters' matched512.model grey512/test/raw/*.tif grey512/z100mm/raw/*.tif
table 'paper2022, learned filters' paper2022.model paper2022/test/raw/*.tif
