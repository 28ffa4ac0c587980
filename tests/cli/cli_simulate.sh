#!/usr/bin/env bash
# Simulated data sets.
. "$(dirname "$0")/cli_testing.sh"
small=(--preset sim300 --size 64x80 --window 24x24 --depths 2 --lenses 9 --pairs 2)

expect 0 '"pairs_per_depth": 2' simulate "${small[@]}" -o a --test 1 --json
is_json simulate
files a 14
expect 0 '' simulate "${small[@]}" -o b --test 1
diff -r a b >/dev/null || fail 'the same seed gave different files'
expect 0 '' simulate "${small[@]}" -o c --test 1 --seed 9
cmp -s a/z100mm/raw/scene0001.tif c/z100mm/raw/scene0001.tif && fail 'another seed gave the same frame'
[ "$(info a/psf.tif)" = '2 1 64 80 32' ] || fail "psf.tif: $(info a/psf.tif)"

# Pictures of other sizes and colours as scenes; integers; a sensor that crops; grey.
"$FRAME_TOOL" flat 'wide picture.tif' 40 90 1 0.5
mkdir pictures
mv 'wide picture.tif' pictures
cp a/z100mm/scene/scene0001.tif a/z100mm/scene/scene0002.tif pictures
expect 0 'too few to keep some' simulate "${small[@]}" --scenes pictures -o d --test 2 --bits 16 --boundary padded \
    --channels 1
[ "$(info d/z600mm/raw/scene0001.tif)" = '1 1 64 80 16' ] || fail '--bits 16 --channels 1'
grep -q '"boundary": "padded"' d/camera.json || fail '--boundary padded'
expect 0 'instead of 5' simulate "${small[@]}" --pairs 5 --scenes pictures -o e
files e/z100mm/raw 3

# What cannot be done leaves nothing.
expect 3 'not an empty folder' simulate "${small[@]}" -o a
expect 3 'is a file; a folder is needed' simulate "${small[@]}" -o a/camera.json/x
expect 3 'nosuch' simulate "${small[@]}" --scenes nosuch -o f
mkdir empty
expect 4 'holds no TIFF' simulate "${small[@]}" --scenes empty -o f
"$FRAME_TOOL" nan a/z100mm/scene/scene0001.tif pictures/a_nan.tif 3
expect 4 'a_nan.tif.*NaN' simulate "${small[@]}" --scenes pictures -o f
expect 2 'lens' simulate "${small[@]}" --lenses 5000 -o f
expect 2 'window' simulate --preset sim300 --window 999x999 -o f
lacks f .f.hadalens-*
finish
