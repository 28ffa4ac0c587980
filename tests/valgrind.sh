#!/usr/bin/env bash
# valgrind.sh BUILD [GROUP...]: runs the unit tests of BUILD, or these groups of them (fit of test_fit.c), under memcheck. It
# finds memory that is read before it is written, which no sanitizer sees beside a driver that is not instrumented. What
# other libraries do is in valgrind.supp, each with a reason.
set -euo pipefail
build=$(realpath "$1")
shift
cd "$(dirname "$0")/.."
unit=$build/tests/unit
[ $# -gt 0 ] || set -- $("$unit" --list)
# Valgrind's CPU is another one (of AVX2 at most), for which PoCL would compile each kernel under Valgrind, in minutes. So
# each test runs by itself first, for that CPU, and leaves its kernels in a cache of their own, which is kept.
export POCL_CACHE_DIR=$build/valgrind-pocl-cache HADALENS_CACHE=off
mkdir -p "$POCL_CACHE_DIR"
! grep -qw avx2 /proc/cpuinfo || export POCL_KERNELLIB_NAME=avx2 POCL_LLVM_CPU_NAME=haswell
failed=0
for name in "$@"; do
    log=$build/valgrind-$name.log
    code=0
    "$unit" "$name" >"$log" 2>&1 || code=$?
    [ $code != 0 ] || valgrind -q --error-exitcode=99 --num-callers=30 --suppressions=tests/valgrind.supp \
        "$unit" "$name" >"$log" 2>&1 || code=$?
    printf '%-28s %s\n' "$name" "$([ $code = 0 ] && echo fine || echo "code $code, $log")"
    [ $code = 0 ] || failed=1
done
exit $failed
