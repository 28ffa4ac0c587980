/* The previous frame and its result, for frames that equal it.
 *
 * A frame that is submitted is compared with the last one by a few samples; if these agree, by the hashes of all
 * pixels, which examining a frame finds anyway. Pixels are not kept, and results are kept only while frames repeat: a
 * plan begins that way, stops after KEEP frames that do not repeat, and begins again at the next that does, which is
 * computed. Plans with an error bound keep pixels as well, since nearly equal frames may serve there. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "dispatch/plan.h"
#include "image/pixels.h"

enum { WAITS, RUNS, DONE, FAILED };
enum { KEEP = 8 };

struct hada_cache_entry {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    int references;
    int state;
    int keep;           /* 1: its result is kept */
    uint64_t sample;    /* hada_exposure_sample() */
    uint64_t hash[2];   /* zeros: not known yet */
    hada_image raw;     /* the pixels, where nearly equal frames may serve; else empty */
    hada_result result; /* empty: not kept */
    double light;       /* what the frame puts into the stack at most, L2; where nearly equal frames may serve */
    double norm;        /* of the stack */
    double change, band_change; /* of the stack: see hada_frame_skip */
};

void hada_frame_cache_make(hada_frame_cache *cache)
{
    cache->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    cache->keeps = KEEP;
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

/* What frame - other (NULL: zero) above the level puts into all planes at most: L2, by the largest gain of each
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

/* Whether nearly equal frames of this plan may serve. A dark level of each frame's own would have to be found first. */
static int may_be_near(const hada_setup *setup)
{
    return setup->gains && setup->options.max_error > 0.0 && !hada_frame_levels_vary(setup);
}

static int has_failed(hada_cache_entry *entry)
{
    pthread_mutex_lock(&entry->lock);
    const int failed = entry->state == FAILED;
    pthread_mutex_unlock(&entry->lock);
    return failed;
}

/* The change that taking the last frame's result for this one's makes, if max_error allows it; negative: it does not.
 */
static double near_change(hada_cache_entry *last, const hada_setup *setup, const hada_image *raw)
{
    const double most = setup->options.max_error;
    if (has_failed(last))
        return -1.0;
    if (!memcmp(raw->data, last->raw.data, hada_image_count(raw) * sizeof *raw->data))
        return 0.0;
    if (hada_image_count_not_finite(raw))
        return -1.0;
    const double off = most_light(setup, raw, &last->raw, 0.0);
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

/* Whether all pixels of the last frame are the job's; waits until the last one's worker has examined it. */
static int is_equal(hada_cache_entry *last, hada_job *job)
{
    const uint64_t *hash = job->frame.exposure.hash;
    if (last->sample != hada_exposure_sample(&job->frame.exposure) || hada_frame_examine(&job->frame, NULL))
        return 0;
    pthread_mutex_lock(&last->lock);
    while (last->state == WAITS && !last->hash[0])
        pthread_cond_wait(&last->changed, &last->lock);
    const int equal = last->state != FAILED && last->hash[0] == hash[0] && last->hash[1] == hash[1];
    pthread_mutex_unlock(&last->lock);
    return equal;
}

/* The job becomes the last frame; raw: its pixels, or empty, which the entry takes over. */
static hada_status become_last(hada_frame_cache *cache, hada_job *job, hada_image *raw, hada_error *err)
{
    const hada_setup *setup = job->frame.setup;
    hada_cache_entry *entry;
    HADA_TRY(hada_allocated(entry = hada_alloc(1, sizeof *entry, "the previous frame", err)));
    entry->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    entry->changed = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
    entry->references = 2; /* the cache and the job */
    entry->sample = hada_exposure_sample(&job->frame.exposure);
    entry->keep = raw->data || cache->keeps > 0;
    cache->keeps -= cache->keeps > 0;
    entry->raw = *raw;
    *raw = (hada_image){0};
    if (entry->raw.data)
        entry->light = most_light(setup, &entry->raw, NULL, hada_frame_fixed_level(setup));
    release(cache->last);
    cache->last = job->entry = entry;
    return HADA_OK;
}

/* With cache->lock held. */
static hada_status enter(hada_frame_cache *cache, hada_job *job, hada_error *err)
{
    const hada_setup *setup = job->frame.setup;
    hada_image raw = {0};
    hada_status status = HADA_OK;
    job->source_change = -1.0;
    if (may_be_near(setup))
        HADA_TRY(hada_pixels_copy(&job->frame.exposure.came, &raw, err));
    if (cache->last)
        job->source_change = raw.data ? near_change(cache->last, setup, &raw) : is_equal(cache->last, job) ? 0.0 : -1.0;
    if (job->source_change >= 0.0) {
        job->source = hold(cache->last);
        cache->keeps = KEEP;
    } else {
        status = become_last(cache, job, &raw, err);
    }
    hada_image_destroy(&raw);
    return status;
}

hada_status hada_frame_cache_enter(hada_frame_cache *cache, hada_job *job, hada_error *err)
{
    /* results are kept on the host alone */
    if (!(job->frame.setup->options.skip & HADA_SKIP_FRAMES) || hada_result_on_device(job->frame.result))
        return HADA_OK;
    job->frame.hashed = 1;
    pthread_mutex_lock(&cache->lock);
    const hada_status status = enter(cache, job, err);
    pthread_mutex_unlock(&cache->lock);
    return status;
}

/* Waits while the source is computed. One that waits was handed on by a worker that failed: this worker may be the only
 * one left to do it. */
static int is_done(hada_cache_entry *source)
{
    pthread_mutex_lock(&source->lock);
    while (source->state == RUNS)
        pthread_cond_wait(&source->changed, &source->lock);
    const int done = source->state == DONE;
    pthread_mutex_unlock(&source->lock);
    return done;
}

hada_status hada_frame_cache_reuse(hada_job *job, int *reused, hada_error *err)
{
    hada_cache_entry *source = job->source;
    const hada_model_info *info = hada_model_get_info(job->frame.setup->model);
    const double start = hada_seconds();
    hada_status status = HADA_OK;
    *reused = 0;
    if (!source || !is_done(source))
        return HADA_OK;
    pthread_mutex_lock(&source->lock); /* another worker may be filling it in */
    *reused = source->result.depths > 0;
    if (*reused)
        status = hada_result_copy(job->frame.result, &source->result, info, err);
    pthread_mutex_unlock(&source->lock);
    if (status || !*reused)
        return status;
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
    hada_cache_entry *entry = job->entry;
    if (!entry)
        return;
    const int known = hada_frame_examine(&job->frame, NULL) == HADA_OK; /* a failure is met again in the run */
    pthread_mutex_lock(&entry->lock);
    if (known)
        memcpy(entry->hash, job->frame.exposure.hash, sizeof entry->hash);
    entry->state = RUNS;
    pthread_cond_broadcast(&entry->changed);
    pthread_mutex_unlock(&entry->lock);
}

/* A result that is kept. Without memory for it the next frame is computed. */
static void keep(hada_cache_entry *entry, const hada_job *job)
{
    if (!entry->result.depths &&
        hada_result_copy(&entry->result, job->frame.result, hada_model_get_info(job->frame.setup->model), NULL))
        hada_result_destroy(&entry->result);
}

void hada_frame_cache_done(hada_job *job, hada_status status)
{
    hada_cache_entry *entry = job->entry, *source = job->source;
    if (source && !status && job->source_change == 0.0) { /* computed because its result was not kept */
        pthread_mutex_lock(&source->lock);
        keep(source, job);
        pthread_mutex_unlock(&source->lock);
    }
    if (!entry)
        return;
    if (!status && entry->keep)
        keep(entry, job);
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
