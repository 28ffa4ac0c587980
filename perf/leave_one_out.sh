#!/usr/bin/env bash
# Leave-one-out through the command line, for a data set of one depth (a folder z<distance>mm with raw/ and scene/): every
# pair in turn is left out of the fit, reconstructed and compared. Prints the PSNR of each and the mean.
#   perf/leave_one_out.sh DATASET "fit options" "reconstruct options" [HADALENS]
set -euo pipefail
dataset=$(cd "$1" && pwd) fit=${2:-} reconstruct=${3:-}
here=$(cd "$(dirname "$0")/.." && pwd)
hadalens=${4:-$here/build/release/bindings/cli/hadalens}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
depth=$(basename "$(ls -d "$dataset"/z*mm)")
for left_out in "$dataset/$depth"/raw/*; do
    name=$(basename "$left_out")
    rm -rf "$work"/*
    mkdir -p "$work/set/$depth/raw" "$work/set/$depth/scene"
    for pair in "$dataset/$depth"/raw/*; do
        [ "$pair" != "$left_out" ] || continue
        ln -s "$pair" "$work/set/$depth/raw/"
        ln -s "$dataset/$depth/scene/$(basename "$pair")" "$work/set/$depth/scene/"
    done
    # the options are lists of words
    "$hadalens" fit "$work/set" -o "$work/model" $fit --quiet >/dev/null
    "$hadalens" reconstruct "$left_out" -m "$work/model" -o "$work/out" $reconstruct --no-preview --json >"$work/run.json"
    "$hadalens" evaluate "$work/out/${name%.*}_stack.tif" "$dataset/$depth/scene/$name" --json >"$work/table.json"
    python3 -c "
import json; t = json.load(open('$work/table.json')); r = json.load(open('$work/run.json'))
print('${name%.*}', '%.2f' % t['files'][0]['psnr'], r['files'][0]['frames'][0]['refine_steps'])"
done | awk '{ print; sum += $2 } END { printf "mean %.2f dB of %d pairs (name, PSNR, refinement steps)\n", sum / NR, NR }'
