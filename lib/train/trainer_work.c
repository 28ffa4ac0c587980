/* Workers, and what they make of a pair. */
#include <hadalens/scene.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "image/dark.h"
#include "train/trainer.h"

typedef struct task {
    hada_trainer *trainer;
    hada_work work;
    void *user;
} task;

static void run(void *user, int number)
{
    const task *what = user;
    hada_worker *worker = &what->trainer->workers[number];
    worker->status = what->work(what->trainer, number, what->user, &worker->error);
}

hada_status hada_workers_run(hada_trainer *trainer, hada_work work, void *user, hada_error *err)
{
    if (trainer->worker_count == 1)
        return work(trainer, 0, user, err);
    hada_crew_run(trainer->crew, run, &(task){trainer, work, user});
    for (int i = 0; i < trainer->worker_count; i++)
        if (trainer->workers[i].status) {
            if (err)
                *err = trainer->workers[i].error;
            return trainer->workers[i].status;
        }
    return HADA_OK;
}

static hada_status take_dark_off(hada_image *raw, double level, hada_error *err)
{
    const size_t area = (size_t)raw->rows * (size_t)raw->cols;
    float *room = NULL;
    hada_status status = HADA_OK;
    if (level < 0.0)
        status = hada_alloc((void **)&room, area, sizeof *room, "a frame's dark level", err);
    for (int c = 0; !status && c < raw->channels; c++) {
        float *at = raw->data + (size_t)c * area;
        const double dark = room ? hada_dark_estimate(at, area, room) : level;
        for (size_t i = 0; dark != 0.0 && i < area; i++)
            at[i] = (float)((double)at[i] - dark);
    }
    free(room);
    return status;
}

hada_status hada_example_make(hada_example *out, hada_trainer *trainer, hada_worker *worker, int depth, hada_image *raw,
                              hada_image *scene, hada_error *err)
{
    const hada_stage stage = trainer->options.stage;
    hada_status status;
    *out = (hada_example){0};
    if (hada_stage_has_planes(stage))
        status = hada_planes_make(worker->planes, depth, raw, &out->input, err);
    else
        status = take_dark_off(raw, trainer->info.dark, err);
    if (!status && stage == HADA_STAGE_CONVENTIONAL) {
        status = hada_image_resize(&out->input, raw, trainer->info.window_rows, trainer->info.window_cols, err);
    } else if (!status && !hada_stage_has_planes(stage)) {
        out->input = *raw;
        *raw = (hada_image){0};
    }
    if (status) {
        hada_example_free(out);
        return status;
    }
    out->scene = *scene;
    *scene = (hada_image){0};
    return HADA_OK;
}
