/* Structs that carry their size, between callers and libraries of different versions. Internal.
 *
 * The first member of such a struct is `size_t size`, and new members only ever come behind the last one
 * (CONTRIBUTING.md). hadalens/base.h has the rule as callers see it. */
#ifndef HADA_CORE_OPTIONS_H
#define HADA_CORE_OPTIONS_H

#include <stddef.h>

#include "core/error.h"

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

#define HADA_REPORT_CHECK(callers, type, err)      hada_sized_check(callers, sizeof(type), #type, err)
#define HADA_REPORT_GIVE(callers, own)             hada_sized_give(callers, (callers)->size, own, sizeof *(own))
#define HADA_OPTIONS_GIVE(callers, size, own)      hada_sized_give(callers, size, own, sizeof *(own))
#define HADA_OPTIONS_TAKE(own, callers, type, err) hada_sized_take(own, sizeof *(own), callers, #type, err)

#endif
