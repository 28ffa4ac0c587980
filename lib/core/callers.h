/* What callers hand in: structs that carry their size, images, monitors, communicators. Internal.
 *
 * Structs that carry their size pass between callers and libraries of different versions. Their first member is
 * `size_t size`, and new members are only added at the end (CONTRIBUTING.md). hadalens/base.h states the rule for
 * callers. */
#ifndef HADA_CORE_CALLERS_H
#define HADA_CORE_CALLERS_H

#include <hadalens/communicator.h>
#include <hadalens/image.h>
#include <hadalens/monitor.h>

#include "core/base.h"

/* The first `size` bytes of the caller's struct become those of `own`, which has `own_size` bytes, and zero behind
 * them; its size member becomes `size`. For defaults, and for reports. */
void hada_sized_give(void *callers, size_t size, const void *own, size_t own_size);

/* Takes the caller's options over into *own, which holds the defaults (all of them stay where `callers` is NULL, and
 * those that the caller does not know). `type` is the struct's name.
 * HADA_ERROR_ARGUMENT where the caller's size cannot be one, HADA_ERROR_UNSUPPORTED where it sets what this library
 * does not know. */
hada_status hada_sized_take(void *own, size_t own_size, const void *callers, const char *type, hada_error *err);

/* Whether a report that is to be filled has a size. HADA_ERROR_ARGUMENT where not; NULL is none to fill, and right. */
hada_status hada_sized_check(const void *callers, size_t own_size, const char *type, hada_error *err);

#define HADA_REPORT_CHECK(callers, type, err) hada_sized_check(callers, sizeof(type), #type, err)
#define HADA_REPORT_GIVE(callers, own)        hada_sized_give(callers, (callers)->size, own, sizeof *(own))
/* The defaults, and over them the caller's options; for structs whose init takes the struct alone. */
#define HADA_OPTIONS_TAKE(own, callers, type, err)                                                                     \
    (type##_init(own), hada_sized_take(own, sizeof *(own), callers, #type, err))

/* For the images that a public function reads: HADA_NEED_IMAGE(image, out, err). Returns HADA_ERROR_ARGUMENT where
 * there is none, or sizes without pixels, and where it is *out, which the function makes; out NULL: it makes none. */
#define HADA_NEED_IMAGE(image, out, err) HADA_TRY(hada_image_check(image, out, __func__, #image, err))
hada_status hada_image_check(const hada_image *image, const hada_image *out, const char *function, const char *name,
                             hada_error *err);

/* Passes a message on; `monitor` may be NULL. */
void hada_monitor_tell(const hada_monitor *monitor, hada_message kind, const char *format, ...) HADA_PRINTF(3, 4);

/* HADA_ERROR_CANCELLED where the caller wants to stop. */
hada_status hada_monitor_check(const hada_monitor *monitor, hada_error *err);

/* A stretch of work of `total` steps, 0: not known beforehand. It must be ended. */
typedef struct hada_progress {
    const hada_monitor *monitor;
    const char *what;
    long done, total;
} hada_progress;

hada_progress hada_progress_begin(const hada_monitor *monitor, const char *what, long total);
/* One step is done. HADA_ERROR_CANCELLED where the caller wants to stop. */
hada_status hada_progress_step(hada_progress *progress, const char *note, hada_error *err);
void hada_progress_end(hada_progress *progress);

/* Ranks exchange data through the caller's communicator. With NULL or one rank nothing is exchanged. */
static inline int hada_ranks(const hada_communicator *of)
{
    return of ? of->count : 1;
}

static inline int hada_rank(const hada_communicator *of)
{
    return of ? of->rank : 0;
}

/* Whether the n-th of equal pieces of work is this rank's: they are dealt out. */
static inline int hada_is_mine(const hada_communicator *of, long n)
{
    return n % hada_ranks(of) == hada_rank(of);
}

/* Whose it is. */
static inline int hada_owner(const hada_communicator *of, long n)
{
    return (int)(n % hada_ranks(of));
}

/* The first index of a rank's share of `count` consecutive items; the share ends at that of rank + 1. */
static inline long hada_share_begin(const hada_communicator *of, long count, int rank)
{
    return (long)((long long)count * rank / hada_ranks(of));
}

/* What the caller's communicator must be; NULL is one. */
hada_status hada_communicator_check(const hada_communicator *callers, hada_error *err);

hada_status hada_reduce(const hada_communicator *of, double *values, size_t count, hada_error *err);
hada_status hada_reduce_floats(const hada_communicator *of, float *values, size_t count, hada_error *err);
hada_status hada_broadcast(const hada_communicator *of, int root, void *bytes, size_t count, hada_error *err);

#endif
