/* Hadalens: OpenCL devices and contexts.
 *
 * Threads: different contexts are independent; all functions of one context may be called from any thread. */
#ifndef HADALENS_DEVICE_H
#define HADALENS_DEVICE_H

#include <hadalens/monitor.h>
#include <hadalens/status.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_device_kind {
    HADA_DEVICE_CPU = 1,
    HADA_DEVICE_GPU = 2,
    HADA_DEVICE_ACCELERATOR = 3, /* FPGA */
    HADA_DEVICE_OTHER = 4
} hada_device_kind;

/* What matters about a device. `quirks` says in words what the library does differently there, and why. */
typedef struct hada_device_info {
    int index; /* its number in the list, as --device takes it */
    hada_device_kind kind;
    char name[256], vendor[128], driver[128], version[128], platform[128];
    unsigned compute_units, clock_mhz;
    uint64_t memory_bytes, max_allocation_bytes, local_memory_bytes;
    size_t max_work_group;
    unsigned alignment_bytes;
    int has_compiler;     /* 0: only offline binaries run here (FPGA) */
    int has_local_memory; /* real on-chip local memory, not ordinary memory */
    int has_double, has_half_arithmetic, unified_memory;
    unsigned max_sub_devices;
    int part, parts; /* a context on a part of a device: which one, from 1 on, of how many; 0, 0: the whole */
    char quirks[1024];
} hada_device_info;

/* All OpenCL devices, in the order of their index; platforms without devices are skipped. HADA_ERROR_NO_DEVICE when
 * there is none (the message says which packages bring one). What hada_device_list_get() gives belongs to the list;
 * NULL beyond its last. */
typedef struct hada_device_list hada_device_list;
HADA_API hada_status hada_device_list_create(hada_device_list **out, hada_error *err);
HADA_API size_t hada_device_list_count(const hada_device_list *list);
HADA_API const hada_device_info *hada_device_list_get(const hada_device_list *list, size_t index);
HADA_API void hada_device_list_destroy(hada_device_list **list);

typedef struct hada_context hada_context;

/* The shape that kernels take on a device: both compute the same, to rounding. */
typedef enum hada_kernel_shape {
    HADA_SHAPE_LANES = 0, /* vectors in one work-item, work-groups of one, no barriers: CPUs, FPGAs */
    HADA_SHAPE_GROUPS = 1 /* work-groups with local memory and barriers: GPUs */
} hada_kernel_shape;

typedef enum hada_log_level { HADA_LOG_WARNING = 1, HADA_LOG_INFO = 2, HADA_LOG_TRACE = 3 } hada_log_level;

/* Receives messages; may be called from any thread, must not call back into the context. */
typedef void (*hada_log_function)(void *user, hada_log_level level, const char *message);

typedef struct hada_context_options {
    size_t size; /* sizeof(hada_context_options), for later versions */
    /* Which device: its index ("0"), a kind ("cpu", "gpu", "accelerator") or a part of its name, case ignored.
     * NULL: the environment variable HADALENS_DEVICE, else the first GPU, else the first accelerator that has its
     * binaries, else the first CPU. A part of a device is named by ":PART/PARTS" behind it, such as "0:1/2". */
    const char *device;
    /* The part-th (from 1 on) of `parts` sub-devices with as many compute units each, as nearly as that goes; 0, 0:
     * what `device` says, the whole otherwise. HADA_ERROR_DEVICE_CHOICE where the device cannot be divided so. */
    int part, parts;
    /* Folder of offline binaries made by hada_programs_save(); NULL: the environment variable HADALENS_BINARIES, else
     * none. When given, nothing is compiled: a kernel missing there is an error. */
    const char *binaries;
    /* Folder of the disk cache of compiled programs. NULL: HADALENS_CACHE, else $XDG_CACHE_HOME/hadalens, else
     * ~/.cache/hadalens, but none where the driver has a cache of its own; "" or the value "off": no cache. A cache
     * that cannot be used is never an error. */
    const char *cache;
    /* Text file of tuning choices that override the shipped tables (hadalens/tune.h); NULL: HADALENS_TUNING, else none.
     * A file that is not there is none; a line that cannot be understood is HADA_ERROR_FILE_FORMAT. */
    const char *tuning;
    hada_log_function log;
    void *log_user;
    hada_log_level log_level;
    int skip_self_test; /* for the tests of the self-test */
    /* A hada_kernel_shape. HADA_AUTO: what the environment variable HADALENS_SHAPE names ("lanes" or "groups"), else
     * groups on GPUs and lanes elsewhere. */
    int shape;
    /* Asked by what measures the device (hada_tune_fft(), hada_device_peaks(), hada_device_call_costs()) whether to
     * stop: HADA_ERROR_CANCELLED then. As long as the context is. NULL: nobody. */
    const hada_monitor *monitor;
} hada_context_options;

HADA_INIT(hada_context_options, HADA_STRUCT_CONTEXT_OPTIONS)

/* Opens a device and checks it with known answers before its first work (HADA_ERROR_SELF_TEST where it computes
 * wrong results). `options` may be NULL. *out is NULL on failure. */
HADA_API hada_status hada_context_create(hada_context **out, const hada_context_options *options, hada_error *err);

/* Frees everything and clears the pointer. Objects made from the context must be destroyed before. */
HADA_API void hada_context_destroy(hada_context **context);

/* The device, owned by the context. */
HADA_API const hada_device_info *hada_context_device(const hada_context *context);

/* What a context does and holds now. */
typedef struct hada_context_info {
    size_t size; /* sizeof(hada_context_info), set by the caller */
    hada_kernel_shape shape;
    unsigned programs_compiled; /* from source so far (offline runs must show 0) */
    unsigned programs_loaded;   /* as binaries */
    uint64_t bytes, peak_bytes; /* of device memory: held now, and the most since the last reset */
} hada_context_info;
HADA_API hada_status hada_context_get_info(const hada_context *context, hada_context_info *info, hada_error *err);
HADA_API void hada_context_reset_peak(hada_context *context);

/* Builds every kernel of the library for the context's device and writes the binaries with a manifest into `folder`
 * (created when missing), for machines or devices that cannot compile. `monitor` (may be NULL) sees every program and
 * may stop: HADA_ERROR_CANCELLED then, and the folder holds what was built before, each file whole. With PoCL all of it
 * takes minutes. */
HADA_API hada_status hada_programs_save(hada_context *context, const char *folder, const hada_monitor *monitor,
                                        hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
