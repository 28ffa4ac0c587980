/* Measuring the implementations of a convolution against each other, on request only. */
#include "net/conv_tune.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "core/random.h"
#include "net/conv_internal.h"

enum { LEAST_ROUNDS = 3, MOST_ROUNDS = 31 };

/* Another variant must be clearly faster than what serves already. */
#define CLEARLY_FASTER 0.97

/* Relative rms from the plain convolution: what docs/convolution.md states against double precision, and as much for
 * the plain one itself. */
#define TOLERANCE           2e-6
#define TOLERANCE_WINOGRAD4 6e-6

typedef struct candidate {
    char text[64];
    hada_conv *conv; /* NULL: left out */
    double seconds[MOST_ROUNDS];
    double median;
} candidate;

typedef struct measurement {
    hada_slot *slot;
    hada_conv_desc desc;
    hada_tune_conv_row *row;
    hada_buffer x, y, weights, bias;
    hada_tensor in, out;
    float *expected, *got;
    candidate *all;
    int count;
    hada_conv_tune_probe probe;
    void *user;
} measurement;

hada_conv_desc hada_tune_conv_desc(const hada_tune_conv_row *row)
{
    return (hada_conv_desc){.images = 1,
                            .in_channels = row->in_channels,
                            .out_channels = row->out_channels,
                            .in_rows = row->in_rows,
                            .in_cols = row->in_cols,
                            .kernel_rows = row->kernel,
                            .kernel_cols = row->kernel,
                            .stride = row->stride,
                            .pad_rows = row->pad,
                            .pad_cols = row->pad,
                            .transposed = row->transposed,
                            .output_pad = row->output_pad,
                            .activation = HADA_ACTIVATION_RELU};
}

static hada_status run(measurement *c, hada_conv *conv, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(hada_conv_forward(conv, &c->in, (hada_floats){c->bias.mem, 0}, &c->out, NULL, err));
    HADA_TRY(hada_slot_finish(c->slot, err));
done:
    return status;
}

/* What a convolution gives, with zeros where it writes nothing. */
static hada_status values_of(measurement *c, hada_conv *conv, float *values, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(hada_conv_set_weights(conv, (hada_floats){c->weights.mem, 0}, err));
    HADA_TRY(hada_buffer_clear(&c->y, c->slot, 0, c->y.bytes, err));
    HADA_TRY(run(c, conv, err));
    HADA_TRY(hada_buffer_read(&c->y, c->slot, 0, values, c->y.bytes, err));
done:
    return status;
}

static hada_status random_buffer(measurement *c, hada_buffer *buffer, uint64_t stream, size_t count, float scale,
                                 hada_error *err)
{
    hada_status status = HADA_OK;
    float *values = NULL;
    hada_random random;
    HADA_TRY(hada_alloc((void **)&values, count, sizeof *values, "the values of a measurement", err));
    hada_random_seed(&random, 1, stream);
    for (size_t i = 0; i < count; i++)
        values[i] = scale * (float)hada_random_normal(&random);
    HADA_TRY(hada_buffer_create_from(buffer, c->slot, values, count * sizeof *values, "a measurement", err));
done:
    free(values);
    return status;
}

/* Tensors, weights of a scale that keeps values near 1, and what the plain convolution makes of them. */
static hada_status make_values(measurement *c, hada_error *err)
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
    HADA_TRY(random_buffer(c, &planar, 0, planes, 1, err));
    HADA_TRY(random_buffer(c, &c->weights, 1, (size_t)d->in_channels * (size_t)d->out_channels * taps,
                           1 / sqrtf((float)((size_t)d->in_channels * taps)), err));
    HADA_TRY(random_buffer(c, &c->bias, 2, (size_t)d->out_channels, 0.1f, err));
    HADA_TRY(hada_buffer_create(&c->x, context, c->in.image_stride * sizeof(float), "a measurement", err));
    HADA_TRY(hada_buffer_create(&c->y, context, c->out.image_stride * sizeof(float), "a measurement", err));
    HADA_TRY(hada_alloc((void **)&c->expected, 2 * c->out.image_stride, sizeof(float), "a measurement", err));
    c->got = c->expected + c->out.image_stride;
    c->in.mem = c->x.mem;
    c->out.mem = c->y.mem;
    const size_t pixels = (size_t)d->in_rows * (size_t)d->in_cols;
    const hada_planar from = {planar.mem, 0, planes, pixels, (size_t)d->in_cols};
    HADA_TRY(hada_tensor_load(c->slot, &from, &c->in, err));
    HADA_TRY(hada_conv_create(&plain, c->slot, &definition, err));
    HADA_TRY(values_of(c, plain, c->expected, err));
done:
    hada_conv_destroy(&plain);
    hada_buffer_destroy(&planar);
    return status;
}

static double difference(const float *expected, const float *got, size_t count)
{
    double square = 0, whole = 0;
    for (size_t i = 0; i < count; i++) {
        const double d = (double)got[i] - (double)expected[i];
        square += d * d;
        whole += (double)expected[i] * (double)expected[i];
    }
    return sqrt(square / (whole > 0 ? whole : 1));
}

static int is_candidate(const measurement *c, const char *text)
{
    for (int i = 0; i < c->count; i++)
        if (!strcmp(c->all[i].text, text))
            return 1;
    return 0;
}

static void refuse(measurement *c, const char *text, const char *reason)
{
    c->row->refused++;
    snprintf(c->row->reason, sizeof c->row->reason, "%.*s: %.*s", 64, text, 180, reason);
}

