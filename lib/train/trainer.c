/* Making and unmaking trainers. */
#include "train/trainer.h"

#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "core/alloc.h"
#include "core/options.h"
#include "model/model.h"

/* What is kept of pairs, held-out ones included, and of what VGG-16 makes of them. */
#define KEPT_BYTES    ((size_t)1 << 30)
#define KEPT_FEATURES (KEPT_BYTES / 4) /* where there is a perceptual term */

void hada_pairs_defaults(hada_pairs *pairs, size_t size)
{
    const hada_pairs own = {.size = sizeof own};
    HADA_OPTIONS_GIVE(pairs, size, &own);
}

static hada_status check_pairs(const hada_pairs *pairs, const hada_model_info *info, const char *what, hada_error *err)
{
    if (pairs->depths != info->depths || !pairs->counts || !pairs->read)
        return hada_fail(err, HADA_ERROR_MODEL, "the pairs %s stand at %d depths, the model knows %d", what,
                         pairs->depths, info->depths);
    for (int z = 0; z < pairs->depths; z++)
        if (pairs->counts[z] < 0)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "depth %d has %d pairs", z, pairs->counts[z]);
    return HADA_OK;
}

/* The most samples at once, up to a device's share of a step, that fit into half of its memory; a divisor of the share,
 * since a call that is not full takes as long as a full one. */
static hada_status choose_at_once(int *out, const hada_context *context, const hada_train_options *options, int share,
                                  const hada_engine_desc *desc, hada_error *err)
{
    hada_engine_desc trial = *desc;
    const uint64_t room = hada_context_device(context)->memory_bytes / 2;
    hada_status status = HADA_OK;
    const int open = options->at_once == HADA_AUTO;
    for (int count = !open && options->at_once < share ? options->at_once : share; count >= 1; count--) {
        size_t bytes = 0;
        if (share % count && open)
            continue;
        *out = trial.at_once = count;
        if (!open || count == 1)
            return HADA_OK;
        status = hada_engine_bytes(context, &trial, &bytes, err);
        if (status || bytes <= room)
            return status;
    }
    return status;
}

static int share_of(const hada_train_options *options, int workers)
{
    return (options->batch + workers - 1) / workers;
}

static hada_status make_worker(hada_trainer *trainer, int number, hada_context *context, hada_error *err)
{
    hada_worker *worker = &trainer->workers[number];
    const hada_train_options *options = &trainer->options;
    const size_t most = (size_t)options->at_once;
    const size_t scenes =
        hada_stage_keeps(&trainer->augment) ? HADA_FLIPPED_WAYS * (size_t)hada_pairs_total(&trainer->pairs) : 0;
    const hada_engine_desc desc = {.model = trainer->model,
                                   .options = options,
                                   .net = trainer->net,
                                   .critic = trainer->critic,
                                   .vgg = trainer->vgg,
                                   .at_once = options->at_once,
                                   .share = number,
                                   .shares = trainer->worker_count,
                                   .scenes = scenes,
                                   .feature_bytes = KEPT_FEATURES / (size_t)trainer->worker_count};
    hada_status status = hada_slot_create(&worker->slot, context, err);
    if (!status)
        status = hada_engine_create(&worker->engine, worker->slot, &desc, err);
    if (!status && hada_stage_has_planes(options->stage))
        status = hada_planes_create(&worker->planes, worker->slot, trainer->model, err);
    if (!status)
        status = hada_alloc((void **)&worker->samples, most, sizeof *worker->samples, "a step", err);
    if (!status)
        status = hada_alloc((void **)&worker->own, most, sizeof *worker->own, "a step", err);
    if (!status)
        status = hada_alloc((void **)&worker->touched, (size_t)trainer->info.depths, 1, "a step", err);
    return status;
}

/* Room for what workers exchange: a depth's filters. */
static hada_status make_exchange(hada_trainer *trainer, hada_error *err)
{
    size_t most = 0;
    hada_status status = HADA_OK;
    for (int g = HADA_GROUP_FILTERS; g < trainer->groups; g++) {
        const size_t count = hada_engine_count(trainer->workers->engine, g, HADA_CONTENT_VALUES);
        most = count > most ? count : most;
    }
    for (int i = 0; !status && most && trainer->worker_count > 1 && i < trainer->worker_count; i++)
        status = hada_alloc_raw((void **)&trainer->workers[i].room, most, sizeof(float), "averaging", err);
    return status;
}

