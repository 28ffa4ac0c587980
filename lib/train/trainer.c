/* Making and unmaking trainers, their nets, and what training gives: a net, a model. */
#include "train/trainer.h"
#include "net/enhance.h"

/* The nets of a stage: new ones begin close to giving back their input. */

/* For each layer: the channel from which on it holds the net's input; -1: nowhere. */
enum { NOWHERE = -1 };

static int passes(hada_activation activation)
{
    return activation == HADA_ACTIVATION_NONE || activation == HADA_ACTIVATION_RELU ||
           activation == HADA_ACTIVATION_LEAKY_RELU;
}

static int keeps_size(const hada_layer *layer)
{
    return !layer->transposed && layer->stride == 1 && layer->kernel % 2 == 1 && layer->pad == layer->kernel / 2;
}

/* Where a layer holds the input, given where those before it do. */
static int held_at(const hada_net *net, int index, const int *held)
{
    const hada_layer *layer = &net->layers[index];
    const int channels = net->layers[net->count - 1].channels, from = held[layer->inputs[0]];
    switch (layer->kind) {
    case HADA_LAYER_INPUT: return 0;
    case HADA_LAYER_CONV:
        return from >= 0 && keeps_size(layer) && passes(layer->activation) && layer->channels >= channels ? 0 : NOWHERE;
    case HADA_LAYER_ACTIVATION: return passes(layer->activation) ? from : NOWHERE;
    case HADA_LAYER_CONCAT:
        for (int i = 0, first = 0; i < layer->input_count; i++) {
            if (held[layer->inputs[i]] >= 0)
                return first + held[layer->inputs[i]];
            first += net->layers[layer->inputs[i]].channels;
        }
        return NOWHERE;
    default: return NOWHERE;
    }
}

/* The first channels of a convolution become copies of those that hold the input. */
static void copy_through(hada_net *net, int index, int from)
{
    const hada_layer *layer = &net->layers[index];
    const hada_parameter *weight = hada_net_parameter(net, index, 0, 0);
    const size_t taps = (size_t)layer->kernel * (size_t)layer->kernel, each = (size_t)weight->shape[1] * taps;
    for (int c = 0; c < net->layers[net->count - 1].channels; c++) {
        float *row = net->values + weight->offset + (size_t)c * each;
        memset(row, 0, each * sizeof *row);
        row[(size_t)(from + c) * taps + taps / 2] = 1.0f;
        if (layer->bias)
            net->values[hada_net_parameter(net, index, 0, 1)->offset + (size_t)c] = 0.0f;
    }
}

int hada_net_start_as_identity(hada_net *net)
{
    const int last = net->count - 1;
    int *held = calloc((size_t)net->count, sizeof *held);
    if (!held)
        return 0;
    for (int i = 0; i < net->count; i++)
        held[i] = held_at(net, i, held);
    const int found = net->layers[last].kind == HADA_LAYER_CONV && held[last] == 0 &&
                      net->layers[last].channels <= net->layers[0].channels;
    for (int i = 1; found && i < net->count; i++)
        if (net->layers[i].kind == HADA_LAYER_CONV && held[i] == 0)
            copy_through(net, i, held[net->layers[i].inputs[0]]);
    free(held);
    return found;
}

static hada_status create_with_others(hada_net **out, int channels, uint64_t seed, hada_error *err)
{
    hada_unet_options options;
    hada_unet_options_init(&options);
    options.channels = 2 * channels;
    options.out_channels = channels;
    return hada_net_create_unet(out, &options, seed, err);
}

/* A net that only shares light out does nothing for planes that stand alone. */
static hada_status check_shares(const hada_net *net, const hada_train_options *options, hada_error *err)
{
    if (!net->shares || (options->stage == HADA_STAGE_ENHANCE && options->compose >= 1.0))
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_MODEL,
                     "the model's net only shares light out among planes, which stage enhance teaches by scenes of "
                     "several depths alone (options.compose 1); for another one give a new net (options.net) and "
                     "options.compose 0.15");
}

