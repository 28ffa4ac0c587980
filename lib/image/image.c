/* Images on the host: making, cutting, scaling. */
#include <hadalens/image.h>
#include <hadalens/scene.h>

#include "core/callers.h"
#include "core/numbers.h"
#include "image/pixels.h"

hada_status hada_image_create(hada_image *image, int channels, int rows, int cols, hada_error *err)
{
    HADA_NEED(image, err);
    *image = (hada_image){0};
    if (channels < 1 || rows < 1 || cols < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "an image of %d channels, %d x %d is not possible", channels, rows,
                         cols);
    void *data;
    HADA_TRY(hada_allocated(data = hada_alloc(hada_size_product((size_t)channels * (size_t)rows, (size_t)cols),
                                              sizeof(float), "an image", err)));
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

hada_status hada_image_ensure(hada_image *image, int channels, int rows, int cols, hada_error *err)
{
    if (image->data && image->channels == channels && image->rows == rows && image->cols == cols)
        return HADA_OK;
    hada_image_destroy(image);
    return hada_image_create(image, channels, rows, cols, err);
}

hada_status hada_image_copy(hada_image *out, const hada_image *image, hada_error *err)
{
    return hada_image_repeat(out, image, image->channels, err);
}

hada_status hada_image_repeat(hada_image *out, const hada_image *image, int channels, hada_error *err)
{
    const size_t count = hada_image_count(image);
    HADA_TRY(hada_image_create(out, channels, image->rows, image->cols, err));
    for (size_t at = 0; at < hada_image_count(out); at += count)
        memcpy(out->data + at, image->data, count * sizeof *out->data);
    return HADA_OK;
}

float hada_image_brightest(const hada_image *image)
{
    float most = 0.0f;
    for (size_t i = 0; i < hada_image_count(image); i++)
        most = image->data[i] > most ? image->data[i] : most;
    return most;
}

size_t hada_image_count_not_finite(const hada_image *image)
{
    if (!image || !image->data)
        return 0;
    float largest;
    return hada_not_finite(image->data, hada_image_count(image), &largest);
}

/* Of a resampled image: spots of 1.1 pixels (standard deviation) change by less than 2 % (test_psf). */
enum { LOBES = 5 };

/* How an output line gathers input lines: `first` .. `first + count - 1` with weights that sum to 1. */
typedef struct gather {
    int *first, *count;
    double *weight; /* `most` for each output line */
    int most;
} gather;

static void gather_free(gather *g)
{
    HADA_FREE(g->first, g->count, g->weight);
}

static hada_status gather_create(gather *g, int out, int most, hada_error *err)
{
    *g = (gather){.most = most};
    HADA_TRY(HADA_NEW(g->first, (size_t)out, "a resize", err));
    HADA_TRY(HADA_NEW(g->count, (size_t)out, "a resize", err));
    return HADA_NEW(g->weight, (size_t)out * (size_t)most, "a resize", err);
}

/* Shrinking: the share of each input pixel in the output pixel's area. Growing: the two nearest centres. */
static hada_status gather_make(gather *g, int in, int out, hada_error *err)
{
    const double ratio = (double)in / out;
    HADA_TRY(gather_create(g, out, in > out ? in / out + 3 : 2, err));
    for (int i = 0; i < out; i++) {
        double *w = g->weight + (size_t)i * (size_t)g->most;
        if (in > out) {
            const double low = i * ratio, high = (i + 1) * ratio;
            const int a = (int)floor(low), b = (int)ceil(high) < in ? (int)ceil(high) : in;
            g->first[i] = a;
            g->count[i] = b - a;
            for (int k = a; k < b; k++)
                w[k - a] = (fmin(high, k + 1.0) - fmax(low, k)) / ratio;
        } else {
            const double centre = fmin(fmax((i + 0.5) * ratio - 0.5, 0.0), in - 1.0);
            const int a = (int)floor(centre) < in - 1 ? (int)floor(centre) : in > 1 ? in - 2 : 0;
            g->first[i] = a;
            g->count[i] = in > 1 ? 2 : 1;
            w[0] = in > 1 ? a + 1.0 - centre : 1.0;
            w[1] = 1.0 - w[0];
        }
    }
    return HADA_OK;
}

/* The rectangle (row0, col0, rows x ...) of an image, by tables, to out_rows x out_cols. */
static hada_status apply(hada_image *out, const hada_image *image, int row0, int col0, int rows, int out_rows,
                         int out_cols, gather down, gather across, hada_error *err)
{
    double *narrow;
    HADA_TRY(HADA_NEW(narrow, (size_t)rows * (size_t)out_cols, "a resize", err));
    const hada_status status = hada_image_create(out, image->channels, out_rows, out_cols, err);
    for (int c = 0; c < out->channels; c++) {
        for (int r = 0; r < rows; r++) {
            const float *in =
                image->data + ((size_t)c * (size_t)image->rows + (size_t)(row0 + r)) * (size_t)image->cols;
            for (int j = 0; j < out_cols; j++) {
                const double *w = across.weight + (size_t)j * (size_t)across.most;
                double sum = 0.0;
                for (int k = 0; k < across.count[j]; k++)
                    sum += w[k] * in[col0 + across.first[j] + k];
                narrow[(size_t)r * (size_t)out_cols + (size_t)j] = sum;
            }
        }
        for (int i = 0; i < out_rows; i++) {
            const double *w = down.weight + (size_t)i * (size_t)down.most;
            float *to = out->data + ((size_t)c * (size_t)out_rows + (size_t)i) * (size_t)out_cols;
            for (int j = 0; j < out_cols; j++) {
                double sum = 0.0;
                for (int k = 0; k < down.count[i]; k++)
                    sum += w[k] * narrow[(size_t)(down.first[i] + k) * (size_t)out_cols + (size_t)j];
                to[j] = (float)sum;
            }
        }
    }
    free(narrow);
    return status;
}

/* The rectangle (row0, col0, rows x cols) of an image, scaled to out_rows x out_cols. */
static hada_status scale(hada_image *out, const hada_image *image, int row0, int col0, int rows, int cols, int out_rows,
                         int out_cols, hada_error *err)
{
    gather down = {0}, across = {0};
    hada_status status = HADA_OK;
    *out = (hada_image){0};
    if (out_rows < 1 || out_cols < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "an image of %d x %d is not possible", out_rows, out_cols);
    HADA_TRY_OR_DONE(gather_make(&down, rows, out_rows, err));
    HADA_TRY_OR_DONE(gather_make(&across, cols, out_cols, err));
    HADA_TRY_OR_DONE(apply(out, image, row0, col0, rows, out_rows, out_cols, down, across, err));
done:
    gather_free(&down);
    gather_free(&across);
    return status;
}

/* Samples of the sine cardinal, under one of LOBES times its width (C. E. Duchon, Journal of Applied Meteorology 18(8),
 * 1016 (1979)). */
static double lanczos(double x)
{
    const double pi = 3.14159265358979323846;
    return fabs(x) < 1e-9 ? 1.0 : LOBES * sin(pi * x) * sin(pi * x / LOBES) / (pi * pi * x * x);
}

/* Line i of the output reads at (i - out/2 - place) / scale + in/2. Shrinking leaves out what the output cannot hold.
 * Light beyond the input is 0; 1 / scale of the light stays in each line, so that its sum does. */
static hada_status gather_magnified(gather *g, int in, int out, double scale, double place, hada_error *err)
{
    const double wide = fmax(1.0, 1.0 / scale);
    HADA_TRY(gather_create(g, out, 2 * (int)ceil(LOBES * wide) + 1, err));
    for (int i = 0; i < out; i++) {
        const double at = (i - out / 2 - place) / scale + in / 2;
        const double low = ceil(at - LOBES * wide), high = floor(at + LOBES * wide);
        double *w = g->weight + (size_t)i * (size_t)g->most, sum = 0.0;
        if (high < 0.0 || low > in - 1.0)
            continue;
        for (double k = low; k <= high; k++)
            sum += lanczos((k - at) / wide);
        g->first[i] = (int)fmax(low, 0.0);
        g->count[i] = (int)fmin(high, in - 1.0) - g->first[i] + 1;
        for (int k = 0; k < g->count[i]; k++)
            w[k] = lanczos((g->first[i] + k - at) / wide) / (sum * scale);
    }
    return HADA_OK;
}

hada_status hada_image_magnify(hada_image *out, const hada_image *image, double scale, double row, double col, int rows,
                               int cols, hada_error *err)
{
    gather down = {0}, across = {0};
    hada_status status = HADA_OK;
    *out = (hada_image){0};
    HADA_TRY_OR_DONE(gather_magnified(&down, image->rows, rows, scale, row, err));
    HADA_TRY_OR_DONE(gather_magnified(&across, image->cols, cols, scale, col, err));
    HADA_TRY_OR_DONE(apply(out, image, 0, 0, image->rows, rows, cols, down, across, err));
done:
    gather_free(&down);
    gather_free(&across);
    return status;
}

hada_status hada_image_resize(hada_image *out, const hada_image *image, int rows, int cols, hada_error *err)
{
    HADA_NEED(out, err);
    HADA_NEED_IMAGE(image, out, err);
    return scale(out, image, 0, 0, image->rows, image->cols, rows, cols, err);
}

hada_status hada_scene_fit(hada_image *out, const hada_image *image, int rows, int cols, hada_error *err)
{
    HADA_NEED(out, err);
    HADA_NEED_IMAGE(image, out, err);
    *out = (hada_image){0};
    if (rows < 1 || cols < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a scene of %d x %d is not possible", rows, cols);
    int height = image->rows, width = (int)lrint((double)image->rows * cols / rows);
    if (width > image->cols) {
        width = image->cols;
        height = (int)lrint((double)image->cols * rows / cols);
    }
    height = height < 1 ? 1 : height > image->rows ? image->rows : height;
    width = width < 1 ? 1 : width;
    return scale(out, image, (image->rows - height) / 2, (image->cols - width) / 2, height, width, rows, cols, err);
}

hada_status hada_image_crop(hada_image *out, const hada_image *image, int row0, int col0, int rows, int cols,
                            hada_error *err)
{
    HADA_NEED(out, err);
    HADA_NEED_IMAGE(image, out, err);
    HADA_TRY(hada_image_create(out, image->channels, rows, cols, err));
    for (int c = 0; c < image->channels; c++)
        for (int r = 0; r < rows; r++) {
            const long long from = (long long)row0 + r;
            if (from < 0 || from >= image->rows)
                continue;
            for (int k = 0; k < cols; k++) {
                const long long col = (long long)col0 + k;
                if (col >= 0 && col < image->cols)
                    out->data[((size_t)c * (size_t)rows + (size_t)r) * (size_t)cols + (size_t)k] =
                        image->data[((size_t)c * (size_t)image->rows + (size_t)from) * (size_t)image->cols +
                                    (size_t)col];
            }
        }
    return HADA_OK;
}
