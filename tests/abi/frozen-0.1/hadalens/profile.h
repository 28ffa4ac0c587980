/* Hadalens: where the time of a plan goes, kernel by kernel, and what a device could do at best.
 *
 * With profiling on, every launch and transfer of a plan keeps the times of its event; they are added up by stage and
 * kernel. Beside the seconds stand the least traffic and arithmetic that the work needs, each value of input and output
 * moved once, so that seconds / bytes and seconds / flops can be held against the device's peaks (the roofline model:
 * S. Williams, A. Waterman, D. Patterson, Communications of the ACM 52(4), 65 (2009)). Caches may serve part of that
 * traffic, so a kernel on small data can stand above the line of memory.
 *
 * Threads: the functions of one plan must not be called while it runs a frame. */
#ifndef HADALENS_PROFILE_H
#define HADALENS_PROFILE_H

#include <hadalens/device.h>
#include <hadalens/reconstruct.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A kernel, or a kind of transfer, within a stage. */
typedef struct hada_kernel_time {
    char name[64];  /* the kernel's; of transfers "write" (to the device), "read", "copy", "fill" */
    char stage[32]; /* as in hada_report: "upload", "linear", "pursuit", "refine", "enhance", "focus", "download"; or
                       "other" */
    int transfer;   /* 1: no kernel */
    uint64_t launches;
    double seconds; /* event start to event end, added up */
    double bytes;   /* least traffic with the device's memory */
    double flops;   /* least additions and multiplications; 0 where a kernel has none to speak of */
} hada_kernel_time;

/* Turns profiling of a plan on, from nothing, or off, which forgets. Off by default. */
HADA_API hada_status hada_plan_profile(hada_plan *plan, int on, hada_error *err);

/* What the plan's queues did since profiling was turned on: *count rows in the order of first use, given back
 * by hada_kernel_times_destroy(). Of several queues and devices together. HADA_ERROR_STATE while profiling is off. */
HADA_API hada_status hada_plan_kernel_times(hada_plan *plan, hada_kernel_time **rows, size_t *count, hada_error *err);
/* Frees the rows and clears the pointer; NULL is fine. */
HADA_API void hada_kernel_times_destroy(hada_kernel_time **rows);

/* Measures the ceilings of a context's device by kernels made for it, in a second or two: the traffic of a copy
 * that is larger than caches (bytes read plus bytes written), and float32 arithmetic in registers (a fused multiply-add
 * counts as two). The best of several runs, since a ceiling is wanted. Either pointer may be NULL. */
HADA_API hada_status hada_device_peaks(hada_context *context, double *copy_bytes_per_second, double *flops_per_second,
                                       hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
