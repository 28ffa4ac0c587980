#include "fit_settings.h"
#include "pairs.h"

#include <hadalens/tiff.h>
#include <stdlib.h>
#include <string.h>

hada_status hada_cli_read_refine(const char *text, int *steps, hada_error *err)
{
    *steps = -1;
    if (!strcmp(text, "auto") || hada_cli_read_count(text, steps))
        return HADA_OK;
    return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--refine takes a number of steps or 'auto', not '%s'", text);
}

hada_status hada_cli_read_refine_tv(const char *text, double *weight, hada_error *err)
{
    *weight = -1.0;
    if (!strcmp(text, "auto") || (hada_cli_read_real(text, weight) && *weight >= 0.0))
        return HADA_OK;
    return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                          "--refine-tv takes a weight, such as 0.003, 0 for none, or 'auto', not '%s'", text);
}

static hada_status psf_distances(const hada_cli_fit_settings *set, hada_tiff_reader *reader, const char *path,
                                 double *out, int pages, hada_error *err)
{
    if (set->distances) {
        double list[256];
        int found = 0;
        hada_status status = hada_cli_read_distances("distances", set->distances, list, 256, &found, err);
        if (!status && found != pages)
            status = hada_cli_error(err, HADA_ERROR_ARGUMENT, "--distances names %d %s, but %s has %d %s", found,
                                    found == 1 ? "distance" : "distances", path, pages, pages == 1 ? "page" : "pages");
        if (!status)
            memcpy(out, list, (size_t)pages * sizeof *out);
        return status;
    }
    if (hada_tiff_distances(reader, out, (size_t)pages) == (size_t)pages)
        return HADA_OK;
    return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                          "%s does not say at which %s its %d %s taken; add --distances with %s in mm", path,
                          pages == 1 ? "distance" : "distances", pages, pages == 1 ? "page was" : "pages were",
                          pages == 1 ? "it" : "them");
}

/* A grey image becomes one of three equal channels. */
static hada_status to_colour(hada_image *image, hada_error *err)
{
    if (image->channels != 1)
        return HADA_OK;
    const size_t area = hada_image_count(image);
    hada_image colour = {0};
    hada_status status = hada_image_create(&colour, 3, image->rows, image->cols, err);
    if (status)
        return status;
    for (int c = 0; c < 3; c++)
        memcpy(colour.data + (size_t)c * area, image->data, area * sizeof(float));
    hada_image_destroy(image);
    *image = colour;
    return HADA_OK;
}

hada_status hada_cli_fit_psf(const hada_cli_fit_settings *set, const char *path, hada_context *context,
                             hada_model **model, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_psf_options psf;
    double weight = -1;
    hada_cli_dark dark = {0};
    hada_psf_options_init(&psf);
    hada_status status = hada_tiff_open(&reader, path, err);
    if (status) {
        hada_cli_prefix(err, "%s: ", path);
        return status;
    }
    int pages = hada_tiff_get_info(reader)->frames;
    double *distances = calloc((size_t)pages, sizeof *distances);
    hada_image *images = calloc((size_t)pages, sizeof *images);
    if (!distances || !images)
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status)
        status = psf_distances(set, reader, path, distances, pages, err);
    if (!status)
        status = hada_cli_dark_read(&dark, set->dark, err);
    if (!status)
        status = hada_cli_read_refine(set->refine, &psf.refine_steps, err);
    if (!status)
        status = hada_cli_read_refine_tv(set->refine_tv, &weight, err);
    for (int z = 0; !status && z < pages; z++) {
        status = hada_tiff_read(reader, z, &images[z], err);
        if (!status && set->colour)
            status = to_colour(&images[z], err);
    }
    if (!status) {
        psf.form = set->form == 3 ? HADA_FORM_MATCHED : HADA_FORM_WIENER;
        psf.boundary = set->boundary == 1 ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED;
        psf.window_rows = set->window[0];
        psf.window_cols = set->window[1];
        psf.lambda = set->lambda > 0 ? set->lambda : 0;
        psf.refine_tv = weight > 0 ? weight : 0;
        psf.psf_dark = set->psf_dark;
        psf.dark = dark.kind == HADA_CLI_DARK_AUTO ? -1 : dark.level;
        status = hada_model_from_psf(model, context, images, pages, distances, &psf, err);
        if (status)
            hada_cli_prefix(err, "%s: ", path);
    }
    for (int z = 0; images && z < pages; z++)
        hada_image_destroy(&images[z]);
    hada_cli_dark_free(&dark);
    free(images);
    free(distances);
    hada_tiff_close(&reader);
    return status;
}
