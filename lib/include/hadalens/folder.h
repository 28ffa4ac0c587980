/* Hadalens: files and folders that appear whole or not at all.
 *
 * What is written stands under a hidden name of random letters in the same folder until it is whole and on the disk:
 * after a failure, a signal or a loss of power there is the old file or the new one (docs/reference/security.md).
 * Devices, FIFOs and inputs of a command are never replaced; a file that replaces another takes over its mode and
 * owner.
 *
 * Thread-safe. */
#ifndef HADALENS_FOLDER_H
#define HADALENS_FOLDER_H

#include <hadalens/status.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Something that is there and no folder. */
HADA_API int hada_path_is_file(const char *path);
/* Nothing, or an empty folder. */
HADA_API int hada_path_is_vacant(const char *path);

/* 1: both name one file or folder, which need not be there, by whatever path. */
HADA_API int hada_path_is_same(const char *one, const char *other);

/* Makes a folder, with those above it where they are missing, and checks that files can be made in it
 * (HADA_ERROR_FILE_WRITE otherwise). A folder that is there already is fine. */
HADA_API hada_status hada_folder_ensure(const char *path, hada_error *err);

/* Removes a folder with all that is in it; links are removed, not followed. */
HADA_API void hada_folder_remove(const char *path);

/* Whether a file can be written, before long work that ends with it: its folder is there and takes files, and no folder
 * has its name. */
HADA_API hada_status hada_file_check_target(const char *path, hada_error *err);

/* Files that no output may replace until they are released, whatever path leads to them: the inputs of a command. Those
 * that are not there, or not ordinary files, are passed over. */
typedef struct hada_inputs hada_inputs;
HADA_API hada_status hada_inputs_protect(hada_inputs **out, const char *const *paths, size_t count, hada_error *err);
HADA_API void hada_inputs_release(hada_inputs **inputs);

/* Removes what is being written at this moment, files and folders; nothing can be written afterwards. For handlers of
 * signals that end the process: calls the system only (async-signal-safe). */
HADA_API void hada_outputs_remove(void);

/* Writes a file beside its place and renames it. */
HADA_API hada_status hada_file_write(const char *path, const void *data, size_t bytes, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
