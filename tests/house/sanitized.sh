#!/usr/bin/env bash
# tests/sanitized.sh runs a program again where the search for leaks itself crashed, and for nothing else.
set -eu
run=$1/tests/sanitized.sh work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/program" <<'END'
#!/bin/sh
echo x >>"$1" # one letter a run
[ "$(wc -l <"$1")" -ge "$2" ] && exit "$3"
echo "$4" >&2
exit 99
END
chmod +x "$work/program"
leaks='ERROR: LeakSanitizer: detected memory leaks'
crash='LeakSanitizer has encountered a fatal error.'
expect() { # NAME RUNS CODE, of a program that: succeeds in which run, with which code, says what before
    code=0
    "$run" "$work/program" "$work/$1" "$4" "$5" "$6" >/dev/null 2>&1 || code=$?
    [ "$(wc -l <"$work/$1")" = "$2" ] && [ "$code" = "$3" ] ||
        { echo "$1: $(wc -l <"$work/$1") runs, code $code; expected $2 and $3"; exit 1; }
}
expect passes 1 0 1 0 ''
expect fails 1 3 1 3 ''
expect leaks 1 99 9 0 "$leaks"
expect crashes_once 2 0 2 0 "$crash"
expect crashes_then_fails 2 3 2 3 "$crash"
expect crashes_always 4 99 9 0 "$crash"

# What tests/leaks.txt leaves out: memory of C++, which our own code has none of; a leak of C is reported.
cat >"$work/leak.c" <<'END'
#include <stdlib.h>
#ifdef __cplusplus
int main(void) { return *new int(0); }
#else
int main(void) { return malloc(10) == NULL; }
#endif
END
export LSAN_OPTIONS="suppressions=$1/tests/leaks.txt:print_suppressions=0" ASAN_OPTIONS=exitcode=99
told() { # LANGUAGE CODE LIBRARY
    gcc -x "$1" -fsanitize=address "$work/leak.c" -o "$work/leak" ${3:+"$3"} 2>/dev/null || return 0
    code=0
    "$run" "$work/leak" >"$work/said" 2>&1 || code=$?
    ! grep -q "$crash" "$work/said" || return 0 # where processes may not be traced
    [ "$code" = "$2" ] || { echo "a leak of $1: code $code; expected $2"; exit 1; }
}
told c 99 ''
told c++ 0 -lstdc++
