#!/usr/bin/env bash
# Builds and runs tests on a fresh Debian or Ubuntu machine; installs missing packages.
#   tests/run.sh [all|quick|full|long|oracle|stress|python|mpi|devices] [release|debug|clang|asan|asan-clang|tsan|tsan-clang] [further arguments for ctest]
#   tests/run.sh fuzz [MINUTES]: libFuzzer (clang) makes inputs for each target, for so many minutes (1)
# all, the default: all tiers except devices and long; tests are skipped where their environment cannot be made. README.md explains
# the tiers. oracle and python make Python environments in build/oracle and build/python; devices installs other OpenCL
# implementations (tests/devices; DEVICES_FORM=brief takes only small shapes). TARGETS: the targets to build, if not all
# (unit_tests builds what test_... and fuzz_... run).
set -euo pipefail
cd "$(dirname "$0")/.."
tier=all
preset=release
while [ $# -gt 0 ]; do
    case $1 in
    all | quick | full | long | oracle | stress | python | mpi | devices) tier=$1 ;;
    fuzz) exec tests/fuzz/run.sh "${2:-1}" ;;
    release | debug | clang | asan | asan-clang | tsan | tsan-clang) preset=$1 ;;
    *) break ;;
    esac
    shift
done

source examples/install.sh
hadalens_install tests
case $tier in
oracle) tests/oracle/environment.sh build/oracle ;;
devices) tests/devices/environment.sh build/devices ;;
python) tests/python/environment.sh build/python ;;
mpi) hadalens_install mpi ;;
all)
    tests/oracle/environment.sh build/oracle || echo "No environment for oracles: they are skipped."
    tests/python/environment.sh build/python || echo "No environment for Python: the package is not tested."
    hadalens_install mpi || echo "No MPI: hadalens-mpi is not built."
    ;;
esac
case $tier in
full | all) tests/budget/environment.sh build/budget || echo "No tools for kernel budgets: they are skipped." ;;
esac
cmake --preset "$preset" -DHADALENS_TESTS=ON -DHADALENS_WERROR=ON >/dev/null
read -ra targets <<<"${TARGETS:-all}"
cmake --build "build/$preset" --target "${targets[@]}"

label=(-L "^$tier\$")
[ "$tier" != all ] || label=(-LE '^(devices|long)$')
# tests that measure time run alone; running kernels use all cores, compiling them uses one
ctest --test-dir "build/$preset" --output-on-failure --no-tests=error -j "$(((($(nproc) + 1) / 2) + 1))" "${label[@]}" "$@"
