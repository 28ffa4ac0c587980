/* Some steps of refine_tv.cl in one pass over the window: a work-item takes a band of rows and a tile of columns and
 * goes down its rows. Each step is one row behind the step before it, so all rows in use stay in the cache. Bands and
 * tiles overlap by a halo, and only values that are right are written: the same as step by step.
 *
 * Planes and duals: as in refine_tv.cl. Dimensions: tiles of bands, places. */
#include "inc_refine_tv.h"
#include "inc_vectors.h"
#include "shared_refine.h"

enum {
    STEPS = HADA_REFINE_TV_ROWS_STEPS,
    MARGIN = HADA_REFINE_TV_ROWS_MARGIN,
    ROOM = HADA_REFINE_TV_ROWS_ROOM /* values of a row of all channels, with a margin before each channel */
};

/* A step on its way down: its last row of u and of the dual. */
typedef struct tv_stage {
    float u[ROOM], p[2 * ROOM];
} tv_stage;

typedef struct tv_tile {
    int channels, cols; /* of the image */
    int first, width;   /* the tile's first column, which may be before the image, and its columns */
    int pitch;          /* from a channel to the next one */
    float theta, step, per_colour;
} tv_tile;

/* A row's pixels of the tile, 0 beyond the image. */
REFINE_INLINE void tv_fetch(__global const float *row, const tv_tile *tile, float *to)
{
    for (int x = 0; x < tile->width; x += 8) {
        const int col = tile->first + x;
        if (col >= 0 && col + 8 <= tile->cols) {
            VECTORS_STORE8(__private, vload8(0, row + col), to + x);
        } else {
            for (int k = 0; k < 8; ++k)
                to[x + k] = (uint)(col + k) < (uint)tile->cols ? row[col + k] : 0.0f;
        }
    }
}

/* 0 where a pixel has no right neighbour in the image */
REFINE_INLINE float8 tv_end(float8 v, int col, int cols)
{
    const int8 at = (int8)(0, 1, 2, 3, 4, 5, 6, 7) + col;
    return select(v, (float8)(0.0f), (at < 0) | (at >= cols - 1));
}

/* Takes a row of the dual and of w, makes u of it, and with that the next dual of the row before, in `done`.
 * begun: there is a row before; ended: this row is beyond the image, the one before its last. */
static void tv_advance(tv_stage *stage, const float *dual, const float *w, float *done, const tv_tile *tile, int begun,
                       int ended)
{
    const int channels = tile->channels, pitch = tile->pitch;
    const float share = 1.0f / (float)channels;
    for (int x = MARGIN; x < MARGIN + tile->width; x += 8) {
        const int col = tile->first + x - MARGIN, inside = col >= 0 && col + 8 < tile->cols;
        float8 square = (float8)(0.0f), sum_i = square, sum_j = square, of_mean, of_rest;
        for (int c = 0; c < channels; ++c) {
            const int at = c * pitch + x, at_i = 2 * c * pitch + x, at_j = at_i + pitch;
            const float8 here = vload8(0, stage->u + at), right = vload8(0, stage->u + at + 1);
            const float8 before_i = vload8(0, stage->p + at_i), before_j = vload8(0, stage->p + at_j);
            float8 below = here;
            if (!ended) {
                const float8 next_i = vload8(0, dual + at_i), next_j = vload8(0, dual + at_j);
                const float8 div = (next_i - before_i) + (next_j - vload8(0, dual + at_j - 1));
                below = max(fma((float8)(tile->theta), div, vload8(0, w + at)), 0.0f);
                VECTORS_STORE8(__private, below, stage->u + at);
                VECTORS_STORE8(__private, next_i, stage->p + at_i);
                VECTORS_STORE8(__private, next_j, stage->p + at_j);
            }
            if (begun) {
                const float8 qi = fma((float8)(tile->step), below - here, before_i);
                float8 qj = fma((float8)(tile->step), right - here, before_j);
                if (!inside)
                    qj = tv_end(qj, col, tile->cols);
                VECTORS_STORE8(__private, qi, done + at_i);
                VECTORS_STORE8(__private, qj, done + at_j);
                square = fma(qi, qi, fma(qj, qj, square));
                sum_i += qi;
                sum_j += qj;
            }
        }
        const float8 mean = share * fma(sum_i, sum_i, sum_j * sum_j), rest = max(square - mean, 0.0f);
        if (begun && any(fma(rest, (float8)(tile->per_colour), mean) > 1.0f)) {
            tv_shorten(mean, rest, tile->per_colour, &of_mean, &of_rest);
            sum_i *= share * (of_mean - of_rest);
            sum_j *= share * (of_mean - of_rest);
            for (int c = 0; c < channels; ++c) {
                float *qi = done + 2 * c * pitch + x, *qj = qi + pitch;
                VECTORS_STORE8(__private, fma(of_rest, vload8(0, qi), sum_i), qi);
                VECTORS_STORE8(__private, fma(of_rest, vload8(0, qj), sum_j), qj);
            }
        }
    }
}

