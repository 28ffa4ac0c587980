/* Dark level and noise of a frame, from its pixels. */
#include "image/statistics.h"
#include "core/base.h"

/* Brings the value of rank k to its place (C. A. R. Hoare's selection, pivot from the middle). */
float hada_select_rank(float *values, size_t count, size_t k)
{
    size_t low = 0, high = count - 1;
    while (low < high) {
        const float pivot = values[low + (high - low) / 2];
        size_t i = low, j = high;
        for (;;) {
            while (values[i] < pivot)
                i++;
            while (values[j] > pivot)
                j--;
            if (i >= j)
                break;
            const float swap = values[i];
            values[i++] = values[j];
            values[j--] = swap;
        }
        /* values[low .. i-1] <= pivot <= values[i .. high], with values[i] = pivot where i == j */
        if (i == j) {
            if (k == i)
                return values[k];
            if (k < i)
                high = i - 1;
            else
                low = i + 1;
        } else if (k < i) {
            high = i - 1;
        } else {
            low = i;
        }
    }
    return values[k];
}

double hada_first_percentile(const float *pixels, size_t count, float *room)
{
    if (pixels != room)
        memcpy(room, pixels, count * sizeof *room);
    return hada_select_rank(room, count, (count - 1) / 100);
}

/* At most so many pixels in a row, whose mean counts as one value with a quarter of their noise; fewer where that
 * leaves fewer than LEAST_RUNS, for the dark places of small frames are small. */
enum { MOST_IN_RUN = 16, LEAST_RUNS = 4096 };

double hada_dark_estimate(const float *pixels, size_t count, float *room)
{
    const size_t whole = count / LEAST_RUNS, run = whole < 1 ? 1 : whole < MOST_IN_RUN ? whole : MOST_IN_RUN;
    const size_t runs = count / run;
    for (size_t i = 0; i < runs; i++) {
        float sum = 0.0f;
        for (size_t k = 0; k < run; k++)
            sum += pixels[i * run + k];
        room[i] = sum / (float)run;
    }
    return hada_first_percentile(room, runs, room);
}

hada_status hada_dark_levels(const hada_pixels *pixels, hada_mosaic mosaic, double *levels, hada_error *err)
{
    const int colours = mosaic == HADA_MOSAIC_NONE ? pixels->channels : HADA_MOSAIC_COLOURS;
    const size_t plane = (size_t)pixels->rows * (size_t)pixels->cols;
    float *room;
    HADA_TRY(HADA_NEW_RAW(room, plane, "the dark level", err));
    for (int c = 0; c < colours; c++) {
        if (mosaic == HADA_MOSAIC_NONE) {
            levels[c] = hada_dark_estimate(hada_pixels_floats(pixels, c, 0, plane, room), plane, room);
        } else {
            const size_t own = hada_mosaic_own(mosaic, c, pixels->data, pixels->rows, pixels->cols, room);
            levels[c] = hada_dark_estimate(room, own, room);
        }
    }
    free(room);
    return HADA_OK;
}

/* Blocks of a channel that are examined: the median then gives the deviation to 2 %. */
enum { BLOCKS = 4096, SIDE = 4 };
/* Third differences of SIDE values, and the deviation of those of rows and columns in units of the noise's. */
static const float difference[SIDE] = {1.0f, -3.0f, 3.0f, -1.0f};
#define DIFFERENCES 20.0f
/* The median of the magnitude of a normal number of deviation 1. */
#define MEDIAN 0.6745
/* Scenes differ: a factor of up to SCATTER above the usual noise is ignored. Beyond that it counts to the power of 3/2,
 * until it counts in full. Less noise than usual counts to that power as long as that is LEAST_SLOPE times as much,
 * then in proportion, for the camera's own errors do not fall with it (docs/explanation/refinement.md). */
#define LEAST_SLOPE 0.8
#define SCATTER     1.6
/* Factors beyond this are not believed. */
#define FARTHEST 8.0

static double of_channel(const hada_pixels *pixels, int channel)
{
    const size_t cols = (size_t)pixels->cols, across = cols / SIDE, all = (size_t)pixels->rows / SIDE * across;
    const size_t count = all < BLOCKS ? all : BLOCKS;
    float coefficients[BLOCKS] = {0.0f}, room[SIDE];
    for (size_t i = 0; i < count; i++) {
        const size_t block = i * all / count, place = block / across * SIDE * cols + block % across * SIDE;
        float sum = 0.0f;
        for (size_t row = 0; row < SIDE; row++) {
            const float *v = hada_pixels_floats(pixels, channel, place + row * cols, SIDE, room);
            sum += difference[row] * (v[0] - v[3] + 3.0f * (v[2] - v[1]));
        }
        coefficients[i] = fabsf(sum) / DIFFERENCES;
    }
    return hada_select_rank(coefficients, count, count / 2) / MEDIAN;
}

/* Of a mosaic, whether its other colours are filled in or not: of every second pixel of every second row, which hold
 * one colour. */
