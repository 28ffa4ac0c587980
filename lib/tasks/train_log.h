/* What training writes on its way: losses.csv and validation.csv, and pictures. Internal. A build without pictures
 * draws none. */
#ifndef HADA_TASKS_TRAIN_LOG_H
#define HADA_TASKS_TRAIN_LOG_H

#include "core/callers.h"
#include <hadalens/task_train.h>
#include <stdio.h>

typedef struct hada_loss_row {
    double step, loss;
} hada_loss_row;

typedef struct hada_train_log {
    char *folder;
    FILE *losses, *validation;
    hada_loss_row *loss; /* of good steps */
    size_t loss_count;
    hada_train_row *rows; /* each with a result of its own */
    size_t row_count;
} hada_train_log;

/* go_on: keeps what the files of the folder hold up to step `from`; what was written after it is taken out. */
hada_status hada_train_log_open(hada_train_log *log, const char *folder, int go_on, uint64_t from, hada_error *err);
hada_status hada_train_log_step(hada_train_log *log, const hada_step_report *report, hada_error *err);
hada_status hada_train_log_validation(hada_train_log *log, uint64_t step, const hada_validation *result,
                                      hada_error *err);
/* Writes out what is buffered. */
hada_status hada_train_log_flush(hada_train_log *log, hada_error *err);
void hada_train_log_close(hada_train_log *log);

/* training.svg in the log's folder: loss and validation over the steps. */
hada_status hada_train_figure(const hada_train_log *log, hada_error *err);

/* Raw frame, plane before the net, output and truth of a few of `held` held-out pairs, a row each. */
hada_status hada_train_picture(hada_trainer *trainer, int held, const char *path, hada_error *err);

#endif
