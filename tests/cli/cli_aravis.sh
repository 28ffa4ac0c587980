#!/usr/bin/env bash
# hadalens-aravis with the camera that Aravis simulates: 512 x 512 pixels, frame after frame.
. "$(dirname "$0")/cli_testing.sh"
[ -x "$ARAVIS" ] || { echo 'hadalens-aravis was not built'; exit 77; }

size() {
    "$ARAVIS" --fake "$@" 2>stderr | wc -c
}
[ "$("$ARAVIS" --fake --describe)" = 512x512:u8 ] || fail '--describe'
[ "$("$ARAVIS" --fake --describe --pixels Mono16)" = 512x512:u16 ] || fail '--describe --pixels'
"$ARAVIS" --fake --list | grep -q '^Fake_1 ' || fail '--list'
[ "$(size --count 3)" = $((3 * 512 * 512)) ] || fail 'three frames are not three frames'
[ "$(size --count 2 --pixels Mono16 --exposure 5 --gain 1 --rate 20)" = $((4 * 512 * 512)) ] || fail 'two frames of 16 bits'
[ "$("$ARAVIS" --fake | head -c 1000 | wc -c)" = 1000 ] || fail 'a reader that ends'
! "$ARAVIS" --fake --count 1 >/dev/full 2>stderr || fail 'a full disk went unnoticed'
grep -q 'standard output' stderr || fail 'a full disk without a message'
! "$ARAVIS" --fake --pixels Nonsense >stdout 2>stderr || fail 'nonsense was taken'
grep -q Nonsense stderr && [ ! -s stdout ] || fail "nonsense is not named: $(cat stderr)"
! "$ARAVIS" --fake --camera Nobody >stdout 2>stderr || fail 'a camera that is not there'
grep -q "'Nobody' not found" stderr || fail "a camera that is not there: $(cat stderr)"

# All the way.
"$FRAME_TOOL" spots psf.tif 512 512 12 3
expect 0 '' fit --psf psf.tif --window 64x64 --boundary circular -o fake.model
"$ARAVIS" --fake --count 3 >frames
expect 0 'frames in .* 0 failed' reconstruct --watch - --headerless "$("$ARAVIS" --fake --describe)" -m fake.model \
    --no-preview -o out <frames
has out/frame000003_stack.tif
finish
