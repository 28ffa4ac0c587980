#!/usr/bin/env bash
# The recipe for a Raspberry Pi with its stand-in: what it makes is as good as a picture can be, and it goes on.
. "$(dirname "$0")/cli_testing.sh"
pi=$EXAMPLES/raspberry-pi
"$pi/try.sh" "$PWD/out" >stdout 2>stderr || fail 'try.sh'
cd out || exit 1
has camera.model results/scene0011_aif.png live.mjpeg
expect 0 'mosaic bggr' fit camera -o again.model
expect 0 '' register judge -o truth --window 100x120
for n in 11 12; do
    expect 0 '' evaluate results/scene00${n}_aif.tif truth/z300mm/scene/scene00$n.tif --json
    psnr=$(grep '"psnr"' stdout | grep -oE '[0-9]+' | head -n 1)
    [ "${psnr:-0}" -ge 27 ] || fail "scene00$n: $psnr dB"
done

# What is there is passed over, with the exposure that the others had; what is missing is captured.
export STAND_IN=$PWD STAND_IN_MM=300
rm captures/z300mm/raw/scene0003.dng
cp captures/z300mm/raw/scene0002.dng before.dng
PATH="$pi/stand-in:$PATH" "$pi/capture.py" pictures/scene000{2,3}.tif -o captures/z300mm --settle 0.1 >stdout 2>stderr ||
    fail 'going on'
[ "$(grep -c dng stdout)" = 1 ] || fail 'not one picture alone'
cmp -s before.dng captures/z300mm/raw/scene0002.dng || fail 'a frame was taken again'
has captures/z300mm/raw/scene0003.dng
refuses() {
    "$pi/capture.py" "${@:2}" >stdout 2>stderr && fail "not refused: ${*:2}"
    grep -q "$1" stderr || fail "no '$1'"
}
refuses 'no such picture' nothing.png -o x
refuses 'have the name scene0002' pictures/scene0002.tif captures/z300mm/scene/scene0002.tif -o x
refuses 'is there a display' pictures/scene0001.tif -o x --show false --settle 0.3
refuses 'No such file' pictures/scene0001.tif -o x --show nothing-of-this-name
lacks x/raw/scene0001.dng
finish
