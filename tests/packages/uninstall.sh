#!/usr/bin/env bash
# What an installation puts anywhere, uninstalling takes away, and nothing else. uninstall.sh SOURCE BUILD WORK
set -euo pipefail
source=$1 build=$2 work=$3
rm -rf "$work"
mkdir -p "$work/root/usr/share/man/man1" # a folder that was there and is empty stays
echo mine >"$work/root/usr/share/mine"
list() { (cd "$work/root" && find . | LC_ALL=C sort); }

# the notes of the build folder about installations stay as they are
notes() { for file in install_manifest.txt install_folders.txt; do [ ! -e "$1/$file" ] || mv "$1/$file" "$2/"; done; }
mkdir "$work/notes"
notes "$build" "$work/notes"
trap 'notes "$work/notes" "$build"' EXIT

list >"$work/before"
export DESTDIR=$work/root
cmake --install "$build" --prefix /usr >/dev/null
cmake --install "$build" --prefix /usr >/dev/null # twice, as people do
installed=$(find "$work/root" -type f -o -type l | wc -l)
[ "$installed" -gt 30 ] || { echo "only $installed files were installed"; exit 1; }
for file in bin/hadalens share/man/man1/hadalens-fit.1 share/bash-completion/completions/hadalens \
    share/zsh/site-functions/_hadalens include/hadalens/hadalens.h; do
    [ -s "$work/root/usr/$file" ] || { echo "not installed: $file"; exit 1; }
done
cmake -DBUILD="$build" -P "$source/cmake/uninstall.cmake" >/dev/null
list >"$work/after"
rm -f "$build/install_manifest.txt" "$build/install_folders.txt"
diff "$work/before" "$work/after" || { echo "uninstalling left (>) or took (<) what it should not"; exit 1; }
cmake -DBUILD="$build" -P "$source/cmake/uninstall.cmake" >"$work/said" 2>&1 && { echo "uninstalled nothing, in silence"; exit 1; }
grep -q 'nothing has been installed' "$work/said"
echo "$((installed - 1)) files came and went"
