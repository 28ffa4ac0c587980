#!/usr/bin/env bash
# Several queues and devices, sequences that stream, and signals in the midst of them.
. "$(dirname "$0")/cli_testing.sh"
raw="$camera/test/raw"
same() { for part in stack aif depth; do same_results "$1_$part.tif" "$2_$part.tif" || fail "$1 and $2 differ"; done; }

"$FRAME_TOOL" pages "$raw/test01.tif" sequence.tif 7
for refine in 0 auto; do
    expect 0 'sequence: 7 frames' reconstruct sequence.tif "$raw"/*.tif -m "$model" -o one --refine "$refine"
    expect 0 'sequence: 7 frames' reconstruct sequence.tif "$raw"/*.tif -m "$model" -o two --refine "$refine" --queues 2
    for name in sequence test01 test02; do same "one/$name" "two/$name"; done
    # two contexts on one device: wherever the tests run
    expect 0 '"devices": ' reconstruct sequence.tif "$raw"/*.tif -m "$model" -o both --refine "$refine" \
        --device 0,0 --json
    is_json 'two devices'
    for name in sequence test01 test02; do same "one/$name" "both/$name"; done
done
if "$HADALENS" devices --json | grep -q '"max_sub_devices": 0'; then
    expect 5 'cannot be divided into 2 parts' reconstruct "$raw/test01.tif" -m "$model" -o half --device 0/2
elif [ "$(nproc)" -ge 2 ]; then
    expect 0 '"part"' reconstruct sequence.tif "$raw"/*.tif -m "$model" -o half --refine auto --device 0/2 --queues 2 --json
    for name in sequence test01 test02; do same "one/$name" "half/$name"; done
    expect 0 '' reconstruct "$raw/test01.tif" -m "$model" -o half --device 0:2/2
fi
expect 5 'cannot be divided into 5000 parts' reconstruct "$raw/test01.tif" -m "$model" -o bad --device 0:1/5000
expect 5 'no part of a device' reconstruct "$raw/test01.tif" -m "$model" -o bad --device 0:3/2
expect 5 'no device matches' reconstruct "$raw/test01.tif" -m "$model" -o bad --device 0,nosuch
expect 2 'number of parts' reconstruct "$raw/test01.tif" -m "$model" -o bad --device 0/0
expect 2 '1 to 64' reconstruct "$raw/test01.tif" -m "$model" -o bad --queues 65
[ ! -e bad ] || files bad 0

# A bad file between good ones, a bad frame within a sequence: the others are whole.
head -c 20000 sequence.tif >cut.tif
"$FRAME_TOOL" nan "$raw/test01.tif" nan.tif 5
expect 1 '2 of 4 files failed' reconstruct "$raw/test01.tif" cut.tif nan.tif "$raw/test02.tif" -m "$model" -o some \
    --queues 2
files some 8
for name in test01 test02; do same "one/$name" "some/$name"; done

# Signals: the exit code that tells it, and nothing half-written. How soon: cli_signals.sh.
"$FRAME_TOOL" pages "$raw/test01.tif" long.tif 4000
for signal in INT TERM; do
    rm -rf stopped
    "$HADALENS" reconstruct "$raw/test01.tif" long.tif -m "$model" -o stopped --queues 2 --refine 60 >stdout 2>stderr &
    process=$!
    until { [ -e stopped/test01_preview.png ] && grep -q test01 stdout; } || ! kill -0 "$process"; do sleep 0.05; done
    sleep 0.5
    kill -"$signal" "$process"
    wait "$process"
    code=$?
    [ "$code" = 130 ] || fail "exit code $code after SIG$signal"
    grep -q stopped stderr || fail "nothing said about SIG$signal"
    files stopped 4
done
finish
