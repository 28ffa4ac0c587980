#!/bin/sh
# Each folder has a README of one screen; no file is longer than a person reads in one sitting.
set -eu
cd "$1"
status=0
for folder in lib lib/*/ kernels bindings bindings/*/ examples tests tests/*/ perf docs; do
    case "$folder" in lib/include/) continue ;; esac
    [ -f "$folder/README.md" ] || { echo "$folder has no README.md"; status=1; continue; }
    lines=$(wc -l <"$folder/README.md")
    [ "$lines" -le 60 ] || { echo "$folder/README.md has $lines lines: one screen, please"; status=1; }
done
for file in $(find lib kernels bindings examples tests perf -name '*.c' -o -name '*.h' -o -name '*.cl'); do
    lines=$(wc -l <"$file")
    [ "$lines" -le 500 ] || { echo "$file has $lines lines: split it"; status=1; }
done
exit $status
