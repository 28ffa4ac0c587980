#!/usr/bin/env bash
# The same results for 1, 2 and 4 ranks, and the same bits on repetition. With 4 depths, 2 ranks take whole depths, and 3
# ranks share the pairs of each.
. "$(dirname "$0")/mpi_testing.sh"
compare() { must "$1 and $2 within $3" python3 "$here/compare.py" "$1" "$2" "$3"; }

camera 4
must alone "$HADALENS" fit camera -o 1.model --sums 1.sums
for count in 2 3 4; do
    must "fit on $count" ranks $count fit camera -o r$count.model --sums r$count.sums
    compare 1.sums r$count.sums 1e-11
    compare 1.model r$count.model 1e-6
done
must "fit on 3 again" ranks 3 fit camera -o again.model --sums again.sums
compare r3.sums again.sums same
compare r3.model again.model same
# as ranks of several machines exchange
HADALENS_MPI_MEMORY=off must "fit on 3, apart" ranks 3 fit camera -o apart.model --sums apart.sums
compare r3.sums apart.sums same
compare r3.model apart.model same

# A frame is a rank's: the bits of one process.
must "reconstruct alone" "$HADALENS" reconstruct camera/test/raw/*.tif -m 1.model -o 1
must "reconstruct on 2" ranks 2 reconstruct camera/test/raw/*.tif -m 1.model -o 2 --json
cp must.txt document.txt
must "the document names all files" grep -q test02_stack.tif document.txt
must "the same files" diff -r 1 2

# Adam divides by gradients, so that the least of them grow apart: parameters are compared less closely than gradients.
train() {
    must "train $1" "${@:2}" train camera -m 1.model -o "$1.model" --log "$1.log" --batch 8 --seed 3 \
        --validate-every 3 --show-every 0 --save-every 3 --steps 6
}
train t1 "$HADALENS"
train t2 ranks 2
train t4 ranks 4
train again ranks 4
HADALENS_MPI_MEMORY=off train apart ranks 4
# Each rank adds up other pairs in single precision: 1e-7 of a gradient, which Adam's division by its size lets grow, as
# mpi_failures.sh says; 4.5e-5 of the optimiser's states and 1.5e-5 of the values were seen.
compare t1.log/checkpoint.safetensors t2.log/checkpoint.safetensors 2e-4
compare t1.log/checkpoint.safetensors t4.log/checkpoint.safetensors 2e-4
compare t4.log/checkpoint.safetensors again.log/checkpoint.safetensors same
compare t4.log/checkpoint.safetensors apart.log/checkpoint.safetensors same
gradients() { cut -d, -f2,8 "$1.log/losses.csv" | sed -n 2p; }
for count in 2 4; do
    must "loss and gradient of $count" python3 -c "
import sys
one, other = ([float(x) for x in text.split(',')] for text in sys.argv[1:])
sys.exit(any(abs(a - b) > 1e-6 * abs(a) for a, b in zip(one, other)))" "$(gradients t1)" "$(gradients t$count)"
done

# What is no work for ranks is refused, and what fails on all ends with its code and is said once, by the first.
# fails CODE TEXT ARGUMENTS...
fails() {
    local code=$1 text=$2
    shift 2
    ranks 2 "$@" >out.txt 2>&1
    local found=$?
    [ $found = "$code" ] || { echo "FAILED: $*: code $found, not $code"; bad=1; }
    [ "$(grep -c -- "$text" out.txt)" = 1 ] || { echo "FAILED: $*: not once '$text':"; cat out.txt; bad=1; }
}
fails 2 "no work for several ranks" devices
fails 2 "there is no command" devises
fails 2 "there is no option" fit --devises
fails 3 "cannot be opened" reconstruct camera/test/raw/test01.tif -m no.model -o x
fails 3 "no.tif" reconstruct camera/test/raw/*.tif no.tif -m 1.model -o x
fails 3 "nothing" fit nothing -o x.model
fails 5 "rank 1 of 2: no device" fit camera -o x.model --device 0,99
fails 0 "Usage:" fit --help
finish
