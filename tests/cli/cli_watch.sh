#!/usr/bin/env bash
# Frames as they come: from a pipe, from a folder; files without a header; what simulated cameras write.
. "$(dirname "$0")/cli_testing.sh"
small=(--preset sim300 --size 64x80 --window 24x24 --depths 1 --lenses 9 --pairs 4 --test 3 --test-depths 1)

# The same frames in the files that cameras write.
for raw in tiff npy dng packed12; do
    expect 0 '' simulate "${small[@]}" --bayer grbg --full-well 8000 --adc-bits 12 --dark 0.05 --raw $raw -o $raw
done
csi=(--headerless 64x80:csi12)
expect 0 'read the raw frames with --headerless 64x80:csi12' simulate "${small[@]}" --bayer grbg --raw packed12 -o other
expect 0 '' fit tiff --bayer grbg --dark 0.05 -o tiff.model
expect 0 'frames of the mosaic grbg' fit dng -o dng.model # as its files say
expect 0 '' fit dng --bayer grbg -o told.model
cmp -s dng.model told.model || fail 'the mosaic that files state made another model'
expect 4 'test01.dng|scene0001.dng: the colour filter mosaic of the file is grbg; leave --bayer bggr out' fit dng --bayer bggr -o x.model
expect 0 '' fit packed12 "${csi[@]}" --bayer grbg --dark 0.05 -o packed.model
expect 0 '' reconstruct tiff/test/raw/test01.tif -m tiff.model -o tiff.out
expect 0 '' reconstruct npy/test/raw/test01.npy -m tiff.model -o npy.out
expect 0 '' reconstruct dng/test/raw/test01.dng -m dng.model -o dng.out
expect 0 '' reconstruct packed12/test/raw/test01.raw "${csi[@]}" -m packed.model -o packed.out
for raw in npy dng packed; do
    expect 0 '' evaluate $raw.out/test01_aif.tif tiff.out/test01_aif.tif --json
    psnr=$(grep '"psnr"' stdout | grep -oE '[0-9]+|null' | head -n 1)
    [ "$psnr" = null ] || [ "$psnr" -ge 60 ] || fail "$raw: $psnr dB"
done
expect 2 'colour filter mosaic' simulate "${small[@]}" --raw dng -o x
expect 3 'no known format.*--headerless' reconstruct packed12/test/raw/test01.raw -m packed.model -o x
expect 3 'no whole frames of 63 x 80' reconstruct packed12/test/raw/test01.raw --headerless 63x80:csi12 -m packed.model -o x
expect 2 "--headerless: '64x80' is not understood" reconstruct packed12/test/raw/test01.raw --headerless 64x80 -m packed.model -o x
expect 2 'has at least 120' reconstruct packed12/test/raw/test01.raw --headerless 64x80:csi12:100 -m packed.model -o x

