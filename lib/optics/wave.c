/* PSFs by wave optics: one channel after the other, lens by lens or the whole mask. */
#include "optics/wave.h"

#include "core/callers.h"

/* Where nothing is chosen: below the rounding of frames of 8 bits (docs/explanation/simulation.md). */
#define STRAY 0.002

static int by_lens(const hada_wave *wave)
{
    return wave->design.sites.count && hada_mask_has_lenses(&wave->camera) && !wave->options.coherent;
}

static hada_status upload_lenses(hada_wave *wave, hada_error *err)
{
    hada_wave_lens *lenses = NULL;
    hada_wave_plane *planes = NULL;
    int count;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_wave_lens_tables(&wave->design, &lenses, &planes, &count, err));
    HADA_TRY_OR_DONE(hada_wave_lens_area(&wave->design, lenses, planes, &wave->area, err));
    HADA_TRY_OR_DONE(hada_buffer_create_from(&wave->lenses, wave->slot, lenses,
                                             (size_t)wave->design.sites.count * sizeof *lenses, "the lenses", err));
    /* one more than there are: a buffer is never empty */
    HADA_TRY_OR_DONE(hada_buffer_create_from(&wave->planes, wave->slot, planes, (size_t)(count + 1) * sizeof *planes,
                                             "the lenses", err));
done:
    HADA_FREE(lenses, planes);
    return status;
}

hada_status hada_wave_create(hada_wave **out, hada_context *context, const hada_camera *camera,
                             const hada_wave_options *callers, hada_error *err)
{
    HADA_NEED(out && context && camera, err);
    hada_wave *wave = NULL;
    hada_wave_options options;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&options, callers, hada_wave_options, err));
    if (options.stray == HADA_AUTO)
        options.stray = STRAY;
    if (!(options.stray >= 1e-5 && options.stray <= 0.2))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "stray light of %g is not possible; use 1e-5 to 0.2", options.stray);
    HADA_TRY_OR_DONE(HADA_NEW(wave, 1, "wave optics", err));
    wave->options = options;
    HADA_TRY_OR_DONE(hada_mask_make_watched(&wave->design, camera, options.monitor, err));
    hada_mask_find_bounds(&wave->design);
    wave->camera = wave->design.camera;
    HADA_TRY_OR_DONE(hada_slot_create(&wave->slot, context, err));
    hada_slot_watch(wave->slot, options.monitor);
    if (by_lens(wave))
        HADA_TRY_OR_DONE(upload_lenses(wave, err));
done:
    if (status)
        hada_wave_destroy(&wave);
    *out = wave;
    return status;
}

void hada_wave_destroy(hada_wave **wave)
{
    hada_wave *w = hada_taken(wave);
    if (!w)
        return;
    if (w->slot)
        hada_slot_finish(w->slot, NULL);
    hada_wave_rest(w);
    HADA_DESTROY_BUFFERS(&w->lenses, &w->planes);
    hada_slot_destroy(&w->slot);
    hada_mask_free(&w->design);
    free(w);
}

hada_status hada_wave_psf(hada_wave *wave, double distance_mm, int rows, int cols, hada_image *psf, hada_error *err)
{
    HADA_NEED(wave && psf, err);
    const hada_camera *camera = &wave->camera;
    const size_t count = hada_size_product((size_t)rows, (size_t)cols);
    double *sum = NULL;
    *psf = (hada_image){0};
    if (!(distance_mm > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a distance of %g mm is not possible; it must be above 0",
                         distance_mm);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(psf, camera->channels, rows, cols, err));
    HADA_TRY_OR_DONE(HADA_NEW(sum, count, "a point spread function", err));
    for (int c = 0; c < camera->channels; c++) {
        double wavelength, path_scale, light = 0.0;
        hada_wave_colour(camera, c, &wavelength, &path_scale);
        for (size_t i = 0; i < count; i++)
            sum[i] = 0.0;
        HADA_TRY_OR_DONE(
            by_lens(wave) ? hada_wave_by_lens(wave, distance_mm, wavelength, path_scale, rows, cols, sum, &light, err)
                          : hada_wave_whole(wave, distance_mm, wavelength, path_scale, rows, cols, sum, &light, err));
        for (size_t i = 0; i < count; i++)
            psf->data[(size_t)c * count + i] = (float)(sum[i] / light);
    }
done:
    free(sum);
    if (status)
        hada_image_destroy(psf);
    return status;
}

hada_status hada_camera_psf_stack(hada_context *context, const hada_camera *callers, hada_image *psf, hada_error *err)
{
    HADA_NEED(callers && psf, err);
    hada_wave *wave = NULL;
    hada_camera own, *camera = &own;
    hada_status status = hada_camera_take(camera, callers, err);
    if (status)
        return status; /* how many PSFs there are is not known */
    for (int z = 0; z < camera->depths; z++)
        psf[z] = (hada_image){0};
    if (camera->optics == HADA_OPTICS_WAVE && !context)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "wave optics need a device; give a context");
    if (camera->optics == HADA_OPTICS_WAVE)
        HADA_TRY_OR_DONE(hada_wave_create(&wave, context, camera, NULL, err));
    for (int z = 0; z < camera->depths; z++)
        HADA_TRY_OR_DONE(wave ? hada_wave_psf(wave, camera->distances_mm[z], camera->rows, camera->cols, &psf[z], err)
                              : hada_camera_psf(camera, camera->distances_mm[z], 0, 0, &psf[z], err));
done:
    hada_wave_destroy(&wave);
    for (int z = 0; z < camera->depths && status; z++)
        hada_image_destroy(&psf[z]);
    return status;
}
