/* Convolutions and transposed convolutions: forward, gradient of the input, gradients of weights and biases, by every
 * implementation, with both sizes of blocks; tensors that are views, masks, accumulation, fused pooling. */
#include "check.h"
#include "net/conv.h"
#include "ref/ref_conv.h"

typedef enum conv_what { FORWARD, DATA, WEIGHTS } conv_what;

typedef struct conv_state {
    conv_what what;
    hada_conv *conv;
    hada_conv_desc desc;
    hada_ref_conv shape;
    int rows, cols, normal, view;
    size_t weights;                   /* how many */
    hada_buffer w, bias, x, dy, mask; /* what the operation takes */
    hada_tensor x_tensor, dy_tensor, mask_tensor, out, pooled;
    float *x_planar, *dy_planar, *w_planar, *bias_planar, *mask_planar;
    double *coarse, *fine; /* one image */
} conv_state;

static size_t plane_of(const hada_tensor *tensor)
{
    return (size_t)tensor->channels * (size_t)tensor->rows * (size_t)tensor->cols;
}

/* The place of a value in the tensor's memory. */
static size_t place_of(const hada_tensor *t, int image, int channel, int row, int col)
{
    const size_t block = (size_t)t->block, pitch = ((size_t)t->cols + 2) * block;
    return t->offset + (size_t)image * t->image_stride +
           ((size_t)channel / block * ((size_t)t->rows + 2) + (size_t)row + 1) * pitch + ((size_t)col + 1) * block +
           (size_t)channel % block;
}

/* A tensor of its own, or (view) the middle of one with a block more before and after. */
static hada_tensor make_tensor(const check_state *state, int view, size_t offset, int channels, int rows, int cols,
                               size_t *floats)
{
    const conv_state *own = state->own;
    const int block = hada_net_block(state->slot->context);
    const int filled = (channels + block - 1) / block * block;
    hada_tensor whole = hada_tensor_at(state->slot->context, NULL, offset, own->desc.images,
                                       view ? filled + 2 * block : channels, rows, cols);
    *floats = whole.image_stride * (size_t)whole.images;
    return view ? hada_tensor_channels(&whole, block, channels) : whole;
}

static void fill(const check_state *state, uint64_t stream, float *out, size_t count)
{
    const conv_state *own = state->own;
    if (own->normal)
        check_fill_normal(state, stream, out, count);
    else
        check_fill_integers(state, stream, out, count, 4);
}

/* Random planes, and on the device the tensor of them; what is not the tensor's (a view's neighbours) is not zero. */
static hada_status make_input(check_state *state, uint64_t stream, int channels, int rows, int cols, float **planar,
                              hada_buffer *buffer, hada_tensor *tensor, hada_error *err)
{
    const conv_state *own = state->own;
    size_t floats;
    *tensor = make_tensor(state, own->view, 0, channels, rows, cols, &floats);
    const size_t plane = plane_of(tensor);
    float *packed = check_room(state, floats * sizeof *packed);
    *planar = check_room(state, plane * (size_t)own->desc.images * sizeof **planar);
    const size_t inside = hada_tensor_image_floats(tensor->block, channels, rows, cols);
    fill(state, stream, *planar, plane * (size_t)own->desc.images);
    for (size_t i = 0; i < floats; i++)
        packed[i] = 1e6f;
    for (int n = 0; n < tensor->images; n++) {
        memset(packed + tensor->offset + (size_t)n * tensor->image_stride, 0, inside * sizeof *packed);
        const float *from = *planar + (size_t)n * plane;
        for (int k = 0; k < channels; k++)
            for (int r = 0; r < rows; r++)
                for (int c = 0; c < cols; c++)
                    packed[place_of(tensor, n, k, r, c)] = *from++;
    }
    HADA_TRY(check_upload(state, buffer, packed, floats * sizeof *packed, err));
    tensor->mem = buffer->mem;
    return HADA_OK;
}

