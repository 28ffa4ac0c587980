#!/usr/bin/env bash
# What is read is never overwritten; signals, full disks and broken pipes leave what was there.
. "$(dirname "$0")/cli_testing.sh"

# The second input has the name of the first one's result.
mkdir cap
cp "$camera/test/raw/test01.tif" cap/f.tif
cp "$camera/test/raw/test02.tif" cap/f_aif.tif
before=$(cksum <cap/f_aif.tif)
expect 3 'f_aif.tif is read by this command' reconstruct cap/f.tif cap/f_aif.tif -m "$model" -o cap --no-preview
[ "$before" = "$(cksum <cap/f_aif.tif)" ] || fail 'an input was overwritten'
cp -r "$camera" data
frame=$(find data/z* -path '*/raw/*.tif' | sort | head -n 1)
before=$(cksum <"$frame")
expect 3 'read by this command' fit data -o "$frame"
[ "$before" = "$(cksum <"$frame")" ] || fail 'fit overwrote a frame of its data set'
expect 3 'read by this command' fit --psf "$camera/psf.tif" --distances 100,600 -o "$camera/psf.tif"

# Outputs against each other, against what a data set leaves out, against files that are nobody's rest of a fit, and
# against inputs at the place of a map that a camera of one depth does not make.
expect 2 'output and --sums both name ./m1' fit data -o m1 --sums ./m1
lacks m1
ln -s nowhere m2
expect 2 'both name' fit data -o m2 --sums "$PWD/m2"
rm m2
folder=$(dirname "$frame")
cp "$frame" "$folder/alone.tif"
expect 3 'alone.tif is read by this command' fit data --skip-incomplete -o "$folder/alone.tif"
cmp -s "$frame" "$folder/alone.tif" || fail 'fit overwrote a frame that it had left out'
rm "$folder/alone.tif"
echo mine >r.1-of-1
expect 3 'r.1-of-1.*not what an interrupted fit left' fit data -o x --sums r
[ "$(cat r.1-of-1)" = mine ] || fail 'a file was taken for the rest of a fit'
expect 0 '' fit data -o x --sums r.1-of-1.whole
mv r.1-of-1.whole r.1-of-1
before=$(cksum <r.1-of-1)
expect 3 'r.1-of-1.*not what an interrupted fit left' fit data -o x --sums r --resume
[ "$before" = "$(cksum <r.1-of-1)" ] || fail 'saved sums were taken for the rest of a fit'
rm -f x r.1-of-1
"$FRAME_TOOL" spots spots.tif 64 80 9 1
expect 0 '1 depth' fit --psf spots.tif -o one.model --frame "$camera/test/raw/test01.tif"
cp "$camera/test/raw/test01.tif" cap/g.tif
cp "$camera/test/raw/test02.tif" cap/g_depth.tif
expect 0 '' reconstruct cap/g.tif cap/g_depth.tif -m one.model -o cap --no-preview
same_results "$camera/test/raw/test02.tif" cap/g_depth.tif || fail 'an input was removed as the map of a run before'

# A device, a FIFO, a full disk.
mkfifo pipe.tif
expect 3 'not an ordinary file' fit data -o pipe.tif
expect 3 'not an ordinary file' fit data -o /dev/null
expect 3 'not an ordinary file' reconstruct pipe.tif -m "$model" -o x
if [ -e /dev/full ]; then
    "$HADALENS" devices >/dev/full 2>stderr
    [ $? = 3 ] || fail 'devices to a full disk'
    grep -q 'could not be written' stderr || fail 'devices to a full disk says nothing'
fi
for odd in /dev/zero pipe.tif; do
    HADALENS_TUNING=$odd expect 3 'tuning file.*not an ordinary file' devices --check
done

# A driver that cannot keep what it compiles: the folder is named, not a defect of the kernels.
mkdir -m 0555 readonly
if command -v setpriv >/dev/null && [ "$(id -u)" = 0 ] && setpriv --reuid 65534 --clear-groups test -x "$HADALENS"; then
    POCL_CACHE_DIR=$PWD/readonly HADALENS_CACHE=off setpriv --reuid 65534 --clear-groups \
        "$HADALENS" devices --check >stdout 2>stderr
    grep -q 'does not build' stderr && { grep -q 'POCL_CACHE_DIR=.*cannot be written' stderr || fail 'read-only cache'; }
fi

# Signals in the midst of writing a folder, which would take hours, leave nothing.
small=(--preset sim300 --size 64x80 --window 24x24 --depths 2 --lenses 9)
begin_to_write() {
    "$HADALENS" simulate "${small[@]}" --pairs 100000 -o set >stdout 2>stderr &
    process=$!
    while kill -0 $process && [ -z "$(find . -maxdepth 1 -name '.set.hadalens-*')" ]; do sleep 0.05; done
}
for signal in HUP INT TERM USR2; do
    begin_to_write
    kill -s "$signal" $process
    wait $process
    code=$?
    [ $code = 130 ] || fail "exit code $code after $signal"
    lacks set .set.hadalens-*
