#include "fit/psf_depths.h"

#include "filter/bank.h"
#include "image/pixels.h"
#include "surface/magnification.h"

/* The largest share of a PSF that the others may leave unexplained by the law, as for optics between depths
 * (engine/constants.c): those of another camera leave all. */
#define MOST_UNEXPLAINED 0.8

/* The law: of the pattern at distance z, 1 + mask / z times as large, and moved. */
typedef struct law {
    double mask, row, col;
} law;

static hada_magnified at_distance(const law *of, double distance)
{
    return (hada_magnified){1.0 + of->mask / distance, of->row / distance, of->col / distance};
}

static hada_status find_law(law *out, double *left, const hada_psfs *psfs, hada_context *context, hada_error *err)
{
    hada_psf_options options;
    hada_model *model = NULL;
    hada_slot *slot = NULL;
    hada_bank *bank = NULL;
    hada_magnification found = {0};
    size_t first;
    int together;
    hada_status status = HADA_OK;
    hada_psf_options_init(&options);
    options.form = HADA_FORM_MATCHED;
    options.psf_dark = 0.0;
    options.window_rows = options.window_cols = 1; /* no scene: the grid is as large as they are */
    HADA_TRY_OR_DONE(hada_model_from_psf(&model, context, psfs->image, psfs->count, psfs->distances_mm, &options, err));
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    const hada_model_info *info = hada_model_get_info(model);
    const hada_spectrum_layout layout = hada_surface_layout(context, info->grid_rows, info->grid_cols);
    HADA_TRY_OR_DONE(hada_bank_create(&bank, slot, model, &layout, NULL, 0, HADA_BANK_OTFS, 0, err));
    const hada_surface_camera camera = {.rows = info->grid_rows,
                                        .cols = info->grid_cols,
                                        .channels = info->channels,
                                        .depths = info->depths,
                                        .otf = hada_bank_otf(bank, 0, &first, &together),
                                        .first = first};
    if (together < info->depths)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_DEVICE_MEMORY,
                                   "the point spread functions are too large for the device to find their law; give "
                                   "the mask's distance"));
    HADA_TRY_OR_DONE(hada_magnification_measure(&found, slot, &camera, psfs->distances_mm, err));
    *out = (law){found.mask, found.row, found.col};
    *left = found.unexplained[HADA_MAGNIFICATION_LAW];
    if (*left > MOST_UNEXPLAINED || found.kind == HADA_MAGNIFICATION_NONE ||
        (found.kind == HADA_MAGNIFICATION_FREE && psfs->count > 2)) /* of two, which is a law as well */
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_NUMERIC,
                                   "the point spread functions do not become one another by magnification (%.0f %% of "
                                   "one stays unexplained by the others): check their distances, or give the mask's",
                                   100.0 * *left));
done:
    hada_magnification_free(&found);
    if (slot)
        hada_slot_finish(slot, NULL);
    hada_bank_destroy(&bank);
    hada_slot_destroy(&slot);
    hada_model_destroy(&model);
    return status;
}

/* *out += part of a measured PSF, made that of another distance. */
static hada_status add(hada_image *out, const law *of, const hada_psfs *psfs, int k, double distance, double part,
                       hada_error *err)
{
    const hada_magnified from = at_distance(of, psfs->distances_mm[k]), to = at_distance(of, distance);
    const hada_magnified by = hada_magnified_between(&from, &to);
    hada_image image;
    HADA_TRY(hada_image_magnify(&image, &psfs->image[k], by.scale, by.row, by.col, out->rows, out->cols, err));
    for (size_t i = 0; i < hada_image_count(out); i++)
        out->data[i] += (float)(part * image.data[i]);
    hada_image_destroy(&image);
    return HADA_OK;
}

hada_status hada_psf_depths(hada_image *out, const double *distances_mm, int count, const hada_psfs *psfs,
                            double *mask_mm, double *left, hada_context *context, hada_error *err)
{
    law own = {.mask = *mask_mm};
    const hada_image *first = psfs->image;
    if (*mask_mm == 0.0)
        HADA_TRY(find_law(&own, left, psfs, context, err));
    *mask_mm = own.mask;
    /* room for the nearest, which is the largest */
    const double most =
        fmax(1.0, at_distance(&own, distances_mm[0]).scale / at_distance(&own, psfs->distances_mm[0]).scale);
    for (int z = 0; z < count; z++) {
        const double distance = distances_mm[z];
        int k = 0;
        HADA_TRY(hada_image_create(&out[z], first->channels, (int)ceil(most * first->rows),
                                   (int)ceil(most * first->cols), err));
        while (k + 1 < psfs->count && psfs->distances_mm[k + 1] <= distance)
            k++;
        const double near = 1.0 / psfs->distances_mm[k];
        const double far = k + 1 < psfs->count ? 1.0 / psfs->distances_mm[k + 1] : near;
        const double part = near > far ? fmax(0.0, (near - 1.0 / distance) / (near - far)) : 0.0;
        HADA_TRY(add(&out[z], &own, psfs, k, distance, 1.0 - part, err));
        if (part > 0.0)
            HADA_TRY(add(&out[z], &own, psfs, k + 1, distance, part, err));
    }
    return HADA_OK;
}
