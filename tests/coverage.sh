#!/usr/bin/env bash
# coverage.sh [readers|all] [--go-on] [FOLDER]: which share of lines and branches is reached, for each room of lib.
# readers: of what reads and writes files, by the corpora, the tests of files, and every fault of the stages for files;
# all, the default: of everything, by unit tests, corpora, commands, and a fault at every call site of every stage, which
# takes an hour on two cores. It goes by parts; --go-on leaves out those whose counts an interrupted run of the same build has
# left. Builds in FOLDER (build/coverage), compared and printed by coverage.py (with --missed that prints what was not
# reached). Fails where a part fails, or branches are below an aim.
set -euo pipefail
cd "$(dirname "$0")/.."
form=all build=build/coverage going_on=0
for word in "$@"; do
    case $word in
    readers | all) form=$word ;;
    --go-on) going_on=1 ;;
    -*) sed -n '2s/^# *//p' "$0" >&2 && exit 2 ;;
    *) build=$word ;;
    esac
done
command -v gcov >/dev/null || { echo "gcov is missing (it comes with gcc)"; exit 77; }
cmake -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Debug -DHADALENS_TESTS=ON -DCMAKE_C_FLAGS='--coverage -O0' >/dev/null
build=$(realpath "$build")
if [ "$form" = readers ]; then
    files=(test_output test_folders test_hostile test_hostile_text test_text test_tiff_golden test_tiff_forms test_tiff_bones
        test_tiff_write test_safetensors test_model_file test_model_refusals test_model_enhance test_net_list test_dataset
        test_response test_tuning test_fit_sums)
    units="^($(IFS='|' && echo "${files[*]}"))\$" commands=''
    cmake --build "$build" --target fuzz_replay unit unit_faults >"$build/build.log"
    stages=(model_file: tiff: files: preview: psf:memory net:memory net:file fit:memory fit:file) runs=all
    rooms=(io model dataset netlist)
else
    # not what holds arithmetic (check_), measures times, or takes minutes for lines that others reach as well
    left_out='faults|profile|hostile_text|pursuit_hard|classic|fit_refine|train_discriminator|register|optics_occlusion'
    units='^test_' commands='^cli_(make|words|simulate|evaluate|fit|forward)$'
    cmake --build "$build" >"$build/build.log"
    stages=() runs=sites rooms=()
    while read -r stage; do
        stages+=("$stage:memory" "$stage:opencl" "$stage:map" "$stage:file")
    done < <(sed -n 's/^ *{"\([a-z_ ]*\)", fault_stage_.*/\1/p' tests/faults/test_faults.c)
    for folder in lib/*/; do
        [ "$folder" = lib/include/ ] || rooms+=("$(basename "$folder")")
    done
fi
# counts go with a build: others are of no use
state="$form $(find "$build/CMakeFiles/hadalens_objects.dir" -name '*.gcno' -exec cksum {} + | sort | cksum)"
if [ $going_on = 0 ] || [ "$(cat "$build/coverage.state" 2>/dev/null)" != "$state" ]; then
    find "$build" -name '*.gcda' -delete
    rm -f "$build/coverage.done"
    echo "$state" >"$build/coverage.state"
fi
touch "$build/coverage.done"
: >"$build/coverage.failed"

# What a part does, as a program of its own, so that several run at once: part NAME COMMAND...
part() {
    local name=$1 log
    shift
    ! grep -qxF "$name" "$build/coverage.done" || return 0
    log=$build/coverage-${name//[: ]/-}.log
    if "$@" >"$log" 2>&1; then
        echo "$name" >>"$build/coverage.done"
    else
        echo "$name" >>"$build/coverage.failed"
        printf 'part %s failed, %s:\n' "$name" "$log"
        tail -n 5 "$log"
    fi
}
export -f part
export build FAULT_RUNS=$runs HADALENS_CACHE=off POCL_CACHE_DIR=$build/pocl-cache
tests() { # NAME REGEX
    [ -z "$2" ] || part "$1" env -u HADALENS_CACHE ctest --test-dir "$build" --timeout 3000 -j "$(nproc)" --output-on-failure \
        -R "$2" -E "^test_(${left_out:-none})\$"
}
tests corpora '^fuzz_'
tests units "$units"
tests commands "$commands"
printf '%s\n' "${stages[@]}" | xargs -P "$(nproc)" -I STAGE \
    bash -c 'FAULT_ONLY=$1 part "$1" "$build/tests/faults/unit_faults" faults' part STAGE
failed=0
[ ! -s "$build/coverage.failed" ] || failed=1
python3 tests/coverage.py . "$build/CMakeFiles/hadalens_objects.dir/lib" "${rooms[@]}" || failed=1
exit $failed
