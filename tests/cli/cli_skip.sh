#!/usr/bin/env bash
# What a frame does not need: options, and what is said about it.
. "$(dirname "$0")/cli_testing.sh"
raw="$camera/test/raw"
one=("$raw/test01.tif" -m "$model" --refine 0)

expect 0 '' reconstruct "${one[@]}" -o all
expect 0 '' reconstruct "${one[@]}" -o channels --skip prune,channels
same_results all/test01_stack.tif channels/test01_stack.tif || fail 'exact kinds changed the stack'
expect 0 '"kinds": \[\]' reconstruct "${one[@]}" -o none --skip none --json
is_json reconstruct
expect 0 '"prune"' reconstruct "${one[@]}" -o none --json

expect 0 'half filters; at most .* % change' reconstruct "${one[@]}" -o half --max-error 0.5 --skip prune,half
same_results all/test01_stack.tif half/test01_stack.tif && fail '--max-error changed nothing'
expect 0 '"half"' reconstruct "${one[@]}" -o half --max-error 0.5 --json
expect 0 '% of the frequencies left out' reconstruct "${one[@]}" -o band --band 0.5
[ "$(info band/test01_stack.tif)" = "$(info all/test01_stack.tif)" ] || fail '--band changed the size'
same_results all/test01_stack.tif band/test01_stack.tif && fail '--band changed nothing'

# A sequence of equal frames, in one colour.
"$FRAME_TOOL" pages "$raw/test01.tif" sequence.tif 3
expect 0 'the result of the frame before' reconstruct sequence.tif -m "$model" -o sequence
expect 0 '' reconstruct sequence.tif -m "$model" -o each --skip prune
same_results sequence/sequence_stack.tif each/sequence_stack.tif || fail 'equal frames gave another stack'
"$FRAME_TOOL" flat flat.tif 64 80 3 0.5
expect 0 '3 channels black or copied' reconstruct flat.tif -m "$model" -o flat --refine 0 --dark 0.5

expect 2 "not 'colours'" reconstruct "${one[@]}" -o a --skip prune,colours
expect 2 "not ''" reconstruct "${one[@]}" -o a --skip prune,
expect 2 '--max-error takes' reconstruct "${one[@]}" -o a --max-error 1
expect 2 '--band a share' reconstruct "${one[@]}" -o a --band 0
expect 2 'add --refine 0' reconstruct "$raw/test01.tif" -m "$model" -o a --refine 3 --band 0.5
finish
