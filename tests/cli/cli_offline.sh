#!/usr/bin/env bash
# The way of an FPGA: every kernel to binaries once, then the whole job from those alone.
. "$(dirname "$0")/cli_testing.sh"

# a signal ends it between two programs
"$HADALENS" devices --save-binaries some >stdout 2>stderr &
process=$!
while kill -0 $process && [ -z "$(ls some 2>/dev/null)" ]; do sleep 0.05; done
kill -s TERM $process
wait $process
code=$?
[ $code = 130 ] || fail "exit code $code after TERM"
lacks some/.*.hadalens-*

expect 0 'Wrote the binaries' devices --save-binaries kernels
[ "$(ls some | wc -l)" -lt "$(ls kernels | wc -l)" ] || fail 'TERM ended it only when all was built'
has kernels
expect 0 '"compiled": 0' simulate --preset sim300 --size 64x80 --window 24x24 --depths 2 --lenses 9 --pairs 2 -o z \
    --binaries kernels --json
expect 0 '"compiled": 0' fit z -o z.model --binaries kernels --json
expect 0 '"compiled": 0' reconstruct z/z100mm/raw/*.tif -m z.model -o y --binaries kernels --json
"$FRAME_TOOL" lpips alex.safetensors
expect 0 '"compiled": 0' evaluate z/z100mm/raw/scene0001.tif z/z100mm/raw/scene0002.tif --lpips alex.safetensors \
    --binaries kernels --json
finish
