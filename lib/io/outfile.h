/* Output files that appear whole or not at all: written beside the target, renamed at the end. Internal. */
#ifndef HADA_IO_OUTFILE_H
#define HADA_IO_OUTFILE_H

#include <stddef.h>

#include "core/error.h"

typedef struct hada_outfile {
    char *path; /* where the file will stand; a symbolic link is followed */
    char *temp; /* what is written meanwhile: PATH.tmp-PID-N */
    int fd;     /* open for reading and writing; -1 once closed */
} hada_outfile;

/* Creates the temporary file. A target that exists and is not a regular file is refused. */
hada_status hada_outfile_open(hada_outfile *out, const char *path, hada_error *err);
/* Writes all bytes at the current position. */
hada_status hada_outfile_write(hada_outfile *out, const void *data, size_t bytes, hada_error *err);
/* Closes and renames into place; on failure the temporary file is removed. The record is emptied either way. */
hada_status hada_outfile_commit(hada_outfile *out, hada_error *err);
/* Closes and removes the temporary file. */
void hada_outfile_abandon(hada_outfile *out);

#endif
