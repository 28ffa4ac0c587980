#include "region.h"
#include "option.h"

#include <hadalens/scene.h>
#include <hadalens/tiff.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int read_window(hada_cli_region *region, const char *text)
{
    char size[32];
    int used = 0, extent[2];
    const size_t length = strcspn(text, "+");
    if (length >= sizeof size)
        return 0;
    memcpy(size, text, length);
    size[length] = 0;
    if (!hada_cli_read_size(size, extent) || extent[0] < 1 || extent[1] < 1)
        return 0;
    region->rows = extent[0];
    region->cols = extent[1];
    region->row = region->col = -1;
    if (!text[length])
        return 1;
    return sscanf(text + length, "+%9d+%9d%n", &region->row, &region->col, &used) == 2 &&
           !text[length + (size_t)used] && region->row >= 0 && region->col >= 0;
}

hada_status hada_cli_region_read(hada_cli_region *region, const char *window, const char *mask, hada_error *err)
{
    *region = (hada_cli_region){0};
    if (window && !read_window(region, window))
        return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                              "--window %s is not a window; write rows x columns as in 192x192, or with the row and "
                              "column of its top left as in 192x192+10+20",
                              window);
    if (!mask)
        return HADA_OK;
    hada_status status = hada_tiff_load(mask, 0, &region->mask, err);
    if (status)
        hada_cli_prefix(err, "%s: ", mask);
    return status;
}

void hada_cli_region_free(hada_cli_region *region)
{
    hada_image_destroy(&region->mask);
}

hada_status hada_cli_region_cut(const hada_cli_region *region, hada_image *image, hada_error *err)
{
    if (!region->rows)
        return HADA_OK;
    hada_image part;
    const int row = region->row < 0 ? (image->rows - region->rows) / 2 : region->row;
    const int col = region->col < 0 ? (image->cols - region->cols) / 2 : region->col;
    if (row < 0 || col < 0 || region->rows > image->rows - row || region->cols > image->cols - col)
        return hada_cli_error(err, HADA_ERROR_SIZE, "the window %dx%d at row %d, column %d does not lie within %dx%d",
                              region->rows, region->cols, row, col, image->rows, image->cols);
    hada_status status = hada_image_crop(&part, image, row, col, region->rows, region->cols, err);
    if (status)
        return status;
    hada_image_destroy(image);
    *image = part;
    return HADA_OK;
}

hada_status hada_cli_region_mask(const hada_cli_region *region, int rows, int cols, unsigned char **mask,
                                 hada_error *err)
{
    *mask = NULL;
    if (!region->mask.data)
        return HADA_OK;
    const int channels = region->mask.channels;
    if (region->mask.rows != rows || region->mask.cols != cols)
        return hada_cli_error(err, HADA_ERROR_SIZE, "the mask is %dx%d, but the images to compare are %dx%d",
                              region->mask.rows, region->mask.cols, rows, cols);
    hada_image part = {0};
    hada_status status = hada_image_crop(&part, &region->mask, 0, 0, rows, cols, err);
    if (!status)
        status = hada_cli_region_cut(region, &part, err);
    const size_t pixels = (size_t)part.rows * (size_t)part.cols;
    int any = 0;
    if (!status && !(*mask = calloc(pixels, 1)))
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    for (size_t i = 0; !status && i < pixels; i++)
        for (int c = 0; c < channels; c++) {
            const float value = part.data[(size_t)c * pixels + i];
            any |= (*mask)[i] |= !isnan(value) && value != 0.0f;
        }
    if (!status && !any) {
        status = hada_cli_error(err, HADA_ERROR_SIZE, "the mask leaves no pixel to compare: all of it is 0%s",
                                region->rows ? " within the window" : "");
        free(*mask);
        *mask = NULL;
    }
    hada_image_destroy(&part);
    return status;
}
