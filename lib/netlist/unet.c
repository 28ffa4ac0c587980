/* U-nets (Ronneberger, Fischer and Brox 2015) as lists, and the presets by
 * name. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/callers.h"
#include "netlist/presets.h"

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
static hada_status add_convs(hada_net *net, const char *side, int level, int count, const int *width, int *at,
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

static hada_status add_all(hada_net *net, const hada_unet_options *options, const widths *down, const widths *up,
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
        HADA_TRY(add_convs(net, "down", level, down->counts[level], down->width[level], &at, err));
        skips[level] = at;
    }
    for (int level = down->levels - 2; level >= 0; level--) {
        const int step = down->levels - 2 - level;
        HADA_TRY(add_lift(net, options, level, skips[level], &at, err));
        HADA_TRY(add_convs(net, "up", level, up->counts[step], up->width[step], &at, err));
    }
    HADA_TRY(add_last(net, options, &at, err));
    return hada_net_finish(net, err);
}

hada_status hada_unet_make(hada_net **out, const hada_unet_options *callers, hada_error *err)
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
    HADA_TRY_OR_DONE(add_all(*out, options, &down, &up, err));
done:
    if (status)
        hada_net_destroy(out);
    return status;
}

hada_status hada_net_create_unet(hada_net **out, const hada_unet_options *options, uint64_t seed, hada_error *err)
{
    hada_status status = HADA_OK;
    if (!out || !options)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_net_create_unet: out and options are needed");
    HADA_TRY_OR_DONE(hada_unet_make(out, options, err));
    HADA_TRY_OR_DONE(hada_net_init(*out, seed, err));
done:
    if (status)
        hada_net_destroy(out);
    return status;
}

hada_status hada_net_create_preset(hada_net **out, const char *preset, int channels, uint64_t seed, hada_error *err)
{
    hada_unet_options options;
    if (!out || !preset)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_net_create_preset: out and preset are needed");
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
