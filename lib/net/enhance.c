/* Enhancing planes: memory, and the way of a plane through the net. */
#include "net/enhance.h"
#include "launch/net_tensor.h"
#include "net/layer_launch.h"

/* Sizes of an enhancement: the receptive field of its net, and tiles that fit the memory. */

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

/* The fewest tiles that fit, cutting the longer side first. */
static hada_status find_tiles(const hada_context *context, const hada_enhance_desc *desc, size_t limit,
                              hada_enhance_shape *shape, hada_error *err)
{
    hada_receptive_field field;
    HADA_TRY(hada_net_receptive_field(desc->net, &field, err));
    int fits, down = hada_most(desc->tile_rows, 1), right = hada_most(desc->tile_cols, 1);
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

static hada_status enhance_shape_of(const hada_context *context, const hada_enhance_desc *desc,
                                    hada_enhance_shape *shape, hada_error *err)
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

/* Where a tile of one axis begins: its own pixels, and those with halo. */
static int enhance_core_at(int tile, int core, int full)
{
    return hada_least(tile * core, full);
}

static int enhance_tile_at(int tile, int core, int tile_size, int full)
{
    /* in the middle of its halo, but inside the image: at the edges the halo on the other side is wider */
    const int halo = (tile_size - core) / 2, at = tile * core - (halo > 0 ? halo : 0);
    return hada_within(at, full - tile_size + 1);
}

struct hada_enhance {
    hada_slot *slot;
    hada_enhance_desc desc;
    hada_enhance_shape shape;
    hada_graph *graph;
    hada_buffer values, content;
    hada_buffer scaled;                 /* resized at once: planar images at the net's size */
    hada_buffer full_in, full_out, out; /* tiled: planar images of the whole, and of one tile */
    hada_buffer sum, beside;            /* of all planes; a plane and what the others hold */
    float *map;                         /* [plane][rows][content_cells] of the planes that are looked at */
    size_t *waiting;                    /* where the planes begin that go through the net next */
    int waiting_count;
    int computed, left_out;
};

/* Bytes of the buffers beside the graph, in the order of the struct. */
enum { BUFFERS = 8 };
static void sizes_of(const hada_enhance_desc *desc, const hada_enhance_shape *shape, size_t *bytes)
{
    const size_t planes = (size_t)desc->channels * sizeof(float);
    const size_t full = planes * (size_t)shape->full_rows * (size_t)shape->full_cols;
    bytes[0] = desc->net->floats * sizeof(float);
    bytes[1] = (size_t)shape->planes * (size_t)desc->rows * (size_t)shape->content_cells * sizeof(float);
    bytes[2] = shape->resized && !shape->tiled
                   ? (size_t)shape->planes * planes * (size_t)shape->rows * (size_t)shape->cols
                   : 0;
    bytes[3] = full * (size_t)shape->inputs;
    bytes[4] = full;
    bytes[5] = shape->tiled ? planes * (size_t)shape->tile_rows * (size_t)shape->tile_cols : 0;
    bytes[6] = shape->inputs > 1 ? planes * (size_t)desc->rows * (size_t)desc->cols : 0;
    bytes[7] = 2 * bytes[6];
}

static hada_status make_buffers(hada_enhance *e, hada_error *err)
{
    hada_context *context = e->slot->context;
    const hada_net *net = e->desc.net;
    hada_buffer *const buffers[BUFFERS] = {&e->values,   &e->content, &e->scaled, &e->full_in,
                                           &e->full_out, &e->out,     &e->sum,    &e->beside};
    size_t bytes[BUFFERS];
    sizes_of(&e->desc, &e->shape, bytes);
    HADA_TRY(hada_buffer_create_from(&e->values, e->slot, net->values, bytes[0], "the net's weights", err));
    for (int i = 1; i < BUFFERS; i++) {
        if (!bytes[i])
            continue;
        HADA_TRY(hada_buffer_create(buffers[i], context, bytes[i], "planes for the net", err));
        HADA_TRY(hada_buffer_clear(buffers[i], e->slot, 0, bytes[i], err)); /* halos and what fills up stay zero */
    }
    return HADA_OK;
}

hada_status hada_enhance_create(hada_enhance **out, hada_slot *slot, const hada_enhance_desc *desc, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_enhance *e = NULL;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(e, 1, "the enhancement", err));
    e->slot = slot;
    e->desc = *desc;
    HADA_TRY_OR_DONE(enhance_shape_of(slot->context, desc, &e->shape, err));
    const size_t cells = (size_t)desc->rows * (size_t)e->shape.content_cells;
    HADA_TRY_OR_DONE(HADA_NEW(e->map, (size_t)e->shape.planes * cells, "the map of content", err));
    HADA_TRY_OR_DONE(HADA_NEW(e->waiting, (size_t)e->shape.planes, "the planes", err));
    HADA_TRY_OR_DONE(hada_graph_create(&e->graph, slot, desc->net, &e->shape.graph, err));
    HADA_TRY_OR_DONE(make_buffers(e, err));
    HADA_TRY_OR_DONE(hada_graph_set_weights(e->graph, (hada_floats){e->values.mem, 0}, err));
done:
    if (status)
        hada_enhance_destroy(&e);
    *out = e;
    return status;
}

