#!/usr/bin/env bash
# A scene that is wider than the window. Light from beyond the window enters the frame as well; a model that was learned
# in a dark room takes it for something in the window. Two ways out: learn from pairs with such light, or take the whole
# field for the window.
#
#   examples/larger-field.sh [FOLDER]       (build/larger-field by default; begun afresh)
#
# Needs `hadalens` in the PATH or built in build/release; HADALENS names another one. About a minute.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
hadalens=${HADALENS:-$(command -v hadalens || echo "$here/build/release/bindings/cli/hadalens")}
out=${1:-$here/build/larger-field}
rm -rf "$out"
mkdir -p "$out"
cd "$out"
camera=(--preset sim300 --boundary padded --depths 1 --near 200 --pairs 16 --test 2 --quiet)

# say MODEL FRAMES: how good the middle 120 x 120 pixels of the frames in FRAMES/test are
say() {
    "$hadalens" reconstruct "$2"/test/raw/*.tif -m "$1.model" -o "pictures-$1-$2" --quiet
    "$hadalens" evaluate "pictures-$1-$2" "$2/test/truth" --window 120x120 |
        awk '$1 == "mean" && !n++ { printf "   PSNR %s dB, SSIM %s\n", $2, $3 }'
}

"$hadalens" simulate "${camera[@]}" --window 120x120 -o dark
"$hadalens" simulate "${camera[@]}" --window 120x120 --field 240x320 -o wide
"$hadalens" simulate "${camera[@]}" --window 240x320 -o whole
for name in dark wide whole; do "$hadalens" fit "$name" -o "$name.model" --quiet; done

echo "learned in a dark room, and used there"
say dark dark
echo "learned in a dark room, used where the scene is 2 x 2.7 times as wide as the window"
say dark wide
echo "learned with light from beyond the window"
say wide wide
echo "the whole field as the window"
say whole whole
printf '\nLook at %s/pictures-*/*_preview.png\n' "$out"
