/* Folders and file names. */
#ifndef HADA_CLI_FOLDER_H
#define HADA_CLI_FOLDER_H

#include "cli.h"

#include <hadalens/folder.h>

/* Formatted text on the heap; NULL when memory is out. */
char *hada_cli_text(const char *format, ...) HADA_CLI_PRINTF(1, 2);

/* The file's name without folders and without its extension. */
char *hada_cli_stem(const char *path);

/* Writes a file: all of it, or nothing. */
#define hada_cli_write_text hada_file_write

/* The names of a folder's TIFF files (.tif, .tiff in any case; hidden ones left out), sorted. Freed with
 * hada_cli_free_names. */
hada_status hada_cli_list_tiffs(const char *folder, char ***names, int *count, hada_error *err);
void hada_cli_free_names(char ***names, int *count);

#endif
