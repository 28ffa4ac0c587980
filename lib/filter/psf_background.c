/* The background and the noise of point spread functions, from their dark parts. */
#include <math.h>
#include <string.h>

#include "core/numbers.h"
#include "filter/psf.h"
#include "image/correct.h"
#include "image/statistics.h"

/* Blocks of 2 x 2 pixels are dark that are among this share of the darkest. */
#define DARK_SHARE 0.1
/* The median of the magnitude of a normal number of deviation 1. */
#define MEDIAN 0.6745
/* The first percentile is 2.3 deviations below the background where all pixels are dark, 1.3 where a tenth is. From
 * between them, the mean of the pixels that are near leads to the background in a few steps; where no pixel is dark it
 * cannot lead far. */
#define PERCENTILE 1.8
#define NEAR       1.5
enum { NEAR_STEPS = 3 };

/* Noise of which the part below black was cut off, as in most files of 8 bits: from so many pixels at the lowest value.
 * 2 x 2 blocks that hold one of them say how strong it was, by the magnitude of their diagonal coefficients and the
 * share a of their pixels above the lowest value. Of normal noise the median is a (0.42 + 0.69 a) deviations, and the
 * mean without the largest tenth a (0.55 + 0.45 a), within 7 % where 16 to 69 % are cut off, 24 % more where it is 7 %.
 * Edges of light move the median little. Values in steps of up to 1.25 deviations make the mean larger by 1.1 - 1.3 a
 * of a step, and the median anything: the lower one counts. The mean of the dark pixels is by 1.21 - 1.69 a deviations
 * higher than without the cut, but black is no lower than the lowest value (all by simulation). */
#define CUT_OFF   0.05
#define LIGHTLESS 0.9
/* Values are whole steps if those of the first few steps are, within this part of one; then they are uncertain by one.
 */
enum { FEW_STEPS = 8 };
#define WHOLE_STEP 0.01

/* 2 x 2 pixels each of a channel. */
typedef struct blocks {
    const float *pixels;
    int rows, cols; /* of blocks */
    size_t pitch;   /* of pixels */
} blocks;

static const float *block(const blocks *b, size_t i)
{
    return b->pixels + i / (size_t)b->cols * 2 * b->pitch + i % (size_t)b->cols * 2;
}

static float diagonal_of(const float *up, size_t pitch)
{
    const float *down = up + pitch;
    return fabsf(up[0] - up[1] - down[0] + down[1]) * 0.5F;
}

/* The noise of the darkest blocks, by the median of their diagonal wavelet coefficients (statistics.h), which know
 * nothing of the blocks' means, by which they are chosen. `room`: two floats for each block. */
static double whole_noise(const blocks *b, float *room)
{
    const size_t count = (size_t)b->rows * (size_t)b->cols;
    float *mean = room, *sorted = room + count;
    size_t dark = 0;
    for (size_t i = 0; i < count; i++) {
        const float *up = block(b, i), *down = up + b->pitch;
        sorted[i] = mean[i] = up[0] + up[1] + down[0] + down[1];
    }
    const float most = hada_select_rank(sorted, count, (size_t)(DARK_SHARE * (double)(count - 1)));
    for (size_t i = 0; i < count; i++)
        if (mean[i] <= most)
            sorted[dark++] = diagonal_of(block(b, i), b->pitch);
    return hada_select_rank(sorted, dark, dark / 2) / MEDIAN;
}

/* Where values were cut off, and stand `step` apart. */
static void find_cut_noise(const blocks *b, double step, float *room, hada_psf_dark *out)
{
    size_t dark = 0, lowest_count = 0, used = 0;
    double sum = 0.0;
    for (size_t i = 0; i < (size_t)b->rows * (size_t)b->cols; i++) {
        const float *up = block(b, i), *down = up + b->pitch, least = out->lowest;
        const int at_lowest = (up[0] == least) + (up[1] == least) + (down[0] == least) + (down[1] == least);
        if (at_lowest)
            room[dark++] = diagonal_of(up, b->pitch);
        lowest_count += (size_t)at_lowest;
    }
    const double above = dark ? 1.0 - (double)lowest_count / (4.0 * (double)dark) : 0.0;
    out->noise = step / sqrt(12.0);
    if (!(above > 0.0))
        return;
    const float most = hada_select_rank(room, dark, (size_t)(LIGHTLESS * (double)(dark - 1)));
    for (size_t i = 0; i < dark; i++)
        if (room[i] <= most) {
            sum += room[i];
            used++;
        }
    const double by_mean = fmax(sum / (double)used / (above * (0.55 + 0.45 * above)) - (1.1 - 1.3 * above) * step, 0.0);
    const double by_median = hada_select_rank(room, dark, dark / 2) / (above * (0.42 + 0.69 * above));
    const double noise = fmin(by_mean, by_median);
    out->lifted = fmax(1.21 - 1.69 * above, 0.0) * noise;
    out->noise = fmax(out->noise, noise);
}

