#!/usr/bin/env bash
# Several processes at once on one output folder, one data set, one tuning file, one cache of programs that is empty:
# each ends well or says why, and what they leave is whole. together.sh ROUNDS
. "$(dirname "$0")/../cli/cli_testing.sh"
small=(--preset sim300 --size 40x48 --window 24x24 --depths 2 --lenses 3 --pairs 3 --channels 1)
"$HADALENS" simulate "${small[@]}" --test 1 -o data >stdout 2>stderr || fail 'no data set'
"$HADALENS" fit data -o a.model --refine 0 --no-leave-one-out >stdout 2>stderr || fail 'no model'
export HADALENS_CACHE="$here/cache"

# at_once COMMAND...: four of the same at once; counts those that end well.
at_once() {
    local pids=() good=0 code
    for k in 1 2 3 4; do
        "$HADALENS" "$@" >"out$k" 2>"err$k" &
        pids+=($!)
    done
    for k in 1 2 3 4; do
        wait "${pids[k - 1]}"
        code=$?
        [ $code -le 7 ] || fail "exit code $code: hadalens $*: $(cat "err$k")"
        [ $code = 0 ] && good=$((good + 1))
        [ $code = 0 ] || [ -s "err$k" ] || fail "exit code $code without a message: hadalens $*"
    done
    ended_well=$good
}

for _ in $(seq "$1"); do
    rm -rf cache one
    at_once reconstruct data/test/raw/test01.tif -m a.model -o one --refine 0
    [ "$ended_well" = 4 ] || fail "only $ended_well of 4 into one folder: $(cat err?)"
    rm -rf whole
    "$HADALENS" reconstruct data/test/raw/test01.tif -m a.model -o whole --refine 0 >stdout 2>stderr
    diff -r one whole >/dev/null || fail 'one folder: other pictures than alone'
    # whoever comes first has the name of a folder that appears at once
    rm -rf set
    at_once simulate "${small[@]}" --test 1 -o set
    [ "$ended_well" -ge 1 ] || fail 'no data set of four'
    diff -r set data >/dev/null || fail 'one data set: other files than alone'
    at_once fit data -o one.model --refine 0 --no-leave-one-out
    [ "$ended_well" = 4 ] || fail "only $ended_well of 4 onto one model: $(cat err?)"
    cmp -s one.model a.model || fail 'one model: other bits than alone'
    [ -z "$(find . -name '.*.hadalens-*')" ] || fail 'temporary files left'
    # the cache is filled now
    "$HADALENS" reconstruct data/test/raw/test01.tif -m a.model -o whole --refine 0 >stdout 2>stderr ||
        fail 'from the cache that four have filled'
done
rm -f tuning
for size in 15x14 16x14 17x14; do "$HADALENS" tune -o tuning --size $size --rounds 1 >stdout 2>stderr & done
wait
[ "$(grep -c '^fft' tuning)" = 3 ] || fail "rows of three at once: $(cat tuning)"
finish
