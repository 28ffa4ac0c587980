#!/usr/bin/env bash
# Training: every stage, logs, going on after signals and kills, what is refused.
. "$(dirname "$0")/cli_testing.sh"
# A net of a few weights, so that steps are quick.
net=small.safetensors
"$FRAME_TOOL" net "$net" 3
quick=(--net "$net" --net-size 16x16 --batch 2)
step_of() { grep -aoE '"step":"[0-9]+"' "$1" | grep -oE '[0-9]+'; }

# The stages, each going on from the one before.
expect 0 'perceptual loss is off.*Stage enhance.*held-out PSNR.*Best on held-out' \
    train "$camera" -m "$model" -o enhanced.model "${quick[@]}" --steps 12
log=enhanced.model.log
has enhanced.model $log/losses.csv $log/validation.csv $log/training.svg $log/checkpoint.safetensors \
    $log/pictures/step00000000.png $log/pictures/step00000012.png
[ "$(wc -l <$log/losses.csv)" = 13 ] || fail 'losses.csv has not a row for each step'
[ "$(wc -l <$log/validation.csv)" = 14 ] || fail 'validation.csv has not a row for each validation'
expect 0 '' reconstruct "$camera/test/raw/test01.tif" -m enhanced.model -o enhanced -q
expect 0 '"stage": "adversarial".*"kept": "last"' train "$camera" -m enhanced.model -o sharp.model --stage adversarial \
    --batch 2 --steps 3 --discriminator-steps 1 --show-every 0 --json
is_json 'train'
expect 0 'linear filters alone.*enhanced' reconstruct "$camera/test/raw/test01.tif" -m sharp.model -o flat --refine 0
expect 0 'Stage filters.*dB at the start' train "$camera" --stage filters -o filters.model --steps 20 --filter-rate 0.02
expect 0 '' reconstruct "$camera/test/raw/test01.tif" -m filters.model -o filters -q --refine 0
expect 0 'Stage filters' train "$camera" --stage filters --form split -o split.model --steps 2
expect 0 'Stage filters' train "$camera" -m "$model" --stage filters -o warm.model --steps 2 --filter-rate 1e-4
expect 0 'Stage conventional' train "$camera" --stage conventional -o plain.net "${quick[@]}" --epochs 1 --hold-out 0.4
expect 0 'exact fit of the 12 pairs to learn from comes first' train "$camera" -o fitted.model "${quick[@]}" --steps 2
expect 2 '--discriminator takes one of patch' train "$camera" -m enhanced.model -o none.model --critic none # its old name
has sharp.model filters.model split.model plain.net fitted.model
expect 0 'on 2 devices' train "$camera" -m "$model" -o two.model "${quick[@]}" --steps 2 --device cpu/2

# Options reach the trainer.
expect 0 'Stopped early: 2 validations' train "$camera" -m "$model" -o early.model "${quick[@]}" --steps 50 --rate 0.5 \
    --patience 2 --validate-every 1 --schedule constant --rule rmsprop --warmup 0
expect 0 'nothing tells how good.*"kept": "last"' train "$camera" -m "$model" -o blind.model "${quick[@]}" --steps 2 \
    --hold-out 0 --json
has blind.model
expect 0 'not finite; back to step 0 with half the rate' train "$camera" -m "$model" -o wild.model "${quick[@]}" \
    --steps 6 --rate 1e15 --clip 0 --warmup 0 --rule adam --schedule constant
expect 0 '' train "$camera" -m "$model" -o changed.model "${quick[@]}" --steps 2 --shift 3 --noise 0.02 --exposure 0.2 \
    --flips both --plane-flips none --mse 1 --tv 0 --at-once 1 --recompute --validate-pairs 1 --seed 9

expect 0 '' train "$camera" -m "$model" -o composed.model --steps 2 --batch 2 --compose 1 --show-every 0
expect 0 'enhanced' reconstruct "$camera/test/raw/test01.tif" -m composed.model -o composed
expect 0 '' train "$camera" -m "$model" -o single.model "${quick[@]}" --steps 2 --compose 0 --show-every 0
expect 2 'a share from 0 to 1' train "$camera" -m "$model" -o none.model "${quick[@]}" --compose 1.5
expect 2 'for the stages enhance and adversarial' train "$camera" -m "$model" --stage conventional -o none.model "${quick[@]}" \
    --compose 0.5
expect 4 'belongs to another training: the share of scenes' train "$camera" -m "$model" -o single.model "${quick[@]}" \
    --steps 2 --compose 0.5 --resume --show-every 0

# Going on gives the bits of going through, whatever was killed on the way.
go=(train "$camera" -m "$model" "${quick[@]}" --noise 0.01 --steps 600 --save-every 5 --validate-every 100
    --show-every 0 -q)
