#!/bin/sh
# Each folder has a README of one screen, which names no file that is gone; no file is longer than a person reads in one
# sitting.
set -eu
cd "$1"
status=0
for folder in lib lib/*/ kernels bindings bindings/*/ examples tests tests/*/ perf docs; do
    case "$folder" in lib/include/) continue ;; esac
    [ -f "$folder/README.md" ] || { echo "$folder has no README.md"; status=1; continue; }
    lines=$(wc -l <"$folder/README.md")
    [ "$lines" -le 60 ] || { echo "$folder/README.md has $lines lines: one screen, please"; status=1; }
done
# A path is one from the root, from lib, from the public headers or from the page's folder; a bare name, any file's.
here="$(find . -path ./build -prune -o -type f -print)
"
for page in README.md docs/*.md docs/*/*.md lib/*/README.md kernels/README.md bindings/*/README.md tests/*/README.md; do
    for name in $(grep -oE '[`][a-z_0-9][a-z_0-9/]*[.](c|h|cl|py|sh)[`]' "$page" | tr -d '`' | sort -u); do
        case "$name" in
        */*) [ -e "$name" ] || [ -e "lib/$name" ] || [ -e "lib/include/$name" ] || [ -e "${page%/*}/$name" ] ;;
        *) case "$here" in *"/$name
"*) ;; *) false ;; esac ;;
        esac || { echo "$page names $name, which is not there"; status=1; }
    done
done
for file in $(find lib kernels bindings examples tests perf -name '*.c' -o -name '*.h' -o -name '*.cl'); do
    lines=$(wc -l <"$file")
    [ "$lines" -le 900 ] || sed -n 1,12p "$file" | grep -q "One file:" || { echo "$file has $lines lines: split it, or say why in its first comment (One file: ...)"; status=1; }
done
exit $status
