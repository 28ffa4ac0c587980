#!/bin/sh
# Every name that the library exports, and every global name inside it, starts with hada_; cairo and all that it brings
# are loaded when a picture is drawn, not with the library.
set -eu
library=$1
exported=$(nm -D --defined-only "$library" | awk '{print $3}' | grep -v '^hada_' || true)
[ -z "$exported" ] || { echo "exported without hada_: $exported"; exit 1; }
nm -D --defined-only "$library" | grep -q hada_context_create || { echo "hada_context_create is not exported"; exit 1; }
if readelf -d "$library" | grep NEEDED | grep -q cairo; then
    echo "cairo is linked: it costs every program that draws nothing (lib/picture/drawing.c)"
    exit 1
fi