/* The net that the caller gives, the model's own, or a new one. */
static hada_status begin_net(hada_net **out, const hada_train_options *options, const hada_model *model,
                             hada_error *err)
{
    const int channels = hada_model_get_info(model)->channels;
    if (options->net_given)
        return hada_net_copy(out, options->net_given, err);
    if (!options->new_net)
        return hada_net_copy(out, hada_model_get_enhance(model), err);
    /* a new net sees beside a plane what the other planes of its scene hold, where there are such and it can */
    if (options->compose > 0.0 && hada_train_may_see_others(options, hada_model_get_info(model))) {
        HADA_TRY(create_with_others(out, channels, options->seed, err));
        (*out)->shares = options->compose >= 1.0;
    } else {
        HADA_TRY(hada_net_create_preset(out, options->net, channels, options->seed, err));
    }
    /* Training then begins at the planes as they are, not at noise. */
    if (options->stage != HADA_STAGE_CONVENTIONAL)
        hada_net_start_as_identity(*out);
    return HADA_OK;
}

static hada_status make_net(hada_net **out, const hada_train_options *options, const hada_model *model, hada_error *err)
{
    const int channels = hada_model_get_info(model)->channels;
    HADA_TRY(begin_net(out, options, model, err));
    const hada_net_info *net = hada_net_get_info(*out);
    const int others = hada_enhance_sees_others(*out, channels);
    if (others && !hada_stage_has_planes(options->stage))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the model's net sees the other planes beside its own, which the stages enhance and "
                         "adversarial alone have: give a new one (options.net)");
    if (net->channels != channels << others || net->out_channels != channels)
        return hada_fail(err, HADA_ERROR_MODEL, "the net takes %d channel(s) and gives %d; the camera has %d",
                         net->channels, net->out_channels, channels);
    return check_shares(*out, options, err);
}

static hada_status load_vgg(hada_net **out, const hada_train_options *options, int channels, hada_error *err)
{
    if (channels != 1 && channels != 3)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "VGG-16 looks at grey or at red, green and blue; this camera has %d channels: leave the "
                         "perceptual term out",
                         channels);
    return hada_vgg16_load(out, options->vgg, err);
}

static void train_nets_free(hada_train_nets *nets)
{
    hada_net_destroy(&nets->net);
    hada_net_destroy(&nets->discriminator);
    hada_net_destroy(&nets->vgg);
}

static hada_status train_nets_make(hada_train_nets *nets, const hada_train_options *options, const hada_model *model,
                                   hada_error *err)
{
    const int channels = hada_model_get_info(model)->channels;
    hada_status status = HADA_OK;
    *nets = (hada_train_nets){0};
    if (options->stage != HADA_STAGE_FILTERS)
        HADA_TRY_OR_DONE(make_net(&nets->net, options, model, err));
    if (hada_stage_has_discriminator(options)) {
        HADA_TRY_OR_DONE(hada_discriminator_make(&nets->discriminator, options->discriminator, channels, err));
        hada_net_init(nets->discriminator, options->seed);
    }
    if (options->perceptual > 0.0)
        HADA_TRY_OR_DONE(load_vgg(&nets->vgg, options, channels, err));
done:
    if (status)
        train_nets_free(nets);
    return status;
}

/* What is kept of pairs, held-out ones included, and of what VGG-16 makes of them. */
#define KEPT_BYTES    ((size_t)1 << 30)
#define KEPT_FEATURES (KEPT_BYTES / 4) /* where there is a perceptual term */

static hada_status check_pairs(const hada_dataset *pairs, const hada_model_info *info, const char *what,
                               hada_error *err)
{
    const int depths = hada_dataset_get_info(pairs)->depths;
    return depths == info->depths ? HADA_OK
                                  : hada_fail(err, HADA_ERROR_MODEL, "the pairs %s have %d depths, the model has %d",
                                              what, depths, info->depths);
}

