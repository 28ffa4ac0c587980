#include "surface/magnification.h"

#include <math.h>
#include <stdlib.h>

#include "core/base.h"
#include "launch/refine.h"
#include "launch/surface_magnify.h"
#include "surface/spline.h"

static const char what[] = "the optics between depths";

/* The depths whose PSFs make one in between: those next to it. */
enum { SOURCES = 2 };

struct hada_between {
    hada_slot *slot;
    hada_surface_camera camera;
    const hada_magnification *magnification;
    hada_spectrum_layout layout;
    hada_fft_pair fft;
    hada_program_surface_magnify program;
    int loaded[SOURCES]; /* depth in each place of coefficients; -1: none */
    hada_buffer prefilter, coefficients, lines, image, spectrum, bases, weights;
    int *host_bases;
    float *host_weights;
};

/* Bytes of every buffer. */
typedef struct sizes {
    size_t prefilter, image, coefficients, lines, spectrum, bases, weights;
} sizes;

static sizes sizes_of(const hada_context *context, const hada_surface_camera *camera)
{
    const size_t count = hada_surface_layout(context, camera->rows, camera->cols).count;
    const size_t sources = SOURCES, channels = (size_t)camera->channels;
    const size_t image = channels * (size_t)camera->rows * (size_t)camera->cols * sizeof(float);
    const size_t bases = sources * (size_t)(camera->rows + camera->cols) * sizeof(cl_int);
    return (sizes){
        count * 2 * sizeof(float), image, sources * image, sources * image, channels * count * 2 * sizeof(float), bases,
        HADA_SPLINE_TAPS * bases};
}

static hada_status make_buffers(hada_between *b, hada_error *err)
{
    hada_context *context = b->slot->context;
    const sizes bytes = sizes_of(context, &b->camera);
    HADA_TRY(hada_surface_prefilter(&b->prefilter, b->slot, &b->layout, err));
    HADA_TRY(hada_buffer_create(&b->coefficients, context, bytes.coefficients, what, err));
    HADA_TRY(hada_buffer_create(&b->lines, context, bytes.lines, what, err));
    HADA_TRY(hada_buffer_create(&b->image, context, bytes.image, what, err));
    HADA_TRY(hada_buffer_create(&b->spectrum, context, bytes.spectrum, what, err));
    HADA_TRY(hada_buffer_create(&b->bases, context, bytes.bases, what, err));
    HADA_TRY(hada_buffer_create(&b->weights, context, bytes.weights, what, err));
    HADA_TRY(hada_allocated(b->host_bases = hada_alloc(bytes.bases, 1, what, err)));
    return hada_allocated(b->host_weights = hada_alloc(bytes.weights, 1, what, err));
}

static hada_status check(const hada_surface_camera *camera, const hada_magnification *m, hada_error *err)
{
    /* what vectors and the taps of a spline reach */
    if (camera->rows < 8 || camera->cols < 8)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "optics between depths need a grid of 8 x 8 pixels at least (got %d x %d)", camera->rows,
                         camera->cols);
    if (camera->depths != m->depths)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the law of magnification is of %d depths, the camera has %d",
                         m->depths, camera->depths);
    return HADA_OK;
}

hada_status hada_between_create(hada_between **out, hada_slot *slot, const hada_surface_camera *camera,
                                const hada_magnification *magnification, hada_error *err)
{
    const hada_fft_desc desc = hada_fft_whole(HADA_FFT_FORWARD, camera->rows, camera->cols, camera->channels);
    hada_between *b = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(check(camera, magnification, err));
    HADA_TRY_OR_DONE(HADA_NEW(b, 1, what, err));
    *b = (hada_between){.slot = slot, .camera = *camera, .magnification = magnification};
    b->layout = hada_surface_layout(slot->context, camera->rows, camera->cols);
    for (int i = 0; i < SOURCES; i++)
        b->loaded[i] = -1;
    b->program = slot->context->shape == HADA_SHAPE_GROUPS ? HADA_PROGRAM_SURFACE_MAGNIFY_GROUPS
                                                           : HADA_PROGRAM_SURFACE_MAGNIFY_DEFAULT;
    HADA_TRY_OR_DONE(make_buffers(b, err));
    HADA_TRY_OR_DONE(hada_fft_pair_create(&b->fft, slot, desc, err));
    HADA_TRY_OR_DONE(hada_prepare_surface_magnify(slot, b->program, err));
    HADA_TRY_OR_DONE(hada_prepare_refine(slot, HADA_PROGRAM_REFINE_DEFAULT, err));
    *out = b;
done:
    if (status)
        hada_between_destroy(&b);
    return status;
}

void hada_between_destroy(hada_between **pointer)
{
    hada_between *b = hada_taken(pointer);
    if (!b)
        return;
    hada_slot_finish(b->slot, NULL);
    hada_fft_pair_destroy(&b->fft);
    HADA_DESTROY_BUFFERS(&b->prefilter, &b->coefficients, &b->lines, &b->image, &b->spectrum, &b->bases, &b->weights);
    HADA_FREE(b->host_bases, b->host_weights, b);
}

