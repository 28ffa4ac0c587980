#!/bin/sh
# Time of the paper's camera's PSFs by wave optics, in turns with NumPy and SciPy: perf/optics.sh BUILD [ROUNDS]
set -eu
build=$1
rounds=${2:-3}
here=$(dirname "$0")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$build/bindings/cli/hadalens" optics --preset paper2022 --optics wave -o "$folder/wave" | tail -n 1 | sed 's/.*wave: //'
for round in $(seq "$rounds"); do
    "$build/perf/perf_optics" paper2022 mla 0 2 | sed -n 's/^round 2/hadalens, round '"$round"'/p'
    python3 "$here/peers/optics_scipy.py" "$folder/wave" 1 | sed "s/round 1/round $round/"
done
