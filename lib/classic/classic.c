#include "classic/classic.h"

#include <math.h>
#include <stdlib.h>

#include "classic/classic_steps.h"
#include "core/alloc.h"
#include "core/options.h"

enum { MOST_SUMS = 4, BAND = 4096 /* pixels of a band of rows, about */ };

void hada_classic_options_defaults(hada_classic_options *options, size_t size)
{
    const hada_classic_options own = {.size = sizeof own,
                                      .iterations = 100,
                                      .weight = HADA_AUTO,
                                      .lambda = 0.1,
                                      .accelerate = 1,
                                      .step = 1.0,
                                      .inner = 5,
                                      .levels = 3,
                                      .mu1 = 1.0,
                                      .mu2 = 3e-3,
                                      .mu3 = 3e-4};
    HADA_OPTIONS_GIVE(options, size, &own);
}

static hada_status check_options(const hada_classic_options *o, hada_error *err)
{
    if (o->method < HADA_METHOD_WIENER || o->method > HADA_METHOD_ADMM || o->prior < HADA_PRIOR_AUTO ||
        o->prior > HADA_PRIOR_HAAR || o->support < HADA_SUPPORT_AUTO || o->support > HADA_SUPPORT_GRID)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "method, prior or support is none that there is");
    if (o->iterations < 1 || !(o->stop >= 0.0 && o->stop < 1.0) || !(o->seconds >= 0.0) || !isfinite(o->seconds))
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "the stopping rules make no sense: there is one iteration at least, seconds are not negative, the relative "
            "change is from 0 to below 1");
    if (!isfinite(o->weight) || !(o->lambda > 0.0 && isfinite(o->lambda)) || !(o->step > 0.0 && o->step < 2.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the weight must be finite, lambda above 0 and the step between 0 and 2");
    if (o->inner < 1 || o->inner > 1000 || o->levels < 1 || o->levels > 8)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "inner iterations are from 1 to 1000, levels of wavelets 1 to 8");
    if (!(o->mu1 > 0.0 && isfinite(o->mu1)) || !(o->mu2 > 0.0 && isfinite(o->mu2)) ||
        !(o->mu3 > 0.0 && isfinite(o->mu3)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "mu1, mu2 and mu3 of ADMM must be above 0");
    const int wavelets = o->prior == HADA_PRIOR_WAVELET || o->prior == HADA_PRIOR_HAAR;
    if ((wavelets && o->method != HADA_METHOD_FISTA) || (o->prior == HADA_PRIOR_TV && o->method == HADA_METHOD_WIENER))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "this method has no such prior: Richardson-Lucy and ADMM take total variation, FISTA also "
                         "wavelets, a Wiener filter none");
    return HADA_OK;
}

/* The weights that were best or near it on simulated frames with 1 % noise: docs/rivals.md. */
static double own_weight(const hada_classic_options *o)
{
    if (o->prior == HADA_PRIOR_NONE)
        return 0.0;
    return o->method == HADA_METHOD_RL || o->prior == HADA_PRIOR_WAVELET ? 5e-3 : 3e-3;
}

hada_status hada_classic_shape_of(const hada_model_info *info, int depths, const hada_classic_options *options,
                                  hada_classic_shape *shape, hada_error *err)
{
    hada_status status = check_options(options, err);
    if (!status && !info->has_otf)
        status = hada_fail(err, HADA_ERROR_MODEL,
                           "the model %s holds no transfer functions, which this method needs: make the model again "
                           "with fit, from pairs or from --psf",
                           info->name);
    if (status)
        return status;
    hada_classic_options *o = &shape->options;
    *o = *options;
    shape->place = hada_refine_shape_of(info, depths, 1);
    o->iterations = o->method == HADA_METHOD_WIENER ? 1 : o->iterations;
    if (o->prior == HADA_PRIOR_AUTO)
        o->prior = o->method == HADA_METHOD_ADMM ? HADA_PRIOR_TV : HADA_PRIOR_NONE;
    if (o->weight < 0.0)
        o->weight = own_weight(o);
    if (o->weight <= 0.0)
        o->prior = HADA_PRIOR_NONE;
    if (o->support == HADA_SUPPORT_AUTO)
        o->support = o->method == HADA_METHOD_ADMM ? HADA_SUPPORT_GRID : HADA_SUPPORT_WINDOW;
    shape->support = o->support == HADA_SUPPORT_GRID ? (hada_refine_rect){0, 0, info->grid_rows, info->grid_cols}
                                                     : shape->place.window;
    shape->grid_rows = info->grid_rows;
    shape->grid_cols = info->grid_cols;
    shape->reach = (hada_refine_rect){0};
    return HADA_OK;
}

