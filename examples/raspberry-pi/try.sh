#!/usr/bin/env bash
# The recipe of docs/how-to/calibrate-a-camera.md without a Raspberry Pi: a stand-in shows pictures and plays the camera.
#
#   examples/raspberry-pi/try.sh [FOLDER]       (build/raspberry-pi by default; begun afresh)
#
# Needs `hadalens` in the PATH or built in build/release; HADALENS names another one. About a minute.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
house=$(cd "$here/../.." && pwd)
export HADALENS=${HADALENS:-$(command -v hadalens || echo "$house/build/release/bindings/cli/hadalens")}
out=${1:-$house/build/raspberry-pi}
rm -rf "$out"
mkdir -p "$out"
cd "$out"
export STAND_IN=$out STAND_IN_MM=300 PATH="$here/stand-in:$PATH"

echo "Pictures to show: twelve drawn ones; your own photographs are better"
"$HADALENS" simulate --preset sim300 --size 240x300 --window 200x240 --depths 1 --pairs 12 --scene-response srgb --seed 8 \
    -o drawn --quiet
mkdir pictures
mv drawn/z*mm/scene/*.tif pictures/

echo "1. Capture pairs; the last two are kept to judge the model by"
python3 "$here/capture.py" pictures/scene00{01,02,03,04,05,06,07,08,09,10}.tif -o captures/z300mm --settle 0.1
python3 "$here/capture.py" pictures/scene00{11,12}.tif -o judge/z300mm --settle 0.1

echo "2. How do the pictures stand on the sensor?"
"$HADALENS" register captures -o camera --window 100x120

echo "3. Learn the camera"
"$HADALENS" fit camera -o camera.model

echo "4. Reconstruct frames that it never saw"
"$HADALENS" reconstruct judge/z300mm/raw/*.dng -m camera.model -o results --png

echo "5. What the camera sees now: frames as they come"
mkdir -p now
cp judge/z300mm/raw/scene0011.dng now/
"$HADALENS" reconstruct --watch now -m camera.model --stream mjpeg --idle 1 >live.mjpeg
printf 'Look at %s\n' "$out"/results/*_preview.png
