#!/usr/bin/env bash
# Quality of the whole way, as a user takes it: simulate a camera, fit it from 8 pairs a depth, reconstruct frames it has
# not seen (which depths are occupied is not told), evaluate. Prints a table.
#   perf/quality.sh [--scenes FOLDER --test-scenes FOLDER] [--presets "sim300 crop300"] [--frames 12] [--seeds "1 2"]
#                   [--occupied "1 2"] [--responses "linear srgb"] [--noise 0.01] [--designed] [--depths N] [--bin FOLDER]
# Without folders of photographs the scenes are procedural. crop300 is a sensor that loses light; with a response the
# scenes are encoded. --designed adds what the designer's own PSFs give with the same refinement: the most that learning
# could reach. Scenes on surfaces: perf/surface.py.
set -euo pipefail
here=$(cd "$(dirname "$0")/.." && pwd)
scenes=procedural test_scenes="" presets=sim300 frames=12 seeds="1 2" occupied_counts="1 2" responses=linear noise=0.01 designed=0 depths="" bin="$here/build/release/bindings/cli"
while [ $# -gt 0 ]; do
    case "$1" in
    --scenes) scenes=$2 ;;
    --test-scenes) test_scenes=$2 ;;
    --preset | --presets) presets=$2 ;;
    --frames) frames=$2 ;;
    --seeds) seeds=$2 ;;
    --occupied) occupied_counts=$2 ;;
    --responses) responses=$2 ;;
    --noise) noise=$2 ;;
    --depths) depths=$2 ;;
    --designed)
        designed=1
        shift
        continue
        ;;
    --bin) bin=$2 ;;
    *) echo "unknown: $1" >&2; exit 2 ;;
    esac
    shift 2
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
hadalens="$bin/hadalens"
echo "| preset | scenes | seed | occupied depths | PSNR of occupied planes, dB | by designed PSFs | all-in-focus, dB | map right | map covers | s a frame | fit, s |"
echo "|---|---|---|---|---|---|---|---|---|---|---|"
# As the learned model refines, with transfer functions from psf.tif.
by_design() {
    local facts
    facts=$(python3 -c "
import json
c = json.load(open('$work/camera/camera.json')); m = json.load(open('$work/fit.json'))['model']
print(','.join('%g' % d for d in c['distances_mm']), c['boundary'], '%dx%d' % (c['window_rows'], c['window_cols']), m['refine_steps'], m['refine_tv'], m['refine_colour'], m['refine_ridge'])")
    # shellcheck disable=SC2086 # the facts are words
    set -- $facts
    "$hadalens" fit --psf "$work/camera/psf.tif" --distances "$1" --boundary "$2" --window "$3" --psf-dark 0 --colour --refine "$4" -o "$work/designed" --quiet >/dev/null
    "$hadalens" reconstruct "$work"/camera/test/raw/*.tif -m "$work/designed" -o "$work/best" --refine-tv "$5" --refine-colour "$6" --refine-ridge "$7" --no-preview --quiet >/dev/null
    "$hadalens" evaluate "$work/best" "$work/camera/test/truth" --json >"$work/designed.json"
}
row() {
    local preset=$1 response=$2 seed=$3 occupied=$4
    set -- --scenes "$scenes" --preset "$preset" --pairs 8 --seed "$seed" --test "$frames" --test-depths "$occupied" --noise "$noise"
    [ -z "$test_scenes" ] || set -- "$@" --test-scenes "$test_scenes"
    [ -z "$depths" ] || set -- "$@" --depths "$depths"
    [ "$response" = linear ] || set -- "$@" --scene-response "$response"
    rm -rf "$work"/*
    "$hadalens" simulate "$@" -o "$work/camera" --quiet >/dev/null
    "$hadalens" fit "$work/camera" -o "$work/model" --json >"$work/fit.json" 2>/dev/null
    "$hadalens" reconstruct "$work"/camera/test/raw/*.tif -m "$work/model" -o "$work/out" --no-preview --json >"$work/run.json" 2>/dev/null
    "$hadalens" evaluate "$work/out" "$work/camera/test/truth" --json >"$work/table.json"
    if [ "$designed" = 1 ] && [ "$response" = linear ]; then
        by_design
    else
        echo '{"files": []}' >"$work/designed.json"
    fi
    python3 - "$preset" "$response" "$seed" "$occupied" "$work" <<'EOF'
import json, statistics, sys
preset, response, seed, occupied, work = sys.argv[1:]
t = json.load(open(work + "/table.json"))
fit = json.load(open(work + "/fit.json"))
files = json.load(open(work + "/run.json"))["files"]
seconds = statistics.median(f["frames"][0]["seconds"]["total"] for f in files[1:] or files)
best = json.load(open(work + "/designed.json"))
def mean(kind, key, t=t):
    values = [r[key] for r in t["files"] if r["kind"] == kind and r.get(key) is not None]
    return sum(values) / len(values) if values else float("nan")
by_design = f"{mean('stack', 'psnr', best):.2f}" if best["files"] else "-"
print(f"| {preset} | {response} | {seed} | {occupied} | {mean('stack', 'psnr'):.2f} | {by_design} | {mean('images', 'psnr'):.2f} | "
      f"{100 * mean('distance_map', 'within'):.1f} % | {100 * mean('distance_map', 'coverage'):.1f} % | {seconds:.3f} | "
      f"{fit.get('seconds', float('nan')):.2f} |")
EOF
}
for preset in $presets; do
    for response in $responses; do
        for seed in $seeds; do
            for occupied in $occupied_counts; do
                row "$preset" "$response" "$seed" "$occupied"
            done
        done
    done
done
