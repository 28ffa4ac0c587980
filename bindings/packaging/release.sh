#!/usr/bin/env bash
# What has to hold before a release, each step alone or all in turn; the table at the end says which did.
#   bindings/packaging/release.sh [--list] [--help] [--brief] [--without STEP]... [STEP...]
# --list names the steps. --brief goes through them in an hour or two, to try the check itself or to look early: quick tests in
# the release build, those of files, models and jobs and the corpora in the debug and sanitized builds, one round of a few
# benchmarks; what it finds is no release. Without it all steps take some hours on two cores.
# LAST: the last release (a tag or commit; default: the newest tag v*), which ABI, results and speed are compared with.
# LAST_BUILD: a build of it with the tests, where there is one; else it is built. KERNELS: a cache of PoCL to begin with.
# RELEASING.md says what each step is for.
set -uo pipefail
cd "$(dirname "$0")/../.."
out=build/release-check
build=build/release
brief=
few="test_dataset test_fit_sums test_jobs test_model_file test_options test_output test_safetensors test_text"

step_names=(version changelog manuals abi release debug sanitized packages results speed)
declare -A about=(
    [version]="the version stands in one place, packages repeat it, and no such tag is there yet"
    [changelog]="CHANGELOG.md has the version with a date, and nothing above it"
    [manuals]="manual pages, completion and the reference are those of this program and these headers"
    [abi]="exported functions and types: against the committed ones, and against the last release's"
    [release]="everything: tests/run.sh all release"
    [debug]="the quick tests in a debug build"
    [sanitized]="unit tests and corpora under the address, undefined behaviour and thread sanitizers"
    [packages]="source archive, sdist, conda recipe, Debian packages: built, checked, installed, used, removed"
    [results]="the same bits as the last release, the whole way"
    [speed]="against the last release, in turns"
)
last=${LAST:-$(git describe --tags --match 'v*' --abbrev=0 2>/dev/null || true)}
version=$(bindings/packaging/version.sh)
failed() { echo "$*"; return 1; }
# Each build's kernels begin with those of KERNELS; others may be at work there, and lose files that are theirs for a moment.
kernels_for() {
    [ -n "${KERNELS:-}" ] || return 0
    mkdir -p "build/$1/pocl-cache"
    cp -rn "$KERNELS/." "build/$1/pocl-cache/" 2>/dev/null || true
}
configured() { # PRESET
    kernels_for "$1"
    cmake --preset "$1" -DHADALENS_TESTS=ON -DHADALENS_WERROR=ON >/dev/null && cmake --build "build/$1"
}
tests() { ctest --test-dir "$build" --output-on-failure --no-tests=error -R "$1"; }
# The last release, built in a folder of its own.
last_build() {
    [ -z "${LAST_BUILD:-}" ] || return 0
    [ -n "$last" ] || { echo "There is no tag v*, and LAST names no other: this is the first release."; return 2; }
    local tree=$out/last
    [ -e "$tree" ] || git worktree add --detach "$tree" "$last" >/dev/null || return 1
    [ "$(git -C "$tree" rev-parse HEAD)" = "$(git rev-parse "$last^{commit}")" ] ||
        failed "$tree is of another version than $last: git worktree remove --force $tree" || return 1
    (cd "$tree" && cmake --preset release -DHADALENS_TESTS=ON >/dev/null &&
        cmake --build build/release --target hadalens_cli check)
}

# Its ABI: as it was committed, or where there was none, that of its headers.
last_abi() {
    ! git show "$last:tests/abi/baseline.abi" >"$out/last.abi" 2>/dev/null || return 0
    local tree=$out/last.headers
    rm -rf "$tree" && mkdir "$tree" && git archive "$last" lib/include | tar -x -C "$tree" &&
        python3 tests/abi/stub.py "$tree/lib/include" >"$tree/stub.c" &&
        cc -std=gnu11 -w -g -O0 -fPIC -shared -I"$tree/lib/include" "$tree/stub.c" -o "$tree/libhadalens.so" &&
        abidw --no-show-locs --no-parameter-names --no-corpus-path --no-comp-dir-path --type-id-style hash \
            --headers-dir "$tree/lib/include" --out-file "$out/last.abi" "$tree/libhadalens.so"
}

