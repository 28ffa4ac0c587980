#!/usr/bin/env bash
# Every command that writes, recorded and judged: what would a loss of power have left? power.sh RECORDER JUDGE
. "$(dirname "$0")/../cli/cli_testing.sh"
recorder=$1 judge=$2
small=(--preset sim300 --size 40x48 --window 24x24 --depths 2 --lenses 3 --pairs 3 --channels 1)

# lossless COMMAND...: runs it, recorded, in this folder.
lossless() {
    rm -f "$here/log"
    (cd disk && POWER_LOG="$here/log" LD_PRELOAD="$recorder" "$HADALENS" "$@") >stdout 2>stderr || fail "hadalens $*"
    python3 "$judge" log disk >stdout 2>stderr || fail "after a loss of power: hadalens $*"
}

mkdir disk
lossless simulate "${small[@]}" --test 1 -o set
lossless fit set -o a.model --sums a.sums --refine 0 --no-leave-one-out
lossless fit set -o a.model --refine 0 --no-leave-one-out # over the old one
lossless fit --psf set/psf.tif --distances 100,600 -o psf.model
lossless reconstruct set/test/raw/test01.tif -m a.model -o pictures --refine 0
lossless train set -m a.model -o b.model --steps 2 --hold-out 1
lossless train set -m a.model -o b.model --steps 3 --hold-out 1 --resume
lossless register set --rotation 3 -o registered
lossless optics set/camera.json -o design
lossless tune -o tuning --size 15x14 --rounds 1
lossless tune -o tuning --size 16x14 --rounds 1
lossless devices --save-binaries kernels
lossless bench -m a.model set/test/raw/test01.tif --quick --no-start --no-sweep -o speed
lossless bench -m a.model set/test/raw/test01.tif --quick --no-start --no-sweep -o speed # over the old one
finish
