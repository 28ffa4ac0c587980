/* A step: waves of pairs through all workers, one gradient, one update; and what happens where numbers break down. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"
#include "core/options.h"
#include "train/trainer.h"

enum { SNAPSHOT_EVERY = 25, MOST_ROLLBACKS = 10 };

static int is_known(void *user, int depth, int pair)
{
    return hada_examples_find(user, depth, pair) != NULL;
}

static hada_status start_feed(hada_trainer *trainer, hada_error *err)
{
    const hada_train_options *options = &trainer->options;
    const int wave = options->at_once * trainer->worker_count;
    const hada_feed_desc desc = {.pairs = &trainer->pairs,
                                 .info = &trainer->info,
                                 .augment = trainer->augment,
                                 .seed = options->seed,
                                 .first = trainer->progress.place,
                                 .ahead = 2 * wave,
                                 .known = hada_stage_keeps(&trainer->augment) ? is_known : NULL,
                                 .user = &trainer->known};
    return hada_feed_create(&trainer->feed, &desc, err);
}

/* What the engine sees of a fed pair: a kept example, or *own. Flipping needs a copy of a kept one. */
static hada_status sample_of(hada_trainer *trainer, hada_worker *worker, hada_fed *fed, hada_example *own,
                             hada_sample *out, hada_error *err)
{
    const hada_augment *augment = &trainer->augment;
    const int flips = hada_stage_has_planes(trainer->options.stage) && augment->plane_flips;
    const hada_example *known = fed->raw.data ? NULL : hada_examples_find(&trainer->known, fed->depth, fed->pair);
    hada_status status = HADA_OK;
    int sides = 0;
    hada_example_free(own);
    if (!known) {
        status = hada_example_make(own, trainer, worker, fed->depth, &fed->raw, &fed->scene, err);
        if (status)
            return status;
        if (hada_stage_keeps(augment))
            known = hada_examples_add(&trainer->known, fed->depth, fed->pair, own);
    }
    if (known && flips) {
        hada_example_free(own);
        status = hada_example_copy(own, known, err);
        known = NULL;
    }
    if (!status && flips)
        sides = hada_augment_plane(augment, trainer->options.seed, fed->place, &own->input, &own->scene);
    const hada_example *example = known ? known : own;
    *out = (hada_sample){.depth = fed->depth, .input = &example->input, .scene = &example->scene};
    if (hada_stage_keeps(augment))
        out->scene_number =
            1 + HADA_FLIPPED_WAYS * hada_examples_number(&trainer->known, fed->depth, fed->pair) + (size_t)sides;
    return status;
}

/* The pairs of a wave that are a worker's: as many for each as can be, in order. */
typedef struct wave {
    int count, critic_only;
} wave;

static int first_of(const wave *all, int worker, int workers)
{
    return (int)((long long)all->count * worker / workers);
}

static hada_status compute(hada_trainer *trainer, int number, void *user, hada_error *err)
{
    const wave *all = user;
    hada_worker *worker = &trainer->workers[number];
    const int first = first_of(all, number, trainer->worker_count);
    const int count = first_of(all, number + 1, trainer->worker_count) - first;
    hada_status status = HADA_OK;
    memset(&worker->terms, 0, sizeof worker->terms);
    for (int i = 0; !status && i < count; i++) {
        status = sample_of(trainer, worker, trainer->fed[first + i], &worker->own[i], &worker->samples[i], err);
    }
    if (status || !count)
        return status;
    return hada_engine_backward(worker->engine, worker->samples, count, 1.0 / trainer->options.batch,
                                trainer->fed[first]->place, all->critic_only, &worker->terms, worker->touched, err);
}

static hada_status clear(hada_trainer *trainer, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < trainer->worker_count; i++) {
        memset(trainer->workers[i].touched, 0, (size_t)trainer->info.depths);
        status = hada_engine_clear(trainer->workers[i].engine, err);
    }
    return status;
}

static void add_terms(hada_terms *sum, const hada_terms *terms)
{
    sum->mse += terms->mse;
    sum->perceptual += terms->perceptual;
    sum->adversarial += terms->adversarial;
    sum->variation += terms->variation;
    sum->critic += terms->critic;
}

/* Gradients and terms of all pairs of a step. */
static hada_status gather(hada_trainer *trainer, int critic_only, hada_terms *terms, hada_error *err)
{
    const int most = trainer->options.at_once * trainer->worker_count;
    hada_status status = clear(trainer, err);
    for (int left = trainer->options.batch; !status && left;) {
        wave all = {left < most ? left : most, critic_only};
        status = hada_feed_take(trainer->feed, all.count, trainer->fed, err);
        if (!status)
            status = hada_workers_run(trainer, compute, &all, err);
        for (int i = 0; !status && i < trainer->worker_count; i++)
            add_terms(terms, &trainer->workers[i].terms);
        trainer->progress.place += (uint64_t)all.count;
        left -= all.count;
    }
    for (int i = 1; i < trainer->worker_count; i++)
        for (int z = 0; z < trainer->info.depths; z++)
            trainer->workers->touched[z] |= trainer->workers[i].touched[z];
    return status;
}

/* Whether a group is updated in this step. */
static int takes_part(const hada_trainer *trainer, int group, int critic_only)
{
    if (!hada_trainer_has(trainer, group))
        return 0;
    if (group == HADA_GROUP_CRITIC || critic_only)
        return group == HADA_GROUP_CRITIC;
    return group == HADA_GROUP_NET || trainer->workers->touched[group - HADA_GROUP_FILTERS];
}

