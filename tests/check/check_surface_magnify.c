/* Images magnified and summed (surface_magnify): vectors and the columns where they break, taps that wrap round, parts
 * that no source has. */
#include "check.h"
#include "launch/surface_magnify.h"
#include "ref/ref_surface.h"
#include "surface/spline.h"

enum { SLOTS = 4 };

typedef struct magnify_state {
    hada_buffer coefficients, bases, weights, lines, image;
    hada_surface_sources sources;
} magnify_state;

/* Each source has a magnification, a place and a weight of its own. */
static double scale_of(const check_state *state, int source)
{
    return 1.0 + (source + 1) * (check_get(state, 's', 1010) - 1000) / 1000.0;
}

static double place_of(const check_state *state, int source)
{
    return (source - 1) * check_get(state, 'o', 0) / 100.0;
}

static void fill_tables(const check_state *state, const magnify_state *own, int *bases, float *weights)
{
    const int rows = own->sources.rows, cols = own->sources.cols;
    for (int s = 0; s < own->sources.count; s++, bases += rows + cols, weights += HADA_SPLINE_TAPS * (rows + cols)) {
        const double scale = scale_of(state, s), place = place_of(state, s);
        hada_spline_axis(rows, scale, place, 1.0 / scale, bases, weights);
        hada_spline_axis(cols, scale, -2.0 * place, (s + 1) / scale, bases + rows, weights + HADA_SPLINE_TAPS * rows);
    }
}

static void expect(check_state *state, const magnify_state *own, const float *values)
{
    const size_t area = (size_t)own->sources.rows * (size_t)own->sources.cols;
    double *image = check_room(state, area * sizeof *image);
    for (int c = 0; c < own->sources.channels; c++)
        for (int s = 0; s < own->sources.count; s++) {
            const size_t from = (size_t)(own->sources.slot[s] * own->sources.channels + c) * area;
            for (size_t i = 0; i < area; i++)
                image[i] = values[from + i];
            hada_ref_magnify(image, own->sources.rows, own->sources.cols, scale_of(state, s), place_of(state, s),
                             -2.0 * place_of(state, s), s + 1, state->expected + (size_t)c * area);
        }
}

static hada_status prepare(check_state *state, hada_error *err)
{
    magnify_state *own = check_own(state, sizeof *own);
    hada_surface_sources *n = &own->sources;
    *n = (hada_surface_sources){.channels = check_get(state, 'k', 1),
                                .rows = check_get(state, 'r', 16),
                                .cols = check_get(state, 'c', 16),
                                .count = check_get(state, 'n', 2),
                                .slot = {2, 0, 3, 1}};
    const size_t image = (size_t)(n->channels * n->rows * n->cols), entries = (size_t)(n->count * (n->rows + n->cols));
    float *values = check_room(state, SLOTS * image * sizeof *values);
    int *bases = check_room(state, entries * sizeof *bases);
    float *weights = check_room(state, HADA_SPLINE_TAPS * entries * sizeof *weights);
    check_fill_normal(state, 1, values, SLOTS * image);
    fill_tables(state, own, bases, weights);
    HADA_TRY(check_output(state, image, err));
    HADA_TRY(check_upload(state, &own->coefficients, values, SLOTS * image * sizeof *values, err));
    HADA_TRY(check_upload(state, &own->bases, bases, entries * sizeof *bases, err));
    HADA_TRY(check_upload(state, &own->weights, weights, HADA_SPLINE_TAPS * entries * sizeof *weights, err));
    HADA_TRY(check_scratch(state, &own->lines, (size_t)n->count * image * sizeof *values, err));
    HADA_TRY(check_scratch(state, &own->image, image * sizeof *values, err));
    expect(state, own, values);
    /* tables in float, and sums of twelve products a source */
    state->tolerance = 1e-6;
    state->bytes = 4.0 * (double)image * (3.0 * n->count + 1.0);
    state->flops = 4.0 * HADA_SPLINE_TAPS * (double)image * n->count;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const magnify_state *own = state->own;
    const hada_surface_sources *n = &own->sources;
    const hada_program_surface_magnify program = state->slot->context->shape == HADA_SHAPE_GROUPS
                                                     ? HADA_PROGRAM_SURFACE_MAGNIFY_GROUPS
                                                     : HADA_PROGRAM_SURFACE_MAGNIFY_DEFAULT;
    const size_t group = (size_t)hada_macros_of_surface_magnify(program)->surface_group;
    const hada_range range = hada_range_groups(1, group, (size_t)n->rows, (size_t)n->channels);
    HADA_TRY(hada_launch_surface_magnify(state->slot, program, &range, err, .coefficients = own->coefficients.mem,
                                         .bases = own->bases.ints, .weights = own->weights.mem, .lines = own->lines.mem,
                                         .out = own->image.mem, .sources = *n));
    return hada_buffer_copy(state->slot, own->image.mem, 0, state->out.mem, state->out_offset * sizeof(float),
                            state->out_count * sizeof(float), err);
}

const check_op check_surface_magnify = {
    "surface_magnify",
    "r rows, c columns, k channels, n sources, s magnification in thousandths, o place in hundredths of a pixel",
    prepare, launch, NULL};
