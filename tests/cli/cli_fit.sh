#!/usr/bin/env bash
# Learning a camera: pairs, sums, PSF, and data sets that are not in order.
. "$(dirname "$0")/cli_testing.sh"
copy() { rm -rf set && mkdir set && cp -r "$camera"/z* "$camera/camera.json" set; }

expect 0 '"leave_one_out"' fit "$camera" -o a.model --json
is_json fit
cmp -s a.model "$model" || fail 'the same pairs gave another model'
# The example in the documentation learns and reconstructs as the commands do, bit for bit.
"$LEARN" "$camera" learned.model learned "$camera"/test/raw/*.tif >stdout 2>stderr || fail 'the example program failed'
cmp -s learned.model "$model" || fail 'the example program learned another model'
expect 0 '' reconstruct "$camera"/test/raw/*.tif -m learned.model -o commands
for file in commands/*.tif; do
    same_results "$file" "learned/$(basename "$file")" || fail "the example program gave another $(basename "$file")"
done
if locale -a 2>/dev/null | grep -qi '^de_DE'; then
    LC_ALL=de_DE.UTF-8 expect 0 '0\.[0-9]' fit "$camera" -o a.model
    cmp -s a.model "$model" || fail 'the locale changed the model'
fi
expect 0 'split' fit "$camera" -o split.model --form split
expect 0 'padded' fit "$camera" -o padded.model --boundary padded --no-leave-one-out
expect 0 'no refinement' fit "$camera" -o plain.model --alpha 0.1 --lambda 0.001 --refine 0 --outside 1
expect 0 '' fit "$camera" -o half.model --half
[ "$(stat -c %s half.model)" -lt "$(stat -c %s a.model)" ] || fail '--half did not make the model smaller'

# The response of the scenes: found, given, remembered; exposures.
expect 0 'Response of the scenes.*\*    linear.*chosen.*scenes linear' fit "$camera" -o a.model
expect 0 'scenes srgb' fit "$camera" -o srgb.model --scene-response srgb
expect 0 '"scene_response": "2.2"' fit "$camera" -o power.model --scene-response 2.2 --exposure same --json
cmp -s a.model srgb.model && fail '--scene-response changed nothing'
expect 0 'differ in exposure' fit "$camera" -o each.model --exposure each
expect 2 "'bright' is no response" fit "$camera" -o x --scene-response bright
expect 2 'belong to pairs' fit --psf "$camera/psf.tif" -o x --scene-response srgb
expect 0 '"colour_matrix": \[' fit "$camera" -o colours.model --colour-matrix 0.8,0.2,0,0.1,0.7,0.2,0,0.3,0.7 --no-leave-one-out --json
expect 2 'nine numbers.*1,2' fit "$camera" -o x --colour-matrix 1,2
expect 4 'its inverse are at most 10' fit "$camera" -o x --colour-matrix 1,0,0,1,0,0,0,0,1 --no-leave-one-out
expect 2 'belong to pairs' fit --psf "$camera/psf.tif" -o x --exposure each

# Filters judged in the window: the weight outside it is chosen, given, or 1, which is the exact fit.
expect 0 'outside the window' fit "$camera" -o judged.model --refine 0
expect 0 '"outside": 0.03' fit "$camera" -o judged.json.model --refine 0 --json
cmp -s judged.model judged.json.model || fail 'judging twice gave two models'
expect 0 '' fit "$camera" -o exact.model --refine 0 --outside 1
expect 0 '' fit "$camera" -o light.model --refine 0 --outside 0.1
cmp -s exact.model light.model && fail '--outside 0.1 changed nothing'
expect 2 '0.01' fit "$camera" -o x --outside 0.001

# Transfer functions with the crop in the model: for the boundary padded, as often as wanted.
expect 0 '' fit "$camera" -o cropped.model --boundary padded --refine 0 --outside 1
expect 0 '' fit "$camera" -o once.model --boundary padded --refine 0 --outside 1 --crop-passes 0
cmp -s cropped.model once.model && fail '--crop-passes 0 changed nothing'
copy && rm set/camera.json
expect 0 'circular' fit set -o found.model --refine 0 --outside 1 # nothing leaves the sensor
cmp -s found.model exact.model || fail 'the boundary that was found gave another model'
expect 2 'at least 3' fit "$camera" -o x --boundary padded --crop-passes 2
expect 2 '--crop-passes takes a whole number such as 8, or .auto' fit "$camera" -o x --crop-passes many
expect 2 'belong to pairs' fit --psf "$camera/psf.tif" -o x --crop-passes 0
expect 2 '0.01 and 1' fit "$camera" -o x --outside 2
expect 2 'belong to pairs' fit --psf "$camera/psf.tif" -o x --outside 0.5

# Sums: the pairs in two parts, merged, give the filters of the whole.
part() { # part KEEP: leaves in every folder what 'KEEP' of the sorted list leaves
    copy
    for folder in set/z*/*/; do
        find "$folder" -name '*.tif' | sort >all
        $1 <all >keep
        comm -23 all keep | xargs rm
    done
}
fixed=(--alpha 0.1 --lambda 0.001 --refine 0)
part 'head -n 2'
expect 0 '6 pairs; at least 2' fit set -o part.model --sums part.sums "${fixed[@]}"
has part.sums
expect 0 '6 pairs' fit set -o again.model --sums part.sums --resume "${fixed[@]}"
cmp -s part.model again.model || fail 'a fit from whole sums is another'
lacks part.sums.1-of-1
cp part.sums part.sums.1-of-1 # of a job that was killed after the sums were whole
expect 0 '' fit set -o once.model --sums part.sums --resume "${fixed[@]}"
lacks part.sums.1-of-1
part 'tail -n 3'
expect 0 '"pairs": \[ +5, +5, +5 +\]' fit set -o whole.model --merge part.sums "${fixed[@]}" --json
[ "$(stat -c %s whole.model)" = "$(stat -c %s plain.model)" ] || fail 'merged sums gave a model of another size'
expect 0 '' reconstruct "$camera/test/raw/test01.tif" -m whole.model -o whole -q
expect 0 '' reconstruct "$camera/test/raw/test01.tif" -m plain.model -o plain -q
expect 0 '' evaluate whole plain --json
psnr=$(grep '"psnr"' stdout | grep -oE '[0-9]+' | sort -n | head -n 1)
[ "${psnr:-100}" -ge 90 ] || fail "merged sums gave other filters: $psnr dB"
expect 2 'sums .--merge. have none' fit set -o x --merge part.sums --outside 0.5
expect 4 "scenes were brought to light as 'linear', those of this fit as '2'.*--scene-response" \
    fit set -o x --merge part.sums --scene-response 2
