#include "classic/classic.h"

#include <stdlib.h>

#include "classic/classic_steps.h"

enum { MOST_SUMS = 4, BAND = 4096 /* pixels of a band of rows, about */ };

static hada_classic_image image_of(const hada_rectangle *rect)
{
    hada_classic_image image = {.rows = rect->rows, .cols = rect->cols, .pitch = (int)hada_classic_pitch(rect->cols)};
    image.pixels = (size_t)image.rows * (size_t)image.pitch;
    image.band = image.pitch < BAND ? BAND / image.pitch : 1;
    return image;
}

static hada_status make_transforms(hada_fft_pair *pair, const hada_classic *classic, const hada_rectangle *rect,
                                   int images, hada_error *err)
{
    const hada_classic_image image = image_of(rect);
    const int batch = hada_least(images, HADA_CLASSIC_BATCH);
    hada_fft_desc desc =
        hada_fft_of(HADA_FFT_FORWARD, classic->shape.grid_rows, classic->shape.grid_cols, batch, *rect);
    desc.real_pitch = (size_t)image.pitch;
    desc.real_distance = image.pixels;
    return hada_fft_pair_create(pair, classic->slot, desc, err);
}

/* Whether the method looks at the frame's pixels in each iteration. */
static int has_frame(const hada_classic_shape *shape)
{
    return shape->place.boundary == HADA_BOUNDARY_PADDED || shape->options.method == HADA_METHOD_RL;
}

int hada_classic_weighs(const hada_classic_shape *shape)
{
    return has_frame(shape) && shape->options.method != HADA_METHOD_WIENER;
}

/* Whether its transforms are taken together with what lies between them (classic_fused.c). */
static int fuses(const hada_context *context, const hada_classic_shape *shape)
{
    const hada_method method = shape->options.method;
    return has_frame(shape) && (method == HADA_METHOD_RL || method == HADA_METHOD_FISTA) &&
           hada_fft_fuses(context, shape->grid_rows, shape->grid_cols,
                          shape->place.max_planes * shape->components > 1 ? 2 : 1);
}

static size_t larger(size_t a, size_t b)
{
    return a > b ? a : b;
}

/* Sums that a launch leaves, at most. */
static size_t partials(const hada_classic_shape *shape, const hada_spectrum_layout *layout,
                       const hada_classic_image *plane, const hada_classic_image *frame)
{
    const size_t channels = (size_t)shape->place.channels, images = channels * (size_t)shape->place.max_planes;
    size_t most = channels * hada_divide_up(layout->count, HADA_CLASSIC_SLICE);
    most = larger(most, channels * hada_divide_up(frame->pixels, HADA_CLASSIC_SLICE));
    most = larger(most, images * MOST_SUMS * hada_divide_up(plane->pixels, HADA_CLASSIC_SLICE));
    most = larger(most, images * MOST_SUMS * hada_divide_up((size_t)plane->rows, HADA_CLASSIC_ROWS));
    return larger(most, images * MOST_SUMS * hada_divide_up((size_t)plane->rows, (size_t)plane->band));
}

/* Bytes of every buffer; 0: the method has none. */
static void sizes_of(const hada_context *context, const hada_classic_shape *shape, size_t *bytes)
{
    const hada_rectangle plane_at = hada_classic_plane_rect(shape), frame_at = hada_classic_frame_rect(shape);
    const hada_classic_image plane = image_of(&plane_at), frame = image_of(&frame_at);
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    const hada_classic_options *o = &shape->options;
    const hada_rectangle *window = &shape->place.window;
    const int rl = o->method == HADA_METHOD_RL, fista = o->method == HADA_METHOD_FISTA,
              admm = o->method == HADA_METHOD_ADMM, tv = o->prior == HADA_PRIOR_TV,
              wavelet = o->prior == HADA_PRIOR_WAVELET || o->prior == HADA_PRIOR_HAAR, has = has_frame(shape);
    const size_t channels = (size_t)shape->place.channels, images = channels * (size_t)shape->place.max_planes;
    const size_t components = (size_t)shape->components, planes = images * plane.pixels * sizeof(float),
                 frames = channels * frame.pixels * sizeof(float);
    const size_t spectrum = layout.count * 2 * sizeof(float);
    /* fused passes keep half spectra of the images' rows alone */
    const size_t row = (size_t)layout.blocks * (size_t)layout.block * 2 * sizeof(float);
    const size_t plane_spectrum = fuses(context, shape) ? (size_t)plane.rows * row : spectrum;
    const size_t frame_spectrum = fuses(context, shape) ? (size_t)frame.rows * row : spectrum;
    const size_t list[HADA_CLASSIC_PARTS] = {
        [HADA_CLASSIC_WINDOW] = images * (size_t)window->rows * (size_t)window->cols * sizeof(float),
        [HADA_CLASSIC_LIST] = (size_t)shape->place.max_planes * components * sizeof(cl_int),
        [HADA_CLASSIC_PARTIAL] = partials(shape, &layout, &plane, &frame) * sizeof(float),
        [HADA_CLASSIC_SPECTRA] = images * components * plane_spectrum,
        [HADA_CLASSIC_COMPONENTS] = components > 1 ? components * planes : 0,
        [HADA_CLASSIC_PROJECTION] = channels * frame_spectrum,
        [HADA_CLASSIC_PRIMAL] = planes,
        [HADA_CLASSIC_FRAME] = has ? frames : 0,
        [HADA_CLASSIC_WEIGHTS] = hada_classic_weighs(shape) ? frames : 0,
        [HADA_CLASSIC_PREDICTION] = has ? frames : 0,
        [HADA_CLASSIC_PREVIOUS] = rl || admm ? planes : 0,
        [HADA_CLASSIC_EXTRAPOLATED] = rl || fista ? planes : 0,
        [HADA_CLASSIC_GRADIENT] = fista ? planes : 0,
        [HADA_CLASSIC_NORM] = rl ? planes : 0,
        [HADA_CLASSIC_DIRECTION] = rl ? planes : 0,
        [HADA_CLASSIC_BLURRED] = rl && shape->sieve ? planes : 0,
        [HADA_CLASSIC_PROXIMAL] = fista && tv ? planes : 0,
        [HADA_CLASSIC_TV_DUAL] = (fista || admm) && tv ? 2 * planes : 0,
        [HADA_CLASSIC_TV_DUAL_NEXT] = (fista || admm) && tv ? 2 * planes : 0,
        [HADA_CLASSIC_PYRAMID] = wavelet ? (size_t)o->levels * planes : 0,
        [HADA_CLASSIC_PLANE_DUAL] = admm ? planes : 0,
        [HADA_CLASSIC_DATA_DUAL] = admm && has ? frames : 0,
        [HADA_CLASSIC_DATA_SPLIT] = admm && has ? channels * spectrum : 0,
        [HADA_CLASSIC_TABLE] =
            (fista ? channels : (size_t)layout.rows + (size_t)layout.blocks * (size_t)layout.block) * sizeof(float)};
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        bytes[i] = list[i];
    if (rl)
        bytes[HADA_CLASSIC_TABLE] = shape->sieve ? (HADA_CLASSIC_REACH + 1) * sizeof(float) : 0;
}

