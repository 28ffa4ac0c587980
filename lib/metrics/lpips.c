/* LPIPS of two images: a net in five stages, each followed by the distance of its features. */
#include "core/callers.h"
#include "image/pixels.h"
#include "io/folder.h"
#include "launch/lpips_distance.h"
#include "metrics/metrics.h"
#include "net/graph.h"
#include "net/layer_launch.h"
#include "runtime/memory.h"

enum { STAGES = 5, CHANNELS = 1472 }; /* channels: of all stages, at most */

/* What a stage does before its convolutions: maximum pooling (0: none), zeros put around (where the convolution wants
 * more of them than a tensor has). The first stage of AlexNet, 11 x 11 every 4 pixels, takes blocks of 4 x 4 pixels as
 * 48 channels: a convolution of 3 x 3 then does the same, much faster. `fold` is the side of these blocks, 1 elsewhere.
 */
typedef struct entry {
    int pool, pool_stride, border, fold;
} entry;

/* A convolution with ReLU, or (channels 0) a maximum pooling; `number` is its place in torchvision's Sequential. After
 * a `tap` the features are compared. */
typedef struct part {
    int number, channels, kernel, stride, pad, tap;
} part;

/* Simonyan and Zisserman 2015, configuration D, up to relu5_3. */
static const part vgg[] = {{0, 64, 3, 1, 1, 0},   {2, 64, 3, 1, 1, 1},   {4, 0, 2, 2, 0, 0},
                           {5, 128, 3, 1, 1, 0},  {7, 128, 3, 1, 1, 1},  {9, 0, 2, 2, 0, 0},
                           {10, 256, 3, 1, 1, 0}, {12, 256, 3, 1, 1, 0}, {14, 256, 3, 1, 1, 1},
                           {16, 0, 2, 2, 0, 0},   {17, 512, 3, 1, 1, 0}, {19, 512, 3, 1, 1, 0},
                           {21, 512, 3, 1, 1, 1}, {23, 0, 2, 2, 0, 0},   {24, 512, 3, 1, 1, 0},
                           {26, 512, 3, 1, 1, 0}, {28, 512, 3, 1, 1, 1}, {0}};

/* Krizhevsky 2014, as torchvision has it. */
static const part alex[] = {{0, 64, 11, 4, 2, 1}, {2, 0, 3, 2, 0, 0},   {3, 192, 5, 1, 2, 1},  {5, 0, 3, 2, 0, 0},
                            {6, 384, 3, 1, 1, 1}, {8, 256, 3, 1, 1, 1}, {10, 256, 3, 1, 1, 1}, {0}};

/* The parts of a stage: from the one behind the last tap. *channels: what it takes. */
static const part *parts_of(hada_lpips_net net, int stage, int *channels)
{
    const part *at = net == HADA_LPIPS_ALEX ? alex : vgg;
    *channels = 3;
    while (stage)
        if (at++->tap) {
            *channels = at[-1].channels;
            stage--;
        }
    return at;
}

/* Channels that a stage gives. */
static int lpips_stage_channels(hada_lpips_net net, int stage)
{
    int channels;
    const part *at = parts_of(net, stage, &channels);
    while (!at->tap)
        at++;
    return at->channels;
}

/* The side of its smallest image. */
static int lpips_least_size(hada_lpips_net net)
{
    return net == HADA_LPIPS_ALEX ? 31 : 16; /* one pixel is left at the end */
}

enum { FOLD = 4, FOLDED_KERNEL = 3, FIRST_PAD = 2 }; /* AlexNet's first convolution */

static int is_folded(hada_lpips_net net, int stage)
{
    return net == HADA_LPIPS_ALEX && !stage;
}

static entry lpips_stage_entry(hada_lpips_net net, int stage)
{
    int channels;
    const part *first = parts_of(net, stage, &channels);
    entry e = {.fold = is_folded(net, stage) ? FOLD : 1};
    if (!first->channels) {
        e.pool = first->kernel;
        e.pool_stride = first->stride;
        first++;
    }
    e.border = !is_folded(net, stage) && first->pad > 1 ? first->pad : 0;
    return e;
}

