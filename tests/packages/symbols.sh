#!/bin/sh
# The symbols file of the Debian package names what the library exports. symbols.sh SOURCE LIBRARY [--renew]
# --renew adds what is new, with the version of today, as tests/abi/abi.sh --renew does.
set -eu
source=$1 library=$2 renew=${3:-}
file=$(ls "$source"/bindings/packaging/debian/libhadalens*.symbols)
version=$("$source/bindings/packaging/version.sh")
nm -D --defined-only "$library" | awk '$3 ~ /^hada_/ { print $3 }' | LC_ALL=C sort | awk -v version="$version" -v file="$file" '
    BEGIN {
        while ((getline line < file) > 0) {
            split(line, part, /[ @]+/)
            if (line ~ /^ /) since[part[2]] = line; else print line
        }
    }
    { print $1 in since ? since[$1] : " " $1 "@Base " version }' >"$file.new"
if [ "$renew" = --renew ]; then
    mv "$file.new" "$file"
    exit 0
fi
status=0
diff "$file" "$file.new" || {
    echo "The library exports other names (>) than the Debian package's symbols file (<). Where functions were added:"
    echo "    tests/abi/abi.sh . build/abi cc build/release/libhadalens.so --renew"
    status=1
}
rm -f "$file.new"
exit $status