# Sums alone make a model, without any pair at hand.
expect 0 '6 pairs in 1 file of sums' fit --merge part.sums -o alone.model
expect 0 '12 pairs in 2 files of sums' fit --merge part.sums --merge part.sums -o twice.model

# A dark level.
copy
for file in set/z*/raw/*.tif; do "$FRAME_TOOL" offset "$file" moved.tif 0.05 && mv moved.tif "$file"; done
expect 0 'dark level 0.05,' fit set -o dark.model --dark 0.05
"$FRAME_TOOL" flat dark.tif 64 80 3 0.05
expect 0 'dark level 0 and a dark frame,' fit set -o dark2.model --dark dark.tif
expect 0 'dark level found per frame' fit set -o dark3.model --dark auto
expect 3 'nosuch.tif' fit set -o x --dark nosuch.tif
"$FRAME_TOOL" flat dark.tif 64 80 3 -0.05 # no number stands for "auto"
expect 0 'dark level 0 and a dark frame,' fit set -o dark4.model --dark dark.tif
"$FRAME_TOOL" flat dark.tif 64 80 3 -1
expect 0 'dark level 0 and a dark frame,' fit set -o dark5.model --dark dark.tif
"$FRAME_TOOL" flat dark.tif 64 80 3 -0.05

# From the PSF.
expect 0 'wiener, padded' fit --psf "$camera/psf.tif" -o psf.model
expect 0 'matched, circular' fit --psf "$camera/psf.tif" -o psf2.model --form matched --boundary circular --window 24x24
"$FRAME_TOOL" flat plain.tif 32 32 1 0.5
expect 2 'names 2 distances, but plain.tif has 1 page' fit --psf plain.tif --distances 100,200 -o x
expect 2 "from near to far.*not '200,100'" fit --psf plain.tif --distances 200,100 -o x
expect 3 'nosuch.tif' fit --psf nosuch.tif -o x
expect 2 'belong to pairs' fit --psf "$camera/psf.tif" --sums s -o x
expect 0 '' fit --psf "$camera/psf.tif" -o turned.model --turn 180
cmp -s psf.model turned.model && fail '--turn changed nothing'
expect 0 '' fit --psf "$camera/psf.tif" -o turned.model --turn none
cmp -s psf.model turned.model || fail '--turn none changed something'
expect 0 '' fit --psf "$camera/psf.tif" -o quarter.model --turn 90
cmp -s psf.model quarter.model && fail '--turn 90 changed nothing'
expect 2 '180' fit --psf "$camera/psf.tif" -o x --turn 45
expect 2 '--turn turns the point spread functions' fit "$camera" -o x --turn 180

# PSFs as people have them: one of an unknown distance, with noise and a background, of another size, several captures.
"$FRAME_TOOL" spots spots.tif 64 80 9 1
"$FRAME_TOOL" spots unlike.tif 64 80 9 2
expect 0 'spots.tif: background 0.(1|0999).* noise is 0.1.*1 depth, 64x80 frames' fit --psf spots.tif -o spots.model
expect 0 '1 depth, 90x100 frames' fit --psf spots.tif -o padded.model --frame 90x100 --window 24x24
expect 0 '1 depth, 24x24 frames' fit --psf spots.tif -o cut.model --frame 24x24 --window 12x12
grep -q 'spots.tif: 64 x 80 pixels are more than frames of 24 x 24.* % of the light' stderr || fail 'no word of lost light'
expect 0 '1 depth, 64x80 frames' fit --psf spots.tif -o psf.model --frame "$camera/test/raw/test01.tif" --window 24x24
expect 0 'a grey one serves red, green and blue alike' fit --psf spots.tif -o grey.model --frame "$camera/test/raw/test01.tif"
expect 0 '' reconstruct "$camera/test/raw/test01.tif" -m psf.model -o psf
lacks psf/test01_depth.tif
has psf/test01_stack.tif
expect 3 'nosuch.tif' fit --psf spots.tif -o x --frame nosuch.tif
expect 0 'light reaches the borders, where a pixel has 100 %.*--psf-taper' fit --psf plain.tif -o flat.model --psf-dark 0.1
expect 0 '' fit --psf plain.tif -o taper.model --psf-dark 0.1 --psf-taper 8
grep -q 'light reaches' stdout stderr && fail 'a PSF that fades out reaches the borders'
expect 7 'nothing of the point spread function is brighter.*--psf-dark' fit --psf plain.tif -o x
"$FRAME_TOOL" spots white.tif 64 80 9 1 0.5
expect 0 'white.tif: [3-5][0-9] % of the light is in pixels at white.*shorter exposure' fit --psf white.tif -o x
expect 0 '' fit --psf white.tif -o x --psf-dark 0
grep -q 'at white' stderr && fail 'a computed PSF is saturated'
mkdir -p psfs/z100mm psfs/z50mm files
cp spots.tif psfs/z100mm/1.tif
cp spots.tif psfs/z100mm/2.tif
cp spots.tif psfs/z50mm
expect 0 'z100mm/2.tif: 2 captures of 2 files averaged.*2 depths' fit --psf psfs -o two.model
expect 0 '"distances_mm": \[ +50.0, +100.0 +\]' fit --psf psfs -o two.model --json
cp spots.tif files/a.tif
cp spots.tif files/b.tif
expect 0 '2 captures of 2 files averaged.*1 depth' fit --psf files -o one.model
expect 0 '2 captures of 2 files averaged.*1 depth' fit --psf files/a.tif files/b.tif -o same.model
cmp -s one.model same.model || fail 'two files and their folder gave two models'
grep -q 'like the captures before' stderr && fail 'equal captures are unlike'
expect 0 'unlike.tif is [0-9]+ % like the captures before it.*z<distance>mm.*--distances' fit --psf spots.tif unlike.tif -o x
"$FRAME_TOOL" turn spots.tif moved.tif 1 0 0 0 2 0
expect 0 'spots.tif is 9[0-9] % like .* moved by (1.9|2.[01]) pixels' fit --psf moved.tif spots.tif -o x
cmp -s one.model spots.model || fail 'two equal captures gave another model than one'
expect 0 '2 depths' fit --psf files --distances 50,100 -o list.model
echo '50, 100mm' >files/distances.txt
expect 0 '2 depths' fit --psf files -o beside.model
cmp -s list.model beside.model || fail 'the list beside gave another model'
echo '50 x' >files/distances.txt
expect 3 'files/distances.txt: number 2 is no distance' fit --psf files -o x
echo '50 60 70' >files/distances.txt
expect 2 'the list beside it names 3 distances, but files has 2 depths' fit --psf files -o x
cp plain.tif files/c.tif
expect 4 'c.tif: page 1 has 1 channels, 32 x 32.*64 x 80.*alike' fit --psf files -o x
mv files/c.tif files/z70mm.tif
expect 2 'a.tif does not say its distance, and .*z70mm.tif does' fit --psf files -o x
mkdir none
expect 3 'none holds no pictures.*none/z100mm' fit --psf none -o x
"$FRAME_TOOL" pages spots.tif stack.tif 2
expect 2 'stack.tif does not say at which distances its 2 pages were taken; add --distances' fit --psf stack.tif -o x
# Equal steps; each second page, whose distances are those of the others' steps.
"$FRAME_TOOL" pages spots.tif stack.tif 5
expect 0 '5 depths' fit --psf stack.tif --distances 50:2.5:5 -o steps.model
expect 0 '5 depths' fit --psf stack.tif --distances 50,52.5,55,57.5,60 -o named.model
cmp -s steps.model named.model || fail 'equal steps gave another model'
expect 0 '3 depths' fit --psf stack.tif --distances 50:2.5:5 --every 2 -o second.model
"$FRAME_TOOL" pages spots.tif three.tif 3
expect 0 '3 depths' fit --psf three.tif --distances 50:5:3 -o third.model
cmp -s second.model third.model || fail 'each second page gave another model'
for steps in 50:2.5:0 50:-1:5 0:1:5 50:2.5:5: 50:2.5:1000; do
    expect 2 'such as .* 2:0.05:40, not' fit --psf stack.tif --distances "$steps" -o x
done
expect 2 '--distances names 3 distances, but stack.tif has 5 pages' fit --psf stack.tif --distances 50:5:3 --every 2 -o x
expect 2 '--every takes pages of one file' fit --psf spots.tif plain.tif --distances 50,100 --every 2 -o x
expect 2 'every' fit --psf stack.tif --distances 50:2.5:5 --every 0 -o x
"$FRAME_TOOL" nan spots.tif holes.tif 5
expect 4 'holes.tif: page 1 holds 5 NaN' fit --psf holes.tif -o x

# A bead that drifts from depth to depth.
mkdir drift
for k in 0 1 2 3 4; do "$FRAME_TOOL" turn spots.tif "drift/z$((50 + 5 * k))mm.tif" 1 0 0 0 $((k == 2 ? 3 : 0)) 0; done
expect 0 'the bead wanders by up to 2.[0-9] pixels.*kept as it is; --recentre takes it off' fit --psf drift -o x
expect 0 'the bead wanders by up to 2.[0-9] pixels, which were taken off' fit --psf drift --recentre -o centred.model -v
expect 2 '--recentre: a drift is seen in 4 depths or more' fit --psf spots.tif --distances 50 --recentre -o x
rm -f x

# Depths by the law of magnification.
expect 0 '3 depths by the law of magnification, 1 . 3.7 mm / distance.*3 depths, 64x80 frames' \
    fit --psf spots.tif --psf-distance 60 --distances 40,60,100 --mask-distance 3.7 -o law.model
expect 2 'does not say at which distance it was taken; add --psf-distance' \
    fit --psf spots.tif --distances 40,60,100 --mask-distance 3.7 -o x
expect 2 'say with --distances which depths' fit --psf spots.tif --psf-distance 60 --mask-distance 3.7 -o x
expect 2 'add --mask-distance' fit --psf spots.tif --psf-distance 60 --distances 40,60 -o x
expect 0 '2 depths by the law of magnification, 1 . 2?[0-9.]* mm / distance, which leaves [1-9][0-9]? % of a PSF unexpl' \
    fit --psf "$camera/psf.tif" --psf-distance 100,200,600 --distances 150,300 -o two.model
expect 2 '--mask-distance takes a number from 0 on.*not .-3' \
    fit --psf spots.tif --psf-distance 60 --distances 70 --mask-distance -3 -o x
expect 7 'do not become one another by magnification' fit --psf spots.tif unlike.tif --psf-distance 60,100 --distances 70 -o x
expect 2 '--psf-distance names 2 distances, but spots.tif has 1 page' \
    fit --psf spots.tif --psf-distance 60,80 --distances 70 -o x

# Pairs that show nothing, or that do not belong together.
flat() { find "set/$1" -name '*.tif' | while read -r file; do "$FRAME_TOOL" flat "$file" "$2" "$3" 3 "$4"; done; }
for value in 0 0.3; do
    copy
    for depth in set/z*; do flat "${depth#set/}/raw" 64 80 $value; done
    expect 4 'all raw frames at 100 mm are black or of one brightness' fit set -o x
    copy
    for depth in set/z*; do flat "${depth#set/}/scene" 24 24 $value; done
    expect 4 'all scenes at 100 mm are black or of one brightness' fit set -o x
    copy
    flat z600mm/raw 64 80 $value
    expect 4 'all raw frames at 600 mm are black or of one brightness.*leave the depth out' fit set -o x
done
copy
find set -path '*/raw/*.tif' | while read -r file; do "$FRAME_TOOL" nan "$file" bad.tif 15360 && cp bad.tif "$file"; done
expect 4 'holds 15360 NaN' fit set -o x
lacks x
expect 0 'held-out scenes come out [0-9.]* dB better' fit "$camera" -o use.model -v
grep -q 'of no use' stdout stderr && fail 'good pairs are of no use'
copy # each frame with the scene after it
for depth in set/z*; do
    names=("$depth"/raw/*.tif)
    mv "${names[0]}" first.tif
    for ((i = 1; i < ${#names[@]}; i++)); do mv "${names[i]}" "${names[i - 1]}"; done
    mv first.tif "${names[-1]}"
done
expect 0 'the model is of no use: held-out scenes come out .* worse .*check that each frame.*--register finds it' fit set -o no_use.model
expect 0 '' simulate --preset sim300 --size 64x80 --window 24x24 --depths 3 --lenses 9 --pairs 5 --noise 100 --seed 5 -o noise
expect 0 'the model is of no use' fit noise -o no_use.model

# One depth at an unknown distance.
mkdir unknown && cp -r "$camera/z100mm" unknown/z0mm
expect 0 '1 depth' fit unknown -o unknown.model --no-leave-one-out --boundary circular
expect 0 'scene0001: one depth; ' reconstruct "$camera/z100mm/raw/scene0001.tif" -m unknown.model -o unknown_out
has unknown_out/scene0001_stack.tif
lacks unknown_out/scene0001_depth.tif
expect 0 'there already' reconstruct "$camera/z100mm/raw/scene0001.tif" -m unknown.model -o unknown_out --resume
expect 2 'at least' reconstruct "$camera/z100mm/raw/scene0001.tif" -m unknown.model -o surface --scene surface
expect 0 '1 depth' fit unknown/z0mm -o same.model --no-leave-one-out --boundary circular
cmp -s unknown.model same.model || fail 'raw and scene without a folder of the depth gave another model'
mkdir unknown/z50mm && cp -r "$camera"/z100mm/* unknown/z50mm
expect 4 'z0mm: among several depths every distance must be known' fit unknown -o x

# Data sets that are not in order.
expect 3 'nosuch' fit nosuch -o x
mkdir empty
expect 4 'z<distance>mm' fit empty -o x
copy
rm set/z100mm/scene/scene0002.tif
expect 4 'z100mm/raw/scene0002.tif has no scene.*--skip-incomplete' fit set -o x
expect 0 'left out: .*scene0002.tif' fit set -o skip.model --skip-incomplete
rm set/z100mm/scene/*.tif
expect 4 'no pair' fit set -o x --skip-incomplete
rm -r set/z100mm/raw
expect 4 "no folder 'raw'" fit set -o x
copy
first=$(find set/z100mm/raw -name '*.tif' | sort | head -n 1)
"$FRAME_TOOL" nan "$first" bad.tif 7 && cp bad.tif "$first"
expect 4 "$first.* 7 .*(NaN|finite)" fit set -o x
rm set/camera.json
expect 4 "$first.* 7 .*(NaN|finite)" fit set -o x
"$FRAME_TOOL" flat "$first" 60 80 3 0.5
expect 4 "60.*80" fit set -o x
copy
head -c 1000 "$first" >cut.tif && cp cut.tif "$first"
expect 3 "$first" fit set -o x
: >"$first"
expect 3 "$first" fit set -o x
copy
for depth in set/z*; do
    for kind in raw scene; do
        find "$depth/$kind" -name '*.tif' | sort | tail -n +2 | xargs rm
    done
done
expect 0 'single pair' fit set -o one.model
has one.model
expect 2 'window' fit "$camera" -o x --window 9x9
expect 3 'no folder' fit "$camera" -o nosuch/x
expect 3 'is a folder' fit "$camera" -o empty
expect 3 'nosuch.sums' fit "$camera" -o x --merge nosuch.sums
expect 3 '' fit "$camera" -o x --merge "$camera/camera.json"
lacks x nosuch
[ -z "$(find . -name '*.part*' -o -name '.*.tmp*')" ] || fail 'temporary files left'
finish