void hada_enhance_destroy(hada_enhance **pointer)
{
    hada_enhance *e = hada_taken(pointer);
    if (!e)
        return;
    hada_graph_destroy(&e->graph);
    HADA_DESTROY_BUFFERS(&e->values, &e->content, &e->scaled, &e->full_in, &e->full_out, &e->out, &e->sum, &e->beside);
    HADA_FREE(e->map, e->waiting, e);
}

void hada_enhance_counts(const hada_enhance *e, int *computed, int *left_out)
{
    *computed = e->computed;
    *left_out = e->left_out;
}

/* Planar images whose channels are a tensor's, colour by colour. */
static hada_planar planar_of(const hada_enhance *e, cl_mem mem, size_t offset, int rows, int cols)
{
    return hada_planar_at(mem, offset, e->desc.net->layers[0].channels, rows, cols);
}

/* Part of planar images to part of others, all channels. */
typedef struct part {
    cl_mem mem;
    size_t offset; /* floats */
    int rows, cols, row, col;
} part;
static hada_planar_layout layout_of(const part *p)
{
    const hada_ulong row = (hada_ulong)p->cols;
    return (hada_planar_layout){.offset = p->offset + (hada_ulong)p->row * row + (hada_ulong)p->col,
                                .channel = row * (hada_ulong)p->rows,
                                .row = row};
}

static hada_status copy(const hada_enhance *e, const part *from, const part *to, int rows, int cols, int channels,
                        hada_error *err)
{
    const hada_range range =
        hada_layer_flat_range(e->slot, hada_divide_up((size_t)cols, HADA_PART_COLS), (size_t)rows * (size_t)channels);
    return hada_launch_net_part(e->slot, hada_program_net_tensor_of(e->slot), &range, err, .from = from->mem,
                                .to = to->mem, .at_from = layout_of(from), .at_to = layout_of(to), .rows = rows,
                                .cols = cols);
}

/* Fills the maps of content of `count` planes. */
static hada_status map_content(hada_enhance *e, cl_mem planes, size_t offset, int count, hada_error *err)
{
    const hada_enhance_desc *d = &e->desc;
    const int cells = e->shape.content_cells;
    const size_t floats = (size_t)count * (size_t)d->rows * (size_t)cells;
    hada_range range = hada_layer_flat_range(e->slot, (size_t)cells, (size_t)d->rows);
    range.global[2] = (size_t)count;
    HADA_TRY(hada_launch_net_content(e->slot, hada_program_net_tensor_of(e->slot), &range, err, .image = planes,
                                     .out = e->content.mem, .offset = offset, .channels = d->channels, .rows = d->rows,
                                     .cols = d->cols, .cell = HADA_CONTENT_CELL, .cells = cells));
    return hada_buffer_read(&e->content, e->slot, 0, e->map, floats * sizeof *e->map, err);
}

