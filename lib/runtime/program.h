/* Programs: one function that either compiles a kernel file or loads an offline binary. Internal. */
#ifndef HADA_RUNTIME_PROGRAM_H
#define HADA_RUNTIME_PROGRAM_H

#include "runtime/device.h"

/* The text of a kernel file, includes flattened, embedded in the library at build time (see cmake/embed.cmake). */
typedef struct hada_kernel_source {
    const char *file; /* name without suffix */
    const char *const *lines;
    size_t line_count;
} hada_kernel_source;
extern const hada_kernel_source hada_kernel_sources[];
extern const size_t hada_kernel_source_count;

/* A row of kernels/manifest.txt: a program that a device needs, as file and macros. */
typedef struct hada_manifest_row {
    const char *file, *options;
    const char *shapes; /* "lanes", "groups" or "all": which devices need it */
} hada_manifest_row;
extern const hada_manifest_row hada_manifest[];
extern const size_t hada_manifest_count;

hada_status hada_program_store_create(hada_context *context, const hada_context_options *options, hada_error *err);
void hada_program_store_destroy(hada_context *context);

/* Whether anything can be compiled here: the device has a compiler, and no folder of offline binaries was given. */
int hada_program_can_compile(const hada_context *context);

/* The program for a file and its macros, made at first use: from the store's memory, from the folder of offline
 * binaries when one was given (then never compiled), from the disk cache, or compiled. Thread-safe. The store keeps
 * the reference. */
hada_status hada_program_get(hada_context *context, const char *file, const char *options, cl_program *out,
                             hada_error *err);

#endif
