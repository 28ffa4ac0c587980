/* Binning: fewer, larger pixels. */
#include "core/callers.h"
#include "image/mosaic.h"
#include "image/statistics.h"

/* The pixels of a bin that count: from `count` places in its first pixels on, each `step` further in rows and columns.
 */
typedef struct pattern {
    int count, step;
    int row[4], col[4];
} pattern;

static pattern find(hada_mosaic mosaic, int channel)
{
    pattern found = {.step = 2};
    if (mosaic == HADA_MOSAIC_NONE)
        return (pattern){.count = 1, .step = 1};
    for (int i = 0; i < 4; i++)
        if (hada_mosaic_channel(mosaic, i / 2, i % 2) == channel) {
            found.row[found.count] = i / 2;
            found.col[found.count++] = i % 2;
        }
    return found;
}

/* The bin whose first pixel `values` points at. */
static float bin(const float *values, size_t cols, int factor, const pattern *of, float limit)
{
    double sum = 0.0;
    int count = 0, saturated = 0;
    for (int i = 0; i < of->count; i++)
        for (int r = of->row[i]; r < factor; r += of->step)
            for (int c = of->col[i]; c < factor; c += of->step) {
                const float value = values[(size_t)r * cols + (size_t)c];
                saturated |= value >= limit;
                sum += value;
                count++;
            }
    /* what is not finite stays so */
    return saturated && sum <= (double)limit * count ? limit : (float)(sum / count);
}

hada_status hada_image_downsample(hada_image *out, const hada_image *image, int factor, hada_mosaic mosaic,
                                  int keep_saturated, hada_error *err)
{
    float *room = NULL;
    hada_status status = HADA_OK;
    HADA_NEED(out, err);
    HADA_NEED_IMAGE(image, out, err);
    *out = (hada_image){0};
    const int coloured = mosaic != HADA_MOSAIC_NONE;
    if (coloured && (!hada_mosaic_is_pattern(mosaic) || image->channels != 1 || factor % 2))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a colour filter mosaic has one channel and a pattern, and is binned by an even number; here "
                         "are %d channel(s), and %d",
                         image->channels, factor);
    if (factor < 1 || factor > image->rows || factor > image->cols)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%d x %d pixels cannot be binned by %d", image->rows, image->cols,
                         factor);
    HADA_TRY_OR_DONE(hada_image_create(out, coloured ? HADA_MOSAIC_COLOURS : image->channels, image->rows / factor,
                                       image->cols / factor, err));
    if (coloured)
        HADA_TRY_OR_DONE(HADA_NEW(room, (size_t)image->rows * (size_t)image->cols, "binned pixels", err));
    const size_t cols = (size_t)image->cols, plane = (size_t)image->rows * cols, side = (size_t)factor;
    float *to = out->data;
    for (int channel = 0; channel < out->channels; channel++) {
        size_t count;
        const float *own = keep_saturated ? hada_mosaic_channel_values(mosaic, channel, image, room, &count) : NULL;
        const float limit = own ? hada_cut_off_value(own, count) : INFINITY;
        const float *from = image->data + (coloured ? 0 : (size_t)channel * plane);
        const pattern of = find(mosaic, channel);
        for (size_t row = 0; row < (size_t)out->rows; row++)
            for (size_t col = 0; col < (size_t)out->cols; col++)
                *to++ = bin(from + row * side * cols + col * side, cols, factor, &of, limit);
    }
done:
    free(room);
    if (status)
        hada_image_destroy(out);
    return status;
}

hada_status hada_image_bin(hada_image *image, int factor, hada_mosaic mosaic, int keep_saturated, hada_error *err)
{
    hada_image binned;
    HADA_TRY(hada_image_downsample(&binned, image, factor, mosaic, keep_saturated, err));
    hada_image_destroy(image);
    *image = binned;
    return HADA_OK;
}
