#include "surface/measure.h"

#include <stdlib.h>

#include "core/alloc.h"
#include "core/fft_factor.h"
#include "launch/refine.h"
#include "surface/spline.h"

/* The law is looked for on a grid of at most about this many pixels a side. */
enum { LARGEST_SIDE = 1024 };
/* A transfer function that is cut off there would ring. */
#define TAPERS 3.0

hada_spectrum_layout hada_surface_layout(const hada_context *context, int rows, int cols)
{
    return hada_fft_layout(context, rows, cols, HADA_FFT_AUTO);
}

hada_status hada_surface_prefilter(hada_buffer *out, hada_slot *slot, const hada_spectrum_layout *layout,
                                   hada_error *err)
{
    const char what[] = "the optics between depths";
    const int width = layout->blocks * layout->block;
    float *values = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(values = hada_alloc(layout->count, 2 * sizeof *values, what, err)));
    for (int ky = 0; ky < layout->rows && !slot->context->dry; ky++)
        for (int kx = 0; kx < width; kx++)
            values[2 * hada_spectrum_index(layout, ky, kx)] =
                (float)(1.0 / (hada_spline_gain(ky, layout->rows) * hada_spline_gain(kx, layout->cols)));
    HADA_TRY_OR_DONE(hada_buffer_create_from(out, slot, values, layout->count * 2 * sizeof *values, what, err));
done:
    free(values);
    return status;
}

hada_status hada_surface_crop(hada_slot *slot, cl_mem in, size_t in_offset, const hada_spectrum_layout *from,
                              int images, int channels, double factor, double tapers, cl_mem out, size_t out_offset,
                              const hada_spectrum_layout *to, hada_error *err)
{
    const hada_range range =
        hada_range_of((size_t)to->blocks * (size_t)to->block, to->block < 8 ? 1 : 8, (size_t)to->rows, (size_t)images);
    const hada_refine_crop crop = {.parts = 2, .channels = channels, .factor = (float)factor, .tapers = (float)tapers};
    hada_slot_cost(slot, 8.0 * images * (channels + 1.0) * to->rows * (to->cols / 2 + 1.0), 0);
    return hada_launch_refine_crop(slot, HADA_PROGRAM_REFINE_DEFAULT, &range, err, .in = in, .in_offset = in_offset,
                                   .in_shape = hada_spectrum_shape_of(from), .out = out,
                                   .out_offset = (cl_uint)out_offset, .out_shape = hada_spectrum_shape_of(to),
                                   .crop = crop);
}

/* How many times the grid is as fine as the one where the law is looked for. */
static double zoom_of(const hada_surface_camera *camera)
{
    const int side = camera->rows > camera->cols ? camera->rows : camera->cols;
    return side > LARGEST_SIDE ? (double)side / LARGEST_SIDE : 1.0;
}

static int shrink(int size, double zoom)
{
    return zoom > 1.0 ? hada_fft_good_size((int)(size / zoom)) : size;
}

static hada_fft_desc plan_of(int rows, int cols)
{
    return (hada_fft_desc){.direction = HADA_FFT_INVERSE,
                           .rows = rows,
                           .cols = cols,
                           .batch = 1,
                           .real_rows = rows,
                           .real_cols = cols,
                           .real_pitch = (size_t)cols,
                           .real_distance = (size_t)rows * (size_t)cols};
}

hada_status hada_magnification_measure(hada_magnification *out, hada_slot *slot, const hada_surface_camera *camera,
                                       const double *distances, hada_error *err)
{
    const char what[] = "the optics between depths";
    const double zoom = zoom_of(camera);
    const int rows = shrink(camera->rows, zoom), cols = shrink(camera->cols, zoom);
    const hada_spectrum_layout full = hada_surface_layout(slot->context, camera->rows, camera->cols);
    const hada_spectrum_layout small = hada_surface_layout(slot->context, rows, cols);
    const size_t area = (size_t)rows * (size_t)cols, step = (size_t)camera->channels * full.count;
    const hada_fft_desc desc = plan_of(rows, cols);
    hada_buffer prefilter = {0}, spectrum = {0}, image = {0};
    hada_fft *plan = NULL;
    float *coefficients = NULL;
    hada_status status = HADA_OK;
    *out = (hada_magnification){0};
    HADA_TRY_OR_DONE(
        hada_allocated(coefficients = hada_alloc_raw((size_t)camera->depths * area, sizeof *coefficients, what, err)));
    HADA_TRY_OR_DONE(hada_surface_prefilter(&prefilter, slot, &small, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&spectrum, slot->context, small.count * 2 * sizeof(float), what, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&image, slot->context, area * sizeof(float), what, err));
    HADA_TRY_OR_DONE(hada_fft_create(&plan, slot, &desc, err));
    if (slot->context->dry)
        goto done;
    for (size_t k = 0; k < (size_t)camera->depths; k++) {
        const hada_fft_filter use = {.product = HADA_FFT_COMPLEX, .filter = prefilter.mem, .spectrum_count = 1};
        HADA_TRY_OR_DONE(hada_surface_crop(slot, camera->otf, camera->first * full.count + k * step, &full, 1,
                                           camera->channels, 1.0, zoom > 1.0 ? TAPERS : 0.0, spectrum.mem, 0, &small,
                                           err));
        HADA_TRY_OR_DONE(hada_fft_inverse(plan, 1, spectrum.mem, 0, image.mem, 0, &use, err));
        HADA_TRY_OR_DONE(hada_buffer_read(&image, slot, 0, coefficients + k * area, area * sizeof(float), err));
    }
    HADA_TRY_OR_DONE(hada_magnification_fit(out, camera->depths, distances, coefficients, rows, cols, err));
    /* rows and columns shrink alike but for a pixel or so of a good size */
    hada_magnification_zoom(out, (double)camera->cols / cols);
done:
    hada_fft_destroy(&plan);
    hada_buffer_destroy(&image);
    hada_buffer_destroy(&spectrum);
    hada_buffer_destroy(&prefilter);
    free(coefficients);
    return status;
}
