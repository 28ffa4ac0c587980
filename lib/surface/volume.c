#include "surface/volume.h"

#include <limits.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "surface/volume_steps.h"

enum {
    BATCH = 48,     /* images that one transform call takes */
    CHECK_EVERY = 5 /* steps from one look at the energy to the next */
};

/* A run has gone astray, its steps being too long, where the residual's energy is above this many times the smallest so
 * far and this part of the frame's, or above the frame's own. */
#define ASTRAY      4.0
#define ASTRAY_PART 1e-3

/* On GPUs, which small images leave idle: as many as this many bytes of spectra hold. */
#define GROUPS_BYTES ((size_t)64 << 20)

/* How many of `bytes` a buffer of the device holds; one at least, which the buffer's making refuses where it must. */
static int in_one_buffer(const hada_context *context, size_t bytes)
{
    const uint64_t most = context->info.max_allocation_bytes / bytes;
    return most < 1 ? 1 : most > INT_MAX ? INT_MAX : (int)most;
}

static int batch_of(const hada_context *context, const hada_volume_shape *shape)
{
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->rows, shape->cols, HADA_FFT_AUTO);
    const size_t plane = (size_t)shape->channels * layout.count * 2 * sizeof(float);
    const int few = BATCH / shape->channels > 1 ? BATCH / shape->channels : 1, held = (int)(GROUPS_BYTES / plane);
    const int most = context->shape == HADA_SHAPE_GROUPS && held > few ? held : few;
    const int batch = shape->planes < most ? shape->planes : most, possible = in_one_buffer(context, plane);
    return possible < batch ? possible : batch;
}

/* Planes whose transfer functions share a buffer: evenly spread over the fewest. */
static int piece_of(const hada_context *context, const hada_volume_shape *shape)
{
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->rows, shape->cols, HADA_FFT_AUTO);
    const int most = in_one_buffer(context, (size_t)shape->channels * layout.count * 2 * sizeof(float));
    int pieces = (shape->planes + most - 1) / most;
    pieces = pieces > HADA_VOLUME_PIECES ? HADA_VOLUME_PIECES : pieces;
    return (shape->planes + pieces - 1) / pieces;
}

enum { PLANS = 4, ROWS = HADA_VOLUME_PIECES + 12 };

/* The transforms; returns how many. */
static int list_plans(const hada_context *context, const hada_volume_shape *shape, hada_fft_desc *plans)
{
    const int images = batch_of(context, shape) * shape->channels;
    plans[0] = hada_rect_transform(&shape->window, shape->rows, shape->cols, images, HADA_FFT_FORWARD);
    plans[1] = hada_rect_transform(&shape->window, shape->rows, shape->cols, images, HADA_FFT_INVERSE);
    plans[2] = hada_rect_transform(&shape->frame, shape->rows, shape->cols, shape->channels, HADA_FFT_FORWARD);
    plans[3] = hada_rect_transform(&shape->frame, shape->rows, shape->cols, shape->channels, HADA_FFT_INVERSE);
    return hada_volume_is_padded(shape) ? PLANS : 2;
}

/* Sums of the energies that are read together, and of the frame's. */
static size_t sums_of(const hada_context *context, const hada_volume_shape *shape, const hada_spectrum_layout *layout)
{
    const size_t frame = hada_volume_is_padded(shape) ? hada_rect_area(&shape->frame) : 0;
    const size_t slices = hada_divide_up(frame > layout->count ? frame : layout->count, HADA_VOLUME_SLICE);
    return (1 + (size_t)hada_volume_looks(context)) * slices * (size_t)shape->channels;
}

