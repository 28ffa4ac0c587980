/* PSFs of a simulator: where they lie, and their transfer functions. */
#include <hadalens/scene.h>

#include "optics/simulator.h"
#include "optics/wave.h"

/* Transfer functions of other distances than the camera's that are kept: all of a camera of 300 x 400 pixels, and few
 * enough of large ones to leave a device its memory. */
#define BETWEEN_BYTES ((size_t)256 << 20)

hada_status hada_simulator_check_depth(const hada_simulator *s, int depth, hada_error *err)
{
    if (depth < 0 || depth >= s->camera.depths)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "depth %d is not among the camera's %d depths (0 to %d)", depth,
                         s->camera.depths, s->camera.depths - 1);
    return HADA_OK;
}

hada_place hada_simulator_place(const hada_simulator *s, int depth)
{
    return (hada_place){depth, s->camera.distances_mm[depth]};
}

/* By the camera's optics. */
static hada_status designed_psf(const hada_simulator *s, double distance, int rows, int cols, hada_image *psf,
                                hada_error *err)
{
    if (!s->wave)
        return hada_camera_psf_watched(&s->camera, distance, rows, cols, s->monitor, psf, err);
    const hada_status status = hada_wave_psf(s->wave, distance, rows, cols, psf, err);
    hada_wave_rest(s->wave); /* the next depth is asked for when frames need it, which need the memory too */
    return status;
}

hada_status hada_simulator_place_psf(const hada_simulator *s, hada_place place, int rows, int cols, hada_image *psf,
                                     hada_error *err)
{
    const hada_extent shift = s->shift;
    if (s->psf) { /* lies about the axis: what is beyond it is dark */
        const hada_image *given = &s->psf[place.depth];
        return hada_image_crop(psf, given, given->rows / 2 - rows / 2 + shift.rows,
                               given->cols / 2 - cols / 2 + shift.cols, rows, cols, err);
    }
    if (!shift.rows && !shift.cols)
        return designed_psf(s, place.distance_mm, rows, cols, psf, err);
    const int down = abs(shift.rows), across = abs(shift.cols);
    hada_image wide = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(designed_psf(s, place.distance_mm, rows + 2 * down, cols + 2 * across, &wide, err));
    HADA_TRY_OR_DONE(hada_image_crop(psf, &wide, down + shift.rows, across + shift.cols, rows, cols, err));
done:
    hada_image_destroy(&wide);
    return status;
}

hada_status hada_simulator_psf(const hada_simulator *s, int depth, hada_image *psf, hada_error *err)
{
    HADA_NEED(s && psf, err);
    *psf = (hada_image){0};
    HADA_TRY(hada_simulator_check_depth(s, depth, err));
    return hada_simulator_place_psf(s, hada_simulator_place(s, depth), s->camera.rows, s->camera.cols, psf, err);
}

/* A PSF of the transform's size with the axis moved from the middle to pixel (0, 0). */
static hada_status upload_psf(hada_simulator *s, const hada_image *psf, int channel, const float *share,
                              hada_error *err)
{
    float *shifted = NULL;
    const size_t pixels = (size_t)s->rows * (size_t)s->cols;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(shifted, pixels, "a PSF", err));
    for (int r = 0; r < psf->rows; r++) {
        const size_t to = (size_t)((r - psf->rows / 2 + s->rows) % s->rows) * (size_t)s->cols,
                     from = (size_t)r * (size_t)psf->cols;
        for (int c = 0; c < psf->cols; c++)
            shifted[to + (size_t)((c - psf->cols / 2 + s->cols) % s->cols)] =
                psf->data[(size_t)channel * pixels + from + (size_t)c] * (share ? share[from + (size_t)c] : 1.0f);
    }
    HADA_TRY_OR_DONE(hada_buffer_write(&s->real, s->slot, 0, shifted, pixels * sizeof(float), err));
done:
    free(shifted);
    return status;
}

hada_status hada_simulator_make_otf(hada_simulator *s, const hada_image *psf, const float *share, hada_buffer *otf,
                                    hada_error *err)
{
    hada_status status = HADA_OK;
    if (!otf->mem)
        HADA_TRY_OR_DONE(hada_buffer_create(otf, s->slot->context,
                                            s->layout.count * 2 * sizeof(float) * (size_t)psf->channels,
                                            "a transfer function", err));
    for (int c = 0; c < psf->channels; c++) {
        HADA_TRY_OR_DONE(upload_psf(s, psf, c, share, err));
        HADA_TRY_OR_DONE(
            hada_fft_forward(s->forward_psf, 1, s->real.mem, 0, otf->mem, (size_t)c * s->layout.count, err));
    }
    HADA_TRY_OR_DONE(hada_slot_finish(s->slot, err));
done:
    if (status)
        hada_buffer_destroy(otf);
    return status;
}

/* Where the transfer functions of a place are, or shall be. */
static hada_status find_otf(hada_simulator *s, hada_place place, hada_buffer *scratch, hada_buffer **otf,
                            hada_error *err)
{
    hada_between *between = &s->between;
    const size_t bytes = s->layout.count * 2 * sizeof(float) * (size_t)s->psf_images;
    *otf = place.depth >= 0 ? &s->otf[place.depth] : NULL;
    for (int i = 0; i < between->count && !*otf; i++)
        if (between->distance_mm[i] == place.distance_mm)
            *otf = &between->otf[i];
    if (*otf)
        return HADA_OK;
    if (((size_t)between->count + 1) * bytes > BETWEEN_BYTES) {
        hada_buffer_destroy(scratch);
        *otf = scratch;
        return HADA_OK;
    }
    HADA_TRY(HADA_GROW(between->distance_mm, (size_t)between->count, 1, "distances", err));
    HADA_TRY(HADA_GROW(between->otf, (size_t)between->count, 1, "the transfer functions", err));
    between->distance_mm[between->count] = place.distance_mm;
    *otf = &between->otf[between->count++];
    **otf = (hada_buffer){0};
    return HADA_OK;
}

hada_status hada_simulator_otf(hada_simulator *s, hada_place place, hada_buffer *scratch, const hada_buffer **out,
                               hada_error *err)
{
    hada_image psf = {0};
    hada_buffer *otf;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(find_otf(s, place, scratch, &otf, err));
    *out = otf;
    if (otf->mem)
        goto done;
    HADA_TRY_OR_DONE(hada_simulator_place_psf(s, place, s->rows, s->cols, &psf, err));
    HADA_TRY_OR_DONE(hada_simulator_make_otf(s, &psf, NULL, otf, err));
done:
    hada_image_destroy(&psf);
    return status;
}
