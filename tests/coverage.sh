#!/usr/bin/env bash
# coverage.sh [readers|all] [FOLDER]: which share of lines and branches is reached, for each room of lib. readers: of what
# reads and writes files, by the corpora, the tests of files, and every fault of the stages for files; all, the default: of
# everything, by unit tests, corpora, commands, and a fault at every call site of every stage. Builds in FOLDER
# (build/coverage). Fails where branches are below an aim (coverage.py; with --missed that tells what was not reached).
set -euo pipefail
cd "$(dirname "$0")/.."
form=all
case ${1:-} in readers | all) form=$1 && shift ;; esac
build=${1:-build/coverage}
command -v gcov >/dev/null || { echo "gcov is missing (it comes with gcc)"; exit 77; }
cmake -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Debug -DHADALENS_TESTS=ON -DCMAKE_C_FLAGS='--coverage -O0' >/dev/null
files=(test_output test_folders test_hostile test_hostile_text test_text test_tiff_golden test_tiff_forms test_tiff_bones
    test_tiff_write test_safetensors test_model_file test_model_refusals test_model_enhance test_net_list test_dataset
    test_response test_tuning test_fit_sums)
stages=(model_file: tiff: files: preview: psf:memory net:memory net:file fit:memory fit:file)
if [ "$form" = readers ]; then
    cmake --build "$build" --target fuzz_replay test_faults "${files[@]}" >"$build/build.log"
    chosen="^(fuzz_.*|$(IFS='|' && echo "${files[*]}"))\$"
    rooms=(io model dataset netlist)
else
    cmake --build "$build" >"$build/build.log"
    # not what holds arithmetic (check_), measures times, or takes minutes for lines that others reach as well
    chosen='^(test_|fuzz_|cli_(make|words|simulate|evaluate|fit|forward)$)'
    rooms=()
    for folder in lib/*/; do
        [ "$folder" = lib/include/ ] || rooms+=("$(basename "$folder")")
    done
fi
find "$build" -name '*.gcda' -delete
ctest --test-dir "$build" --timeout 3000 -j "$(nproc)" -R "$chosen" -E '^test_(faults|profile)$' >"$build/coverage.log" || tail -n 20 "$build/coverage.log"
runs=all
[ "$form" = readers ] || { stages=("") && runs=sites; }
for stage in "${stages[@]}"; do
    FAULT_RUNS=$runs FAULT_ONLY=$stage POCL_CACHE_DIR=$PWD/$build/pocl-cache HADALENS_CACHE=off \
        "$build/tests/faults/test_faults" >>"$build/coverage.log" 2>&1 || tail -n 5 "$build/coverage.log"
done
python3 tests/coverage.py . "$build/CMakeFiles/hadalens_objects.dir/lib" "${rooms[@]}"
