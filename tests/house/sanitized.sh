#!/usr/bin/env bash
# tests/sanitized.sh runs a program again where the search for leaks itself crashed or a driver compiled a kernel, and for
# nothing else.
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
expect compiles 2 0 2 0 "$leaks
#1 libLLVM-15.so.1"
expect compiles_then_leaks 2 99 2 99 "$leaks
#1 libLLVM-15.so.1"
expect compiles_and_fails 1 99 9 0 'AddressSanitizer: heap-buffer-overflow libLLVM-15.so.1'
expect crashes_once 2 0 2 0 "$crash"
expect crashes_then_fails 2 3 2 3 "$crash"
expect crashes_always 4 99 9 0 "$crash"