/* Makes a variant and holds it against the plain one; a wrong one is left out. `choice` NULL: what serves now. */
static hada_status add_candidate(measurement *c, const hada_conv_choice *choice, hada_error *err)
{
    candidate *one = &c->all[c->count];
    hada_conv *conv = NULL;
    char reason[64];
    hada_error local = {0};
    hada_status status = hada_conv_create_chosen(&conv, c->slot, &c->desc, choice, &local);
    if (status) {
        if (err)
            *err = local;
        return status;
    }
    hada_conv_choice_text(&conv->plan, HADA_CONV_FORWARD, one->text, sizeof one->text);
    if (is_candidate(c, one->text)) {
        hada_conv_destroy(&conv);
        return HADA_OK;
    }
    c->count++;
    status = values_of(c, conv, c->got, &local);
    if (status == HADA_ERROR_MEMORY) { /* which is no fault of the variant */
        hada_conv_destroy(&conv);
        if (err)
            *err = local;
        return status;
    }
    if (status == HADA_OK && c->probe)
        c->probe(c->user, one->text, c->got, c->out.image_stride);
    const int loose = conv->plan.pass[HADA_CONV_FORWARD].method == HADA_CONV_WINOGRAD4;
    const double apart = status ? INFINITY : difference(c->expected, c->got, c->out.image_stride);
    if (apart <= (loose ? TOLERANCE_WINOGRAD4 : TOLERANCE)) {
        one->conv = conv;
        return HADA_OK;
    }
    snprintf(reason, sizeof reason, "relative difference %.1e from the plain convolution", apart);
    refuse(c, one->text, status ? local.message : reason);
    hada_conv_destroy(&conv);
    return HADA_OK;
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* All candidates once in each round, until the time is over. */
static hada_status measure(measurement *c, double end, hada_error *err)
{
    hada_status status = HADA_OK;
    int rounds = 0;
    for (; rounds < MOST_ROUNDS && (rounds < LEAST_ROUNDS || hada_seconds() < end); rounds++)
        for (int i = 0; i < c->count; i++) {
            candidate *one = &c->all[(i + rounds) % c->count];
            if (!one->conv)
                continue;
            const double start = hada_seconds();
            HADA_TRY(run(c, one->conv, err));
            one->seconds[rounds] = hada_seconds() - start;
        }
    for (int i = 0; i < c->count && rounds; i++) {
        qsort(c->all[i].seconds, (size_t)rounds, sizeof *c->all[i].seconds, ascending);
        c->all[i].median = c->all[i].seconds[rounds / 2];
    }
done:
    return status;
}

/* The first one serves now. */
static hada_status choose(measurement *c, hada_error *err)
{
    const candidate *best = c->all[0].conv ? &c->all[0] : NULL;
    for (int i = 1; i < c->count; i++) {
        const candidate *one = &c->all[i];
        if (one->conv && (!best || one->median < (best == &c->all[0] ? CLEARLY_FASTER : 1) * best->median))
            best = one;
    }
    if (!best)
        return hada_fail(err, HADA_ERROR_SELF_TEST, "no convolution gives right results for %s on %s; the last: %s",
                         c->row->shape, c->slot->context->info.name, c->row->reason);
    for (int i = 0; i < c->count; i++)
        c->row->measured += c->all[i].conv != NULL;
    c->row->before_ms = c->all[0].conv ? 1e3 * c->all[0].median : NAN;
    c->row->chosen_ms = 1e3 * best->median;
    memcpy(c->row->before, c->all[0].text, sizeof c->row->before);
    memcpy(c->row->chosen, best->text, sizeof c->row->chosen);
    return HADA_OK;
}

static void finish(measurement *c)
{
    for (int i = 0; i < c->count; i++)
        hada_conv_destroy(&c->all[i].conv);
    free(c->all);
    free(c->expected);
    hada_buffer *const buffers[] = {&c->x, &c->y, &c->weights, &c->bias};
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
}

hada_status hada_conv_tune(hada_slot *slot, hada_tune_conv_row *row, double seconds, hada_conv_tune_probe probe,
                           void *user, hada_error *err)
{
    hada_status status = HADA_OK;
    measurement c = {.slot = slot, .desc = hada_tune_conv_desc(row), .row = row, .probe = probe, .user = user};
    hada_conv_plan plan;
    row->measured = row->refused = row->skipped = 0;
    row->reason[0] = '\0';
    HADA_TRY(hada_conv_plan_make(&plan, slot->context, &c.desc, NULL, err));
    hada_conv_shape_text(&plan, HADA_CONV_FORWARD, row->shape, sizeof row->shape);
    hada_conv_choice choices[HADA_CONV_VARIANTS];
    const int count = hada_conv_variants(slot->context, &plan, choices);
    HADA_TRY(hada_alloc((void **)&c.all, (size_t)count + 1, sizeof *c.all, "a measurement", err));
    HADA_TRY(make_values(&c, err));
    const double start = hada_seconds(); /* the plain one may take longer than all others */
    HADA_TRY(add_candidate(&c, NULL, err));
    /* the first half goes to compiling and checking */
    for (int i = 0; i < count; i++) {
        if (hada_seconds() - start > 0.5 * seconds)
            row->skipped++;
        else
            add_candidate(&c, &choices[i], NULL); /* one that cannot be made does not take part */
    }
    HADA_TRY(measure(&c, start + seconds, err));
    HADA_TRY(choose(&c, err));
done:
    finish(&c);
    return status;
}

hada_status hada_tune_conv(hada_context *context, hada_tune_conv_row *row, double seconds, hada_error *err)
{
    hada_status status = HADA_OK;
    if (!context || !row || !(seconds > 0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_tune_conv: a context, a row and a time above 0 are needed");
    hada_slot *slot = NULL;
    HADA_TRY(hada_slot_create(&slot, context, err));
    HADA_TRY(hada_conv_tune(slot, row, seconds, NULL, NULL, err));
done:
    hada_slot_destroy(&slot);
    return status;
}
