#!/usr/bin/env bash
# Two versions of Hadalens against each other, in turns (old new, new old, ...): time of each row, and the ratio.
#   perf/against.sh OLD_BUILD NEW_BUILD [-o FILE] [-n ROUNDS] [-r ROWS]
# Builds with the command line and the tests (the check tool times single operations). A ratio is old/new of two runs
# side by side; above 1 the new version is faster. The table has the medians, and the least and greatest ratio; rows
# whose median is below 0.98 are marked. ROUNDS: 7 by default, about six minutes on two idle cores. ROWS: an extended
# regular expression of the names of rows. Files stand in memory (/dev/shm) where that is possible: newer versions wait
# until the disk has what they wrote. Where a version does more unless told otherwise, `like` tells it.
set -euo pipefail
usage() { sed -n '3s/^# *//p' "$0" >&2; exit 2; }
[ $# -ge 2 ] || usage
declare -A build=([old]=$(realpath "$1") [new]=$(realpath "$2"))
shift 2
file= rounds=7 only=.
while getopts o:n:r: letter; do
    case $letter in
    o) file=$(realpath -m "$OPTARG") ;;
    n) rounds=$OPTARG ;;
    r) only=$OPTARG ;;
    *) usage ;;
    esac
done
for side in old new; do
    for program in bindings/cli/hadalens tests/check/check; do
        [ -x "${build[$side]}/$program" ] || { echo "no $program in ${build[$side]}" >&2; exit 2; }
    done
