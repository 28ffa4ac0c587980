#include "refine/shift.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"

/* Pixels along a tile; looks at pairs of pixels each way, and at pixels. */
enum { TILE = 8, PAIR = 2, FAR_LOOKS = 3, NEAR_LOOKS = 2 };

/* Cells across a window, at most and at least; pixels of a cell, at least, and at the border. */
enum { MOST_CELLS = 96, LEAST_CELLS = 12, LEAST_SCALE = 2, BORDER = 8 };

int hada_shift_scale(int rows, int cols)
{
    const int size = rows > cols ? rows : cols;
    return size > LEAST_SCALE * MOST_CELLS ? (size + MOST_CELLS - 1) / MOST_CELLS : LEAST_SCALE;
}

size_t hada_shift_floats(int planes, int rows, int cols)
{
    const int scale = hada_shift_scale(rows, cols);
    return 2 * (size_t)planes * (size_t)(rows / scale) * (size_t)(cols / scale);
}

int hada_shift_border(int scale)
{
    return scale < BORDER / PAIR ? BORDER / scale : PAIR;
}

int hada_shift_possible(int rows, int cols)
{
    const int scale = hada_shift_scale(rows, cols), least = scale * (LEAST_CELLS + 2 * hada_shift_border(scale));
    return rows >= least && cols >= least;
}

int hada_shift_weights(double shift, float weights[HADA_REFINE_MOVE_TAPS])
{
    static const double pi = 3.14159265358979323846, nothing = 1e-9;
    enum { LOBES = HADA_REFINE_MOVE_TAPS / 2 };
    const double whole = floor(-shift), part = -shift - whole;
    double sum = 0.0, w[HADA_REFINE_MOVE_TAPS];
    for (int a = 0; a < HADA_REFINE_MOVE_TAPS; a++) {
        const double x = pi * (part + LOBES - 1 - a);
        w[a] = fabs(x) < nothing ? 1.0 : fabs(x) >= pi * LOBES ? 0.0 : sin(x) / x * sin(x / LOBES) / (x / LOBES);
        sum += w[a];
    }
    for (int a = 0; a < HADA_REFINE_MOVE_TAPS; a++)
        weights[a] = (float)(w[a] / sum);
    return (int)whole - LOBES + 1;
}

static int within(int i, int count)
{
    return i < 0 ? 0 : i < count ? i : count - 1;
}

/* An image at another place, continued by its borders; `room`: as large. */
static void move(const float *in, float *out, float *room, int rows, int cols, const double by[2])
{
    float down[HADA_REFINE_MOVE_TAPS], across[HADA_REFINE_MOVE_TAPS];
    const int row0 = hada_shift_weights(by[0], down), col0 = hada_shift_weights(by[1], across);
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            float sum = 0.0f;
            for (int b = 0; b < HADA_REFINE_MOVE_TAPS; b++)
                sum += across[b] * in[i * cols + within(j + col0 + b, cols)];
            room[i * cols + j] = sum;
        }
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < cols; j++) {
            float sum = 0.0f;
            for (int a = 0; a < HADA_REFINE_MOVE_TAPS; a++)
                sum += down[a] * room[within(i + row0 + a, rows) * cols + j];
            out[i * cols + j] = sum;
        }
}

/* Sums over a tile of the slopes' products, of these with what there is more now, and of the squares of that. */
typedef struct tile {
    double slopes[3], more[2], squares;
    int pixels;
} tile;

static double left_of(const tile *t, const double d[2])
{
    const double left = t->squares + 2.0 * (d[0] * t->more[0] + d[1] * t->more[1]) + t->slopes[0] * d[0] * d[0] +
                        2.0 * t->slopes[1] * d[0] * d[1] + t->slopes[2] * d[1] * d[1];
    return fmax(left, 0.0);
}

/* The shift of so many tiles that leaves least; what a tile leaves counts nearly by its logarithm. all: the products of
 * all slopes come there, of all tiles (near NULL); or a part of them keeps the shift `near`, where a plane's tiles say
 * little. */
