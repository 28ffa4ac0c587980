# unoptimised.sh ROOT GENERATED COMPILER CLFFT_INCLUDE CLFFT_LIBRARY: what the file that calls clFFT needs, compiled
# without optimisation, is in clFFT.
set -eu
command -v nm >/dev/null || { echo "nm is missing (binutils)"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$3" -std=c11 -D_GNU_SOURCE -DHADALENS_BUILDING -O0 -fPIC -I"$1/lib/include" -I"$1/lib" -I"$2" -I"$4" \
    -c "$1/lib/fft/fft_clfft.c" -o "$work/object.o"
nm -u "$work/object.o" | sed -n 's/.* \(clfft[A-Za-z]*\)$/\1/p' | sort -u >"$work/needed"
nm -D --defined-only "$5" | sed -n 's/.* \(clfft[A-Za-z]*\)\(@.*\)*$/\1/p' | sort -u >"$work/there"
[ -s "$work/needed" ] && [ -s "$work/there" ] || { echo "no symbols of clFFT found"; exit 1; }
missing=$(comm -23 "$work/needed" "$work/there")
[ -z "$missing" ] || { echo "not in clFFT: $missing"; exit 1; }
