#!/bin/sh
# Holds the exported ABI against tests/abi/baseline.abi. abi.sh SOURCE WORK CC LIBRARY [--renew]
# --renew writes it anew, and adds to the symbols file of the Debian package.
# Skips (77) where abigail-tools are missing.
set -eu
source=$1 work=$2 cc=$3 library=$4
baseline=$source/tests/abi/baseline.abi
command -v abidw >/dev/null && command -v abidiff >/dev/null || {
    echo "abidw and abidiff are missing (Debian: apt-get install abigail-tools): the ABI is not checked"
    exit 77
}
mkdir -p "$work"
python3 "$source/tests/abi/stub.py" "$source/lib/include" >"$work/stub.c"
"$cc" -std=gnu11 -w -g -O0 -fPIC -shared -Wl,-soname,libhadalens.so -I"$source/lib/include" "$work/stub.c" \
    -o "$work/libhadalens.so"
names() { nm -D --defined-only "$1" | awk '$3 ~ /^hada_/ { print $3 }' | sort; }
names "$work/libhadalens.so" >"$work/declared"
names "$library" >"$work/exported"
diff "$work/declared" "$work/exported" >"$work/names" || {
    echo "declared (<) and exported (>) names differ:"
    cat "$work/names"
    exit 1
}
abidw --no-show-locs --no-parameter-names --no-corpus-path --no-comp-dir-path --type-id-style hash --headers-dir "$source/lib/include" \
    --out-file "$work/now.abi" "$work/libhadalens.so"
sed -i "s#path='[^']*/stub.c'#path='stub.c'#" "$work/now.abi" # where it was made does not matter
if [ "${5:-}" = --renew ]; then
    cp "$work/now.abi" "$baseline"
    exec sh "$source/tests/packages/symbols.sh" "$source" "$library" --renew
fi
status=0
abidiff "$baseline" "$work/now.abi" || status=$?
[ "$status" = 0 ] && exit 0
if [ $((status & 8)) != 0 ]; then
    echo "Programs that were built against the soname have to be built again: take the change back, or raise"
    echo "HADALENS_SOVERSION in CMakeLists.txt (CONTRIBUTING.md says when)."
else
    echo "The ABI has changed. Where only functions were added, and members behind the last of a struct with a size:"
fi
echo "The new description becomes the baseline by: tests/abi/abi.sh . build/abi cc build/release/libhadalens.so --renew"
exit 1
