#!/usr/bin/env bash
# What a camera resolves, by its design; other masks; wave optics.
. "$(dirname "$0")/cli_testing.sh"
small=(--preset sim300 --size 75x100 --window 30x30 --depths 3 --aperture 6 --lenses 5 --spacing 0.8)

# column FILE NAME: the values of a column, one a line.
column() {
    awk -F, -v name="$2" 'NR == 1 { for (i = 1; i <= NF; i++) if ($i == name) at = i; next } { print $at }' "$1"
}

expect 0 'lateral' optics "${small[@]}" -o plain
files plain 15
has plain/{camera.json,psf.tif,mask.png,depths.csv,mtf.csv,self_correlation.csv,correlation.csv}
has plain/{mtf,self_correlation,correlation,depths}.svg plain/psf_z100mm.png plain/psf_z600mm.png
[ "$(wc -l <plain/lenses.csv)" = 6 ] || fail 'lenses.csv'
[ "$(info plain/psf.tif)" = '3 1 75 100 32' ] || fail "psf.tif: $(info plain/psf.tif)"
# 1 + d/z, d = 30 mm, z = 100, 171.4, 600 mm
[ "$(column plain/depths.csv magnification | tr '\n' ' ')" = '1.3 1.175 1.05 ' ] || fail 'magnification'
# N R M^2 = 5 x 30 x 30 / (75 x 100) at the nearest distance, (100/600)^2 of it at the farthest
[ "$(column plain/depths.csv occupancy | head -n 1)" = 0.6 ] || fail 'occupancy'
[ "$(column plain/depths.csv occupancy | tail -n 1)" = 0.0166667 ] || fail 'occupancy'
[ "$(head -n 1 plain/correlation.csv)" = 'distance_mm,z100mm,z171.429mm,z600mm' ] || fail 'heads of correlation.csv'

# Where cairo is not installed, pictures are left out, and all else is the same.
if [ -n "$NO_CAIRO" ]; then # empty where a sanitizer must be loaded first
    LD_PRELOAD=$NO_CAIRO expect 0 'pictures are left out' optics "${small[@]}" -o unseen
    files unseen 7
    diff -r -x '*.svg' -x '*.png' plain unseen || fail 'without cairo more than pictures is missing'
fi

# From the design's file, by waves, in colour.
expect 0 '"optics": "wave"' optics plain/camera.json --optics wave -o waves --json
is_json optics
[ "$(info waves/psf.tif)" = '3 3 75 100 32' ] || fail "psf.tif: $(info waves/psf.tif)"
grep -q '"optics": "wave"' waves/camera.json || fail '--optics wave in camera.json'
expect 0 '' optics plain/camera.json --optics wave --coherent -o together
cmp -s waves/psf.tif together/psf.tif && fail '--coherent changed nothing'
expect 0 'measured' optics plain/camera.json --psf plain/psf.tif -o again
cmp -s plain/mtf.csv again/mtf.csv || fail 'PSFs from a file gave another MTF'

# Every mask, in data sets too.
for mask in grid diffuser contour aperture; do
    expect 0 "mask $mask" optics "${small[@]}" --mask "$mask" -o "$mask"
    grep -q "\"mask\": \"$mask\"" "$mask/camera.json" || fail "--mask $mask in camera.json"
    cmp -s plain/psf.tif "$mask/psf.tif" && fail "--mask $mask gave the same PSF"
    expect 0 '' simulate --camera "$mask/camera.json" --pairs 1 -o "data_$mask"
    cmp -s "$mask/psf.tif" "data_$mask/psf.tif" || fail "simulate made another PSF of mask $mask"
done
expect 0 '' simulate --camera waves/camera.json --pairs 1 -o data_waves
cmp -s waves/psf.tif data_waves/psf.tif || fail 'simulate made other wave PSFs'
expect 0 'fill factor 0\.(2|3)' optics "${small[@]}" --mask aperture --cell 0.6 --open 0.3 -o cells
expect 0 'fill factor 0\.(099|100|101)' optics "${small[@]}" --fill 0.1 -o filled
# f = R / (n - 1)
expect 0 '' optics "${small[@]}" --curvature 13 --index 1.5 -o curved
grep -Eq '"focal_length_mm": 26(\.0)?,' curved/camera.json || fail '--curvature'

# What cannot be done leaves nothing.
expect 2 'with -o FOLDER' optics
expect 2 'one camera too many' optics a.json b.json -o x
expect 2 'not with both' optics plain/camera.json --preset sim300 -o x
expect 3 'not an empty folder' optics -o plain
expect 3 'cannot be opened' optics nosuch.json -o x
expect 4 '3 pages' optics --preset sim512 --psf plain/psf.tif -o x
expect 2 'one of mla' optics --mask hole -o x
expect 2 'correlation length' optics --mask diffuser --correlation 1000 -o x
expect 2 'no diameter' optics --mask diffuser --fill 0.5 -o x
expect 2 'three numbers' optics --wavelengths 610,530 -o x
expect 2 'do not fit' optics --mask grid --spacing 9 -o x
lacks x .x.hadalens-*
finish
