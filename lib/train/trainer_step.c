/* A step: waves of pairs through all workers, one gradient, one update; and what happens where numbers break down. */

#include "core/callers.h"
#include "core/clock.h"
#include "train/trainer.h"
#include "train/workers.h"

/* Steps between copies of the parameters to the host, which cost about a step; rollbacks in a row after which training
 * gives up: the rates are 2^-10 of what they were; and with good steps between them, but never beyond the one that
 * failed, by when the rates are next to nothing. */
enum { SNAPSHOT_EVERY = 25, MOST_ROLLBACKS = 10, MOST_STUCK = 200 };

/* Waves that are read ahead: the one at work and the next. */
enum { WAVES_AHEAD = 2 };

/* Keeps the quotient of clipping finite, as PyTorch's clip_grad_norm_ has it. */
#define CLIP_EPS 1e-6

static int is_known(void *user, int depth, int pair, int variant)
{
    return hada_examples_find(user, depth, pair, variant) != NULL;
}

static hada_status start_feed(hada_trainer *trainer, hada_error *err)
{
    const hada_train_options *options = &trainer->options;
    const int wave = options->at_once * trainer->workers.count;
    const hada_feed_desc desc = {.pairs = trainer->pairs,
                                 .info = &trainer->info,
                                 .augment = trainer->augment,
                                 .compose = options->compose,
                                 .planes_only = hada_trainer_shares(trainer),
                                 .seed = options->seed,
                                 .first = trainer->progress.place,
                                 .ahead = WAVES_AHEAD * wave,
                                 .batch = options->batch,
                                 .skip = trainer->first,
                                 .take = trainer->share,
                                 .known = hada_stage_keeps(&trainer->augment) ? is_known : NULL,
                                 .user = &trainer->known};
    return hada_feed_create(&trainer->feed, &desc, err);
}

/* Planes of composed scenes differ in their error by a factor of a hundred: each counts by the share that is taken off
 * its own, as PSNR does, where the plain error would have those that no net can mend decide alone. The error at which a
 * sample counts as it is, 30 dB; and 40 dB, where it stops to count more. */
#define ERROR_OF_ONE   1e-3
#define ERROR_OF_SHARP 1e-4
static double weight_of(const hada_example *example)
{
    const size_t count = hada_image_count(&example->scene);
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double difference = (double)example->input.data[i] - (double)example->scene.data[i];
        sum += difference * difference;
    }
    return ERROR_OF_ONE / (sum / (double)count + ERROR_OF_SHARP);
}

/* What the replica takes of a fed pair: a kept example, or *own. Flipping needs a copy of a kept one. */
static hada_status sample_of(hada_trainer *trainer, hada_worker *worker, hada_fed *fed, hada_example *own,
                             hada_sample *out, hada_error *err)
{
    const hada_augment *augment = &trainer->augment;
    const hada_stage stage = trainer->options.stage;
    const int flips = hada_stage_has_planes(stage) && augment->plane_flips, keeps = hada_stage_keeps(augment);
    const hada_example *known =
        fed->raw.data ? NULL : hada_examples_find(&trainer->known, fed->depth, fed->pair, fed->variant);
    int sides = 0;
    hada_example_free(own);
    if (!known) {
        HADA_TRY(hada_example_make(own, stage, &trainer->info, worker->planes, fed->depth, &fed->raw, &fed->composed,
                                   &fed->scene, err));
        if (keeps)
            known = hada_examples_add(&trainer->known, fed->depth, fed->pair, fed->variant, own);
    }
    if (known && flips) {
        hada_example_free(own);
        HADA_TRY(hada_example_copy(own, known, err));
        known = NULL;
    }
    if (flips)
        sides = hada_augment_plane(augment, trainer->options.seed, fed->place, &own->input, &own->scene);
    const hada_example *example = known ? known : own;
    *out = (hada_sample){.depth = fed->depth, .input = &example->input, .scene = &example->scene};
    if (trainer->options.compose > 0.0)
        out->weight = weight_of(example);
    if (keeps && !fed->variant)
        out->scene_number =
            1 + HADA_FLIPPED_WAYS * hada_pairs_number(trainer->pairs, fed->depth, fed->pair) + (size_t)sides;
    return HADA_OK;
}

/* The pairs of a wave, which the workers share: as many for each as can be, in order. */
typedef struct wave {
    hada_trainer *trainer;
    int count, discriminator_only;
    int last; /* of the step */
} wave;

static int first_of(const wave *all, int worker, int workers)
{
    return (int)((long long)all->count * worker / workers);
}

static hada_status compute(hada_workers *workers, int number, void *user, hada_error *err)
{
    const wave *all = user;
    hada_trainer *trainer = all->trainer;
    hada_worker *worker = &workers->worker[number];
    const int first = first_of(all, number, workers->count), count = first_of(all, number + 1, workers->count) - first;
    memset(&worker->terms, 0, sizeof worker->terms);
    for (int i = 0; i < count; i++)
        HADA_TRY(sample_of(trainer, worker, trainer->fed[first + i], &worker->own[i], &worker->samples[i], err));
    hada_replica_share(worker->replica, all->last && workers->buckets.values ? &workers->buckets : NULL);
    if (count)
        HADA_TRY(hada_replica_backward(worker->replica, worker->samples, count, 1.0 / trainer->options.batch,
                                       trainer->fed[first]->place, all->discriminator_only, &worker->terms,
                                       worker->touched, err));
    return HADA_OK;
}