step_version() {
    configured release && tests '^packages_version$' || return 1
    ! git rev-parse -q --verify "refs/tags/v$version" >/dev/null ||
        failed "the tag v$version is there: raise the version (lib/include/hadalens/base.h)"
}
step_changelog() {
    grep -qE "^## $version \(20[0-9]{2}-[0-9]{2}-[0-9]{2}\)$" CHANGELOG.md ||
        failed "CHANGELOG.md has no line '## $version (YEAR-MONTH-DAY)'" || return 1
    local above
    above=$(sed -n "/^## Unreleased/,/^## $version/p" CHANGELOG.md | grep -c '^- ')
    [ "$above" = 0 ] || failed "$above lines still stand under 'Unreleased', above $version"
}
step_manuals() {
    configured release || return 1
    rm -rf "$out/man" && mkdir "$out/man" || return 1
    local page command
    for page in "$build"/man/*.1; do
        command=$(basename "$page" .1 | sed 's/^hadalens-*//')
        "$build/bindings/cli/hadalens" --man ${command:+"$command"} >"$out/man/${page##*/}" || return 1
    done
    diff -r "$out/man" "$build/man" ||
        failed "the build's manual pages are not those of its program" || return 1
    rm -rf "$out/completion" && python3 bindings/cli/completion/completion.py "$out/man" "$out/completion" &&
        diff -r "$out/completion" "$build/completion" || failed "the build's completion is not that of its pages" || return 1
    grep -q "hadalens $version" "$build/man/hadalens.1" || failed "the manual pages are of another version" || return 1
    tests '^(cli_words|packages_completion|house_reference|house_site|cli_make)$'
}
step_abi() {
    configured release && tests '^(abi_.*|packages_symbols|house_symbols)$' || return 1
    [ -n "$last" ] || { echo "There is no last release to compare with."; return 0; }
    last_abi || return 1
    abidiff "$out/last.abi" tests/abi/baseline.abi
    local changed=$? was
    was=$(git show "$last:CMakeLists.txt" | sed -n 's/^set(HADALENS_SOVERSION \(.*\))/\1/p')
    # 8: what was built against the last release has to be built again
    [ $((changed & 8)) = 0 ] || [ "$was" != "$(sed -n 's/^set(HADALENS_SOVERSION \(.*\))/\1/p' CMakeLists.txt)" ] ||
        failed "programs have to be built again, and the soname is that of $last (CONTRIBUTING.md)"
}
# Quick tests of another build: those like PATTERN, and in brief a few, without building what they do not need.
quick_tests() { # PRESET PATTERN
    kernels_for "$1"
    [ -n "$brief" ] || { tests/run.sh quick "$1" -R "$2"; return; }
    # shellcheck disable=SC2086
    cmake --preset "$1" -DHADALENS_TESTS=ON -DHADALENS_WERROR=ON >/dev/null && cmake --build "build/$1" --target $few fuzz_replay &&
        ctest --test-dir "build/$1" --output-on-failure --no-tests=error -R "^(${few// /|}|fuzz_.*)\$"
}
step_release() { kernels_for release && tests/run.sh ${brief:+quick} release; }
step_debug() { quick_tests debug .; }
step_sanitized() { quick_tests asan '^(test_|fuzz_)' && quick_tests tsan '^test_'; }
step_packages() {
    tests/packages/sdist.sh "$out/sdist" && tests/packages/conda.sh "$out/conda" && tests/packages/debian.sh "$out/debian"
}
step_results() {
    last_build
    case $? in 1) return 1 ;; 2) return 0 ;; esac
    configured release && tests/golden/compare.sh "${LAST_BUILD:-$out/last/build/release}/bindings/cli/hadalens" \
        "$build/bindings/cli/hadalens" "$out/golden"
}
step_speed() {
    last_build
    case $? in 1) return 1 ;; 2) return 0 ;; esac
    configured release && perf/against.sh "${LAST_BUILD:-$out/last/build/release}" "$build" ${brief:+-n 1 -r "sim300\$|^FFT"} -o "$out/against-$version.md" &&
        ! grep 'slower |$' "$out/against-$version.md"
}

chosen=() without=" "
while [ $# -gt 0 ]; do
    case $1 in
    --list)
        for name in "${step_names[@]}"; do printf '%-10s %s\n' "$name" "${about[$name]}"; done
        exit ;;
    --help | -h)
        sed -n '2,/^set/s/^# \{0,1\}//p' "$0"
        exit ;;
    --brief) brief=1 ;;
    --without)
        without="$without${2:-} "
        shift ;;
    *)
        [ -n "${about[$1]:-}" ] || { echo "no step '$1'; --list names them" >&2; exit 2; }
        chosen+=("$1") ;;
    esac
    shift
done
[ ${#chosen[@]} -gt 0 ] || chosen=("${step_names[@]}")
mkdir -p $out
worst=0 table=
for name in "${chosen[@]}"; do
    if [[ $without == *" $name "* ]]; then
        table+=$(printf '%-10s left out' "$name")$'\n'
        continue
    fi
    printf '\n== %s: %s\n' "$name" "${about[$name]}"
    from=$SECONDS
    if (set -e; "step_$name") >"$out/$name.log" 2>&1; then said=holds; else said="FAILS ($out/$name.log)" worst=1; fi
    [ "$said" = holds ] || tail -n 15 "$out/$name.log"
    table+=$(printf '%-10s %s, %d s' "$name" "$said" $((SECONDS - from)))$'\n'
done
printf '\nhadalens %s after %s%s\n%s' "$version" "${last:-nothing}" "${brief:+, in brief: no release}" "$table"
exit $worst
