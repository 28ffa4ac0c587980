/* Tensors of nets: planes loaded into a tensor whose memory held something else, its halo cleared, stored again. The
 * output holds the tensor and the planes that came back. */
#include "check.h"
#include "net/tensor.h"

typedef struct tensor_state {
    hada_buffer in;
    hada_tensor tensor;
    hada_planar from, to;
    size_t floats; /* of the tensor */
} tensor_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    tensor_state *own = check_own(state, sizeof *own);
    const int images = check_get(state, 'n', 1), channels = check_get(state, 'k', 1);
    const int rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8);
    own->tensor = hada_tensor_at(state->slot->context, NULL, 0, images, channels, rows, cols);
    own->floats = own->tensor.image_stride * (size_t)images;
    /* strides with gaps */
    const size_t row = (size_t)cols + 3, plane = row * (size_t)rows + 5, image = plane * (size_t)channels + 7;
    own->from = (hada_planar){NULL, 2, image, plane, row};
    own->to = (hada_planar){NULL, own->floats, (size_t)(rows * cols * channels), (size_t)(rows * cols), (size_t)cols};
    const size_t count = 2 + image * (size_t)images;
    float *in = check_room(state, count * sizeof *in);
    HADA_TRY(check_output(state, own->floats + own->to.image_stride * (size_t)images, err));
    const size_t block = (size_t)own->tensor.block, pitch = (size_t)(cols + 2) * block;
    double *planes = state->expected + own->floats;
    check_fill_integers(state, 1, in, count, 99);
    for (int n = 0; n < images; n++)
        for (int k = 0; k < channels; k++)
            for (int r = 0; r < rows; r++)
                for (int c = 0; c < cols; c++) {
                    const float v = in[2 + (size_t)n * image + (size_t)k * plane + (size_t)r * row + (size_t)c];
                    state->expected[(size_t)n * own->tensor.image_stride +
                                    ((size_t)k / block * (size_t)(rows + 2) + (size_t)r + 1) * pitch +
                                    ((size_t)c + 1) * block + (size_t)k % block] = v;
                    *planes++ = v;
                }
    HADA_TRY(check_upload(state, &own->in, in, count * sizeof *in, err));
    own->from.mem = own->in.mem;
    own->to.mem = own->tensor.mem = state->out.mem;
    own->to.offset += state->out_offset;
    own->tensor.offset += state->out_offset;
    state->bytes = (double)(2 * own->floats + 2 * own->to.image_stride * (size_t)images) * sizeof(float);
    return HADA_OK;
}

/* The halo is spoilt on purpose between loading and clearing. */
static hada_status launch(check_state *state, hada_error *err)
{
    tensor_state *own = state->own;
    const int images = own->tensor.images, each = state->batch_limit ? state->batch_limit : images;
    const float spoilt = 3.0f;
    hada_status status = HADA_OK;
    for (int n = 0; !status && n < images; n += each) {
        const int count = each < images - n ? each : images - n;
        hada_planar from = own->from, to = own->to;
        const hada_tensor part = hada_tensor_images(&own->tensor, n, count);
        from.offset += (size_t)n * from.image_stride;
        to.offset += (size_t)n * to.image_stride;
        status = hada_tensor_load(state->slot, &from, &part, err);
        if (!status &&
            clEnqueueFillBuffer(state->slot->queue, part.mem, &spoilt, sizeof spoilt, part.offset * sizeof(float),
                                (size_t)part.block * sizeof(float), 0, NULL, NULL) != CL_SUCCESS)
            status = hada_fail(err, HADA_ERROR_DEVICE, "clEnqueueFillBuffer");
        if (!status)
            status = hada_tensor_clear_halo(state->slot, &part, err);
        if (!status)
            status = hada_tensor_store(state->slot, &part, &to, err);
    }
    return status;
}

const check_op check_tensor = {"net_tensor", "n images, k channels, r rows, c columns, v block", prepare, launch, NULL};