/* Pixels that the convolutions of a stage take, after its entry, from what the stage before gives. */
static hada_size lpips_stage_input(hada_lpips_net net, int stage, hada_size before)
{
    const entry e = lpips_stage_entry(net, stage);
    hada_size in = before;
    if (e.fold > 1)
        return (hada_size){(in.rows + 2 * FIRST_PAD - alex[0].kernel) / FOLD + FOLDED_KERNEL,
                           (in.cols + 2 * FIRST_PAD - alex[0].kernel) / FOLD + FOLDED_KERNEL};
    if (e.pool)
        in = (hada_size){(in.rows - e.pool) / e.pool_stride + 1, (in.cols - e.pool) / e.pool_stride + 1};
    return (hada_size){in.rows + 2 * e.border, in.cols + 2 * e.border};
}

/* Channels of an image as the first stage takes it. */
static int lpips_fill_channels(hada_lpips_net net)
{
    return is_folded(net, 0) ? 3 * FOLD * FOLD : 3;
}

/* 0 ... 1 to -1 ... 1 and then (x - shift) / scale, with the constants of the package. */
static float scaled(double value, int channel)
{
    static const double shift[3] = {-0.030, -0.088, -0.188}, scale[3] = {0.458, 0.448, 0.450};
    return (float)((2.0 * value - 1.0 - shift[channel]) / scale[channel]);
}

/* An image, 0 ... peak, as the first stage takes it: channels, rows and columns of its input, with the colours brought
 * to what the backbone was trained with. */
static void lpips_fill(hada_lpips_net net, const hada_image *image, double peak, hada_size size, float *out)
{
    const int fold = lpips_stage_entry(net, 0).fold, pad = fold > 1 ? FIRST_PAD : 0;
    const size_t plane = (size_t)image->rows * (size_t)image->cols;
    for (int k = 0; k < 3 * fold * fold; k++) {
        const int c = k / (fold * fold), down = k / fold % fold, right = k % fold;
        const float *from = image->data + (image->channels == 3 ? (size_t)c * plane : 0);
        for (int r = 0; r < size.rows; r++)
            for (int col = 0; col < size.cols; col++) {
                const int y = r * fold + down - pad, x = col * fold + right - pad;
                const int inside = y >= 0 && x >= 0 && y < image->rows && x < image->cols;
                *out++ = inside ? scaled(from[(size_t)y * (size_t)image->cols + (size_t)x] / peak, c) : 0.0f;
            }
    }
}

static hada_status list(hada_net *net, hada_lpips_net kind, int stage, hada_error *err)
{
    int at, channels;
    const entry e = lpips_stage_entry(kind, stage);
    const part *parts = parts_of(kind, stage, &channels) + (e.pool > 0);
    hada_layer layer = hada_layer_of(HADA_LAYER_INPUT, "", 0);
    layer.channels = stage ? channels : lpips_fill_channels(kind);
    HADA_TRY(hada_net_add(net, &layer, &at, err));
    for (int first = 1, last = 0; !last; first = 0, parts++) {
        layer = hada_layer_of(HADA_LAYER_CONV, "", at);
        snprintf(layer.name, sizeof layer.name, "features.%d", parts->number);
        layer.channels = parts->channels;
        layer.kernel = e.fold > 1 ? FOLDED_KERNEL : parts->kernel;
        layer.stride = e.fold > 1 ? 1 : parts->stride;
        layer.pad = e.fold > 1 || (first && e.border) ? 0 : parts->pad;
        layer.activation = HADA_ACTIVATION_RELU;
        HADA_TRY(hada_net_add(net, &layer, &at, err));
        last = parts->tap;
    }
    return hada_net_finish(net, err);
}

/* AlexNet's first weights, [out][3][11][11], for blocks of pixels as channels: the place (y, x) of a kernel becomes
 * place (y / 4, x / 4) of the channel of pixel (y % 4, x % 4). */
