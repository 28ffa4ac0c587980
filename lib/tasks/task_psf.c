/* A camera from its point spread functions. */
#include <hadalens/task_fit.h>
#include <hadalens/tiff.h>

#include "core/callers.h"
#include "io/folder.h"
#include "io/tiff_page.h"
#include "tasks/fit_steps.h"

/* The pages of a file and their distances. */
typedef struct pages {
    int count;
    hada_image *image;
    double *distances_mm;
} pages;

static hada_status find_distances(pages *of, hada_tiff_reader *reader, const char *path, const hada_psf_task *task,
                                  hada_error *err)
{
    const size_t count = (size_t)of->count;
    if (task->distances_mm && task->distances != of->count)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.distances names %d distance%s, but %s has %d page%s",
                         task->distances, task->distances == 1 ? "" : "s", path, of->count, of->count == 1 ? "" : "s");
    const hada_tiff_info *info = hada_tiff_get_info(reader);
    const double *known = task->distances_mm             ? task->distances_mm
                          : info->distances == of->count ? info->distances_mm
                                                         : NULL;
    if (known) {
        memcpy(of->distances_mm, known, count * sizeof *of->distances_mm);
        return HADA_OK;
    }
    return hada_fail(err, HADA_ERROR_ARGUMENT,
                     "%s does not say at which %s its %d %s taken; add options.distances with %s in mm", path,
                     of->count == 1 ? "distance" : "distances", of->count, of->count == 1 ? "page was" : "pages were",
                     of->count == 1 ? "it" : "them");
}

/* A grey image becomes one of three equal channels. */
static hada_status to_colour(hada_image *image, hada_error *err)
{
    const size_t area = hada_image_count(image);
    hada_image colour = {0};
    if (image->channels != 1)
        return HADA_OK;
    HADA_TRY(hada_image_create(&colour, 3, image->rows, image->cols, err));
    for (size_t c = 0; c < 3; c++)
        memcpy(colour.data + c * area, image->data, area * sizeof(float));
    hada_image_destroy(image);
    *image = colour;
    return HADA_OK;
}

static hada_status read_pages(pages *of, const char *path, const hada_psf_task *task, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_tiff_open(&reader, path, err));
    HADA_TRY_OR_DONE(hada_tiff_check_all(reader, err));
    of->count = hada_tiff_get_info(reader)->frames;
    HADA_TRY_OR_DONE(HADA_NEW(of->distances_mm, (size_t)of->count, "distances", err));
    HADA_TRY_OR_DONE(HADA_NEW(of->image, (size_t)of->count, "point spread functions", err));
    HADA_TRY_OR_DONE(find_distances(of, reader, path, task, err));
    for (int z = 0; z < of->count; z++) {
        HADA_TRY_OR_DONE(hada_tiff_read_light(reader, z, task->frame_encoding, &of->image[z], err));
        if (task->colour)
            HADA_TRY_OR_DONE(to_colour(&of->image[z], err));
    }
done:
    hada_tiff_close(&reader);
    return status;
}

hada_status hada_psf_run(hada_model **out, hada_context *context, const char *path, const hada_psf_task *callers,
                         hada_error *err)
{
    HADA_NEED(out && context && path, err);
    hada_psf_task own, *task = &own;
    pages of = {0};
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(task, callers, hada_psf_task, err));
    if (!path)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT, "hada_psf_run: a file is needed"));
    HADA_TRY_OR_DONE(read_pages(&of, path, task, err));
    HADA_TRY_OR_DONE(
        hada_named(hada_model_from_psf(out, context, of.image, of.count, of.distances_mm, task->psf, err), path, err));
    if (task->half)
        HADA_TRY_OR_DONE(hada_model_make_half(out, err));
done:
    for (int z = 0; of.image && z < of.count; z++)
        hada_image_destroy(&of.image[z]);
    HADA_FREE(of.image, of.distances_mm);
    if (status)
        hada_model_destroy(out);
    return status;
}
