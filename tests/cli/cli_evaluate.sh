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
"$FRAME_TOOL" flat negative.tif 20 20 1 -0.4
expect 0 '"gain": 0' evaluate negative.tif a.tif --match-gain --json
# A signal ends it between two pages, of which files may have many.
"$FRAME_TOOL" pages "$truth/test01_aif.tif" many.tif 20000
"$HADALENS" evaluate many.tif many.tif >stdout 2>stderr &
process=$!
sleep 1
kill -s TERM $process
SECONDS=0
wait $process
code=$?
[ $code = 130 ] || fail "exit code $code of evaluate after TERM"
[ $SECONDS -le 2 ] || fail "evaluate took $SECONDS s to stop"
rm many.tif
# Tables of emitters: one of two is found, and one of what was found is none.
printf 'x,y,z\n10,10,3\n20,20,5\n' >truth.csv
printf 'frame,x,y,z,amplitude\n0,10.3,10.4,4,1\n0,50,50,5,1\n' >found.csv
expect 0 'recall +precision +F1 +Jaccard +lateral px +axial depths.*found +0.500 +0.500 +0.500 +0.333 +0.500 +1.000' \
    evaluate found.csv truth.csv
expect 0 '"emitters_truth": 2.*"recall": 0.5' evaluate found.csv truth.csv --json
expect 0 'found +0.000 +0.000 +0.000 +0.000 +- +-' evaluate found.csv truth.csv --gate-depths 0.9
expect 2 'gate-pixels and --gate-depths must be greater than zero' evaluate found.csv truth.csv --gate-pixels 0
echo x,y >truth.csv
expect 3 "truth.csv has no column 'z'" evaluate found.csv truth.csv
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
# Windows: at the centre or anywhere; masks of the whole image's size.
expect 0 '20\.00' evaluate a.tif b.tif --window 11x13
expect 0 '20\.00' evaluate a.tif b.tif --window 3x4+17+16
expect 4 'does not lie within 20x20' evaluate a.tif b.tif --window 3x4+17+17
expect 2 '--window 3x is not a window' evaluate a.tif b.tif --window 3x
expect 2 '--window 3x4\+1 is not' evaluate a.tif b.tif --window 3x4+1
"$FRAME_TOOL" nan a.tif spoilt.tif 1
expect 4 'NaN' evaluate spoilt.tif b.tif
expect 0 '20\.00' evaluate spoilt.tif b.tif --window 10x10+5+5
expect 0 '20\.00' evaluate a.tif b.tif --mask a.tif
"$FRAME_TOOL" flat none.tif 20 20 1 0
expect 4 'mask leaves no pixel' evaluate a.tif b.tif --mask none.tif
expect 4 'mask is 20x21' evaluate a.tif b.tif --mask c.tif
expect 3 'nosuch.tif' evaluate a.tif b.tif --mask nosuch.tif
expect 0 '100.0% +- +5 mm' evaluate a_depth.tif b_depth.tif --mask a.tif --window 4x4
# Jumps, what is outside the range, a second surface, confidence.
expect 0 '' simulate --preset sim300 --size 64x80 --window 24x24 --depths 4 --lenses 9 --pairs 1 -o surfaces \
    --surface bars,overlap,outside
cp -r surfaces/test/truth guess
expect 0 'said so.*outside_depth .* 0\.0% .*maps at jumps.*bars_depth +100\.0% +100\.0% +0\.00.*Images at jumps.*bars_aif +inf' \
    evaluate guess surfaces/test/truth
rm guess/*_stack.tif
mv guess/test02_overlap_depth2.tif guess/test02_overlap_depth.tif # where it is NaN nothing is covered
expect 0 'overlap_depth +[1-9][0-9]\.[0-9]% +100\.0% +0 mm' evaluate guess surfaces/test/truth
"$FRAME_TOOL" flat guess/test01_bars_depth.tif 24 24 1 100
"$FRAME_TOOL" flat guess/test01_bars_confidence.tif 24 24 1 0.5
expect 0 'sure half' evaluate guess surfaces/test/truth
expect 0 '"risk_coverage": [0-9.]+' evaluate guess surfaces/test/truth --json
is_json 'evaluate --json of surfaces'
# The figures of the 2022 paper's code: equal errors at all pixels, so both PSNR agree.
expect 0 "authors' PSNR.*20\.00 .* 20\.00 " evaluate a.tif b.tif --authors
expect 0 '"authors_psnr": 19.99' evaluate a.tif b.tif --json
is_json 'evaluate --json'
# LPIPS, by a net with random weights.
"$FRAME_TOOL" lpips alex.safetensors
"$FRAME_TOOL" flat grey.tif 40 32 1 0.5
expect 0 'LPIPS.* inf .* 0\.0000' evaluate grey.tif grey.tif --lpips alex.safetensors
expect 0 '"lpips_net": "alex".*"lpips": -?[0-9.e-]+,' evaluate "$camera/test/raw/test01.tif" "$camera/test/raw/test02.tif" \
    --json --lpips alex.safetensors --peak 2 --lpips-net alex
expect 4 'at least 31 x 31, not 20 x 20' evaluate a.tif b.tif --lpips alex.safetensors
expect 4 'shape than that of VGG-16' evaluate a.tif b.tif --lpips alex.safetensors --lpips-net vgg
expect 4 'no tensor features.0.weight' evaluate a.tif b.tif --lpips "$model"
expect 3 'nosuch' evaluate a.tif b.tif --lpips nosuch
expect 2 'need --lpips' evaluate a.tif b.tif --lpips-net vgg
finish
