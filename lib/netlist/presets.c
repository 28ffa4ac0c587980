/* The nets that the library knows, as lists: U-nets (Ronneberger, Fischer and Brox 2015), discriminators, VGG-16. */
#include "netlist/net_list.h"

#include "core/callers.h"
#include "io/folder.h"

enum { MOST_LEVELS = 16, MOST_CONVS = 16 };

/* Widths per level; a level may have none. */
typedef struct widths {
    int levels, counts[MOST_LEVELS], width[MOST_LEVELS][MOST_CONVS];
} widths;

static hada_status read_widths(const char *text, widths *out, hada_error *err)
{
    *out = (widths){.levels = 1};
    for (const char *at = text; *at;) {
        int *count = &out->counts[out->levels - 1];
        char *end;
        const long width = strtol(at, &end, 10);
        if (*at == '|' && out->levels < MOST_LEVELS) {
            out->levels++;
            at++;
        } else if (end != at && ((*end == ',' && end[1] > '0' && end[1] <= '9') || *end == '|' || !*end) && width > 0 &&
                   width <= 65536 && *count < MOST_CONVS) {
            out->width[out->levels - 1][(*count)++] = (int)width;
            at = *end == ',' ? end + 1 : end;
        } else {
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "the widths \"%.200s\" of a U-net cannot be read at \"%.20s\"; write them as "
                             "\"16,16|32,32|64,64\", at most %d levels of %d convolutions",
                             text, at, MOST_LEVELS, MOST_CONVS);
        }
    }
    return HADA_OK;
}

/* The convolutions of a level, 3 x 3 with ReLU; *at is the layer before and
 * then the last one. */
static hada_status add_level(hada_net *net, const char *side, int level, int count, const int *width, int *at,
                             hada_error *err)
{
    for (int i = 0; i < count; i++) {
        hada_layer conv = hada_layer_of(HADA_LAYER_CONV, "", *at);
        snprintf(conv.name, sizeof conv.name, "%s.%d.%d", side, level, i);
        conv.channels = width[i];
        conv.activation = HADA_ACTIVATION_RELU;
        HADA_TRY(hada_net_add(net, &conv, at, err));
    }
    return HADA_OK;
}

/* What came from below takes the size of the level's own part, `skip`, and both
 * are put together. */
static hada_status add_lift(hada_net *net, const hada_unet_options *options, int level, int skip, int *at,
                            hada_error *err)
{
    hada_layer lift = hada_layer_of(HADA_LAYER_RESIZE, "", *at);
    lift.like = skip;
    lift.resize = options->up_by == HADA_UNET_NEAREST ? HADA_RESIZE_NEAREST : HADA_RESIZE_LINEAR;
    if (options->up_by == HADA_UNET_TRANSPOSED) {
        lift = hada_layer_of(HADA_LAYER_CONV, "", *at);
        snprintf(lift.name, sizeof lift.name, "lift.%d", level);
        lift.channels = net->layers[skip].channels;
        lift.kernel = lift.stride = 2;
        lift.pad = 0;
        lift.transposed = 1;
    }
    HADA_TRY(hada_net_add(net, &lift, at, err));
    hada_layer concat = hada_layer_of(HADA_LAYER_CONCAT, "", skip);
    concat.inputs[1] = *at;
    concat.input_count = 2;
    return hada_net_add(net, &concat, at, err);
}

static hada_status add_last(hada_net *net, const hada_unet_options *options, int *at, hada_error *err)
{
    if (options->last_norm) {
        const hada_layer norm = hada_layer_of(HADA_LAYER_NORM, "norm", *at);
        HADA_TRY(hada_net_add(net, &norm, at, err));
    }
    hada_layer last = hada_layer_of(HADA_LAYER_CONV, "last", *at);
    last.channels = options->shared ? 1 : options->out_channels;
    last.kernel = options->last_kernel;
    last.pad = options->last_kernel / 2;
    last.activation = options->last_relu ? HADA_ACTIVATION_RELU : HADA_ACTIVATION_NONE;
    return hada_net_add(net, &last, at, err);
}

static hada_status add_unet(hada_net *net, const hada_unet_options *options, const widths *down, const widths *up,
                            hada_error *err)
{
    int skips[MOST_LEVELS], at;
    hada_layer input = hada_layer_of(HADA_LAYER_INPUT, "", 0);
    input.channels = options->shared ? 1 : options->channels;
    HADA_TRY(hada_net_add(net, &input, &at, err));
    for (int level = 0; level < down->levels; level++) {
        if (level) {
            const hada_layer pool = hada_layer_of(HADA_LAYER_POOL, "", at);
            HADA_TRY(hada_net_add(net, &pool, &at, err));
        }
        HADA_TRY(add_level(net, "down", level, down->counts[level], down->width[level], &at, err));
        skips[level] = at;
    }
    for (int level = down->levels - 2; level >= 0; level--) {
        const int step = down->levels - 2 - level;
        HADA_TRY(add_lift(net, options, level, skips[level], &at, err));
        HADA_TRY(add_level(net, "up", level, up->counts[step], up->width[step], &at, err));
    }
    HADA_TRY(add_last(net, options, &at, err));
    return hada_net_finish(net, err);
}

