/* Channels that need no computing, and whether bounds were kept. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "engine/frame.h"
#include "filter/hadamard.h"

hada_status hada_task_skip_begin(hada_task *task, hada_error *err)
{
    const size_t channels = (size_t)hada_model_get_info(task->plan->model)->channels;
    hada_status status = hada_alloc((void **)&task->skip.spectra, channels, sizeof(int), "a frame", err);
    if (!status)
        status = hada_alloc((void **)&task->skip.planes, channels, sizeof(int), "a frame", err);
    if (status)
        hada_task_skip_end(task);
    return status;
}

void hada_task_skip_end(hada_task *task)
{
    free(task->skip.spectra);
    free(task->skip.planes);
    task->skip = (hada_task_skip){0};
}

/* Whether nothing is left of a channel when the dark level and the dark frame are off: in float, as the device does
 * it. */
static int is_black(const hada_task *task, int channel)
{
    const hada_image *frame = hada_task_frame(task), *dark = &task->plan->dark_frame;
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols, at = (size_t)channel * pixels;
    const float *values = frame->data + at, *background = dark->data ? dark->data + at : NULL;
    const float level = (float)task->levels[channel];
    for (size_t i = 0; i < pixels; i++)
        if ((values[i] - level) - (background ? background[i] : 0.0f) != 0.0f)
            return 0;
    return 1;
}

static int is_same(const hada_task *task, int a, int b)
{
    const hada_image *frame = hada_task_frame(task);
    const int *dark = task->plan->skip.same_dark;
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    return task->levels[a] == task->levels[b] && dark[a] == dark[b] &&
           !memcmp(frame->data + (size_t)a * pixels, frame->data + (size_t)b * pixels, pixels * sizeof(float));
}

void hada_task_skip_channels(hada_task *task)
{
    hada_task_skip *skip = &task->skip;
    const int *same_filter = task->plan->skip.same_filter, channels = hada_model_get_info(task->plan->model)->channels;
    skip->channels = 0;
    for (int c = 0; c < channels; c++) {
        skip->spectra[c] = skip->planes[c] = c;
        if (!(task->plan->options.skip & HADA_SKIP_CHANNELS))
            continue;
        if (is_black(task, c)) {
            skip->spectra[c] = HADA_CHANNEL_BLACK;
            skip->planes[c] = task->plan->shape.refined ? c : HADA_CHANNEL_BLACK;
        } else {
            for (int before = c - 1; before >= 0; before--)
                if (is_same(task, before, c)) {
                    skip->spectra[c] = before;
                    if (!task->plan->shape.refined && same_filter[before] == same_filter[c])
                        skip->planes[c] = before;
                }
        }
        skip->channels += skip->planes[c] != c;
    }
}

/* The root of the sum of squares of all planes that count. */
static double norm_of(const hada_result *result)
{
    double sum = 0.0;
    for (int z = 0; z < result->depths; z++) {
        const size_t count = result->report.occupied[z] ? hada_image_count(&result->planes[z]) : 0;
        const float *values = result->planes[z].data;
        for (size_t i = 0; i < count; i++)
            sum += (double)values[i] * values[i];
    }
    return sqrt(sum);
}

double hada_skip_relative(double change, double norm)
{
    return change == 0.0 ? 0.0 : change < norm ? change / (norm - change) : INFINITY;
}

int hada_task_skip_again(hada_task *task)
{
    hada_task_skip *skip = &task->skip;
    hada_skip_report *report = &task->result->report.skipped;
    const double most = task->plan->options.max_error;
    const double norm = skip->change + skip->band_change + most > 0.0 ? norm_of(task->result) : 0.0;
    const int again = hada_skip_relative(skip->change, norm) > most;
    report->bound = hada_skip_relative(skip->change + skip->band_change, norm);
    if (task->plan->shape.enhance && report->bound > 0.0)
        report->bound = INFINITY; /* the net may make anything of it */
    skip->norm = norm;
    if (again) {
        skip->again = 1;
        skip->limited = 0;
        skip->change = 0.0;
        skip->band_rows = task->plan->shape.band_rows;
        skip->band_cols = task->plan->shape.band_cols;
    }
    return again;
}

void hada_task_skip_report(hada_task *task)
{
    const hada_plan_shape *shape = &task->plan->shape;
    const hada_task_skip *skip = &task->skip;
    hada_skip_report *report = &task->result->report.skipped;
    const hada_gains *gains = task->plan->skip.gains;
    const int banded = skip->band_rows || skip->band_cols;
    const int left_out = atomic_load(&task->tiles_left_out), tiles = left_out + atomic_load(&task->tiles);
    report->depths = shape->depths - task->result->report.occupied_count;
    report->tiles = tiles ? (double)left_out / tiles : 0.0;
    report->channels = skip->channels;
    report->again = skip->again;
    report->frequencies = banded ? hada_tiles_share_outside(&gains->tiles, skip->band_rows, skip->band_cols) : 0.0;
    report->kinds =
        (shape->pruned ? HADA_SKIP_PRUNE : 0u) | (report->depths && !shape->full_look ? HADA_SKIP_DEPTHS : 0u) |
        (skip->limited ? HADA_SKIP_FREQUENCIES : 0u) | (shape->half_by_error && !skip->again ? HADA_SKIP_HALF : 0u) |
        (skip->channels ? HADA_SKIP_CHANNELS : 0u) | (left_out ? HADA_SKIP_TILES : 0u);
    task->result->report.enhanced = atomic_load(&task->enhanced);
    for (int c = 0; c < hada_model_get_info(task->plan->model)->channels; c++)
        if (skip->spectra[c] != c)
            report->kinds |= HADA_SKIP_CHANNELS;
}
