#!/usr/bin/env bash
# PSFs that vary over the field: from a simulated camera's measured ones to pictures, and what is refused.
. "$(dirname "$0")/cli_testing.sh"
design=(--preset sim300 --size 96x104 --window 40x40 --depths 2 --channels 1 --lenses 9 --boundary padded --pairs 1)
expect 0 '' simulate "${design[@]}" --field-varying 0.6 --field-psfs 4 --test 2 --test-depths 1 --noise 0.005 -o made
files made/field 17
[ "$(info made/field/psf_01_01.tif)" = '2 1 96 104 32' ] || fail "psf_01_01.tif: $(info made/field/psf_01_01.tif)"
[ "$(sed -n 2p made/field/positions.csv)" = 'psf_01_01.tif,32,28' ] || fail 'the list of positions'
grep -q '"field_varying": 0.6' made/sensor.json || fail 'sensor.json'
expect 0 '' simulate "${design[@]}" --field-varying 0.6 --field-psfs 0 -o none
lacks none/field
expect 2 'padded' simulate --preset sim300 --size 96x104 --window 40x40 --field-varying 0.6 -o x
expect 2 'field-varying' simulate "${design[@]}" --field-varying 0.6 --occlude --test 1 -o x
expect 2 'between 0 and 1' simulate "${design[@]}" --field-varying 2 -o x
expect 2 'field-psfs' simulate "${design[@]}" --field-varying 0.6 --field-psfs 1 -o x

# Components, chosen and given; a single one is a plain camera.
expect 0 '"components": 6, +"positions": 16' fit --psf made/field --window 40x40 --components 6 -o six.model --json
is_json fit
expect 0 'PSFs of 16 positions; 6 components leave' fit --psf made/field --window 40x40 --components 6 -o six.model
grep -q 'borders' stderr && fail 'a note on borders'
expect 0 'PSFs of 16 positions; 1 component leaves' fit --psf made/field/positions.csv --window 40x40 --components 1 -o one.model
expect 0 '' fit --psf made/field --window 40x40 -o chosen.model
expect 0 '' fit --psf made/field --window 40x40 --explained 0.9 -o fewer.model
[ "$(stat -c %s fewer.model)" -lt "$(stat -c %s chosen.model)" ] || fail '--explained'

# They explain frames better.
for method in rl fista; do
    for model in six one; do
        expect 0 '' reconstruct made/test/raw/*.tif -m $model.model --method $method --iterations 60 -o $method.$model
        sed -n 's/.*; \([0-9.]*\) % unexplained.*/\1/p' stdout | sort -g | tail -n 1 >$method.$model.left
    done
    awk 'NR == 1 { six = $1 } NR == 2 { exit !(six > 0 && six < 0.8 * $1) }' $method.six.left $method.one.left ||
        fail "$method: $(cat $method.six.left $method.one.left | tr '\n' ' ') unexplained"
done
expect 0 'rl, 120 iterations' reconstruct made/test/raw/test01.tif -m six.model --scene volume -o volume
has volume/test01_stack.tif

# A distance for each file, rows in any order, comments; the same camera.
mkdir single
"$FRAME_TOOL" flat flat.tif 40 40 1 0.5
{
    echo '# measured today'
    echo 'file;x;y;distance'
    sed -n '2,$p' made/field/positions.csv | sort -r | sed 's/,/ ; /g; s/$/ ; 100mm/; s|^|../made/field/|'
} >single/positions.csv
sed -i 's/psf_01_01.tif/psf_01_02.tif/' single/positions.csv
expect 0 '1 depth, 96x104' fit --psf single --window 40x40 --components 3 -o single.model
# What is wrong with a list.
list() { { echo 'file,x,y,distance'; printf '%s\n' "$@"; } >list.csv; }
list 'flat.tif,1,2' 'flat.tif,1'
expect 3 'line 3 is not' fit --psf list.csv -o x
list 'flat.tif,1,2,100' 'flat.tif,3,2'
expect 3 'some lines say a distance' fit --psf list.csv -o x
list 'flat.tif,1,2,100' 'flat.tif,3,2,100' 'flat.tif,3,2,200'
expect 3 '1 positions at 200 mm and 2' fit --psf list.csv -o x
list 'flat.tif,1,2' 'flat.tif,5,2' 'flat.tif,1,8'
expect 2 '4 positions' fit --psf list.csv -o x
list 'flat.tif,1,2' 'flat.tif,5,2' 'flat.tif,1,8' 'flat.tif,1,2'
expect 2 'average them' fit --psf list.csv -o x
list 'missing.tif,1,2'
expect 3 'missing.tif' fit --psf list.csv -o x
: >list.csv
expect 3 'names no point spread functions' fit --psf list.csv -o x
expect 2 'do not go with them' fit --psf made/field --recentre -o x
expect 2 'several positions' fit --psf made/psf.tif --components 3 -o x
expect 2 'belong|components' fit made --components 3 -o x
expect 2 'padded' fit --psf made/field --boundary circular -o x

# What takes PSFs for the same everywhere says what to do.
for way in '' '--method admm' '--method wiener' '--scene surface' '--refine 0'; do
    # shellcheck disable=SC2086
    expect 4 '--method rl or fista, or --scene volume; or make a model of the mean PSF with fit --components 1' \
        reconstruct made/test/raw/test01.tif -m six.model $way -o x
done
expect 4 'training would take them' train made -m six.model -o x
finish