static hada_status fold_weights(hada_net *net, const hada_tensors *file, hada_error *err)
{
    hada_status status = HADA_OK;
    const int kernel = alex[0].kernel, out = alex[0].channels, values = out * 3 * kernel * kernel;
    const hada_stored_tensor *tensor = hada_tensors_find(file, "features.0.weight");
    float *to = net->values + hada_net_find(net, "features.0.weight")->offset, *given = NULL;
    if (!tensor || tensor->dims != 4 || tensor->shape[0] != out || tensor->shape[1] != 3 ||
        tensor->shape[2] != kernel || tensor->shape[3] != kernel)
        return hada_fail(err, HADA_ERROR_MODEL, "the tensor features.0.weight has another shape than that of AlexNet");
    HADA_TRY_OR_DONE(HADA_NEW(given, (size_t)values, "the weights", err));
    HADA_TRY_OR_DONE(hada_tensor_copy_f32(tensor, 0, (size_t)values, given, err));
    for (int i = 0; i < values; i++) {
        const int x = i % kernel, y = i / kernel % kernel, c = i / kernel / kernel % 3, o = i / kernel / kernel / 3;
        const int channel = (c * FOLD + y % FOLD) * FOLD + x % FOLD;
        if (!isfinite(given[i]))
            HADA_TRY_OR_DONE(
                hada_fail(err, HADA_ERROR_NOT_FINITE, "the tensor features.0.weight holds values that are not finite"));
        to[((o * 3 * FOLD * FOLD + channel) * FOLDED_KERNEL + y / FOLD) * FOLDED_KERNEL + x / FOLD] = given[i];
    }
done:
    free(given);
    return status;
}

/* The convolutions of a stage as a list, with a file's weights; the output is what is compared, and what the next stage
 * takes. */
static hada_status lpips_stage_make(hada_net **out, hada_lpips_net kind, int stage, const hada_tensors *file,
                                    hada_error *err)
{
    hada_status status = HADA_OK;
    const char *own = is_folded(kind, stage) ? "features.0.weight" : NULL;
    HADA_TRY_OR_DONE(hada_net_begin(out, 1, err));
    HADA_TRY_OR_DONE(list(*out, kind, stage, err));
    if (own)
        HADA_TRY_OR_DONE(fold_weights(*out, file, err));
    HADA_TRY_OR_DONE(hada_net_read_but(*out, file, "", own, err));
done:
    if (status)
        hada_net_destroy(out);
    return status;
}

hada_status hada_lpips_distance(hada_slot *slot, const hada_tensor *x, hada_floats weights, hada_floats out,
                                hada_error *err)
{
    const int pairs = x->images / 2;
    hada_layer_grid grid = hada_layer_pixel_grid_of(slot, x, x->rows, x->cols);
    grid.range.global[2] = (size_t)pairs;
    const double pixels = (double)pairs * x->rows * x->cols;
    hada_slot_cost(slot, pixels * 4.0 * (2.0 * x->channels + 1.0), pixels * 9.0 * x->channels);
    return hada_launch_lpips_distance(slot, HADA_PROGRAM_BY_BLOCK(LPIPS_DISTANCE, x->block), &grid.range, err,
                                      .x = x->mem, .w = weights.mem, .out = out.mem, .at_x = hada_layout_of(x),
                                      .w_offset = weights.offset, .out_offset = out.offset, .pairs = pairs,
                                      .span = grid.span);
}

/* Files of weights. */

/* VGG-16 begins with kernels of 3 x 3, AlexNet with 11 x 11. */
static hada_status lpips_find_net(const hada_tensors *file, hada_lpips_net *net, hada_error *err)
{
    const hada_stored_tensor *first = hada_tensors_find(file, "features.0.weight");
    if (!first)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the file holds no tensor features.0.weight; LPIPS takes the weights of VGG-16 or AlexNet by "
                         "torchvision's names");
    const hada_lpips_net found = first->dims == 4 && first->shape[3] == 3    ? HADA_LPIPS_VGG
                                 : first->dims == 4 && first->shape[3] == 11 ? HADA_LPIPS_ALEX
                                                                             : HADA_LPIPS_AUTO;
    if (!found || (*net && *net != found))
        return hada_fail(err, HADA_ERROR_MODEL, "the tensor features.0.weight has another shape than that of %s",
                         *net == HADA_LPIPS_VGG    ? "VGG-16"
                         : *net == HADA_LPIPS_ALEX ? "AlexNet"
                                                   : "VGG-16 and AlexNet");
    *net = found;
    return HADA_OK;
}

