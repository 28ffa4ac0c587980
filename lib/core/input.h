/* Files that are read: opened so that nothing else than an ordinary file is, and kept from being replaced while a
 * command works. Internal. */
#ifndef HADA_CORE_INPUT_H
#define HADA_CORE_INPUT_H

#include <sys/stat.h>

#include "core/base.h"

/* Opens an ordinary file for reading; never waits (a FIFO would), and refuses folders and devices. *code, where not
 * NULL, is the reason of the system (ENOENT where there is nothing), 0 where it gave none. Messages do not name the
 * path. */
hada_status hada_input_open(int *fd, size_t *bytes, const char *path, int *code, hada_error *err);

/* Reads exactly `bytes` at an offset; 0 on success. */
int hada_read_at(int fd, void *out, size_t bytes, uint64_t offset);

/* A whole file of at most `most` bytes with a NUL behind it, to be freed; HADA_ERROR_FILE_FORMAT for longer ones. */
hada_status hada_input_read(char **text, size_t *bytes, const char *path, size_t most, int *code, hada_error *err);

/* A hash of a file's bytes, beyond 128 MiB of its size and of 64 MiB at each end; 0 where there is no such file.
 * Messages do not name the path. */
hada_status hada_file_hash(uint64_t *hash, const char *path, hada_error *err);

/* Whether a text of JSON would take far more memory than it is long, and more than those of sound files do. Short texts
 * may. */
int hada_json_is_bloated(const char *text, size_t bytes);

/* Whether a file is one of those that hada_inputs_protect() named. */
int hada_input_is_in_use(const struct stat *file);

#endif
