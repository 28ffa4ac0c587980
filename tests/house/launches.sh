#!/bin/sh
# A launch with a wrong argument does not compile: tries each kind of mistake, and launches that are right.
# launches.sh SOURCE_FOLDER GENERATED_FOLDER COMPILER CHECKS...   (CHECKS: what CMakeLists.txt gives the library)
set -u
root=$1 generated=$2 compiler=$3
shift 3
checks=$*
work=$(mktemp -d) || exit 1
trap 'rm -rf "$work"' EXIT
status=0

# compiles PROGRAM ARGUMENTS, for the kernel in $kernel
compiles() {
    cat >"$work/try.c" <<END
#include "launch/refine.h"
#include "launch/refine_tv.h"
#include "launch/selftest.h"
#include "launch/optics_wave_whole.h"
extern cl_mem a;
extern hada_ints ints;
extern hada_halves halves;
extern hada_wave_pixel_array pixels;
extern hada_local part;
extern const float *host;
extern double number;
extern hada_refine_window window;
extern hada_refine_crop crop;
hada_status attempt(hada_slot *slot, const hada_range *range, hada_error *err);
hada_status attempt(hada_slot *slot, const hada_range *range, hada_error *err)
{
    return hada_launch_$kernel(slot, $1, range, err, $2);
}
END
    # shellcheck disable=SC2086 # several words
    "$compiler" -std=c11 -D_GNU_SOURCE -Wall -Wextra $checks -I"$root/lib/include" -I"$root/lib" -I"$generated" \
        -fsyntax-only "$work/try.c" >"$work/log" 2>&1
}
right() {
    compiles "$2" "$3" || { echo "this does not compile: $1"; cat "$work/log"; status=1; }
}
wrong() {
    ! compiles "$2" "$3" || { echo "this compiles: $1"; status=1; }
}

kernel=refine_tv_planes program=HADA_PROGRAM_REFINE_TV_SCALAR
right "a launch" $program '.planes = a, .duals = a, .window = window, .theta = 1.0f'
right "in another order" $program '.theta = 1.0f, .window = window, .duals = a, .planes = a'
right "a program by its macros" 'hada_find_refine_tv(.refine_width = 1, .refine_group = 64)' \
    '.planes = a, .duals = a, .window = window, .theta = 1.0f'
wrong "one left out" $program '.planes = a, .duals = a, .window = window'
wrong "one too many" $program '.planes = a, .duals = a, .window = window, .theta = 1.0f, .step = 1.0f'
wrong "an unknown name" $program '.planes = a, .dual = a, .window = window, .theta = 1.0f'
wrong "one named twice" $program '.planes = a, .planes = a, .window = window, .theta = 1.0f'
wrong "a number for a buffer" $program '.planes = 1, .duals = a, .window = window, .theta = 1.0f'
wrong "a pointer of the host" $program '.planes = host, .duals = a, .window = window, .theta = 1.0f'
wrong "a buffer for a number" $program '.planes = a, .duals = a, .window = window, .theta = a'
wrong "a double for a float" $program '.planes = a, .duals = a, .window = window, .theta = number'
wrong "another struct" $program '.planes = a, .duals = a, .window = crop, .theta = 1.0f'
wrong "another file's program" HADA_PROGRAM_REFINE_SCALAR '.planes = a, .duals = a, .window = window, .theta = 1.0f'
wrong "a macro left out" 'hada_find_refine_tv(.refine_width = 1)' \
    '.planes = a, .duals = a, .window = window, .theta = 1.0f'
right "no buffer" $program '.planes = a, .duals = NULL, .window = window, .theta = 1.0f'
wrong "a buffer of integers for one of floats" $program '.planes = a, .duals = ints, .window = window, .theta = 1.0f'

kernel=selftest_sum program=HADA_PROGRAM_SELFTEST_DEFAULT
right "buffers of integers" $program '.in = ints, .out = ints, .part = part'
wrong "a buffer of floats for one of integers" $program '.in = ints, .out = a, .part = part'
wrong "a buffer of halves for one of integers" $program '.in = ints, .out = halves, .part = part'

kernel=optics_wave_sensor_rows program=HADA_PROGRAM_OPTICS_WAVE_WHOLE_DEFAULT
right "a buffer of structs" $program '.part = a, .field = a, .table = pixels, .rows = 1, .cols = 1, .pixels = 1'
wrong "a buffer of floats for one of structs" $program \
    '.part = a, .field = a, .table = a, .rows = 1, .cols = 1, .pixels = 1'
exit $status