static const char what[] = "the images of a classic method";

/* Everything that a method keeps, on the host and on the device. */
static hada_status allocate(hada_classic *classic, hada_error *err)
{
    hada_slot *slot = classic->slot;
    const hada_classic_shape *shape = &classic->shape;
    const hada_rectangle plane = hada_classic_plane_rect(shape), frame = hada_classic_frame_rect(shape);
    const int channels = shape->place.channels, images = shape->place.max_planes * shape->components * channels;
    HADA_TRY(hada_allocated(
        classic->sums = hada_alloc(classic->bytes[HADA_CLASSIC_PARTIAL] / sizeof(float), sizeof(float), what, err)));
    HADA_TRY(hada_allocated(classic->table = hada_alloc(classic->bytes[HADA_CLASSIC_TABLE] + 1, 1, what, err)));
    if (classic->fuses)
        HADA_TRY(hada_fft_fused_make(&classic->fused, slot, shape->grid_rows, shape->grid_cols, err));
    else
        HADA_TRY(make_transforms(&classic->fft, classic, &plane, images, err));
    if (classic->has_frame && !classic->fuses)
        HADA_TRY(make_transforms(&classic->frame_fft, classic, &frame, channels, err));
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        if (classic->bytes[i])
            HADA_TRY(hada_buffer_take(&classic->part[i], slot, i == HADA_CLASSIC_WINDOW ? HADA_RESULT : HADA_OWN_STEPS,
                                      classic->bytes[i], what, err));
    return HADA_OK;
}

hada_status hada_classic_create(hada_classic **out, hada_slot *slot, const hada_classic_shape *shape, hada_error *err)
{
    const hada_rectangle plane = hada_classic_plane_rect(shape), frame = hada_classic_frame_rect(shape);
    hada_classic *classic = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(classic, 1, what, err));
    classic->slot = slot;
    classic->shape = *shape;
    classic->layout = hada_fft_layout(slot->context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    classic->plane = image_of(&plane);
    classic->frame = image_of(&frame);
    /* vectors need whole ones of eight frequencies in a row of the layout */
    classic->spectrum_program = HADA_PROGRAM_VARIANT(CLASSIC_SPECTRUM, slot->context, classic->layout.block % 8 == 0);
    classic->group = (size_t)hada_macros_of_classic_spectrum(classic->spectrum_program)->refine_group;
    classic->has_frame = has_frame(shape);
    classic->fuses = fuses(slot->context, shape);
    sizes_of(slot->context, shape, classic->bytes);
    HADA_TRY_OR_DONE(allocate(classic, err));
    if (classic->fuses)
        HADA_TRY_OR_DONE(hada_classic_check(classic, err));
    *out = classic;
done:
    if (status)
        hada_classic_destroy(&classic);
    return status;
}

void hada_classic_destroy(hada_classic **pointer)
{
    hada_classic *classic = hada_taken(pointer);
    if (!classic)
        return;
    hada_slot_finish(classic->slot, NULL);
    hada_fft_pair_destroy(&classic->fft);
    hada_fft_pair_destroy(&classic->frame_fft);
    hada_fft_fused_free(&classic->fused);
    for (int i = 0; i < HADA_CLASSIC_PARTS; i++)
        hada_buffer_destroy(&classic->part[i]);
    HADA_FREE(classic->sums, classic->table, classic);
}

cl_mem hada_classic_planes(const hada_classic *classic)
{
    return classic->part[HADA_CLASSIC_WINDOW].mem;
}
