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

/* Whether the context's shape needs a program. */
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

typedef struct hada_program_entry hada_program_entry;

struct hada_program_store {
    pthread_mutex_t lock; /* held for looking up, making and adding: a program is made once */
    hada_program_entry *entries;
    char *binaries; /* folder of offline binaries, NULL: compile */
    char *cache;    /* folder of the disk cache, NULL: off */
    unsigned compiled, loaded;
};

/* The embedded text of a kernel file as one string, on the heap. */
hada_status hada_kernel_text(char **out, const char *file, hada_error *err);

/* The file name of a program's binary: "<file>-<hash>.bin"; the hash covers the flattened text,
 * the macros, device, driver, platform and the library's version. */
hada_status hada_program_key(const hada_context *context, const char *file, const char *options, const char *text,
                             char *out, size_t size, hada_error *err);

/* Reads a binary written by hada_binary_write(): *bytes is 0 and the status HADA_OK where there is no such file or it
 * is not ours or damaged (the checksum does not hold). *out is freed with free(). */
hada_status hada_binary_read(const char *folder, const char *name, unsigned char **out, size_t *bytes, hada_error *err);

/* Writes beside and renames, so that a reader never sees half a file. */
hada_status hada_binary_write(const char *folder, const char *name, const unsigned char *data, size_t bytes,
                              hada_error *err);

/* Makes a folder and its parents. A cache belongs to this user alone, since its programs are run. */
enum { HADA_OURS_ALONE = 0700 };
hada_status hada_folder_make(const char *folder, unsigned mode, hada_error *err);

/* Removes files of PoCL's own cache that a loss of power has left empty or cut, once for each start of the machine. */
void hada_driver_cache_mend(hada_context *context);

/* The device binary of a built program; *out is freed with free(). */
hada_status hada_program_binary(cl_program program, unsigned char **out, size_t *bytes, hada_error *err);

/* A program from source text. */
hada_status hada_program_compile(hada_context *context, const char *file, const char *options, const char *text,
                                 cl_program *out, hada_error *err);

#endif
