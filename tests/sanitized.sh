#!/usr/bin/env bash
# Runs a program of a sanitizer's build: sanitized.sh PROGRAM [ARGUMENT...]
# One finding says nothing of the program, which is then run again, three times at most: the search for leaks at the end
# crashed itself, where a thread of a driver was about to begin or to end ("Tracer caught signal 11").
# Whatever else is found ends here at once, with the program's own exit code.
set -uo pipefail
said=$(mktemp)
trap 'rm -f "$said"' EXIT
for _ in 1 2 3 4; do
    "$@" 2>&1 | tee "$said"
    code=${PIPESTATUS[0]}
    [ "$code" != 0 ] && grep -q 'LeakSanitizer has encountered a fatal error' "$said" || break
    echo "sanitized.sh: the search for leaks crashed; once more"
done
exit "$code"