static hada_status begin(check_state *state, conv_what what, hada_error *err)
{
    conv_state *own = check_own(state, sizeof *own);
    own->what = what;
    own->normal = check_get(state, 'f', 0);
    own->view = check_get(state, 'w', 0);
    hada_conv_desc *d = &own->desc;
    *d = (hada_conv_desc){.images = check_get(state, 'n', 1),
                          .in_channels = check_get(state, 'i', 8),
                          .out_channels = check_get(state, 'o', 8),
                          .in_rows = check_get(state, 'r', 8),
                          .in_cols = check_get(state, 'c', 8),
                          .kernel_rows = check_get(state, 'k', 3),
                          .stride = check_get(state, 's', 1),
                          .pad_rows = check_get(state, 'p', 0),
                          .transposed = check_get(state, 'd', 0),
                          .output_pad = check_get(state, 'e', 0),
                          .activation = (hada_activation)check_get(state, 'a', 0),
                          .slope = 0.25f,
                          .method = (hada_conv_method)check_get(state, 'm', 0),
                          .training = what != FORWARD};
    d->kernel_cols = check_get(state, 'l', d->kernel_rows);
    d->pad_cols = check_get(state, 'q', d->pad_rows);
    hada_conv_output_size(d, &own->rows, &own->cols);
    own->shape = d->transposed ? (hada_ref_conv){.coarse_channels = d->in_channels,
                                                 .coarse_rows = d->in_rows,
                                                 .coarse_cols = d->in_cols,
                                                 .fine_channels = d->out_channels,
                                                 .fine_rows = own->rows,
                                                 .fine_cols = own->cols}
                               : (hada_ref_conv){.coarse_channels = d->out_channels,
                                                 .coarse_rows = own->rows,
                                                 .coarse_cols = own->cols,
                                                 .fine_channels = d->in_channels,
                                                 .fine_rows = d->in_rows,
                                                 .fine_cols = d->in_cols};
    own->shape.kernel_rows = d->kernel_rows;
    own->shape.kernel_cols = d->kernel_cols;
    own->shape.stride = d->stride;
    own->shape.pad_rows = d->pad_rows;
    own->shape.pad_cols = d->pad_cols;
    own->weights = (size_t)d->in_channels * (size_t)d->out_channels * (size_t)d->kernel_rows * (size_t)d->kernel_cols;

    hada_context *context = state->slot->context;
    const int tensor_cores = context->tensor_cores;
    if (check_get(state, 'h', 0))
        context->tensor_cores = 0;
    HADA_TRY(hada_conv_create(&own->conv, state->slot, d, err));
    context->tensor_cores = tensor_cores;
    if (d->method && hada_conv_serving(own->conv) != d->method)
        HADA_TRY(hada_fail(err,
                           /* Winograd's tiles are in local memory */
                           state->slot->context->info.local_memory_bytes < (size_t)64 << 10 ? HADA_ERROR_UNSUPPORTED
                                                                                            : HADA_ERROR_STATE,
                           "method %d serves instead of %d", (int)hada_conv_serving(own->conv), (int)d->method));
    own->w_planar = check_room(state, own->weights * sizeof(float));
    own->bias_planar = check_room(state, (size_t)d->out_channels * sizeof(float));
    own->coarse = check_room(state, (size_t)own->shape.coarse_channels * (size_t)own->shape.coarse_rows *
                                        (size_t)own->shape.coarse_cols * sizeof(double));
    own->fine = check_room(state, (size_t)own->shape.fine_channels * (size_t)own->shape.fine_rows *
                                      (size_t)own->shape.fine_cols * sizeof(double));
    fill(state, 1, own->w_planar, own->weights);
    fill(state, 2, own->bias_planar, (size_t)d->out_channels);
    HADA_TRY(check_upload(state, &own->w, own->w_planar, own->weights * sizeof(float), err));
    HADA_TRY(check_upload(state, &own->bias, own->bias_planar, (size_t)d->out_channels * sizeof(float), err));
    if (what != DATA)
        HADA_TRY(
            make_input(state, 3, d->in_channels, d->in_rows, d->in_cols, &own->x_planar, &own->x, &own->x_tensor, err));
    if (what != FORWARD)
        HADA_TRY(make_input(state, 4, d->out_channels, own->rows, own->cols, &own->dy_planar, &own->dy, &own->dy_tensor,
                            err));
    HADA_TRY(hada_conv_set_weights(own->conv, (hada_floats){own->w.mem, 0}, err));
    state->flops = 2.0 * (double)own->weights * own->shape.coarse_rows * own->shape.coarse_cols * d->images;
    /* integers: every sum is exact; sigmoid and normal numbers: rounding of sums of up to thousands of products */
    state->tolerance = own->normal || d->activation == HADA_ACTIVATION_SIGMOID ? 1e-6 : 0.0;
    /* Winograd's transforms round integers too: F(4 x 4) divides
     * by 24 and cancels values up to a hundred times larger */
    if (hada_conv_serving(own->conv) == HADA_CONV_WINOGRAD4)
        state->tolerance = d->activation == HADA_ACTIVATION_SIGMOID ? 2e-5 : 5e-6; /* a sigmoid of sums about 100 */
    return HADA_OK;
}

