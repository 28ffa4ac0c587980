#include "refine/pursuit.h"

#include <math.h>
#include <stdlib.h>
#include <time.h>

#include "core/alloc.h"
#include "program/kernel.h"
#include "refine/pursuit_search.h"

enum {
    MAX_SETS = 16,     /* trials side by side */
    MAX_STEPS = 12,    /* of a trial, at most */
    COARSE_SIDE = 256, /* pixels: grids with a longer side than twice this are shrunk to it */
    MARGIN = 2         /* pixels: the coarse window is wider by this on every side, for the blur of its edge */
};

void hada_pursuit_options_init(hada_pursuit_options *options)
{
    *options = (hada_pursuit_options){.rho = 1e-2};
}

static int coarse_size(int size, double shrink)
{
    return hada_fft_good_size(2 * (int)lround(size / shrink / 2.0));
}

/* The coarse rectangle round (outward) or within a rectangle. */
static void shrink_span(int first, int size, int full, int coarse, int outward, int *to_first, int *to_size)
{
    const double scale = (double)coarse / full;
    int from = outward ? (int)floor(first * scale) - MARGIN : (int)ceil(first * scale);
    int end = outward ? (int)ceil((first + size) * scale) + MARGIN : (int)floor((first + size) * scale);
    from = from < 0 ? 0 : from;
    end = end > coarse ? coarse : end;
    *to_first = from;
    *to_size = end - from;
}

static hada_refine_rect shrink_rect(const hada_refine_rect *rect, const hada_refine_shape *full,
                                    const hada_refine_shape *coarse, int outward)
{
    hada_refine_rect out;
    shrink_span(rect->row0, rect->rows, full->grid_rows, coarse->grid_rows, outward, &out.row0, &out.rows);
    shrink_span(rect->col0, rect->cols, full->grid_cols, coarse->grid_cols, outward, &out.col0, &out.cols);
    return out;
}

static hada_pursuit_options complete(const hada_pursuit_options *options)
{
    hada_pursuit_options o = *options;
    const hada_refine_shape *full = &o.shape;
    const int longer = full->grid_rows > full->grid_cols ? full->grid_rows : full->grid_cols;
    if (o.shrink == 0.0)
        o.shrink = longer > 2 * COARSE_SIDE ? (double)longer / COARSE_SIDE : 2.0;
    if (o.threshold == 0.0) {
        /* a depth that is not there explains about the window's share of white noise: be clearly above that */
        const hada_refine_rect *frame = &full->frame;
        const double pixels = full->boundary == HADA_BOUNDARY_PADDED ? (double)frame->rows * frame->cols
                                                                     : (double)full->grid_rows * full->grid_cols;
        const double chance = 1.6 * full->window.rows * full->window.cols / pixels;
        o.threshold = chance < 0.2 ? 0.2 : chance > 0.5 ? 0.5 : chance;
    }
    if (!o.max_depths)
        o.max_depths = o.depths > 6 ? 4 : o.depths;
    if (o.max_depths > o.depths)
        o.max_depths = o.depths;
    return o;
}

static hada_refine_shape coarse_shape(const hada_pursuit_options *options)
{
    const hada_refine_shape *full = &options->shape;
    hada_refine_shape shape = {.grid_rows = coarse_size(full->grid_rows, options->shrink),
                               .grid_cols = coarse_size(full->grid_cols, options->shrink),
                               .boundary = full->boundary,
                               .channels = 1,
                               .max_sets = MAX_SETS,
                               .max_planes = MAX_SETS * options->max_depths,
                               .max_steps = MAX_STEPS};
    shape.window = shrink_rect(&full->window, full, &shape, 1);
    if (full->boundary == HADA_BOUNDARY_PADDED)
        shape.frame = shrink_rect(&full->frame, full, &shape, 0);
    return shape;
}

static size_t spectrum_bytes(const hada_spectrum_layout *layout)
{
    return layout->count * 2 * sizeof(float);
}

static hada_fft_desc frame_plan(const hada_refine_shape *shape)
{
    return (hada_fft_desc){.direction = HADA_FFT_INVERSE,
                           .rows = shape->grid_rows,
                           .cols = shape->grid_cols,
                           .batch = 1,
                           .row0 = shape->frame.row0,
                           .col0 = shape->frame.col0,
                           .real_rows = shape->frame.rows,
                           .real_cols = shape->frame.cols,
                           .real_pitch = (size_t)shape->frame.cols,
                           .real_distance = (size_t)shape->frame.rows * (size_t)shape->frame.cols};
}

