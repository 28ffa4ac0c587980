/* What `evaluate` prints and puts into the document. */
#ifndef HADA_CLI_EVALUATE_TELL_H
#define HADA_CLI_EVALUATE_TELL_H

#include "cli.h"

#include <hadalens/task_evaluate.h>

/* Tables of all files; tolerance: as in hada_evaluate_task. */
void hada_cli_evaluate_tell(hada_cli *cli, const hada_evaluate_report *all, double tolerance);

#endif