/* One image's values into the expected output. */
static void put(const check_state *state, const hada_tensor *tensor, int image, const double *planar)
{
    for (int k = 0; k < tensor->channels; k++)
        for (int r = 0; r < tensor->rows; r++)
            for (int c = 0; c < tensor->cols; c++)
                state->expected[place_of(tensor, image, k, r, c)] = *planar++;
}

static double larger(double a, double b)
{
    return a > b ? a : b;
}

static hada_status forward_prepare(check_state *state, hada_error *err)
{
    HADA_TRY(begin(state, FORWARD, err));
    conv_state *own = state->own;
    const hada_conv_desc *d = &own->desc;
    const size_t pixels = (size_t)own->rows * (size_t)own->cols;
    size_t floats, more = 0;
    own->out = make_tensor(state, own->view, 0, d->out_channels, own->rows, own->cols, &floats);
    if (check_get(state, 'z', 0))
        own->pooled = make_tensor(state, 0, floats, d->out_channels, own->rows / 2, own->cols / 2, &more);
    HADA_TRY(check_output(state, floats + more, err));
    for (int n = 0; !state->timing && n < d->images; n++) {
        const float *x = own->x_planar + (size_t)n * plane_of(&own->x_tensor);
        double *y = d->transposed ? own->fine : own->coarse;
        if (d->transposed)
            hada_ref_conv_to_fine(&own->shape, own->w_planar, x, y);
        else
            hada_ref_conv_to_coarse(&own->shape, own->w_planar, x, y);
        for (size_t i = 0; i < (size_t)d->out_channels * pixels; i++)
            y[i] = hada_ref_activation(d->activation, d->slope,
                                       y[i] + (check_get(state, 'b', 1) ? own->bias_planar[i / pixels] : 0.0));
        put(state, &own->out, n, y);
        if (!more)
            continue;
        double *p = y; /* shrinks in place */
        for (int k = 0; k < d->out_channels; k++)
            for (int r = 0; r < own->rows / 2; r++)
                for (int c = 0; c < own->cols / 2; c++) {
                    const double *from = y + (size_t)k * pixels + (size_t)(2 * r * own->cols + 2 * c);
                    *p++ = larger(larger(from[0], from[1]), larger(from[own->cols], from[own->cols + 1]));
                }
        put(state, &own->pooled, n, y);
    }
    state->bytes = (double)(floats + own->weights + plane_of(&own->x_tensor) * (size_t)d->images) * sizeof(float);
    return HADA_OK;
}

static hada_tensor in_output(const check_state *state, const hada_tensor *tensor)
{
    hada_tensor moved = *tensor;
    moved.mem = state->out.mem;
    moved.offset += state->out_offset;
    return moved;
}

static hada_status forward_launch(check_state *state, hada_error *err)
{
    conv_state *own = state->own;
    const hada_tensor y = in_output(state, &own->out), pooled = in_output(state, &own->pooled);
    const int each = state->batch_limit ? state->batch_limit : own->desc.images;
    HADA_TRY(state->timing ? HADA_OK : check_clear(state, 0, state->out_count, err));
    for (int n = 0; n < own->desc.images; n += each) {
        const int count = each < own->desc.images - n ? each : own->desc.images - n;
        const hada_tensor part_x = hada_tensor_images(&own->x_tensor, n, count);
        const hada_tensor part_y = hada_tensor_images(&y, n, count);
        const hada_tensor part_pooled = hada_tensor_images(&pooled, n, count);
        const hada_floats bias = {check_get(state, 'b', 1) ? own->bias.mem : NULL, 0};
        HADA_TRY(hada_conv_forward(own->conv, &part_x, NULL, bias, &part_y, own->pooled.channels ? &part_pooled : NULL,
                                   err));
    }
    return HADA_OK;
}

