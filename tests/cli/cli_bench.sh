#!/usr/bin/env bash
# Bench: tables, files, figures and comparisons, on the small camera.
. "$(dirname "$0")/cli_testing.sh"
raws=("$camera"/test/raw/*.tif)
mkdir scratch
export TMPDIR=$PWD/scratch # nobody else's

# Words.
expect 2 'frame without its camera; add -m' bench frame.tif
expect 2 'one or more raw frames' bench -m "$model"
expect 2 "no workload 'nosuch'; there are sim300, sim512, paper2022" bench --workload nosuch
expect 2 'takes two files.*OLD.json NEW.json' bench --compare one.json
expect 2 'needs -m MODEL and one frame' bench --first-frame -m "$model"
expect 2 'rounds takes 1 to 200' bench --rounds 201
expect 2 'net-size is of a net' bench --net-size 64x64
expect 2 'sequence simulates films' bench --sequence -m "$model" "${raws[0]}"
expect 2 'nosuch' bench -m "$model" "${raws[0]}" --net nosuch --device 0
expect 2 'not a list of devices' bench --device 0,,1 --quick
expect 5 'no device' bench --device nosuchdevice --quick
expect 3 'missing.model' bench -m missing.model "${raws[0]}" -o out --device 0
expect 3 'missing.tif' bench -m "$model" missing.tif --device 0
lacks out/bench.json

# A camera of one's own.
expect 0 'at best.*Latency of a frame.*stage by stage.*Many frames.*Memory.*From nothing.*floor.*no other beats' \
    bench -m "$model" "${raws[@]}" -o out --quick --device 0
has out/bench.json out/bench.csv out/latency.svg out/roofline-camera.model.svg out/time-error-camera.model.svg
files out 5
# Every device is in it, and every part.
columns='device,workload,group,name,unit,median,q1,q3,count,error_l2,bound_l2,psnr_db,psnr_in_focus_db,front,bytes,flops'
[ "$(head -n 1 out/bench.csv)" = "$columns" ] || fail "columns: $(head -n 1 out/bench.csv)"
for group in peak start latency stage kernel calls memory throughput sweep; do
    grep -q "camera.model,$group,\|,,$group," out/bench.csv || fail "no row of $group"
done
if command -v python3 >/dev/null; then
    python3 "$(dirname "$0")/../../perf/estimate.py" out/bench.json --device h100 | grep -q 'camera.model, refined.*ms' ||
        fail "perf/estimate.py"
    python3 - out <<'PYTHON' || fail "the files of bench"
import csv, json, sys, glob, xml.dom.minidom
folder = sys.argv[1]
rows = list(csv.DictReader(open(folder + '/bench.csv')))
document = json.load(open(folder + '/bench.json'))
assert document['format'] == 'hadalens bench 1' and len(document['devices']) == 1
assert len(rows) == len(document['rows']) > 50
for a, b in zip(rows, document['rows']):
    assert None not in a and None not in a.values(), a
    assert a['name'] == b['name'] and abs(float(a['median']) - b['median']) <= 1e-6 * abs(b['median'])
    assert float(a['q1']) <= float(a['median']) <= float(a['q3']), a
of = lambda group: {r['name']: r for r in rows if r['group'] == group}
latency, stage, kernel, sweep, memory = map(of, ('latency', 'stage', 'kernel', 'sweep', 'memory'))
depths = 3
assert abs(float(latency['linear, frame']['median']) / depths / float(latency['linear, depth']['median']) - 1) < 1e-6
assert float(stage['linear, linear']['median']) > 0 and float(stage['linear, refine']['median']) == 0
assert float(stage['refined, refine']['median']) > 0 and float(stage['refined, linear']['median']) == 0
assert all(float(r['median']) > 0 for r in kernel.values())
assert sum(float(r['bytes']) for r in kernel.values()) > 1e5
stated, held = (float(memory['linear, %s on the device' % w]['median']) for w in ('stated', 'held at most'))
assert 0 < held <= 1.01 * stated, (stated, held)
calls = of('calls')
assert 4 < float(calls['linear, launches']['median']) < float(calls['refined, launches']['median'])
parts = sum(float(calls['refined, of it ' + p]['median']) for p in ('launches', 'waits', 'transfers', 'kernels at the peaks'))
assert abs(parts / float(calls['refined, expected']['median']) - 1) < 1e-5
assert float(calls['refined, waits']['median']) >= 2 and float(calls['refined, to the device']['median']) > 50
assert any(r['front'] == '1' for r in sweep.values())
assert float(sweep['hadamard float, dense']['error_l2']) == 0
assert 0 < float(sweep['hadamard half, dense']['error_l2']) < 1e-2
assert any(n.startswith('refined 8') for n in sweep) and any(n.startswith('matched') for n in sweep)
start = of('start')
assert float(start['linear, cold, whole process']['median']) > float(start['linear, warm, whole process']['median'])
for path in glob.glob(folder + '/*.svg'):
    xml.dom.minidom.parse(path)
PYTHON
elif command -v xmllint >/dev/null; then
    xmllint --noout out/*.svg || fail "SVG that is not XML"
fi

# With a net, whose error is not stated.
expect 0 'Latency of a frame' \
    bench -m "$model" "${raws[@]}" -o net --net compact --net-size 32x32 --quick --rounds 1 --no-start --device 0
for mode in linear refined; do
    awk -F, -v name="\"$mode, enhance\"" '$2 == "camera.model+compact" && $3 == "stage" && index($0, name) { seen = 1 }
        END { exit !seen }' net/bench.csv || fail "no stage 'enhance', $mode"
done
! grep -q ',sweep,' net/bench.csv || fail "a sweep of an untrained net"

# Against itself: all ratios are 1. Against a twice as fast one: better where less is better.
expect 0 '0 better, 0 worse, [0-9]+ within the spread; 0 rows' bench --compare out/bench.json out/bench.json
expect 0 '"summary".*"better": 0' bench --compare out/bench.json out/bench.json --json
is_json 'comparison'
if command -v python3 >/dev/null; then
    python3 - <<'PYTHON'
import json
document = json.load(open('out/bench.json'))
for row in document['rows']:
    row['device'] = 'another'
    if row['unit'] == 'ms':
        for key in ('median', 'q1', 'q3'):
            row[key] = row[key] / 1000
    if row['unit'] == 'frames/s':
        for key in ('median', 'q1', 'q3'):
            row[key] = row[key] / 1000
json.dump(document, open('fast.json', 'w'))
PYTHON
    expect 0 'old: .*new: another.*latency .*linear, frame .* ms +0.001 +better' bench --compare out/bench.json fast.json
    grep -Eq 'throughput .*linear, 1 queue .*0.001 +worse' stdout || fail 'fewer frames a second are worse'
fi
echo '{"format": "other"}' >other.json
expect 3 'other.json is not a bench.json' bench --compare out/bench.json other.json
expect 3 'nothere.json' bench --compare out/bench.json nothere.json
expect 0 'open.*plan.*first frame.*second frame.*close' bench --first-frame -m "$model" "${raws[0]}" --quick
expect 0 '"second frame": [0-9.]+' bench --first-frame -m "$model" "${raws[0]}" --quick --json
is_json 'first frame'

# No files without -o; what is left out is left out.
mkdir empty
cd empty || exit 1
expect 0 'Latency' bench -m "$model" "${raws[0]}" --quick --no-start --no-sweep --device cpu
rm -f stdout stderr
files . 0
cd ..
[ -z "$(find scratch -name 'hadalens-bench-*')" ] || fail 'scratch is left'
finish
