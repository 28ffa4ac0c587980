/* The parts of the program store. Internal to lib/runtime. */
#ifndef HADA_RUNTIME_STORE_H
#define HADA_RUNTIME_STORE_H

#include "runtime/program.h"

typedef struct hada_program_entry {
    char *file, *options;
    cl_program program;
    struct hada_program_entry *next;
} hada_program_entry;

struct hada_program_store {
    pthread_mutex_t lock; /* held for looking up, making and adding: a program is made once */
    hada_program_entry *entries;
    char *binaries; /* folder of offline binaries, NULL: compile */
    char *cache;    /* folder of the disk cache, NULL: off */
    unsigned compiled, loaded;
};

/* The embedded text of a kernel file as one string (freed by the caller), NULL where there is none or no memory. */
char *hada_kernel_text(const char *file);

/* Why hada_kernel_text() gave NULL. */
hada_status hada_kernel_text_missing(const char *file, hada_error *err);

/* The name under which a program's binary stands in a folder: "<file>-<hash>.bin"; the hash covers the flattened text,
 * the macros, device, driver, platform and the library's version. */
hada_status hada_program_key(const hada_context *context, const char *file, const char *options, const char *text,
                             char *out, size_t size, hada_error *err);

/* Reads a binary written by hada_binary_write(): *bytes is 0 and the status HADA_OK where there is no such file or it
 * is not ours or damaged (the checksum does not hold). *out is freed with free(). */
hada_status hada_binary_read(const char *folder, const char *name, unsigned char **out, size_t *bytes, hada_error *err);

/* Writes beside and renames, so that a reader never sees half a file. */
hada_status hada_binary_write(const char *folder, const char *name, const unsigned char *data, size_t bytes,
                              hada_error *err);

/* Removes a binary that does not load, so that the next one can take its place. */
void hada_binary_drop(const char *folder, const char *name);

/* Makes a folder and its parents. A cache is for this user alone, since what stands in it is run. */
enum { HADA_OURS_ALONE = 0700 };
hada_status hada_folder_make(const char *folder, unsigned mode, hada_error *err);
/* Whether nobody but this user (or root) can put files into a folder; also where there is none yet. */
int hada_folder_is_ours(const char *folder);

/* The device binary of a built program; *out is freed with free(). */
hada_status hada_program_binary(cl_program program, unsigned char **out, size_t *bytes, hada_error *err);

/* A program from source text. */
hada_status hada_program_compile(hada_context *context, const char *file, const char *options, const char *text,
                                 cl_program *out, hada_error *err);

/* A program from a device binary. */
hada_status hada_program_from_binary(hada_context *context, const char *file, const char *options,
                                     const unsigned char *binary, size_t bytes, cl_program *out, hada_error *err);

#endif
