/* What every source file of the library uses: headers of the C library, errors, memory. Internal. */
#ifndef HADA_CORE_BASE_H
#define HADA_CORE_BASE_H

#include <hadalens/status.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__GNUC__)
#define HADA_PRINTF(f, a) __attribute__((format(printf, f, a)))
#else
#define HADA_PRINTF(f, a)
#endif

/* Fills *err (when not NULL). hada_fail() is the usual way to call it. */
void hada_error_set(hada_error *err, hada_status status, const char *format, ...) HADA_PRINTF(3, 4);

/* Fills *err and is `status`, so that a function can end with `return hada_fail(err, HADA_ERROR_SIZE, "...", ...)`.
 * Messages say what to do. It is a macro so that analysers see that the status is an error. */
#define hada_fail(err, status, ...) (hada_error_set(err, status, __VA_ARGS__), hada_status_itself(status))
static inline hada_status hada_status_itself(hada_status status) /* a value may be left unused, a bare name may not */
{
    return status;
}

/* As hada_fail, for a failed OpenCL call: `call` names it, `code` is what it returned. Out-of-memory codes become
 * HADA_ERROR_DEVICE_MEMORY, others HADA_ERROR_DEVICE. */
void hada_error_set_cl(hada_error *err, int code, const char *call);
int hada_cl_is_memory(int code);
static inline hada_status hada_fail_cl(hada_error *err, int code, const char *call)
{
    hada_error_set_cl(err, code, call);
    return hada_cl_is_memory(code) ? HADA_ERROR_DEVICE_MEMORY : HADA_ERROR_DEVICE;
}

/* Passes an error on: returns it at once. */
#define HADA_TRY(call)                                                                                                 \
    do {                                                                                                               \
        const hada_status try_status = (call);                                                                         \
        if (try_status)                                                                                                \
            return try_status;                                                                                         \
    } while (0)

/* The same in a function that holds something: goes to its one exit, `done:`, which frees that and returns `status`
 * (declared as HADA_OK). What the exit frees is declared, empty, before the first of these. */
#define HADA_TRY_OR_DONE(call)                                                                                         \
    do {                                                                                                               \
        status = (call);                                                                                               \
        if (status)                                                                                                    \
            goto done;                                                                                                 \
    } while (0)

/* For the pointers that a public function needs: HADA_NEED(out && model, err). Returns HADA_ERROR_ARGUMENT where one is
 * NULL. */
#define HADA_NEED(pointers, err)                                                                                       \
    do {                                                                                                               \
        if (!(pointers))                                                                                               \
            return hada_fail(err, HADA_ERROR_ARGUMENT, "%s: a pointer is NULL that is needed (%s)", __func__,          \
                             #pointers);                                                                               \
    } while (0)

/* What a file says is no fault of the call: errors of arguments and of what is not offered become those of a file. */
hada_status hada_error_of_file(hada_status status, hada_error *err);

/* Puts context before the message of a record that a callee filled: "reading x.tif: <message>". */
void hada_error_prefix(hada_error *err, const char *format, ...) HADA_PRINTF(2, 3);

/* The name of an OpenCL error code, such as "CL_OUT_OF_RESOURCES". */
const char *hada_cl_code_name(int code);

/* Host memory with overflow checks and error messages. */

/* count*size zeroed bytes (at least one byte), to be freed with free(). NULL on failure, and then the message says how
 * much was asked for and what for (`what`, such as "the raw frame"). */
void *hada_alloc(size_t count, size_t size, const char *what, hada_error *err);

/* As hada_alloc, aligned to 64 bytes and not zeroed: for large arrays that are written at once. */
void *hada_alloc_raw(size_t count, size_t size, const char *what, hada_error *err);

/* The status of an allocation: HADA_TRY(hada_allocated(pointer = hada_alloc(...))). */
static inline hada_status hada_allocated(const void *pointer)
{
    return pointer ? HADA_OK : HADA_ERROR_MEMORY;
}

/* Allocates `count` zeroed elements for a pointer; a status: HADA_TRY(HADA_NEW(rows, count, "the rows", err)). RAW:
 * aligned and not zeroed, as hada_alloc_raw. */
#define HADA_NEW(pointer, count, what, err) hada_allocated((pointer) = hada_alloc(count, sizeof *(pointer), what, err))
#define HADA_NEW_RAW(pointer, count, what, err)                                                                        \
    hada_allocated((pointer) = hada_alloc_raw(count, sizeof *(pointer), what, err))

/* Room for `more` elements of an array behind the `held` ones, which stay, also where memory is short: HADA_TRY(
 * HADA_GROW(rows, count, 1, "the rows", err)). Grows when full, to powers of two; nothing else may allocate it. */
hada_status hada_grow(void *place, size_t held, size_t more, size_t size, const char *what, hada_error *err);
#define HADA_GROW(pointer, held, more, what, err) hada_grow(&(pointer), held, more, sizeof *(pointer), what, err)

/* free() of each of some pointers: HADA_FREE(rows, sums). */
#define HADA_FREE(...) hada_free_each((void *[]){__VA_ARGS__}, HADA_COUNT(((void *[]){__VA_ARGS__})))
void hada_free_each(void *const *pointers, size_t count);

/* Takes a pointer out of its place, for functions that destroy: returns it and leaves NULL there; NULL where `place` is
 * NULL. place: the address of a pointer of any type. */
static inline void *hada_taken(void *place)
{
    void *pointer = NULL;
    if (place) {
        memcpy(&pointer, place, sizeof pointer);
        memset(place, 0, sizeof pointer);
    }
    return pointer;
}

static inline int hada_least(int a, int b)
{
    return a < b ? a : b;
}

static inline int hada_most(int a, int b)
{
    return a > b ? a : b;
}

/* The nearest of 0 to count - 1. */
static inline int hada_within(int i, int count)
{
    return i < 0 ? 0 : i < count ? i : count - 1;
}

/* Number k of `count` that are spread evenly over 0 to all - 1, from the first to the last. */
static inline int hada_spread(int k, int count, int all)
{
    return count > 1 ? k * (all - 1) / (count - 1) : 0;
}

/* The top of a parabola through three values a step apart, the middle one the largest, in steps from it. */
static inline double hada_parabola_top(double before, double here, double after)
{
    const double bend = before - 2.0 * here + after;
    return bend < 0.0 ? 0.5 * (before - after) / bend : 0.0;
}

/* The scalar product of two arrays, in double and in order. */
double hada_product(const float *a, const float *b, size_t count);

/* For qsort(): doubles, ascending; and the median of some, which are sorted: NaN of none. */
int hada_ascending(const void *a, const void *b);
double hada_median(double *values, size_t count);

/* A copy of a string, NULL when memory is short. */
char *hada_string_copy(const char *text);

/* count*size, or SIZE_MAX where that overflows. */
size_t hada_size_product(size_t count, size_t size);

#define HADA_COUNT(array) (sizeof(array) / sizeof *(array))

/* Whether this machine stores the low byte of a number first. */
#define HADA_LITTLE_ENDIAN (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__)

/* How many parts of `part` it takes to hold n. */
static inline size_t hada_divide_up(size_t n, size_t part)
{
    return (n + part - 1) / part;
}

/* n rounded up to a multiple of `part`. */
static inline size_t hada_round_up(size_t n, size_t part)
{
    return hada_divide_up(n, part) * part;
}

#endif
