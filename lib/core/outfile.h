/* Output files that appear whole or not at all: written beside the target, brought to the disk, renamed. Internal. */
#ifndef HADA_CORE_OUTFILE_H
#define HADA_CORE_OUTFILE_H

#include <sys/stat.h>

#include "core/base.h"

typedef struct hada_outfile {
    char *path; /* the final path; a symbolic link is followed */
    char *temp; /* the temporary file, in the same folder */
    int fd;     /* open for reading and writing; -1 once closed */
    int replaces;
    struct stat old; /* of the file that is replaced */
} hada_outfile;

/* Whether a file may be written here: there is nothing, or an ordinary file that no command in progress reads
 * (core/input.h). The path that links lead to is put into *real, on the heap, NULL where there is nothing. */
hada_status hada_outfile_check(const char *path, char **real, struct stat *old, hada_error *err);

/* Creates the temporary file, under an unpredictable name. */
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

/* Removes what an earlier run left at an output's place, unless a command in progress reads it. */
void hada_outfile_remove(const char *path);

/* A whole file at once. */
hada_status hada_outfile_save(const char *path, const void *data, size_t bytes, hada_error *err);

/* What is written under a temporary name until it is whole: names that nobody can foresee, and a list of them that a
 * handler of a signal can go through. Internal. */

typedef enum hada_staged_kind { HADA_STAGED_FILE, HADA_STAGED_FOLDER } hada_staged_kind;

/* Makes an empty file (open for reading and writing, its descriptor in *fd) or folder beside `path`, under a hidden
 * name of random letters that was not there; `mode` as for open() and mkdir(). *name is for hada_staged_remove() or
 * hada_staged_forget(). `shown` is the name for messages. */
hada_status hada_staged_make(char **name, int *fd, hada_staged_kind kind, const char *path, unsigned mode,
                             const char *shown, hada_error *err);

/* Takes the name off the list and frees it: what stood there has another name now, or is gone. */
void hada_staged_forget(char **name);

/* Whether `path` lies in a folder that is not whole yet: what is in it is brought to the disk with the folder. */
int hada_staged_holds(const char *path);

/* All give 0, or -1 with the reason in errno. What a file system cannot do (folders on some) counts as done. */
int hada_sync(int fd);
/* The folder that `path` is in: its names outlast a loss of power. */
int hada_sync_parent(const char *path);
/* A folder and all that is in it. */
int hada_sync_tree(const char *path);

/* Makes a folder and those above it, where they are missing, with this mode (less what the umask takes); their names
 * outlast a loss of power. A folder that is there already is fine. */
int hada_folders_make(const char *path, unsigned mode);

#endif