static uint64_t fingerprint_of(const hada_model *model)
{
    const size_t values = (size_t)model->info.depths * (size_t)model->info.channels * hada_model_plane(model) * 2;
    return (uint64_t)(model->filter ? XXH3_64bits(model->filter, values * sizeof *model->filter)
                                    : XXH3_64bits(model->filter_half, values * sizeof *model->filter_half));
}

static hada_status make_workers(hada_trainer *trainer, hada_context *const *contexts, int count, hada_error *err)
{
    const hada_engine_desc desc = {.model = trainer->model,
                                   .options = &trainer->options,
                                   .net = trainer->net,
                                   .critic = trainer->critic,
                                   .vgg = trainer->vgg,
                                   .shares = count};
    const int share = share_of(&trainer->options, count);
    int at_once = share;
    hada_status status =
        hada_alloc((void **)&trainer->workers, (size_t)count, sizeof *trainer->workers, "a trainer", err);
    for (int i = 0; !status && i < count; i++) {
        int own = 0;
        status = choose_at_once(&own, contexts[i], &trainer->options, share, &desc, err);
        at_once = own < at_once ? own : at_once;
    }
    trainer->options.at_once = at_once;
    trainer->worker_count = status ? 0 : count;
    if (!status && count > 1)
        status = hada_crew_create(&trainer->crew, count, err);
    for (int i = 0; !status && i < count; i++) {
        status = make_worker(trainer, i, contexts[i], err);
        if (status && count > 1)
            hada_error_prefix(err, "device %d: ", i);
    }
    if (status)
        return status;
    trainer->groups = hada_engine_groups(trainer->workers->engine);
    return make_exchange(trainer, err);
}

static hada_status make_lists(hada_trainer *trainer, hada_error *err)
{
    const size_t wave = (size_t)trainer->options.at_once * (size_t)trainer->worker_count;
    hada_status status = hada_alloc((void **)&trainer->fed, wave, sizeof(hada_fed *), "a step", err);
    if (!status)
        status = hada_alloc((void **)&trainer->progress.group_steps, (size_t)trainer->groups, sizeof(uint64_t),
                            "a trainer", err);
    if (!status)
        status = hada_examples_create(&trainer->known, &trainer->pairs,
                                      KEPT_BYTES / 4 * 3 - (trainer->vgg ? KEPT_FEATURES : 0), err);
    if (!status && trainer->held_out.read)
        status = hada_examples_create(&trainer->held, &trainer->held_out, KEPT_BYTES / 4, err);
    return status;
}

static hada_status make(hada_trainer *trainer, hada_context *const *contexts, int count,
                        const hada_train_options *callers, hada_error *err)
{
    hada_train_nets nets;
    hada_status status = hada_train_options_settle(&trainer->options, &trainer->augment, callers, trainer->model, err);
    if (!status)
        status = check_pairs(&trainer->pairs, &trainer->info, "to learn from", err);
    if (!status && !hada_pairs_total(&trainer->pairs))
        status = hada_fail(err, HADA_ERROR_ARGUMENT, "there is no pair to learn from; hold fewer out, or add some");
    if (!status && trainer->held_out.read)
        status = check_pairs(&trainer->held_out, &trainer->info, "to validate with", err);
    if (!status && trainer->options.batch < count)
        status = hada_fail(err, HADA_ERROR_ARGUMENT, "%d devices share the pairs of a step: a batch of %d is too small",
                           count, trainer->options.batch);
    if (!status)
        status = hada_train_nets_make(&nets, &trainer->options, trainer->model, err);
    if (status)
        return status;
    trainer->net = nets.net;
    trainer->critic = nets.critic;
    trainer->vgg = nets.vgg;
    trainer->fingerprint = fingerprint_of(trainer->model);
    status = make_workers(trainer, contexts, count, err);
    if (!status)
        status = make_lists(trainer, err);
    return status ? status : hada_snapshot_create(trainer, err);
}