/* What is kept of the pairs to learn from, and of those held out. */
static size_t kept_bytes(int held_out, int features)
{
    const size_t quarter = KEPT_BYTES / 4;
    return held_out ? quarter : 3 * quarter - (features ? KEPT_FEATURES : 0);
}

/* The most samples at once, up to a device's share of a step, that fit into half of its memory; a divisor of the share,
 * since a call that is not full takes as long as a full one. */
static hada_status choose_at_once(int *out, const hada_context *context, const hada_train_options *options, int share,
                                  const hada_replica_desc *desc, hada_error *err)
{
    hada_replica_desc trial = *desc;
    const uint64_t room = hada_context_device(context)->memory_bytes / 2;
    const int open = options->at_once == HADA_AUTO;
    for (int count = !open && options->at_once < share ? options->at_once : share; count >= 1; count--) {
        size_t bytes = 0;
        if (share % count && open)
            continue;
        *out = trial.at_once = count;
        if (!open || count == 1)
            return HADA_OK;
        const hada_status status = hada_replica_bytes(context, &trial, &bytes, err);
        if (status != HADA_ERROR_DEVICE_MEMORY && (status || bytes <= room))
            return status;
    }
    return HADA_OK;
}

static hada_status make_workers(hada_trainer *trainer, hada_context *const *contexts, int count, hada_error *err)
{
    hada_train_options *options = &trainer->options;
    const size_t scenes =
        hada_stage_keeps(&trainer->augment) ? HADA_FLIPPED_WAYS * (size_t)hada_pairs_total(trainer->pairs) : 0;
    const int share = (int)hada_divide_up((size_t)trainer->share, (size_t)count);
    hada_replica_desc desc = {.model = trainer->model,
                              .options = options,
                              .net = trainer->nets.net,
                              .discriminator = trainer->nets.discriminator,
                              .vgg = trainer->nets.vgg,
                              .at_once = share,
                              .shares = count,
                              .scenes = scenes,
                              .feature_bytes = KEPT_FEATURES / (size_t)count};
    for (int i = 0; i < count; i++) {
        int own = 0;
        HADA_TRY(choose_at_once(&own, contexts[i], options, share, &desc, err));
        desc.at_once = own < desc.at_once ? own : desc.at_once;
    }
    options->at_once = desc.at_once;
    return hada_workers_create(&trainer->workers, contexts, count, &trainer->ranks, &desc,
                               hada_stage_has_planes(options->stage), err);
}

static hada_status make_lists(hada_trainer *trainer, hada_error *err)
{
    const hada_workers *workers = &trainer->workers;
    const size_t wave = (size_t)trainer->options.at_once * (size_t)workers->count;
    const int features = trainer->nets.vgg != NULL;
    HADA_TRY(HADA_NEW(trainer->fed, wave, "a step", err));
    HADA_TRY(HADA_NEW(trainer->progress.group_steps, (size_t)workers->groups, "a trainer", err));
    HADA_TRY(hada_examples_create(&trainer->known, trainer->pairs, kept_bytes(0, features), err));
    if (trainer->held_out.pairs)
        HADA_TRY(
            hada_examples_create(&trainer->held_out.examples, trainer->held_out.pairs, kept_bytes(1, features), err));
    return HADA_OK;
}

static hada_status check_all_pairs(const hada_trainer *trainer, int workers, hada_error *err)
{
    HADA_TRY(check_pairs(trainer->pairs, &trainer->info, "to learn from", err));
    if (!hada_pairs_total(trainer->pairs))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no pair to learn from; hold fewer out, or add some");
    if (trainer->held_out.pairs)
        HADA_TRY(check_pairs(trainer->held_out.pairs, &trainer->info, "to validate with", err));
    if (trainer->share < workers)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%d devices of %d ranks share the pairs of a step: a batch of %d is too small",
                         workers * trainer->ranks.count, trainer->ranks.count, trainer->options.batch);
    return HADA_OK;
}

