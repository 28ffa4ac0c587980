/* The discriminators of adversarial training, as lists. */
#include <stdio.h>
#include <string.h>

#include "netlist/presets.h"

typedef struct stage {
    int channels, stride;
} stage;

static hada_status begin(hada_net **out, int channels, hada_error *err)
{
    hada_layer layer = hada_layer_of(HADA_LAYER_INPUT, "", 0);
    layer.channels = channels;
    HADA_TRY(hada_net_begin(out, 1, err));
    return hada_net_add(*out, &layer, NULL, err);
}

/* Convolutions of 3 x 3, conv.0 and so on, each on what the layer before gives. */
static hada_status add_convs(hada_net *net, const stage *stages, int count, hada_error *err)
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

static hada_status add_patch(hada_net *net, hada_error *err)
{
    static const stage stages[] = {{32, 1}, {64, 2}, {128, 2}, {128, 1}, {1, 1}};
    return add_convs(net, stages, (int)(sizeof stages / sizeof *stages), err);
}

static hada_status add_paper(hada_net *net, hada_error *err)
{
    static const stage stages[] = {{32, 2}, {64, 2}, {128, 2}, {128, 2}, {128, 2}};
    enum { CONVS = sizeof stages / sizeof *stages, SIDE = 256, HIDDEN = 256 };
    hada_layer layer = hada_layer_of(HADA_LAYER_RESIZE, "", 0);
    layer.resize = HADA_RESIZE_LINEAR;
    layer.rows = layer.cols = SIDE;
    HADA_TRY(hada_net_add(net, &layer, NULL, err));
    HADA_TRY(add_convs(net, stages, CONVS, err));
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
    hada_status status = HADA_OK;
    static const char *const names[] = {"conditional", "patch", "paper"};
    int which = 0;
    *out = NULL;
    while (which < 3 && (!name || strcmp(name, names[which])))
        which++;
    if (which == 3)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no discriminator \"%s\": take conditional, patch or paper",
                         name ? name : "");
    HADA_TRY_OR_DONE(begin(out, which ? channels : 2 * channels, err));
    HADA_TRY_OR_DONE(which < 2 ? add_patch(*out, err) : add_paper(*out, err));
    HADA_TRY_OR_DONE(hada_net_finish(*out, err));
done:
    if (status)
        hada_net_destroy(out);
    return status;
}
