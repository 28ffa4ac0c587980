#!/usr/bin/env bash
# Builds and runs all tests on a fresh Debian or Ubuntu machine, installing what is missing.
#   tests/run.sh [asan|tsan|debug|release] [further arguments for ctest]
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-release}
[ $# -gt 0 ] && shift
source examples/install.sh
hadalens_install tests
cmake --preset "$preset" -DHADALENS_TESTS=ON -DHADALENS_WERROR=ON >/dev/null
cmake --build "build/$preset"
# one test at a time on small machines: the kernels use all cores themselves
ctest --test-dir "build/$preset" --output-on-failure --no-tests=error -j "$(( ($(nproc) + 3) / 4 ))" "$@"
