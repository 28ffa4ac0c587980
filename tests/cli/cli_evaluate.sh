#!/usr/bin/env bash
# Comparing results with the truth.
. "$(dirname "$0")/cli_testing.sh"
truth="$camera/test/truth"

expect 0 '' reconstruct "$camera"/test/raw/*.tif -m "$model" -o out -q
expect 0 'PSNR dB.*test01_aif.*Stacks.*test01_stack.*Distance maps.*test01_depth' evaluate out "$truth"
expect 0 '"mean_error_steps"' evaluate out "$truth" --json
is_json evaluate
expect 0 'inf +1.000' evaluate "$truth/test01_stack.tif" "$truth/test01_stack.tif"
expect 0 '100.0% +100.0% +0 mm' evaluate "$truth/test01_depth.tif" "$truth/test01_depth.tif"
"$FRAME_TOOL" flat a_depth.tif 20 20 1 105
"$FRAME_TOOL" flat b_depth.tif 20 20 1 100
expect 0 '100.0% +- +5 mm' evaluate a_depth.tif b_depth.tif
expect 0 '100.0% +100.0% +5 mm' evaluate a_depth.tif b_depth.tif --distances 100,200,400
# A flat difference of 0.1: PSNR 20 dB, MAE 0.1; a gain makes it vanish.
"$FRAME_TOOL" flat a.tif 20 20 1 0.5
"$FRAME_TOOL" flat b.tif 20 20 1 0.4
expect 0 '20\.00 .*0\.1000' evaluate a.tif b.tif
expect 0 '0\.0000' evaluate a.tif b.tif --match-gain
# NAME_aif.tif goes with NAME.tif.
mkdir scenes results
cp b.tif scenes/one.tif
cp a.tif results/one_aif.tif
expect 0 '20\.00' evaluate results scenes
cp b.tif scenes/two.tif
expect 0 '1 file in scenes without a result' evaluate results scenes
rm results/*
expect 4 'no TIFF file' evaluate results scenes
"$FRAME_TOOL" flat c.tif 20 21 1 0.4
expect 4 'a.tif is 20x20.*c.tif is 20x21' evaluate a.tif c.tif
expect 4 '1 image .*3' evaluate a.tif "$truth/test01_stack.tif"
expect 3 'nosuch.tif' evaluate nosuch.tif a.tif
expect 2 'two files or two folders' evaluate out a.tif
finish