# Files are sequences of frames; all of a file that is sent as if by a pipe are done. Rows have 128 bytes.
cat packed12/test/raw/*.raw >three.raw
pipe=(--watch - --headerless 64x80:csi12:128 -m packed.model)
expect 0 'three: 3 frames' reconstruct three.raw "${csi[@]}" -m packed.model -o film
expect 0 '3 frames in .*, 0 passed over, 0 failed' reconstruct "${pipe[@]}" -o piped <three.raw
has piped/frame00000{1,2,3}_{stack,aif}.tif
same_results piped/frame000001_aif.tif packed.out/test01_aif.tif || fail "a frame of a pipe has other bits than the file's"
# Of a pipe, the newest are done.
cat three.raw | expect 0 'failed' reconstruct "${pipe[@]}" -o newest
has newest/frame000003_aif.tif
cat three.raw | "$HADALENS" reconstruct "${pipe[@]}" --stream mjpeg >stream 2>stderr || fail "a stream"
[ "$(head -c 3 stream | od -An -tx1 | tr -d ' ')" = ffd8ff ] || fail "no JPEG"
"$HADALENS" reconstruct "${pipe[@]}" --stream rgb24 <three.raw >stream 2>stderr || fail "a stream of bytes"
[ "$(stat -c %s stream)" = $((3 * 3 * 24 * 24)) ] || fail "a stream of $(stat -c %s stream) bytes"
head -c 100 three.raw | expect 3 'ended after 100 bytes, before a whole frame of 8192' reconstruct "${pipe[@]}" -o x
expect 4 '64 x 80' reconstruct --watch - --headerless 63x80:u8 -m packed.model -o x <three.raw
expect 2 'say how they lie with --headerless' reconstruct --watch - -m packed.model -o x <three.raw

# Frames that a camera has encoded for displays, without saying so: found in the pairs, and kept in the model.
expect 0 '' simulate "${small[@]}" -o colour
for file in colour/z*mm/raw/*.tif colour/test/raw/*.tif; do
    "$FRAME_TOOL" encode "$file" "${file%.tif}.rgb" && "$FRAME_TOOL" encode "$file" "$file" || fail "$file"
done
expect 0 'encoded for displays.*"frame_encoding": "srgb"' fit colour -o encoded.model --json
expect 0 '' fit colour --frame-encoding srgb -o told.model
cmp -s encoded.model told.model || fail "frames that were found to be encoded made another model"
expect 0 '' reconstruct colour/test/raw/test01.tif -m encoded.model -o known
expect 0 '' reconstruct colour/test/raw/test01.tif --frame-encoding srgb -m encoded.model -o told
expect 0 '' reconstruct colour/test/raw/test01.tif --frame-encoding linear -m encoded.model -o linear
expect 0 '' reconstruct --watch - --headerless 64x80:rgb8 -m encoded.model -o pipe.out <colour/test/raw/test01.rgb
same_results known/test01_aif.tif told/test01_aif.tif || fail "the model did not know how frames are encoded"
same_results known/test01_aif.tif linear/test01_aif.tif && fail "--frame-encoding linear changed nothing"
same_results pipe.out/frame000001_aif.tif known/test01_aif.tif || fail "an encoded frame of a pipe has other bits"

# A folder: files that come, those that change, those that are no frames; older ones when there is time.
mkdir come
cp tiff/test/raw/test01.tif come/here.tif
"$HADALENS" reconstruct --watch come -m tiff.model -o came --idle 3 --json >watched 2>stderr &
for n in 1 2 3; do
    sleep 0.4
    cp tiff/test/raw/test0$n.tif come/frame$n.tif
done
echo nothing >come/broken.tif
echo nothing >come/other.txt
sleep 1.5
cp tiff/test/raw/test02.tif come/frame1.tif
wait $!
[ $? = 1 ] || fail "the exit code of a folder with a file that is no frame"
has came/here_aif.tif came/frame{1,2,3}_aif.tif
cmp -s came/frame1_aif.tif came/frame2_aif.tif || fail "a file that changed was not done again"
grep -q '"frames": 5' watched && grep -q '"failed": 1' watched || fail "$(cat watched stderr)"
grep -q 'broken.tif: of no known format' stderr || fail "$(cat stderr)"

expect 2 '--stream goes with --watch' reconstruct tiff/test/raw/test01.tif -m tiff.model --stream mjpeg -o x
expect 2 'leave the files out' reconstruct tiff/test/raw/test01.tif --watch come -m tiff.model -o x
expect 2 'need all files beforehand' reconstruct --watch come -m tiff.model -o x --strict
expect 2 'where the results shall go' reconstruct --watch come -m tiff.model
expect 2 '--stream and --json' reconstruct --watch come -m tiff.model --stream mjpeg --json
expect 2 'is the folder of the frames' reconstruct --watch come -m tiff.model -o come/
expect 3 'cannot be read' reconstruct --watch nowhere -m tiff.model -o x
lacks x/frame000001_aif.tif

# A signal ends it, and whatever was done stays.
"$HADALENS" reconstruct --watch come -m tiff.model -o again >watched 2>stderr &
for _ in $(seq 100); do
    [ -e again/frame2_aif.tif ] && break
    sleep 0.1
done
kill -TERM $!
wait $!
[ $? = 130 ] || fail "the exit code after a signal"
has again/frame2_aif.tif
finish
