/* Programs: one function that either compiles a kernel file or loads an offline binary. Internal. */
#ifndef HADA_RUNTIME_PROGRAM_H
#define HADA_RUNTIME_PROGRAM_H

#include "runtime/context.h"

/* A row of kernels/manifest.txt: a program that a device needs. */
typedef struct hada_program_row {
    const char *name;
    const char *macros; /* "-DNAME=NUMBER ..." or "" */
    const char *shapes; /* "lanes", "groups", "tensor_cores" (groups that have them) or "all": which devices need it */
} hada_program_row;

/* Of a file whose programs are DEFAULT (vectors of eight values), SCALAR (value by value) and GROUPS (work-groups of a
 * GPU), the one for a device; vectors: whether the data consist of whole ones. */
#define HADA_PROGRAM_VARIANT(FILE, context, vectors)                                                                   \
    ((context)->shape == HADA_SHAPE_GROUPS ? HADA_PROGRAM_##FILE##_GROUPS                                              \
     : (vectors)                           ? HADA_PROGRAM_##FILE##_DEFAULT                                             \
                                           : HADA_PROGRAM_##FILE##_SCALAR)

/* Whether a program serves the context's shape. */
int hada_program_serves(const hada_context *context, const hada_program_row *row);

typedef struct hada_kernel hada_kernel; /* runtime/launch.h */

/* A kernel file, embedded in the library at build time (cmake/kernels.py): its text with includes flattened, its
 * kernels, and its programs as the manifest lists them. */
typedef struct hada_kernel_file {
    const char *name;          /* without suffix */
    const char *const *pieces; /* one after the other */
    size_t piece_count;
    const hada_kernel *const *kernels;
    int kernel_count;
    const hada_program_row *programs;
    int program_count;
    const int *macro_values; /* [program][macro] */
    int macro_count;
    int first_object; /* of its kernel objects in a slot: [program][kernel] */
} hada_kernel_file;
extern const hada_kernel_file *const hada_kernel_files[];
extern const int hada_kernel_file_count;
extern const int hada_kernel_object_count; /* of all files */

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
