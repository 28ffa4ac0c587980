#!/usr/bin/env bash
# check.sh [FOLDER [SANITIZER]]: runs build.sh as OSS-Fuzz does (address, or undefined), and each program on its seeds
# and on as many new inputs, from an empty folder and without environment. Needs clang, zip, unzip.
set -euo pipefail
cd "$(dirname "$0")/../../.."
folder=$(realpath -m "${1:-build/oss-fuzz}")
case ${2:-address} in
address) flags="-fsanitize=address -fsanitize-address-use-after-scope" ;;
undefined) flags="-fsanitize=undefined -fno-sanitize-recover=undefined" ;;
esac
rm -rf "$folder/out" "$folder/run"
mkdir -p "$folder/out" "$folder/run"
export CC=clang CXX=clang++ LIB_FUZZING_ENGINE=-fsanitize=fuzzer SRC=$PWD WORK=$folder OUT=$folder/out
export CFLAGS="-O1 -fno-omit-frame-pointer -gline-tables-only $flags -fsanitize=fuzzer-no-link"
export CXXFLAGS=$CFLAGS
tests/fuzz/oss-fuzz/build.sh
count=0
for program in "$OUT"/fuzz_*; do
    case $program in *.*| *_seed_corpus.zip) continue ;; esac
    name=$(basename "$program")
    mkdir "$folder/run/$name"
    unzip -q "$OUT/${name}_seed_corpus.zip" -d "$folder/run/$name"
    [ -s "$OUT/$name.options" ] || { echo "$name has no options" && exit 1; }
    words=()
    [ ! -e "$OUT/$name.dict" ] || words=(-dict="$OUT/$name.dict")
    seeds=$(find "$folder/run/$name" -type f | wc -l)
    (cd "$folder/run" && env -i ASAN_OPTIONS=new_delete_type_mismatch=0:detect_leaks=0 "$program" "${words[@]}" \
        -runs=$((2 * seeds)) -max_len=8192 -timeout=10 -rss_limit_mb=1500 "$name") >"$folder/$name.log" 2>&1 ||
        { tail -n 30 "$folder/$name.log" && exit 1; }
    echo "$name: $seeds seeds"
    count=$((count + 1))
done
[ $count = "$(find tests/fuzz/corpus -mindepth 1 -maxdepth 1 ! -name checkpoint | wc -l)" ] || { echo "$count programs" && exit 1; }