/* Whether anything stands in a part of the plane whose map is given. */
static int has_content(const hada_enhance *e, const float *map, int row, int col, int rows, int cols)
{
    const int last_row = row + rows < e->desc.rows ? row + rows : e->desc.rows;
    const int last_col = col + cols < e->desc.cols ? col + cols : e->desc.cols;
    for (int r = row; r < last_row; r++)
        for (int c = col / HADA_CONTENT_CELL; c * HADA_CONTENT_CELL < last_col; c++)
            if (!(map[(size_t)r * (size_t)e->shape.content_cells + (size_t)c] <= e->desc.content))
                return 1;
    return 0;
}

/* The graph, from its input to what is not negative in its output. */
static hada_status run_graph(hada_enhance *e, hada_error *err)
{
    const hada_tensor *y = hada_graph_output(e->graph);
    HADA_TRY(hada_graph_forward(e->graph, err));
    return hada_activation_forward(e->slot, HADA_ACTIVATION_RELU, 0.0f, y, y, err);
}

/* The images of plane `slot` of those that go through the net at once. */
static hada_tensor images_of(const hada_enhance *e, const hada_tensor *tensor, int slot)
{
    return hada_tensor_images(tensor, slot * e->desc.net->colours, e->desc.net->colours);
}

/* The plane at `offset` as it stands in the window. */
static hada_planes window_of(const hada_enhance *e, cl_mem planes, size_t offset)
{
    const int rows = e->desc.rows, cols = e->desc.cols;
    return (hada_planes){planar_of(e, planes, offset, rows, cols), rows, cols};
}

/* Plane `slot` of those that go through the net at once, at the net's size. */
static hada_planes scaled_of(const hada_enhance *e, int slot)
{
    const int rows = e->shape.rows, cols = e->shape.cols;
    const size_t each = (size_t)e->desc.channels * (size_t)rows * (size_t)cols;
    return (hada_planes){planar_of(e, e->scaled.mem, (size_t)slot * each, rows, cols), rows, cols};
}

/* All channels of a plane, colour by colour. */
static hada_status resize(const hada_enhance *e, const hada_planes *from, const hada_planes *to, float floor,
                          hada_error *err)
{
    return hada_resize_planes(e->slot, from, to, 1, e->desc.channels, floor, err);
}

/* A whole plane to the net, which takes it with others. */
static hada_status wait_for_others(hada_enhance *e, cl_mem planes, size_t offset, hada_error *err)
{
    const hada_planes seen = e->shape.inputs > 1 ? window_of(e, e->beside.mem, 0) : window_of(e, planes, offset);
    const hada_planes scaled = scaled_of(e, e->waiting_count);
    const hada_tensor to = images_of(e, hada_graph_input(e->graph), e->waiting_count);
    e->computed++;
    HADA_TRY(e->shape.resized ? resize(e, &seen, &scaled, -INFINITY, err)
                              : hada_tensor_load(e->slot, &seen.at, &to, err));
    e->waiting[e->waiting_count++] = offset;
    return HADA_OK;
}

/* The whole planes that wait go through the net, and back to where they stood. */
static hada_status run_waiting(hada_enhance *e, cl_mem planes, hada_error *err)
{
    hada_status status = HADA_OK;
    const int count = e->waiting_count;
    if (!count)
        return HADA_OK;
    hada_graph_set_images(e->graph, count);
    const hada_tensor *x = hada_graph_input(e->graph), *y = hada_graph_output(e->graph);
    const hada_planes first = scaled_of(e, 0);
    if (e->shape.resized)
        HADA_TRY_OR_DONE(hada_tensor_load(e->slot, &first.at, x, err));
    HADA_TRY_OR_DONE(e->shape.resized ? hada_graph_forward(e->graph, err) : run_graph(e, err));
    if (e->shape.resized)
        HADA_TRY_OR_DONE(hada_tensor_store(e->slot, y, &first.at, err));
    for (int i = 0; i < count; i++) {
        const hada_planes plane = window_of(e, planes, e->waiting[i]), scaled = scaled_of(e, i);
        const hada_tensor from = images_of(e, y, i);
        HADA_TRY_OR_DONE(e->shape.resized ? resize(e, &scaled, &plane, 0.0f, err)
                                          : hada_tensor_store(e->slot, &from, &plane.at, err));
    }
done:
    e->waiting_count = 0;
    return status;
}

