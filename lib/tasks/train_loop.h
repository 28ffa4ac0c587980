/* The steps of a training, and what is due after them. Internal. */
#ifndef HADA_TASKS_TRAIN_LOOP_H
#define HADA_TASKS_TRAIN_LOOP_H

#include "core/callers.h"
#include "tasks/train_log.h"

/* A training that is set up. */
typedef struct hada_train_work {
    const hada_train_task *task;
    hada_trainer *trainer;
    hada_stage stage;
    char *log_folder, *checkpoint;
    hada_communicator ranks; /* the first one writes */
    hada_train_state state;  /* what is told: depths, pairs and steps are filled in */
} hada_train_work;

/* Steps until the end, with validations, pictures, checkpoints and the best parameters on the way. */
hada_status hada_train_loop(hada_train_work *work, hada_error *err);

static inline hada_trainer_info hada_trainer_info_of(const hada_trainer *trainer)
{
    hada_trainer_info info = {.size = sizeof info};
    (void)hada_trainer_get_info(trainer, &info, NULL);
    return info;
}

#endif
