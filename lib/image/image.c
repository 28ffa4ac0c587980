#include <hadalens/image.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "core/finite.h"

hada_status hada_image_create(hada_image *image, int channels, int rows, int cols, hada_error *err)
{
    *image = (hada_image){0};
    if (channels < 1 || rows < 1 || cols < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "an image of %d channels, %d x %d is not possible", channels, rows,
                         cols);
    void *data;
    hada_status status =
        hada_allocated(data = hada_alloc(hada_size_product((size_t)channels * (size_t)rows, (size_t)cols),
                                         sizeof(float), "an image", err));
    if (status)
        return status;
    *image = (hada_image){channels, rows, cols, data};
    return HADA_OK;
}

void hada_image_destroy(hada_image *image)
{
    if (!image)
        return;
    free(image->data);
    *image = (hada_image){0};
}

size_t hada_image_count(const hada_image *image)
{
    return (size_t)image->channels * (size_t)image->rows * (size_t)image->cols;
}

size_t hada_image_count_not_finite(const hada_image *image)
{
    float largest;
    return hada_not_finite(image->data, hada_image_count(image), &largest);
}