done
# twice: at once
begin_to_write
kill -s TERM $process
kill -s TERM $process
wait $process
lacks set .set.hadalens-*

# Limits of a process: a file that may grow no more is a write that fails, the end of its time a signal like others.
(ulimit -f 16 && "$HADALENS" simulate "${small[@]}" --pairs 4 -o set >stdout 2>stderr)
code=$?
[ $code = 3 ] || fail "exit code $code at a limit for files"
grep -q 'File too large; nothing was left behind' stderr || fail 'a limit for files says nothing'
lacks set .set.hadalens-*
(ulimit -St 1 && exec "$HADALENS" simulate "${small[@]}" --pairs 100000 -o set >stdout 2>stderr)
code=$?
[ $code = 130 ] || fail "exit code $code after a limit of time"
lacks set .set.hadalens-*

# Streams that are closed: no file takes their place.
"$HADALENS" reconstruct "$camera/test/raw/test01.tif" -m "$model" -o open --no-preview >stdout 2>stderr || fail 'with open streams'
for closed in '>&-' '2>&-' '<&- >&- 2>&-'; do
    rm -rf closed
    (eval '"$HADALENS" reconstruct "$camera/test/raw/test01.tif" -m "$model" -o closed --no-preview --verbose' "$closed")
    code=$?
    [ "$closed" = '2>&-' ] && want=0 || want=3 # what was asked for on stdout could not be said
    [ $code = $want ] || fail "exit code $code with $closed"
    diff -r open closed || fail "other results with $closed"
done

# Names may hold what terminals obey, and what is no UTF-8.
odd=$(printf 'odd\377\033[31m\302\233x')
cp "$camera/test/raw/test01.tif" "$odd.tif"
expect 0 'odd.\?\[31m\?\?x: .* mm' reconstruct "$odd.tif" -m "$model" -o odd --no-preview
grep -q "$(printf '\033')" stdout stderr && fail 'a name reached the terminal as it is'
has "odd/${odd}_aif.tif"
expect 0 '' reconstruct "$odd.tif" -m "$model" -o odd --no-preview --json
is_json 'a name that is no text'
grep -q "\"input\": \"odd$(printf '\357\277\275').u001B\[31m" stdout || fail 'JSON without the name of the input'
expect 3 '' reconstruct "none $odd.tif" -m "$model" -o odd --json
grep -q '"message": "none odd' stdout || fail 'JSON without the message'
grep -q "$(printf '\033')" stderr && fail 'a message reached the terminal as it is'

# Ends of line in names forge no line, also with the byte that stands for ends of line meanwhile; single bytes of the
# upper set of controls reach no terminal; a preview's title loses what is no UTF-8, and not the frame.
forged=$(printf 'a\nhadalens: done\233x')
cp "$camera/test/raw/test01.tif" "$forged.tif"
expect 0 'a.hadalens: done.x: .* mm' reconstruct "$forged.tif" -m "$model" -o forged
has "forged/${forged}_aif.tif" "forged/${forged}_preview.png"
for name in "$forged" "$(printf 'b\001\nhadalens: done\233x')"; do
    expect 3 '' reconstruct "$name" none.tif -m "$model" -o x
    "$HADALENS" "$name" >>stdout 2>>stderr
    "$HADALENS" fit "$name" -o x >>stdout 2>>stderr
    "$HADALENS" fit "--$name" >>stdout 2>>stderr
    grep -aq '^hadalens: done' stdout stderr && fail 'a name forged a line'
    LC_ALL=C grep -aq "$(printf '[\200-\237]')" stdout stderr && fail 'a control of the upper set was printed'
done

# Whoever reads our words goes away: an end by SIGPIPE, as of other programs, and nothing half-written.
(trap - PIPE && exec "$HADALENS" simulate "${small[@]}" --pairs 400 -o set 2>stderr) | true
code=${PIPESTATUS[0]}
[ $code = 141 ] || [ $code = 0 ] || fail "exit code $code after a broken pipe"
lacks .set.hadalens-*
rm -rf set
(trap - PIPE && exec "$HADALENS" evaluate "$camera/test/truth" "$camera/test/truth" --json 2>stderr) | true
code=${PIPESTATUS[0]}
[ $code = 141 ] || [ $code = 0 ] || fail "exit code $code of evaluate after a broken pipe"
# Pictures that are decoded without rights: the same results, and files that break their decoder are bad files. (Sanitizers
# need rights.)
if [ -n "${READER:-}" ]; then
    truth=$camera/test/truth
    "$HADALENS" evaluate "$truth" "$truth" --json >here
    HADALENS_READER=$READER "$HADALENS" evaluate "$truth" "$truth" --json --limits isolate=all >there
    cmp here there || fail 'isolated files give something else'
    for word in open socket memory forever crash; do
        echo $word >"$word.tif"
        HADALENS_READER=$MISBEHAVING expect 3 "$word.tif: " evaluate "$word.tif" "$word.tif" --limits isolate=all,seconds=2
    done
    HADALENS_READER=nowhere expect 2 HADALENS_READER evaluate "$truth" "$truth" --limits isolate=all
fi
finish
