#!/usr/bin/env bash
# Sensors with a colour filter mosaic: simulated, learned, reconstructed.
. "$(dirname "$0")/cli_testing.sh"
small=(--preset sim300 --size 64x80 --window 24x24 --depths 1 --lenses 9 --pairs 4 --test 1 --test-depths 1)

expect 0 '' simulate "${small[@]}" --bayer gbrg -o a
expect 0 '' simulate "${small[@]}" -o full
raw=a/test/raw/test01.tif
[ "$(info $raw)" = '1 1 64 80 32' ] || fail "a frame of a mosaic: $(info $raw)"
[ "$(info a/z100mm/raw/scene0001.tif)" = '1 1 64 80 32' ] || fail 'a pair of a mosaic'
[ "$(info a/z100mm/scene/scene0001.tif)" = '1 3 24 24 32' ] || fail 'the scene of a mosaic'
grep -q '"mosaic": "gbrg"' a/sensor.json || fail 'sensor.json does not name the mosaic'
expect 2 'three channels' simulate "${small[@]}" --channels 1 --bayer gbrg -o b
expect 2 '--bayer takes' simulate "${small[@]}" --bayer rgb -o b
expect 0 '' simulate "${small[@]}" --bayer rggb --bits 16 -o b
[ "$(info b/test/raw/test01.tif)" = '1 1 64 80 16' ] || fail '--bayer with --bits 16'

# Learned from pairs of mosaics, the model knows the pattern.
expect 0 'frames of the mosaic gbrg' fit a --bayer gbrg -o a.model
expect 0 '"mosaic": "gbrg"' fit a --bayer gbrg -o again.model --json
is_json fit
cmp -s a.model again.model || fail 'the same pairs gave another model'
expect 4 'colour filter mosaic, name its pattern with --bayer' fit a -o x.model
expect 4 'leave --bayer out' fit full --bayer gbrg -o x.model
expect 0 '' reconstruct $raw -m a.model -o known
[ "$(info known/test01_stack.tif)" = '1 3 24 24 32' ] || fail "planes of a mosaic: $(info known/test01_stack.tif)"
expect 0 '' reconstruct $raw -m a.model -o told --bayer gbrg
same_results known/test01_stack.tif told/test01_stack.tif || fail '--bayer is not what the model says'
expect 0 '' evaluate known/test01_aif.tif a/test/truth/test01_aif.tif --json
psnr=$(grep '"psnr"' stdout | grep -oE '[0-9]+' | head -n 1)
[ "${psnr:-0}" -ge 20 ] || fail "a mosaic: $psnr dB"
expect 0 '' reconstruct $raw -m a.model -o linear --refine 0
expect 0 '' reconstruct $raw -m a.model -o wiener --method wiener
expect 4 'name its pattern with --bayer' reconstruct $raw -m a.model -o x --bayer none
expect 0 '' reconstruct full/test/raw/test01.tif -m a.model -o colours
expect 4 'leave --bayer out' reconstruct full/test/raw/test01.tif -m a.model -o x --bayer gbrg
expect 2 '--bayer takes' reconstruct $raw -m a.model -o x --bayer bayer

expect 0 '100 mm' register a --bayer gbrg -o registered
cmp -s a/z100mm/raw/scene0001.tif registered/z100mm/raw/scene0001.tif || fail 'register changed a frame'
expect 4 'colour filter mosaic, name its pattern with --bayer' register a

# Sums say it too.
expect 0 '' fit a --bayer gbrg --sums a.sums -o x.model
expect 0 'frames of the mosaic gbrg' fit --merge a.sums -o merged.model
expect 0 '' fit full --sums full.sums -o full.model
expect 4 'mosaic differs' fit --merge a.sums --merge full.sums -o x.model
expect 4 'name its pattern with --bayer' reconstruct $raw -m full.model -o x
expect 0 '' reconstruct $raw -m full.model -o asked --bayer gbrg

# Known by the point spread function.
expect 0 'frames of the mosaic gbrg' fit --psf a/psf.tif --colour --distances 100 --window 24x24 --boundary circular \
    --bayer gbrg -o psf.model
expect 0 'found from the frame' reconstruct $raw -m psf.model -o psf
expect 0 'one channel and is taken for a raw capture of the mosaic.*--colour' fit --psf a/psf.tif --distances 100 --bayer gbrg -o x.model
expect 0 '' fit --psf a/psf.tif --distances 100 --window 24x24 -o grey.model
expect 4 'three channels' reconstruct $raw -m grey.model -o x --bayer gbrg

# Dark frames and weights of one channel or three, not finite values.
"$FRAME_TOOL" flat dark.tif 64 80 1 0
"$FRAME_TOOL" flat grey.tif 64 80 1 1
"$FRAME_TOOL" flat even.tif 64 80 3 0.5
expect 0 '' reconstruct $raw -m a.model -o dark --dark dark.tif --weights grey.tif
expect 0 '' reconstruct $raw -m a.model -o even --dark none --weights even.tif
same_results known/test01_stack.tif even/test01_stack.tif || fail 'equal weights changed the planes'
# Flat frames: even ones change nothing; the model keeps what it was learned with.
expect 0 '' reconstruct $raw -m a.model -o even-flat --flat even.tif
same_results known/test01_stack.tif even-flat/test01_stack.tif || fail 'an even flat frame changed the planes'
expect 0 '' fit a --bayer gbrg --flat grey.tif -o flat.model
expect 0 '' reconstruct $raw -m flat.model -o kept
same_results known/test01_stack.tif kept/test01_stack.tif || fail 'pairs that were divided by 1 gave another camera'
expect 0 'not divided' fit --psf a/psf.tif --colour --distances 100 --window 24x24 --bayer gbrg --flat grey.tif -o x.model
expect 0 '' fit --psf a/psf.tif --distances 100 --window 24x24 --bayer gbrg --flat grey.tif -o x.model
expect 7 'no light' reconstruct $raw -m a.model -o x --flat dark.tif
expect 4 'flat_frame must have' reconstruct $raw -m a.model -o x --flat known/test01_aif.tif
expect 4 'flat frame 3 of 24 x 24' fit a --bayer gbrg --flat known/test01_aif.tif -o x.model
expect 2 'belong to pairs' fit --merge a.sums --flat grey.tif -o x.model

"$FRAME_TOOL" nan $raw nan.tif 5
expect 4 '5 pixel' reconstruct nan.tif -m a.model -o x
expect 0 '5 ' reconstruct nan.tif -m a.model -o nan --repair

finish