done
work=$(mktemp -d /dev/shm/against.XXXXXX 2>/dev/null || mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
export LC_ALL=C HADALENS_TUNING=/nonexistent

# Runs a program of the side whose turn it is; its JSON or CSV stands in `said`.
hadalens() { "${build[$side]}/bindings/cli/hadalens" "$@" --json >said; }
check() { "${build[$side]}/tests/check/check" --mode time --csv "$@" >said; }

# Figures in milliseconds.
median() { sort -g | awk '{ v[NR] = $1 } END { print NR % 2 ? v[(NR + 1) / 2] : (v[NR / 2] + v[NR / 2 + 1]) / 2 }'; }
figure() { sed -n "s/^  \"$1\": \([0-9.e+-]*\),*\$/\1/p" said | awk '{ print $1 * 1000 }'; }
# the first frame of a process is left out
frames() { sed -n "s/^ *\"$1\": \([0-9.e+-]*\),*\$/\1/p" said | awk 'NR > 1 { print $1 * 1000 }' | median; }
started() { sed -n "s/^    \"$1\": \([0-9.e+-]*\),*\$/\1/p" said | awk '{ print $1 * 1000 }'; }
wall() { # the time of a command as a whole
    local from=$EPOCHREALTIME
    "$@" >/dev/null
    awk -v a="$from" -v b="$EPOCHREALTIME" 'BEGIN { print (b - a) * 1000 }'
}
# like COMMAND OPTION VALUE...: those options that this side knows, so that both do the same
like() {
    local help
    help=$("${build[$side]}/bindings/cli/hadalens" "$1" --help)
    shift
    for (( ; $# > 1; )); do
        ! grep -qE -e " $1( |$)" <<<"$help" || echo "$1 $2"
        shift 2
    done
}
operation() { check --op "$1" --shape "$2" && tail -n 1 said | cut -d, -f3; }
fitted() { hadalens fit "$@" -o out.model && figure seconds; }
step() { hadalens train "$@" -o out.model --restart --show-every 0 --validate-every 0 --save-every 1000 && figure seconds_per_step; }
frame() { # frame DATASET FRAMES WHAT OPTION...: milliseconds a frame
    local set=$1 count=$2 what=$3
    shift 3
    local raws=("$set"/test/raw/*.tif)
    hadalens reconstruct "${raws[@]:0:count}" -o out --no-preview "$@" && frames "$what"
}
begin() { hadalens bench --first-frame -m small.model small/test/raw/test01.tif --quick && started "$1"; }

light="--scene-response linear --exposure same" # nothing to find out about the scenes
weights="--refine-colour 1 --refine-shrink 0" # weights of refinement that 0.1.0 does not compare
flat="--scene planes --refine-colour 1"
planes="$flat --refine 12" # as many steps as 0.1.0 takes of two depths
rows=(
    "start: device open|begin open"
    "start: plan|begin plan"
    "start: first frame|begin 'first frame'"
    "simulate sim300, whole command|wall hadalens simulate --preset sim300 --pairs 2 -o out"
    "fit sim300, choosing by leave-one-out|fitted small \$(like fit \$light \$weights)"
    "fit sim300 padded|fitted small --boundary padded --no-leave-one-out \$(like fit --crop-passes 0)"
    "fit sim300, judged in the window|fitted small --refine 0 --outside 0.1 \$(like fit \$light)"
    "fit sim300 from its PSF|fitted --psf small/psf.tif --colour"
    "linear frame, sim300|frame small 16 total -m small.model --refine 0"
    "linear frame, sim512|frame large 4 total -m large.model --refine 0"
    "refined frame, sim300|frame small 8 total -m small.model \$(like reconstruct \$planes)"
    "refined frame, sim300, all depths|frame small 4 total -m small.model --occupied all --refine 8 \$(like reconstruct \$flat)"
    "refined frame, sim512|frame large 3 total -m large.model \$(like reconstruct \$planes)"
    "frames of two queues, whole command|wall frame small 16 total -m small.model --refine 0 --queues 2"
    "all-in-focus and distances, sim512|frame large 4 focus -m large.model --refine 0"
    "wiener, sim300|frame small 6 total -m small.model --method wiener"
    "Richardson-Lucy, sim300|frame small 3 total -m small.model --method rl --iterations 10"
    "FISTA with TV, sim300|frame small 3 total -m small.model --method fista --iterations 10 --tv 0.01"
    "ADMM, sim300|frame small 3 total -m small.model --method admm --iterations 10"
    "net forward, of a frame|frame small 6 enhance -m net.model --occupied all"
    "training step, enhance|step small -m small.model --steps 6 --batch 2 \$(like train --compose 0)"
    "training step, adversarial|step small -m net.model --stage adversarial \$(like train --critic-steps 0 --discriminator-steps 0 --compose 0) --steps 4 --batch 2"
    "training step, filters|step small --stage filters --steps 10"
    "register, whole command|wall hadalens register tiny --rotation 3"
    "evaluate, whole command|wall hadalens evaluate truth small/test/truth"
    "optics, rays, sim300|wall hadalens optics --preset sim300 -o out"
    "optics, waves|wall hadalens optics --preset sim300 --depths 2 --optics wave -o out"
    "FFT forward 300 x 400, 12|operation fft_forward r300c400b12"
    "FFT forward 512 x 512, 42|operation fft_forward r512c512b42"
    "FFT forward 1376 x 2064, 3|operation fft_forward r1376c2064b3"
    "FFT inverse 300 x 400, 12|operation fft_inverse r300c400b12"
    "FFT inverse 512 x 512, 42|operation fft_inverse r512c512b42"
    "FFT inverse 1376 x 2064, 3|operation fft_inverse r1376c2064b3"
    "Hadamard stage 512 x 512, 4 depths|operation hadamard r512c512k3d4h192w192b4"
    "refinement 300 x 400, 4 depths|operation refine r300c400h120w120d4s1n8"
    "convolution 32 to 32, 256 x 256|operation conv_forward i32o32r256c256p1a1"
    "its gradient of weights|operation conv_weights i32o32r256c256p1"
)

# What both versions work on comes from the old one. Each side runs once before it counts, so that kernels are there.
side=old
caches() { export POCL_CACHE_DIR=${build[$side]}/pocl-cache HADALENS_CACHE=${build[$side]}/program-cache; }
caches
prepare() {
    hadalens simulate --preset sim300 --pairs 6 --test 16 --seed 3 -o small
    hadalens simulate --preset sim512 --pairs 1 --test 4 --seed 4 -o large
    hadalens simulate --preset sim300 --size 150x200 --window 60x60 --depths 2 --pairs 3 --seed 5 -o tiny
    hadalens fit small -o small.model
    hadalens fit --psf large/psf.tif --colour --refine 8 -o large.model
    hadalens train small -m small.model -o net.model --steps 1 --batch 1 --show-every 0 --validate-every 0
    cp -r small/test/truth truth
}
prepare
run() { # the row's figure by this side
    caches
    rm -rf out out.model out.model.log
    eval "$1"
}

for round in $(seq 0 "$rounds"); do
    echo "round $round of $rounds" >&2
    order="old new"
    [ $((round % 2)) = 0 ] || order="new old"
    for i in "${!rows[@]}"; do
        name=${rows[i]%%|*}
        [[ $name =~ $only ]] || continue
        declare -A value=()
        for side in $order; do
            value[$side]=$(run "${rows[i]#*|}") || { echo "$side: the row '$name' failed: ${rows[i]#*|}" >&2; exit 1; }
        done
        [ "$round" = 0 ] || echo "${value[old]} ${value[new]}" >>"row.$i"
    done
done

table() {
    printf '%s against %s, %s rounds in turns, %s.\n\n' "${build[old]}" "${build[new]}" "$rounds" \
        "$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -n 1), $(nproc) cores, load $(cut -d' ' -f1 /proc/loadavg)"
    echo '| row | old, ms | new, ms | old/new | least | greatest | |'
    echo '|---|---:|---:|---:|---:|---:|---|'
    for i in "${!rows[@]}"; do
        [ -e "row.$i" ] || continue
        awk '{ print $1 / $2 }' "row.$i" | sort -g >ratios
        printf '| %s | %.4g | %.4g | %.3f | %.3f | %.3f | %s |\n' "${rows[i]%%|*}" "$(cut -d' ' -f1 "row.$i" | median)" \
            "$(cut -d' ' -f2 "row.$i" | median)" "$(median <ratios)" "$(head -n 1 ratios)" "$(tail -n 1 ratios)" \
            "$(median <ratios | awk '$1 < 0.98 { print "slower" }')"
    done
}
if [ -n "$file" ]; then
    table | tee "$file"
else
    table
fi