static void solve(const tile *tiles, int count, const double near[2], double all[3], double d[2])
{
    static const double even = 0.3, flat = 1e-6, pull = 0.05;
    enum { ROUNDS = 8 };
    const double from[2] = {near ? near[0] : 0.0, near ? near[1] : 0.0}, back = near ? pull : 0.0;
    memcpy(d, from, sizeof from);
    for (int round = 0; round < ROUNDS; round++) {
        double mean = 0.0, g[3] = {0.0, 0.0, 0.0}, b[2] = {0.0, 0.0};
        for (int t = 0; t < count; t++)
            mean += left_of(&tiles[t], d) / count;
        for (int t = 0; t < count; t++) {
            const double left = even * mean + left_of(&tiles[t], d), weight = left > 0.0 ? mean / left : 0.0;
            for (int k = 0; k < 3; k++)
                g[k] += weight * tiles[t].slopes[k];
            for (int k = 0; k < 2; k++)
                b[k] += weight * tiles[t].more[k];
        }
        if (!near)
            memcpy(all, g, sizeof g);
        for (int k = 0; k < 2; k++)
            b[k] -= back * (all[k] * from[0] + all[k + 1] * from[1]);
        for (int k = 0; k < 3; k++)
            g[k] += back * all[k];
        const double det = g[0] * g[2] - g[1] * g[1];
        memcpy(d, from, sizeof from);
        if (!(det > flat * g[0] * g[2]))
            return;
        d[0] = (g[1] * b[1] - g[2] * b[0]) / det;
        d[1] = (g[1] * b[0] - g[0] * b[1]) / det;
    }
}

/* Tiles are [plane][count]. */
static void spread_of(const tile *tiles, int planes, int count, const double d[2], hada_shift *found)
{
    double sum = 0.0, squares = 0.0, most = 0.0;
    int shown = 0;
    for (int t = 0; t < count; t++) {
        double left = 0.0;
        int pixels = 0;
        for (int z = 0; z < planes; z++) {
            left += left_of(&tiles[z * count + t], d);
            pixels += tiles[z * count + t].pixels;
        }
        if (2 * pixels >= TILE * TILE) {
            left /= pixels;
            sum += left;
            squares += left * left;
            most = fmax(most, left);
            shown++;
        }
    }
    found->spread = sum > 0.0 ? squares * shown / (sum * sum) : 1.0;
    found->most = sum > 0.0 ? most * shown / sum : 1.0;
}

/* How much brighter it is now. */
static double gain_of(const float *here, const float *now, int rows, int cols, int border)
{
    double products = 0.0, squares = 0.0;
    for (int i = border; i < rows - border; i++)
        for (int j = border; j < cols - border; j++) {
            products += (double)here[i * cols + j] * now[i * cols + j];
            squares += (double)here[i * cols + j] * here[i * cols + j];
        }
    return squares > 0.0 ? products / squares : 1.0;
}

/* here: planes as they were before, where they are taken to be now; `sums`, two: of them, and of planes now. A pixel
 * tells of the plane that is brightest there. */
static void add_up(const float *here, const float *sums, int planes, int rows, int cols, int border, int wide,
                   int count, tile *tiles)
{
    const size_t area = (size_t)rows * (size_t)cols;
    const double gain = gain_of(sums, sums + area, rows, cols, border);
    for (int i = border; i < rows - border; i++)
        for (int j = border; j < cols - border; j++) {
            const size_t at = (size_t)i * (size_t)cols + (size_t)j;
            int brightest = 0;
            for (int z = 1; z < planes; z++)
                brightest = here[(size_t)z * area + at] > here[(size_t)brightest * area + at] ? z : brightest;
            tile *t = &tiles[brightest * count + (i - border) / TILE * wide + (j - border) / TILE];
            const double down = 0.5 * gain * ((double)sums[at + (size_t)cols] - sums[at - (size_t)cols]);
            const double across = 0.5 * gain * ((double)sums[at + 1] - sums[at - 1]);
            const double more = sums[area + at] - gain * sums[at];
            t->slopes[0] += down * down;
            t->slopes[1] += down * across;
            t->slopes[2] += across * across;
            t->more[0] += down * more;
            t->more[1] += across * more;
            t->squares += more * more;
            t->pixels++;
        }
}

