/* Pixels of the sensor that do not see what those around them see: hot, dead and stuck ones. */
#include "core/numbers.h"
#include "dataset/dataset.h"
#include "fit/fitter.h"
#include "image/correct.h"
#include "image/mosaic.h"

/* Frames that are looked at. From so many on, a bad pixel may look sound in one of five. */
enum { FRAMES = 12, MANY = 5 };

typedef struct looking {
    hada_mosaic mosaic;
    int frames, needed;  /* looked at so far; in how many a pixel must be bad */
    unsigned char *bads; /* [channel][row][col]: in how many it is */
    size_t count;
} looking;

static hada_status look_at(looking *at, const hada_image *frame, hada_error *err)
{
    const size_t area = (size_t)frame->rows * (size_t)frame->cols;
    hada_pixels pixels = {.size = sizeof pixels, .full_scale = HADA_AUTO};
    size_t *list, count;
    hada_pixels_of_image(&pixels, frame);
    HADA_TRY(hada_bad_pixels_find(&pixels, at->mosaic, 0, &list, &count, err));
    for (size_t k = 0; k < count; k++) {
        const int row = (int)(list[k] % area / (size_t)frame->cols), col = (int)(list[k] % (size_t)frame->cols);
        if (at->mosaic == HADA_MOSAIC_NONE || (size_t)hada_mosaic_channel(at->mosaic, row, col) == list[k] / area)
            at->bads[list[k]]++;
    }
    free(list);
    at->frames++;
    return HADA_OK;
}

static hada_status look_at_pair(looking *at, const hada_dataset *pairs, int number, hada_error *err)
{
    hada_pair pair = {0};
    float largest;
    hada_status status = HADA_OK;
    int z = 0;
    for (; number >= hada_dataset_get_info(pairs)->counts[z]; z++)
        number -= hada_dataset_get_info(pairs)->counts[z];
    HADA_TRY(hada_pair_take(&pair, pairs, z, number, err));
    const size_t count = hada_image_count(pair.raw);
    if (!at->bads) {
        HADA_TRY_OR_DONE(HADA_NEW(at->bads, count, "bad pixels", err));
        at->count = count;
    }
    if (at->count == count && !hada_not_finite(pair.raw->data, count, &largest)) /* others are refused by the fit */
        HADA_TRY_OR_DONE(look_at(at, pair.raw, err));
done:
    hada_pair_return(&pair);
    return status;
}

/* The flat frame of the pairs, or one of 1, with 0 where pixels are bad. */
static hada_status mark(const looking *at, const hada_fit_options *sizes, const hada_image *before, hada_image *flat,
                        hada_error *err)
{
    HADA_TRY(hada_image_create(flat, sizes->channels, sizes->raw_rows, sizes->raw_cols, err));
    const int same = before && before->rows == flat->rows && before->cols == flat->cols;
    for (size_t i = 0; i < at->count; i++)
        flat->data[i] = at->bads[i] >= at->needed ? 0.0F : same ? before->data[i % hada_image_count(before)] : 1.0F;
    return HADA_OK;
}

hada_status hada_fit_find_bad_pixels(const hada_fit_options *sizes, const hada_dataset *pairs, hada_image *flat,
                                     size_t *found, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(pairs);
    const int count = hada_least(info->pairs, FRAMES);
    looking at = {.mosaic = info->mosaic, .needed = count - (count < MANY ? 0 : count / MANY)};
    hada_status status = HADA_OK;
    *found = 0;
    for (int k = 0; k < count; k++)
        HADA_TRY_OR_DONE(look_at_pair(&at, pairs, hada_spread(k, count, info->pairs), err));
    if (at.frames < 2 || at.frames < count ||
        at.count != (size_t)sizes->channels * (size_t)sizes->raw_rows * (size_t)sizes->raw_cols)
        goto done;
    for (size_t i = 0; i < at.count; i++)
        *found += at.bads[i] >= at.needed;
    if (*found)
        HADA_TRY_OR_DONE(mark(&at, sizes, info->flat, flat, err));
done:
    free(at.bads);
    return status;
}
