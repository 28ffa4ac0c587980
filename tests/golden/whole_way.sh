#!/usr/bin/env bash
# The whole way, by the command line alone, on small cameras that the program itself simulates from seeds.
#   tests/golden/whole_way.sh HADALENS OUT_FOLDER
# Leaves in OUT_FOLDER the files of every step, and HASHES: a sorted list of the hashes of all that is deterministic
# (pixels, tensors, figures; no times, versions or pictures to look at). Two programs that compute the same bits leave
# the same list. About a minute on two cores, once the kernels are compiled (POCL_CACHE_DIR, HADALENS_CACHE).
set -euo pipefail
[ $# = 2 ] || { sed -n '2,6s/^# //p' "$0"; exit 2; }
hadalens=$(realpath "$1")
here=$(realpath "$(dirname "$0")")
export LC_ALL=C HADALENS_TUNING=/nonexistent
rm -rf "$2"
mkdir -p "$2/figures"
cd "$2"

tool() { python3 "$here/golden_tool.py" "$@"; }

# step NAME COMMAND...: 'hadalens COMMAND... --json'; its document becomes figures/NAME.json.
step() {
    local name=$1
    shift
    [ ! -e "figures/$name.json" ] || { echo "two steps are named $name" >&2; exit 2; }
    "$hadalens" "$@" --json >"figures/$name.json" 2>figures/stderr || {
        echo "whole_way: exit code $? from: hadalens $*" >&2
        cat "figures/$name.json" figures/stderr >&2
        exit 1
    }
}

tiny=(--preset sim300 --size 64x80 --window 24x24 --depths 3 --lenses 9 --pairs 5)
simulate() { # simulate NAME OPTION...
    step "simulate-$1" simulate "${tiny[@]}" -o "$1" "${@:2}"
}
simulate colour --test 2 --seed 5
simulate padded --test 1 --seed 6 --boundary padded --noise 0.02
simulate grey --test 1 --seed 7 --channels 1 --mask diffuser --size 48x60 --depths 2
simulate opaque --test 2 --test-depths 3 --seed 8 --occlude --window 32x40
simulate sensor --test 1 --seed 9 --full-well 10000 --read-noise 5 --adc-bits 12 --dark 0.02 --bits 16 --vignetting cos4
simulate beyond --test 1 --seed 10 --boundary padded --field 48x60 --shift -2,3 --window 40x48
few=(--pairs 1 --test 0 --depths 2)
simulate mask-grid "${few[@]}" --seed 11 --mask grid
simulate mask-contour "${few[@]}" --seed 12 --mask contour
simulate mask-holes "${few[@]}" --seed 13 --mask aperture
simulate mask-cells "${few[@]}" --seed 14 --mask aperture --cell 0.1 --open 0.4 --channels 1
simulate waves "${few[@]}" --seed 15 --optics wave --wavelengths 620,540,450
simulate pictures "${few[@]}" --seed 16 --scenes colour/z100mm/scene
tool pages colour/test/raw/test01.tif sequence.tif 4
tool offset colour/test/raw/test01.tif offset.tif 0.25

fit() { # fit NAME ARGUMENT...: NAME.model
    step "fit-$1" fit "${@:2}" -o "$1.model"
}
for camera in colour padded grey opaque; do fit $camera $camera; done
fit sensor sensor --dark 0.02
fit split colour --form split
fit half colour --half
fit across colour --boundary padded --no-leave-one-out
fit judged colour --refine 0
fit outside colour --refine 0 --outside 0.1
fit plain colour --alpha 0.1 --lambda 0.001 --refine 0 --outside 1
fit free colour --psf-sign free --refine 6 --refine-tv auto
fit weighted colour --refine auto --refine-tv 0.01
fit dark colour --dark auto
fixed=(--alpha 0.1 --lambda 0.001 --refine 0)
fit summed colour --sums colour.sums "${fixed[@]}"
fit merged --merge colour.sums
fit twice colour --merge colour.sums "${fixed[@]}"
fit psf --psf colour/psf.tif --colour
fit psf-matched --psf colour/psf.tif --form matched --boundary circular --window 24x24 --colour
fit psf-grey --psf grey/psf.tif --distances 100,600 --refine 4

frames=(colour/test/raw/test01.tif colour/test/raw/test02.tif)
one=("${frames[0]}" -m colour.model)
reconstruct() { # reconstruct NAME ARGUMENT...: the folder results/NAME
    step "reconstruct-$1" reconstruct "${@:2}" -o "results/$1" --no-preview
}
reconstruct colour "${frames[@]}" -m colour.model
reconstruct queues "${frames[@]}" sequence.tif -m colour.model --queues 2
reconstruct devices "${frames[@]}" sequence.tif -m colour.model --device 0,0 --refine 0
reconstruct sequence sequence.tif -m colour.model --refine 0
for camera in padded grey sensor; do reconstruct $camera $camera/test/raw/test01.tif -m $camera.model; done
reconstruct opaque opaque/test/raw/*.tif -m opaque.model --occupied all
for model in split half judged across psf psf-matched; do
    reconstruct "$model" "${frames[0]}" -m "$model.model" --refine 0
done
reconstruct psf-grey grey/test/raw/test01.tif -m psf-grey.model
reconstruct psf-refined "${frames[0]}" -m psf.model --refine 5
reconstruct linear "${one[@]}" --refine 0
reconstruct linear-halves "${one[@]}" --refine 0 --half
reconstruct band "${one[@]}" --refine 0 --band 0.6
reconstruct error "${one[@]}" --refine 0 --max-error 0.05
reconstruct error-half "${one[@]}" --refine 0 --max-error 0.5 --skip prune,half
reconstruct error-tiles "${one[@]}" --refine 0 --max-error 0.1 --skip prune,tiles,frequencies
reconstruct nothing-skipped "${one[@]}" --refine 0 --skip none
reconstruct all-depths "${one[@]}" --occupied all --refine 6
reconstruct listed "${one[@]}" --depths 1,3
reconstruct occupied "${one[@]}" --occupied 100mm,600mm --refine 3
reconstruct one-by-one "${one[@]}" --refine 0 --batch 1
reconstruct total-variation "${one[@]}" --refine 6 --refine-tv 0.05
reconstruct rough "${one[@]}" --refine 6 --refine-tv 0
reconstruct bits8 "${one[@]}" --bits 8 --gamma 0.5
reconstruct bits16 "${one[@]}" --bits 16 --white 2
reconstruct dark-level offset.tif -m colour.model --dark 0.25
reconstruct dark-auto offset.tif -m colour.model --dark auto --refine 0
few=(--iterations 6)
reconstruct matched "${one[@]}" --method matched
reconstruct wiener "${one[@]}" --method wiener --lambda 0.2
reconstruct wiener-padded padded/test/raw/test01.tif -m padded.model --method wiener
reconstruct rl "${one[@]}" --method rl "${few[@]}"
reconstruct rl-tv "${one[@]}" --method rl "${few[@]}" --tv 0.01 --no-accelerate --stop 0.001
reconstruct fista "${one[@]}" --method fista "${few[@]}"
reconstruct fista-tv "${one[@]}" --method fista "${few[@]}" --tv 0.01 --inner 3
reconstruct fista-wavelet "${one[@]}" --method fista "${few[@]}" --prior wavelet --levels 2
reconstruct fista-haar "${one[@]}" --method fista "${few[@]}" --prior haar --levels 2 --depths 1,3
reconstruct admm "${one[@]}" --method admm "${few[@]}"
reconstruct admm-mu padded/test/raw/test01.tif -m padded.model --method admm "${few[@]}" --mu 1,0.01,0.001 --support window
reconstruct admm-grey grey/test/raw/test01.tif -m grey.model --method admm "${few[@]}"

train() { # train NAME ARGUMENT...: NAME.model, NAME.model.log
    step "train-$1" train "${@:2}" -o "$1.model" --show-every 0
}
# the program may be older than a word
case $("$hadalens" train --help) in *--discriminator*) opponent=--discriminator ;; *) opponent=--critic ;; esac
small=(--net-size 16x16 --batch 2)
vgg=(--vgg vgg.safetensors)
tool vgg vgg.safetensors
train filters colour --stage filters --steps 6 --filter-rate 0.02
train filters-split colour --stage filters --form split --steps 2
train filters-warm padded -m padded.model --stage filters --steps 2 --filter-rate 1e-4
train enhance colour -m colour.model "${small[@]}" --steps 3
train perceptual opaque -m opaque.model --net-size 32x40 --batch 1 "${vgg[@]}" --steps 1 --validate-every 0
train sharp colour -m enhance.model --stage adversarial --batch 2 --steps 2 $opponent-steps 1
train paper colour -m enhance.model --stage adversarial $opponent paper --batch 1 --steps 1 $opponent-steps 1
train conventional grey --stage conventional "${small[@]}" --steps 2
train changed colour -m colour.model "${small[@]}" --steps 2 --shift 3 --noise 0.02 --exposure 0.2 --flips both \
    --plane-flips none --mse 1 --tv 0 --at-once 1 --recompute --rule rmsprop --schedule constant --seed 9
train resumed colour -m colour.model "${small[@]}" --steps 4 --save-every 2 --schedule constant
train again colour -m colour.model "${small[@]}" --steps 2 --save-every 2 --schedule constant
step train-again-resumed train colour -m colour.model "${small[@]}" --steps 4 --save-every 2 --schedule constant \
    --resume -o again.model --show-every 0
reconstruct enhanced "${frames[@]}" -m enhance.model
reconstruct enhanced-linear "${frames[0]}" -m enhance.model --refine 0
reconstruct not-enhanced "${frames[0]}" -m enhance.model --no-enhance

tool turned colour/z100mm turned/z100mm
tool turned colour/z600mm turned/z600mm
step register-same register colour --rotation 3
step register-turned register turned --magnification 0.3,0.8 --rotation 4 -o registered --window 24x24

step evaluate-colour evaluate results/colour colour/test/truth
step evaluate-linear evaluate results/linear colour/test/truth --match-gain --authors --tolerance 1
step evaluate-window evaluate results/listed/test01_aif.tif colour/test/truth/test01_aif.tif --window 20x16+1+2
step evaluate-grey evaluate results/grey grey/test/truth --peak 2
step evaluate-lpips evaluate colour/test/raw/test01.tif colour/test/raw/test02.tif --lpips vgg.safetensors

step optics-rays optics --preset sim300 --size 64x80 --depths 3 --lenses 9 -o optics/rays
step optics-waves optics --preset sim300 --size 64x80 --depths 2 --lenses 9 --optics wave --coherent -o optics/waves
step optics-measured optics colour/camera.json --psf colour/psf.tif --threshold 0.1 -o optics/measured

tool hash . >HASHES
