# Shared by the command line's tests. Needs HADALENS, FRAME_TOOL and WORK in the environment. Each works in a folder of
# its own, named as its script or, where one script is several tests that may run at once, TEST_NAME.
set -u
export LC_ALL=C
here="$WORK/${TEST_NAME:-$(basename "$0" .sh)}"
rm -rf "$here"
mkdir -p "$here"
cd "$here" || exit 1
camera="$WORK/camera"
model="$WORK/camera.model"
failures=0

fail() {
    failures=$((failures + 1))
    printf 'FAILED: %s\n' "$1"
    sed 's/^/    stdout: /' stdout 2>/dev/null | head -n 20
    sed 's/^/    stderr: /' stderr 2>/dev/null | head -n 20
}

# expect CODE WORDS COMMAND...: runs 'hadalens COMMAND...'; its exit code must be CODE, and its output must hold WORDS
# (an extended regular expression; "" for none).
expect() {
    local code=$1 words=$2 got
    shift 2
    "$HADALENS" "$@" >stdout 2>stderr
    got=$?
    [ "$got" = "$code" ] || fail "exit code $got instead of $code: hadalens $*"
    [ -z "$words" ] || cat stdout stderr | tr '\n' ' ' | grep -Eq -- "$words" || fail "no '$words' from: hadalens $*"
}

# Whether two results are the same but for the names of what they were made from.
same_results() { "$FRAME_TOOL" same "$1" "$2"; }

is_json() {
    if command -v jq >/dev/null; then
        jq -e . <stdout >/dev/null || fail "not JSON: $1"
    elif command -v python3 >/dev/null; then
        python3 -m json.tool <stdout >/dev/null || fail "not JSON: $1"
    fi
}

# has FILE...: all are there and not empty.
has() {
    local file
    for file in "$@"; do [ -s "$file" ] || fail "missing: $file"; done
}

# lacks FILE...: none is there.
lacks() {
    local file
    for file in "$@"; do [ ! -e "$file" ] || fail "left behind: $file"; done
}

# files FOLDER N: exactly N files, hidden ones too.
files() {
    local count
    count=$(find "$1" -type f 2>/dev/null | wc -l)
    [ "$count" = "$2" ] || fail "$count files instead of $2 in $1: $(find "$1" -type f | head -n 8 | tr '\n' ' ')"
}

info() { "$FRAME_TOOL" info "$1" | head -n 1; }

finish() {
    if [ "$failures" != 0 ]; then
        echo "$failures failed"
        exit 1
    fi
    cd /
    rm -rf "$here"
    echo "all as expected"
}
