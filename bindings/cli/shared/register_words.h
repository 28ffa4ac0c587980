/* What `register` and `fit --register` print: how scenes are placed on the sensor. */
#ifndef HADA_CLI_REGISTER_WORDS_H
#define HADA_CLI_REGISTER_WORDS_H

#include "cli.h"

#include <hadalens/task_register.h>

/* A line for each depth, warnings, and "depths" and "registered" in the document. */
void hada_cli_tell_registered(hada_cli *cli, const hada_dataset *data, const hada_register_report *report);

#endif
