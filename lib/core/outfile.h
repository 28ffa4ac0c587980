/* Output files that appear whole or not at all: written beside the target, brought to the disk, renamed. Internal. */
#ifndef HADA_CORE_OUTFILE_H
#define HADA_CORE_OUTFILE_H

#include <stddef.h>
#include <sys/stat.h>

#include "core/error.h"

typedef struct hada_outfile {
    char *path; /* where the file will stand; a symbolic link is followed */
    char *temp; /* what is written meanwhile, in the same folder */
    int fd;     /* open for reading and writing; -1 once closed */
    int replaces;
    struct stat old; /* of the file that is replaced */
} hada_outfile;

/* Whether a file may be written here: there is nothing, or an ordinary file that no command in progress reads
 * (core/input.h). The path that links lead to is put into *real, on the heap, NULL where there is nothing. */
hada_status hada_outfile_check(const char *path, char **real, struct stat *old, hada_error *err);

/* Creates the temporary file, under a name that nobody can foresee. */
hada_status hada_outfile_open(hada_outfile *out, const char *path, hada_error *err);
/* Writes all bytes at the current position. */
hada_status hada_outfile_write(hada_outfile *out, const void *data, size_t bytes, hada_error *err);
/* Waits until the disk has the file, renames it into place with the mode and owner of the one it replaces, and waits
 * until the disk has the name: after a loss of power the old file is there or the new one, whole. On failure the
 * temporary file is removed. The record is emptied either way. Files in a folder that is not whole itself
 * (hada_folder_create()) are waited for with the folder. */
hada_status hada_outfile_commit(hada_outfile *out, hada_error *err);
/* Closes and removes the temporary file. */
void hada_outfile_abandon(hada_outfile *out);

/* A whole file at once. */
hada_status hada_outfile_save(const char *path, const void *data, size_t bytes, hada_error *err);

#endif
