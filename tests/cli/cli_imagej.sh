#!/usr/bin/env bash
# The ImageJ macro, in ImageJ before a screen in memory: what it opens, and what it says where that cannot be.
. "$(dirname "$0")/cli_testing.sh"
jar=/usr/share/java/ij.jar
if ! command -v java >/dev/null || ! command -v Xvfb >/dev/null || [ ! -e "$jar" ]; then
    echo "skipped: ImageJ or Xvfb is not installed (Debian's packages imagej, xvfb)"
    exit 77
fi
macro=$(cd "$(dirname "$0")/../../bindings/imagej" && pwd)/Hadalens_Reconstruct.ijm

mkfifo screen
Xvfb -displayfd 3 -nolisten tcp 3>screen >xvfb.log 2>&1 &
xvfb=$!
trap 'kill $xvfb' EXIT
read -r display <screen

# imagej WORDS ARGUMENTS: what it prints must hold WORDS
imagej() {
    DISPLAY=":$display" timeout 900 java -Duser.home="$here" -cp "$jar" ij.ImageJ -batch "$macro" "$2" >stdout 2>stderr || fail "ImageJ does not end well with: $2"
    grep -q -- "$1" stdout || fail "no '$1' from the macro with: $2"
}

frame="$camera/test/raw/test01.tif"
mkdir out
imagej 'test01_stack.tif: 24x24x3x3' "raw=$frame model=$model output=out program=$HADALENS"
grep -q 'test01_stack.tif:.*100 mm' stdout || fail 'the slices are not labelled by distance'
grep -q 'test01_depth.tif: 24x24x1x1' stdout || fail 'no distance map'
has out/test01_stack.tif
# again, over what is there; and file names with spaces, one argument a line
cp "$frame" 'a frame.tif'
imagej 'a frame_stack.tif: 24x24x3x3' "raw=a frame.tif
model=$model
output=out
program=$HADALENS"
imagej 'test01_stack.tif: 24x24x3x3' "raw=$frame model=$model output=out program=$HADALENS"
# what goes wrong is said, and nothing old is shown for new
imagej 'it was not done: .*none.model' "raw=$frame model=none.model output=out program=$HADALENS"
grep -q 'test01_stack' stdout && fail 'an old result was shown for a new one'
imagej 'there is no file none.tif' "raw=none.tif model=$model output=out program=$HADALENS"
imagej 'are needed' "raw=$frame"
finish