/* The step of which values are whole numbers, from the lowest one on; 0: there is none. */
static double step_of(const float *pixels, size_t count, float lowest)
{
    float next = INFINITY;
    int reaches = 0;
    for (size_t i = 0; i < count; i++)
        next = pixels[i] > lowest ? fminf(next, pixels[i]) : next;
    for (size_t i = 0; i < count; i++) {
        const double steps = (pixels[i] - lowest) / (next - lowest);
        if (steps < FEW_STEPS + 0.5 && fabs(steps - nearbyint(steps)) > WHOLE_STEP)
            return 0.0;
        reaches |= steps > FEW_STEPS - 0.5;
    }
    return reaches ? next - lowest : 0.0;
}

hada_psf_dark hada_psf_find_dark(const float *pixels, int rows, int cols, float *room)
{
    const blocks b = {pixels, rows / 2, cols / 2, (size_t)cols};
    const size_t count = (size_t)rows * (size_t)cols;
    hada_psf_dark out = {.lowest = INFINITY};
    size_t at_lowest = 0;
    for (size_t i = 0; i < count; i++)
        out.lowest = fminf(out.lowest, pixels[i]);
    for (size_t i = 0; i < count; i++)
        at_lowest += pixels[i] == out.lowest;
    if (!b.rows || !b.cols)
        return out;
    if ((double)at_lowest < CUT_OFF * (double)count)
        out.noise = whole_noise(&b, room);
    else
        find_cut_noise(&b, step_of(pixels, count, out.lowest), room, &out);
    return out;
}

double hada_psf_background(const float *pixels, size_t count, double noise, float *room)
{
    double level = hada_first_percentile(pixels, count, room) + PERCENTILE * noise;
    for (int step = 0; noise > 0.0 && step < NEAR_STEPS; step++) {
        double sum = 0.0, near = 0.0;
        for (size_t i = 0; i < count; i++)
            if (fabs(pixels[i] - level) <= NEAR * noise) {
                sum += pixels[i];
                near += 1.0;
            }
        level = near > 0.0 ? sum / near : level;
    }
    return level;
}

/* Backgrounds that are not even, as of a room that is not quite dark. Where one of TILES x TILES parts of a channel has
 * no light, the lower quartile of its means of 2 x 2 pixels is the background. A polynomial of the place passes below
 * light if parts count the less the higher they are above it. A higher order is taken where the polynomial is near to
 * MANY of the parts, within NEAR_TILE deviations of the noise, and to MORE times as many as before: where light falls
 * off, a polynomial is near to few. The HIGHEST follows light as well, so that it must be near to ALL but few parts,
 * and leave HARDLY anything of what was left. Measured: perf/results/real-captures.md. */
enum { TILES = 16, LEAST_TILE = 4, SURFACE_STEPS = 30, CURVED = 2, HIGHEST = 6 };
enum { TERMS = (HIGHEST + 1) * (HIGHEST + 2) / 2 };
#define TILE_RANK 0.25
#define NEAR_TILE 2.0
#define MANY      0.25
#define MORE      2.0
#define ALL       0.9
#define HARDLY    0.5

typedef struct tiles {
    double level[TILES * TILES];
    double term[TILES * TILES][TERMS]; /* at the middle of each */
    double noise;
} tiles;

typedef struct surface {
    double weight[TERMS]; /* 0 beyond its order */
    double near;          /* the share of tiles that are */
    double left;          /* the mean over tiles of what is left, each up to 1 */
} surface;

/* Products of powers of a place, from -1 to 1, by their order: those of an order and the ones below it come first. */
static void find_terms(double *term, double y, double x)
{
    double *next = term, power = 1.0;
    *next++ = 1.0;
    for (int order = 1; order <= HIGHEST; order++) {
        const double *before = next - order;
        for (int k = 0; k < order; k++)
            *next++ = before[k] * x;
        *next++ = power *= y;
    }
}

