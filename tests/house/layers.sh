#!/bin/sh
# Reads every #include "..." under lib/ and holds the order of lib/layers.txt; bindings may see public headers only.
set -eu
root=$1
cd "$root"
status=0
order=$(sed -n 's/^\([a-z]*\):.*/\1/p' lib/layers.txt)

# each folder of lib stands in the list, and each line names only folders above it
for folder in lib/*/; do
    name=$(basename "$folder")
    [ "$name" = include ] || echo "$order" | grep -qx "$name" || { echo "lib/$name is not in lib/layers.txt"; status=1; }
done
seen=""
while IFS=: read -r name allowed; do
    case "$name" in \#* | "") continue ;; esac
    for a in $allowed; do
        case " $seen " in *" $a "*) ;; *) echo "lib/layers.txt: $name names $a, which does not stand above it"; status=1 ;; esac
    done
    seen="$seen $name"
    for file in $(find "lib/$name" -name '*.[ch]' 2>/dev/null); do
        for target in $(sed -n 's/^#include "\([a-z_]*\)\/.*/\1/p' "$file" | sort -u); do
            case " $name $allowed " in
            *" $target "*) ;;
            *) echo "$file includes $target/, which lib/layers.txt does not allow for $name"; status=1 ;;
            esac
        done
    done
done <lib/layers.txt

# quoted includes name the folder, so that a reader and this test can tell where they lead
if grep -rnE '^#include "[^/"]+"' lib --include='*.[ch]'; then
    echo "write these includes with their folder"
    status=1
fi
if grep -rnE '^#include "[a-z_]+/' bindings examples; then
    echo "bindings and examples see the public headers only"
    status=1
fi
if grep -rn 'include.*\(CL/\|clFFT\|tiffio\|jansson\)' lib/include; then
    echo "public headers need no OpenCL, TIFF or JSON headers"
    status=1
fi
# file names are unique within lib, so that a name says where it stands
twins=$(find lib -name '*.[ch]' ! -path 'lib/include/*' -exec basename {} \; | sort | uniq -d)
[ -z "$twins" ] || { echo "file names used twice: $twins"; status=1; }
exit $status
