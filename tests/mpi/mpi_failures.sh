#!/usr/bin/env bash
# Ranks that die: the job ends soon with a message, files are whole, and going on gives what an undisturbed run gives.
. "$(dirname "$0")/mpi_testing.sh"
# run_and_kill CLEAN FOLDER PATTERN COUNT ARGUMENTS...: kills the second of two ranks once COUNT files like PATTERN are
# there. On a busy machine the job may have ended before, or have made all of WHOLE such files: CLEAN takes away what it
# left, and it begins again.
run_and_kill() {
    local clean=$1 folder=$2 pattern=$3 count=$4 job begun victim code
    shift 4
    for _ in $(seq 20); do
        $clean
        "$MPIRUN" "${root[@]}" --oversubscribe -np 2 "$HADALENS_MPI" "$@" >out.txt 2>&1 &
        job=$!
        until [ "$(find "$folder" -name "$pattern" 2>/dev/null | wc -l)" -ge "$count" ]; do
            kill -0 $job 2>/dev/null || break
            sleep 0.02
        done
        victim=$(pgrep -P $job | tail -1)
        begun=$SECONDS
        [ -n "$victim" ] && kill -9 "$victim"
        wait $job
        code=$?
        [ $code = 0 ] || [ "$(find "$folder" -name "$pattern" | wc -l)" = "${whole:-none}" ] || break
    done
    [ $code != 0 ] || { echo "FAILED: the job ended well although a rank was killed"; bad=1; }
    [ $((SECONDS - begun)) -lt 1200 ] || { echo "FAILED: the job took $((SECONDS - begun)) s to end"; bad=1; }
    must "a message" grep -qi "killed" out.txt
    echo "a rank of '$1' was killed; the job ended $((SECONDS - begun)) s later"
}

camera 2
for depth in camera/z*; do # many pairs, at no cost
    first=$(find "$depth/raw" -name '*.tif' -printf '%f\n' | sort | head -1)
    for i in $(seq 80); do
        ln "$depth/raw/$first" "$depth/raw/more$i.tif"
        ln "$depth/scene/$first" "$depth/scene/more$i.tif"
    done
done
must fit "$HADALENS" fit camera -o camera.model --sums whole.sums

# Frames; MPI_FRAMES: so many, as .ci/nightly has it.
frames=${MPI_FRAMES:-240}
mkdir frames
for i in $(seq $frames); do
    cp "camera/test/raw/test0$((1 + i % 2)).tif" "frames/frame$(printf %04d "$i").tif"
done
must "undisturbed" "$HADALENS" reconstruct frames/*.tif -m camera.model -o undisturbed --no-preview
# more are done until the rank is found and killed
no_frames() { rm -rf broken; }
whole=$frames run_and_kill no_frames broken '*_stack.tif' $((frames / 6)) reconstruct frames/*.tif -m camera.model -o broken --no-preview
done=$(find broken -name '*_stack.tif' | wc -l)
echo "$done of $frames frames were done"
[ "$done" -lt $frames ] || { echo "FAILED: everything was done before the rank was killed"; bad=1; }
for file in broken/*_stack.tif; do
    name=$(basename "$file")
    cmp -s "$file" "undisturbed/$name" || { echo "FAILED: $file is not whole"; bad=1; }
done
touch -d '2000-01-01' frames/*.tif camera.model # results that are older than these are made anew
touch -d '2001-01-01' broken/*_stack.tif broken/*_aif.tif broken/*_depth.tif
must "going on" ranks 2 reconstruct frames/*.tif -m camera.model -o broken --no-preview --resume
[ "$(find broken -name '*_stack.tif' -not -newermt '2002-01-01' | wc -l)" -ge "$done" ] ||
    { echo "FAILED: frames that were done were done again"; bad=1; }
for file in undisturbed/*; do
    cmp -s "$file" "broken/$(basename "$file")" || { echo "FAILED: $(basename "$file") differs after going on"; bad=1; }
done

# Sums, saved after every pair here.
no_sums() { rm -f sums sums.*-of-* sums.model; }
run_and_kill no_sums . 'sums.*-of-2' 1 fit camera -o sums.model --sums sums --save-seconds 0
must "the fit goes on" ranks 2 fit camera -o sums.model --sums sums --save-seconds 0 --resume
must "the sums of an undisturbed run" python3 "$here/compare.py" whole.sums sums same
must "nothing is left of the parts" test -z "$(find . -name 'sums.*-of-*' -print -quit)"
must "and again, from whole sums" ranks 2 fit camera -o more.model --sums sums --resume
must "the same model" cmp sums.model more.model

# Training, which goes on with another number of ranks.
train() {
    train=(train camera -m camera.model --batch 4 --seed 3 --validate-every 0 --show-every 0 --save-every 2 --steps 16
        -o "$1.model" --log "$1.log")
}
train through
must "training through" ranks 2 "${train[@]}"
train on
no_log() { rm -rf on.model on.log && mkdir on.log; }
run_and_kill no_log on.log checkpoint.safetensors 1 "${train[@]}"
cp -r on.log other.log
must "two ranks go on" ranks 2 "${train[@]}" --resume
must "the bits of going through" python3 "$here/compare.py" through.log/checkpoint.safetensors \
    on.log/checkpoint.safetensors same
train other
must "three ranks go on" ranks 3 "${train[@]}" --resume
# Pairs, their changes and the sums' order are the same, but each rank adds up other pairs in single precision: 1e-7 of a
# gradient, which Adam's division by its size lets grow. After these 16 steps 2e-5 of the optimiser's states and 4e-7 of
# the values were seen between 2 and 3 ranks, 1.2e-4 and 5e-5 in another version, 6e-5 and 2e-5 between 1 and 2, which
# compute other numbers of pairs at once. Noise of a thousandth on the pairs makes 0.5 and 6e-3.
must "which is the same training" python3 "$here/compare.py" through.log/checkpoint.safetensors \
    other.log/checkpoint.safetensors 1e-3

# A wish to stop, as batch systems send it: the ranks end when the first has saved, long before it was due.
"$MPIRUN" "${root[@]}" --oversubscribe -np 2 "$HADALENS_MPI" train camera -m camera.model --batch 4 --validate-every 0 \
    --show-every 2 --save-every 100000 --steps 100000 -o warned.model --log warned.log >out.txt 2>&1 &
job=$!
while kill -0 $job 2>/dev/null && ! [ -e warned.log/pictures/step00000002.png ]; do sleep 0.1; done
must "nothing is saved yet" test ! -e warned.log/checkpoint.safetensors
kill -USR2 $job
wait $job
code=$?
[ $code = 130 ] || { echo "FAILED: the job that was asked to stop has code $code"; bad=1; }
must "words" grep -q 'stopped after step .* --resume goes on' out.txt
must "a checkpoint" test -s warned.log/checkpoint.safetensors
finish
