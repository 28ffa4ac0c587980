#!/usr/bin/env bash
# Format and static analysis, with no finding: clang-format, cppcheck and the checks of .clang-tidy.
#   tests/house/lint.sh BUILD [whole]    a build folder with compile_commands.json, built
#   tests/house/lint.sh --format         only says which sources are not formatted, within seconds
#   tests/house/lint.sh --fix            only formats the sources
# What follows calls from file to file or from branch to branch, cppcheck and clang's analyzer, takes nine tenths of the
# time: it looks at the files of the last ten commits and at a fifth of all, another one each day; whole: at all.
# Where a finding is none, the code is mended so that tools and readers see why; else a suppression is put on its line
# with the reason (cppcheck-suppress, NOLINT).
set -euo pipefail
[ $# = 1 ] || [ "${2:-}" = whole ] || { sed -n '3,5s/^# *//p' "$0"; exit 2; }
build=$1
cd "$(dirname "$0")/../.."
sources() { git ls-files -- "$@" | while read -r file; do [ ! -e "$file" ] || echo "$file"; done; }
failed=0
all=$(sources 'lib/*.c' 'bindings/*.c')
deep=$all
if [ "${2:-}" != whole ] && lately=$(git log -n 10 --name-only --format= -- lib bindings && git diff --name-only HEAD); then
    deep=$({ echo "$lately" | grep -xF "$all" || true; echo "$all" | awk -v day="$(date +%j)" 'NR % 5 == day % 5'; } | sort -u)
fi

formatted=$(sources '*.c' '*.h' '*.cl' | grep -v '^tests/abi/frozen')
if [ "$build" = --fix ]; then
    echo "$formatted" | xargs clang-format -i
    exit
fi
echo "$formatted" | xargs clang-format --dry-run -Werror || { echo "lint: format with $0 --fix"; failed=1; }
[ "$build" != --format ] || exit $failed

cppcheck --quiet --enable=warning,performance,portability --inline-suppr --std=c11 --error-exitcode=1 -j "$(nproc)" \
    --suppress=missingIncludeSystem -I lib -I lib/include -I kernels -I bindings/cli/base -I bindings/cli/shared -I "$build/generated" $deep ||
    { echo "lint: findings of cppcheck"; failed=1; }

tidy() { xargs -r -P "$(nproc)" -n 8 clang-tidy -p "$build" --quiet "$@" 2>/dev/null; }
{ echo "$deep" | tidy && echo "$all" | grep -vxF "$deep" | tidy --checks='-clang-analyzer-*'; } ||
    { echo "lint: findings of clang-tidy"; failed=1; }
exit $failed