static hada_status run_tile(hada_enhance *e, const float *map, int down, int right, hada_error *err)
{
    const hada_enhance_shape *s = &e->shape;
    const int row = enhance_tile_at(down, s->core_rows, s->tile_rows, s->full_rows);
    const int col = enhance_tile_at(right, s->core_cols, s->tile_cols, s->full_cols);
    const int first_row = enhance_core_at(down, s->core_rows, s->full_rows);
    const int first_col = enhance_core_at(right, s->core_cols, s->full_cols);
    const int rows = enhance_core_at(down + 1, s->core_rows, s->full_rows) - first_row;
    const int cols = enhance_core_at(right + 1, s->core_cols, s->full_cols) - first_col;
    if (!s->resized && !has_content(e, map, row, col, s->tile_rows, s->tile_cols)) {
        e->left_out++;
        return HADA_OK;
    }
    e->computed++;
    const hada_planar in =
        planar_of(e, e->full_in.mem, (size_t)row * (size_t)s->full_cols + (size_t)col, s->full_rows, s->full_cols);
    const hada_planar out = planar_of(e, e->out.mem, 0, s->tile_rows, s->tile_cols);
    const part tile = {e->out.mem, 0, s->tile_rows, s->tile_cols, first_row - row, first_col - col};
    const part whole = {e->full_out.mem, 0, s->full_rows, s->full_cols, first_row, first_col};
    HADA_TRY(hada_tensor_load(e->slot, &in, hada_graph_input(e->graph), err));
    HADA_TRY(run_graph(e, err));
    HADA_TRY(hada_tensor_store(e->slot, hada_graph_output(e->graph), &out, err));
    return copy(e, &tile, &whole, rows, cols, e->desc.channels, err);
}

/* Between the plane and the whole image at the net's size. */
static hada_status bring(hada_enhance *e, cl_mem planes, size_t offset, int back, hada_error *err)
{
    const hada_enhance_shape *s = &e->shape;
    const part plane = {planes, offset, e->desc.rows, e->desc.cols, 0, 0};
    const part seen = {e->beside.mem, 0, e->desc.rows, e->desc.cols, 0, 0};
    const part in = {e->full_in.mem, 0, s->full_rows, s->full_cols, 0, 0};
    const part out = {e->full_out.mem, 0, s->full_rows, s->full_cols, 0, 0};
    if (!s->resized && back)
        return copy(e, &out, &plane, s->rows, s->cols, e->desc.channels, err);
    if (!s->resized)
        return copy(e, s->inputs > 1 ? &seen : &plane, &in, s->rows, s->cols, s->inputs * e->desc.channels, err);
    const hada_planes here = window_of(e, planes, offset);
    const hada_planes there = {planar_of(e, back ? e->full_out.mem : e->full_in.mem, 0, s->full_rows, s->full_cols),
                               s->rows, s->cols};
    return resize(e, back ? &there : &here, back ? &here : &there, -INFINITY, err);
}

static hada_status run_tiles(hada_enhance *e, const float *map, cl_mem planes, size_t offset, hada_error *err)
{
    HADA_TRY(bring(e, planes, offset, 0, err));
    /* tiles that are left out are dark */
    HADA_TRY(hada_buffer_clear(&e->full_out, e->slot, 0, e->full_out.bytes, err));
    for (int down = 0; down < e->shape.tiles_down; down++)
        for (int right = 0; right < e->shape.tiles_right; right++)
            HADA_TRY(run_tile(e, map, down, right, err));
    return bring(e, planes, offset, 1, err);
}

/* The sum of planes that belong together; otherwise each is its own sum, so that nothing stands beside it. */
static hada_status add_up(hada_enhance *e, cl_mem planes, size_t offset, int count, hada_error *err)
{
    const size_t values = (size_t)e->desc.channels * (size_t)e->desc.rows * (size_t)e->desc.cols;
    const hada_range range = hada_layer_flat_range(e->slot, values, 1);
    if (e->shape.inputs < 2)
        return HADA_OK;
    return hada_launch_net_add_planes(e->slot, hada_program_net_tensor_of(e->slot), &range, err, .planes = planes,
                                      .sum = e->sum.mem, .offset = offset, .values = values, .count = count);
}

