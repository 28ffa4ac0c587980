#include "metrics/lpips_stage.h"

#include "launch/lpips_distance.h"
#include "net/layer_launch.h"

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

int hada_lpips_stage_channels(hada_lpips_net net, int stage)
{
    int channels;
    const part *at = parts_of(net, stage, &channels);
    while (!at->tap)
        at++;
    return at->channels;
}

int hada_lpips_least_size(hada_lpips_net net)
{
    return net == HADA_LPIPS_ALEX ? 31 : 16; /* one pixel is left at the end */
}

enum { FOLD = 4, FOLDED_KERNEL = 3, FIRST_PAD = 2 }; /* AlexNet's first convolution */

static int is_folded(hada_lpips_net net, int stage)
{
    return net == HADA_LPIPS_ALEX && !stage;
}

hada_lpips_entry hada_lpips_stage_entry(hada_lpips_net net, int stage)
{
    int channels;
    const part *first = parts_of(net, stage, &channels);
    hada_lpips_entry entry = {.fold = is_folded(net, stage) ? FOLD : 1};
    if (!first->channels) {
        entry.pool = first->kernel;
        entry.pool_stride = first->stride;
        first++;
    }
    entry.border = !is_folded(net, stage) && first->pad > 1 ? first->pad : 0;
    return entry;
}

hada_size hada_lpips_stage_input(hada_lpips_net net, int stage, hada_size before)
{
    const hada_lpips_entry entry = hada_lpips_stage_entry(net, stage);
    hada_size in = before;
    if (entry.fold > 1)
        return (hada_size){(in.rows + 2 * FIRST_PAD - alex[0].kernel) / FOLD + FOLDED_KERNEL,
                           (in.cols + 2 * FIRST_PAD - alex[0].kernel) / FOLD + FOLDED_KERNEL};
    if (entry.pool)
        in =
            (hada_size){(in.rows - entry.pool) / entry.pool_stride + 1, (in.cols - entry.pool) / entry.pool_stride + 1};
    return (hada_size){in.rows + 2 * entry.border, in.cols + 2 * entry.border};
}

int hada_lpips_fill_channels(hada_lpips_net net)
{
    return is_folded(net, 0) ? 3 * FOLD * FOLD : 3;
}

/* 0 ... 1 to -1 ... 1 and then (x - shift) / scale, with the constants of the package. */
static float scaled(double value, int channel)
{
    static const double shift[3] = {-0.030, -0.088, -0.188}, scale[3] = {0.458, 0.448, 0.450};
    return (float)((2.0 * value - 1.0 - shift[channel]) / scale[channel]);
}

void hada_lpips_fill(hada_lpips_net net, const hada_image *image, double peak, hada_size size, float *out)
{
    const int fold = hada_lpips_stage_entry(net, 0).fold, pad = fold > 1 ? FIRST_PAD : 0;
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
    const hada_lpips_entry entry = hada_lpips_stage_entry(kind, stage);
    const part *parts = parts_of(kind, stage, &channels) + (entry.pool > 0);
    hada_layer layer = hada_layer_of(HADA_LAYER_INPUT, "", 0);
    layer.channels = stage ? channels : hada_lpips_fill_channels(kind);
    HADA_TRY(hada_net_add(net, &layer, &at, err));
    for (int first = 1, last = 0; !last; first = 0, parts++) {
        layer = hada_layer_of(HADA_LAYER_CONV, "", at);
        snprintf(layer.name, sizeof layer.name, "features.%d", parts->number);
        layer.channels = parts->channels;
        layer.kernel = entry.fold > 1 ? FOLDED_KERNEL : parts->kernel;
        layer.stride = entry.fold > 1 ? 1 : parts->stride;
        layer.pad = entry.fold > 1 || (first && entry.border) ? 0 : parts->pad;
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

hada_status hada_lpips_stage_make(hada_net **out, hada_lpips_net kind, int stage, const hada_tensors *file,
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
    if (x->images < 2 || x->images % 2)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "LPIPS compares pairs, not %d images", x->images);
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
hada_status hada_lpips_find_net(const hada_tensors *file, hada_lpips_net *net, hada_error *err)
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
    const int channels = hada_lpips_stage_channels(net, stage);
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

hada_status hada_lpips_read_heads(const char *path, hada_lpips_net net, float weights[HADA_LPIPS_CHANNELS],
                                  size_t first[HADA_LPIPS_STAGES], hada_error *err)
{
    hada_tensors *file = NULL;
    size_t count = 0;
    hada_status status = HADA_OK;
    HADA_TRY(hada_tensors_open(&file, path, err));
    for (int i = 0; i < HADA_LPIPS_CHANNELS; i++)
        weights[i] = 0.0f;
    for (int k = 0; k < HADA_LPIPS_STAGES; k++) {
        first[k] = count;
        HADA_TRY_OR_DONE(read_head(file, net, k, weights + count, err));
        count += (size_t)hada_lpips_stage_channels(net, k);
    }
done:
    if (status)
        hada_error_prefix(err, "%s: ", path);
    hada_tensors_close(&file);
    return status;
}