hada_status hada_trainer_create_on(hada_trainer **out, hada_context *const *contexts, int count,
                                   const hada_model *model, const hada_pairs *pairs, const hada_pairs *held_out,
                                   const hada_train_options *options, hada_error *err)
{
    hada_trainer *trainer;
    if (!out || !contexts || count < 1 || !model || !pairs || !options)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a trainer needs out, contexts, model, pairs and options");
    *out = NULL;
    for (int i = 0; i < count; i++)
        for (int k = 0; k <= i; k++)
            if (!contexts[i] || (k < i && contexts[k] == contexts[i]))
                return hada_fail(err, HADA_ERROR_ARGUMENT, "a trainer's contexts are different ones");
    hada_status status = hada_alloc((void **)&trainer, 1, sizeof *trainer, "a trainer", err);
    if (status)
        return status;
    pthread_mutex_init(&trainer->reading, NULL);
    trainer->model = model;
    trainer->info = *hada_model_get_info(model);
    hada_pairs_init(&trainer->pairs);
    hada_pairs_init(&trainer->held_out);
    status = HADA_OPTIONS_TAKE(&trainer->pairs, pairs, hada_pairs, err);
    if (!status)
        status = HADA_OPTIONS_TAKE(&trainer->held_out, held_out, hada_pairs, err);
    if (!status)
        status = make(trainer, contexts, count, options, err);
    /* What the caller owns is not looked at any more. */
    trainer->options.net = trainer->options.vgg = trainer->options.critic = NULL;
    trainer->options.net_given = NULL;
    if (status)
        hada_trainer_destroy(&trainer);
    *out = trainer;
    return status;
}

hada_status hada_trainer_create(hada_trainer **out, hada_context *context, const hada_model *model,
                                const hada_pairs *pairs, const hada_pairs *held_out, const hada_train_options *options,
                                hada_error *err)
{
    return hada_trainer_create_on(out, &context, 1, model, pairs, held_out, options, err);
}

static void free_worker(const hada_trainer *trainer, hada_worker *worker)
{
    for (int i = 0; worker->own && i < trainer->options.at_once; i++)
        hada_example_free(&worker->own[i]);
    hada_planes_destroy(&worker->planes);
    hada_engine_destroy(&worker->engine);
    hada_slot_destroy(&worker->slot);
    free(worker->samples);
    free(worker->own);
    free(worker->touched);
    free(worker->room);
}

void hada_trainer_destroy(hada_trainer **pointer)
{
    hada_trainer *trainer = pointer ? *pointer : NULL;
    if (!trainer)
        return;
    *pointer = NULL;
    hada_feed_destroy(&trainer->feed);
    hada_snapshot_free(trainer);
    hada_crew_destroy(&trainer->crew);
    for (int i = 0; i < trainer->worker_count; i++)
        free_worker(trainer, &trainer->workers[i]);
    hada_examples_free(&trainer->known);
    hada_examples_free(&trainer->held);
    hada_train_nets_free(&(hada_train_nets){trainer->net, trainer->critic, trainer->vgg});
    pthread_mutex_destroy(&trainer->reading);
    free(trainer->progress.group_steps);
    free(trainer->workers);
    free(trainer->fed);
    free(trainer);
}

hada_status hada_trainer_bytes(hada_context *context, const hada_model *model, const hada_train_options *options,
                               uint64_t *bytes, hada_error *err)
{
    hada_train_nets nets;
    size_t engine = 0, planes = 0;
    if (!context || !model || !options || !bytes)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_trainer_bytes: context, model, options and bytes are needed");
    hada_train_options settled;
    hada_augment augment;
    hada_status status = hada_train_options_settle(&settled, &augment, options, model, err);
    if (!status)
        status = hada_train_nets_make(&nets, &settled, model, err);
    if (status)
        return status;
    hada_engine_desc desc = {
        .model = model, .options = &settled, .net = nets.net, .critic = nets.critic, .vgg = nets.vgg};
    status = choose_at_once(&desc.at_once, context, &settled, settled.batch, &desc, err);
    if (!status)
        status = hada_engine_bytes(context, &desc, &engine, err);
    if (!status && hada_stage_has_planes(settled.stage))
        status = hada_planes_bytes(context, model, &planes, err);
    hada_train_nets_free(&nets);
    *bytes = engine + planes;
    return status;
}

const hada_train_options *hada_trainer_get_options(const hada_trainer *trainer)
{
    return &trainer->options;
}

const hada_net *hada_trainer_get_net(const hada_trainer *trainer)
{
    return trainer->net;
}

uint64_t hada_trainer_steps(const hada_trainer *trainer)
{
    return trainer->progress.step;
}

uint64_t hada_trainer_seen(const hada_trainer *trainer)
{
    return trainer->progress.place;
}