/* The ranks, and this one's share of a step. Exchanges go device by device. */
static hada_status take_ranks(hada_trainer *trainer, int devices, hada_error *err)
{
    double all = devices;
    const hada_communicator *ranks = &trainer->ranks;
    const int batch = trainer->options.batch;
    HADA_TRY(hada_communicator_check(trainer->options.communicator, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&trainer->ranks, trainer->options.communicator, hada_communicator, err));
    trainer->options.communicator = NULL;
    trainer->first = (int)hada_share_begin(ranks, batch, ranks->rank);
    trainer->share = (int)hada_share_begin(ranks, batch, ranks->rank + 1) - trainer->first;
    HADA_TRY(hada_reduce(ranks, &all, 1, err));
    if (all != (double)devices * ranks->count)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "rank %d trains on %d of %.0f devices: all %d ranks must have as many; start one for each "
                           "device",
                           ranks->rank, devices, all, ranks->count));
    return HADA_OK;
}

static hada_status make(hada_trainer *trainer, hada_context *const *contexts, int count,
                        const hada_train_options *callers, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_train_options_settle(&trainer->options, &trainer->augment, callers, trainer->model, err));
    HADA_TRY_OR_DONE(take_ranks(trainer, count, err));
    HADA_TRY_OR_DONE(check_all_pairs(trainer, count, err));
    HADA_TRY_OR_DONE(train_nets_make(&trainer->nets, &trainer->options, trainer->model, err));
    HADA_TRY_OR_DONE(make_workers(trainer, contexts, count, err));
    HADA_TRY_OR_DONE(make_lists(trainer, err));
    HADA_TRY_OR_DONE(hada_snapshot_create(&trainer->snapshot, &trainer->workers, &trainer->progress, err));
done:
    /* What the caller owns is not read any more. */
    trainer->options.net = trainer->options.vgg = trainer->options.discriminator = NULL;
    trainer->options.net_given = NULL;
    return status;
}

hada_status hada_trainer_create(hada_trainer **out, hada_context *const *contexts, int count, const hada_model *model,
                                const hada_dataset *pairs, const hada_dataset *held_out,
                                const hada_train_options *options, hada_error *err)
{
    hada_trainer *trainer = NULL;
    hada_status status = HADA_OK;
    if (!out || !contexts || count < 1 || !model || !pairs || !options)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a trainer needs out, contexts, model, pairs and options");
    *out = NULL;
    HADA_TRY(hada_model_check_single(hada_model_get_info(model), "training", err));
    for (int i = 0; i < count; i++)
        for (int k = 0; k <= i; k++)
            if (!contexts[i] || (k < i && contexts[k] == contexts[i]))
                return hada_fail(err, HADA_ERROR_ARGUMENT, "a trainer's contexts are different ones");
    HADA_TRY_OR_DONE(HADA_NEW(trainer, 1, "a trainer", err));
    trainer->held_out.reading = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    trainer->model = hada_model_hold(model);
    trainer->info = *hada_model_get_info(model);
    hada_communicator_init(&trainer->ranks);
    trainer->pairs = pairs;
    trainer->held_out.pairs = held_out;
    HADA_TRY_OR_DONE(make(trainer, contexts, count, options, err));
done:
    if (status)
        hada_trainer_destroy(&trainer);
    *out = trainer;
    return status;
}

void hada_trainer_destroy(hada_trainer **pointer)
{
    hada_trainer *trainer = hada_taken(pointer);
    if (!trainer)
        return;
    hada_feed_destroy(&trainer->feed);
    hada_snapshot_free(&trainer->snapshot);
    hada_workers_destroy(&trainer->workers);
    hada_examples_free(&trainer->known);
    hada_examples_free(&trainer->held_out.examples);
    train_nets_free(&trainer->nets);
    hada_model_destroy(&trainer->model);
    pthread_mutex_destroy(&trainer->held_out.reading);
    HADA_FREE(trainer->progress.group_steps, trainer->fed, trainer);
}

