#!/usr/bin/env bash
# Builds and runs tests on a fresh Debian or Ubuntu machine, installing what is missing.
#   tests/run.sh [all|quick|full|oracle|stress|python|mpi|devices] [release|debug|clang|asan|asan-clang|tsan|tsan-clang] [further arguments for ctest]
#   tests/run.sh fuzz [MINUTES]: libFuzzer (clang) makes inputs, so many minutes (1) for each target
# devices: by other implementations of OpenCL (tests/devices), which are brought; DEVICES_FORM=brief: small shapes alone.
# quick: within two minutes on two cores, once kernels are compiled. oracle: against PyTorch, SciPy and others, in a
# Python environment that is made in build/oracle. python: the Python package, built and installed into an environment
# in build/python. mpi: the program that ranks share, on one machine. all, the default: everything; what needs an environment is skipped where it cannot be made. README.md
# tells the tiers. TARGETS: what is built, where that is not all (unit_tests: what test_... and fuzz_... run).
set -euo pipefail
cd "$(dirname "$0")/.."
tier=all
preset=release
while [ $# -gt 0 ]; do
    case $1 in
    all | quick | full | oracle | stress | python | mpi | devices) tier=$1 ;;
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
    tests/oracle/environment.sh build/oracle || echo "Without their environment, oracles are skipped."
    tests/python/environment.sh build/python || echo "Without its environment, the Python package is not tested."
    hadalens_install mpi || echo "Without MPI, hadalens-mpi is not built."
    ;;
esac
case $tier in
full | all) tests/budget/environment.sh build/budget || echo "Without their tools, the budgets of kernels are skipped." ;;
esac
cmake --preset "$preset" -DHADALENS_TESTS=ON -DHADALENS_WERROR=ON >/dev/null
read -ra targets <<<"${TARGETS:-all}"
cmake --build "build/$preset" --target "${targets[@]}"

label=(-L "^$tier\$")
[ "$tier" != all ] || label=(-LE '^devices$')
# tests that measure run alone; kernels use all cores themselves, compiling them does not
ctest --test-dir "build/$preset" --output-on-failure --no-tests=error -j "$(((($(nproc) + 1) / 2) + 1))" "${label[@]}" "$@"
