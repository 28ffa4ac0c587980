#!/usr/bin/env bash
# Runs a program of a sanitizer's build: sanitized.sh PROGRAM [ARGUMENT...]
# Two findings say nothing of the program, which is then run again, three times at most:
# - The search for leaks at the end crashed itself, where a thread of a driver was about to begin or to end ("Tracer caught
#   signal 11").
# - PoCL loses its compiler's memory (LLVM's), wherever it had to compile a kernel; in the next run it finds that kernel.
# Whatever else is found ends here at once, with the program's own exit code.
set -uo pipefail
said=$(mktemp)
trap 'rm -f "$said"' EXIT
for _ in 1 2 3 4; do
    "$@" 2>&1 | tee "$said"
    code=${PIPESTATUS[0]}
    [ "$code" != 0 ] || break
    if grep -q 'LeakSanitizer has encountered a fatal error' "$said"; then
        echo "sanitized.sh: the search for leaks crashed; once more"
    elif grep -q 'LeakSanitizer: detected memory leaks' "$said" && grep -q 'libLLVM' "$said"; then
        echo "sanitized.sh: a kernel was compiled, whose compiler leaks; once more"
    else
        break
    fi
done
exit "$code"
