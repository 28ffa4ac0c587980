#!/usr/bin/env bash
# What a frame asks of a device: launches, transfers, waits and arguments of a further frame, held below table.md.
#   frames.sh WORKLOAD LANES|GROUPS SHIM PRETEND HADALENS WORK
# WORKLOAD: sim512, crop300 or paper2022, a scene at two depths; surface300, one on a surface, told so. GROUPS: the
# device calls itself a GPU (PRETEND, of tests/devices/pretend.c). What the library needs once is no part of it: a run
# over two frames less one over a single frame.
set -euo pipefail
[ $# = 6 ] || { sed -n '2,6s/^# \{0,1\}//p' "$0" >&2; exit 2; }
workload=$1 shape=$2 shim=$(realpath "$3") pretend=$(realpath "$4") hadalens=$(realpath "$5")
here=$(realpath "$(dirname "$0")")
export LC_ALL=C HADALENS_TUNING=/nonexistent
mkdir -p "$6"
cd "$6"

# A camera and its model stay for the next run until the program or the library is built anew, as a fit may then choose
# otherwise; what is half made does not count. The large one's model is that of its point spread functions, which is
# quicker than a fit.
library=$(ldd "$hadalens" | sed -n 's/.*=> \(.*libhadalens\.so[^ ]*\).*/\1/p')
if [ ! -e "$workload.model" ] || [ "$hadalens" -nt "$workload.model" ] || [ "${library:-$hadalens}" -nt "$workload.model" ]; then
    pairs=8
    [ "$workload" != paper2022 ] || pairs=1
    rm -rf "$workload" "$workload.model" part
    scenes=(--preset "$workload" --test 2)
    [ "$workload" != surface300 ] || scenes=(--preset sim300 --surface slant,hill)
    "$hadalens" simulate "${scenes[@]}" --pairs "$pairs" --seed 4 --bits 16 -o "$workload" --quiet
    case $workload in
    paper2022) "$hadalens" fit --psf "$workload/psf.tif" --boundary circular --window 383x383 --colour --refine-tv 0 -o part --quiet ;;
    *) "$hadalens" fit "$workload" -o part --quiet ;;
    esac
    mv part "$workload.model"
fi
second=$(ls "$workload/test/raw" | grep -v '^frame' | sed -n 2p)
for i in 1 2; do ln -sf "$second" "$workload/test/raw/frame$i.tif"; done
paths=(linear refined)
[ "$workload" != surface300 ] || paths=(surface)

before=$shim disguise=
[ "$shape" = LANES ] || before=$pretend:$shim disguise=gpu,units=132
# count FRAMES OPTION...: the counts of a run over so many frames, in FRAMES.counts
count() {
    local frames=("$workload"/test/raw/frame[12].tif) number=$1
    shift
    rm -rf out "$number.counts"
    CL_PRETEND=$disguise LD_PRELOAD=$before CL_SHIM_COUNTS="$PWD/$number.counts" \
        "$hadalens" reconstruct "${frames[@]:0:number}" -m "$workload.model" -o out --no-preview \
        --skip prune,depths,channels,tiles --json "$@" >report.json
}

status=0
for path in "${paths[@]}"; do
    options=()
    [ "$path" != linear ] || options=(--refine 0)
    [ "$path" != surface ] || options=(--scene surface)
    count 1 "${options[@]}"
    count 2 "${options[@]}"
    echo "== $workload, $path, $shape"
    python3 "$here/counts.py" 1.counts 2.counts 1 "$here/table.md" "$workload $path ${shape,,}" || status=1
done
exit $status