static hada_status data_prepare(check_state *state, hada_error *err)
{
    HADA_TRY(begin(state, DATA, err));
    conv_state *own = state->own;
    const hada_conv_desc *d = &own->desc;
    size_t floats;
    own->out = make_tensor(state, own->view, 0, d->in_channels, d->in_rows, d->in_cols, &floats);
    const size_t plane = plane_of(&own->out);
    if (check_get(state, 'x', 0))
        HADA_TRY(make_input(state, 5, d->in_channels, d->in_rows, d->in_cols, &own->mask_planar, &own->mask,
                            &own->mask_tensor, err));
    HADA_TRY(check_output(state, floats, err));
    for (int n = 0; !state->timing && n < d->images; n++) {
        const float *dy = own->dy_planar + (size_t)n * plane_of(&own->dy_tensor);
        double *dx = d->transposed ? own->coarse : own->fine;
        if (d->transposed)
            hada_ref_conv_to_coarse(&own->shape, own->w_planar, dy, dx);
        else
            hada_ref_conv_to_fine(&own->shape, own->w_planar, dy, dx);
        for (size_t i = 0; i < plane; i++) {
            if (own->mask_planar && !(own->mask_planar[(size_t)n * plane + i] > 0.0f))
                dx[i] = 0.0;
            if (check_get(state, 'y', 0))
                dx[i] *= 2.0;
        }
        put(state, &own->out, n, dx);
    }
    return HADA_OK;
}

static hada_status data_launch(check_state *state, hada_error *err)
{
    conv_state *own = state->own;
    const hada_tensor dx = in_output(state, &own->out);
    const int each = state->batch_limit ? state->batch_limit : own->desc.images;
    HADA_TRY(state->timing ? HADA_OK : check_clear(state, 0, state->out_count, err));
    for (int again = 0; again <= check_get(state, 'y', 0); again++)
        for (int n = 0; n < own->desc.images; n += each) {
            const int count = each < own->desc.images - n ? each : own->desc.images - n;
            const hada_tensor part_dy = hada_tensor_images(&own->dy_tensor, n, count);
            const hada_tensor part_dx = hada_tensor_images(&dx, n, count);
            const hada_tensor part_mask = hada_tensor_images(&own->mask_tensor, n, count);
            HADA_TRY(hada_conv_backward_data(own->conv, &part_dy, own->mask_planar ? &part_mask : NULL, &part_dx, again,
                                             err));
        }
    return HADA_OK;
}

/* Gradients of weights, then of biases. */
static hada_status weights_prepare(check_state *state, hada_error *err)
{
    HADA_TRY(begin(state, WEIGHTS, err));
    conv_state *own = state->own;
    const hada_conv_desc *d = &own->desc;
    const int pixels = own->rows * own->cols;
    HADA_TRY(check_output(state, own->weights + (size_t)d->out_channels, err));
    for (int n = 0; !state->timing && n < d->images; n++) {
        const float *x = own->x_planar + (size_t)n * plane_of(&own->x_tensor);
        const float *dy = own->dy_planar + (size_t)n * plane_of(&own->dy_tensor);
        hada_ref_conv_weights(&own->shape, d->transposed ? x : dy, d->transposed ? dy : x, state->expected);
        hada_ref_conv_bias(dy, d->out_channels, pixels, state->expected + own->weights);
    }
    if (check_get(state, 'y', 0))
        for (size_t i = 0; i < state->out_count; i++)
            state->expected[i] *= 2.0;
    return HADA_OK;
}

static hada_status weights_launch(check_state *state, hada_error *err)
{
    conv_state *own = state->own;
    const hada_floats dw = {state->out.mem, state->out_offset}, db = {dw.mem, dw.offset + own->weights};
    for (int again = 0; again <= check_get(state, 'y', 0); again++)
        HADA_TRY(hada_conv_backward_weights(own->conv, &own->x_tensor, &own->dy_tensor, dw, db, again, err));
    return HADA_OK;
}

static void release(check_state *state)
{
    conv_state *own = state->own;
    hada_conv_destroy(&own->conv);
}

static const char forward_help[] =
    "n images, i o channels in and out, r c rows and columns, k l kernel, s stride, p q padding, d1 transposed, e "
    "output padding, a activation, b0 no bias, z1 pooled too, w1 views, f1 normal numbers, m method, h1 without tensor cores, v block";
static const char data_help[] = "as conv_forward; x1 masked, y1 added to what is there";
static const char weights_help[] = "as conv_forward; y1 added to what is there";

const check_op check_conv_forward = {"conv_forward", forward_help, forward_prepare, forward_launch, release};
const check_op check_conv_data = {"conv_data", data_help, data_prepare, data_launch, release};
const check_op check_conv_weights = {"conv_weights", weights_help, weights_prepare, weights_launch, release};
