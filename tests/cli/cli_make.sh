#!/usr/bin/env bash
# A small camera and its model, which the other scripts use.
rm -rf "$WORK"
. "$(dirname "$0")/cli_testing.sh"

expect 0 '3 depths from 100 to 600 mm, 5 pairs each, 64x80 colour frames, window 24x24' \
    simulate --preset sim300 --size 64x80 --window 24x24 --depths 3 --lenses 9 --pairs 5 --test 2 --seed 5 -o "$camera"
expect 0 'chosen.*15 pairs; at least 5 for each of 3 depths' fit "$camera" -o "$model"
has "$camera/psf.tif" "$camera/camera.json" "$camera/z100mm/raw/scene0001.tif" "$camera/z100mm/scene/scene0001.tif" \
    "$camera/test/raw/test01.tif" "$camera/test/truth/test01_stack.tif" "$camera/test/truth/test01_depth.tif" "$model"
finish
