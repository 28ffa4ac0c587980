#!/usr/bin/env bash
# The way of a frame on a device that says it is another one (pretend.c): a camera is fitted, frames are reconstructed
# linearly, refined and as a surface, nets train. Pictures agree with those of the device as it is, or a message tells.
#   pretend.sh truth: makes what the others compare with; pretend.sh NAME
TEST_NAME=pretend_$1
. "$(dirname "$0")/../cli/cli_testing.sh"
truth=$WORK/pretend.truth
net=(--net "$truth/net.safetensors" --net-size 16x16 --batch 2 --steps 2 --show-every 0)

# The whole way, each step from what the true device made before it.
way() {
    expect 0 '' fit "$camera" -o fitted.model
    expect 0 '' reconstruct "$camera/test/raw/test01.tif" -m fitted.model -o fitted --refine 0
    expect 0 '' reconstruct "$camera"/test/raw/*.tif -m "$model" -o linear --refine 0
    expect 0 '' reconstruct "$camera"/test/raw/*.tif -m "$model" -o refined
    expect 0 '' reconstruct "$truth/set/test/raw/test01_slant.tif" -m "$truth/set.model" -o surface --scene surface
    expect 0 '' train "$camera" -m "$model" -o trained.model "${net[@]}"
}

# agree FOLDER ERROR: every image of it is the truth's but for this mean absolute error (white is 1).
agree() {
    "$HADALENS" evaluate "$1" "$truth/$1" --json >compared 2>stderr || fail "$1 cannot be compared"
    grep -oE '"mae": [-+0-9.e]+' compared | awk -v most="$2" '
        { seen++; if (!($2 + 0 <= most)) { print $0 ", at most " most " is right"; bad = 1 } }
        END { exit bad || !seen }' >stdout || fail "$1 differs from what the true device gives"
}

# Losses of the two steps, to a thousandth.
agree_losses() {
    awk -F, 'NR == FNR { loss[FNR] = $2; next }
        FNR > 1 && !(($2 - loss[FNR]) ^ 2 <= (1e-3 * loss[FNR]) ^ 2) { bad = 1 } END { exit bad || FNR != 3 }' \
        "$truth/trained.model.log/losses.csv" trained.model.log/losses.csv || fail 'training has other losses'
}

# as WORDS: the way on a device that pretends so. Both shapes of kernels round differently.
as() {
    export LD_PRELOAD=$PRETEND CL_PRETEND=$1
    way
    unset LD_PRELOAD CL_PRETEND
    for part in linear fitted; do agree $part 1e-5; done
    for part in refined surface; do agree $part 1e-4; done
    agree_losses
}

# refused CODE WORDS PRETENCE COMMAND...: an error that says what to do, and nothing left behind
refused() {
    local code=$1 words=$2 pretence=$3
    shift 3
    LD_PRELOAD=$PRETEND CL_PRETEND=$pretence expect "$code" "$words" "$@"
}

case $1 in
truth)
    rm -rf "$truth"
    mkdir -p "$truth"
    cd "$truth" || exit 1
    "$FRAME_TOOL" net net.safetensors 3
    expect 0 '' simulate --preset crop300 --size 150x200 --window 64x64 --depths 4 --pairs 5 -o set --surface slant --seed 5
    expect 0 '' fit set -o set.model
    way
    ;;
gpu) as gpu,units=132,nvidia,late ;;
wave64) as gpu,wave64,local=65536,align=256 ;;
small) as gpu,wave64,local=32768,plain,queues=1 ;;
tight) as gpu,memory=100663296,align=4096 ;;
cpu) as local=32768,plain,memory=134217728,queues=1,align=4096,slow=100 ;;
fpga)
    # a cache that has seen the way is a folder of binaries as well
    HADALENS_CACHE=$PWD/kernels as apart,local=32768,queues=1,align=4096
    rm -rf fitted* linear refined surface trained*
    HADALENS_BINARIES=$PWD/kernels as fpga,queues=1,align=4096
    ;;
refused)
    refused 6 'in one piece|larger than|at most' memory=65536 fit "$camera" -o x.model
    refused 6 'in one piece|at most' gpu,memory=65536 reconstruct "$camera/test/raw/test01.tif" -m "$model" -o x
    HADALENS_CACHE=off refused 5 'cannot compile' fpga reconstruct "$camera/test/raw/test01.tif" -m "$model" -o x
    lacks x.model
    files x 0
    ;;
*) echo "pretend.sh: there is no '$1'" && exit 2 ;;
esac
finish
