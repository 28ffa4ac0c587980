/* Writing a registered data set. */
#ifndef HADA_CLI_REGISTER_APPLY_H
#define HADA_CLI_REGISTER_APPLY_H

#include "dataset.h"

#include <hadalens/register.h>

/* Writes the scenes of every depth as its registration has them, rows x cols, and the raw frames as they are (as hard
 * links where the file system allows, else as copies) into a new data set. `folder` is made by the caller. Steps the
 * progress bar once per pair. */
hada_status hada_cli_register_write(hada_cli *cli, const hada_cli_dataset *set, const hada_registration *registrations,
                                    int rows, int cols, const char *folder, hada_error *err);

#endif
