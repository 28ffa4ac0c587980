/* The discriminator of adversarial training, as a list. */
#include <stdio.h>

#include "net/presets.h"

hada_status hada_discriminator_make(hada_net **out, int channels, hada_error *err)
{
    static const int widths[] = {32, 64, 128, 128, 128};
    enum { CONVS = sizeof widths / sizeof *widths, SIDE = 256, HIDDEN = 256 };
    int at;
    hada_status status = hada_net_begin(out, 1, err);
    hada_layer layer = hada_layer_of(HADA_LAYER_INPUT, "", 0);
    layer.channels = channels;
    if (!status)
        status = hada_net_add(*out, &layer, &at, err);
    layer = hada_layer_of(HADA_LAYER_RESIZE, "", 0);
    layer.resize = HADA_RESIZE_LINEAR;
    layer.rows = layer.cols = SIDE;
    if (!status)
        status = hada_net_add(*out, &layer, &at, err);
    for (int i = 0; !status && i < CONVS; i++) {
        layer = hada_layer_of(HADA_LAYER_CONV, "", at);
        snprintf(layer.name, sizeof layer.name, "conv.%d", i);
        layer.channels = widths[i];
        layer.stride = 2;
        layer.activation = HADA_ACTIVATION_LEAKY_RELU;
        layer.slope = 0.2f;
        status = hada_net_add(*out, &layer, &at, err);
    }
    for (int i = 0; !status && i < 2; i++) {
        layer = hada_layer_of(HADA_LAYER_LINEAR, "", at);
        snprintf(layer.name, sizeof layer.name, "full.%d", i);
        layer.in = i ? HIDDEN : widths[CONVS - 1] * (SIDE >> CONVS) * (SIDE >> CONVS);
        layer.channels = i ? 1 : HIDDEN;
        layer.activation = i ? HADA_ACTIVATION_NONE : HADA_ACTIVATION_LEAKY_RELU;
        layer.slope = i ? 0.0f : 0.2f;
        status = hada_net_add(*out, &layer, &at, err);
    }
    if (!status)
        status = hada_net_finish(*out, err);
    if (status)
        hada_net_destroy(out);
    return status;
}
