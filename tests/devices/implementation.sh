#!/usr/bin/env bash
# Every operation, by another implementation of OpenCL, in one shape of kernels.
#   implementation.sh intel|oclgrind|pocl lanes|groups CHECK FOLDER     FOLDER: environment.sh made it
# DEVICES_FORM=brief: small shapes alone. Exit code 77: the implementation is not there.
set -euo pipefail
[ $# = 4 ] || { sed -n '3,4s/^# *//p' "$0" >&2; exit 2; }
implementation=$1 check=$3 folder=$4
export HADALENS_SHAPE=$2 HADALENS_CACHE=off HADALENS_TUNING=/nonexistent
command=("$check") log=''
# every number of a shape is at most so: what a simulator gets through, and what a minute has time for
largest=0
[ "${DEVICES_FORM:-full}" = full ] || largest=24

case $implementation in
intel)
    [ -e "$folder/intel/vendors/intel.icd" ] || { echo "no $folder/intel: tests/devices/environment.sh makes it"; exit 77; }
    export OCL_ICD_VENDORS=$folder/intel/vendors LD_LIBRARY_PATH=$folder/intel/lib
    ;;
oclgrind)
    command -v oclgrind >/dev/null || { echo "no oclgrind (Debian, Ubuntu: oclgrind)"; exit 77; }
    log=$(mktemp)
    trap 'rm -f "$log"' EXIT
    largest=$((largest ? 12 : 24))
    command=(oclgrind --data-races --log "$log" "$check")
    ;;
pocl) ;;
*) echo "there is no implementation '$implementation'" >&2 && exit 2 ;;
esac

status=0
"${command[@]}" --largest "$largest" || status=1
[ "$implementation$largest" != intel0 ] || "$check" --mode compile || status=1
# what Oclgrind finds is in its log: races, reads and writes outside, divergence at barriers
if [ -s "$log" ]; then
    head -n 40 "$log"
    status=1
fi
exit $status