static hada_status read_head(const hada_tensors *file, hada_lpips_net net, int stage, float *out, hada_error *err)
{
    const int channels = lpips_stage_channels(net, stage);
    char name[] = "lin0.model.1.weight";
    name[3] = (char)('0' + stage);
    const hada_stored_tensor *head = hada_tensors_find(file, name);
    int64_t values = head ? 1 : 0;
    for (int d = 0; head && d < head->dims; d++)
        values *= head->shape[d];
    if (values != channels)
        return hada_fail(err, HADA_ERROR_MODEL, "%s %s of %d values; the heads of LPIPS for %s are needed",
                         head ? "the file holds another tensor" : "the file holds no tensor", name, channels,
                         net == HADA_LPIPS_ALEX ? "AlexNet" : "VGG-16");
    HADA_TRY(hada_tensor_copy_f32(head, 0, (size_t)channels, out, err));
    for (int i = 0; i < channels; i++)
        if (!isfinite(out[i]))
            HADA_TRY(hada_fail(err, HADA_ERROR_NOT_FINITE, "the tensor %s holds values that are not finite", name));
    return HADA_OK;
}

/* The linear heads of a file: the weights of all channels, stage after stage, and where each stage's begin. */
static hada_status lpips_read_heads(const char *path, hada_lpips_net net, float weights[CHANNELS], size_t first[STAGES],
                                    hada_error *err)
{
    hada_tensors *file = NULL;
    size_t count = 0;
    hada_status status = HADA_OK;
    HADA_TRY(hada_tensors_open(&file, path, err));
    for (int i = 0; i < CHANNELS; i++)
        weights[i] = 0.0f;
    for (int k = 0; k < STAGES; k++) {
        first[k] = count;
        HADA_TRY_OR_DONE(read_head(file, net, k, weights + count, err));
        count += (size_t)lpips_stage_channels(net, k);
    }
done:
    hada_tensors_close(&file);
    return hada_named(status, path, err);
}

/* What stands where for images of one size. */
typedef struct lpips_plan {
    hada_size input[STAGES], size[STAGES]; /* of the convolutions; what a stage gives */
    size_t map_at[STAGES + 1];             /* a stage's distances; the count of all */
    size_t in_floats, pooled_floats;
} lpips_plan;

struct hada_lpips {
    hada_context *context;
    hada_slot *slot;
    hada_lpips_net net;
    hada_net *stage[STAGES];
    hada_buffer values[STAGES]; /* weights of the stages */
    hada_buffer heads;          /* of the channels, stage after stage */
    size_t head_at[STAGES];

    /* For images of one size, kept for the next ones; rows 0: none. */
    int rows, cols;
    lpips_plan plan;
    hada_graph *graph[STAGES];
    hada_buffer in, pooled, distances;
    float *pair, *maps; /* on the host: two images, the distances */
};

static hada_graph_options options_for(hada_size size)
{
    return (hada_graph_options){.images = 2, .rows = size.rows, .cols = size.cols};
}

static void forget_size(hada_lpips *lpips)
{
    for (int k = 0; k < STAGES; k++)
        hada_graph_destroy(&lpips->graph[k]);
    HADA_DESTROY_BUFFERS(&lpips->in, &lpips->pooled, &lpips->distances);
    HADA_FREE(lpips->pair, lpips->maps);
    lpips->pair = lpips->maps = NULL;
    lpips->rows = lpips->cols = 0;
}

/* The tensor between pooling and a convolution that wants more zeros around than a tensor has. */
static hada_tensor pooled_tensor(const hada_lpips *lpips, int stage, hada_size input, cl_mem mem)
{
    const int border = lpips_stage_entry(lpips->net, stage).border;
    return hada_tensor_at(lpips->context, mem, 0, 2, lpips_stage_channels(lpips->net, stage - 1),
                          input.rows - 2 * border, input.cols - 2 * border);
}

