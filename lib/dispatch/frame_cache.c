#include "dispatch/frame_cache.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "engine/frame.h"
#include "engine/result.h"

enum { WAITS, RUNS, DONE, FAILED };

struct hada_kept {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    int references;
    int state;
    hada_image raw;
    hada_result result;         /* filled where somebody may ask for it */
    double light;               /* at most what the frame puts into the stack: L2; where frames may be nearly equal */
    double norm;                /* of the stack */
    double change, band_change; /* of it: see hada_task_skip */
};

void hada_frames_make(hada_frames *frames)
{
    pthread_mutex_init(&frames->lock, NULL);
}

static void release(hada_kept *kept)
{
    if (!kept)
        return;
    pthread_mutex_lock(&kept->lock);
    const int left = --kept->references;
    pthread_mutex_unlock(&kept->lock);
    if (left)
        return;
    pthread_cond_destroy(&kept->changed);
    pthread_mutex_destroy(&kept->lock);
    hada_image_destroy(&kept->raw);
    hada_result_destroy(&kept->result);
    free(kept);
}

static hada_kept *hold(hada_kept *kept)
{
    pthread_mutex_lock(&kept->lock);
    kept->references++;
    pthread_mutex_unlock(&kept->lock);
    return kept;
}

void hada_frames_free(hada_frames *frames)
{
    release(frames->last);
    frames->last = NULL;
    pthread_mutex_destroy(&frames->lock);
}

uint64_t hada_frames_bytes(uint64_t frame, uint64_t result)
{
    return frame + result;
}

static hada_status make(hada_kept **out, const hada_image *raw, hada_error *err)
{
    hada_kept *kept;
    hada_status status = hada_alloc((void **)&kept, 1, sizeof *kept, "a kept frame", err);
    if (status)
        return status;
    status = hada_image_create(&kept->raw, raw->channels, raw->rows, raw->cols, err);
    if (status) {
        free(kept);
        return status;
    }
    pthread_mutex_init(&kept->lock, NULL);
    pthread_cond_init(&kept->changed, NULL);
    kept->references = 1;
    *out = kept;
    return HADA_OK;
}

/* The last one if nobody else needs it any more, with its memory; else a new one. */
static hada_status renew(hada_frames *frames, const hada_image *raw, hada_error *err)
{
    hada_kept *last = frames->last;
    int alone = 0;
    if (last) {
        pthread_mutex_lock(&last->lock);
        alone = last->references == 1;
        pthread_mutex_unlock(&last->lock);
    }
    if (!alone) {
        hada_kept *kept;
        hada_status status = make(&kept, raw, err);
        if (status)
            return status;
        release(last);
        frames->last = kept;
    }
    frames->last->state = WAITS;
    memcpy(frames->last->raw.data, raw->data, hada_image_count(raw) * sizeof *raw->data);
    return HADA_OK;
}

static int equal(const hada_image *a, const hada_image *b)
{
    return !memcmp(a->data, b->data, hada_image_count(a) * sizeof *a->data);
}

/* At most what frame - other (NULL: zero), the level off, puts into all planes: L2, by the largest gain of each
 * channel. */
static double most_light(const hada_plan *plan, const hada_image *frame, const hada_image *other, double level)
{
    const hada_gains *gains = plan->skip.gains;
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    const float *dark = plan->dark_frame.data;
    double sum = 0.0;
    for (int c = 0; c < frame->channels; c++) {
        double channel = 0.0;
        for (size_t i = (size_t)c * pixels; i < (size_t)(c + 1) * pixels; i++) {
            const double value =
                other ? (double)frame->data[i] - other->data[i] : frame->data[i] - level - (dark ? dark[i] : 0.0f);
            channel += value * value;
        }
        sum += gains->most[c] * channel;
    }
    return sqrt(sum);
}

/* Whether frames of this plan may be reused when they are nearly equal. A dark level of each frame's own would have to
 * be found first. */
static int may_be_near(const hada_plan *plan)
{
    return plan->skip.gains && plan->options.max_error > 0.0 && !hada_task_each_level(plan);
}

/* The change that taking the last frame's result for this one's makes, if max_error allows it; negative: it does
 * not. */
static double near_change(const hada_frames *frames, const hada_task *task)
{
    hada_kept *last = frames->last;
    const double most = task->plan->options.max_error;
    if (!may_be_near(task->plan) || hada_image_count_not_finite(task->raw))
        return -1.0;
    const double off = most_light(task->plan, task->raw, &last->raw, 0.0);
    if (!(hada_skip_relative(off, last->light) <= most)) /* the stack holds no more than that */
        return -1.0;
    pthread_mutex_lock(&last->lock);
    while (last->state == WAITS || last->state == RUNS)
        pthread_cond_wait(&last->changed, &last->lock);
    const int known = last->state == DONE && last->result.depths;
    const double change = last->change + off, norm = last->norm;
    pthread_mutex_unlock(&last->lock);
    return known && hada_skip_relative(change, norm) <= most ? change : -1.0;
}

