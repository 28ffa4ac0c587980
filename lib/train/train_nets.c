/* The nets of a stage: new ones begin close to giving back their input. */
#include "train/trainer.h"

#include "net/enhance.h"
#include "netlist/net_list.h"

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

/* A new net sees beside a plane what the other planes of its scene hold, where there are such and it can. */
static int sees_others(const hada_train_options *options, const hada_model_info *info)
{
    return options->compose > 0.0 && hada_train_may_see_others(options, info);
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
    if (sees_others(options, hada_model_get_info(model))) {
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

/* The discriminator that the options name. */
static hada_status make_discriminator(hada_net **out, const hada_train_options *options, int channels, hada_error *err)
{
    HADA_TRY(hada_discriminator_make(out, options->discriminator, channels, err));
    return hada_net_init(*out, options->seed, err);
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

hada_status hada_train_nets_make(hada_train_nets *nets, const hada_train_options *options, const hada_model *model,
                                 hada_error *err)
{
    const int channels = hada_model_get_info(model)->channels;
    hada_status status = HADA_OK;
    *nets = (hada_train_nets){0};
    if (hada_stage_has_net(options->stage))
        HADA_TRY_OR_DONE(make_net(&nets->net, options, model, err));
    if (hada_stage_has_discriminator(options))
        HADA_TRY_OR_DONE(make_discriminator(&nets->discriminator, options, channels, err));
    if (options->perceptual > 0.0)
        HADA_TRY_OR_DONE(load_vgg(&nets->vgg, options, channels, err));
done:
    if (status)
        hada_train_nets_free(nets);
    return status;
}

void hada_train_nets_free(hada_train_nets *nets)
{
    hada_net_destroy(&nets->net);
    hada_net_destroy(&nets->discriminator);
    hada_net_destroy(&nets->vgg);
}