static void clear(hada_trainer *trainer)
{
    for (int i = 0; i < trainer->workers.count; i++) {
        hada_worker *worker = &trainer->workers.worker[i];
        memset(worker->touched, 0, (size_t)trainer->info.depths);
        hada_parameters_clear(hada_worker_parameters(worker));
    }
}

/* hada_terms as an array. */
enum { TERMS = sizeof(hada_terms) / sizeof(double) };

static void add_terms(hada_terms *sum, const hada_terms *terms)
{
    sum->mse += terms->mse;
    sum->perceptual += terms->perceptual;
    sum->adversarial += terms->adversarial;
    sum->variation += terms->variation;
    sum->discriminator += terms->discriminator;
}

/* Terms, and which depths have a gradient, of all ranks; whether one of them cannot go on is not known here: it ends
 * them all. */
static hada_status share_terms(hada_trainer *trainer, hada_terms *terms, hada_error *err)
{
    const size_t depths = (size_t)trainer->info.depths;
    unsigned char *touched = trainer->workers.worker->touched;
    double *values = NULL;
    hada_status status = HADA_OK;
    if (trainer->ranks.count == 1)
        return HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(values, TERMS + depths, "a step", err));
    memcpy(values, terms, sizeof *terms);
    for (size_t z = 0; z < depths; z++)
        values[TERMS + z] = touched[z];
    HADA_TRY_OR_DONE(hada_reduce(&trainer->ranks, values, TERMS + depths, err));
    memcpy(terms, values, sizeof *terms);
    for (size_t z = 0; z < depths; z++)
        touched[z] = values[TERMS + z] > 0.0;
done:
    free(values);
    return status;
}

/* Gradients and terms of all pairs of a step. */
static hada_status gather(hada_trainer *trainer, int discriminator_only, hada_terms *terms, hada_error *err)
{
    hada_workers *workers = &trainer->workers;
    const int most = trainer->options.at_once * workers->count;
    clear(trainer);
    for (int left = trainer->share; left;) {
        wave all = {trainer, left < most ? left : most, discriminator_only, left <= most};
        HADA_TRY(hada_feed_take(trainer->feed, all.count, trainer->fed, err));
        HADA_TRY(hada_workers_run(workers, compute, &all, err));
        for (int i = 0; i < workers->count; i++)
            add_terms(terms, &workers->worker[i].terms);
        left -= all.count;
    }
    trainer->progress.place += (uint64_t)trainer->options.batch;
    for (int i = 1; i < workers->count; i++)
        for (int z = 0; z < trainer->info.depths; z++)
            workers->worker->touched[z] |= workers->worker[i].touched[z];
    return share_terms(trainer, terms, err);
}

/* Whether a group is updated in this step. */
static int takes_part(const hada_trainer *trainer, int group, int discriminator_only)
{
    if (!hada_workers_have(&trainer->workers, group))
        return 0;
    if (group == HADA_GROUP_DISCRIMINATOR || discriminator_only)
        return group == HADA_GROUP_DISCRIMINATOR;
    return group == HADA_GROUP_NET || trainer->workers.worker->touched[group - HADA_GROUP_FILTERS];
}

/* One gradient of all workers', and its norms. */
static hada_status sum_up(hada_trainer *trainer, int discriminator_only, double *norm, double *discriminator_norm,
                          hada_error *err)
{
    hada_workers *workers = &trainer->workers;
    double squares = 0.0, discriminator = 0.0;
    if (workers->count == 1 && trainer->ranks.count == 1)
        return hada_parameters_norm(hada_worker_parameters(workers->worker), workers->worker->touched, norm,
                                    discriminator_norm, err);
    for (int g = 0; g < workers->groups; g++)
        if (takes_part(trainer, g, discriminator_only))
            HADA_TRY(
                hada_exchange_gradients(workers, g, g == HADA_GROUP_DISCRIMINATOR ? &discriminator : &squares, err));
    *norm = sqrt(squares);
    *discriminator_norm = sqrt(discriminator);
    return HADA_OK;
}

/* An update of a group; step: its own count, from 1. */
typedef struct change {
    int group;
    uint64_t step;
    double rate, scale;
} change;

static hada_status update_one(hada_workers *workers, int number, void *user, hada_error *err)
{
    const change *what = user;
    return hada_parameters_update(hada_worker_parameters(&workers->worker[number]), what->group, what->step, what->rate,
                                  what->scale, err);
}

static double scale_for(double norm, double clip)
{
    return clip > 0.0 && norm > clip ? clip / (norm + CLIP_EPS) : 1.0;
}

