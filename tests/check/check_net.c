#include "check_net.h"

#define BETWEEN    40 /* floats between images where the letter p asks for some, and what stands there */
#define BETWEEN_IS 7.0
#define GONE       (-777.0f) /* what an output holds before it is replaced */

int check_net_block(const check_state *state)
{
    return check_get(state, 'v', hada_net_block(state->slot->context));
}

hada_ref_shape check_net_shape(const check_state *state)
{
    return (hada_ref_shape){check_get(state, 'n', 1), check_get(state, 'k', 1), check_get(state, 'r', 8),
                            check_get(state, 'c', 8)};
}

check_net *check_net_own(check_state *state, hada_status (*run)(check_state *, check_net *, int, int, hada_error *))
{
    check_net *own = check_own(state, sizeof *own);
    own->run = run;
    own->mode = check_get(state, 'b', 0);
    own->accumulate = check_get(state, 'a', 0);
    return own;
}

static hada_tensor tensor_of(const check_state *state, const hada_ref_shape *shape, cl_mem mem, size_t offset)
{
    const int block = check_net_block(state);
    const size_t image = hada_tensor_image_floats(block, shape->channels, shape->rows, shape->cols);
    return (hada_tensor){.mem = mem,
                         .offset = offset,
                         .image_stride = image + (check_get(state, 'p', 0) ? BETWEEN : 0),
                         .images = shape->images,
                         .channels = shape->channels,
                         .rows = shape->rows,
                         .cols = shape->cols,
                         .block = block};
}

static size_t place_of(const hada_tensor *t, int n, int c, int row, int col)
{
    const size_t rows = (size_t)t->rows + 2, cols = (size_t)t->cols + 2, block = (size_t)t->block;
    return (size_t)n * t->image_stride + ((size_t)c / block * rows + (size_t)row + 1) * cols * block +
           ((size_t)col + 1) * block + (size_t)c % block;
}

/* Plain values to the places of a tensor at `out`, zeros round them, `between` between images. */
static void pack(const hada_tensor *t, const double *plain, double between, double *out)
{
    const size_t image = hada_tensor_image_floats(t->block, t->channels, t->rows, t->cols);
    for (int n = 0; n < t->images; n++) {
        for (size_t i = 0; i < t->image_stride; i++)
            out[(size_t)n * t->image_stride + i] = i < image ? 0.0 : between;
        for (int c = 0; c < t->channels; c++)
            for (int row = 0; row < t->rows; row++)
                for (int col = 0; col < t->cols; col++)
                    out[place_of(t, n, c, row, col)] = *plain++;
    }
}

static hada_status upload(check_state *state, const double *values, size_t count, hada_buffer *buffer, hada_error *err)
{
    float *floats = check_room(state, count * sizeof *floats);
    for (size_t i = 0; i < count; i++)
        floats[i] = (float)values[i];
    return check_upload(state, buffer, floats, count * sizeof *floats, err);
}

static double *random_values(check_state *state, uint64_t stream, size_t count, int largest)
{
    float *floats = check_room(state, count * sizeof *floats);
    double *out = check_room(state, count * sizeof *out);
    if (largest)
        check_fill_integers(state, stream, floats, count, largest);
    else
        check_fill_normal(state, stream, floats, count);
    for (size_t i = 0; i < count; i++)
        out[i] = floats[i];
    return out;
}

hada_status check_net_input(check_state *state, check_net *own, const hada_ref_shape *shape, int largest,
                            hada_error *err)
{
    const int i = own->inputs++;
    hada_tensor t = tensor_of(state, shape, NULL, 0);
    const size_t count = t.image_stride * (size_t)shape->images;
    double *blocks = check_room(state, count * sizeof *blocks);
    own->plain[i] = random_values(state, (uint64_t)i + 1, hada_ref_values(shape), largest);
    pack(&t, own->plain[i], BETWEEN_IS, blocks);
    HADA_TRY(upload(state, blocks, count, &own->memory[i], err));
    t.mem = own->memory[i].mem;
    own->x[i] = t;
    return HADA_OK;
}

hada_status check_net_floats(check_state *state, check_net *own, size_t count, int largest, hada_error *err)
{
    const int i = own->inputs++;
    own->plain[i] = random_values(state, (uint64_t)i + 1, count, largest);
    return upload(state, own->plain[i], count, &own->memory[i], err);
}

void check_net_ignore(check_state *state, size_t first, size_t count)
{
    if (!state->unspecified)
        state->unspecified = check_room(state, state->out_count);
    memset(state->unspecified + first, 1, count);
}

size_t check_net_behind(const check_state *state, const check_net *own)
{
    return state->out_offset + own->y.image_stride * (size_t)own->y.images;
}

hada_status check_net_output(check_state *state, check_net *own, const hada_ref_shape *shape, size_t floats,
                             int largest, double **plain, hada_error *err)
{
    const size_t values = hada_ref_values(shape);
    own->y = tensor_of(state, shape, NULL, 0);
    const size_t blocks = own->y.image_stride * (size_t)shape->images;
    HADA_TRY(check_output(state, blocks + floats, err));
    *plain = random_values(state, 99, values + floats, largest);
    double *all = check_room(state, (blocks + floats) * sizeof *all);
    if (!own->accumulate)
        for (size_t i = 0; i < values + floats; i++)
            (*plain)[i] = GONE;
    pack(&own->y, *plain, 0.0, all);
    memcpy(all + blocks, *plain + values, floats * sizeof *all);
    HADA_TRY(upload(state, all, blocks + floats, &own->start, err));
    own->y.mem = state->out.mem;
    own->y.offset = state->out_offset;
    return HADA_OK;
}

void check_net_expect(check_state *state, const check_net *own, const hada_ref_shape *shape, size_t floats,
                      const double *plain)
{
    pack(&own->y, plain, 0.0, state->expected);
    memcpy(state->expected + own->y.image_stride * (size_t)shape->images, plain + hada_ref_values(shape),
           floats * sizeof *plain);
}

hada_status check_net_launch(check_state *state, hada_error *err)
{
    check_net *own = state->own;
    if (!state->timing) {
        const cl_int code =
            clEnqueueCopyBuffer(state->slot->queue, own->start.mem, state->out.mem, 0,
                                state->out_offset * sizeof(float), state->out_count * sizeof(float), 0, NULL, NULL);
        if (code != CL_SUCCESS)
            return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    }
    const int piece = state->batch_limit ? state->batch_limit : own->y.images;
    for (int first = 0; first < own->y.images; first += piece)
        HADA_TRY(own->run(state, own, first, first + piece > own->y.images ? own->y.images - first : piece, err));
    return HADA_OK;
}
