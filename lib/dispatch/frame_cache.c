#include "dispatch/plan.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "engine/frame.h"

enum { WAITS, RUNS, DONE, FAILED };

struct hada_cache_entry {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    int references;
    int state;
    hada_image raw;
    hada_result result;         /* filled where somebody may ask for it */
    double light;               /* at most what the frame puts into the stack: L2; where frames may be nearly equal */
    double norm;                /* of the stack */
    double change, band_change; /* of it: see hada_frame_skip */
};

void hada_frame_cache_make(hada_frame_cache *cache)
{
    cache->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
}

static void release(hada_cache_entry *entry)
{
    if (!entry)
        return;
    pthread_mutex_lock(&entry->lock);
    const int left = --entry->references;
    pthread_mutex_unlock(&entry->lock);
    if (left)
        return;
    pthread_cond_destroy(&entry->changed);
    pthread_mutex_destroy(&entry->lock);
    hada_image_destroy(&entry->raw);
    hada_result_destroy(&entry->result);
    free(entry);
}

static hada_cache_entry *hold(hada_cache_entry *entry)
{
    pthread_mutex_lock(&entry->lock);
    entry->references++;
    pthread_mutex_unlock(&entry->lock);
    return entry;
}

void hada_frame_cache_free(hada_frame_cache *cache)
{
    release(cache->last);
    cache->last = NULL;
    pthread_mutex_destroy(&cache->lock);
}

static hada_status make(hada_cache_entry **out, const hada_image *raw, hada_error *err)
{
    hada_cache_entry *entry = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(entry = hada_alloc(1, sizeof *entry, "the frame before", err)));
    HADA_TRY_OR_DONE(hada_image_create(&entry->raw, raw->channels, raw->rows, raw->cols, err));
    entry->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    entry->changed = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
    entry->references = 1;
done:
    if (status) {
        free(entry);
        entry = NULL;
    }
    *out = entry;
    return status;
}

/* The last one if nobody else needs it any more, with its memory; else a new one. */
static hada_status renew(hada_frame_cache *cache, const hada_image *raw, hada_error *err)
{
    hada_cache_entry *last = cache->last;
    int alone = 0;
    if (last) {
        pthread_mutex_lock(&last->lock);
        alone = last->references == 1;
        pthread_mutex_unlock(&last->lock);
    }
    if (!alone) {
        hada_cache_entry *entry;
        HADA_TRY(make(&entry, raw, err));
        release(last);
        cache->last = entry;
    }
    cache->last->state = WAITS;
    memcpy(cache->last->raw.data, raw->data, hada_image_count(raw) * sizeof *raw->data);
    return HADA_OK;
}

static int equal(const hada_image *a, const hada_image *b)
{
    return !memcmp(a->data, b->data, hada_image_count(a) * sizeof *a->data);
}

/* At most what frame - other (NULL: zero), the level off, puts into all planes: L2, by the largest gain of each
 * channel. */