static hada_refine_rect at_top_left(const hada_refine_rect *rect)
{
    return (hada_refine_rect){0, 0, rect->rows, rect->cols};
}

/* ADMM has its gradients on the whole grid. */
hada_refine_rect hada_classic_plane_rect(const hada_classic_shape *shape)
{
    const hada_refine_rect grid = {0, 0, shape->grid_rows, shape->grid_cols};
    if (shape->reach.rows)
        return at_top_left(&shape->support);
    return shape->options.method == HADA_METHOD_ADMM ? grid : shape->support;
}

hada_refine_rect hada_classic_frame_rect(const hada_classic_shape *shape)
{
    const hada_refine_rect grid = {0, 0, shape->grid_rows, shape->grid_cols};
    if (shape->reach.rows)
        return at_top_left(&shape->place.frame);
    return shape->place.boundary == HADA_BOUNDARY_PADDED ? shape->place.frame : grid;
}

static hada_classic_image image_of(const hada_refine_rect *rect)
{
    hada_classic_image image = {.rows = rect->rows, .cols = rect->cols, .pitch = (rect->cols + 7) / 8 * 8};
    image.pixels = (size_t)image.rows * (size_t)image.pitch;
    image.band = image.pitch < BAND ? BAND / image.pitch : 1;
    return image;
}

static hada_fft_desc describe(const hada_classic_shape *shape, const hada_refine_rect *rect, int images,
                              hada_fft_direction direction)
{
    const hada_classic_image image = image_of(rect);
    return (hada_fft_desc){.direction = direction,
                           .rows = shape->grid_rows,
                           .cols = shape->grid_cols,
                           .batch = images < HADA_CLASSIC_BATCH ? images : HADA_CLASSIC_BATCH,
                           .row0 = rect->row0,
                           .col0 = rect->col0,
                           .real_rows = rect->rows,
                           .real_cols = rect->cols,
                           .real_pitch = (size_t)image.pitch,
                           .real_distance = image.pixels};
}

/* Whether the method looks at the frame's pixels in each iteration. */
static int has_frame(const hada_classic_shape *shape)
{
    return shape->place.boundary == HADA_BOUNDARY_PADDED || shape->options.method == HADA_METHOD_RL;
}

/* Whether its transforms are taken together with what lies between them (classic_fused.c). */
static int fuses(const hada_context *context, const hada_classic_shape *shape)
{
    const hada_method method = shape->options.method;
    return has_frame(shape) && (method == HADA_METHOD_RL || method == HADA_METHOD_FISTA) &&
           hada_fft_fuses(context, shape->grid_rows, shape->grid_cols, shape->place.max_planes > 1 ? 2 : 1);
}

enum { PLANS = 4 };

/* Transforms of their own; none where the passes are fused. */
static int list_plans(const hada_context *context, const hada_classic_shape *shape, hada_fft_desc *plans)
{
    const hada_refine_rect plane = hada_classic_plane_rect(shape), frame = hada_classic_frame_rect(shape);
    const int images = shape->place.max_planes * shape->place.channels;
    if (fuses(context, shape))
        return 0;
    plans[0] = describe(shape, &plane, images, HADA_FFT_FORWARD);
    plans[1] = describe(shape, &plane, images, HADA_FFT_INVERSE);
    plans[2] = describe(shape, &frame, shape->place.channels, HADA_FFT_FORWARD);
    plans[3] = describe(shape, &frame, shape->place.channels, HADA_FFT_INVERSE);
    return has_frame(shape) ? PLANS : 2;
}

static size_t larger(size_t a, size_t b)
{
    return a > b ? a : b;
}

static size_t groups(size_t count, size_t each)
{
    return (count + each - 1) / each;
}

/* Sums that a launch leaves, at most. */
static size_t partials(const hada_classic_shape *shape, const hada_spectrum_layout *layout,
                       const hada_classic_image *plane, const hada_classic_image *frame)
{
    const size_t channels = (size_t)shape->place.channels, images = channels * (size_t)shape->place.max_planes;
    size_t most = channels * groups(layout->count, HADA_CLASSIC_SLICE);
    most = larger(most, channels * groups(frame->pixels, HADA_CLASSIC_SLICE));
    most = larger(most, images * MOST_SUMS * groups(plane->pixels, HADA_CLASSIC_SLICE));
    most = larger(most, images * MOST_SUMS * groups((size_t)plane->rows, HADA_CLASSIC_ROWS));
    return larger(most, images * MOST_SUMS * groups((size_t)plane->rows, (size_t)plane->band));
}

