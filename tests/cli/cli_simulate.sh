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

# Surfaces: a frame of each kind, the second layer of what overlaps, a map in millimetres or as shares of the range.
kinds=slant,half,hill,ball,steps,bars,overlap,outside
expect 0 '8 test frames on surfaces' simulate "${small[@]}" --surface $kinds -o g
files g/test/truth 25
[ "$(info g/test/truth/test01_slant_stack.tif)" = '2 3 24 24 32' ] || fail 'the stack of a surface'
[ "$(info g/test/truth/test07_overlap_depth2.tif)" = '1 1 24 24 32' ] || fail 'the second surface'
expect 0 '' simulate "${small[@]}" --surface $kinds --test 9 -o h
for file in g/test/raw/test0[1-6]*.tif; do cmp -s "$file" "h/test/raw/${file##*/}" || fail "$file: --test 9 changed it"; done
same_results h/test/truth/test01_slant_depth.tif h/test/truth/test09_slant_depth.tif && fail 'twice the same slant'
"$FRAME_TOOL" flat map.tif 20 30 1 250
expect 0 '"tests": 2' simulate "${small[@]}" --surface map.tif,ball --occlude -o i --json
"$FRAME_TOOL" flat flat_depth.tif 24 24 1 250
expect 0 '100.0% +100.0% +0 mm' evaluate i/test/truth/test01_surface_depth.tif flat_depth.tif
expect 2 'neither a kind of surface' simulate "${small[@]}" --surface valley -o f
"$FRAME_TOOL" flat below.tif 20 30 1 -1
expect 4 'below.tif.*-1 is not possible' simulate "${small[@]}" --surface below.tif -o f
expect 2 'two depths' simulate --preset sim300 --size 64x80 --window 24x24 --depths 1 --lenses 9 --surface ball -o f
expect 0 '' simulate "${small[@]}" --surface bars --full-well 10000 --read-noise 5 --adc-bits 12 --bits 16 -o l
[ "$(info l/test/raw/test01_bars.tif)" = '1 3 64 80 16' ] || fail 'a surface before a sensor'
# Encoded scenes: they are written as they are, the frames are made of their light.
expect 0 '' simulate "${small[@]}" --scene-response 2 --test 1 -o j
cmp -s a/z100mm/raw/scene0001.tif j/z100mm/raw/scene0001.tif && fail '--scene-response changed no frame'
expect 0 '(inf|1[0-9][0-9]\.[0-9]+) +1\.000' evaluate a/z100mm/scene/scene0001.tif j/z100mm/scene/scene0001.tif
expect 0 '(inf|1[0-9][0-9]\.[0-9]+) +1\.000' evaluate a/test/truth/test01_aif.tif j/test/truth/test01_aif.tif
expect 0 '"result_encoding": "2"' evaluate j/test/truth/test01_aif.tif a/test/truth/test01_aif.tif --json
grep -q '"scene_response": "2"' j/sensor.json || fail 'sensor.json does not give the response of the scenes'
expect 2 'no response' simulate "${small[@]}" --scene-response film -o f
expect 2 'scene_response|scene-response' simulate "${small[@]}" --scene-response auto -o f
# A sensor that crops.
expect 0 "% of the window's light misses the sensor" simulate "${small[@]}" --boundary padded --distance 60 -o k

# Distances that six digits do not tell apart, and a model that goes with such a set.
sed 's/100\.0$/12345.67,/;s/100\.0,/12345.67,/;s/600\.0/12345.68/' a/camera.json >near.json
expect 0 '' simulate --camera near.json --pairs 2 -o near
[ -d near/z12345.67mm ] && [ -d near/z12345.68mm ] || fail 'distances that are close'
expect 0 '12345.67' fit near -o near.model --no-leave-one-out --refine 0 --json
expect 0 '' train near -m near.model -o near2.model --steps 1 --hold-out 0

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
