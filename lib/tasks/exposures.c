/* Files of exposures of one scene. */
#include <hadalens/task_reconstruct.h>

#include "core/callers.h"
#include "io/tiff_page.h"

/* A pixel without light that reads less is as good as dark. */
#define DARK 0.002

typedef struct exposures {
    hada_image *image;
    int count;
} exposures;

/* All pages of a file. */
static hada_status add(exposures *all, const char *path, double encoding, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_tiff_open(&reader, path, err));
    const int pages = hada_tiff_get_info(reader)->frames;
    HADA_TRY_OR_DONE(hada_tiff_check_all(reader, err));
    HADA_TRY_OR_DONE(HADA_GROW(all->image, (size_t)all->count + (size_t)pages, "exposures", err));
    for (int page = 0; page < pages; page++) {
        HADA_TRY_OR_DONE(hada_tiff_read_light(reader, page, encoding, &all->image[all->count], err));
        all->count++;
    }
done:
    hada_tiff_close(&reader);
    return status;
}

hada_status hada_exposures_load(hada_image *frame, hada_image *weights, const char *const *paths, int count,
                                double encoding, hada_mosaic mosaic, const hada_monitor *monitor, hada_error *err)
{
    HADA_NEED(frame && weights && paths, err);
    exposures all = {0};
    double *scales = NULL, dark;
    hada_status status = HADA_OK;
    *frame = *weights = (hada_image){0};
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(add(&all, paths[i], encoding, err));
    HADA_TRY_OR_DONE(HADA_NEW(scales, (size_t)all.count + 1, "a bracket", err));
    HADA_TRY_OR_DONE(hada_image_merge_exposures(frame, weights, all.image, all.count, mosaic, scales, &dark, err));
    for (int k = 0; k < all.count; k++)
        hada_monitor_tell(monitor, HADA_MESSAGE_INFO, "exposure %d is %.4g times the shortest", k + 1, scales[k]);
    if (fabs(dark) > DARK)
        hada_monitor_tell(monitor, HADA_MESSAGE_INFO,
                          "without light the exposures read %.3g, which is the dark level to take off", dark);
done:
    for (int k = 0; k < all.count; k++)
        hada_image_destroy(&all.image[k]);
    HADA_FREE(all.image, scales);
    return status;
}
