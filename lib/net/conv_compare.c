/* Values for a comparison of convolutions, and how far two are apart. */
#include "net/conv_compare.h"

#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "core/random.h"

hada_status hada_conv_compare_run(hada_conv_compare *c, hada_conv *conv, hada_error *err)
{
    HADA_TRY(hada_conv_forward(conv, &c->in, (hada_floats){c->bias.mem, 0}, &c->out, NULL, err));
    return hada_slot_finish(c->slot, err);
}

hada_status hada_conv_compare_values(hada_conv_compare *c, hada_conv *conv, float *values, hada_error *err)
{
    HADA_TRY(hada_conv_set_weights(conv, (hada_floats){c->weights.mem, 0}, err));
    HADA_TRY(hada_buffer_clear(&c->y, c->slot, 0, c->y.bytes, err));
    HADA_TRY(hada_conv_compare_run(c, conv, err));
    return hada_buffer_read(&c->y, c->slot, 0, values, c->y.bytes, err);
}

static hada_status random_buffer(hada_conv_compare *c, hada_buffer *buffer, uint64_t stream, size_t count, float scale,
                                 hada_error *err)
{
    hada_status status = HADA_OK;
    float *values = NULL;
    hada_random random;
    HADA_TRY_OR_DONE(hada_allocated(values = hada_alloc(count, sizeof *values, "the values of a measurement", err)));
    hada_random_seed(&random, 1, stream);
    for (size_t i = 0; i < count; i++)
        values[i] = scale * (float)hada_random_normal(&random);
    HADA_TRY_OR_DONE(hada_buffer_create_from(buffer, c->slot, values, count * sizeof *values, "a measurement", err));
done:
    free(values);
    return status;
}

static hada_status make_values(hada_conv_compare *c, hada_error *err)
{
    hada_status status = HADA_OK;
    const hada_conv_desc *d = &c->desc;
    hada_context *context = c->slot->context;
    const size_t planes = (size_t)d->in_channels * (size_t)d->in_rows * (size_t)d->in_cols;
    const size_t taps = (size_t)d->kernel_rows * (size_t)d->kernel_cols;
    int rows, cols;
    hada_buffer planar = {0};
    hada_conv *plain = NULL;
    hada_conv_desc definition = *d;
    definition.method = HADA_CONV_PLAIN;
    hada_conv_output_size(d, &rows, &cols);
    c->in = hada_tensor_at(context, NULL, 0, 1, d->in_channels, d->in_rows, d->in_cols);
    c->out = hada_tensor_at(context, NULL, 0, 1, d->out_channels, rows, cols);
    HADA_TRY_OR_DONE(random_buffer(c, &planar, 0, planes, 1, err));
    HADA_TRY_OR_DONE(random_buffer(c, &c->weights, 1, (size_t)d->in_channels * (size_t)d->out_channels * taps,
                                   1 / sqrtf((float)((size_t)d->in_channels * taps)), err));
    HADA_TRY_OR_DONE(random_buffer(c, &c->bias, 2, (size_t)d->out_channels, 0.1f, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&c->x, context, c->in.image_stride * sizeof(float), "a measurement", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&c->y, context, c->out.image_stride * sizeof(float), "a measurement", err));
    HADA_TRY_OR_DONE(
        hada_allocated(c->expected = hada_alloc(2 * c->out.image_stride, sizeof(float), "a measurement", err)));
    c->got = c->expected + c->out.image_stride;
    c->in.mem = c->x.mem;
    c->out.mem = c->y.mem;
    const size_t pixels = (size_t)d->in_rows * (size_t)d->in_cols;
    const hada_planar from = {planar.mem, 0, planes, pixels, (size_t)d->in_cols};
    HADA_TRY_OR_DONE(hada_tensor_load(c->slot, &from, &c->in, err));
    HADA_TRY_OR_DONE(hada_conv_create(&plain, c->slot, &definition, err));
    HADA_TRY_OR_DONE(hada_conv_compare_values(c, plain, c->expected, err));
done:
    hada_conv_destroy(&plain);
    hada_buffer_destroy(&planar);
    return status;
}

hada_status hada_conv_compare_begin(hada_conv_compare *compare, hada_slot *slot, const hada_conv_desc *desc,
                                    hada_error *err)
{
    *compare = (hada_conv_compare){.slot = slot, .desc = *desc};
    return make_values(compare, err);
}

double hada_conv_compare_apart(const hada_conv_compare *c)
{
    double square = 0, whole = 0;
    for (size_t i = 0; i < c->out.image_stride; i++) {
        const double d = (double)c->got[i] - (double)c->expected[i];
        square += d * d;
        whole += (double)c->expected[i] * (double)c->expected[i];
    }
    return sqrt(square / (whole > 0 ? whole : 1));
}

void hada_conv_compare_end(hada_conv_compare *c)
{
    free(c->expected);
    hada_buffer *const buffers[] = {&c->x, &c->y, &c->weights, &c->bias};
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
}
