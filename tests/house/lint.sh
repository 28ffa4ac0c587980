#!/usr/bin/env bash
# Format and static analysis, with no finding: clang-format, cppcheck and the checks of .clang-tidy.
#   tests/house/lint.sh BUILD            a build folder with compile_commands.json, built
#   tests/house/lint.sh --fix            only formats the sources
# Where a finding is none, the code is mended so that tools and readers see why; else a suppression is put on its line
# with the reason (cppcheck-suppress, NOLINT).
set -euo pipefail
[ $# = 1 ] || { sed -n '3,4s/^# *//p' "$0"; exit 2; }
build=$1
cd "$(dirname "$0")/../.."
sources() { git ls-files -- "$@" | while read -r file; do [ ! -e "$file" ] || echo "$file"; done; }
failed=0

formatted=$(sources '*.c' '*.h' '*.cl' | grep -v '^tests/abi/frozen')
if [ "$build" = --fix ]; then
    echo "$formatted" | xargs clang-format -i
    exit
fi
echo "$formatted" | xargs clang-format --dry-run -Werror || { echo "lint: format with $0 --fix"; failed=1; }

cppcheck --quiet --enable=warning,performance,portability --inline-suppr --std=c11 --error-exitcode=1 -j "$(nproc)" \
    --suppress=missingIncludeSystem -I lib -I lib/include -I kernels -I bindings/cli/base -I bindings/cli/shared -I "$build/generated" lib bindings ||
    { echo "lint: findings of cppcheck"; failed=1; }

sources 'lib/*.c' 'bindings/*.c' | xargs -P "$(nproc)" -n 8 clang-tidy -p "$build" --quiet 2>/dev/null ||
    { echo "lint: findings of clang-tidy"; failed=1; }
exit $failed