expect 0 '' "${go[@]}" -o whole.model
expect 2 'holds the checkpoint of an earlier training.*--resume' "${go[@]}" -o whole.model
# Where a run ends before it is killed, all begins anew, and they are killed sooner.
killed=0
delay=250
while [ "$killed" -lt 8 ]; do
    "$HADALENS" "${go[@]}" -o killed.model --resume >stdout 2>stderr &
    sleep "$(printf '0.%03d' $((delay + delay * killed / 5)))"
    kill -KILL $! 2>/dev/null
    wait $! 2>/dev/null
    if [ $? = 137 ]; then
        killed=$((killed + 1))
    else
        rm -rf killed.model killed.model.log
        killed=0
        delay=$((delay * 2 / 3))
    fi
done
expect 0 '' "${go[@]}" -o killed.model --resume
cmp -s whole.model killed.model || fail 'a run that was killed now and then gave another model'
cmp -s whole.model.log/checkpoint.safetensors killed.model.log/checkpoint.safetensors ||
    fail 'a run that was killed now and then gave another checkpoint'
cut -d, -f1-11 <whole.model.log/losses.csv >one
cut -d, -f1-11 <killed.model.log/losses.csv >two
cmp -s one two || fail 'a run that was killed now and then logged other losses'
cmp -s whole.model.log/validation.csv killed.model.log/validation.csv || fail 'and other validations'
find . -name '.*.hadalens-*' -delete # of those that were killed while they wrote
# Where the best is gone, that is said, and the last takes its place.
: >killed.model
expect 0 'killed.model holds the parameters of the last step.*killed.model holds no whole model' "${go[@]:0:${#go[@]}-1}" \
    -o killed.model --resume
expect 0 '' reconstruct "$camera/test/raw/test01.tif" -m killed.model -o pictures --no-preview

# Ctrl-C and SIGTERM save.
for signal in INT TERM; do
    touch begun
    bash -c 'trap - INT; exec "$@"' - "$HADALENS" "${go[@]}" -o stopped.model --steps 1000000 --resume >stdout 2>stderr &
    pid=$!
    while kill -0 $pid && ! [ stopped.model.log/checkpoint.safetensors -nt begun ]; do sleep 0.1; done
    kill -$signal $pid
    wait $pid
    [ $? = 130 ] || fail "after SIG$signal the exit code was not 130"
    grep -q 'stopped after step .* --resume goes on' stderr || fail "SIG$signal: no word on how to go on"
    step=$(step_of stopped.model.log/checkpoint.safetensors)
    [ "$(tail -n 1 stopped.model.log/losses.csv | cut -d, -f1)" = "$step" ] || fail "SIG$signal did not save step $step"
done
expect 0 'begin|Stage' train "$camera" -m "$model" -o stopped.model "${quick[@]}" --steps 2 --restart

# What is refused.
expect 4 'the seed is 1 there and 2 here' "${go[@]}" -o killed.model --resume --seed 2
expect 4 'the batch is 2 there and 4 here' "${go[@]}" -o killed.model --resume --batch 4
expect 4 'the stage is enhance there' "${go[@]}" -o killed.model --resume --stage adversarial
head -c 3000 killed.model.log/checkpoint.safetensors >cut && cp cut killed.model.log/checkpoint.safetensors
expect 3 'checkpoint.safetensors' "${go[@]}" -o killed.model --resume
expect 2 'DATASET folder' train -o x
expect 2 'with -o MODEL2' train "$camera"
expect 2 'not both' train "$camera" -o x --steps 3 --epochs 3
expect 2 "share such as 0.2; not 'few'" train "$camera" -o x --hold-out few
expect 4 'nothing would be left to learn from' train "$camera" -o x --hold-out 5
expect 3 "no file 'nosuch'" train "$camera" -m "$model" -o x --net nosuch
expect 3 'nosuch.model' train "$camera" -m nosuch.model -o x
expect 3 'vgg' train "$camera" -m "$model" -o x --vgg nosuch.vgg
expect 2 'shifts of up to 99 pixels' train "$camera" -m "$model" -o x "${quick[@]}" --shift 99
expect 2 'rates are above 0' train "$camera" -m "$model" -o x "${quick[@]}" --rate 0
cp -r "$camera" set && mv set/z100mm set/z90mm
expect 4 'from 100 to 600 mm, the data set holds 3 from 90 to 600' train set -m "$model" -o x
mv set/z90mm set/z100mm
"$FRAME_TOOL" nan set/z100mm/raw/scene0001.tif bad.tif 7 && cp bad.tif set/z100mm/raw/scene0001.tif
expect 4 'pair 1 of the depth at 100 mm: 7 pixels are NaN' train set -m "$model" -o x "${quick[@]}" --steps 20 --restart
lacks nosuch
[ -z "$(find . -name '.*.hadalens-*')" ] || fail 'temporary files left'
finish