static void list_buffers(const hada_context *context, const hada_volume_shape *shape, hada_buffer_row *rows)
{
    static const char what[] = "a surface";
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->rows, shape->cols, HADA_FFT_AUTO);
    const size_t window = hada_rect_area(&shape->window), channels = (size_t)shape->channels,
                 planes = (size_t)shape->planes;
    const size_t unknown = shape->free ? planes : 1, spectrum = channels * layout.count * 2 * sizeof(float);
    const size_t values = (unknown * channels * window + HADA_VARIATION_ROOM) * sizeof(float);
    const size_t batch = ((size_t)batch_of(context, shape) * channels * window + HADA_VARIATION_ROOM) * sizeof(float);
    const size_t duals = sizeof(float) * hada_variation_floats(context, shape->channels, shape->window.rows,
                                                               shape->window.cols, (int)unknown);
    const size_t piece = (size_t)piece_of(context, shape);
    const hada_buffer_row list[ROWS - HADA_VOLUME_PIECES] = {
        {offsetof(hada_volume, weight), spectrum / 2, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, spectra), (size_t)batch_of(context, shape) * spectrum, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, sum), spectrum, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, frame),
         hada_volume_is_padded(shape) ? channels * hada_rect_area(&shape->frame) * sizeof(float) : 0, what,
         HADA_OWN_STEPS},
        {offsetof(hada_volume, mask),
         hada_volume_is_padded(shape) && shape->weighs ? channels * hada_rect_area(&shape->frame) * sizeof(float) : 0,
         what, HADA_OWN_STEPS},
        {offsetof(hada_volume, planes), shape->free ? values : batch, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, at), values, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, gradient), values, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, start), values, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, duals[0]), duals, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, duals[1]), duals, what, HADA_OWN_STEPS},
        {offsetof(hada_volume, partial), sums_of(context, shape, &layout) * sizeof(float), what, HADA_OWN_STEPS}};
    for (size_t i = 0, left = planes, here; i < HADA_VOLUME_PIECES; i++, left -= here) {
        here = left < piece ? left : piece;
        rows[i] = (hada_buffer_row){offsetof(hada_volume, otf) + i * sizeof(hada_buffer), here * spectrum, what,
                                    HADA_OWN_STEPS};
    }
    memcpy(rows + HADA_VOLUME_PIECES, list, sizeof list);
}

static hada_status check_shape(const hada_volume_shape *shape, hada_error *err)
{
    if (shape->channels < 1 || shape->planes < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a surface: channels and planes must be at least 1 (got %d, %d)",
                         shape->channels, shape->planes);
    if (!hada_rect_inside(&shape->window, shape->rows, shape->cols))
        return hada_fail(err, HADA_ERROR_SIZE, "a surface: the window of %d x %d pixels leaves the grid of %d x %d",
                         shape->window.rows, shape->window.cols, shape->rows, shape->cols);
    if (hada_volume_is_padded(shape) && !hada_rect_inside(&shape->frame, shape->rows, shape->cols))
        return hada_fail(err, HADA_ERROR_SIZE, "a surface: the frame of %d x %d pixels leaves the grid of %d x %d",
                         shape->frame.rows, shape->frame.cols, shape->rows, shape->cols);
    return HADA_OK;
}

static hada_status prepare(hada_volume *v, hada_error *err)
{
    const hada_volume_shape *s = &v->shape;
    const int vectors = v->layout.block % 8 == 0;
    v->program = HADA_PROGRAM_VARIANT(SURFACE_VOLUME, v->slot->context, vectors);
    v->refine = HADA_PROGRAM_VARIANT(REFINE, v->slot->context, vectors);
    v->group = (size_t)hada_macros_of_surface_volume(v->program)->refine_group;
    HADA_TRY(hada_prepare_surface_volume(v->slot, v->program, err));
    HADA_TRY(hada_prepare_refine(v->slot, v->refine, err));
    HADA_TRY(hada_variation_prepare(&v->variation, v->slot, s->channels, s->window.rows, s->window.cols, err));
    if (!s->free)
        HADA_TRY(hada_shrinkage_prepare(&v->shrinkage, v->slot, s->channels, s->window.rows, s->window.cols, err));
    return HADA_OK;
}