size_t hada_pursuit_bytes(const hada_context *context, const hada_pursuit_options *options)
{
    const hada_pursuit_options o = complete(options);
    const hada_refine_shape shape = coarse_shape(&o);
    const hada_spectrum_layout layout = hada_fft_layout(context, shape.grid_rows, shape.grid_cols, HADA_FFT_AUTO);
    const size_t spectrum = spectrum_bytes(&layout), depths = (size_t)o.depths;
    size_t bytes = depths * spectrum + spectrum / 2 + depths * spectrum / 2 + spectrum +
                   hada_refiner_bytes(context, &shape) + 3 * hada_refine_state_bytes(context, &shape, o.max_depths);
    if (shape.boundary == HADA_BOUNDARY_PADDED) {
        const hada_fft_desc desc = frame_plan(&shape);
        bytes += desc.real_distance * sizeof(float) + hada_fft_bytes(context, &desc);
    }
    return bytes;
}

static hada_status make_buffers(hada_pursuit *p, hada_error *err)
{
    static const char what[] = "the depth pursuit";
    hada_context *context = p->slot->context;
    const size_t spectrum = spectrum_bytes(&p->coarse), depths = (size_t)p->options.depths;
    hada_status status = hada_buffer_create(&p->otf, context, depths * spectrum, what, err);
    if (!status)
        status = hada_buffer_create(&p->prior, context, spectrum / 2, what, err);
    if (!status)
        status = hada_buffer_create(&p->doubt, context, depths * spectrum / 2, what, err);
    if (!status)
        status = hada_buffer_create(&p->spectrum, context, spectrum, what, err);
    hada_refine_state *states[] = {&p->now, &p->next, &p->best};
    for (size_t i = 0; !status && i < HADA_COUNT(states); i++)
        status = hada_refine_state_create(states[i], p->refiner, p->options.max_depths, err);
    if (status || p->shape.boundary != HADA_BOUNDARY_PADDED)
        return status;
    const hada_fft_desc desc = frame_plan(&p->shape);
    status = hada_buffer_create(&p->frame, context, desc.real_distance * sizeof(float), what, err);
    return status ? status : hada_fft_create(&p->frame_inverse, p->slot, &desc, err);
}

hada_status hada_pursuit_create(hada_pursuit **out, hada_slot *slot, const hada_pursuit_options *options,
                                hada_error *err)
{
    hada_pursuit *p;
    *out = NULL;
    const hada_pursuit_options o = complete(options);
    if (o.depths < 1 || o.depths > HADA_PURSUIT_DEPTHS || o.max_depths > HADA_PURSUIT_MAX || o.max_depths < 1 ||
        !(o.shrink >= 1.0) || !(o.rho > 0.0) || o.shape.channels < 1)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "depth pursuit: 1 to %d depths, channels from 1 on, up to %d depths in a set, a shrink factor from 1 on "
            "and rho above 0 are possible (got %d, %d, %d, %g, %g)",
            HADA_PURSUIT_DEPTHS, HADA_PURSUIT_MAX, o.depths, o.shape.channels, o.max_depths, o.shrink, o.rho);
    hada_status status = hada_alloc((void **)&p, 1, sizeof *p, "a depth pursuit", err);
    if (status)
        return status;
    p->slot = slot;
    p->options = o;
    p->shape = coarse_shape(&o);
    p->full = hada_fft_layout(slot->context, o.shape.grid_rows, o.shape.grid_cols, HADA_FFT_AUTO);
    p->coarse = hada_fft_layout(slot->context, p->shape.grid_rows, p->shape.grid_cols, HADA_FFT_AUTO);
    status = hada_refiner_create(&p->refiner, slot, &p->shape, err);
    if (!status)
        status = make_buffers(p, err);
    if (!status)
        status = hada_slot_kernel(slot, "refine_crop", "refine_crop", "", &p->crop, err);
    if (status) {
        hada_pursuit_destroy(&p);
        return status;
    }
    *out = p;
    return HADA_OK;
}

void hada_pursuit_destroy(hada_pursuit **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_pursuit *p = *pointer;
    *pointer = NULL;
    hada_slot_finish(p->slot, NULL);
    hada_refiner_destroy(&p->refiner);
    hada_fft_destroy(&p->frame_inverse);
    hada_buffer *buffers[] = {&p->otf, &p->prior, &p->doubt, &p->spectrum, &p->frame};
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
    hada_refine_state_destroy(&p->now);
    hada_refine_state_destroy(&p->next);
    hada_refine_state_destroy(&p->best);
    free(p);
}

/* How a kind of spectrum goes to the coarse grid, whose unknown is the scene tapered towards its last frequency: a
 * scene cut off there would ring, and ringing is not non-negative. */
typedef struct crop {
    int parts;     /* 2: complex */
    double factor; /* times the mean over the channels */
    double tapers; /* how often the taper is applied */
    int invert;
} crop;