hada_status hada_trainer_bytes(hada_context *context, const hada_model *model, const hada_train_options *options,
                               uint64_t *bytes, hada_error *err)
{
    hada_train_nets nets = {0};
    hada_train_options settled;
    hada_augment augment;
    size_t replica = 0, planes = 0;
    hada_status status = HADA_OK;
    HADA_NEED(context && model && options && bytes, err);
    HADA_TRY_OR_DONE(hada_train_options_settle(&settled, &augment, options, model, err));
    HADA_TRY_OR_DONE(train_nets_make(&nets, &settled, model, err));
    hada_replica_desc desc = {
        .model = model, .options = &settled, .net = nets.net, .discriminator = nets.discriminator, .vgg = nets.vgg};
    HADA_TRY_OR_DONE(choose_at_once(&desc.at_once, context, &settled, settled.batch, &desc, err));
    HADA_TRY_OR_DONE(hada_replica_bytes(context, &desc, &replica, err));
    if (hada_stage_has_planes(settled.stage))
        HADA_TRY_OR_DONE(hada_planes_bytes(context, model, settled.compose > 0.0, &planes, err));
    *bytes = replica + planes;
done:
    train_nets_free(&nets);
    return status;
}

hada_status hada_trainer_get_info(const hada_trainer *trainer, hada_trainer_info *info, hada_error *err)
{
    HADA_NEED(trainer && info, err);
    HADA_TRY(HADA_REPORT_CHECK(info, hada_trainer_info, err));
    const hada_trainer_info own = {.size = sizeof own,
                                   .options = &trainer->options,
                                   .net = trainer->nets.net,
                                   .steps = trainer->progress.step,
                                   .seen = trainer->progress.place};
    HADA_REPORT_GIVE(info, &own);
    return HADA_OK;
}

hada_status hada_trainer_net(hada_trainer *trainer, hada_net **out, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_NEED(trainer && out, err);
    *out = NULL;
    if (!trainer->nets.net)
        return hada_fail(err, HADA_ERROR_STATE, "this stage trains no net");
    HADA_TRY_OR_DONE(hada_net_copy(out, trainer->nets.net, err));
    HADA_TRY_OR_DONE(hada_workers_read(&trainer->workers, HADA_GROUP_NET, HADA_CONTENT_VALUES, (*out)->values, err));
done:
    if (status)
        hada_net_destroy(out);
    return status;
}

static hada_status with_filters(hada_model **out, hada_trainer *trainer, hada_error *err)
{
    hada_model_info info = trainer->info;
    info.form = trainer->options.form;
    info.half = info.refine_steps = 0;
    HADA_TRY(hada_model_create_like(out, trainer->model, &info, err));
    for (int z = 0; z < trainer->info.depths; z++) {
        const size_t at = (size_t)z * (size_t)trainer->info.channels * hada_model_plane(trainer->model) * 2;
        HADA_TRY(hada_workers_read(&trainer->workers, HADA_GROUP_FILTERS + z, HADA_CONTENT_VALUES, (*out)->filter + at,
                                   err));
    }
    return HADA_OK;
}

hada_status hada_trainer_model(hada_trainer *trainer, hada_model **out, hada_error *err)
{
    hada_net *net = NULL;
    hada_status status = HADA_OK;
    HADA_NEED(trainer && out, err);
    *out = NULL;
    const hada_train_options *options = &trainer->options;
    if (options->stage == HADA_STAGE_CONVENTIONAL)
        return hada_fail(err, HADA_ERROR_STATE, "the conventional net has no filters; take it with hada_trainer_net()");
    if (trainer->nets.net) {
        HADA_TRY_OR_DONE(hada_trainer_net(trainer, &net, err));
        HADA_TRY_OR_DONE(hada_model_with_enhance(out, trainer->model, net, options->net_rows, options->net_cols, err));
    } else {
        HADA_TRY_OR_DONE(with_filters(out, trainer, err));
    }
done:
    if (status)
        hada_model_destroy(out);
    hada_net_destroy(&net);
    return status;
}