static double of_mosaic(const hada_pixels *pixels, hada_mosaic mosaic)
{
    double sum = 0.0;
    for (int row = 0; row < 2; row++)
        for (int col = 0; col < 2; col++) {
            const int channel = hada_mosaic_channel(mosaic, row, col), green = channel == 1;
            hada_pixels own = *pixels;
            own.data = (const unsigned char *)pixels->data +
                       (pixels->channels > 1 ? channel : 0) * pixels->channel_stride + row * pixels->row_stride +
                       col * pixels->col_stride;
            own.channels = 1;
            own.rows = (pixels->rows + 1 - row) / 2;
            own.cols = (pixels->cols + 1 - col) / 2;
            own.row_stride *= 2;
            own.col_stride *= 2;
            if (own.rows < SIDE || own.cols < SIDE)
                return 0.0;
            const double deviation = of_channel(&own, 0);
            sum += deviation * deviation / (green ? 2 * HADA_MOSAIC_COLOURS : HADA_MOSAIC_COLOURS);
        }
    return sqrt(sum);
}

double hada_noise_estimate(const hada_pixels *pixels, hada_mosaic mosaic)
{
    double sum = 0.0;
    if (pixels->rows < SIDE || pixels->cols < SIDE)
        return 0.0;
    if (mosaic != HADA_MOSAIC_NONE)
        return of_mosaic(pixels, mosaic);
    for (int c = 0; c < pixels->channels; c++) {
        const double deviation = of_channel(pixels, c);
        sum += deviation * deviation / pixels->channels;
    }
    return sqrt(sum);
}

hada_noise_share hada_noise_share_of(const hada_pixels *pixels, hada_mosaic mosaic, double mean_square, double largest)
{
    if (!(mean_square > 0.0 && largest > 0.0))
        return (hada_noise_share){0.0, 0.0};
    const double noise = hada_noise_estimate(pixels, mosaic);
    return (hada_noise_share){noise / sqrt(mean_square), noise / largest};
}

/* The factor for noise that is `more` times the usual, from 1. */
static double for_more(double more)
{
    const double beyond = fmax(more / SCATTER, 1.0);
    return fmin(fmin(beyond * sqrt(beyond), more), FARTHEST);
}

/* For less, below 1. A share that was not measured on frames may be too large. */
static double for_less(double less, int measured)
{
    return measured ? fmax(less * fmax(sqrt(less), LEAST_SLOPE), 1.0 / FARTHEST) : 1.0 / for_more(1.0 / less);
}

double hada_noise_unit(const hada_pixels *pixels, hada_mosaic mosaic, const hada_noise_share *usual, double mean_square,
                       double largest)
{
    if (!(usual->of_light > 0.0 && mean_square > 0.0))
        return mean_square;
    const hada_noise_share share = hada_noise_share_of(pixels, mosaic, mean_square, largest);
    const int measured = usual->of_largest > 0.0;
    double ratio = share.of_light / usual->of_light;
    /* a dark scene with a few bright places has little light, and no more noise than others as bright at most */
    if (ratio > 1.0 && measured)
        ratio = fmin(ratio, fmax(share.of_largest / usual->of_largest, 1.0));
    const double by = ratio >= 1.0 ? for_more(ratio) : for_less(ratio, measured);
    return mean_square * by * by;
}

float hada_cut_off_value(const float *values, size_t count)
{
    float largest = 0.0f, next = 0.0f;
    for (size_t i = 0; i < count; i++)
        if (values[i] > largest) {
            next = largest;
            largest = values[i];
        } else if (values[i] < largest && values[i] > next) {
            next = values[i];
        }
    const float limit = HADA_NEAR_LARGEST * (next > HADA_NEAR_LARGEST * largest ? largest : next);
    size_t equal = 0, near = 0;
    for (size_t i = 0; i < count; i++) {
        equal += values[i] == largest;
        near += values[i] > limit && values[i] < largest;
    }
    return largest > 0.0f && hada_is_cut_off(equal, near) ? largest : INFINITY;
}

hada_status hada_saturated_weigh(const hada_image *frame, hada_mosaic mosaic, hada_image *weights, hada_error *err)
{
    const int coloured = mosaic != HADA_MOSAIC_NONE && frame->channels == 1;
    const int channels = coloured ? HADA_MOSAIC_COLOURS : frame->channels;
    const size_t cols = (size_t)frame->cols, plane = (size_t)frame->rows * cols;
    float *room = NULL;
    hada_status status = HADA_OK;
    *weights = (hada_image){0};
    if (coloured)
        HADA_TRY_OR_DONE(HADA_NEW_RAW(room, plane, "the weights of pixels", err));
    for (int c = 0; c < channels; c++) {
        size_t count;
        const float *values = hada_mosaic_channel_values(coloured ? mosaic : HADA_MOSAIC_NONE, c, frame, room, &count);
        const float cut_off = hada_cut_off_value(values, count);
        if (!isfinite(cut_off))
            continue;
        const int first = !weights->data;
        if (first)
            HADA_TRY_OR_DONE(hada_image_create(weights, frame->channels, frame->rows, frame->cols, err));
        for (size_t i = 0; first && i < hada_image_count(weights); i++)
            weights->data[i] = 1.0f;
        for (size_t i = 0, k = coloured ? 0 : (size_t)c * plane; i < plane; i++, k++)
            if (frame->data[k] == cut_off &&
                (!coloured || hada_mosaic_channel(mosaic, (int)(i / cols), (int)(i % cols)) == c))
                weights->data[k] = -1.0f;
    }
done:
    free(room);
    if (status)
        hada_image_destroy(weights);
    return status;
}

void hada_weights_bound(hada_image *weights)
{
    for (size_t i = 0; i < hada_image_count(weights); i++)
        if (weights->data[i] < 1.0f)
            weights->data[i] = -1.0f;
}
