/* Sizes of an enhancement: the receptive field of its net, and tiles that fit the memory. */
#include "net/enhance.h"

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
    HADA_TRY(HADA_NEW(of, (size_t)net->count, "a net's reach", err));
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

static hada_status check_net(const hada_enhance_desc *desc, int rows, int cols, hada_error *err)
{
    hada_size out;
    const hada_net_info *info = hada_net_get_info(desc->net);
    const int others = hada_enhance_sees_others(desc->net, desc->channels);
    if (others && (rows != desc->rows || cols != desc->cols))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the net for enhancement sees the other planes beside its own, so it runs at the window's "
                         "size, %d x %d, not at %d x %d",
                         desc->rows, desc->cols, rows, cols);
    if ((!others && info->channels != desc->channels) || info->out_channels != desc->channels)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the net for enhancement takes %d channel(s) and gives %d, but the planes have %d",
                         info->channels, info->out_channels, desc->channels);
    HADA_TRY(hada_net_output_size(desc->net, rows, cols, &out, err));
    if (out.rows != rows || out.cols != cols)
        return hada_fail(err, HADA_ERROR_MODEL, "the net for enhancement makes %d x %d pixels of %d x %d", out.rows,
                         out.cols, rows, cols);
    return HADA_OK;
}

/* Whether a graph of this size fits; *bytes is what it needs. */
static hada_status try_size(const hada_context *context, const hada_enhance_desc *desc, size_t limit,
                            hada_enhance_shape *shape, int rows, int cols, int *fits, hada_error *err)
{
    shape->graph = (hada_graph_options){
        .images = shape->tiled ? 1 : shape->planes, .rows = rows, .cols = cols, .method = desc->method};
    if (shape->tiled) /* pixels that do not depend on their place */
        shape->graph.method = HADA_CONV_DIRECT;
    const hada_status status = hada_graph_bytes(context, desc->net, &shape->graph, &shape->graph_bytes, err);
    *fits = !status && shape->graph_bytes <= limit;
    return status == HADA_ERROR_DEVICE_MEMORY ? HADA_OK : status;
}

static int rounded_up(int value, int to)
{
    return (int)hada_round_up((size_t)value, (size_t)to);
}

/* One axis cut in `parts`. */
static void cut(int full, int parts, const hada_receptive_field *field, int *core, int *tile)
{
    *core = rounded_up((full + parts - 1) / parts, field->multiple);
    *tile = *core + 2 * field->halo < full ? *core + 2 * field->halo : full;
}

static int at_least_one(int value)
{
    return value > 1 ? value : 1;
}

/* The fewest tiles that fit, cutting the longer side first. */
static hada_status find_tiles(const hada_context *context, const hada_enhance_desc *desc, size_t limit,
                              hada_enhance_shape *shape, hada_error *err)
{
    hada_receptive_field field;
    HADA_TRY(hada_net_receptive_field(desc->net, &field, err));
    int fits, down = at_least_one(desc->tile_rows), right = at_least_one(desc->tile_cols);
    if (!field.tiles)
        return hada_fail(err, HADA_ERROR_DEVICE_MEMORY,
                         "the net for enhancement does not fit the memory for %d x %d pixels, and its layers do not "
                         "allow tiles: use a smaller window, or another device",
                         shape->rows, shape->cols);
    shape->tiled = 1;
    shape->full_rows = rounded_up(shape->rows, field.multiple);
    shape->full_cols = rounded_up(shape->cols, field.multiple);
    for (;;) {
        cut(shape->full_rows, down, &field, &shape->core_rows, &shape->tile_rows);
        cut(shape->full_cols, right, &field, &shape->core_cols, &shape->tile_cols);
        HADA_TRY(try_size(context, desc, limit, shape, shape->tile_rows, shape->tile_cols, &fits, err));
        if (fits)
            break;
        if (shape->core_rows <= field.multiple && shape->core_cols <= field.multiple)
            return hada_fail(err, HADA_ERROR_DEVICE_MEMORY,
                             "the net for enhancement needs %.1f MiB for its smallest tile, %d x %d pixels with halo: "
                             "leave it out (options.enhance 0), or use another device",
                             (double)shape->graph_bytes / 1048576.0, shape->tile_rows, shape->tile_cols);
        if (shape->core_rows >= shape->core_cols)
            down++;
        else
            right++;
    }
    shape->tiles_down = (shape->full_rows + shape->core_rows - 1) / shape->core_rows;
    shape->tiles_right = (shape->full_cols + shape->core_cols - 1) / shape->core_cols;
    return HADA_OK;
}

hada_status hada_enhance_shape_of(const hada_context *context, const hada_enhance_desc *desc, hada_enhance_shape *shape,
                                  hada_error *err)
{
    const size_t limit = desc->memory ? desc->memory : (size_t)(context->info.memory_bytes / 4);
    int fits = 0;
    *shape = (hada_enhance_shape){.rows = desc->net_rows ? desc->net_rows : desc->rows,
                                  .cols = desc->net_cols ? desc->net_cols : desc->cols,
                                  .planes = desc->planes > 1 ? desc->planes : 1,
                                  .content_cells = (desc->cols + HADA_CONTENT_CELL - 1) / HADA_CONTENT_CELL,
                                  .tiles_down = 1,
                                  .tiles_right = 1};
    shape->resized = shape->rows != desc->rows || shape->cols != desc->cols;
    shape->inputs = hada_enhance_sees_others(desc->net, desc->channels) ? 2 : 1;
    HADA_TRY(check_net(desc, shape->rows, shape->cols, err));
    while (desc->tile_rows <= 1 && desc->tile_cols <= 1) {
        HADA_TRY(try_size(context, desc, limit, shape, shape->rows, shape->cols, &fits, err));
        if (fits || shape->planes == 1)
            break;
        shape->planes = (shape->planes + 1) / 2;
    }
    if (!fits)
        HADA_TRY(find_tiles(context, desc, limit, shape, err));
    return HADA_OK;
}

int hada_enhance_core_at(int tile, int core, int full)
{
    const int at = tile * core;
    return at < full ? at : full;
}

int hada_enhance_tile_at(int tile, int core, int tile_size, int full)
{
    /* in the middle of its halo, but inside the image: at the edges the halo on the other side is wider */
    const int halo = (tile_size - core) / 2, at = tile * core - (halo > 0 ? halo : 0);
    return at < 0 ? 0 : at > full - tile_size ? full - tile_size : at;
}