hada_status hada_volume_create(hada_volume **out, hada_slot *slot, const hada_volume_shape *shape, hada_error *err)
{
    static const char what[] = "a surface";
    hada_volume *v = NULL;
    hada_fft_desc plans[PLANS];
    hada_buffer_row rows[ROWS];
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(check_shape(shape, err));
    HADA_TRY_OR_DONE(HADA_NEW(v, 1, what, err));
    v->slot = slot;
    v->shape = *shape;
    v->layout = hada_fft_layout(slot->context, shape->rows, shape->cols, HADA_FFT_AUTO);
    v->batch = batch_of(slot->context, shape);
    v->piece = piece_of(slot->context, shape);
    v->window_area = hada_rect_area(&shape->window);
    v->frame_area = hada_rect_area(&shape->frame);
    {
        hada_fft **const made[PLANS] = {&v->forward, &v->inverse, &v->frame_forward, &v->frame_inverse};
        const int count = list_plans(slot->context, shape, plans);
        for (int i = 0; i < count; i++)
            HADA_TRY_OR_DONE(hada_fft_create(made[i], slot, &plans[i], err));
    }
    list_buffers(slot->context, shape, rows);
    HADA_TRY_OR_DONE(hada_buffer_rows_take(v, slot, rows, ROWS, err));
    for (int i = 0; i < ROWS; i++) /* what lies behind the last value is read and multiplied by 0 */
        if (rows[i].bytes)
            HADA_TRY_OR_DONE(hada_buffer_clear(hada_buffer_of(v, &rows[i]), slot, 0, rows[i].bytes, err));
    HADA_TRY_OR_DONE(HADA_NEW(v->host_partial, sums_of(slot->context, shape, &v->layout), what, err));
    HADA_TRY_OR_DONE(prepare(v, err));
    *out = v;
done:
    if (status)
        hada_volume_destroy(&v);
    return status;
}

void hada_volume_destroy(hada_volume **pointer)
{
    hada_volume *v = hada_taken(pointer);
    hada_buffer_row rows[ROWS];
    if (!v)
        return;
    hada_slot_finish(v->slot, NULL);
    hada_fft_destroy(&v->forward);
    hada_fft_destroy(&v->inverse);
    hada_fft_destroy(&v->frame_forward);
    hada_fft_destroy(&v->frame_inverse);
    list_buffers(v->slot->context, &v->shape, rows);
    hada_buffer_rows_destroy(v, rows, ROWS);
    HADA_FREE(v->host_partial, v);
}

cl_mem hada_volume_planes(const hada_volume *volume)
{
    return volume->planes.mem;
}

size_t hada_volume_values(const hada_volume *v)
{
    return (size_t)v->shape.planes * (size_t)v->shape.channels * v->window_area;
}

void hada_volume_set_frame(hada_volume *v, cl_mem spectrum, size_t spectrum_offset, cl_mem pixels, size_t pixels_offset,
                           cl_mem weights)
{
    v->weights = v->mask.mem ? weights : NULL;
    v->frame_spectrum = spectrum;
    v->spectrum_offset = spectrum_offset;
    v->frame_pixels = pixels;
    v->pixels_offset = pixels_offset;
}

/* Whether one of `count` energies, after that of the frame, says that the run has gone astray: *energy is the first
 * such one, else the last; *least: of the run so far. */
static int is_astray(const double *energies, int count, double *least, double *energy)
{
    const double whole = energies[0];
    int astray = 0;
    *least = fmin(*least, whole);
    for (int i = 1; i <= count && !astray; i++) {
        *energy = energies[i];
        astray = !(*energy <= whole) || *energy > ASTRAY * *least + ASTRAY_PART * whole;
        *least = fmin(*least, *energy);
    }
    return astray;
}

