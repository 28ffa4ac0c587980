#!/usr/bin/env bash
# How frames come about: sensors, shifts, wide fields, opaque objects; and the example that sees through a leaf.
. "$(dirname "$0")/cli_testing.sh"
small=(--preset sim300 --size 64x80 --window 24x24 --depths 2 --lenses 9 --pairs 1 --test 1)
mean() { "$FRAME_TOOL" info "$1" | tail -n 1; }

# A sensor as one can buy it.
sensor=(--full-well 5000 --read-noise 4 --dark 0.05 --adc-bits 10 --vignetting cos4)
expect 0 '"exposure": [0-9.]+.*"noise": 0.0|"noise": 0.0.*"exposure"' simulate "${small[@]}" "${sensor[@]}" -o a --json
is_json simulate
has a/sensor.json
grep -q '"vignetting": "cos4"' a/sensor.json || fail 'sensor.json'
files a 11
expect 0 '' simulate "${small[@]}" "${sensor[@]}" -o b
diff -r a b >/dev/null || fail 'the same seed gave different frames'
cmp -s a/z100mm/raw/scene0001.tif a/z600mm/raw/scene0002.tif && fail 'two frames are the same'
expect 0 '' simulate "${small[@]}" -o plain
lacks plain/sensor.json
cmp -s a/z100mm/scene/scene0001.tif plain/z100mm/scene/scene0001.tif || fail 'the sensor changed the scene'
cmp -s a/psf.tif plain/psf.tif && fail 'psf.tif is not in the units of the frames'
expect 0 '' simulate "${small[@]}" --exposure 2 --noise 0 -o twice
expect 0 '' simulate "${small[@]}" --exposure 1 --noise 0 -o once
awk -v a="$(mean once/z100mm/raw/scene0001.tif)" -v b="$(mean twice/z100mm/raw/scene0001.tif)" \
    'BEGIN { exit !(b > 1.99 * a && b < 2.01 * a) }' || fail 'twice the exposure is not twice the light'

# Off the axis, and with a field; what is written as scene is the window.
expect 0 '' simulate "${small[@]}" --boundary padded --shift=-5,7 --field 90x100 -o wide
[ "$(info wide/z100mm/raw/scene0001.tif)" = '1 3 64 80 32' ] || fail 'a frame of the wide field'
[ "$(info wide/z100mm/scene/scene0001.tif)" = '1 3 24 24 32' ] || fail 'a scene of the wide field'
[ "$(info wide/test/truth/test01_aif.tif)" = '1 3 24 24 32' ] || fail 'a truth of the wide field'
tr -d ' \n' <wide/sensor.json | grep -q '"shift":\[-5,7\],"field":\[90,100\]' || fail 'sensor.json of the wide field'

# Opaque objects: the far picture is whole, the distance map knows both.
expect 0 '' simulate "${small[@]}" --occlude -o opaque
cmp -s plain/z100mm/raw/scene0001.tif opaque/z100mm/raw/scene0001.tif || fail '--occlude changed the pairs'
cmp -s plain/test/raw/test01.tif opaque/test/raw/test01.tif && fail '--occlude changed nothing'
expect 0 '' evaluate opaque/test/truth opaque/test/truth
for kind in clear opaque; do # a mask without lenses looks from every place of its surface
    [ $kind = opaque ] && occlude=(--occlude) || occlude=()
    expect 0 'mask diffuser' simulate "${small[@]}" --mask diffuser "${occlude[@]}" -o $kind-diffuser
done
cmp -s {clear,opaque}-diffuser/test/raw/test01.tif && fail '--occlude changed nothing behind a diffuser'

# What is not possible, and leaves nothing.
expect 2 'two kinds of noise' simulate "${small[@]}" --full-well 5000 --noise 0.1 -o f
expect 2 'noise takes a number from 0 on' simulate "${small[@]}" --noise=-1 -o f
expect 2 'shift takes' simulate "${small[@]}" --shift 5x7 -o f
expect 2 'shift takes' simulate "${small[@]}" --shift 5,7.5 -o f
expect 2 'field of 90 x 100' simulate "${small[@]}" --field 90x100 -o f
expect 2 'converter of 17' simulate "${small[@]}" --adc-bits 17 -o f
expect 2 'full well' simulate "${small[@]}" --full-well 1e9 -o f
expect 3 'nosuch.tif' simulate "${small[@]}" --vignetting nosuch.tif -o f
"$FRAME_TOOL" flat gain.tif 10 10 1 1
expect 4 '10 x 10' simulate "${small[@]}" --vignetting gain.tif -o f
lacks f .f.hadalens-*

# The picture behind the leaf: 6 dB better than a single lens sees it, as it is and with the leaf accounted for.
mkdir leaf
"$SEE_THROUGH" leaf >stdout 2>stderr || fail 'see_through'
awk '/nearest to the axis/ { single = $(NF - 1) } /planes refined/ { plain = $5 } /again/ { last = $2 }
     END { exit !(single > 5 && plain > single + 6 && last > single + 10) }' stdout || fail 'see_through: not seen'
has leaf/far.png leaf/single_view.png leaf/raw.png leaf/near.png leaf/picture.png
finish
