#!/usr/bin/env bash
# kill -9 at random moments of every command: afterwards there is the old result or the new one, whole, what is read is
# as it was, and the next run is as a first. kill.sh TIMES [SEED]: so often for each command; ONLY=TARGET: for one
. "$(dirname "$0")/../cli/cli_testing.sh"
times=$1
RANDOM=${2:-1}
small=(--preset sim300 --size 40x48 --window 24x24 --depths 2 --lenses 3 --pairs 3 --channels 1)

# killed POLICY FRESH TARGET COMMAND...: runs the command again and again, ended at random moments of the time that it
# takes. What stands under TARGET (hidden names aside) fits POLICY:
#   whole     it appears at once, with all that is in it, as a whole run leaves it
#   files     each file of it is as a whole run leaves it
#   measured  files of it hold times: each is a whole one of its kind
#   model     it is a model that can be used
#   nothing   the command writes nothing
# FRESH 1: the command wants no old result; else it runs over the old one at times.
killed() {
    local policy=$1 fresh=$2 target=$3 took start
    shift 3
    [ -z "${ONLY:-}" ] || [ "$ONLY" = "$target" ] || [ "$policy" != nothing ] || return 0
    rm -rf "$target" whole
    start=$(date +%s%N)
    "$HADALENS" "$@" >stdout 2>stderr || fail "hadalens $*"
    took=$((($(date +%s%N) - start) / 1000000 + 1))
    [ "$policy" = nothing ] || cp -r "$target" whole
    [ -z "${ONLY:-}" ] || [ "$ONLY" = "$target" ] || return 0
    for _ in $(seq "$times"); do
        { [ "$fresh" = 1 ] || [ $((RANDOM % 2)) = 0 ]; } && [ "$policy" != nothing ] && rm -rf "$target"
        "$HADALENS" "$@" >stdout 2>stderr &
        sleep "$(printf '%d.%03d' $((RANDOM % took / 1000)) $((RANDOM % took % 1000)))"
        kill -9 $! 2>/dev/null
        wait $! 2>/dev/null
        [ "$policy" = nothing ] || [ ! -e "$target" ] || "fits_$policy" "$target" ||
            fail "half a result after kill -9: hadalens $*"
    done
    [ "$policy" = nothing ] || rm -rf "$target"
    "$HADALENS" "$@" >stdout 2>stderr || fail "the next run: hadalens $*"
    case $policy in
    nothing) ;;
    measured) diff <(cd whole && find . | sort) <(cd "$target" && find . | sort) >/dev/null ||
        fail "the next run leaves other files: hadalens $*" ;;
    *) diff -r whole "$target" >/dev/null || fail "the next run gives something else: hadalens $*" ;;
    esac
    rm -rf whole
}

fits_whole() { diff -r whole "$1" >/dev/null; }

fits_files() {
    local file
    while read -r file; do
        cmp -s "$1/$file" "whole/$file" || return 1
    done < <(cd "$1" && find . -type f ! -name '.*')
}

# Whole by form: JSON and SVG that end, tables whose rows have as many columns as their heads.
fits_measured() {
    python3 - "$1" <<'PYTHON'
import csv, json, pathlib, sys, xml.dom.minidom
for path in pathlib.Path(sys.argv[1]).rglob("[!.]*"):
    if not path.is_file():
        continue
    if path.suffix == ".bin": # magic, length, checksum, and what the driver gave
        data = path.read_bytes()
        assert data[:8] == b"HADABIN1" and int.from_bytes(data[8:16], "little") == len(data) - 24, path
        continue
    text = path.read_text()
    if path.suffix == ".json":
        json.loads(text)
    elif path.suffix == ".svg":
        xml.dom.minidom.parseString(text)
    elif path.suffix == ".csv":
        rows = list(csv.reader(text.splitlines()))
        assert rows and all(len(row) == len(rows[0]) for row in rows), path
PYTHON
}

# Training writes the best model so far, which may be an earlier one; that is fine.
fits_model() { "$HADALENS" reconstruct data/test/raw/test01.tif -m "$1" -o served --no-preview -q >stdout 2>stderr; }

# A tuning file: rows, each whole; those of others stay.
fits_rows() { ! grep -Evq '^(fft|conv) [a-z*]+ [0-9x/+:>*]+ [a-z0-9]+( [a-z]+=[0-9]+)*$' "$1"; }

killed whole 1 set simulate "${small[@]}" --test 1 -o set
"$HADALENS" simulate "${small[@]}" --test 1 -o data >stdout 2>stderr
killed whole 0 a.model fit data -o a.model --refine 0 --no-leave-one-out
"$HADALENS" fit data -o b.model --refine 0 --no-leave-one-out >stdout 2>stderr
killed whole 0 psf.model fit --psf data/psf.tif --distances 100,600 -o psf.model
killed whole 1 registered register data --rotation 3 -o registered
killed files 0 pictures reconstruct data/test/raw/test01.tif -m b.model -o pictures --refine 0 --no-preview
"$HADALENS" reconstruct data/test/raw/test01.tif -m b.model -o seen --refine 0 --no-preview >stdout 2>stderr
killed files 0 design optics data/camera.json -o design
killed measured 0 kernels devices --save-binaries kernels
killed model 0 trained.model train data -m b.model -o trained.model --steps 3 --hold-out 1 --restart
killed measured 0 speed bench -m b.model data/test/raw/test01.tif --quick --no-start --no-sweep -o speed
before=$(find data seen b.model -type f -exec cksum {} + | sort)
killed nothing 0 evaluated evaluate seen data/test/truth
killed nothing 0 listed devices
[ "$before" = "$(find data seen b.model -type f -exec cksum {} + | sort)" ] || fail 'what is read was changed'

# Rows of others outlast each moment.
printf 'fft gpu 15x14 clfft\n' >tuning
for _ in $(seq "$times"); do
    "$HADALENS" tune -o tuning --size 15x14 --rounds 1 >stdout 2>stderr &
    sleep "0.$((RANDOM % 900 + 100))"
    kill -9 $! 2>/dev/null
    wait $! 2>/dev/null
    fits_rows tuning || fail "half a tuning file: $(cat tuning)"
    grep -q '^fft gpu 15x14 clfft$' tuning || fail "the rows of others went: $(cat tuning)"
done
expect 0 '' tune -o tuning --size 15x14 --rounds 1
find . -name '.*.hadalens-*' -prune -exec rm -r {} + # of those that were killed
finish
