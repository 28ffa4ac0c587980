#!/usr/bin/env bash
# coverage.sh [FOLDER]: which share of lines and branches of lib/io, lib/model, lib/dataset, lib/netlist and the files of
# lib/core that read and write is reached by the replayed corpora and the tests of files. Builds in FOLDER (build/coverage).
set -euo pipefail
cd "$(dirname "$0")/../.."
build=${1:-build/coverage}
command -v gcov >/dev/null || { echo "gcov is missing (it comes with gcc)"; exit 77; }
cmake -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Debug -DHADALENS_TESTS=ON -DCMAKE_C_FLAGS='--coverage -O0' >/dev/null
tests='test_(output|hostile|text|tiff_golden|tiff_write|safetensors|model_file|net_list)'
cmake --build "$build" --target fuzz_replay $(printf 'test_%s ' output hostile text tiff_golden tiff_write safetensors \
    model_file net_list)
find "$build" -name '*.gcda' -delete
ctest --test-dir "$build" -R "^(fuzz_.*|$tests)\$" >"$build/coverage.log"
objects=$build/CMakeFiles/hadalens_objects.dir/lib
for folder in io model dataset netlist core; do
    gcov -b -n "$objects/$folder"/*.gcda 2>/dev/null | awk -v folder="lib/$folder" '
        /^File/ { keep = index($0, folder "/") }
        keep && /^Lines executed/ { split($0, p, /[:%]| of /); lines += p[4]; hit += p[2] / 100 * p[4] }
        keep && /^Branches executed/ { split($0, p, /[:%]| of /); all += p[4] }
        keep && /^Taken at least once/ { split($0, p, /[:%]| of /); taken += p[2] / 100 * p[4] }
        /^Calls executed|^No calls/ { keep = 0 } # the sum over all files comes last, without a name
        END { printf "%-12s lines %5.1f %% of %d, branches %5.1f %% of %d\n", folder, lines ? 100 * hit / lines : 0, lines,
                     all ? 100 * taken / all : 0, all }'
done
