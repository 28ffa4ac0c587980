/* Folders and file names. */
#ifndef HADA_CLI_FOLDER_H
#define HADA_CLI_FOLDER_H

#include "cli.h"

/* Formatted text on the heap; NULL when memory is out. */
char *hada_cli_text(const char *format, ...) HADA_CLI_PRINTF(1, 2);

/* The file's name without folders and without its extension. */
char *hada_cli_stem(const char *path);

int hada_cli_is_folder(const char *path);
int hada_cli_is_file(const char *path);
/* Whether nothing is there, or an empty folder. */
int hada_cli_is_vacant(const char *path);

/* Makes a folder with those above it where missing, and checks that files can be made in it. */
hada_status hada_cli_make_folder(const char *path, hada_error *err);

/* Checks that a file could be written: its folder is there and takes files. */
hada_status hada_cli_check_output(const char *path, hada_error *err);

/* Writes a file beside its place and renames it: all of it, or nothing. */
hada_status hada_cli_write_text(const char *path, const char *text, size_t size, hada_error *err);

/* Makes a folder that is not there yet, or empty: `fill` writes into one beside, which takes the name when it is whole
 * and goes away where it is not. */
hada_status hada_cli_write_folder(const char *path,
                                  hada_status (*fill)(void *user, const char *folder, hada_error *err), void *user,
                                  hada_error *err);

/* The names of a folder's TIFF files (.tif, .tiff in any case; hidden ones left out), sorted. Freed with
 * hada_cli_free_names. */
hada_status hada_cli_list_tiffs(const char *folder, char ***names, int *count, hada_error *err);
void hada_cli_free_names(char ***names, int *count);

/* Removes a folder that this program made, with all in it. */
void hada_cli_remove_tree(const char *path);

#endif
