/* What is said about a reconstructed frame. */
#ifndef HADA_CLI_FRAME_REPORT_H
#define HADA_CLI_FRAME_REPORT_H

#include "cli.h"

#include <hadalens/reconstruct.h>

json_t *hada_cli_frame_json(const hada_result *result);
/* "100 and 250 mm; 8 refinement steps; 2.1 % unexplained" into `text` of `size` bytes. */
void hada_cli_frame_words(const hada_result *result, char *text, size_t size);

#endif
