#!/usr/bin/env bash
# coverage.sh [readers|all] [FOLDER]: which share of lines and branches is reached, for each room of lib. readers: of what
# reads and writes files, by the corpora, the tests of files, and faults; all, the default: of everything, by all tests.
# Builds in FOLDER (build/coverage). Fails where a room is below its aim.
set -euo pipefail
cd "$(dirname "$0")/.."
form=all
case ${1:-} in readers | all) form=$1 && shift ;; esac
build=${1:-build/coverage}
command -v gcov >/dev/null || { echo "gcov is missing (it comes with gcc)"; exit 77; }
cmake -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Debug -DHADALENS_TESTS=ON -DCMAKE_C_FLAGS='--coverage -O0' >/dev/null
files=(test_output test_hostile test_text test_tiff_golden test_tiff_write test_safetensors test_model_file
    test_model_enhance test_net_list test_dataset test_response test_tuning)
if [ "$form" = readers ]; then
    cmake --build "$build" --target fuzz_replay test_faults fault_commands "${files[@]}" >"$build/build.log"
    chosen="^(fuzz_.*|test_faults|fault_commands|$(IFS='|' && echo "${files[*]}"))\$"
    rooms=(io model dataset netlist core)
else
    cmake --build "$build" >"$build/build.log"
    chosen='^(test_|fuzz_|fault_|check_|cli_|soak)' # what measures times, or builds anew, is no test of this build
    rooms=()
    for folder in lib/*/; do
        [ "$folder" = lib/include/ ] || rooms+=("$(basename "$folder")")
    done
fi
find "$build" -name '*.gcda' -delete
ctest --test-dir "$build" --timeout 3000 -R "$chosen" >"$build/coverage.log" || tail -n 20 "$build/coverage.log"

# Aims, in percent of branches: what reads bytes of others, and all else.
aim_of() { case $1 in io | model | dataset) echo 90 ;; *) echo 80 ;; esac; }
objects=$build/CMakeFiles/hadalens_objects.dir/lib
below=0
for room in "${rooms[@]}"; do
    gcov -b -n "$objects/$room"/*.gcda 2>/dev/null | awk -v room="lib/$room" -v aim="$(aim_of "$room")" '
        /^File/ { keep = index($0, room "/") }
        keep && /^Lines executed/ { split($0, p, /[:%]| of /); lines += p[4]; hit += p[2] / 100 * p[4] }
        keep && /^Branches executed/ { split($0, p, /[:%]| of /); all += p[4] }
        keep && /^Taken at least once/ { split($0, p, /[:%]| of /); taken += p[2] / 100 * p[4] }
        /^Calls executed|^No calls/ { keep = 0 } # the sum over all files comes last, without a name
        END {
            share = all ? 100 * taken / all : 100
            printf "%-14s lines %5.1f %% of %5d, branches %5.1f %% of %5d%s\n", room, lines ? 100 * hit / lines : 0, lines,
                   share, all, share < aim ? ", below " aim " %" : ""
            exit share < aim
        }' || below=1
done
exit $below
