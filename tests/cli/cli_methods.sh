#!/usr/bin/env bash
# Other methods: each runs, stops by its rule, says so, and refuses what makes no sense.
. "$(dirname "$0")/cli_testing.sh"
one=("$camera/test/raw/test01.tif" -m "$model" --no-preview)

for method in wiener rl fista admm; do
    few=(--method $method --iterations 8)
    [ "$method" != wiener ] || few=(--method wiener --lambda 0.2)
    expect 0 "$method.*unexplained" reconstruct "${one[@]}" -o $method "${few[@]}"
    [ "$method" = wiener ] || grep -q '8 iterations' stdout stderr || fail "$method: not 8 iterations"
    [ "$(info $method/test01_stack.tif)" = '3 3 24 24 32' ] || fail "$method: $(info $method/test01_stack.tif)"
    has $method/test01_{aif,depth}.tif
    expect 0 '' reconstruct "${one[@]}" -o again "${few[@]}"
    same_results $method/test01_stack.tif again/test01_stack.tif || fail "$method: two runs gave different stacks"
done
same_results rl/test01_stack.tif fista/test01_stack.tif && fail 'rl and fista gave the same'

# The transposed optics are not refined unless that is asked for.
expect 0 '' reconstruct "${one[@]}" -o matched --method matched
expect 0 '' reconstruct "${one[@]}" -o again --method matched --refine 0
expect 0 '' reconstruct "${one[@]}" -o own
same_results matched/test01_stack.tif again/test01_stack.tif || fail '--method matched is refined'
same_results matched/test01_stack.tif own/test01_stack.tif && fail '--method matched changed nothing'

# Priors, in both ways of saying them.
expect 0 '' reconstruct "${one[@]}" -o tv --method fista --iterations 8 --tv 0.01
expect 0 '' reconstruct "${one[@]}" -o same --method fista --iterations 8 --prior tv --weight 0.01
same_results tv/test01_stack.tif same/test01_stack.tif || fail '--tv is not --prior tv --weight'
same_results tv/test01_stack.tif fista/test01_stack.tif && fail '--tv changed nothing'
for prior in wavelet haar; do
    expect 0 '' reconstruct "${one[@]}" -o $prior --method fista --iterations 8 --prior $prior --levels 2
    same_results $prior/test01_stack.tif fista/test01_stack.tif && fail "--prior $prior changed nothing"
done

# The weight of total variation: each frame's own by default, and what was chosen is said; another one as it is given.
expect 0 '' reconstruct "${one[@]}" -o auto --method fista --iterations 8 --tv auto
expect 0 '' reconstruct "${one[@]}" -o same --method fista --iterations 8 --prior tv
same_results auto/test01_stack.tif same/test01_stack.tif || fail '--tv auto is not --prior tv'
same_results auto/test01_stack.tif fista/test01_stack.tif && fail '--tv auto takes no total variation'
expect 0 'admm, 8 iterations, total variation [0-9.e-]+' reconstruct "${one[@]}" -o same --method admm --iterations 8 --weight auto
same_results admm/test01_stack.tif same/test01_stack.tif || fail '--weight auto is not the default'
expect 0 '"refine_tv": 0.003,' reconstruct "${one[@]}" -o given --method admm --iterations 8 --weight 0.003 --json
same_results admm/test01_stack.tif given/test01_stack.tif && fail 'admm takes 0.003 by default'
expect 0 '"refine_tv": 0.003,' reconstruct "${one[@]}" -o a --method admm --seconds 9 --iterations 3 --json

# Weights of pixels: methods that iterate take them, and equal ones change nothing; a Wiener filter cannot.
read -r _ _ rows cols _ <<< "$(info "$camera/test/raw/test01.tif")"
"$FRAME_TOOL" flat even.tif "$rows" "$cols" 1 0.5
for method in rl admm; do
    expect 0 '' reconstruct "${one[@]}" -o weighed --method $method --iterations 8 --weights even.tif
    same_results $method/test01_stack.tif weighed/test01_stack.tif || fail "--weights EVEN changed $method"
done
expect 2 'linear filters take no weights' reconstruct "${one[@]}" -o b --method wiener --weights even.tif

# Stopping rules, settings, depths.
expect 0 '"method": "admm".*"refine_steps": 1,' reconstruct "${one[@]}" -o a --method admm --seconds 1e-9 --json
is_json 'reconstruct --method admm'
expect 0 'rl, [0-9]+ iterations' reconstruct "${one[@]}" -o a --method rl --stop 0.05 --no-accelerate
grep -q '100 iterations' stdout stderr && fail '--stop did not stop'
expect 0 '' reconstruct "${one[@]}" -o a --method admm --iterations 3 --mu 1,0.01,0.001 --support window
expect 0 '171.4 mm; fista, 1 iteration;' reconstruct "${one[@]}" -o a --method fista --iterations 1 --occupied 2 --step 1.5
expect 0 '' reconstruct "${one[@]}" -o a --method fista --depths 1,3 --iterations 2
[ "$(info a/test01_stack.tif)" = '2 3 24 24 32' ] || fail "--depths: $(info a/test01_stack.tif)"

# What makes no sense.
expect 2 'support is the grid only' reconstruct "${one[@]}" -o b --support grid
expect 2 'support is the grid only' reconstruct "${one[@]}" -o b --method wiener --support grid
expect 2 '--iterations belongs to --method' reconstruct "${one[@]}" -o b --iterations 5
expect 2 '--tv belongs to --method' reconstruct "${one[@]}" -o b --method wiener --tv 1
expect 2 'one or the other' reconstruct "${one[@]}" -o b --method fista --tv 1 --weight 1
expect 2 'choose one with --prior' reconstruct "${one[@]}" -o b --method rl --weight 1
expect 2 'no such prior' reconstruct "${one[@]}" -o b --method admm --prior wavelet
expect 2 '--mu takes three numbers' reconstruct "${one[@]}" -o b --method admm --mu 1,2
expect 2 "'x' is not a number" reconstruct "${one[@]}" -o b --method admm --mu 1,x,2
expect 2 'levels' reconstruct "${one[@]}" -o b --method fista --prior haar --levels 9
expect 2 'lambda must be greater' reconstruct "${one[@]}" -o b --method wiener --lambda 0
expect 2 'band' reconstruct "${one[@]}" -o b --method admm --band 0.5
finish
