#!/usr/bin/env bash
# Scenes on surfaces, from the camera to the score: reconstruct --scene.
. "$(dirname "$0")/cli_testing.sh"

expect 0 '' simulate --preset crop300 --size 150x200 --window 64x64 --depths 6 --pairs 6 -o set --surface slant,bars --seed 5
expect 0 '' fit set -o camera.model
expect 0 'slant: a surface, .* mm' reconstruct set/test/raw/test01_slant.tif -m camera.model -o surface --scene surface
for file in stack aif depth confidence; do has surface/test01_slant_$file.tif; done
expect 0 '"scene": "surface"' reconstruct set/test/raw/test01_slant.tif -m camera.model -o found --json
is_json 'reconstruct --json of a surface'
expect 0 '"confidence": ".*test01_slant_confidence.tif"' reconstruct set/test/raw/test01_slant.tif -m camera.model -o found --json
same_results surface/test01_slant_aif.tif found/test01_slant_aif.tif || fail "given and found surfaces differ"
expect 0 'depths|mm' reconstruct set/test/raw/test01_slant.tif -m camera.model -o found --scene planes
lacks found/test01_slant_confidence.tif
expect 2 'take --scene planes' reconstruct set/test/raw/test01_slant.tif -m camera.model -o told --scene surface --occupied all
expect 2 'take --scene planes' reconstruct set/test/raw/test01_slant.tif -m camera.model -o told --scene surface --depths 1,2
expect 2 'auto\|planes\|surface' reconstruct set/test/raw/test01_slant.tif -m camera.model -o told --scene hill
# noise hides what a surface has beside two planes
expect 0 '' simulate --preset crop300 --size 150x200 --window 64x64 --depths 6 --pairs 6 -o noisy --surface hill --seed 5 --noise 0.03
expect 0 '' fit noisy -o noisy.model
expect 0 '"scene": "surface"' reconstruct noisy/test/raw/test01_hill.tif -m noisy.model -o noisy_out --json
finish
