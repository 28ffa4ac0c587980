/* The dark level, as several commands take it. */
#ifndef HADA_CLI_MODEL_WORDS_H
#define HADA_CLI_MODEL_WORDS_H

#include "option.h"

#include <hadalens/reconstruct.h>

/* "none", "auto", a level or a file. */
typedef struct hada_cli_dark {
    hada_dark kind;
    double level;     /* of the level, or the mean of the file */
    hada_image frame; /* mean of the file's pages */
} hada_cli_dark;
hada_status hada_cli_read_dark(hada_cli_dark *dark, const char *text, hada_error *err);
void hada_cli_dark_free(hada_cli_dark *dark);

/* The same as one number: negative for each frame's own, a file's mean. */
hada_status hada_cli_read_dark_level(double *level, const char *text, hada_error *err);

/* The flat frame of a file, above the level or the dark frame that --dark names (NULL: 0). path NULL: none. */
hada_status hada_cli_read_flat(hada_image *flat, const char *path, const char *dark, hada_error *err);

#endif
