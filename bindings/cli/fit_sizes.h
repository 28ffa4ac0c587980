/* What a data set says about a camera, for commands that learn from one. */
#ifndef HADA_CLI_FIT_SIZES_H
#define HADA_CLI_FIT_SIZES_H

#include "dataset.h"

#include <hadalens/fit.h>

/* Depths, distances and the sizes of the first pair; the others are checked when they are read. `window` (0 x 0: none
 * given) may be smaller than scenes that are as large as the frame. The distances stay the data set's. */
hada_status hada_cli_fit_sizes(hada_fit_options *fit, const hada_cli_dataset *data, const int window[2],
                               hada_error *err);

/* `choice`: 1 circular, 2 padded, 0: what camera.json says, else padded. */
hada_boundary hada_cli_fit_boundary(hada_cli *cli, int choice, const hada_cli_dataset *data);

/* The level of --dark; negative: each frame's own. */
hada_status hada_cli_fit_dark(const char *text, double *level, hada_error *err);

#endif
