/* Measuring the implementations of a convolution against each other, on request only. */
#include "net/conv_tune.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "net/conv_compare.h"
#include "net/conv_tf32.h"

enum { LEAST_ROUNDS = 3, MOST_ROUNDS = 31 };

/* Another variant must be clearly faster than what serves already. */
#define CLEARLY_FASTER 0.97

/* As HADA_CONV_COMPARE_MOST. */
#define TOLERANCE_WINOGRAD4 6e-6

typedef struct candidate {
    char text[64];
    hada_conv *conv; /* NULL: left out */
    double seconds[MOST_ROUNDS];
    double median;
} candidate;

typedef struct measurement {
    hada_conv_compare compare;
    hada_tune_conv_row *row;
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
    hada_status status = hada_conv_create_chosen(&conv, c->compare.slot, &c->compare.desc, choice, &local);
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
    status = hada_conv_compare_values(&c->compare, conv, c->compare.got, &local);
    if (status == HADA_ERROR_MEMORY) { /* which is no fault of the variant */
        hada_conv_destroy(&conv);
        if (err)
            *err = local;
        return status;
    }
    if (status == HADA_OK && c->probe)
        c->probe(c->user, one->text, c->compare.got, c->compare.out.image_stride);
    const int loose = conv->plan.pass[HADA_CONV_FORWARD].method == HADA_CONV_WINOGRAD4;
    const double apart = status ? INFINITY : hada_conv_compare_apart(&c->compare);
    if (apart <= (loose ? TOLERANCE_WINOGRAD4 : HADA_CONV_COMPARE_MOST)) {
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
    int rounds = 0;
    for (; rounds < MOST_ROUNDS && (rounds < LEAST_ROUNDS || hada_seconds() < end); rounds++)
        for (int i = 0; i < c->count; i++) {
            candidate *one = &c->all[(i + rounds) % c->count];
            if (!one->conv)
                continue;
            const double start = hada_seconds();
            HADA_TRY(hada_conv_compare_run(&c->compare, one->conv, err));
            one->seconds[rounds] = hada_seconds() - start;
        }
    for (int i = 0; i < c->count && rounds; i++) {
        qsort(c->all[i].seconds, (size_t)rounds, sizeof *c->all[i].seconds, ascending);
        c->all[i].median = c->all[i].seconds[rounds / 2];
    }
    return HADA_OK;
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
                         c->row->shape, c->compare.slot->context->info.name, c->row->reason);
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
    hada_conv_compare_end(&c->compare);
}

hada_status hada_conv_tune(hada_slot *slot, hada_tune_conv_row *row, double seconds, hada_conv_tune_probe probe,
                           void *user, hada_error *err)
{
    hada_status status = HADA_OK;
    measurement c = {.row = row, .probe = probe, .user = user};
    const hada_conv_desc desc = hada_tune_conv_desc(row);
    hada_conv_plan plan;
    row->measured = row->refused = row->skipped = 0;
    row->reason[0] = '\0';
    HADA_TRY_OR_DONE(hada_conv_plan_make(&plan, slot->context, &desc, NULL, err));
    hada_conv_shape_text(&plan, HADA_CONV_FORWARD, row->shape, sizeof row->shape);
    hada_conv_choice choices[HADA_CONV_VARIANTS];
    const int count = hada_conv_variants(slot->context, &plan, choices);
    HADA_TRY_OR_DONE(hada_allocated(c.all = hada_alloc((size_t)count + 1, sizeof *c.all, "a measurement", err)));
    HADA_TRY_OR_DONE(hada_conv_compare_begin(&c.compare, slot, &desc, err));
    const double start = hada_seconds(); /* the plain one may take longer than all others */
    HADA_TRY_OR_DONE(add_candidate(&c, NULL, err));
    /* the first half goes to compiling and checking */
    for (int i = 0; i < count; i++) {
        if (hada_seconds() - start > 0.5 * seconds)
            row->skipped++;
        else
            add_candidate(&c, &choices[i], NULL); /* one that cannot be made does not take part */
    }
    HADA_TRY_OR_DONE(measure(&c, start + seconds, err));
    HADA_TRY_OR_DONE(choose(&c, err));
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
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    HADA_TRY_OR_DONE(hada_conv_tf32_try(slot, err));
    HADA_TRY_OR_DONE(hada_conv_tune(slot, row, seconds, NULL, NULL, err));
done:
    hada_slot_destroy(&slot);
    return status;
}
