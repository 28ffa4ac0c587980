#!/bin/sh
# Each public header compiles alone as C++17. headers.sh COMPILER INCLUDE [FLAG...]
set -eu
compiler=$1 include=$2
shift 2
status=0
for header in "$include"/hadalens/*.h; do
    "$compiler" -std=c++17 -Wall -Wextra -pedantic -Werror -fsyntax-only -I"$include" "$@" -x c++ "$header" || status=1
    guard=$(grep -c 'extern "C" {' "$header" || true)
    [ "$guard" = 1 ] || [ "$(basename "$header")" = hadalens.h ] || { echo "$header: no C++ guard"; status=1; }
done
exit $status