static double most_light(const hada_setup *setup, const hada_image *frame, const hada_image *other, double level)
{
    const hada_gains *gains = setup->gains;
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    const float *dark = setup->dark_frame.data;
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
static int may_be_near(const hada_setup *setup)
{
    return setup->gains && setup->options.max_error > 0.0 && !hada_frame_levels_vary(setup);
}

/* The change that taking the last frame's result for this one's makes, if max_error allows it; negative: it does
 * not. */
static double near_change(const hada_frame_cache *cache, const hada_job *job)
{
    hada_cache_entry *last = cache->last;
    const double most = job->frame.setup->options.max_error;
    if (!may_be_near(job->frame.setup) || hada_image_count_not_finite(job->frame.raw))
        return -1.0;
    const double off = most_light(job->frame.setup, job->frame.raw, &last->raw, 0.0);
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

static int has_failed(hada_cache_entry *entry)
{
    pthread_mutex_lock(&entry->lock);
    const int failed = entry->state == FAILED;
    pthread_mutex_unlock(&entry->lock);
    return failed;
}

/* Whether the frame before serves for this one; the job then has it as its source. */
static int find_source(const hada_frame_cache *cache, hada_job *job)
{
    if (!cache->last || has_failed(cache->last))
        return 0;
    job->source_change = equal(&cache->last->raw, job->frame.raw) ? 0.0 : near_change(cache, job);
    if (job->source_change < 0.0)
        return 0;
    job->source = hold(cache->last);
    return 1;
}

/* With cache->lock held. */
static hada_status enter(hada_frame_cache *cache, hada_job *job, hada_error *err)
{
    const hada_setup *setup = job->frame.setup;
    if (find_source(cache, job))
        return HADA_OK;
    HADA_TRY(renew(cache, job->frame.raw, err));
    if (may_be_near(setup))
        cache->last->light = most_light(setup, job->frame.raw, NULL, hada_frame_fixed_level(setup));
    job->entry = hold(cache->last);
    return HADA_OK;
}

hada_status hada_frame_cache_enter(hada_frame_cache *cache, hada_job *job, hada_error *err)
{
    /* what the frame before left is on the host alone */
    if (!(job->frame.setup->options.skip & HADA_SKIP_FRAMES) || hada_result_on_device(job->frame.result))
        return HADA_OK;
    pthread_mutex_lock(&cache->lock);
    const hada_status status = enter(cache, job, err);
    pthread_mutex_unlock(&cache->lock);
    return status;
}

static int is_known(hada_cache_entry *source)
{
    /* one that does not run was handed on by a worker that failed: this worker may be the only one left to do it */
    pthread_mutex_lock(&source->lock);
    while (source->state == RUNS)
        pthread_cond_wait(&source->changed, &source->lock);
    const int known = source->state == DONE && source->result.depths;
    pthread_mutex_unlock(&source->lock);
    return known;
}

hada_status hada_frame_cache_reuse(hada_job *job, int *reused, hada_error *err)
{
    hada_cache_entry *source = job->source;
    const double start = hada_seconds();
    *reused = source && is_known(source);
    if (!*reused)
        return HADA_OK;
    HADA_TRY(hada_result_copy(job->frame.result, &source->result, hada_model_get_info(job->frame.setup->model), err));
    hada_result_memory *memory = job->frame.result->memory;
    hada_report *report = &memory->report;
    report->seconds_upload = report->seconds_linear = report->seconds_pursuit = report->seconds_refine =
        report->seconds_enhance = report->seconds_focus = report->seconds_download = 0.0;
    memory->skipped.kinds |= HADA_SKIP_FRAMES;
    memory->skipped.frame = 1;
    if (job->source_change > 0.0)
        memory->skipped.bound = hada_skip_relative(job->source_change + source->band_change, source->norm);
    report->seconds_total = hada_seconds() - start;
    return HADA_OK;
}

void hada_frame_cache_begin(hada_job *job)
{
    if (!job->entry)
        return;
    pthread_mutex_lock(&job->entry->lock);
    job->entry->state = RUNS;
    pthread_mutex_unlock(&job->entry->lock);
}

/* What the job's worker made of it. Where only the job itself still has the frame nobody will ask. */
void hada_frame_cache_done(hada_job *job, hada_status status)
{
    hada_cache_entry *entry = job->entry;
    if (!entry)
        return;
    pthread_mutex_lock(&entry->lock);
    const int wanted = entry->references > 1;
    pthread_mutex_unlock(&entry->lock);
    if (!status && wanted &&
        hada_result_copy(&entry->result, job->frame.result, hada_model_get_info(job->frame.setup->model), NULL))
        hada_result_destroy(&entry->result); /* no memory: the next frame is computed */
    pthread_mutex_lock(&entry->lock);
    entry->norm = job->frame.skip.norm;
    entry->change = job->frame.skip.change;
    entry->band_change = job->frame.skip.band_change;
    entry->state = status ? WAITS : DONE;
    pthread_cond_broadcast(&entry->changed);
    pthread_mutex_unlock(&entry->lock);
}

void hada_frame_cache_leave(hada_job *job)
{
    if (job->entry) {
        pthread_mutex_lock(&job->entry->lock);
        if (job->entry->state != DONE)
            job->entry->state = FAILED;
        pthread_cond_broadcast(&job->entry->changed);
        pthread_mutex_unlock(&job->entry->lock);
    }
    release(job->entry);
    release(job->source);
    job->entry = job->source = NULL;
}
