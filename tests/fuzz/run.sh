#!/usr/bin/env bash
# run.sh MINUTES [TARGET...]: so long for each target, or for these. What is found stays in build/fuzz/found.
set -euo pipefail
cd "$(dirname "$0")/../.."
seconds=$(awk "BEGIN { print int(60 * $1) }")
shift
[ $# -gt 0 ] || set -- tests/fuzz/corpus/*/
cmake --preset fuzz >/dev/null
cmake --build build/fuzz --target fuzz_engine
mkdir -p build/fuzz/found
export ASAN_OPTIONS=new_delete_type_mismatch=0 LSAN_OPTIONS=suppressions=tests/leaks.txt:print_suppressions=0
failed=0
for target in "$@"; do
    target=$(basename "$target")
    corpus=(tests/fuzz/corpus/"$target")
    words=tests/fuzz/dictionary/$target
    case $target in
    tiff | safetensors) corpus+=(tests/golden) ;;
    model | sums | checkpoint | net) words=tests/fuzz/dictionary/safetensors ;;
    camera | list) words=tests/fuzz/dictionary/json ;;
    esac
    [ -e "$words" ] && corpus+=(-dict="$words")
    mkdir -p "build/fuzz/corpus/$target"
    FUZZ_TARGET=$target build/fuzz/tests/fuzz/fuzz_engine "build/fuzz/corpus/$target" "${corpus[@]}" \
        -max_total_time="$seconds" -max_len=8192 -timeout=10 -rss_limit_mb=1500 -malloc_limit_mb=800 \
        -artifact_prefix="build/fuzz/found/$target-" -print_final_stats=1 >"build/fuzz/$target.log" 2>&1 ||
        { failed=1 && tail -n 30 "build/fuzz/$target.log"; }
    printf '%-12s %s executions, %s\n' "$target" \
        "$(sed -n 's/^stat::number_of_executed_units: //p' "build/fuzz/$target.log")" \
        "$(grep -o 'cov: [0-9]*' "build/fuzz/$target.log" | tail -n 1)"
done
exit $failed
