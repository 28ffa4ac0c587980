#!/usr/bin/env bash
# Reconstruction: results, options, sequences, and files that cannot be done.
. "$(dirname "$0")/cli_testing.sh"
raw="$camera/test/raw"

expect 0 'test01: .*unexplained.*test02: ' reconstruct "$raw"/*.tif -m "$model" -o out
files out 8
has out/test01_{stack,aif,depth}.tif out/test01_preview.png out/test02_stack.tif
[ "$(info out/test01_stack.tif)" = '3 3 24 24 32' ] || fail "stack: $(info out/test01_stack.tif)"
[ "$(info out/test01_aif.tif)" = '1 3 24 24 32' ] || fail "aif: $(info out/test01_aif.tif)"
[ "$(info out/test01_depth.tif)" = '1 1 24 24 32' ] || fail "depth: $(info out/test01_depth.tif)"
expect 0 '"occupied_mm"' reconstruct "$raw/test01.tif" -m "$model" -o json --json
is_json reconstruct
same_results out/test01_stack.tif json/test01_stack.tif || fail 'two runs gave different stacks'
expect 0 '' reconstruct "$raw/test01.tif" -m "$model" -o quiet -q
[ ! -s stdout ] && [ ! -s stderr ] || fail '--quiet is not quiet'
"$EXAMPLE" "$model" "$raw/test01.tif" example.tif >stdout 2>stderr || fail 'the example program failed'
[ "$("$FRAME_TOOL" info example.tif)" = "$("$FRAME_TOOL" info out/test01_aif.tif)" ] || fail 'the example differs'

# Options.
one=("$raw/test01.tif" -m "$model")
expect 0 '' reconstruct "${one[@]}" -o depths --depths 1,3 --no-preview --png
[ "$(head -c 4 depths/test01_aif.png | tail -c 3)" = PNG ] || fail 'no picture'
lacks depths/test01_preview.png
[ "$(info depths/test01_stack.tif)" = '2 3 24 24 32' ] || fail "--depths: $(info depths/test01_stack.tif)"
files depths 4
expect 0 '' reconstruct "${one[@]}" -o arrays --format npy --no-preview
files arrays 3
for result in stack aif depth; do
    expect 0 'inf +1.000|mean error.*0 mm +0.00' evaluate "arrays/test01_$result.npy" "out/test01_$result.tif"
done
expect 2 'resume needs what TIFF files say' reconstruct "${one[@]}" -o none --format npy --resume
lacks none
expect 0 'all 3 depths' reconstruct "${one[@]}" -o a --occupied all
expect 0 '100 and 600 mm' reconstruct "${one[@]}" -o a --occupied 100mm,600mm --refine 3
expect 0 '3 refinement steps' reconstruct "${one[@]}" -o a --occupied 1 --refine 3
expect 0 '"refine_steps": 0' reconstruct "${one[@]}" -o a --refine 0 --json
expect 0 '' reconstruct "${one[@]}" -o bits --bits 16 --white 2 --gamma 0.5 --half --batch 1
[ "$(info bits/test01_stack.tif)" = '3 3 24 24 16' ] || fail '--bits 16'
expect 0 '' reconstruct "${one[@]}" -o dim --bits 8 --white 50
expect 0 'steps of 8 bits are coarser than the noise' fit --psf dim/test01_aif.tif --psf-dark 0 -o x.model
expect 0 '' reconstruct "${one[@]}" -o bits --bits 8
expect 0 '' reconstruct "${one[@]}" -o matched --method matched --refine 0
expect 0 '' reconstruct "${one[@]}" -o wiener --method wiener --refine 0
same_results matched/test01_stack.tif wiener/test01_stack.tif && fail '--method changed nothing'
# A net in the model: planes go through it, or not.
"$FRAME_TOOL" enhance "$model" enhance.model || fail 'no model with a net'
expect 0 'plane[s]* enhanced' reconstruct "$raw/test01.tif" -m enhance.model -o enhanced
same_results out/test01_stack.tif enhanced/test01_stack.tif && fail 'the net changed nothing'
expect 0 '"enhanced": 0' reconstruct "$raw/test01.tif" -m enhance.model -o plain --no-enhance --json
same_results out/test01_stack.tif plain/test01_stack.tif || fail '--no-enhance is not the model without its net'
expect 2 '3 depths from 100 to 600 mm' reconstruct "${one[@]}" -o a --depths 4
expect 2 "cannot use '150mm'" reconstruct "${one[@]}" -o a --occupied 150mm
# Total variation: what the model says, another weight, none.
expect 0 '' reconstruct "${one[@]}" -o smooth --refine 6 --refine-tv 0.05 --refine-ridge 0 --no-preview
expect 0 '' reconstruct "${one[@]}" -o rough --refine 6 --refine-tv 0 --no-preview
same_results smooth/test01_stack.tif rough/test01_stack.tif && fail '--refine-tv changed nothing'
expect 2 '--refine-tv takes' reconstruct "${one[@]}" -o a --refine-tv -1
expect 0 '' reconstruct "${one[@]}" -o grey --refine 6 --refine-tv 0.05 --refine-colour 4 --refine-ridge 0 --no-preview
same_results smooth/test01_stack.tif grey/test01_stack.tif && fail '--refine-colour changed nothing'
expect 2 '--refine-colour takes' reconstruct "${one[@]}" -o a --refine-colour 0.5
expect 0 '' reconstruct "${one[@]}" -o filters --occupied 100mm --refine 6 --refine-tv 0.05 --refine-ridge 4 --no-preview
expect 0 '' reconstruct "${one[@]}" -o edges --occupied 100mm --refine 6 --refine-tv 0.05 --refine-ridge 0 --no-preview
same_results filters/test01_stack.tif edges/test01_stack.tif && fail '--refine-ridge changed nothing'
expect 2 '--refine-ridge takes' reconstruct "${one[@]}" -o a --refine-ridge -1
two=(--occupied all --refine 6 --no-preview)
expect 0 '' reconstruct "${one[@]}" -o faded "${two[@]}"
expect 0 '' reconstruct "${one[@]}" -o unfaded "${two[@]}" --crosstalk 0
same_results faded/test01_stack.tif unfaded/test01_stack.tif && fail '--crosstalk 0 changed nothing'
expect 2 '--crosstalk takes' reconstruct "${one[@]}" -o a --crosstalk 1.5
expect 2 '--refine takes' reconstruct "${one[@]}" -o a --refine soon
expect 2 'greater than zero' reconstruct "${one[@]}" -o a --gamma 0

# Dark: an offset of the sensor, taken off in three ways, gives the frame back.
"$FRAME_TOOL" offset "$raw/test01.tif" offset.tif 0.25
"$FRAME_TOOL" flat dark.tif 64 80 3 0.25
expect 0 '' reconstruct offset.tif -m "$model" -o level --dark 0.25
expect 0 '' reconstruct offset.tif -m "$model" -o frame --dark dark.tif
expect 0 '' reconstruct offset.tif -m "$model" -o auto --dark auto
expect 0 '' evaluate level/offset_aif.tif out/test01_aif.tif --json
psnr=$(grep '"psnr"' stdout | grep -oE '[0-9]+' | head -n 1)
[ "${psnr:-100}" -ge 80 ] || fail "--dark LEVEL: $psnr dB"
"$FRAME_TOOL" flat small.tif 6 8 3 0.25
expect 4 '' reconstruct offset.tif -m "$model" -o frame --dark small.tif

# The camera belongs to the frames, or turned another way it would.
psf=(fit --psf "$camera/psf.tif" --colour --boundary circular --window 24x24)
expect 0 '' "${psf[@]}" -o upright.model
expect 0 '"verdict": "belongs"' reconstruct "${one[@]/$model/upright.model}" -o match --strict --no-preview --json
is_json 'a frame and its camera'
for turn in 180 mirror flip; do
    expect 0 '' "${psf[@]}" -o turned.model --turn "$turn"
    expect 0 "test01: the point spread function .* explains the frame .* times better.*--turn $turn" \
        reconstruct "${one[@]/$model/turned.model}" -o match --no-preview
    expect 8 '"verdict": "turned"' reconstruct "${one[@]/$model/turned.model}" -o strict --no-preview --strict --json
    is_json "a camera turned: $turn"
    has strict/test01_{stack,aif,depth}.tif
    rm -r strict
done
grep -q '"exit_code": 8' stdout || fail 'the document has not exit code 8'
grep -q 'note' stderr || fail 'no note with --json'
expect 0 '' reconstruct "$raw"/*.tif -m turned.model -o match --no-preview
[ "$(grep -c 'times better' stderr)" = 1 ] || fail 'not the first frame alone'
expect 8 '' reconstruct "$raw"/*.tif -m turned.model -o match --no-preview --strict
[ "$(grep -c 'times better' stderr)" = 2 ] || fail '--strict: not the first frame of each file'
expect 0 '' reconstruct "$raw"/*.tif -m turned.model -o match --no-preview --refine 0
[ ! -s stderr ] || fail 'linear filters were compared'
expect 0 '' simulate --preset sim300 --mask contour --size 64x80 --window 24x24 --depths 3 --pairs 1 --test 1 --seed 8 -o other
expect 8 'no better than any other' reconstruct other/test/raw/test01.tif -m upright.model -o match --no-preview --strict
expect 8 '"verdict": "unrelated"' reconstruct other/test/raw/test01.tif -m "$model" -o match --no-preview --strict --json
expect 0 '"verdict": "belongs"' reconstruct "${one[@]}" -o match --no-preview --strict --json

# Weights of pixels: equal ones change nothing, black ones leave nothing.
"$FRAME_TOOL" flat even.tif 64 80 1 0.5
"$FRAME_TOOL" flat black.tif 64 80 3 0
expect 0 '' reconstruct "${one[@]}" -o weighed --occupied 100mm --weights even.tif --no-preview
expect 0 '' reconstruct "${one[@]}" -o unweighed --occupied 100mm --no-preview
same_results weighed/test01_stack.tif unweighed/test01_stack.tif || fail '--weights EVEN'
expect 4 'pixel_weights must have' reconstruct "${one[@]}" -o weighed --weights small.tif
expect 2 'all weights of pixels are 0' reconstruct "${one[@]}" -o weighed --weights black.tif
expect 2 'linear filters take no weights' reconstruct "${one[@]}" -o weighed --weights even.tif --refine 0
expect 3 'nosuch.tif' reconstruct "${one[@]}" -o weighed --weights nosuch.tif

# A sequence.
"$FRAME_TOOL" pages "$raw/test01.tif" sequence.tif 3
expect 0 'sequence: 3 frames' reconstruct sequence.tif -m "$model" -o seq
[ "$(info seq/sequence_stack.tif)" = '9 3 24 24 32' ] || fail "sequence: $(info seq/sequence_stack.tif)"
[ "$(info seq/sequence_depth.tif)" = '3 1 24 24 32' ] || fail "sequence: $(info seq/sequence_depth.tif)"
# A weight that the first frame finds is kept for the others; with a single depth there is no distance map.
"$FRAME_TOOL" flat seq/sequence_depth.tif 24 24 1 100
expect 0 '"refine_tv_kept": false.*"refine_tv_kept": true.*"refine_tv_kept": true' \
    reconstruct sequence.tif -m upright.model -o seq --depths 1 --skip none --json
grep -q distance_map stdout && fail 'a distance map of a single depth'
lacks seq/sequence_depth.tif
expect 0 'sequence: there already' reconstruct sequence.tif -m upright.model -o seq --depths 1 --resume
expect 0 'kept from an earlier frame' reconstruct sequence.tif -m upright.model -o seq --skip none
has seq/sequence_depth.tif
# Refinement that goes on from the frame before; several files are a sequence then.
expect 0 '"warm_started": true.*"gain": 1.*"warm_started": true' \
    reconstruct sequence.tif -m upright.model -o seq --depths 1 --skip none --warm --json
expect 0 'kept from an earlier frame' reconstruct sequence.tif "$raw/test01.tif" -m upright.model -o seq --skip none --warm
# Steps that keep up: with a slow camera all do; with one that is too fast a step is what --refine 1 makes.
quick=(reconstruct sequence.tif -m "$model" -o seq --scene planes)
expect 0 'with all steps of refinement' "${quick[@]}" --fps 0.001
expect 0 '1e.06 frames a second are too many.*refine 1 ' "${quick[@]}" --fps 1e6 --skip none
mv seq/sequence_stack.tif kept.tif
expect 0 'sequence: 3 frames' "${quick[@]}" --refine 1 --skip none
cmp -s kept.tif seq/sequence_stack.tif || fail '--fps is not --refine with its number'
expect 0 '"pace": {[^}]*"refine": 1,' "${quick[@]}" --fps 1e6 --skip none --json
expect 2 'say the steps with --refine' "${quick[@]}" --fps 10 --method rl
expect 2 'two frames or more' reconstruct "$raw/test01.tif" -m "$model" -o seq --fps 10
expect 0 'found from the frame' reconstruct sequence.tif "$raw/test01.tif" -m upright.model -o seq --skip none
grep -q 'kept from' stdout stderr && fail 'several files are taken for a sequence'
expect 0 'found from the frame' reconstruct sequence.tif -m upright.model -o seq --skip none --refine-tv frame

# Bad files do not stop the others, and leave nothing.
"$FRAME_TOOL" nan "$raw/test01.tif" nan.tif 5
"$FRAME_TOOL" flat size.tif 60 80 3 0.5
"$FRAME_TOOL" flat grey.tif 64 80 1 0.5
head -c 2000 "$raw/test01.tif" >cut.tif
: >empty.tif
echo 'not a picture' >text.tif
expect 4 'nan.tif: 5 .*--repair' reconstruct nan.tif -m "$model" -o bad
expect 4 'size.tif: .*60 x 80.*64 x 80' reconstruct size.tif -m "$model" -o bad
expect 4 'grey.tif: .*one channel.*--bayer' reconstruct grey.tif -m "$model" -o bad
expect 3 'cut.tif' reconstruct cut.tif -m "$model" -o bad
expect 3 'empty.tif' reconstruct empty.tif -m "$model" -o bad
expect 3 'text.tif' reconstruct text.tif -m "$model" -o bad
expect 3 'a folder; name the files' reconstruct "$raw" -m "$model" -o bad
expect 3 'nosuch.tif' reconstruct nosuch.tif -m "$model" -o bad
files bad 0
expect 1 '3 of 4 files failed' reconstruct nan.tif cut.tif "$raw/test01.tif" size.tif -m "$model" -o some
files some 4
expect 4 '2 of 3 files failed' reconstruct nan.tif "$raw/test01.tif" size.tif -m "$model" -o some --json
is_json 'files that failed'
expect 0 '5 pixels repaired' reconstruct nan.tif -m "$model" -o some --repair
"$FRAME_TOOL" pages nan.tif two.tif 2
expect 4 'frame 1 of 2' reconstruct two.tif -m "$model" -o bad
files bad 0

# Bad models, bad folders, one name twice.
expect 3 'nosuch.model' reconstruct "$raw/test01.tif" -m nosuch.model -o bad
head -c 500 "$model" >cut.model
expect 3 'cut.model' reconstruct "$raw/test01.tif" -m cut.model -o bad
expect 3 '' reconstruct "$raw/test01.tif" -m text.tif -o bad
expect 3 'is a file' reconstruct "$raw/test01.tif" -m "$model" -o text.tif
expect 3 'cannot be made' reconstruct "$raw/test01.tif" -m "$model" -o text.tif/out
mkdir again && cp "$raw/test01.tif" again
expect 2 'would both write test01_stack.tif' reconstruct again/test01.tif "$raw/test01.tif" -m "$model" -o bad
files bad 0
if [ "$(id -u)" != 0 ]; then
    mkdir locked && chmod 555 locked
    expect 3 'nothing can be written' reconstruct "$raw/test01.tif" -m "$model" -o locked
fi

# Encodings: as the scenes were, unless another one is asked for; evaluate brings results to the truth's.
frame="$camera/test/raw/test01.tif"
truth="$camera/test/truth/test01_aif.tif"
expect 0 'scenes srgb' fit "$camera" -o srgb.model --scene-response srgb --no-leave-one-out
for encoding in scene linear srgb 1.8; do
    expect 0 '' reconstruct "$frame" -m srgb.model -o "as_$encoding" --encoding "$encoding" --no-preview
    expect 0 '' evaluate "as_$encoding/test01_aif.tif" "$truth" --json
    grep -oE '"(psnr|encoding|result_encoding)": *[^,]*' stdout >"as_$encoding.txt"
    grep -q '"encoding": "srgb"' "as_$encoding.txt" || fail "results as $encoding are not compared as the scenes were"
done
same_results as_scene/test01_stack.tif as_srgb/test01_stack.tif || fail 'srgb is not how the scenes were encoded'
same_results as_scene/test01_stack.tif as_linear/test01_stack.tif && fail '--encoding linear changed nothing'
same_results as_scene/test01_depth.tif as_linear/test01_depth.tif || fail '--encoding changed the distances'
grep -q '"result_encoding": "1.8"' as_1.8.txt || fail 'the encoding 1.8 is not stated'
for encoding in linear srgb 1.8; do
    [ "$(grep -oE 'psnr": *[0-9]+\.[0-9]{3}' "as_$encoding.txt")" = "$(grep -oE 'psnr": *[0-9]+\.[0-9]{3}' as_scene.txt)" ] ||
        fail "results as $encoding compare otherwise"
done
expect 0 "encoding '1.8', to which results in 'linear'" evaluate as_linear/test01_aif.tif "$truth" --encoding 1.8
expect 0 '"encoding": "linear"' evaluate as_srgb/test01_aif.tif "$truth" --truth-encoding linear --json
expect 2 'does not say.*--truth-encoding' evaluate "$truth" "$truth" --encoding srgb
expect 2 "'dim' is no response" evaluate as_linear/test01_aif.tif "$truth" --encoding dim
expect 2 "'dim' is no response" reconstruct "$frame" -m srgb.model -o x --encoding dim
expect 2 "'dim' is no response" reconstruct "$frame" -m srgb.model -o x --frame-encoding dim
expect 0 'encoded for displays.*--frame-encoding' reconstruct "$frame" -m srgb.model -o as_encoded --frame-encoding srgb --no-preview
same_results as_encoded/test01_stack.tif as_scene/test01_stack.tif && fail '--frame-encoding changed nothing'
expect 2 'encoding already' reconstruct "$frame" -m srgb.model -o x --encoding srgb --gamma 0.5
expect 0 '' reconstruct "$frame" -m srgb.model -o as_gamma --gamma 0.5 --no-preview
expect 0 '"result_encoding": "2"' evaluate as_gamma/test01_aif.tif "$truth" --json
expect 0 '' reconstruct "$frame" -m "$model" -o as_ever --no-preview
expect 0 '"encoding": "linear"' evaluate as_ever/test01_aif.tif "$truth" --json
expect 0 'test01: there already' reconstruct "$frame" -m "$model" -o as_ever --no-preview --resume
expect 0 '"there": true' reconstruct "$frame" -m "$model" -o as_ever --no-preview --resume --json
rm as_ever/test01_depth.tif
expect 0 'test01: [^t]' reconstruct "$frame" -m "$model" -o as_ever --no-preview --resume
has as_ever/test01_depth.tif
# results that are cut, of another frame's size, of fewer depths, or older than frame or model are made anew
for file in stack aif depth; do
    truncate -s 2000 as_ever/test01_$file.tif
    expect 0 'test01: [^t]' reconstruct "$frame" -m "$model" -o as_ever --no-preview --resume
done
cp as_ever/test01_aif.tif as_ever/test01_stack.tif
expect 0 'test01: [^t]' reconstruct "$frame" -m "$model" -o as_ever --no-preview --resume
"$FRAME_TOOL" flat as_ever/test01_aif.tif 12 12 3 0.5
expect 0 'test01: [^t]' reconstruct "$frame" -m "$model" -o as_ever --no-preview --resume
cp "$frame" test01.tif
expect 0 'test01: [^t]' reconstruct test01.tif -m "$model" -o as_ever --no-preview --resume
expect 0 'test01: there already' reconstruct test01.tif -m "$model" -o as_ever --no-preview --resume
cp "$model" newer.model
expect 0 'test01: [^t]' reconstruct test01.tif -m newer.model -o as_ever --no-preview --resume
# and those of another frame or model of that name, however old it is; results of versions that did not say it are trusted
again=(reconstruct test01.tif -m newer.model -o as_ever --no-preview --resume)
touch -d 2001-01-01 test01.tif newer.model
expect 0 'test01: there already' "${again[@]}"
cp "$raw/test02.tif" test01.tif && touch -d 2001-01-01 test01.tif
expect 0 'test01: [^t]' "${again[@]}"
sed -i 's/"library":"hadalens/"library":"Hadalens/' newer.model && touch -d 2001-01-01 newer.model
expect 0 'test01: [^t]' "${again[@]}"
expect 0 'test01: there already' "${again[@]}"
sed -i 's/made_from=/made_up_o=/' as_ever/test01_*.tif
cp "$frame" test01.tif && touch -d 2001-01-01 test01.tif
expect 0 'test01: there already' "${again[@]}"
lacks x
finish
