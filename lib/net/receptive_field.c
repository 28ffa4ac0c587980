#include "net/receptive_field.h"

#include <stdlib.h>

#include "core/alloc.h"

/* Pixels of the input to a pixel of each layer, 0 where a layer cannot be run in tiles; and pixels beyond a tile,
 * counted in the layer's own, on which the tile's output depends. */
typedef struct reach {
    int scale, beyond;
} reach;

/* Far above any net, and far from where a product of two overflows. */
#define MOST_SCALE (1 << 20)

static int up_by(const reach *from, const reach *to)
{
    return from->scale % to->scale ? 0 : from->scale / to->scale;
}

/* The scale of a layer's pixels, 0 where its size does not follow from the input's by a factor alone. */
static int scale_of(const hada_layer *l, const reach *of)
{
    const reach *in = &of[l->inputs[0]];
    switch (l->kind) {
    case HADA_LAYER_CONV:
        if (l->transposed)
            return l->kernel - 2 * l->pad + l->output_pad == l->stride && in->scale % l->stride == 0
                       ? in->scale / l->stride
                       : 0;
        return l->kernel - 2 * l->pad > 0 && l->kernel - 2 * l->pad <= l->stride && in->scale < MOST_SCALE
                   ? in->scale * l->stride
                   : 0;
    case HADA_LAYER_POOL: return l->kernel <= l->stride && in->scale < MOST_SCALE ? in->scale * l->stride : 0;
    case HADA_LAYER_RESIZE:
        if (l->like < 0 || l->resize == HADA_RESIZE_LINEAR_ALIGNED || l->resize == HADA_RESIZE_CUBIC_ALIGNED)
            return 0;
        return of[l->like].scale && (up_by(in, &of[l->like]) || up_by(&of[l->like], in)) ? of[l->like].scale : 0;
    case HADA_LAYER_CONCAT:
        for (int i = 1; i < l->input_count; i++)
            if (of[l->inputs[i]].scale != in->scale)
                return 0;
        return in->scale;
    case HADA_LAYER_LINEAR: return 0;
    default: return in->scale;
    }
}

/* Pixels of a layer's input beyond the tile for `n` of its own. */
static int beyond_of(const hada_layer *l, const reach *in, const reach *out, int n)
{
    const int side = l->pad > l->kernel - 1 - l->pad ? l->pad : l->kernel - 1 - l->pad;
    if (l->kind == HADA_LAYER_CONV)
        return l->transposed ? (n + l->kernel + l->stride - 1) / l->stride : n * l->stride + side;
    if (l->kind == HADA_LAYER_POOL)
        return n * l->stride;
    if (l->kind == HADA_LAYER_RESIZE) {
        const int taps = l->resize == HADA_RESIZE_NEAREST ? 0 : l->resize == HADA_RESIZE_LINEAR ? 1 : 2;
        const int up = up_by(in, out);
        return up ? (n + up - 1) / up + taps : (n + taps) * up_by(out, in) + taps;
    }
    return n;
}

hada_status hada_net_receptive_field(const hada_net *net, hada_receptive_field *field, hada_error *err)
{
    reach *of;
    *field = (hada_receptive_field){0};
    hada_status status = hada_allocated(of = hada_alloc((size_t)net->count, sizeof *of, "a net's reach", err));
    if (status)
        return status;
    int multiple = 1, possible = 1;
    of[0].scale = 1;
    for (int i = 1; possible && i < net->count; i++) {
        of[i].scale = scale_of(&net->layers[i], of);
        possible = of[i].scale > 0;
        multiple = of[i].scale > multiple ? of[i].scale : multiple;
    }
    /* sizes halve exactly where every scale divides the largest */
    for (int i = 0; possible && i < net->count; i++)
        possible = multiple % of[i].scale == 0;
    if (possible && of[net->count - 1].scale == 1) {
        for (int i = net->count - 1; i > 0; i--)
            for (int k = 0; k < net->layers[i].input_count; k++) {
                reach *in = &of[net->layers[i].inputs[k]];
                const int beyond = beyond_of(&net->layers[i], in, &of[i], of[i].beyond);
                in->beyond = beyond > in->beyond ? beyond : in->beyond;
            }
        *field = (hada_receptive_field){1, multiple, (int)hada_round_up((size_t)of[0].beyond, (size_t)multiple)};
    }
    free(of);
    return HADA_OK;
}
