#!/bin/sh
# What a library must not do: leave the process, print, change locale or environment.
set -eu
cd "$1"
if grep -rnE '\b(exit|_exit|abort|printf|puts|perror|setlocale|setenv|putenv|unsetenv|assert) ?\(' lib --include='*.c' |
    grep -vE '(snprintf|vsnprintf|XMLprintf|TIFFPrint)'; then
    echo "the library returns errors as values and leaves the process alone"
    exit 1
fi
# C99's inline without static defines no symbol that a program could be linked to
if grep -nE '\binline\b' kernels/* | grep -v 'static inline'; then
    echo "an inline function of a kernel file is 'static inline': other compilers leave the symbol undefined"
    exit 1
fi
