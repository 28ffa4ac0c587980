/* What a plan keeps of frames for later ones: the previous frame's result, for frames that equal it, and the weight of
 * total variation that a frame found, for those whose noise and light are the same.
 *
 * A frame that is submitted is compared with the last one by a few samples; if these agree, by the hashes of all
 * pixels, which examining a frame finds anyway. Pixels are not kept, and results are kept only while frames repeat: a
 * plan begins that way, stops after KEEP frames that do not repeat, and begins again at the next that does, which is
 * computed.
 *
 * Which frame finds a weight, and which ones take it, is decided by noise and light of frames in the order in which
 * they are submitted. A frame that takes a weight waits until it is found, by a worker that has begun before. Only
 * where that frame fails, or is handed on by a device that fails, does it find its own. */

#include "core/clock.h"
#include "dispatch/plan.h"

enum { WAITS, RUNS, DONE, FAILED };
enum { KEEP = 8 };

/* A frame takes the weight of one whose noise and light are at most so many times its own, and the other way round.
 * Those of a scene that moves were within 1.07 and 1.01; of different photographs, which want other weights, one or two
 * in ten were (perf/results/weights.md). */
#define SAME_NOISE 1.1
#define SAME_LIGHT 1.05

struct hada_cache_entry {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    int references;
    int state;
    int keep;            /* 1: its result is kept */
    uint64_t sample;     /* hada_exposure_sample() */
    uint64_t hash[2];    /* zeros: not known yet */
    hada_result result;  /* empty: not kept */
    double noise, light; /* of a frame that finds a weight: standard deviation, root mean square */
    double tv;           /* weight that it found, once DONE; 0: none */
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
    hada_result_destroy(&entry->result);
    free(entry);
}

void hada_frame_cache_free(hada_frame_cache *cache)
{
    release(cache->last);
    release(cache->chosen);
    cache->last = cache->chosen = NULL;
    pthread_mutex_destroy(&cache->lock);
}

/* Whether all pixels of the last frame are the job's; waits until the last one's worker has examined it. The last one
 * is held for the job then. */
static int is_equal(hada_cache_entry *last, hada_job *job)
{
    const uint64_t *hash = job->frame.exposure.hash;
    if (last->sample != hada_exposure_sample(&job->frame.exposure) || hada_frame_examine(&job->frame, NULL))
        return 0;
    pthread_mutex_lock(&last->lock);
    while (last->state <= RUNS && !last->hash[0])
        pthread_cond_wait(&last->changed, &last->lock);
    const int equal = last->state != FAILED && last->hash[0] == hash[0] && last->hash[1] == hash[1];
    last->references += equal;
    pthread_mutex_unlock(&last->lock);
    return equal;
}

/* The job's entry takes a place in the cache. */
static hada_status enter_as(hada_job *job, hada_cache_entry **place, hada_error *err)
{
    if (!job->entry) {
        HADA_TRY(HADA_NEW(job->entry, 1, "the previous frame", err));
        job->entry->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
        job->entry->changed = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
        job->entry->references = 1;
    }
    job->entry->references++;
    release(*place);
    *place = job->entry;
    return HADA_OK;
}

static hada_status become_last(hada_frame_cache *cache, hada_job *job, hada_error *err)
{
    HADA_TRY(enter_as(job, &cache->last, err));
    job->entry->sample = hada_exposure_sample(&job->frame.exposure);
    job->entry->keep = cache->keeps > 0;
    cache->keeps -= job->entry->keep;
    return HADA_OK;
}

static int alike(double a, double b, double factor)
{
    return a <= factor * b && b <= factor * a;
}

/* The job takes the weight that is kept, or finds one that is kept from now on. A frame that cannot be examined fails
 * when it is run. */
static hada_status share_weight(hada_frame_cache *cache, hada_job *job, hada_error *err)
{
    hada_cache_entry *chosen = cache->chosen;
    const hada_frame_exposure *exposure = &job->frame.exposure;
    if (!job->frame.setup->config.keep || hada_frame_examine(&job->frame, NULL))
        return HADA_OK;
    const double noise = hada_exposure_noise(exposure), light = hada_exposure_light(exposure);
    if (chosen && alike(noise, chosen->noise, SAME_NOISE) && alike(light, chosen->light, SAME_LIGHT)) {
        pthread_mutex_lock(&chosen->lock);
        chosen->references++;
        pthread_mutex_unlock(&chosen->lock);
        job->chooser = chosen;
        return HADA_OK;
    }
    HADA_TRY(enter_as(job, &cache->chosen, err));
    job->entry->noise = noise;
    job->entry->light = light;
    return HADA_OK;
}

hada_status hada_frame_cache_enter(hada_frame_cache *cache, hada_job *job, hada_error *err)
{
    const hada_setup *setup = job->frame.setup;
    hada_status status = HADA_OK;
    /* results are kept on the host alone */
    job->frame.hashed = setup->options.skip & HADA_SKIP_FRAMES && !hada_result_on_device(job->frame.result);
    if (!job->frame.hashed && !setup->config.keep)
        return HADA_OK;
    pthread_mutex_lock(&cache->lock);
    if (job->frame.hashed && cache->last && is_equal(cache->last, job)) {
        job->source = cache->last;
        cache->keeps = KEEP;
    } else if (job->frame.hashed) {
        HADA_TRY_OR_DONE(become_last(cache, job, err));
    }
    HADA_TRY_OR_DONE(share_weight(cache, job, err));
done:
    pthread_mutex_unlock(&cache->lock);
    return status;
}

/* Waits while a frame is computed. One that waits was handed on by a worker that failed: this worker may be the only
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
    report->seconds_total = hada_seconds() - start;
    return HADA_OK;
}

void hada_frame_cache_take(hada_job *job)
{
    if (!job->entry)
        return;
    pthread_mutex_lock(&job->entry->lock);
    job->entry->state = RUNS;
    pthread_mutex_unlock(&job->entry->lock);
}

void hada_frame_cache_begin(hada_job *job)
{
    hada_cache_entry *entry = job->entry;
    if (entry) {
        const int known = hada_frame_examine(&job->frame, NULL) == HADA_OK; /* a failure is met again in the run */
        pthread_mutex_lock(&entry->lock);
        if (known)
            memcpy(entry->hash, job->frame.exposure.hash, sizeof entry->hash);
        pthread_cond_broadcast(&entry->changed);
        pthread_mutex_unlock(&entry->lock);
    }
    job->frame.kept_tv = job->chooser && is_done(job->chooser) ? job->chooser->tv : 0.0;
}

void hada_frame_cache_done(hada_job *job, hada_status status)
{
    /* an equal frame was computed where the result of the first was not kept; it is now */
    hada_cache_entry *entry = job->entry ? job->entry : job->source;
    if (!entry)
        return;
    pthread_mutex_lock(&entry->lock);
    if (!status && (job->source || entry->keep) && !entry->result.depths &&
        hada_result_copy(&entry->result, job->frame.result, hada_model_get_info(job->frame.setup->model), NULL))
        hada_result_destroy(&entry->result); /* no memory: the next frame is computed as well */
    if (job->entry) {
        entry->state = status ? WAITS : DONE;
        entry->tv = status ? 0.0 : job->frame.result->report->refine_tv;
        pthread_cond_broadcast(&entry->changed);
    }
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
    release(job->chooser);
    job->entry = job->source = job->chooser = NULL;
}
