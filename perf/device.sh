#!/usr/bin/env bash
# Builds Hadalens, tests it and measures it on one device, with one command and no network, and leaves tables, plots
# and logs in a folder: for taking the project to any machine and back.
#
#   perf/device.sh OUT [PREFIX] [--device D] [--minutes N] [--build FOLDER] [--only "STEP ..."]
#
# PREFIX: packages unpacked by perf/device_packages.sh; without it those of the machine are used. The machine needs a C
# compiler and CMake. --device (or HADALENS_DEVICE): as `hadalens --device`, default the library's choice. --minutes:
# what does not fit in is left out, the most telling steps come first (default 60). --build: kept for another run
# (default: in a temporary folder). OCL_ICD_VENDORS, where set, says which OpenCL drivers are seen; else those of the
# machine, NVIDIA's library where it lies about without a vendor file, and the PoCL of PREFIX.
#
# OUT/summary.md says what happened; OUT/results.tar.gz holds everything, to be carried back. Exit code: 0 all went
# well, 1 a step failed (the others ran), 2 wrong call, 3 nothing could be built, 4 no device.
set -uo pipefail
usage() { sed -n '2,16s/^# \{0,1\}//p' "$0"; exit 2; }
out="" prefix="" minutes=60 build="" only=""
while [ $# -gt 0 ]; do
    case "$1" in
    --device | --minutes | --build | --only)
        [ $# -ge 2 ] || usage
        case "$1" in
        --device) export HADALENS_DEVICE=$2 ;;
        --minutes) minutes=$2 ;;
        --build) build=$2 ;;
        --only) only=" $2 " ;;
        esac
        shift
        ;;
    -*) usage ;;
    *) if [ -z "$out" ]; then out=$1; elif [ -z "$prefix" ]; then prefix=$1; else usage; fi ;;
    esac
    shift
done
[ -n "$out" ] || usage
source=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$out/logs" || exit 2
out=$(cd "$out" && pwd)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
build=${build:-$scratch/build}
mkdir -p "$build" && build=$(cd "$build" && pwd) || exit 2
end=$((SECONDS + minutes * 60))
jobs=$(nproc 2>/dev/null || echo 2)
failed=0
export HADALENS_CACHE=${HADALENS_CACHE:-$build/program-cache} POCL_CACHE_DIR=${POCL_CACHE_DIR:-$build/pocl-cache}
mkdir -p "$POCL_CACHE_DIR"
printf '# Hadalens on %s\n\n| Step | Result | Seconds | Log |\n|---|---|---|---|\n' "$(uname -n)" >"$out/summary.md"

# record STEP RESULT SECONDS
record() { echo "| $1 | $2 | $3 | logs/$1.log |" >>"$out/summary.md"; echo "$1: $2 ($3 s)"; }

# step NAME SECONDS COMMAND...: runs it for at most so many seconds, its output in logs/NAME.log; returns its exit
# code. Code 77 of a command means that there was nothing to do.
step() {
    local name=$1 limit=$2 start=$SECONDS left=$((end - SECONDS)) code
    shift 2
    [ -z "$only" ] || [[ $only == *" $name "* ]] || return 77
    if [ "$left" -lt 10 ]; then
        echo "no time left" >"$out/logs/$name.log"
        record "$name" "left out: no time" 0
        return 77
    fi
    # a function of this script runs in a shell of its own, so that its time is limited as well
    if declare -F "$1" >/dev/null; then
        export -f "$1"
        set -- bash -c "$1"
    fi
    timeout -k 10 "$((limit < left ? limit : left))" "$@" >"$out/logs/$name.log" 2>&1 </dev/null
    code=$?
    case $code in
    0) record "$name" ok $((SECONDS - start)) ;;
    77) record "$name" "nothing to do" 0 ;;
    124 | 137) record "$name" "FAILED: not done in time" $((SECONDS - start)) ;;
    *) record "$name" "FAILED: exit code $code" $((SECONDS - start)) ;;
    esac
    [ $code = 0 ] || [ $code = 77 ] || failed=1
    return $code
}

# finish CODE: the ends of logs of failed steps, then out
finish() {
    local log
    {
        grep '| FAILED' "$out/summary.md" | sed 's/.*| \(logs[^ ]*\) |.*/\1/' | while read -r log; do
            printf '\n## %s\n\n```\n' "$log"
            tail -n 25 "$out/$log" | cut -c 1-300
            printf '```\n'
        done
        printf '\nExit code %s.\n' "$1"
    } >"$scratch/tails"
    cat "$scratch/tails" >>"$out/summary.md"
    tar -C "$out" -cz --exclude results.tar.gz -f "$scratch/results.tar.gz" . && mv "$scratch/results.tar.gz" "$out"
    echo "Exit code $1: $out/summary.md"
    exit "$1"
}

