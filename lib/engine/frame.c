/* Frames checked, repaired and levelled on the host. */
#include "engine/frame.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "engine/repair.h"
#include "engine/result.h"
#include "image/dark.h"

hada_status hada_task_begin(hada_task *task, const hada_plan *plan, const hada_image *raw, hada_result *result,
                            hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(plan->model);
    const hada_plan_shape *shape = &plan->shape;
    *task = (hada_task){.plan = plan, .raw = raw, .result = result};
    /* upload and pictures are a unit each; the pursuit takes about as long as some refinement steps */
    task->work = 2 + (shape->refined ? shape->steps + (shape->pursuit ? HADA_WORK_PURSUIT : 0) : shape->depths);
    if (raw->channels != info->channels || raw->rows != info->raw_rows || raw->cols != info->raw_cols)
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "the frame has %d channel(s) of %d x %d pixels; the model %s is for %d channel(s) of %d x %d: use "
            "the model of this camera, or make one with fit",
            raw->channels, raw->rows, raw->cols, info->name, info->channels, info->raw_rows, info->raw_cols);
    hada_status status = hada_alloc((void **)&task->levels, (size_t)info->channels, sizeof(double), "a frame", err);
    if (!status)
        status = hada_alloc((void **)&task->depths, (size_t)shape->depths, 1, "a frame", err);
    if (!status)
        status = hada_task_skip_begin(task, err);
    if (status) {
        free(task->levels);
        free(task->depths);
    }
    return status;
}

void hada_task_end(hada_task *task, hada_status status)
{
    if (status)
        hada_result_destroy(task->result);
    hada_image_destroy(&task->repaired);
    free(task->levels);
    free(task->depths);
    hada_task_skip_end(task);
    hada_frames_leave(task);
    task->levels = NULL;
    task->depths = NULL;
}

void hada_task_progress(hada_task *task, int done)
{
    const int now = (int)((double)done / task->work * HADA_PROGRESS);
    int before = atomic_load(&task->progress);
    while (now > before && !atomic_compare_exchange_weak(&task->progress, &before, now))
        ;
}

hada_status hada_task_check(hada_task *task, hada_error *err)
{
    return atomic_load(&task->cancelled) ? hada_fail(err, HADA_ERROR_CANCELLED, "the job was cancelled") : HADA_OK;
}

const hada_image *hada_task_frame(const hada_task *task)
{
    return task->broken ? &task->repaired : task->raw;
}

/* A result used again keeps its memory. */
static hada_status fit_result(hada_task *task, hada_error *err)
{
    const hada_plan *plan = task->plan;
    hada_result *result = task->result;
    hada_status status = hada_result_fit(result, hada_model_get_info(plan->model), plan->shape.depths, err);
    if (status)
        return status;
    unsigned char *occupied = result->report.occupied;
    result->report = (hada_report){.occupied = occupied, .residual_linear = NAN, .residual = NAN};
    memcpy(result->distances_mm, plan->distances, (size_t)plan->shape.depths * sizeof(double));
    return HADA_OK;
}

static hada_status repair(hada_task *task, hada_error *err)
{
    const hada_image *raw = task->raw;
    hada_status status = HADA_OK;
    if (!task->plan->options.repair_not_finite)
        return hada_fail(
            err, HADA_ERROR_NOT_FINITE,
            "%zu pixel(s) of the frame are NaN or infinite; repair them from their neighbours with --repair, "
            "or mend the file",
            task->broken);
    if (!task->repaired.data)
        status = hada_image_create(&task->repaired, raw->channels, raw->rows, raw->cols, err);
    if (status)
        return status;
    memcpy(task->repaired.data, raw->data, hada_image_count(raw) * sizeof(float));
    return hada_frame_repair(&task->repaired, &task->result->report.repaired_pixels, err);
}

int hada_task_each_level(const hada_plan *plan)
{
    /* a model asks for the level of each frame by a dark level below zero */
    return plan->options.dark == HADA_DARK_AUTO ||
           (plan->options.dark == HADA_DARK_MODEL && hada_model_get_info(plan->model)->dark < 0);
}

double hada_task_fixed_level(const hada_plan *plan)
{
    return plan->options.dark == HADA_DARK_MODEL   ? hada_model_get_info(plan->model)->dark
           : plan->options.dark == HADA_DARK_LEVEL ? plan->options.dark_level
                                                   : 0.0;
}

/* The report takes the mean of the channels' levels. */
static hada_status find_levels(hada_task *task, hada_error *err)
{
    const hada_plan *plan = task->plan;
    const hada_image *frame = hada_task_frame(task);
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    const double level = hada_task_fixed_level(plan);
    const int each = hada_task_each_level(plan);
    void *room = NULL;
    hada_status status = each ? hada_alloc_raw(&room, pixels, sizeof(float), "the dark level", err) : HADA_OK;
    for (int channel = 0; !status && channel < frame->channels; channel++) {
        task->levels[channel] = each ? hada_dark_estimate(frame->data + (size_t)channel * pixels, pixels, room) : level;
        task->result->report.dark += task->levels[channel] / frame->channels;
    }
    free(room);
    return status;
}

static double energy_above(const hada_image *frame, const double *levels, const hada_image *dark)
{
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    double sum = 0;
    for (int channel = 0; channel < frame->channels; channel++)
        for (size_t i = (size_t)channel * pixels; i < (size_t)(channel + 1) * pixels; i++) {
            const double value = frame->data[i] - levels[channel] - (dark->data ? dark->data[i] : 0.0f);
            sum += value * value;
        }
    return sum;
}

hada_status hada_task_prepare(hada_task *task, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(task->plan->model);
    task->start = task->watch = hada_seconds();
    atomic_store(&task->enhanced, 0);
    atomic_store(&task->tiles, 0);
    atomic_store(&task->tiles_left_out, 0);
    hada_status status = fit_result(task, err);
    task->broken = hada_image_count_not_finite(task->raw);
    if (!status && task->broken)
        status = repair(task, err);
    if (!status)
        status = hada_frame_check_range(hada_task_frame(task), (double)info->grid_rows * info->grid_cols, err);
    if (!status)
        status = find_levels(task, err);
    if (!status && task->plan->shape.refined)
        task->energy = energy_above(hada_task_frame(task), task->levels, &task->plan->dark_frame);
    if (!status)
        hada_task_skip_channels(task);
    return status;
}
