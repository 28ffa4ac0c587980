/* The convolutional part of VGG-16 as a list. */
#include <stdio.h>

#include "netlist/presets.h"
#include "netlist/weights_file.h"

/* Widths of the convolutions; 0: a pooling. */
static const int widths[] = {64, 64, 0, 128, 128, 0, 256, 256, 256, 0, 512, 512, 512, 0, 512, 512, 512, 0};

static hada_status add_all(hada_net *net, hada_error *err)
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
    for (size_t i = 0; i < sizeof widths / sizeof *widths; i++) {
        layer = hada_layer_of(widths[i] ? HADA_LAYER_CONV : HADA_LAYER_POOL, "", at);
        if (widths[i]) {
            snprintf(layer.name, sizeof layer.name, "features.%d", number);
            layer.channels = widths[i];
            layer.activation = HADA_ACTIVATION_RELU;
        }
        number += widths[i] ? 2 : 1;
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
    HADA_TRY_OR_DONE(add_all(*out, err));
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
    if ((status = hada_tensors_open(&file, path, err)) != HADA_OK)
        return status;
    HADA_TRY_OR_DONE(hada_vgg16_make(out, err));
    HADA_TRY_OR_DONE(hada_net_read_but(*out, file, "", "normalize.", err));
done:
    if (status) {
        hada_error_prefix(err, "%s: ", path);
        hada_net_destroy(out);
    }
    hada_tensors_close(&file);
    return status;
}
