#!/usr/bin/env bash
# build.sh, as OSS-Fuzz calls it: with CC, CXX, CFLAGS, CXXFLAGS, LIB_FUZZING_ENGINE, SRC, WORK and OUT. Leaves one program
# fuzz_TARGET for each target in $OUT, with its seeds, dictionary, options, and the libraries that it needs. check.sh calls
# it on this machine. Left out: checkpoints, which need an OpenCL device.
set -euo pipefail
cd "$(dirname "$0")/../../.."
cmake -S . -B "$WORK/build" -G Ninja -DCMAKE_BUILD_TYPE=None -DCMAKE_C_COMPILER="$CC" -DCMAKE_CXX_COMPILER="$CXX" \
    -DHADALENS_TESTS=ON -DHADALENS_FUZZ=ON -DHADALENS_FUZZ_ENGINE="$LIB_FUZZING_ENGINE" -DHADALENS_MPI=OFF \
    -DHADALENS_PICTURES=OFF -DCMAKE_BUILD_RPATH='$ORIGIN/lib' -DCMAKE_BUILD_RPATH_USE_ORIGIN=ON \
    -DCMAKE_EXE_LINKER_FLAGS=-Wl,--disable-new-dtags >"$WORK/configure.log"
cmake --build "$WORK/build" --target fuzz_alone
mkdir -p "$OUT/lib"
# What a program or library needs beyond the C library, which is all that is there where programs run.
needed() {
    ldd "$1" | awk '$3 ~ "^/" && $1 !~ /^(libc|libm|libdl|libpthread|librt|libgcc_s|libstdc\+\+)[.]so/ { print $3 }' |
        xargs -r cp -L -n -t "$OUT/lib"
}
for program in "$WORK"/build/tests/fuzz/fuzz_*; do
    name=$(basename "$program")
    target=${name#fuzz_}
    [ -d "tests/fuzz/corpus/$target" ] && [ "$target" != checkpoint ] && [ -x "$program" ] || continue
    cp "$program" "$OUT/"
    needed "$program"
    seeds=(tests/fuzz/corpus/"$target"/*)
    words=tests/fuzz/dictionary/$target
    case $target in
    tiff) seeds+=(tests/golden/*.tif tests/golden/*.np? tests/golden/*.mat tests/golden/*.png tests/golden/*.jp*g) ;;
    safetensors) seeds+=(tests/golden/*.safetensors) ;;
    model | sums | net) words=tests/fuzz/dictionary/safetensors ;;
    camera | list) words=tests/fuzz/dictionary/json ;;
    esac
    rm -f "$OUT/${name}_seed_corpus.zip"
    for seed in "${seeds[@]}"; do [ ! -e "$seed" ] || printf '%s\n' "$seed"; done |
        zip -q -j -@ "$OUT/${name}_seed_corpus.zip"
    [ ! -e "$words" ] || cp "$words" "$OUT/$name.dict"
    printf '[libfuzzer]\nmax_len = 8192\ntimeout = 10\nrss_limit_mb = 1500\nmalloc_limit_mb = 800\n' >"$OUT/$name.options"
done
# those that are loaded when a file asks for them
for library in libpng16 libturbojpeg libraw libmatio; do
    path=$(/sbin/ldconfig -p | awk -v l="$library.so" 'index($1, l) == 1 && !n++ { print $NF }')
    [ -z "$path" ] || { cp -L "$(dirname "$path")/$library".so.[0-9]* "$OUT/lib/" && needed "$path"; }
done