static hada_status plan_size(const hada_lpips *lpips, int rows, int cols, lpips_plan *plan, hada_error *err)
{
    enum { MOST_LAYERS = 16 };
    hada_size sizes[MOST_LAYERS];
    const int least = lpips_least_size(lpips->net);
    if (rows < least || cols < least)
        return hada_fail(err, HADA_ERROR_SIZE, "LPIPS by %s needs images of at least %d x %d, not %d x %d",
                         lpips->net == HADA_LPIPS_ALEX ? "AlexNet" : "VGG-16", least, least, rows, cols);
    *plan = (lpips_plan){0};
    for (int k = 0; k < STAGES; k++) {
        const entry e = lpips_stage_entry(lpips->net, k);
        plan->input[k] = lpips_stage_input(lpips->net, k, k ? plan->size[k - 1] : (hada_size){rows, cols});
        if (e.pool && e.border) {
            const hada_tensor pooled = pooled_tensor(lpips, k, plan->input[k], NULL);
            plan->pooled_floats = 2 * pooled.image_stride;
        }
        HADA_TRY(hada_net_sizes(lpips->stage[k], plan->input[k].rows, plan->input[k].cols, sizes, err));
        plan->size[k] = sizes[lpips->stage[k]->count - 1];
        plan->map_at[k + 1] = plan->map_at[k] + (size_t)plan->size[k].rows * (size_t)plan->size[k].cols;
    }
    plan->in_floats =
        2 * (size_t)lpips_fill_channels(lpips->net) * (size_t)plan->input[0].rows * (size_t)plan->input[0].cols;
    return HADA_OK;
}

static hada_status make_graphs(hada_lpips *lpips, hada_error *err)
{
    for (int k = 0; k < STAGES; k++) {
        const hada_graph_options options = options_for(lpips->plan.input[k]);
        HADA_TRY(hada_graph_create(&lpips->graph[k], lpips->slot, lpips->stage[k], &options, err));
        HADA_TRY(hada_graph_set_weights(lpips->graph[k], (hada_floats){lpips->values[k].mem, 0}, err));
    }
    return HADA_OK;
}

