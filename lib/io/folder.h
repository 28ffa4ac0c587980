/* Names of files. Internal. */
#ifndef HADA_IO_FOLDER_H
#define HADA_IO_FOLDER_H

#include <hadalens/folder.h>

#include "core/base.h"

/* The kind of a path: unlike hada_path_is_folder() a failure to look is an error, not
 * nothing. */
typedef enum hada_stands { HADA_STANDS_NOTHING, HADA_STANDS_FILE, HADA_STANDS_FOLDER } hada_stands;
hada_status hada_path_kind(const char *path, hada_stands *out, hada_error *err);
int hada_path_is_folder(const char *path);
/* Whether it is a file. */
hada_status hada_path_finds_file(const char *path, int *out, hada_error *err);

/* Writes a folder's files into `folder`, which exists and is empty. */
typedef hada_status (*hada_folder_fill)(void *user, const char *folder, hada_error *err);

/* Makes a folder that is not there yet, or empty: `fill` writes into one beside it, which takes the name when `fill`
 * has succeeded and is removed where it has not. */
hada_status hada_folder_create(const char *path, hada_folder_fill fill, void *user, hada_error *err);

/* The names of a folder's TIFF files (.tif, .tiff in any case; hidden ones left out), sorted; freed with
 * hada_names_free(). */
hada_status hada_folder_list_tiffs(const char *folder, char ***names, int *count, hada_error *err);

/* The same of names that are a distance as a whole, such as z100mm. `what`: the kind of the folder, for messages. */
hada_status hada_folder_list_depths(const char *folder, const char *what, char ***names, int *count, hada_error *err);
void hada_names_free(char ***names, int *count);

/* A path's last part. */
const char *hada_name_of(const char *path);
/* A file's name without folders and without its ending, on the heap. */
hada_status hada_path_stem(char **out, const char *path, hada_error *err);
/* The length of a name without its ending. */
size_t hada_name_stem(const char *name);

/* What a name such as z100mm, z250.5mm_2.tif, 100mm.tif says of a distance, and what follows in the name; below 0:
 * nothing. */
double hada_name_distance(const char *name, const char **rest);

/* A name from a format, on the heap. No %g or %f here, which would follow the locale. */
hada_status hada_path_format(char **out, hada_error *err, const char *format, ...) HADA_PRINTF(3, 4);

/* The same on the stack: paths of more bytes the system itself refuses. */
typedef char hada_path[4096];
hada_status hada_path_write(hada_path out, hada_error *err, const char *format, ...) HADA_PRINTF(3, 4);

/* Puts "PATH: " before a message, unless it begins so already. */
void hada_error_prefix_path(hada_error *err, const char *path);
/* Does so where `status` is an error, and returns it: HADA_TRY(hada_named(read(path, err), path, err)). */
hada_status hada_named(hada_status status, const char *path, hada_error *err);

#endif