/* p' from p after STEPS steps; fresh: p is 0; per_colour: 1 / colour^2 */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
refine_tv_rows(__global const float *given, __global const float *old, __global float *next, hada_refine_tv_rows rows,
               float theta, float step, float per_colour)
{
    const int channels = rows.window.channels, cols = rows.window.cols, area = rows.window.rows * cols;
    const int from = get_group_id(0) / rows.tiles * rows.window.band,
              to = min(rows.window.rows, from + rows.window.band);
    const int first = get_group_id(0) % rows.tiles * rows.inner, top = max(0, from - STEPS);
    const size_t image = (size_t)get_global_id(1) * channels * area;
    const tv_tile tile = {.channels = channels,
                          .cols = cols,
                          .first = first - MARGIN,
                          .width = rows.inner + 2 * MARGIN,
                          .pitch = rows.inner + 3 * MARGIN,
                          .theta = theta,
                          .step = step,
                          .per_colour = per_colour};
    float w[STEPS][ROOM], flow[2][2 * ROOM];
    tv_stage stages[STEPS];
    for (int i = 0; i < 2 * ROOM; ++i) {
        flow[0][i] = flow[1][i] = 0.0f;
        for (int k = 0; k < STEPS; ++k)
            stages[k].p[i] = stages[k].u[i / 2] = w[k][i / 2] = 0.0f;
    }
    for (int t = top; t < to + STEPS; ++t) {
        for (int c = 0; c < channels && t < rows.window.rows; ++c) {
            const size_t at = image + (size_t)c * area + (size_t)t * cols;
            __global const float *p = old + 2 * image + 2 * (size_t)c * area + (size_t)t * cols;
            float *at_i = flow[0] + 2 * c * tile.pitch + MARGIN;
            tv_fetch(given + at, &tile, w[t % STEPS] + c * tile.pitch + MARGIN);
            if (rows.fresh) {
                for (int x = 0; x < tile.width; ++x)
                    at_i[x] = at_i[tile.pitch + x] = 0.0f;
            } else {
                tv_fetch(p, &tile, at_i);
                tv_fetch(p + area, &tile, at_i + tile.pitch);
            }
        }
        for (int k = 0, row = t; k < STEPS && row >= top; ++k, --row)
            if (row <= rows.window.rows)
                tv_advance(&stages[k], flow[k % 2], w[row % STEPS], flow[(k + 1) % 2], &tile, row > top,
                           row == rows.window.rows);
        const int row = t - STEPS;
        for (int c = 0; c < 2 * channels && row >= from; ++c)
            for (int x = 0; x < rows.inner && first + x < cols; x += 8)
                wide_put_some(vload8(0, flow[STEPS % 2] + c * tile.pitch + 2 * MARGIN + x),
                              next + 2 * image + (size_t)c * area + (size_t)row * cols + first + x, cols - first - x);
    }
}
