/* What the pixels of a frame say of its dark level and of its noise. */
#include "image/statistics.h"

#include <math.h>
#include <string.h>

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

double hada_dark_estimate(const float *pixels, size_t count, float *room)
{
    memcpy(room, pixels, count * sizeof *room);
    return hada_select_rank(room, count, (count - 1) / 100);
}

/* Blocks of a channel that are looked at: the median then tells the deviation to 2 %. */
enum { BLOCKS = 4096 };
/* The median of the magnitude of a normal number of deviation 1. */
#define MEDIAN 0.6745
/* Scenes differ: up to so many times more or less noise than the share says nothing. Beyond that it is taken to the
 * power of 3/2, until it counts whole (docs/explanation/refinement.md). */
#define SCATTER 1.6
/* Noise so many times less or more than it was is not believed. */
#define FARTHEST 8.0

static double of_channel(const float *pixels, int rows, int cols)
{
    const size_t across = (size_t)cols / 2, all = (size_t)rows / 2 * across;
    const size_t count = all < BLOCKS ? all : BLOCKS;
    float coefficients[BLOCKS];
    for (size_t i = 0; i < count; i++) {
        const size_t block = i * all / count;
        const float *at = pixels + block / across * 2 * (size_t)cols + block % across * 2;
        coefficients[i] = fabsf(at[0] - at[1] - at[cols] + at[cols + 1]) * 0.5F;
    }
    return hada_select_rank(coefficients, count, count / 2) / MEDIAN;
}

double hada_noise_estimate(const float *pixels, int channels, int rows, int cols)
{
    double sum = 0.0;
    if (rows < 2 || cols < 2)
        return 0.0;
    for (int c = 0; c < channels; c++) {
        const double deviation = of_channel(pixels + (size_t)c * (size_t)rows * (size_t)cols, rows, cols);
        sum += deviation * deviation / channels;
    }
    return sqrt(sum);
}

/* How many times more noise than usual is accounted for. */
static double believed(double more)
{
    const double beyond = fmax(more / SCATTER, 1.0);
    return fmin(fmin(beyond * sqrt(beyond), fmax(more, 1.0)), FARTHEST);
}

double hada_noise_unit(const float *pixels, int channels, int rows, int cols, double share, double mean_square)
{
    if (!(share > 0.0 && mean_square > 0.0))
        return mean_square;
    const double more = hada_noise_estimate(pixels, channels, rows, cols) / (share * sqrt(mean_square));
    const double by =
        more >= 1.0 ? believed(more) : 1.0 / believed(1.0 / fmax(more, 1.0 / (2.0 * FARTHEST * FARTHEST)));
    return mean_square * by * by;
}