/* hadalens/net.h says what the options mean. Names: down.<level>.<number>, lift.<level> (transposed
 * convolutions), up.<level>.<number>, norm, last. */
static hada_status unet_make(hada_net **out, const hada_unet_options *callers, hada_error *err)
{
    hada_status status = HADA_OK;
    widths down, up;
    hada_unet_options own, *options = &own;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(options, callers, hada_unet_options, err));
    if (!options->down || !options->up)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "U-net options: widths down and up are needed");
    if (options->channels < 1 || options->channels > 64 || options->out_channels < 1 || options->out_channels > 64 ||
        (options->shared && options->channels != options->out_channels) ||
        (options->last_kernel != 1 && options->last_kernel != 3) || options->up_by < HADA_UNET_LINEAR ||
        options->up_by > HADA_UNET_TRANSPOSED)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "U-net options: 1 to 64 channels, as many out as in where "
                         "the net is shared, and a last "
                         "kernel of 1 or 3");
    HADA_TRY_OR_DONE(read_widths(options->down, &down, err));
    HADA_TRY_OR_DONE(read_widths(options->up, &up, err));
    for (int level = 0; level < down.levels; level++)
        if (!down.counts[level])
            return hada_fail(err, HADA_ERROR_ARGUMENT, "level %d of the U-net \"%.200s\" has no convolution", level,
                             options->down);
    if (down.levels > 1 ? up.levels != down.levels - 1 : *options->up != '\0')
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a U-net with the levels \"%.200s\" needs %d levels on "
                         "the way up, not \"%.200s\"",
                         options->down, down.levels - 1, options->up);
    HADA_TRY_OR_DONE(hada_net_begin(out, options->shared ? options->channels : 1, err));
    HADA_TRY_OR_DONE(add_unet(*out, options, &down, &up, err));
done:
    if (status)
        hada_net_destroy(out);
    return status;
}

hada_status hada_net_create_unet(hada_net **out, const hada_unet_options *options, uint64_t seed, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_NEED(out && options, err);
    HADA_TRY_OR_DONE(unet_make(out, options, err));
    hada_net_init(*out, seed);
done:
    if (status)
        hada_net_destroy(out);
    return status;
}

hada_status hada_net_create_preset(hada_net **out, const char *preset, int channels, uint64_t seed, hada_error *err)
{
    hada_unet_options options;
    HADA_NEED(out && preset, err);
    *out = NULL;
    hada_unet_options_init(&options);
    options.channels = options.out_channels = channels;
    if (!strcmp(preset, "paper")) {
        options.shared = 1;
        options.down = "32,32|64|64|128|256|512,256,128";
        options.up = "128|64|32|32|";
        options.last_kernel = 3;
        options.last_norm = options.last_relu = 1;
    } else if (strcmp(preset, "compact") != 0) {
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no net \"%.60s\"; there are compact and paper", preset);
    }
    return hada_net_create_unet(out, &options, seed, err);
}

/* Discriminators. */

typedef struct stage {
    int channels, stride;
} stage;

static hada_status begin_discriminator(hada_net **out, int channels, hada_error *err)
{
    hada_layer layer = hada_layer_of(HADA_LAYER_INPUT, "", 0);
    layer.channels = channels;
    HADA_TRY(hada_net_begin(out, 1, err));
    return hada_net_add(*out, &layer, NULL, err);
}

/* Convolutions of 3 x 3, conv.0 and so on, each on what the layer before gives. */
static hada_status add_stages(hada_net *net, const stage *stages, int count, hada_error *err)
{
    for (int i = 0; i < count; i++) {
        hada_layer layer = hada_layer_of(HADA_LAYER_CONV, "", net->count - 1);
        snprintf(layer.name, sizeof layer.name, "conv.%d", i);
        layer.channels = stages[i].channels;
        layer.stride = stages[i].stride;
        if (stages[i].channels > 1) { /* logits are as they are */
            layer.activation = HADA_ACTIVATION_LEAKY_RELU;
            layer.slope = 0.2f;
        }
        HADA_TRY(hada_net_add(net, &layer, NULL, err));
    }
    return HADA_OK;
}