static void sum_of(const float *images, int planes, size_t area, float *sum)
{
    for (size_t i = 0; i < area; i++) {
        sum[i] = 0.0f;
        for (int z = 0; z < planes; z++)
            sum[i] += images[(size_t)z * area + i];
    }
}

/* A look: adds what it finds, at most two pixels each way. */
static hada_status look(const float *before, const float *now, int planes, int rows, int cols, int border,
                        hada_shift *found, hada_error *err)
{
    static const double most = 2.0;
    const int high = (rows - 2 * border + TILE - 1) / TILE, wide = (cols - 2 * border + TILE - 1) / TILE;
    const int count = high * wide;
    const size_t area = (size_t)rows * (size_t)cols;
    float *here = NULL, *sums;
    tile *tiles = NULL;
    double d[2], all[3];
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(here, (size_t)(planes + 2) * area, "the motion of a scene", err));
    HADA_TRY_OR_DONE(HADA_NEW(tiles, (size_t)(planes * count), "the motion of a scene", err));
    sums = here + (size_t)planes * area;
    for (int z = 0; z < planes; z++)
        move(before + (size_t)z * area, here + (size_t)z * area, sums, rows, cols, found->by);
    sum_of(here, planes, area, sums);
    sum_of(now, planes, area, sums + area);
    add_up(here, sums, planes, rows, cols, border, wide, count, tiles);
    solve(tiles, planes * count, NULL, all, d);
    spread_of(tiles, planes, count, d, found);
    found->apart = 0.0;
    for (int z = 0; planes > 1 && z < planes; z++) {
        double own[2];
        solve(tiles + z * count, count, d, all, own);
        found->apart = fmax(found->apart, hypot(own[0] - d[0], own[1] - d[1]));
    }
    for (int k = 0; k < 2; k++)
        found->by[k] += fmax(-most, fmin(d[k], most));
done:
    free(here);
    free(tiles);
    return status;
}

/* Means over pairs of pixels each way. */
static void pair_up(const float *in, float *out, int planes, int rows, int cols)
{
    const int high = rows / PAIR, wide = cols / PAIR;
    for (int z = 0; z < planes; z++)
        for (int i = 0; i < high; i++)
            for (int j = 0; j < wide; j++) {
                const float *from = in + ((size_t)z * (size_t)rows + (size_t)(PAIR * i)) * (size_t)cols + PAIR * j;
                *out++ = 0.25f * (from[0] + from[1] + from[cols] + from[cols + 1]);
            }
}

hada_status hada_shift_find(const float *before, const float *now, int planes, int rows, int cols, int border, int far,
                            hada_shift *found, hada_error *err)
{
    const size_t half = (size_t)planes * (size_t)(rows / PAIR) * (size_t)(cols / PAIR);
    float *pairs = NULL;
    hada_status status = HADA_OK;
    if (far) {
        HADA_TRY_OR_DONE(HADA_NEW(pairs, 2 * half, "the motion of a scene", err));
        pair_up(before, pairs, planes, rows, cols);
        pair_up(now, pairs + half, planes, rows, cols);
        for (int k = 0; k < 2; k++)
            found->by[k] /= PAIR;
        for (int i = 0; i < FAR_LOOKS; i++)
            HADA_TRY_OR_DONE(
                look(pairs, pairs + half, planes, rows / PAIR, cols / PAIR, (border + 1) / PAIR, found, err));
        for (int k = 0; k < 2; k++)
            found->by[k] *= PAIR;
    }
    for (int i = 0; i < (far ? NEAR_LOOKS : 1); i++)
        HADA_TRY_OR_DONE(look(before, now, planes, rows, cols, border, found, err));
done:
    free(pairs);
    return status;
}