static double sum_of(const double *weight, const double *term)
{
    double sum = 0.0;
    for (int k = 0; k < TERMS; k++)
        sum += weight[k] * term[k];
    return sum;
}

static void find_tiles(tiles *t, const blocks *b, float *room)
{
    for (int tile = 0; tile < TILES * TILES; tile++) {
        const int row = tile / TILES, col = tile % TILES;
        size_t count = 0;
        for (int i = row * b->rows / TILES; i < (row + 1) * b->rows / TILES; i++)
            for (int k = col * b->cols / TILES; k < (col + 1) * b->cols / TILES; k++) {
                const float *up = block(b, (size_t)i * (size_t)b->cols + (size_t)k), *down = up + b->pitch;
                room[count++] = 0.25F * (up[0] + up[1] + down[0] + down[1]);
            }
        t->level[tile] = hada_select_rank(room, count, (size_t)(TILE_RANK * (double)(count - 1)));
        find_terms(t->term[tile], hada_smooth_place(row + 0.5, TILES), hada_smooth_place(col + 0.5, TILES));
    }
}

/* The nearest surface of so many terms, tiles above the one at hand counting less. 0: there is none. */
static int step_down(surface *at, int terms, const tiles *t)
{
    double normal[TERMS * TERMS] = {0.0}, right[TERMS] = {0.0};
    for (int tile = 0; tile < TILES * TILES; tile++) {
        const double *term = t->term[tile];
        const double above = fmax(t->level[tile] - sum_of(at->weight, term), 0.0) / t->noise;
        const double counts = 1.0 / (1.0 + above * above);
        for (int n = 0; n < terms; n++) {
            right[n] += counts * term[n] * t->level[tile];
            for (int k = 0; k <= n; k++)
                normal[n * terms + k] += counts * term[n] * term[k];
        }
    }
    if (!hada_cholesky_factor(normal, terms))
        return 0;
    hada_cholesky_solve(normal, terms, right);
    memcpy(at->weight, right, (size_t)terms * sizeof *right);
    return 1;
}

/* The lowest surface, from above all tiles. */
static surface lowest_surface(const tiles *t, int order)
{
    surface out = {.weight = {INFINITY}};
    for (int step = 0; step < SURFACE_STEPS; step++)
        if (!step_down(&out, (order + 1) * (order + 2) / 2, t))
            return (surface){.left = 1.0};
    for (int tile = 0; tile < TILES * TILES; tile++) {
        const double off = fabs(t->level[tile] - sum_of(out.weight, t->term[tile])) / t->noise;
        out.near += (off < NEAR_TILE) / (double)(TILES * TILES);
        out.left += off * off / (1.0 + off * off) / (TILES * TILES);
    }
    return out;
}

double hada_psf_take_uneven(float *pixels, int rows, int cols, double noise, float *room)
{
    static const int orders[] = {1, CURVED, HIGHEST};
    const blocks b = {pixels, rows / 2, cols / 2, (size_t)cols};
    double term[TERMS], least = INFINITY, most = -INFINITY;
    tiles t = {.noise = noise};
    if (!(noise > 0.0) || b.rows < LEAST_TILE * TILES || b.cols < LEAST_TILE * TILES)
        return 0.0;
    find_tiles(&t, &b, room);
    surface best = lowest_surface(&t, 0);
    for (size_t k = 0; k < HADA_COUNT(orders); k++) {
        const surface next = lowest_surface(&t, orders[k]);
        if ((orders[k] <= CURVED && next.near >= MANY && next.near >= MORE * best.near) ||
            (next.near >= ALL && next.left <= HARDLY * best.left))
            best = next;
    }
    for (int tile = 0; tile < TILES * TILES; tile++) {
        least = fmin(least, sum_of(best.weight, t.term[tile]));
        most = fmax(most, sum_of(best.weight, t.term[tile]));
    }
    if (!(most > least)) /* a constant: even */
        return 0.0;
    best.weight[0] -= least;
    for (int row = 0; row < rows; row++)
        for (int col = 0; col < cols; col++) {
            find_terms(term, hada_smooth_place(row + 0.5, rows), hada_smooth_place(col + 0.5, cols));
            pixels[(size_t)row * (size_t)cols + (size_t)col] -= (float)sum_of(best.weight, term);
        }
    return most - least;
}