/* From `start` on with steps of length 1 / bound. astray: they were too long, and the values are worth nothing. */
static hada_status descend(hada_volume *v, const hada_volume_unknown *u, const hada_volume_rule *rule, double bound,
                           double *energy, int *astray, hada_error *err)
{
    const int most = hada_volume_looks(v->slot->context);
    double t = 1, least = INFINITY, energies[1 + HADA_VOLUME_LOOKS];
    int looks = 0;
    *astray = 0;
    HADA_TRY(hada_buffer_copy(v->slot, v->start.mem, 0, v->at.mem, 0, u->count * sizeof(float), err));
    HADA_TRY(hada_buffer_copy(v->slot, v->start.mem, 0, u->values, 0, u->count * sizeof(float), err));
    for (int k = 0; k < rule->steps && !*astray; k++) {
        const double next = (1 + sqrt(1 + 4 * t * t)) / 2;
        const int last = k == rule->steps - 1;
        HADA_TRY(hada_volume_differentiate(v, u, 1 + looks, err));
        looks += last || k % CHECK_EVERY == CHECK_EVERY - 1;
        if (last || looks == most) {
            HADA_TRY(hada_volume_fetch_energies(v, 1 + looks, energies, err));
            *astray = is_astray(energies, looks, &least, energy);
            looks = 0;
        }
        HADA_TRY(hada_volume_step(v, u, rule, bound, (t - 1) / next, k, err));
        t = next;
    }
    return HADA_OK;
}

static hada_status run(hada_volume *v, const hada_volume_unknown *u, const hada_volume_rule *rule, double *energy,
                       hada_error *err)
{
    double left = 0, bound = rule->bound;
    int astray = 1;
    if (rule->steps < 1 || !(rule->floor > 0) || !(rule->bound > 0))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a surface: steps from 1 on, a floor and a bound above 0 are possible (got %d, %g, %g)",
                         rule->steps, rule->floor, rule->bound);
    HADA_TRY(hada_volume_weigh(v, rule->floor, err));
    HADA_TRY(hada_buffer_copy(v->slot, u->values, 0, v->start.mem, 0, u->count * sizeof(float), err));
    HADA_TRY(hada_volume_frame_energy(v, err));
    /* no curvature is above the number of planes, so this ends */
    for (; astray && bound < 4.0 * v->shape.planes + 4.0 * rule->bound; bound *= 2)
        HADA_TRY(descend(v, u, rule, bound, &left, &astray, err));
    if (energy)
        *energy = left;
    return HADA_OK;
}

static int is_range(const hada_volume *v, int first, int last)
{
    return first >= 0 && first <= last && last < v->shape.planes;
}

static hada_status no_range(const hada_volume *v, int first, int last, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_ARGUMENT, "a surface: planes %d to %d of %d", first, last, v->shape.planes);
}

hada_status hada_volume_solve(hada_volume *v, const hada_volume_rule *rule, const hada_volume_band *band,
                              double *energy, hada_error *err)
{
    const hada_volume_unknown u = {.first = band ? band->first : 0,
                                   .last = band ? band->last : v->shape.planes - 1,
                                   .values = v->planes.mem,
                                   .allowed = band ? band->allowed : NULL,
                                   .count = hada_volume_values(v)};
    if (!v->shape.free)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a surface: this volume was made for textures");
    if (!is_range(v, u.first, u.last))
        return no_range(v, u.first, u.last, err);
    /* no step writes the gradient of dark planes */
    if (u.first > 0 || u.last < v->shape.planes - 1)
        HADA_TRY(hada_buffer_clear(&v->gradient, v->slot, 0, v->gradient.bytes, err));
    return run(v, &u, rule, energy, err);
}

hada_status hada_volume_texture(hada_volume *v, const hada_volume_rule *rule, cl_mem depth, int first, int last,
                                cl_mem texture, double *energy, hada_error *err)
{
    const hada_volume_unknown u = {.texture = 1,
                                   .first = first,
                                   .last = last,
                                   .depth = depth,
                                   .values = texture,
                                   .count = (size_t)v->shape.channels * v->window_area};
    if (!is_range(v, first, last))
        return no_range(v, first, last, err);
    return run(v, &u, rule, energy, err);
}