/* Bytes of every buffer; 0: the method has none. */
static void keep_books(const hada_context *context, const hada_classic_shape *shape, size_t *bytes)
{
    const hada_refine_rect plane_at = hada_classic_plane_rect(shape), frame_at = hada_classic_frame_rect(shape);
    const hada_classic_image plane = image_of(&plane_at), frame = image_of(&frame_at);
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    const hada_classic_options *o = &shape->options;
    const hada_refine_rect *window = &shape->place.window;
    const int rl = o->method == HADA_METHOD_RL, fista = o->method == HADA_METHOD_FISTA,
              admm = o->method == HADA_METHOD_ADMM, tv = o->prior == HADA_PRIOR_TV,
              wavelet = o->prior == HADA_PRIOR_WAVELET || o->prior == HADA_PRIOR_HAAR, met = has_frame(shape);
    const size_t channels = (size_t)shape->place.channels, images = channels * (size_t)shape->place.max_planes;
    const size_t planes = images * plane.pixels * sizeof(float), frames = channels * frame.pixels * sizeof(float);
    const size_t spectrum = layout.count * 2 * sizeof(float);
    /* fused passes keep half spectra of the images' rows alone */
    const size_t row = (size_t)layout.blocks * (size_t)layout.block * 2 * sizeof(float);
    const size_t plane_spectrum = fuses(context, shape) ? (size_t)plane.rows * row : spectrum;
    const size_t frame_spectrum = fuses(context, shape) ? (size_t)frame.rows * row : spectrum;
    const size_t list[HADA_CLASSIC_PARTS] = {
        [HADA_CLASSIC_WINDOW] = images * (size_t)window->rows * (size_t)window->cols * sizeof(float),
        [HADA_CLASSIC_LIST] = (size_t)shape->place.max_planes * sizeof(cl_int),
        [HADA_CLASSIC_PARTIAL] = partials(shape, &layout, &plane, &frame) * sizeof(float),
        [HADA_CLASSIC_SPECTRA] = images * plane_spectrum,
        [HADA_CLASSIC_SUM] = channels * frame_spectrum,
        [HADA_CLASSIC_X] = planes,
        [HADA_CLASSIC_SEEN] = met ? frames : 0,
        [HADA_CLASSIC_MADE] = met ? frames : 0,
        [HADA_CLASSIC_BEFORE] = rl || admm ? planes : 0,
        [HADA_CLASSIC_START] = rl || fista ? planes : 0,
        [HADA_CLASSIC_GRADIENT] = fista ? planes : 0,
        [HADA_CLASSIC_NORM] = rl ? planes : 0,
        [HADA_CLASSIC_TURN] = rl ? planes : 0,
        [HADA_CLASSIC_SMOOTH] = fista && tv ? planes : 0,
        [HADA_CLASSIC_DUAL] = (fista || admm) && tv ? 2 * planes : 0,
        [HADA_CLASSIC_DUAL2] = (fista || admm) && tv ? 2 * planes : 0,
        [HADA_CLASSIC_PYRAMID] = wavelet ? (size_t)o->levels * planes : 0,
        [HADA_CLASSIC_SHADOW] = admm ? planes : 0,
        [HADA_CLASSIC_STATE] = admm && met ? frames : 0,
        [HADA_CLASSIC_SPLIT] = admm && met ? channels * spectrum : 0,
        [HADA_CLASSIC_TABLE] =
            (fista ? channels : (size_t)layout.rows + (size_t)layout.blocks * (size_t)layout.block) * sizeof(float)};
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        bytes[i] = list[i];
    if (rl)
        bytes[HADA_CLASSIC_TABLE] = 0;
}

size_t hada_classic_bytes(const hada_context *context, const hada_classic_shape *shape)
{
    size_t bytes[HADA_CLASSIC_PARTS], sum = 0;
    hada_fft_desc plans[PLANS];
    const int count = list_plans(context, shape, plans);
    keep_books(context, shape, bytes);
    if (fuses(context, shape))
        sum += hada_fft_fused_bytes(context, shape->grid_rows, shape->grid_cols);
    for (int i = 0; i < count; i++)
        sum += hada_fft_bytes(context, &plans[i]);
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        sum += bytes[i];
    return sum;
}

