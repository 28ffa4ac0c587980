/* A run of a classic method. */
#include <math.h>
#include <stdlib.h>

#include "classic/classic_steps.h"
#include "core/base.h"
#include "core/clock.h"

/* Iterations that may be in the queue, so that a run can be cancelled between them. */
enum { QUEUED = 8 };

typedef struct method {
    hada_classic_begin_call begin;
    hada_classic_step_call step;
} method;
static const method methods[] = {[HADA_METHOD_RL] = {hada_classic_rl_begin, hada_classic_rl_step},
                                 [HADA_METHOD_FISTA] = {hada_classic_fista_begin, hada_classic_fista_step},
                                 [HADA_METHOD_ADMM] = {hada_classic_admm_begin, hada_classic_admm_step}};

static hada_status check_job(const hada_classic *classic, const hada_classic_job *job, hada_error *err)
{
    if (job->depths < 1 || job->depths > classic->shape.place.max_planes)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%d depths asked for; %d were planned", job->depths,
                         classic->shape.place.max_planes);
    for (int i = 0; i < job->depths; i++)
        if (job->list[i] < 0 || job->list[i] >= job->data->otf_depths)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "depth %d asked for; there are %d", job->list[i],
                             job->data->otf_depths);
    if (classic->bytes[HADA_CLASSIC_FRAME] && !job->data->frame)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "this method needs the frame's pixels");
    return HADA_OK;
}

/* Memory that other parts of a slot used meanwhile is cleared; some buffers are written anyway before they are read. */
static hada_status clear(hada_classic *classic, hada_error *err)
{
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        if (i != HADA_CLASSIC_LIST && i != HADA_CLASSIC_WINDOW && i != HADA_CLASSIC_TABLE &&
            i != HADA_CLASSIC_SPECTRA && i != HADA_CLASSIC_FRAME && i != HADA_CLASSIC_WEIGHTS)
            HADA_TRY(hada_classic_clear(classic, (hada_classic_part)i, err));
    return HADA_OK;
}

hada_status hada_classic_weigh(hada_classic *classic, cl_mem weights, hada_error *err)
{
    classic->weighted = weights && classic->bytes[HADA_CLASSIC_WEIGHTS];
    return classic->weighted ? hada_classic_load(classic, HADA_CLASSIC_WEIGHTS, weights, 0, err) : HADA_OK;
}

/* The depths of the job; with components, all of each. */
static hada_status write_list(hada_classic *classic, const hada_classic_job *job, hada_error *err)
{
    hada_buffer *list = &classic->part[HADA_CLASSIC_LIST];
    const int components = classic->shape.components, terms = job->depths * components;
    cl_int *terms_of = NULL;
    hada_status status = HADA_OK;
    if (components == 1)
        return hada_buffer_write(list, classic->slot, 0, job->list, (size_t)job->depths * sizeof(cl_int), err);
    HADA_TRY_OR_DONE(HADA_NEW(terms_of, (size_t)terms, "a list of components", err));
    for (int i = 0; i < terms; i++)
        terms_of[i] = job->list[i / components] * components + i % components;
    HADA_TRY_OR_DONE(hada_buffer_write(list, classic->slot, 0, terms_of, (size_t)terms * sizeof(cl_int), err));
done:
    free(terms_of);
    return status;
}

hada_status hada_classic_ready(hada_classic *classic, const hada_classic_job *job, hada_error *err)
{
    HADA_TRY(check_job(classic, job, err));
    classic->job = job;
    classic->planes = job->depths * classic->shape.place.channels;
    classic->momentum = 1.0;
    classic->weighted = 0;
    classic->weight = job->weight;
    classic->sieve = classic->shape.sieve ? job->sieve : 0.0;
    classic->taps = 0.0;
    HADA_TRY(clear(classic, err));
    HADA_TRY(write_list(classic, job, err));
    if (classic->bytes[HADA_CLASSIC_FRAME])
        HADA_TRY(hada_classic_load(classic, HADA_CLASSIC_FRAME, job->data->frame, job->data->frame_offset, err));
    return hada_classic_weigh(classic, job->data->weights, err);
}

static hada_status wiener(hada_classic *classic, hada_error *err)
{
    const double noise = classic->shape.options.lambda * classic->job->camera->mean_square;
    hada_classic_gradient_power(classic, 1);
    HADA_TRY(hada_classic_write_table(classic, err));
    HADA_TRY(hada_classic_solve(classic, 1, 1.0, 0.0, noise, err));
    return hada_classic_inverse(classic, HADA_CLASSIC_PRIMAL, err);
}

hada_status hada_classic_step(hada_classic *classic, int first, int number, hada_error *err)
{
    const method *m = &methods[classic->shape.options.method];
    double sums[2];
    for (int k = 0; k < number; k++) {
        if (!k)
            HADA_TRY(m->begin(classic, err));
        HADA_TRY(m->step(classic, first + k, 0, sums, err));
    }
    return HADA_OK;
}

/* Until the relative change was small twice running, or a limit is reached. */
static hada_status iterate(hada_classic *classic, int *count, hada_error *err)
{
    const hada_classic_options *o = &classic->shape.options;
    const method *m = &methods[o->method];
    const hada_classic_job *job = classic->job;
    const double start = hada_seconds();
    const int most = job->iterations ? job->iterations : o->iterations;
    int settled = 0;
    if (!job->before)
        HADA_TRY(m->begin(classic, err));
    while (*count < most && settled < 2) {
        double sums[2] = {1.0, 1.0};
        HADA_TRY(m->step(classic, *count, o->stop > 0.0, sums, err));
        ++*count;
        settled = o->stop > 0.0 && sqrt(sums[0]) <= o->stop * sqrt(sums[1]) ? settled + 1 : 0;
        if (o->seconds > 0.0 || *count % QUEUED == 0)
            HADA_TRY(hada_slot_finish(classic->slot, err));
        if (o->seconds > 0.0 && hada_seconds() - start >= o->seconds)
            break;
        if (job->progress && *count % QUEUED == 0)
            job->progress(job->user, *count);
    }
    return HADA_OK;
}

hada_status hada_classic_run(hada_classic *classic, const hada_classic_job *job, hada_classic_result *result,
                             hada_error *err)
{
    *result = (hada_classic_result){.iterations = job->before};
    if (!job->before)
        HADA_TRY(hada_classic_ready(classic, job, err));
    classic->job = job;
    if (job->before && job->anew) {
        HADA_TRY(hada_classic_weigh(classic, job->data->weights, err));
        HADA_TRY(hada_classic_rl_anew(classic, job->sieve, err));
    }
    HADA_TRY(classic->shape.options.method == HADA_METHOD_WIENER ? wiener(classic, err)
                                                                 : iterate(classic, &result->iterations, err));
    HADA_TRY(hada_classic_crop(classic, err));
    return hada_classic_energy(classic, &result->energy, err);
}
