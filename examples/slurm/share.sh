#!/usr/bin/env bash
# One share of a data set, as links: every N-th pair of each distance, from the I-th (counted from 0) on.
#   share.sh DATASET N I FOLDER
set -euo pipefail
[ $# = 4 ] || { sed -n '3s/^# *//p' "$0" >&2; exit 2; }
dataset=$(realpath "$1") count=$2 index=$3 folder=$4
for depth in "$dataset"/z*mm; do
    mkdir -p "$folder/${depth##*/}/raw" "$folder/${depth##*/}/scene"
    number=0
    for raw in "$depth"/raw/*; do
        if [ $((number % count)) = "$index" ]; then
            ln -s "$raw" "$folder/${depth##*/}/raw/"
            ln -s "$depth/scene/${raw##*/}" "$folder/${depth##*/}/scene/"
        fi
        number=$((number + 1))
    done
done
[ ! -e "$dataset/camera.json" ] || ln -s "$dataset/camera.json" "$folder/"