# --- the machine
machine() {
    uname -a
    lscpu 2>/dev/null || head -n 30 /proc/cpuinfo
    head -n 3 /proc/meminfo
    command -v nvidia-smi >/dev/null && nvidia-smi
    cmake --version
    ${CC:-cc} --version
    true
}
step machine 60 machine

# --- what it is built with and what runs it
settings=(-DCMAKE_BUILD_TYPE=Release -DHADALENS_TESTS=ON -DHADALENS_PERF=ON)
if [ -n "$prefix" ]; then
    prefix=$(cd "$prefix" && pwd) || exit 2
    libraries=$(find "$prefix/usr/lib" -name 'libOpenCL.so*' -printf '%h\n' -quit)
    [ -n "$libraries" ] || { echo "$prefix holds no libOpenCL.so: see perf/device_packages.sh" >&2; exit 2; }
    multiarch=$(basename "$libraries")
    # Programs find their libraries, and the libraries of these and drivers opened later, by an old-style run path. No
    # LD_LIBRARY_PATH, which the machine's own programs (CMake) would take libraries from as well.
    paths=$libraries:$(find "$prefix/usr/lib" -maxdepth 3 -name lib -path '*llvm*' | tr '\n' ':')
    link="-Wl,--disable-new-dtags,-rpath,${paths%:},-rpath-link,$libraries"
    settings+=("-DCMAKE_PREFIX_PATH=$prefix/usr" "-DCMAKE_LIBRARY_PATH=$libraries" "-DCMAKE_EXE_LINKER_FLAGS=$link"
        "-DCMAKE_SHARED_LINKER_FLAGS=$link")
    export C_INCLUDE_PATH=$prefix/usr/include:$prefix/usr/include/$multiarch CPLUS_INCLUDE_PATH=$prefix/usr/include
    export LIBRARY_PATH=$libraries CMAKE_PREFIX_PATH=$prefix/usr
    # pkg-config needs a library of its own, and has to look into the prefix alone
    mkdir -p "$build/tools"
    printf '#!/bin/sh\nLD_LIBRARY_PATH=%s exec %s/usr/bin/pkgconf "$@"\n' "$libraries" "$prefix" \
        >"$build/tools/pkg-config"
    chmod +x "$build/tools/pkg-config"
    export PKG_CONFIG=$build/tools/pkg-config PKG_CONFIG_SYSROOT_DIR=$prefix
    export PKG_CONFIG_LIBDIR=$libraries/pkgconfig:$prefix/usr/lib/pkgconfig:$prefix/usr/share/pkgconfig
    export PKG_CONFIG_ALLOW_SYSTEM_CFLAGS=1 PKG_CONFIG_ALLOW_SYSTEM_LIBS=1
    export PATH=$build/tools:$PATH:$prefix/usr/bin