static hada_status crop_images(hada_pursuit *p, const crop *how, cl_mem in, size_t in_offset, int images,
                               const hada_buffer *out, int first_image, hada_error *err)
{
    const hada_spectrum_layout *full = &p->full, *coarse = &p->coarse;
    cl_ulong from = in_offset;
    cl_int in_rows = full->rows, in_block = full->block, rows = coarse->rows, cols = coarse->cols;
    cl_int block = coarse->block, parts = how->parts, channels = p->options.shape.channels, invert = how->invert;
    cl_uint in_count = (cl_uint)full->count, count = (cl_uint)coarse->count;
    cl_uint to = (cl_uint)((size_t)first_image * coarse->count);
    cl_float factor = (cl_float)how->factor, tapers = (cl_float)how->tapers;
    hada_arg args[] = {HADA_ARG(in),       HADA_ARG(from),     HADA_ARG(in_rows), HADA_ARG(in_block),
                       HADA_ARG(in_count), HADA_ARG(out->mem), HADA_ARG(to),      HADA_ARG(rows),
                       HADA_ARG(cols),     HADA_ARG(block),    HADA_ARG(count),   HADA_ARG(parts),
                       HADA_ARG(channels), HADA_ARG(factor),   HADA_ARG(tapers),  HADA_ARG(invert)};
    const size_t local[3] = {(size_t)(block < 8 ? 1 : 8), 1, 1};
    const size_t cols_up = ((size_t)coarse->blocks * (size_t)block + local[0] - 1) / local[0] * local[0];
    const size_t global[3] = {cols_up, (size_t)rows, (size_t)images};
    hada_slot_cost(p->slot, 4.0 * parts * images * (channels + 1.0) * rows * (cols / 2 + 1.0), 0);
    return hada_slot_launch(p->slot, p->crop, "refine_crop", 3, global, local, args, HADA_COUNT(args), err);
}

/* Image values are kept by the ratio of the sizes; OTFs are values already. */
static double area_ratio(const hada_pursuit *p)
{
    return (double)p->coarse.rows * p->coarse.cols / ((double)p->full.rows * p->full.cols);
}

static hada_status check_depths(const hada_pursuit *p, int first, int count, hada_error *err)
{
    if (first < 0 || count < 0 || first + count > p->options.depths)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "depth pursuit: depths %d to %d given, the camera has %d", first,
                         first + count - 1, p->options.depths);
    return HADA_OK;
}

hada_status hada_pursuit_set_otf(hada_pursuit *p, int first, int count, cl_mem otf, size_t offset, hada_error *err)
{
    const crop how = {.parts = 2, .factor = 1.0, .tapers = -1.0};
    const hada_status status = check_depths(p, first, count, err);
    return status ? status : crop_images(p, &how, otf, offset, count, &p->otf, first, err);
}

hada_status hada_pursuit_set_prior(hada_pursuit *p, cl_mem prior, hada_error *err)
{
    /* the noise of a mean of channels is smaller than theirs */
    const crop how = {.parts = 1, .factor = 1.0 / p->options.shape.channels, .tapers = -2.0};
    p->has_prior = 1;
    return crop_images(p, &how, prior, 0, 1, &p->prior, 0, err);
}

hada_status hada_pursuit_set_power(hada_pursuit *p, int first, int count, cl_mem power, size_t offset, hada_error *err)
{
    const double ratio = area_ratio(p);
    const crop how = {.parts = 1, .factor = p->options.shape.channels * ratio * ratio, .tapers = 2.0, .invert = 1};
    const hada_status status = check_depths(p, first, count, err);
    p->has_doubt = 1;
    return status ? status : crop_images(p, &how, power, offset, count, &p->doubt, first, err);
}

hada_status hada_pursuit_run(hada_pursuit *p, cl_mem spectrum, size_t offset, hada_pursuit_result *result,
                             hada_error *err)
{
    struct timespec start, end;
    const crop how = {.parts = 2, .factor = area_ratio(p)};
    const size_t before = hada_refiner_transforms(p->refiner);
    *result = (hada_pursuit_result){0};
    clock_gettime(CLOCK_MONOTONIC, &start);
    hada_status status = crop_images(p, &how, spectrum, offset, 1, &p->spectrum, 0, err);
    if (!status && p->frame_inverse)
        status = hada_fft_inverse(p->frame_inverse, 1, p->spectrum.mem, 0, p->frame.mem, 0, NULL, err);
    if (!status)
        status = hada_pursuit_search(p, result, err);
    clock_gettime(CLOCK_MONOTONIC, &end);
    result->seconds = (double)(end.tv_sec - start.tv_sec) + 1e-9 * (double)(end.tv_nsec - start.tv_nsec);
    result->transforms = hada_refiner_transforms(p->refiner) - before;
    return status;
}
