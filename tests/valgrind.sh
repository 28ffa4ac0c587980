#!/usr/bin/env bash
# valgrind.sh BUILD [TEST...]: the unit tests of BUILD (or these) under memcheck: what is read without having been written,
# which no sanitizer sees beside a driver that is not instrumented. What others do is in valgrind.supp, each with a reason.
set -euo pipefail
build=$(realpath "$1")
shift
cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- $(cd "$build/tests" && ls -d test_* | grep -v '_tests')
export POCL_CACHE_DIR=$build/pocl-cache HADALENS_CACHE=off
failed=0
for name in "$@"; do
    log=$build/valgrind-$name.log
    code=0
    valgrind -q --error-exitcode=99 --num-callers=30 --suppressions=tests/valgrind.supp \
        "$build/tests/$name" >"$log" 2>&1 || code=$?
    printf '%-28s %s\n' "$name" "$([ $code = 0 ] && echo fine || echo "code $code, $log")"
    [ $code = 0 ] || failed=1
done
exit $failed