static hada_status put_beside(hada_enhance *e, cl_mem planes, size_t offset, hada_error *err)
{
    const size_t values = (size_t)e->desc.channels * (size_t)e->desc.rows * (size_t)e->desc.cols;
    const hada_range range = hada_layer_flat_range(e->slot, values, 1);
    if (e->shape.inputs < 2)
        return HADA_OK;
    return hada_launch_net_beside(e->slot, hada_program_net_tensor_of(e->slot), &range, err, .planes = planes,
                                  .sum = e->sum.mem, .out = e->beside.mem, .offset = offset, .out_offset = 0,
                                  .values = values);
}

/* What stands in `planes`, and beside it the sum less that. Whole planes go through the net when as many wait as it
 * takes at once. */
static hada_status run_one(hada_enhance *e, const float *map, cl_mem planes, size_t offset, hada_error *err)
{
    HADA_TRY(put_beside(e, planes, offset, err));
    if (!has_content(e, map, 0, 0, e->desc.rows, e->desc.cols))
        e->left_out += e->shape.tiles_down * e->shape.tiles_right;
    else if (e->shape.tiled)
        HADA_TRY(run_tiles(e, map, planes, offset, err));
    else
        HADA_TRY(wait_for_others(e, planes, offset, err));
    if (e->waiting_count == e->shape.planes)
        HADA_TRY(run_waiting(e, planes, err));
    return HADA_OK;
}

/* A net that sees one plane after the other knows of each what is its own, but not that together they must make a
 * whole: the sum is shared out as the planes say, enhanced by itself where the net does more than share. */
static hada_status share_out(hada_enhance *e, cl_mem planes, size_t offset, int count, hada_error *err)
{
    const size_t values = (size_t)e->desc.channels * (size_t)e->desc.rows * (size_t)e->desc.cols;
    const hada_range range = hada_layer_flat_range(e->slot, values, 1);
    if (!e->desc.net->shares) {
        HADA_TRY(map_content(e, e->sum.mem, 0, 1, err));
        HADA_TRY(run_one(e, e->map, e->sum.mem, 0, err));
        HADA_TRY(run_waiting(e, e->sum.mem, err));
    }
    return hada_launch_net_share(e->slot, hada_program_net_tensor_of(e->slot), &range, err, .planes = planes,
                                 .whole = e->sum.mem, .offset = offset, .values = values, .count = count);
}

/* Planes whose content is read at once. */
static hada_status run_some(hada_enhance *e, cl_mem planes, size_t offset, int count, int together, hada_error *err)
{
    const size_t plane = (size_t)e->desc.channels * (size_t)e->desc.rows * (size_t)e->desc.cols;
    const size_t cells = (size_t)e->desc.rows * (size_t)e->shape.content_cells;
    HADA_TRY(map_content(e, planes, offset, count, err));
    for (int i = 0; i < count; i++, offset += plane) {
        if (!together)
            HADA_TRY(add_up(e, planes, offset, 1, err));
        HADA_TRY(run_one(e, e->map + (size_t)i * cells, planes, offset, err));
    }
    return run_waiting(e, planes, err);
}

int hada_enhance_acts(const hada_enhance *e, int count, int together)
{
    return !e->desc.net->shares || e->shape.inputs < 2 || (together && count > 1);
}

hada_status hada_enhance_run(hada_enhance *e, cl_mem planes, size_t offset, int count, int together, hada_error *err)
{
    hada_status status = HADA_OK;
    const size_t plane = (size_t)e->desc.channels * (size_t)e->desc.rows * (size_t)e->desc.cols;
    const int most = e->shape.planes;
    e->computed = e->left_out = e->waiting_count = 0;
    if (!hada_enhance_acts(e, count, together))
        return HADA_OK;
    if (together)
        HADA_TRY_OR_DONE(add_up(e, planes, offset, count, err));
    for (int i = 0; i < count; i += most)
        HADA_TRY_OR_DONE(
            run_some(e, planes, offset + (size_t)i * plane, most < count - i ? most : count - i, together, err));
    if (together && count > 1 && e->shape.inputs > 1)
        HADA_TRY_OR_DONE(share_out(e, planes, offset, count, err));
done:
    if (status)
        hada_error_prefix(err, "enhancement: ");
    return status;
}
