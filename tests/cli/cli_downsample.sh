#!/usr/bin/env bash
# Sensors with more pixels than are wanted: frames, point spread functions and pairs are binned.
. "$(dirname "$0")/cli_testing.sh"
small=(--preset sim300 --size 128x160 --window 48x48 --depths 1 --lenses 9 --pairs 4 --test 1 --test-depths 1)

# Learned from binned pairs, the model bins frames by itself.
for bayer in none grbg; do
    expect 0 '' simulate "${small[@]}" --bayer $bayer -o $bayer
    raw=$bayer/test/raw/test01.tif
    expect 0 '64x80 frames binned by 2.*window 24x24' fit $bayer --bayer $bayer --downsample 2 -o $bayer.model
    expect 0 '' reconstruct $raw -m $bayer.model -o $bayer-known
    [ "$(info $bayer-known/test01_stack.tif)" = '1 3 24 24 32' ] || fail "binned: $(info $bayer-known/test01_stack.tif)"
    expect 0 'truth has 2 times the rows' evaluate $bayer-known $bayer/test/truth
    expect 0 '' evaluate $bayer-known/test01_aif.tif $bayer/test/truth/test01_aif.tif --json
    psnr=$(grep '"psnr"' stdout | grep -oE '[0-9]+' | head -n 1)
    [ "${psnr:-0}" -ge 24 ] || fail "binned: $psnr dB"
done
expect 0 '"downsample": 2' fit grbg --bayer grbg --downsample 2 -o again.model --json
is_json fit
cmp -s grbg.model again.model || fail 'the same pairs gave another model'
expect 2 'even' fit grbg --bayer grbg --downsample 3 -o x.model
expect 2 'downsample' fit none --downsample 0 -o x.model
expect 0 '' train none -m none.model -o trained.model --stage enhance --steps 1 --batch 1

# A frame of one channel is refused where nobody says that it is a mosaic; other sizes with what to do.
raw=none/test/raw/test01.tif
expect 4 'one channel' reconstruct grbg/test/raw/test01.tif -m none.model -o x
expect 4 'is for 3 channel.s. of 64 x 80' reconstruct none-known/test01_aif.tif -m none.model -o x
expect 0 '' fit --psf none/psf.tif --colour --distances 100 --window 48x48 --downsample 2 -o psf.model
expect 0 '' reconstruct $raw -m psf.model -o psf
[ "$(info psf/test01_stack.tif)" = '1 3 24 24 32' ] || fail "from a PSF: $(info psf/test01_stack.tif)"
expect 0 '64x80 frames binned by 2, window 24x24' fit --psf none/psf.tif --colour --distances 100 --frame $raw --window 48x48 --downsample 2 -o x.model
expect 0 'binned by 2 of the mosaic grbg' fit --psf grbg/psf.tif --colour --distances 100 --downsample 2 --bayer grbg -o x.model

# A model of small frames takes large ones where that is asked for, with a dark frame of either size.
"$FRAME_TOOL" flat dark.tif 128 160 3 0
expect 0 '' simulate "${small[@]}" --size 64x80 --window 24x24 -o little
expect 0 '' fit little -o little.model
expect 4 '2 times the 64 x 80.*--downsample 2' reconstruct $raw -m little.model -o x
expect 0 '' reconstruct $raw -m little.model --downsample 2 -o asked --dark dark.tif
expect 0 '' reconstruct little/test/raw/test01.tif -m none.model -o binned-before
expect 2 'downsample' reconstruct $raw -m little.model --downsample 0 -o x

# Sums say it too.
expect 0 '' fit none --downsample 2 --sums none.sums -o x.model
expect 0 'frames binned by 2' fit --merge none.sums -o x.model
expect 4 'binned by another number' fit little --merge none.sums -o x.model
expect 2 'sums' fit --merge none.sums --downsample 2 -o x.model

# Exposures of one scene: the long ones saturate, the short ones are noise; together they are better than each.
sensor=(--preset sim300 --size 64x80 --window 24x24 --depths 1 --lenses 9 --test 1 --test-depths 1 --pairs 4
    --full-well 8000 --read-noise 10)
expect 0 '' simulate "${sensor[@]}" -o sensor
expect 0 '' fit sensor -o sensor.model
for e in 0.4 3 24; do
    expect 0 '' simulate "${sensor[@]}" --exposure $e --adc-bits 12 -o exposed-$e
    cp exposed-$e/test/raw/test01.tif $e.tif
done
best=0
psnr() {
    expect 0 '' evaluate $1 sensor/test/truth/test01_aif.tif --match-gain --json
    grep '"psnr"' stdout | grep -oE '[0-9]+\.[0-9]' | head -n 1 | tr -d .
}
for e in 0.4 3 24; do
    expect 0 '' reconstruct $e.tif -m sensor.model -o single
    got=$(psnr single/${e}_aif.tif)
    [ "$got" -le "$best" ] || best=$got
done
expect 0 'exposure 3 is .* times the shortest' reconstruct --bracket 0.4.tif 3.tif 24.tif -m sensor.model -o bracket
got=$(psnr bracket/0.4_aif.tif)
[ "$got" -gt $((best + 5)) ] || fail "a bracket: $got, the best exposure: $best (tenths of dB)"
expect 0 'linear filters' reconstruct --bracket 0.4.tif 3.tif -m sensor.model -o x --refine 0
expect 2 'two exposures' reconstruct --bracket 0.4.tif -m sensor.model -o x
expect 2 'weights of its own' reconstruct --bracket 0.4.tif 3.tif --weights 24.tif -m sensor.model -o x
expect 3 'none.tif' reconstruct --bracket 0.4.tif none.tif -m sensor.model -o x
expect 4 '128 x 160' reconstruct --bracket 0.4.tif none/test/raw/test01.tif -m sensor.model -o x

finish
