/* Convolutions by tensor cores are tried before they serve: the instruction stands in the kernel as text for one
 * vendor's compiler, and nothing else says whether a driver takes it and what it computes. */
#include "net/conv_plan.h"

#include "core/random.h"

/* A convolution compared with the plain one, on random values. */
typedef struct comparison {
    hada_slot *slot;
    hada_conv_desc desc;
    hada_buffer x, y, weights, bias;
    hada_tensor in, out;
    float *expected, *got; /* out.image_stride values: of the plain one, and of another */
} comparison;

/* What a convolution gives, with zeros where it writes nothing. */
static hada_status values_of(comparison *c, hada_conv *conv, float *values, hada_error *err)
{
    HADA_TRY(hada_conv_set_weights(conv, (hada_floats){c->weights.mem, 0}, err));
    HADA_TRY(hada_buffer_clear(&c->y, c->slot, 0, c->y.bytes, err));
    HADA_TRY(hada_conv_forward(conv, &c->in, NULL, (hada_floats){c->bias.mem, 0}, &c->out, NULL, err));
    return hada_buffer_read(&c->y, c->slot, 0, values, c->y.bytes, err);
}

static hada_status random_buffer(comparison *c, hada_buffer *buffer, uint64_t stream, size_t count, float scale,
                                 hada_error *err)
{
    hada_status status = HADA_OK;
    float *values = NULL;
    hada_random random;
    HADA_TRY_OR_DONE(HADA_NEW(values, count, "the values of a measurement", err));
    hada_random_seed(&random, 1, stream);
    for (size_t i = 0; i < count; i++)
        values[i] = scale * (float)hada_random_normal(&random);
    HADA_TRY_OR_DONE(hada_buffer_create_from(buffer, c->slot, values, count * sizeof *values, "a measurement", err));
done:
    free(values);
    return status;
}

/* An image, weights of a scale that keeps values near 1, and what the plain convolution makes of them. Whatever it
 * returns, end() frees what there is. */
static hada_status begin(comparison *c, hada_slot *slot, const hada_conv_desc *desc, hada_error *err)
{
    *c = (comparison){.slot = slot, .desc = *desc};
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
    HADA_TRY_OR_DONE(HADA_NEW(c->expected, 2 * c->out.image_stride, "a measurement", err));
    c->got = c->expected + c->out.image_stride;
    c->in.mem = c->x.mem;
    c->out.mem = c->y.mem;
    const hada_planar from = hada_planar_like(&c->in, planar.mem, 0);
    HADA_TRY_OR_DONE(hada_tensor_load(c->slot, &from, &c->in, err));
    HADA_TRY_OR_DONE(hada_conv_create(&plain, c->slot, &definition, err));
    HADA_TRY_OR_DONE(values_of(c, plain, c->expected, err));
done:
    hada_conv_destroy(&plain);
    hada_buffer_destroy(&planar);
    return status;
}

/* Relative rms of `got` from `expected`. */
static double difference(const comparison *c)
{
    double square = 0, whole = 0;
    for (size_t i = 0; i < c->out.image_stride; i++) {
        const double d = (double)c->got[i] - (double)c->expected[i];
        square += d * d;
        whole += (double)c->expected[i] * (double)c->expected[i];
    }
    return sqrt(square / (whole > 0 ? whole : 1));
}

static void end(comparison *c)
{
    free(c->expected);
    HADA_DESTROY_BUFFERS(&c->x, &c->y, &c->weights, &c->bias);
}

/* Channels that fill no block, several tiles of pixels and several steps, by both sizes of tiles: 20 x 21 pixels are
 * two of 256 and four of 128. */
static hada_conv_desc trial(int out_channels)
{
    return (hada_conv_desc){.images = 1,
                            .in_channels = 21,
                            .out_channels = out_channels,
                            .in_rows = 20,
                            .in_cols = 21,
                            .kernel_rows = 3,
                            .kernel_cols = 3,
                            .stride = 1,
                            .pad_rows = 1,
                            .pad_cols = 1,
                            .method = HADA_CONV_TF32};
}

hada_status hada_conv_tf32_apart(hada_slot *slot, double *apart, hada_error *err)
{
    static const int out_channels[] = {27, 59};
    hada_status status = HADA_OK;
    comparison compare = {0};
    hada_conv *conv = NULL;
    *apart = 0;
    for (size_t i = 0; i < HADA_COUNT(out_channels); i++) {
        const hada_conv_desc desc = trial(out_channels[i]);
        HADA_TRY_OR_DONE(begin(&compare, slot, &desc, err));
        HADA_TRY_OR_DONE(hada_conv_create(&conv, slot, &desc, err));
        HADA_TRY_OR_DONE(values_of(&compare, conv, compare.got, err));
        const double one = difference(&compare);
        *apart = one > *apart || one != one ? one : *apart; /* what is no number stays */
        hada_conv_destroy(&conv);
        end(&compare);
        compare = (comparison){0};
        if (!(one <= HADA_CONV_TF32_MOST))
            break;
    }
done:
    hada_conv_destroy(&conv);
    end(&compare);
    return status;
}

hada_status hada_conv_tf32_try(hada_slot *slot, hada_error *err)
{
    hada_context *context = slot->context;
    hada_error reason = {0};
    double apart = 0;
    if (context->dry || !context->tensor_cores || context->shape != HADA_SHAPE_GROUPS ||
        atomic_load(&context->tf32) != HADA_CONV_TF32_UNTRIED)
        return HADA_OK;
    /* two slots may try at the same time: they come to the same */
    const hada_status status = hada_conv_tf32_apart(slot, &apart, &reason);
    if (status == HADA_ERROR_MEMORY) { /* which says nothing of tensor cores */
        if (err)
            *err = reason;
        return status;
    }
    const int right = !status && apart <= HADA_CONV_TF32_MOST;
    if (status)
        hada_log(context, HADA_LOG_WARNING, "%s: convolutions go without tensor cores: %s", context->info.name,
                 reason.message);
    else if (!right)
        hada_log(context, HADA_LOG_WARNING,
                 "%s: convolutions go without tensor cores, whose results differ by %.1e (%.1e is rounding)",
                 context->info.name, apart, HADA_CONV_TF32_MOST);
    atomic_store(&context->tf32, right ? HADA_CONV_TF32_RIGHT : HADA_CONV_TF32_WRONG);
    return HADA_OK;
}
