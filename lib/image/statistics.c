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

static int is_whole(const hada_pixels *pixels)
{
    return pixels->type != HADA_PIXEL_F32;
}

size_t hada_dark_room(const hada_pixels *pixels)
{
    const size_t plane = (size_t)pixels->rows * (size_t)pixels->cols;
    return is_whole(pixels) ? HADA_PIXEL_NUMBERS * sizeof(size_t) : plane * sizeof(float);
}

/* The number of rank k, by how often each occurs. */
static float rank_by_counts(const hada_pixels *pixels, int channel, size_t k, size_t *counts)
{
    int number = 0;
    hada_pixels_count(pixels, channel, counts);
    for (size_t below = counts[0]; below <= k; below += counts[number])
        number++;
    return hada_pixels_value(pixels, number);
}

static size_t dark_rank(size_t count)
{
    return (count - 1) / 100;
}

double hada_dark_estimate(const float *pixels, size_t count, float *room)
{
    if (pixels != room)
        memcpy(room, pixels, count * sizeof *room);
    return hada_select_rank(room, count, dark_rank(count));
}

double hada_dark_level(const hada_pixels *pixels, int channel, void *room)
{
    const size_t plane = (size_t)pixels->rows * (size_t)pixels->cols;
    return is_whole(pixels) ? rank_by_counts(pixels, channel, dark_rank(plane), room)
                            : hada_dark_estimate(hada_pixels_floats(pixels, channel, 0, plane, room), plane, room);
}

hada_status hada_dark_levels(const hada_pixels *pixels, hada_mosaic mosaic, double *levels, hada_error *err)
{
    const int colours = mosaic == HADA_MOSAIC_NONE ? pixels->channels : HADA_MOSAIC_COLOURS;
    void *room = hada_alloc_raw(hada_dark_room(pixels), 1, "the dark level", err);
    HADA_TRY(hada_allocated(room));
    for (int c = 0; c < colours; c++) {
        if (mosaic == HADA_MOSAIC_NONE) {
            levels[c] = hada_dark_level(pixels, c, room);
        } else {
            const size_t own = hada_mosaic_own(mosaic, c, pixels->data, pixels->rows, pixels->cols, room);
            levels[c] = hada_dark_estimate(room, own, room);
        }
    }
    free(room);
    return HADA_OK;
}

/* Blocks of a channel that are examined: the median then gives the deviation to 2 %. */
enum { BLOCKS = 4096 };
/* The median of the magnitude of a normal number of deviation 1. */
#define MEDIAN 0.6745
/* Scenes differ: a factor of up to SCATTER from the usual noise is ignored. Beyond that it counts to the power of 3/2,
 * until it counts in full (docs/explanation/refinement.md). */
#define SCATTER 1.6
/* Factors beyond this are not believed. */
#define FARTHEST 8.0

static double of_channel(const hada_pixels *pixels, int channel)
{
    const size_t cols = (size_t)pixels->cols, across = cols / 2, all = (size_t)pixels->rows / 2 * across;
    const size_t count = all < BLOCKS ? all : BLOCKS;
    float coefficients[BLOCKS] = {0.0f}, room[4];
    for (size_t i = 0; i < count; i++) {
        const size_t block = i * all / count, place = block / across * 2 * cols + block % across * 2;
        const float *up = hada_pixels_floats(pixels, channel, place, 2, room);
        const float *down = hada_pixels_floats(pixels, channel, place + cols, 2, room + 2);
        coefficients[i] = fabsf(up[0] - up[1] - down[0] + down[1]) * 0.5F;
    }
    return hada_select_rank(coefficients, count, count / 2) / MEDIAN;
}

/* Of a mosaic: of every second pixel of every second row, which hold one colour. */
static double of_mosaic(const hada_pixels *pixels, hada_mosaic mosaic)
{
    double sum = 0.0;
    for (int row = 0; row < 2; row++)
        for (int col = 0; col < 2; col++) {
            const int channel = hada_mosaic_channel(mosaic, row, col), green = channel == 1;
            hada_pixels own = *pixels;
            own.data = (const unsigned char *)pixels->data + channel * pixels->channel_stride +
                       row * pixels->row_stride + col * pixels->col_stride;
            own.channels = 1;
            own.rows = (pixels->rows + 1 - row) / 2;
            own.cols = (pixels->cols + 1 - col) / 2;
            own.row_stride *= 2;
            own.col_stride *= 2;
            if (own.rows < 2 || own.cols < 2)
                return 0.0;
            const double deviation = of_channel(&own, 0);
            sum += deviation * deviation / (green ? 2 * HADA_MOSAIC_COLOURS : HADA_MOSAIC_COLOURS);
        }
    return sqrt(sum);
}

double hada_noise_estimate(const hada_pixels *pixels, hada_mosaic mosaic)
{
    double sum = 0.0;
    if (pixels->rows < 2 || pixels->cols < 2)
        return 0.0;
    if (mosaic != HADA_MOSAIC_NONE)
        return of_mosaic(pixels, mosaic);
    for (int c = 0; c < pixels->channels; c++) {
        const double deviation = of_channel(pixels, c);
        sum += deviation * deviation / pixels->channels;
    }
    return sqrt(sum);
}

/* The factor of noise over the usual that is accounted for. */
static double believed(double more)
{
    const double beyond = fmax(more / SCATTER, 1.0);
    return fmin(fmin(beyond * sqrt(beyond), fmax(more, 1.0)), FARTHEST);
}

double hada_noise_unit(const hada_pixels *pixels, hada_mosaic mosaic, double share, double mean_square)
{
    if (!(share > 0.0 && mean_square > 0.0))
        return mean_square;
    const double more = hada_noise_estimate(pixels, mosaic) / (share * sqrt(mean_square));
    const double by =
        more >= 1.0 ? believed(more) : 1.0 / believed(1.0 / fmax(more, 1.0 / (2.0 * FARTHEST * FARTHEST)));
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
