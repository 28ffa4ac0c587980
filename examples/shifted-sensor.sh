#!/usr/bin/env bash
# A sensor that does not stand behind the middle of the mask. Pairs of frame and scene tell the fit where everything
# stands, so nothing has to be aligned: a camera that was learned with its shift is as good as a straight one, until the
# pattern leaves the sensor. The straight camera's model, used on frames of the shifted one, shows what happens if the
# shift is not learned: the picture moves with the sensor.
#
#   examples/shifted-sensor.sh [FOLDER]       (build/shifted-sensor by default; begun afresh)
#
# Needs `hadalens` in the PATH or built in build/release; HADALENS names another one. About half a minute.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
hadalens=${HADALENS:-$(command -v hadalens || echo "$here/build/release/bindings/cli/hadalens")}
out=${1:-$here/build/shifted-sensor}
rm -rf "$out"
mkdir -p "$out"
cd "$out"

# say FRAMES MODEL: how good the test frames of a camera are, by a model
say() {
    local pictures="pictures-of-$1-by-$2"
    "$hadalens" reconstruct "camera$1"/test/raw/*.tif -m "camera$2.model" -o "$pictures" --quiet
    "$hadalens" evaluate "$pictures" "camera$1/test/truth" |
        awk '$1 == "mean" { printf "   %s: PSNR %s dB, SSIM %s\n", n++ ? "planes" : "all in focus", $2, $3
                            if (n == 2) exit }'
}

for shift in 0,0 0,30 40,60 0,150; do
    echo "the sensor $shift pixels (rows,columns) off the axis"
    "$hadalens" simulate --preset sim300 --boundary padded --depths 2 --test 2 --shift="$shift" -o "camera$shift" --quiet
    "$hadalens" fit "camera$shift" -o "camera$shift.model" --quiet
    say "$shift" "$shift"
done
echo "frames of the sensor at 0,30, seen with the model of the straight one"
say 0,30 0,0
printf '\nLook at %s/pictures-*/*_preview.png\n' "$out"
