#!/usr/bin/env bash
# Devices: the list, the choice, none at all.
. "$(dirname "$0")/cli_testing.sh"

expect 0 'index +kind +name' devices
expect 0 '"max_allocation_bytes"' devices --json
is_json 'devices'
expect 0 'gives the known answers' devices --check
expect 5 'HADALENS_DEVICE|--device|hadalens devices' devices --check --device nosuchdevice
expect 5 '' devices --check --device 99
expect 0 'kernels as groups' devices --check --shape groups
expect 0 '"shape": "lanes"' devices --check --shape lanes --json
HADALENS_SHAPE=groups expect 0 '"shape": "groups"' devices --check --json
HADALENS_SHAPE=groups expect 0 '"shape": "lanes"' devices --check --shape lanes --json
HADALENS_SHAPE=round expect 5 "HADALENS_SHAPE is 'round'.*lanes or groups" devices --check
expect 2 '--shape takes one of lanes|groups' devices --check --shape round
HADALENS_DEVICE=nosuchdevice expect 5 'nosuchdevice' fit "$camera" -o x
lacks x

# PoCL's cache after a loss of power: files that are empty or cut are removed at the first start, and compiled again.
export POCL_CACHE_DIR=$here/pocl
mkdir pocl
expect 0 '' devices --check
for kind in program.bc '*.so'; do
    for size in 0 3/8 7/8 zeros; do
        rm pocl/hadalens-checked
        find pocl -mindepth 2 -name "$kind" >damaged
        while read -r file; do
            bytes=$(stat -c %s "$file")
            case $size in
            zeros) truncate -s $((bytes / 2)) "$file" && truncate -s "$bytes" "$file" ;;
            *) truncate -s $((bytes * $size)) "$file" ;;
            esac
            touch -d '1 hour ago' "$file"
        done <damaged
        touch pocl/other.so
        expect 0 "gives the known answers.*cache $POCL_CACHE_DIR: .* removed \($(wc -l <damaged)\)" devices --check
        has $(cat damaged)
        [ -e pocl/other.so ] || fail 'a file of somebody else was removed'
        "$HADALENS" devices --check 2>&1 | grep -q 'empty or cut' && fail 'said twice'
    done
done

# No OpenCL at all.
export OCL_ICD_VENDORS=/nonexistent
expect 5 'pocl-opencl-icd' devices
expect 5 '"HADA_ERROR_NO_DEVICE"' devices --json
is_json 'no device'
expect 5 'pocl-opencl-icd' simulate -o x
expect 5 'pocl-opencl-icd' fit "$camera" -o x
expect 5 'pocl-opencl-icd' reconstruct "$camera/test/raw/test01.tif" -m "$model" -o y
lacks x
files y 0
expect 0 '' evaluate "$camera/test/truth" "$camera/test/truth"
unset OCL_ICD_VENDORS

expect 5 'nosuchfolder' devices --check --binaries nosuchfolder
finish