static int failed(hada_kept *kept)
{
    pthread_mutex_lock(&kept->lock);
    const int is = kept->state == FAILED;
    pthread_mutex_unlock(&kept->lock);
    return is;
}

/* With frames->lock held. */
static hada_status enter(hada_frames *frames, hada_task *task, hada_error *err)
{
    const hada_plan *plan = task->plan;
    if (frames->last && !failed(frames->last)) {
        const int same = equal(&frames->last->raw, task->raw);
        const double change = same ? 0.0 : near_change(frames, task);
        if (same || change >= 0.0) {
            task->source = hold(frames->last);
            task->source_change = change;
            return HADA_OK;
        }
    }
    hada_status status = renew(frames, task->raw, err);
    if (status)
        return status;
    if (may_be_near(plan))
        frames->last->light = most_light(plan, task->raw, NULL, hada_task_fixed_level(plan));
    task->kept = hold(frames->last);
    return HADA_OK;
}

hada_status hada_frames_enter(hada_frames *frames, hada_task *task, hada_error *err)
{
    if (!(task->plan->options.skip & HADA_SKIP_FRAMES))
        return HADA_OK;
    pthread_mutex_lock(&frames->lock);
    const hada_status status = enter(frames, task, err);
    pthread_mutex_unlock(&frames->lock);
    return status;
}

static hada_status copy(hada_result *to, const hada_result *from, const hada_model_info *info, hada_error *err)
{
    hada_status status = hada_result_fit(to, info, from->depths, err);
    if (status)
        return status;
    unsigned char *occupied = to->report.occupied;
    memcpy(occupied, from->report.occupied, (size_t)from->depths);
    to->report = from->report;
    to->report.occupied = occupied;
    memcpy(to->distances_mm, from->distances_mm, (size_t)from->depths * sizeof *to->distances_mm);
    for (int z = 0; z < from->depths; z++)
        memcpy(to->planes[z].data, from->planes[z].data, hada_image_count(&from->planes[z]) * sizeof(float));
    memcpy(to->all_in_focus.data, from->all_in_focus.data, hada_image_count(&from->all_in_focus) * sizeof(float));
    memcpy(to->distance_map.data, from->distance_map.data, hada_image_count(&from->distance_map) * sizeof(float));
    return HADA_OK;
}

int hada_frames_reuse(hada_task *task, hada_status *status, hada_error *err)
{
    hada_kept *source = task->source;
    if (!source)
        return 0;
    const double start = hada_seconds();
    /* one that does not run was handed on by a lane that failed: this lane may be the only one left to do it */
    pthread_mutex_lock(&source->lock);
    while (source->state == RUNS)
        pthread_cond_wait(&source->changed, &source->lock);
    const int known = source->state == DONE && source->result.depths;
    pthread_mutex_unlock(&source->lock);
    if (!known)
        return 0;
    hada_report *report = &task->result->report;
    *status = copy(task->result, &source->result, hada_model_get_info(task->plan->model), err);
    if (*status)
        return 1;
    report->seconds_upload = report->seconds_linear = report->seconds_pursuit = report->seconds_refine =
        report->seconds_enhance = report->seconds_focus = report->seconds_download = 0.0;
    report->skipped.kinds |= HADA_SKIP_FRAMES;
    report->skipped.frame = 1;
    if (task->source_change > 0.0)
        report->skipped.bound = hada_skip_relative(task->source_change + source->band_change, source->norm);
    report->seconds_total = hada_seconds() - start;
    return 1;
}

void hada_frames_begin(hada_task *task)
{
    if (!task->kept)
        return;
    pthread_mutex_lock(&task->kept->lock);
    task->kept->state = RUNS;
    pthread_mutex_unlock(&task->kept->lock);
}

/* What the task's lane made of it. Where only the task itself still has the frame nobody will ask. */
void hada_frames_done(hada_task *task, hada_status status)
{
    hada_kept *kept = task->kept;
    if (!kept)
        return;
    pthread_mutex_lock(&kept->lock);
    const int wanted = kept->references > 1;
    pthread_mutex_unlock(&kept->lock);
    if (!status && wanted && copy(&kept->result, task->result, hada_model_get_info(task->plan->model), NULL))
        hada_result_destroy(&kept->result); /* no memory: the next frame is computed */
    pthread_mutex_lock(&kept->lock);
    kept->norm = task->skip.norm;
    kept->change = task->skip.change;
    kept->band_change = task->skip.band_change;
    kept->state = status ? WAITS : DONE;
    pthread_cond_broadcast(&kept->changed);
    pthread_mutex_unlock(&kept->lock);
}

void hada_frames_leave(hada_task *task)
{
    if (task->kept) {
        pthread_mutex_lock(&task->kept->lock);
        if (task->kept->state != DONE)
            task->kept->state = FAILED;
        pthread_cond_broadcast(&task->kept->changed);
        pthread_mutex_unlock(&task->kept->lock);
    }
    release(task->kept);
    release(task->source);
    task->kept = task->source = NULL;
}
