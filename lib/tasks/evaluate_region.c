#include "tasks/evaluate.h"

#include <hadalens/scene.h>
#include <hadalens/tiff.h>

hada_status hada_region_read(hada_region *region, const hada_evaluate_task *task, hada_error *err)
{
    *region = (hada_region){task->window_rows, task->window_cols, task->window_row, task->window_col, {0}};
    if (!task->mask)
        return HADA_OK;
    const hada_status status = hada_tiff_load(task->mask, 0, &region->mask, err);
    if (status)
        hada_error_prefix(err, "%s: ", task->mask);
    return status;
}

void hada_region_free(hada_region *region)
{
    hada_image_destroy(&region->mask);
}

hada_status hada_region_cut(const hada_region *region, hada_image *image, hada_error *err)
{
    hada_image part;
    if (!region->rows)
        return HADA_OK;
    const int row = region->row < 0 ? (image->rows - region->rows) / 2 : region->row;
    const int col = region->col < 0 ? (image->cols - region->cols) / 2 : region->col;
    if (row < 0 || col < 0 || region->rows > image->rows - row || region->cols > image->cols - col)
        return hada_fail(err, HADA_ERROR_SIZE, "the window %dx%d at row %d, column %d does not lie within %dx%d",
                         region->rows, region->cols, row, col, image->rows, image->cols);
    HADA_TRY(hada_image_crop(&part, image, row, col, region->rows, region->cols, err));
    hada_image_destroy(image);
    *image = part;
    return HADA_OK;
}

/* Pixels that are not 0 in some channel; returns whether there are any. */
static int mark(unsigned char *mask, const hada_image *image)
{
    const size_t pixels = (size_t)image->rows * (size_t)image->cols;
    int any = 0;
    for (int c = 0; c < image->channels; c++)
        for (size_t i = 0; i < pixels; i++) {
            const float value = image->data[(size_t)c * pixels + i];
            any |= mask[i] |= !isnan(value) && value != 0.0f;
        }
    return any;
}

hada_status hada_region_mask(const hada_region *region, int rows, int cols, unsigned char **mask, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_image part = {0};
    *mask = NULL;
    if (!region->mask.data)
        return HADA_OK;
    if (region->mask.rows != rows || region->mask.cols != cols)
        return hada_fail(err, HADA_ERROR_SIZE, "the mask is %dx%d, but the images to compare are %dx%d",
                         region->mask.rows, region->mask.cols, rows, cols);
    HADA_TRY_OR_DONE(hada_image_crop(&part, &region->mask, 0, 0, rows, cols, err));
    HADA_TRY_OR_DONE(hada_region_cut(region, &part, err));
    HADA_TRY_OR_DONE(HADA_NEW(*mask, (size_t)part.rows * (size_t)part.cols, "a mask", err));
    if (!mark(*mask, &part))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_SIZE, "the mask leaves no pixel to compare: all of it is 0%s",
                                   region->rows ? " within the window" : ""));
done:
    hada_image_destroy(&part);
    if (status) {
        free(*mask);
        *mask = NULL;
    }
    return status;
}
