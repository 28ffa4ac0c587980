#!/usr/bin/env bash
# Queues, halves of a device, and streaming: perf_queues on the camera sim512, then 50 frames through the command line
# against the computing alone, in turns. Prints what perf/results/queues-cpu.md holds.
#   perf/queues.sh BUILD [ROUNDS [STREAMS]]      BUILD: a build folder with the command line and HADALENS_PERF=ON
set -euo pipefail
build=$(cd "$1" && pwd)
rounds=${2:-21}
streams=${3:-5}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
hadalens="$build/bindings/cli/hadalens"
"$hadalens" simulate --preset sim512 --test 50 -q -o "$work/camera"
"$hadalens" fit "$work/camera" -q -o "$work/camera.model"
raws=("$work"/camera/test/raw/*.tif)

"$build/perf/perf_queues" "$work/camera.model" "$rounds" "${raws[@]:0:32}"

# Seconds from the first frame to the last, opening the device and making the plan left out.
stream() {
    rm -rf "$work/out"
    "$hadalens" reconstruct "${raws[@]}" -m "$work/camera.model" -o "$work/out" --no-preview --json --refine "$1" |
        awk '/^      "seconds": [0-9.]+/ { sub(/,/, "", $2); sum += $2 } END { printf "%.3f\n", sum }'
}
median() { sort -n | awk '{ a[NR] = $1 } END { print NR % 2 ? a[(NR + 1) / 2] : (a[NR / 2] + a[NR / 2 + 1]) / 2 }'; }

for ((i = 0; i < streams; i++)); do
    { read -r linear; read -r refined; } < <("$build/perf/perf_queues" --alone "$work/camera.model" "${raws[@]}")
    echo "$linear" >>"$work/linear.alone"
    echo "$refined" >>"$work/refined.alone"
    for refine in 0 auto; do
        kind=$([ "$refine" = 0 ] && echo linear || echo refined)
        seconds=$(stream "$refine")
        echo "$seconds" >>"$work/$kind.stream"
        awk -v a="$seconds" -v b="$(tail -n 1 "$work/$kind.alone")" 'BEGIN { print a / b }' >>"$work/$kind.ratio"
    done
done
printf '\n50 frames from TIFF to TIFF against computing alone, one queue:\n\n| | streaming, s | computing, s | ratio |\n|---|---|---|---|\n'
for kind in linear refined; do
    printf '| %s | %s | %s | %s |\n' "$kind" "$(median <"$work/$kind.stream")" "$(median <"$work/$kind.alone")" \
        "$(median <"$work/$kind.ratio")"
done