/* One gradient of all workers', and its norms. */
static hada_status sum_up(hada_trainer *trainer, int critic_only, double *norm, double *critic_norm, hada_error *err)
{
    double squares = 0.0, critic = 0.0;
    hada_status status = HADA_OK;
    if (trainer->worker_count == 1)
        return hada_engine_norm(trainer->workers->engine, trainer->workers->touched, norm, critic_norm, err);
    for (int g = 0; !status && g < trainer->groups; g++)
        if (takes_part(trainer, g, critic_only))
            status = hada_train_sum_gradients(trainer, g, g == HADA_GROUP_CRITIC ? &critic : &squares, err);
    *norm = sqrt(squares);
    *critic_norm = sqrt(critic);
    return status;
}

typedef struct change {
    int group;
    double rate, scale;
} change;

static hada_status update_one(hada_trainer *trainer, int number, void *user, hada_error *err)
{
    const change *what = user;
    return hada_engine_update(trainer->workers[number].engine, what->group,
                              trainer->progress.group_steps[what->group] + 1, what->rate, what->scale, err);
}

static double scale_for(double norm, double clip)
{
    return clip > 0.0 && norm > clip ? clip / (norm + 1e-6) : 1.0;
}

static hada_status update(hada_trainer *trainer, int critic_only, double share, double norm, double critic_norm,
                          hada_error *err)
{
    const hada_train_options *options = &trainer->options;
    hada_status status = HADA_OK;
    trainer->snapshot.dirty[HADA_GROUP_NET] = 1;
    for (int g = 0; !status && g < trainer->groups; g++) {
        if (!takes_part(trainer, g, critic_only))
            continue;
        const int critic = g == HADA_GROUP_CRITIC;
        const double rate = critic ? options->critic_rate : g == HADA_GROUP_NET ? options->rate : options->filter_rate;
        change what = {g, rate * share, scale_for(critic ? critic_norm : norm, options->clip)};
        trainer->snapshot.dirty[g] = 1;
        status = hada_workers_run(trainer, update_one, &what, err);
        if (!status)
            status = hada_train_share_values(trainer, g, err);
        trainer->progress.group_steps[g] += !status;
    }
    /* batch norms have looked at pairs without the net's being updated */
    if (!status && critic_only)
        status = hada_train_share_values(trainer, HADA_GROUP_NET, err);
    return status;
}

static hada_status roll_back(hada_trainer *trainer, hada_step_report *report, hada_error *err)
{
    hada_progress *progress = &trainer->progress;
    const uint64_t at = progress->step + 1;
    hada_status status = hada_snapshot_restore(trainer, err);
    if (status)
        return status;
    progress->halvings++;
    report->rolled_back = 1;
    report->step = progress->step;
    if (++progress->bad < MOST_ROLLBACKS)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_NUMERIC,
                     "loss or gradient were not finite in step %llu, and %d smaller rates did not help; the parameters "
                     "are those of step %llu. Begin with a rate a tenth as large, a smaller clip, or look for a pair "
                     "that is much brighter than the others",
                     (unsigned long long)at, MOST_ROLLBACKS, (unsigned long long)progress->step);
}

static void fill_report(const hada_trainer *trainer, const hada_terms *terms, int critic_only, double norm,
                        double share, hada_step_report *report)
{
    const hada_train_options *options = &trainer->options;
    const int all = !critic_only;
    report->mse = all && options->mse > 0.0 ? terms->mse : NAN;
    report->perceptual = all && options->perceptual > 0.0 ? terms->perceptual : NAN;
    report->adversarial = all && options->adversarial > 0.0 ? terms->adversarial : NAN;
    report->variation = all && options->variation > 0.0 ? terms->variation : NAN;
    report->critic = trainer->critic ? terms->critic : NAN;
    report->loss = critic_only ? terms->critic : terms->mse + terms->perceptual + terms->adversarial + terms->variation;
    report->norm = norm;
    report->rate = share * (critic_only                            ? options->critic_rate
                            : options->stage == HADA_STAGE_FILTERS ? options->filter_rate
                                                                   : options->rate);
    report->critic_only = critic_only;
}

static hada_status step(hada_trainer *trainer, hada_step_report *report, hada_error *err)
{
    hada_progress *progress = &trainer->progress;
    const int critic_only = progress->step < trainer->options.critic_steps;
    const double share = ldexp(hada_train_rate(&trainer->options, progress->step), -progress->halvings);
    hada_terms terms = {0};
    double norm = 0.0, critic_norm = 0.0;
    hada_status status = trainer->feed ? HADA_OK : start_feed(trainer, err);
    if (!status)
        status = gather(trainer, critic_only, &terms, err);
    if (!status)
        status = sum_up(trainer, critic_only, &norm, &critic_norm, err);
    if (status)
        return status;
    if (critic_only)
        norm = critic_norm;
    fill_report(trainer, &terms, critic_only, norm, share, report);
    const double all = report->loss + norm + (trainer->critic ? terms.critic + critic_norm : 0.0);
    if (!isfinite(all))
        return roll_back(trainer, report, err);
    /* These parameters gave finite numbers: they are good. */
    if (progress->step % SNAPSHOT_EVERY == 0)
        status = hada_snapshot_take(trainer, err);
    if (!status)
        status = update(trainer, critic_only, share, norm, critic_norm, err);
    if (status)
        return status;
    progress->bad = 0;
    report->step = ++progress->step;
    return HADA_OK;
}

hada_status hada_trainer_step(hada_trainer *trainer, hada_step_report *report, hada_error *err)
{
    hada_step_report own = {0};
    const double start = hada_seconds();
    if (!trainer)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_trainer_step: a trainer is needed");
    hada_status status = HADA_REPORT_CHECK(report, hada_step_report, err);
    if (status)
        return status;
    status = step(trainer, &own, err);
    own.seconds = hada_seconds() - start;
    if (report)
        HADA_REPORT_GIVE(report, &own);
    return status;
}