static hada_status add_paper(hada_net *net, hada_error *err)
{
    static const stage stages[] = {{32, 2}, {64, 2}, {128, 2}, {128, 2}, {128, 2}};
    enum { CONVS = sizeof stages / sizeof *stages, SIDE = 256, HIDDEN = 256 };
    hada_layer layer = hada_layer_of(HADA_LAYER_RESIZE, "", 0);
    layer.resize = HADA_RESIZE_LINEAR;
    layer.rows = layer.cols = SIDE;
    HADA_TRY(hada_net_add(net, &layer, NULL, err));
    HADA_TRY(add_stages(net, stages, CONVS, err));
    for (int i = 0; i < 2; i++) {
        layer = hada_layer_of(HADA_LAYER_LINEAR, "", net->count - 1);
        snprintf(layer.name, sizeof layer.name, "full.%d", i);
        layer.in = i ? HIDDEN : stages[CONVS - 1].channels * (SIDE >> CONVS) * (SIDE >> CONVS);
        layer.channels = i ? 1 : HIDDEN;
        layer.activation = i ? HADA_ACTIVATION_NONE : HADA_ACTIVATION_LEAKY_RELU;
        layer.slope = i ? 0.0f : 0.2f;
        HADA_TRY(hada_net_add(net, &layer, NULL, err));
    }
    return HADA_OK;
}

hada_status hada_discriminator_make(hada_net **out, const char *name, int channels, hada_error *err)
{
    static const stage patch[] = {{32, 1}, {64, 2}, {128, 2}, {128, 1}, {1, 1}};
    hada_status status = HADA_OK;
    const int paper = name && !strcmp(name, "paper");
    *out = NULL;
    if (!paper && (!name || strcmp(name, "patch") != 0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no discriminator \"%s\": take patch or paper",
                         name ? name : "");
    HADA_TRY_OR_DONE(begin_discriminator(out, channels, err));
    HADA_TRY_OR_DONE(paper ? add_paper(*out, err) : add_stages(*out, patch, (int)HADA_COUNT(patch), err));
    HADA_TRY_OR_DONE(hada_net_finish(*out, err));
done:
    if (status)
        hada_net_destroy(out);
    return status;
}

/* The convolutional part of VGG-16. */

/* Widths of the convolutions; 0: a pooling. */
static const int vgg_widths[] = {64, 64, 0, 128, 128, 0, 256, 256, 256, 0, 512, 512, 512, 0, 512, 512, 512, 0};

static hada_status add_vgg(hada_net *net, hada_error *err)
{
    int at;
    hada_layer layer = hada_layer_of(HADA_LAYER_INPUT, "", 0);
    layer.channels = 3;
    HADA_TRY(hada_net_add(net, &layer, &at, err));
    /* (x - mean) / deviation, as a convolution of 1 x 1 */
    layer = hada_layer_of(HADA_LAYER_CONV, "normalize", 0);
    layer.channels = 3;
    layer.kernel = 1;
    layer.pad = 0;
    HADA_TRY(hada_net_add(net, &layer, &at, err));
    /* torchvision numbers the layers of its Sequential: a convolution, its ReLU,
     * a pooling count one each */
    int number = 0;
    for (size_t i = 0; i < sizeof vgg_widths / sizeof *vgg_widths; i++) {
        layer = hada_layer_of(vgg_widths[i] ? HADA_LAYER_CONV : HADA_LAYER_POOL, "", at);
        if (vgg_widths[i]) {
            snprintf(layer.name, sizeof layer.name, "features.%d", number);
            layer.channels = vgg_widths[i];
            layer.activation = HADA_ACTIVATION_RELU;
        }
        number += vgg_widths[i] ? 2 : 1;
        HADA_TRY(hada_net_add(net, &layer, &at, err));
    }
    return hada_net_finish(net, err);
}

static void normalize(hada_net *net)
{
    /* of ImageNet, as torchvision.models.VGG16_Weights says */
    static const double mean[3] = {0.485, 0.456, 0.406}, deviation[3] = {0.229, 0.224, 0.225};
    float *weight = net->values + hada_net_find(net, "normalize.weight")->offset;
    float *bias = net->values + hada_net_find(net, "normalize.bias")->offset;
    for (int c = 0; c < 3; c++) {
        weight[3 * c + c] = (float)(1.0 / deviation[c]);
        bias[c] = (float)(-mean[c] / deviation[c]);
    }
}

hada_status hada_vgg16_make(hada_net **out, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_net_begin(out, 1, err));
    HADA_TRY_OR_DONE(add_vgg(*out, err));
    normalize(*out);
done:
    if (status)
        hada_net_destroy(out);
    return status;
}

hada_status hada_vgg16_load(hada_net **out, const char *path, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_tensors *file = NULL;
    *out = NULL;
    HADA_TRY(hada_tensors_open(&file, path, err));
    HADA_TRY_OR_DONE(hada_vgg16_make(out, err));
    HADA_TRY_OR_DONE(hada_net_read_but(*out, file, "", "normalize.", err));
done:
    if (status)
        hada_net_destroy(out);
    hada_tensors_close(&file);
    return hada_named(status, path, err);
}
