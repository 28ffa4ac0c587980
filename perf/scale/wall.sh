#!/usr/bin/env bash
# Two ranks with a core each against one process with both, by the clock: perf/scale/wall.sh BUILD [ROUNDS]. Whole
# commands in turns, camera sim300, files in memory where /dev/shm is; of training the seconds of a step, as it tells
# them. For a machine that does nothing else; ratios are one process / two ranks, of medians.
set -euo pipefail
build=$(cd "$1" && pwd)
rounds=${2:-3}
alone=$build/bindings/cli/hadalens shared=$build/bindings/mpi/hadalens-mpi
export LC_ALL=C OMPI_MCA_plm=isolated OMPI_MCA_btl_vader_single_copy_mechanism=none
unset HADALENS_DEVICE
root=()
[ "$(id -u)" != 0 ] || root=(--allow-run-as-root)
place=/dev/shm
[ -w $place ] || place=${TMPDIR:-/tmp}
work=$(mktemp -d "$place/hadalens-wall-XXXXXX")
trap 'rm -rf "$work"' EXIT
cd "$work"

one() { "$alone" "$@"; }
two() { mpirun "${root[@]}" -np 2 "$shared" "$@"; }

# links FOLDER COUNT FILE...: so many names for the files, in turn; no frame is equal to the one before.
links() {
    local folder=$1 count=$2 i
    shift 2
    mkdir -p "$folder"
    for ((i = 0; i < count; i++)); do
        ln -f "${*:1 + i % $#:1}" "$folder/$(printf f%05d $i).tif"
    done
}

# Seconds of a command, and of a step of a training.
clock() {
    local begun=$EPOCHREALTIME
    "$@" >out.txt 2>&1 || { cat out.txt >&2; exit 1; }
    echo "$begun $EPOCHREALTIME" | awk '{printf "%.3f\n", $2 - $1}'
}
step() {
    "$@" --json >out.json 2>errors.txt || { cat errors.txt >&2; exit 1; }
    awk -F'[:,]' '/"seconds_per_step"/ {printf "%.4f\n", $2}' out.json
}
median() { sort -g | awk '{v[NR] = $1} END {print NR % 2 ? v[(NR + 1) / 2] : (v[NR / 2] + v[NR / 2 + 1]) / 2}'; }

# row NAME HOW ARGUMENTS...: both, in turns.
row() {
    local name=$1 how=$2 round
    shift 2
    rm -f one.txt two.txt
    for ((round = 0; round < rounds; round++)); do
        rm -rf out && "$how" one "$@" >>one.txt
        rm -rf out && "$how" two "$@" >>two.txt
    done
    awk -v name="$name" -v a="$(median <one.txt)" -v b="$(median <two.txt)" -v all="$(paste -sd' ' one.txt)" \
        -v both="$(paste -sd' ' two.txt)" 'BEGIN {printf "| %s | %s | %s | %.2f |\n", name, all, both, a / b}'
}

one simulate --preset sim300 --pairs 8 --test 8 -o camera -q
one fit camera -o camera.model -q
links linear 1200 camera/test/raw/*.tif
links refined 240 camera/test/raw/*.tif
for depth in camera/z*mm; do
    for kind in raw scene; do
        links "many/$(basename "$depth")/$kind" 240 "$depth/$kind"/*.tif
    done
done
frames=(-m camera.model -o out --no-preview --skip none -q)
train=(train camera -m camera.model -o net.model --log net.log --restart --validate-every 0 --show-every 0 --compose 0
    --save-every 1000 --steps 60)

printf '| work | one process, s | two ranks, s | ratio of medians |\n|---|---|---|---|\n'
row "1,200 frames, linear filters" clock reconstruct linear/*.tif --refine 0 "${frames[@]}"
row "240 frames, refined" clock reconstruct refined/*.tif "${frames[@]}"
row "fit of 240 pairs a depth" clock fit many -o out.model -q --no-leave-one-out --boundary circular --psf-sign free
row "a step of training, batch 8" step "${train[@]}" --batch 8
row "a step of training, batch 16" step "${train[@]}" --batch 16