static hada_status make_size(hada_lpips *lpips, int rows, int cols, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(plan_size(lpips, rows, cols, &lpips->plan, err));
    const size_t in = lpips->plan.in_floats, pooled = lpips->plan.pooled_floats * sizeof(float);
    const size_t distances = lpips->plan.map_at[STAGES];
    HADA_TRY_OR_DONE(make_graphs(lpips, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&lpips->in, lpips->context, in * sizeof(float), "the images to compare", err));
    if (pooled) {
        HADA_TRY_OR_DONE(hada_buffer_create(&lpips->pooled, lpips->context, pooled, "pooled features", err));
        HADA_TRY_OR_DONE(hada_buffer_clear(&lpips->pooled, lpips->slot, 0, pooled, err));
    }
    HADA_TRY_OR_DONE(
        hada_buffer_create(&lpips->distances, lpips->context, distances * sizeof(float), "distances of features", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(lpips->pair, in, "the images to compare", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(lpips->maps, distances, "distances of features", err));
    lpips->rows = rows;
    lpips->cols = cols;
done:
    if (status)
        forget_size(lpips);
    return status;
}

static hada_status check(const hada_image *a, const hada_image *b, double peak, hada_error *err)
{
    HADA_TRY(hada_image_check(a, NULL, "LPIPS", "one of two images", err));
    HADA_TRY(hada_image_check(b, NULL, "LPIPS", "one of two images", err));
    if (!(peak > 0.0 && isfinite(peak)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a peak of %g is not possible; it must be above 0", peak);
    if (a->channels != b->channels || a->rows != b->rows || a->cols != b->cols ||
        (a->channels != 1 && a->channels != 3))
        return hada_fail(err, HADA_ERROR_SIZE,
                         "LPIPS compares images of one size with 1 or 3 channels, not %d channels, %d x %d and %d "
                         "channels, %d x %d",
                         a->channels, a->rows, a->cols, b->channels, b->rows, b->cols);
    const size_t bad = hada_image_count_not_finite(a) + hada_image_count_not_finite(b);
    return bad ? hada_fail(err, HADA_ERROR_NOT_FINITE, "the images to compare hold %zu NaN or infinite values", bad)
               : HADA_OK;
}

/* What a stage gives to the input of the next one. */
static hada_status enter(hada_lpips *lpips, int stage, hada_error *err)
{
    const entry e = lpips_stage_entry(lpips->net, stage);
    const hada_tensor *from = hada_graph_output(lpips->graph[stage - 1]), *to = hada_graph_input(lpips->graph[stage]);
    const hada_tensor pooled = pooled_tensor(lpips, stage, lpips->plan.input[stage], lpips->pooled.mem);
    const hada_tensor *between = e.border ? &pooled : to;
    HADA_TRY(hada_tensor_clear_halo(lpips->slot, to, err)); /* other things may have stood there */
    if (e.pool)
        HADA_TRY(hada_pool_forward(lpips->slot, HADA_POOL_MAX, e.pool, e.pool_stride, from, between, err));
    if (!e.pool || e.border)
        HADA_TRY(hada_place(lpips->slot, e.pool ? between : from, to, e.border, e.border, 0, 0, err));
    return HADA_OK;
}

/* The distances of all stages into lpips->maps. */
static hada_status compare(hada_lpips *lpips, const hada_image *a, const hada_image *b, double peak, hada_error *err)
{
    HADA_TRY(check(a, b, peak, err));
    if (lpips->rows != a->rows || lpips->cols != a->cols) {
        forget_size(lpips);
        HADA_TRY(make_size(lpips, a->rows, a->cols, err));
    }
    const hada_size input = lpips->plan.input[0];
    const size_t plane = (size_t)input.rows * (size_t)input.cols, image = lpips->plan.in_floats / 2;
    const hada_planar in = {lpips->in.mem, 0, image, plane, (size_t)input.cols};
    lpips_fill(lpips->net, a, peak, input, lpips->pair);
    lpips_fill(lpips->net, b, peak, input, lpips->pair + image);
    HADA_TRY(hada_buffer_write(&lpips->in, lpips->slot, 0, lpips->pair, lpips->in.bytes, err));
    HADA_TRY(hada_graph_load(lpips->graph[0], &in, err));
    for (int k = 0; k < STAGES; k++) {
        if (k)
            HADA_TRY(enter(lpips, k, err));
        HADA_TRY(hada_graph_forward(lpips->graph[k], err));
        HADA_TRY(hada_lpips_distance(lpips->slot, hada_graph_output(lpips->graph[k]),
                                     (hada_floats){lpips->heads.mem, lpips->head_at[k]},
                                     (hada_floats){lpips->distances.mem, lpips->plan.map_at[k]}, err));
    }
    return hada_buffer_read(&lpips->distances, lpips->slot, 0, lpips->maps, lpips->distances.bytes, err);
}

/* Bilinear resizing with pixel centres at half (PyTorch's align_corners=False): the place of pixel i of `out` among
 * `in`: index of the first neighbour, share of the second. */
static int place(int i, int in, int out, double *share)
{
    const double at = fmax((i + 0.5) * in / out - 0.5, 0.0);
    const int first = at < in - 1 ? (int)at : in - 1;
    *share = first < in - 1 ? at - first : 0.0;
    return first;
}

static double resized(const float *map, hada_size size, int row, int col, int rows, int cols)
{
    double down, right;
    const int r = place(row, size.rows, rows, &down), c = place(col, size.cols, cols, &right);
    const float *at = map + (size_t)r * (size_t)size.cols + (size_t)c;
    const int next = c + 1 < size.cols, below = r + 1 < size.rows ? size.cols : 0;
    const double top = (1.0 - right) * at[0] + right * at[next];
    const double bottom = (1.0 - right) * at[below] + right * at[below + next];
    return (1.0 - down) * top + down * bottom;
}

static double distance_at(const hada_lpips *lpips, int row, int col)
{
    double sum = 0.0;
    for (int k = 0; k < STAGES; k++)
        sum += resized(lpips->maps + lpips->plan.map_at[k], lpips->plan.size[k], row, col, lpips->rows, lpips->cols);
    return sum;
}

hada_status hada_lpips_run(hada_lpips *lpips, const hada_image *a, const hada_image *b, double peak,
                           const unsigned char *mask, double *out, hada_error *err)
{
    HADA_NEED(lpips && out, err);
    HADA_TRY(compare(lpips, a, b, peak, err));
    double all = 0.0;
    if (mask) {
        size_t used = 0;
        for (int r = 0; r < a->rows; r++)
            for (int c = 0; c < a->cols; c++)
                if (mask[(size_t)r * (size_t)a->cols + (size_t)c]) {
                    all += distance_at(lpips, r, c);
                    used++;
                }
        if (!used)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "the mask leaves no pixel to compare");
        *out = all / (double)used;
        return HADA_OK;
    }
    for (int k = 0; k < STAGES; k++) {
        double sum = 0.0;
        for (size_t i = lpips->plan.map_at[k]; i < lpips->plan.map_at[k + 1]; i++)
            sum += lpips->maps[i];
        all += sum / (double)(lpips->plan.map_at[k + 1] - lpips->plan.map_at[k]);
    }
    *out = all;
    return HADA_OK;
}

hada_status hada_lpips_map(hada_lpips *lpips, const hada_image *a, const hada_image *b, double peak, hada_image *map,
                           hada_error *err)
{
    HADA_NEED(lpips && map, err);
    HADA_TRY(compare(lpips, a, b, peak, err));
    HADA_TRY(hada_image_ensure(map, 1, a->rows, a->cols, err));
    for (int r = 0; r < a->rows; r++)
        for (int c = 0; c < a->cols; c++)
            map->data[(size_t)r * (size_t)a->cols + (size_t)c] = (float)distance_at(lpips, r, c);
    return HADA_OK;
}

hada_status hada_lpips_bytes(const hada_lpips *lpips, int rows, int cols, uint64_t *bytes, hada_error *err)
{
    hada_dry dry;
    HADA_NEED(lpips && bytes, err);
    hada_dry_begin(&dry, lpips->context);
    hada_lpips trial = {.context = &dry.context, .slot = &dry.slot, .net = lpips->net};
    memcpy(trial.stage, lpips->stage, sizeof trial.stage);
    const hada_status status = make_size(&trial, rows, cols, err);
    *bytes = lpips->heads.bytes + hada_context_bytes(&dry.context);
    for (int k = 0; k < STAGES; k++)
        *bytes += lpips->values[k].bytes;
    forget_size(&trial);
    hada_dry_end(&dry);
    return status;
}

static hada_status read_backbone(hada_lpips *lpips, const char *path, hada_error *err)
{
    hada_tensors *file = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_tensors_open(&file, path, err));
    HADA_TRY_OR_DONE(lpips_find_net(file, &lpips->net, err));
    for (int k = 0; k < STAGES; k++) {
        HADA_TRY_OR_DONE(lpips_stage_make(&lpips->stage[k], lpips->net, k, file, err));
        HADA_TRY_OR_DONE(hada_buffer_create_from(&lpips->values[k], lpips->slot, lpips->stage[k]->values,
                                                 lpips->stage[k]->floats * sizeof(float), "the weights", err));
    }
done:
    hada_tensors_close(&file);
    return hada_named(status, path, err);
}

static hada_status read_heads(hada_lpips *lpips, const char *path, hada_error *err)
{
    float weights[CHANNELS];
    HADA_TRY(lpips_read_heads(path, lpips->net, weights, lpips->head_at, err));
    return hada_buffer_create_from(&lpips->heads, lpips->slot, weights, sizeof weights, "the heads of LPIPS", err);
}

hada_status hada_lpips_create(hada_lpips **out, hada_context *context, hada_lpips_net net, const char *backbone,
                              const char *heads, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_lpips *lpips = NULL;
    if (!out || !context || !backbone || (unsigned)net > HADA_LPIPS_ALEX)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_lpips_create: an argument is missing or out of range");
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(lpips, 1, "LPIPS", err));
    lpips->context = context;
    lpips->net = net;
    HADA_TRY_OR_DONE(hada_slot_create(&lpips->slot, context, err));
    HADA_TRY_OR_DONE(read_backbone(lpips, backbone, err));
    HADA_TRY_OR_DONE(read_heads(lpips, heads ? heads : backbone, err));
done:
    if (status)
        hada_lpips_destroy(&lpips);
    *out = lpips;
    return status;
}

void hada_lpips_destroy(hada_lpips **pointer)
{
    hada_lpips *lpips = hada_taken(pointer);
    if (!lpips)
        return;
    if (lpips->slot)
        hada_slot_finish(lpips->slot, NULL);
    forget_size(lpips);
    for (int k = 0; k < STAGES; k++) {
        hada_buffer_destroy(&lpips->values[k]);
        hada_net_destroy(&lpips->stage[k]);
    }
    hada_buffer_destroy(&lpips->heads);
    hada_slot_destroy(&lpips->slot);
    free(lpips);
}

void hada_lpips_watch(hada_lpips *lpips, const hada_monitor *monitor)
{
    hada_slot_watch(lpips->slot, monitor);
}

hada_lpips_net hada_lpips_get_net(const hada_lpips *lpips)
{
    if (!lpips)
        return HADA_LPIPS_AUTO;
    return lpips->net;
}