fi
if [ -z "${OCL_ICD_VENDORS:-}" ]; then
    # a path in a vendor file, or a name that the loader looks for; a name of the prefix's becomes its path
    mkdir -p "$scratch/vendors"
    cp /etc/OpenCL/vendors/*.icd "$scratch/vendors" 2>/dev/null
    for icd in "${prefix:-/nowhere}"/etc/OpenCL/vendors/*.icd; do
        [ -e "$icd" ] && [ ! -e "$scratch/vendors/$(basename "$icd")" ] || continue
        find "$prefix/usr/lib" -name "$(basename "$(cat "$icd")")" -print -quit >"$scratch/vendors/$(basename "$icd")"
    done
    if ! ls "$scratch/vendors"/nvidia*.icd >/dev/null 2>&1; then
        nvidia=$({ /sbin/ldconfig -p 2>/dev/null | sed -n 's/.*=> //p'
            ls /usr/local/nvidia/lib*/* /usr/lib/*/libnvidia-opencl.so* 2>/dev/null; } |
            grep -m 1 'libnvidia-opencl\.so\.1')
        [ -z "$nvidia" ] || echo "$nvidia" >"$scratch/vendors/nvidia.icd"
    fi
    export OCL_ICD_VENDORS=$scratch/vendors
fi
command -v ninja >/dev/null && settings+=(-G Ninja)

step configure 300 cmake -S "$source" -B "$build" "${settings[@]}"
code=$?
[ $code = 0 ] || [ $code = 77 ] || finish 3
step build 1800 cmake --build "$build" -j "$jobs"
code=$?
if [ $code != 0 ] && [ $code != 77 ]; then
    # what can be built may still run: a peer or a test that does not build must not cost the rest
    step build_rest 1800 cmake --build "$build" -j "$jobs" -- -k 0
    [ -x "$build/bindings/cli/hadalens" ] || finish 3
fi
hadalens=$build/bindings/cli/hadalens
export out build source scratch jobs hadalens

# --- the device
devices() {
    "$hadalens" devices || return
    "$hadalens" devices --json >"$out/devices.json" 2>/dev/null
    "$build/tests/check/check" --op none | grep '^device' # the one that the others take
}
step devices 300 devices
[ $? != 77 ] && ! grep -q '^device' "$out/logs/devices.log" && finish 4

# --- The steps, the most telling first. Tables and plots are made of whatever a step left, also when its time ran out.
way() {
    local camera=$scratch/camera
    "$hadalens" simulate --preset sim300 --pairs 8 --test 4 -o "$camera" &&
        "$hadalens" fit "$camera" -o "$scratch/model" --json >"$out/fit.json" &&
        "$hadalens" reconstruct "$camera"/test/raw/*.tif -m "$scratch/model" -o "$scratch/pictures" --json \
            >"$out/reconstruct.json" &&
        "$hadalens" evaluate "$scratch/pictures" "$camera/test/truth" --json >"$out/evaluate.json" &&
        cp "$scratch"/pictures/*_preview.png "$out" &&
        cat "$out/fit.json" "$out/reconstruct.json" "$out/evaluate.json"
}
bench() {
    "$hadalens" bench --help >/dev/null 2>&1 || { echo "this version has no bench"; return 77; }
    "$hadalens" bench --quick -o "$out/bench-quick" && "$hadalens" bench -o "$out/bench" || return
    # what a frame asks of this device would take on another one
    ! command -v python3 >/dev/null || python3 "$source/perf/estimate.py" "$out/bench/bench.json" | tee "$out/estimate.txt"
}
check_time() { "$build/tests/check/check" --mode time --csv >"$out/check-time.csv"; }
# bars FILE COLUMN UNIT TITLE: a column of the check tool's times, for the slowest shape of each operation
bars() {
    awk -F, -v column="$2" '
        NR > 1 && !($1 in slowest) { order[++count] = $1 }
        NR > 1 && $3 > slowest[$1] { slowest[$1] = $3; bar[$1] = $1 " " $2 "," $column }
        END { for (i = 1; i <= count; i++) print bar[order[i]] }' "$out/check-time.csv" |
        awk -v title="$4" -v unit="$3" -f "$source/perf/bars.awk" >"$out/$1"
}
# each program of perf with its defaults; what it prints is its table
programs() {
    local program name code=0 some=77
    for program in "$build"/perf/perf_*; do
        [ -f "$program" ] && [ -x "$program" ] || continue
        some=0 name=$(basename "$program")
        echo "== $name"
        timeout -k 10 400 "$program" >"$out/$name.md" 2>"$scratch/errors" || { code=1; cat "$scratch/errors"; }
        cat "$out/$name.md"
    done
    return $((some ? some : code))
}
# the nets beside PyTorch's on the same GPU, where python3 has PyTorch for it
nets() {
    python3 -c 'import sys, torch; sys.exit(not torch.cuda.is_available())' || return 77
    PEER_DEVICE=cuda "$build/perf/perf_unet" --rounds 15 --peer "python3 $source/perf/peers/unet_torch.py" \
        >"$out/nets.md" || return
    python3 "$source/perf/peers/conv_torch.py" "$build/perf/perf_conv" --device cuda >>"$out/nets.md"
    cat "$out/nets.md"
}
# every operation against its reference; operations in processes beside each other, since compiling is what takes time
check_correct() {
    local check=$build/tests/check/check
    "$check" --help | sed -n 's/^  \([a-z0-9_]*\) .*/\1/p' |
        xargs -P "$jobs" -I{} bash -c '"$0" --mode correct --op {} >"$1/check-{}" 2>&1; echo $? >>"$1/check-{}"' \
            "$check" "$scratch"
    cat "$scratch"/check-*
    ! tail -qn 1 "$scratch"/check-* | grep -qv '^0$'
}
tests() {
    ctest --test-dir "$build" --output-on-failure --no-tests=error -j "$jobs" \
        --output-junit "$out/tests.xml" -E '^check_(correct|bits)$|^stress$'
}
step whole_way 600 way
step stress 600 "$build/tests/stress/stress" --csv "$out/stress.csv"
[ ! -s "$out/logs/stress.log" ] || sed -n '/^| Condition/,$p' "$out/logs/stress.log" >"$out/stress.md"
step bench 900 bench
step check_correct 1200 check_correct
step check_time 900 check_time
if [ -s "$out/check-time.csv" ]; then
    awk -F, '{ gsub(",", " | "); print "| " $0 " |" } NR == 1 { print "|---|---|---|---|---|---|---|" }' \
        "$out/check-time.csv" >"$out/check-time.md"
    bars check-time.svg 3 ms "Median milliseconds"
    bars check-bandwidth.svg 5 GB/s "GB/s by the least traffic"
fi
step nets 600 nets
step programs 1500 programs
step check_bits 900 "$build/tests/check/check" --mode bits
step tests 1800 tests
finish $failed
