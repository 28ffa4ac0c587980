/* What training draws on its way. Internal. A build without pictures does nothing here. */
#ifndef HADA_TASKS_TRAIN_PICTURES_H
#define HADA_TASKS_TRAIN_PICTURES_H

#include "tasks/train_log.h"

/* training.svg in the log's folder: loss and validation over the steps. */
hada_status hada_train_figure(const hada_train_log *log, hada_error *err);

/* Raw frame, plane before the net, output and truth of a few of `held` held-out pairs, a row each. */
hada_status hada_train_picture(hada_trainer *trainer, int held, const char *path, hada_error *err);

#endif
