/* What is written under a temporary name until it is whole: names that nobody can foresee, and a list of them that a
 * handler of a signal can go through. Internal. */
#ifndef HADA_CORE_STAGED_H
#define HADA_CORE_STAGED_H

#include "core/error.h"

typedef enum hada_staged_kind { HADA_STAGED_FILE, HADA_STAGED_FOLDER } hada_staged_kind;

/* Makes an empty file (open for reading and writing, its descriptor in *fd) or folder beside `path`, under a hidden
 * name of random letters that was not there; `mode` as for open() and mkdir(). *name is for hada_staged_remove() or
 * hada_staged_forget(). `shown` stands in messages. */
hada_status hada_staged_make(char **name, int *fd, hada_staged_kind kind, const char *path, unsigned mode,
                             const char *shown, hada_error *err);

/* Takes the name off the list and frees it: what stood there has another name now, or is gone. */
void hada_staged_forget(char **name);

/* Whether `path` lies in a folder that is not whole yet: what is in it is brought to the disk with the folder. */
int hada_staged_holds(const char *path);

#endif