static const char what[] = "the images of a classic method";

hada_status hada_classic_note(const hada_context *context, const hada_classic_shape *shape, hada_room *room, int first,
                              int last, int planes_last, hada_error *err)
{
    size_t bytes[HADA_CLASSIC_PARTS];
    hada_fft_desc plans[PLANS];
    hada_status status = HADA_OK;
    const int count = list_plans(context, shape, plans);
    keep_books(context, shape, bytes);
    hada_room_steps(room, first, last);
    for (int i = 0; !status && i < count; i++)
        status = hada_fft_note(context, &plans[i], room, err);
    for (int i = 0; !status && i < HADA_CLASSIC_PARTS; i++) {
        hada_room_steps(room, first, i == HADA_CLASSIC_WINDOW ? planes_last : last);
        if (bytes[i])
            status = hada_room_note(room, bytes[i], what, err);
    }
    return status;
}

static hada_status make(hada_classic *classic, hada_error *err)
{
    hada_slot *slot = classic->slot;
    hada_fft **const made[PLANS] = {&classic->forward, &classic->inverse, &classic->frame_forward,
                                    &classic->frame_inverse};
    hada_fft_desc plans[PLANS];
    const int count = list_plans(slot->context, &classic->shape, plans);
    hada_status status = hada_alloc((void **)&classic->sums, classic->bytes[HADA_CLASSIC_PARTIAL] / sizeof(float),
                                    sizeof(float), what, err);
    if (!status)
        status = hada_alloc((void **)&classic->table, classic->bytes[HADA_CLASSIC_TABLE] + 1, 1, what, err);
    if (!status && classic->fuses)
        status = hada_fft_fused_make(&classic->fused, slot, classic->shape.grid_rows, classic->shape.grid_cols, err);
    for (int i = 0; !status && i < count; i++)
        status = hada_fft_create(made[i], slot, &plans[i], err);
    for (int i = 0; !status && i < HADA_CLASSIC_PARTS; i++)
        if (classic->bytes[i])
            status = hada_scratch_create(&classic->part[i], slot, classic->bytes[i], what, err);
    return status;
}

hada_status hada_classic_create(hada_classic **out, hada_slot *slot, const hada_classic_shape *shape, hada_error *err)
{
    hada_classic *classic;
    const hada_refine_rect plane = hada_classic_plane_rect(shape), frame = hada_classic_frame_rect(shape);
    const int in_groups = slot->context->shape == HADA_SHAPE_GROUPS;
    *out = NULL;
    hada_status status = hada_alloc((void **)&classic, 1, sizeof *classic, what, err);
    if (status)
        return status;
    classic->slot = slot;
    classic->shape = *shape;
    classic->layout = hada_fft_layout(slot->context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    classic->plane = image_of(&plane);
    classic->frame = image_of(&frame);
    classic->group = in_groups ? HADA_CLASSIC_GROUP : 1;
    classic->image_options = in_groups ? "-DREFINE_WIDTH=1 -DREFINE_GROUP=64" : "";
    /* vectors need whole ones of eight frequencies in a row of the layout */
    classic->spectrum_options = !in_groups && classic->layout.block % 8 ? "-DREFINE_WIDTH=1" : classic->image_options;
    classic->met = has_frame(shape);
    classic->fuses = fuses(slot->context, shape);
    keep_books(slot->context, shape, classic->bytes);
    status = make(classic, err);
    if (!status && classic->fuses)
        status = hada_classic_check(classic, err);
    if (status)
        hada_classic_destroy(&classic);
    *out = classic;
    return status;
}

void hada_classic_destroy(hada_classic **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_classic *classic = *pointer;
    *pointer = NULL;
    hada_slot_finish(classic->slot, NULL);
    hada_fft_destroy(&classic->forward);
    hada_fft_destroy(&classic->inverse);
    hada_fft_destroy(&classic->frame_forward);
    hada_fft_destroy(&classic->frame_inverse);
    hada_fft_fused_free(&classic->fused);
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        hada_buffer_destroy(&classic->part[i]);
    free(classic->sums);
    free(classic->table);
    free(classic);
}

cl_mem hada_classic_planes(const hada_classic *classic)
{
    return classic->part[HADA_CLASSIC_WINDOW].mem;
}