static hada_status update(hada_trainer *trainer, int discriminator_only, double share, double norm,
                          double discriminator_norm, hada_error *err)
{
    const hada_train_options *options = &trainer->options;
    hada_workers *workers = &trainer->workers;
    hada_train_progress *progress = &trainer->progress;
    trainer->snapshot.dirty[HADA_GROUP_NET] = 1;
    for (int g = 0; g < workers->groups; g++) {
        if (!takes_part(trainer, g, discriminator_only))
            continue;
        const int discriminator = g == HADA_GROUP_DISCRIMINATOR;
        const double rate = discriminator         ? options->discriminator_rate
                            : g == HADA_GROUP_NET ? options->rate
                                                  : options->filter_rate;
        change what = {g, progress->group_steps[g] + 1, rate * share,
                       scale_for(discriminator ? discriminator_norm : norm, options->clip)};
        trainer->snapshot.dirty[g] = 1;
        HADA_TRY(hada_workers_run(workers, update_one, &what, err));
        HADA_TRY(hada_exchange_values(workers, g, err));
        progress->group_steps[g]++;
    }
    /* statistics of batch norms have changed without the net's being updated */
    if (discriminator_only)
        HADA_TRY(hada_exchange_values(workers, HADA_GROUP_NET, err));
    return HADA_OK;
}

static hada_status roll_back(hada_trainer *trainer, hada_step_report *report, hada_error *err)
{
    hada_train_progress *progress = &trainer->progress;
    const uint64_t at = progress->step + 1;
    hada_status status = HADA_OK;
    HADA_TRY(hada_snapshot_restore(&trainer->snapshot, &trainer->workers, progress, err));
    progress->halvings++;
    progress->failed = at;
    report->rolled_back = 1;
    report->step = progress->step;
    if (++progress->bad >= MOST_ROLLBACKS || ++progress->stuck >= MOST_STUCK)
        status = hada_fail(
            err, HADA_ERROR_NUMERIC,
            "loss or gradient were not finite in step %llu, and %d smaller rates did not help; the parameters are "
            "those of step %llu. Begin with a rate a tenth as large, a smaller clip, or look for a pair that is much "
            "brighter than the others",
            (unsigned long long)at, progress->halvings, (unsigned long long)progress->step);
    return status;
}

static void fill_report(const hada_trainer *trainer, const hada_terms *terms, int discriminator_only, double norm,
                        double share, hada_step_report *report)
{
    const hada_train_options *options = &trainer->options;
    const int all = !discriminator_only;
    report->mse = all && options->mse > 0.0 ? terms->mse : NAN;
    report->perceptual = all && options->perceptual > 0.0 ? terms->perceptual : NAN;
    report->adversarial = all && options->adversarial > 0.0 ? terms->adversarial : NAN;
    report->variation = all && options->variation > 0.0 ? terms->variation : NAN;
    report->discriminator = trainer->nets.discriminator ? terms->discriminator : NAN;
    report->loss = discriminator_only ? terms->discriminator
                                      : terms->mse + terms->perceptual + terms->adversarial + terms->variation;
    report->norm = norm;
    report->rate = share * (discriminator_only                     ? options->discriminator_rate
                            : options->stage == HADA_STAGE_FILTERS ? options->filter_rate
                                                                   : options->rate);
    report->discriminator_only = discriminator_only;
}

static hada_status step(hada_trainer *trainer, hada_step_report *report, hada_error *err)
{
    hada_train_progress *progress = &trainer->progress;
    const int discriminator_only = progress->step < trainer->options.discriminator_steps;
    const double share = ldexp(hada_train_rate(&trainer->options, progress->step), -progress->halvings);
    hada_terms terms = {0};
    double norm = 0.0, discriminator_norm = 0.0;
    if (!trainer->feed)
        HADA_TRY(start_feed(trainer, err));
    HADA_TRY(gather(trainer, discriminator_only, &terms, err));
    HADA_TRY(sum_up(trainer, discriminator_only, &norm, &discriminator_norm, err));
    if (discriminator_only)
        norm = discriminator_norm;
    fill_report(trainer, &terms, discriminator_only, norm, share, report);
    if (!isfinite(report->loss + norm + (trainer->nets.discriminator ? terms.discriminator + discriminator_norm : 0.0)))
        return roll_back(trainer, report, err);
    /* These parameters gave finite numbers: they are good. */
    if (progress->step % SNAPSHOT_EVERY == 0)
        HADA_TRY(hada_snapshot_take(&trainer->snapshot, &trainer->workers, progress, err));
    HADA_TRY(update(trainer, discriminator_only, share, norm, discriminator_norm, err));
    progress->bad = 0;
    report->step = ++progress->step;
    if (progress->step >= progress->failed)
        progress->stuck = 0;
    return HADA_OK;
}

hada_status hada_trainer_step(hada_trainer *trainer, hada_step_report *report, hada_error *err)
{
    hada_step_report own = {0};
    const double start = hada_seconds();
    HADA_NEED(trainer, err);
    HADA_TRY(HADA_REPORT_CHECK(report, hada_step_report, err));
    hada_status status = step(trainer, &own, err);
    own.seconds = hada_seconds() - start;
    if (report)
        HADA_REPORT_GIVE(report, &own);
    return status;
}
