/* What may be skipped, and what was, in words. */
#ifndef HADA_CLI_SKIP_WORDS_H
#define HADA_CLI_SKIP_WORDS_H

#include "cli.h"

#include <hadalens/reconstruct.h>

/* "all", "none" or a list such as "prune,channels" to HADA_SKIP_... */
hada_status hada_cli_read_skip(const char *text, unsigned *skip, hada_error *err);

/* The part of a frame's JSON. */
json_t *hada_cli_skip_json(const hada_result *result);

/* Adds "; 31 % of the frequencies left out, at most 0.8 % change" and the like to a text. */
void hada_cli_skip_words(const hada_result *result, char *text, size_t size);

#endif