/* Brings a depth's coefficients to their place, unless they are there. */
static hada_status load(hada_between *b, int depth, hada_error *err)
{
    const int slot = depth % SOURCES, channels = b->camera.channels;
    const size_t area = (size_t)b->camera.rows * (size_t)b->camera.cols;
    /* the transfer functions are the filters, and the spline's prefilter is what they are multiplied with */
    const hada_fft_filter use = {.product = HADA_FFT_COMPLEX,
                                 .filter = b->camera.otf,
                                 .spectrum_count = 1,
                                 .filter_first = (int)b->camera.first + depth * channels};
    if (b->loaded[slot] == depth)
        return HADA_OK;
    b->loaded[slot] = -1;
    HADA_TRY(hada_fft_inverse(b->fft.inverse, channels, b->prefilter.mem, 0, b->coefficients.mem,
                              (size_t)(slot * channels) * area, &use, err));
    b->loaded[slot] = depth;
    return HADA_OK;
}

static hada_status add_source(hada_between *b, hada_surface_sources *sources, int depth, double weight,
                              const hada_magnified *to, hada_error *err)
{
    const int rows = b->camera.rows, cols = b->camera.cols;
    const hada_magnified by = hada_magnified_between(&b->magnification->depth[depth], to);
    const size_t table = (size_t)sources->count * (size_t)(rows + cols);
    int *bases = b->host_bases + table;
    float *weights = b->host_weights + HADA_SPLINE_TAPS * table;
    HADA_TRY(load(b, depth, err));
    hada_spline_axis(rows, by.scale, by.row, 1.0 / by.scale, bases, weights);
    hada_spline_axis(cols, by.scale, by.col, weight / by.scale, bases + rows, weights + HADA_SPLINE_TAPS * rows);
    sources->slot[sources->count++] = depth % SOURCES;
    return HADA_OK;
}

/* The images at a depth that is none of the camera's. */
static hada_status magnify(hada_between *b, double depth, hada_error *err)
{
    const int rows = b->camera.rows, cols = b->camera.cols, channels = b->camera.channels;
    const size_t group = (size_t)hada_macros_of_surface_magnify(b->program)->surface_group;
    const hada_range range = hada_range_groups(1, group, (size_t)rows, (size_t)channels);
    const hada_magnified to = hada_magnification_at(b->magnification, depth);
    hada_surface_sources sources = {.channels = channels, .rows = rows, .cols = cols};
    const int last = b->camera.depths - 1, low = depth < 0.0 ? 0 : depth > last ? last : (int)depth;
    const double part = depth < 0.0 || depth > last ? 0.0 : depth - low;
    HADA_TRY(add_source(b, &sources, low, 1.0 - part, &to, err));
    if (part > 0.0)
        HADA_TRY(add_source(b, &sources, low + 1, part, &to, err));
    const size_t entries = (size_t)sources.count * (size_t)(rows + cols);
    HADA_TRY(hada_buffer_write(&b->bases, b->slot, 0, b->host_bases, entries * sizeof(cl_int), err));
    HADA_TRY(
        hada_buffer_write(&b->weights, b->slot, 0, b->host_weights, HADA_SPLINE_TAPS * entries * sizeof(float), err));
    hada_slot_cost(b->slot, 4.0 * rows * cols * channels * (3.0 * sources.count + 1.0),
                   4.0 * HADA_SPLINE_TAPS * rows * cols * channels * sources.count);
    return hada_launch_surface_magnify(b->slot, b->program, &range, err, .coefficients = b->coefficients.mem,
                                       .bases = b->bases.ints, .weights = b->weights.mem, .lines = b->lines.mem,
                                       .out = b->image.mem, .sources = sources);
}

/* The transfer functions of one depth; `at` in complex numbers. */
static hada_status make(hada_between *b, double depth, cl_mem out, size_t at, const hada_spectrum_layout *to,
                        hada_error *err)
{
    const int channels = b->camera.channels;
    const size_t step = (size_t)channels * b->layout.count;
    const int known = depth == floor(depth) && depth >= 0.0 && depth < b->camera.depths;
    const size_t from = known ? b->camera.first * b->layout.count + (size_t)depth * step : 0;
    const cl_mem whole = known ? b->camera.otf : to ? b->spectrum.mem : out;
    if (!known) {
        HADA_TRY(magnify(b, depth, err));
        HADA_TRY(hada_fft_forward(b->fft.forward, channels, b->image.mem, 0, whole, to ? 0 : at, err));
    }
    if (to)
        HADA_TRY(hada_surface_crop(b->slot, whole, from, &b->layout, channels, 1, 1.0, 0.0, out, at, to, err));
    else if (known)
        HADA_TRY(hada_buffer_copy(b->slot, whole, from * 2 * sizeof(float), out, at * 2 * sizeof(float),
                                  step * 2 * sizeof(float), err));
    return HADA_OK;
}

hada_status hada_between_make(hada_between *between, int count, const double *depth, cl_mem out, size_t first,
                              const hada_spectrum_layout *to, hada_error *err)
{
    const size_t values = to ? to->count : between->layout.count;
    const double least = -hada_magnification_beyond(between->magnification, 0);
    const double most = between->camera.depths - 1 + hada_magnification_beyond(between->magnification, 1);
    for (int i = 0; i < count; i++)
        if (!(depth[i] >= least && depth[i] <= most))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "a depth of %g is none of what is known of the camera's %d: %g to %g", depth[i],
                             between->camera.depths, least, most);
    for (int i = 0; i < count && !between->slot->context->dry; i++)
        HADA_TRY(make(between, depth[i], out, (first + (size_t)(i * between->camera.channels)) * values, to, err));
    return HADA_OK;
}
