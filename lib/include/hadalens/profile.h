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
 * by hada_memory_destroy(). Of several queues and devices together. HADA_ERROR_STATE while profiling is off. */
HADA_API hada_status hada_plan_kernel_times(hada_plan *plan, hada_kernel_time **rows, size_t *count, hada_error *err);

/* What a plan asked of its devices; always counted. The time of a frame on a quick device is bound by these calls as
 * much as by its arithmetic. */
typedef struct hada_call_counts {
    uint64_t launches;           /* of kernels; those of clFFT are not seen */
    uint64_t transfers;          /* reads, writes, fills, copies, maps */
    uint64_t waits;              /* of the host, for a device */
    uint64_t arguments;          /* of kernels, set where they change */
    double bytes_up, bytes_down; /* from host to device, and back */
} hada_call_counts;

/* Since the plan was made, by all its queues together. */
HADA_API hada_status hada_plan_calls(const hada_plan *plan, hada_call_counts *counts, hada_error *err);

/* Measures what calls cost on a context's device, in a fraction of a second: the launch of a kernel that does next to
 * nothing, among many; what it takes longer where the host waits for it; and the traffic of a large write to the
 * device. The best of several runs. Any pointer may be NULL. */
HADA_API hada_status hada_device_call_costs(hada_context *context, double *launch_seconds, double *wait_seconds,
                                            double *write_bytes_per_second, hada_error *err);

/* Measures the ceilings of a context's device by kernels made for it, in a second or two: the traffic of a copy
 * that is larger than caches (bytes read plus bytes written), and float32 arithmetic in registers (a fused multiply-add
 * counts as two). The best of several runs, since a ceiling is wanted. Either pointer may be NULL. */
HADA_API hada_status hada_device_peaks(hada_context *context, double *copy_bytes_per_second, double *flops_per_second,
                                       hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
