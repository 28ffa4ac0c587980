#!/usr/bin/env bash
# kill -9 at random moments of every command that writes: afterwards there is the old result or the new one, whole, and
# the next run is as a first. kill.sh TIMES [SEED]: so often for each command
. "$(dirname "$0")/../cli/cli_testing.sh"
times=$1
RANDOM=${2:-1}
small=(--preset sim300 --size 40x48 --window 24x24 --depths 2 --lenses 3 --pairs 3 --channels 1)

# killed FOLDER COMMAND...: runs the command again and again, ended at random moments of the time that it takes; what
# stands in FOLDER (hidden names aside) is what stood there or what a whole run leaves.
killed() {
    local target=$1 took start old
    shift
    rm -rf "$target" old
    start=$(date +%s%N)
    "$HADALENS" "$@" >stdout 2>stderr || fail "hadalens $*"
    took=$((($(date +%s%N) - start) / 1000000 + 1))
    cp -r "$target" whole
    for _ in $(seq "$times"); do
        # at times over nothing, at times over the result of before
        [ $((RANDOM % 2)) = 0 ] && rm -rf "$target"
        rm -rf old
        [ -e "$target" ] && [ "$1" != fit ] && [ "$1" != reconstruct ] && rm -rf "$target"
        "$HADALENS" "$@" >stdout 2>stderr &
        sleep "$(printf '%d.%03d' $((RANDOM % took / 1000)) $((RANDOM % took % 1000)))"
        kill -9 $! 2>/dev/null
        wait $! 2>/dev/null
        [ ! -e "$target" ] || same "$target" || fail "half a result after kill -9: hadalens $*"
    done
    rm -rf "$target"
    "$HADALENS" "$@" >stdout 2>stderr || fail "the next run: hadalens $*"
    diff -r whole "$target" >/dev/null || fail "the next run gives something else: hadalens $*"
    rm -rf whole
}

# Every file that is there is as a whole run leaves it; folders that appear at once are there with all that is in them.
same() {
    local file
    if [ "$command" = files ]; then
        for file in $(cd "$1" && find . -type f ! -name '.*'); do
            cmp -s "$1/$file" "whole/$file" || return 1
        done
    else
        diff -r whole "$1" >/dev/null
    fi
}

command=whole
killed set simulate "${small[@]}" --test 1 -o set
"$HADALENS" simulate "${small[@]}" --test 1 -o data >stdout 2>stderr
killed a.model fit data -o a.model --refine 0 --no-leave-one-out
"$HADALENS" fit data -o b.model --refine 0 --no-leave-one-out >stdout 2>stderr
killed registered register data --rotation 3 -o registered
command=files
killed pictures reconstruct data/test/raw/test01.tif -m b.model -o pictures --refine 0 --no-preview
find . -name '.*.hadalens-*' -prune -exec rm -r {} + # of those that were killed
finish
