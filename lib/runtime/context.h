/* A context: its device, its OpenCL context, its quirks, its log and its count of memory; and the list of devices.
 * Internal. */
#ifndef HADA_RUNTIME_CONTEXT_H
#define HADA_RUNTIME_CONTEXT_H

#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include <hadalens/device.h>
#include <pthread.h>
#include <stdatomic.h>

#include "core/base.h"

/* What the library does differently on a device; filled from the table in devices.c. */
typedef struct hada_quirks {
    unsigned own_disk_cache : 1; /* the driver caches programs well itself: keep ours off */
    unsigned avoid_clfft : 1;    /* clFFT gives wrong results or cannot build here */
    unsigned stated_local : 1;   /* local memory of arguments is laid out when compiling (shared_local.h) */
    unsigned host_pages : 1;     /* buffers in huge-page host memory (CL_MEM_USE_HOST_PTR) are faster */
    unsigned no_parts : 1;       /* buffers are not divided into parts (clCreateSubBuffer) */
} hada_quirks;

typedef struct hada_program_store hada_program_store; /* runtime/program.h */
typedef struct hada_tuning hada_tuning;               /* runtime/tuning.h */

/* A size of transforms that another library was tried on. */
typedef struct hada_trial {
    int rows, cols, works;
    struct hada_trial *next;
} hada_trial;

enum { HADA_HANDLES = 1024 };

struct hada_context {
    /* not NULL: objects made with it are only counted, for this context's device (runtime/memory.h) */
    const hada_context *dry;
    cl_platform_id platform;
    cl_device_id device;
    int adopted; /* the device is the caller's, and held as long as the context is */
    cl_context cl;
    hada_device_info info;
    hada_kernel_shape shape; /* which variant of an operation to use */
    unsigned vector_floats;  /* how many floats the device's vectors hold, as it says itself */
    int tensor_cores;        /* for TF32, by inline PTX: NVIDIA's GPUs of compute capability 8.0 and later */
    atomic_int tf32;         /* whether convolutions may use them (net/conv_tf32.c) */
    hada_quirks quirks;
    hada_program_store *programs;
    hada_tuning *tuning; /* NULL where none */

    hada_log_function log;
    void *log_user;
    hada_log_level log_level;
    const hada_monitor *monitor; /* for what measures the device; NULL: nobody */

    /* How many buffers were released, and for handles by their hash which was the last of them: a driver may give
     * another buffer the same handle. Written under the lock. */
    atomic_ulong releases, released[HADA_HANDLES];

    pthread_mutex_t lock; /* guards what is below */
    uint64_t bytes, peak_bytes;
    hada_trial *trials;     /* of clFFT (fft/fft.c) */
    cl_command_queue queue; /* the first one, for slots that the device gives none (runtime/slot.c) */
};

/* Sends a message to the context's log function, when its level is asked for. */
void hada_log(const hada_context *context, hada_log_level level, const char *format, ...) HADA_PRINTF(3, 4);

/* A device of a platform. All devices of all platforms are listed in a fixed order. */
typedef struct hada_platform_device {
    cl_platform_id platform;
    cl_device_id device;
} hada_platform_device;

/* *out is freed with free(). */
hada_status hada_platform_devices(hada_platform_device **out, size_t *count, hada_error *err);

/* Fills info for a device. */
hada_status hada_device_describe(cl_platform_id platform, cl_device_id device, int index, hada_device_info *info,
                                 hada_error *err);

/* Looks the device up in the table of quirks; also writes the reasons into info->quirks. */
void hada_quirks_find(hada_device_info *info, hada_quirks *quirks);

/* A part of a device, as a device. It is never released; a second call returns the same part. */
hada_status hada_device_divide(cl_device_id device, const hada_device_info *info, int part, int parts,
                               cl_device_id *out, hada_error *err);

/* Reads and cuts off ":PART/PARTS" at the end of words for a device; part and parts stay as they are where there is
 * none. */
hada_status hada_device_part(char *words, int *part, int *parts, hada_error *err);

/* The index in `infos` that `words` means: an index, a kind, or a part of a name; NULL or "": the first GPU, else the
 * first accelerator when binaries are at hand, else the first CPU, else the first of all. */
hada_status hada_device_choose(const hada_device_info *infos, size_t count, const char *words, int have_binaries,
                               size_t *out, hada_error *err);

/* Integer sums through local memory and barriers, complex products in vector lanes, half as storage: all exact.
 * HADA_ERROR_SELF_TEST names the test that failed. */
hada_status hada_self_test(hada_context *context, hada_error *err);

/* Memory of its buffers, now and at most so far. */
uint64_t hada_context_bytes(const hada_context *context);
uint64_t hada_context_peak_bytes(const hada_context *context);

#endif
