/* What `fit` prints and puts into the document. */
#ifndef HADA_CLI_FIT_TELL_H
#define HADA_CLI_FIT_TELL_H

#include "cli.h"

#include <hadalens/task_fit.h>

/* Of a fit to pairs: how many there are, what they said, what was compared. */
void hada_cli_fit_tell_pairs(hada_cli *cli, const hada_dataset_info *info, const hada_model *model,
                             const hada_fit_report *report);
/* Of a fit to `files` files of sums. */
void hada_cli_fit_tell_sums(hada_cli *cli, int files, const hada_model *model, const hada_fit_report *report);
/* The model, as written to a file. */
void hada_cli_fit_tell_model(hada_cli *cli, const char *path, const hada_model *model, double seconds);

#endif
