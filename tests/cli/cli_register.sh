#!/usr/bin/env bash
# Registration: the small camera's scenes, turned, scaled and moved, and put right again.
. "$(dirname "$0")/cli_testing.sh"

range='--magnification 0.4,1 --rotation 6' # a quick search

# turned FOLDER DISTANCE TURN...: the camera's depth with its scenes through frame_tool turn.
turned() {
    local folder=$1/$2 scene
    mkdir -p "$folder/scene"
    cp -r "$camera/$2/raw" "$folder/raw"
    for scene in "$camera/$2"/scene/*.tif; do
        "$FRAME_TOOL" turn "$scene" "$folder/scene/$(basename "$scene")" "${@:3}"
    done
}

# As simulated: nothing to do; and what is written is what was there.
expect 0 'as it is .*100 mm|100 mm +as it is.*nothing to do' register "$camera" --rotation 3 -o same
expect 0 'inf +1.000' evaluate same/z100mm/scene "$camera/z100mm/scene"
cmp -s same/z100mm/raw/scene0001.tif "$camera/z100mm/raw/scene0001.tif" || fail "the raw frame was not taken over"
files same 30
expect 2 'is there already' register "$camera" -o same

# Frames that are links, relative ones: what they lead to is taken.
cp -r "$camera" linked
for frame in linked/z*/raw/*.tif; do
    mv "$frame" "${frame%.tif}.real"
    ln -s "$(basename "${frame%.tif}.real")" "$frame"
done
expect 0 'nothing to do' register linked --rotation 3 -o unlinked
cmp -s unlinked/z100mm/raw/scene0001.tif "$camera/z100mm/raw/scene0001.tif" || fail 'a link was taken over as it is'

# Mirrored, turned and enlarged, and one depth moved: comes back.
near=z100mm
far=$(basename "$(ls -d "$camera"/z600*mm)")
turned moved "$near" 1.6 3 1 1 0 0
turned moved "$far" 1.6 3 1 1 4 -3
expect 0 'mirror, turn left +0\.6[23].*mirror, turn left +0\.6[23]' register moved $range -o back --window 24x24
expect 0 '"quarter_turns": 1.*"registered": false' register moved $range --no-offset --json
is_json register
expect 0 'nothing to do' register back --rotation 3
inside() { expect 0 '"psnr": (2[2-9]|3)' evaluate "back/$1" "$camera/$1" --window 16x16 --json; }
inside "$near/scene/scene0001.tif"
inside "$far/scene/scene0011.tif"
expect 0 'pairs' fit back -o back.model

# In one command: what is learned is the same.
expect 0 'wide: 10 pairs' register moved --window 24x24 -o wide
expect 0 'pairs' fit wide -o wide.model
expect 0 'mirror, turn left.*pairs' fit moved --register --window 24x24 -o direct.model
cmp -s wide.model direct.model || fail 'fit --register learns something else'
expect 2 'needs the pairs' fit --psf "$camera/psf.tif" --register -o none
lacks none

# A tilted display.
turned slanted "$near" 1.6 3 1 1 0 0 0.003
expect 0 'top to bottom' register slanted $range

# Refusals leave nothing behind.
expect 4 'do not show.*magnification 1.5 to 2' register moved --magnification 1.5,2 --rotation 3 -o none
lacks none
expect 4 'larger than the frames, 64x80' register moved $range --window 65x80 -o none
lacks none
mkdir -p single/z1mm/raw single/z1mm/scene
cp "$camera/$near/raw/scene0001.tif" single/z1mm/raw/a.tif
cp "$camera/$near/scene/scene0001.tif" single/z1mm/scene/a.tif
expect 4 'z1mm: one pair does not show' register single -o none
lacks none
"$FRAME_TOOL" flat single/z1mm/scene/b.tif 24 24 3 0.5
cp single/z1mm/scene/b.tif single/z1mm/scene/a.tif
cp single/z1mm/raw/a.tif single/z1mm/raw/b.tif
expect 4 'flat' register single
expect 2 'magnification x is not a range' register moved --magnification x
expect 2 'takes 0 to 45' register moved --rotation 46
expect 2 'one data set' register
expect 3 'nosuch' register nosuch
finish
