/* A gradient step of the proximal step of a ridge regulariser, on the way to the least
 *
 *   1/2 |x - y|^2 + sum_k sum_p (m_k / a_k^2) psi(a_k (W_k x)_p)
 *
 * with learned filters W_k of 5 x 5 pixels of all channels (shared_ridge_weights.h), applied wherever they lie within
 * the image (A. Goujon, S. Neumayer, M. Unser, SIAM J. Imaging Sciences 17(1), 2024), and psi'(t) = t / (1 + t^2) (S.
 * Roth, M. Black, "Fields of experts", IJCV 82, 2009). With momentum (B. Polyak, 1964):
 *
 *   x' = x - length (x - y + sum_k W_k^T (m_k / a_k) psi'(a_k W_k x)) + momentum (x - the x before)
 *
 * A work-group makes a tile: the responses of some filters at a time and their share of the gradient. Tiles do not wait
 * for each other: responses across their borders are computed on both sides, in the same order. Images:
 * [image][channel][rows][cols]. */
#include "inc_vectors.h"
#include "shared_ridge.h"
#include "shared_ridge_weights.h"

/* Channels that a filter sees, 1 or 3. */
#ifndef RIDGE_CHANNELS
#define RIDGE_CHANNELS 3
#endif
/* Work-items of a group: one with vectors, or more with numbers. */
#ifndef RIDGE_GROUP
#define RIDGE_GROUP 1
#endif
/* Lanes of a vector, 8 or 16. */
#ifndef RIDGE_WIDTH
#define RIDGE_WIDTH 16
#endif
/* Pixels of a tile; with vectors, responses for its columns fill whole ones, four or a multiple. */
#ifndef RIDGE_ROWS
#define RIDGE_ROWS 28
#endif
#ifndef RIDGE_COLS
#define RIDGE_COLS 60
#endif

#define RIDGE_INLINE       static inline __attribute__((always_inline))
#define RIDGE_EACH(i, end) _Pragma("unroll") for (int i = 0; i < (end); ++i)

enum {
    SIZE = HADA_RIDGE_SIZE,
    REACH = SIZE - 1,
    SOME = HADA_RIDGE_SOME, /* filters at a time */
    TAPS = RIDGE_CHANNELS * SIZE * SIZE,
    ROWS = RIDGE_ROWS,
    COLS = RIDGE_COLS,
    /* responses that reach into a tile, and the pixels that they see */
    HIGH = ROWS + REACH,
    WIDE = COLS + REACH,
    SEEN_ROWS = HIGH + REACH,
    SEEN_COLS = WIDE + REACH
};

/* The filters of a step from number `first` on: [four of them][channel][row][column][one of the four]. */
#if RIDGE_CHANNELS == 3
#define RIDGE_FILTERS(step, first) (hada_ridge_colour + ((step)->number * HADA_RIDGE_FILTERS + (first)) * TAPS)
#else
#define RIDGE_FILTERS(step, first) (hada_ridge_grey + ((step)->number * HADA_RIDGE_FILTERS + (first)) * TAPS)
#endif

#if RIDGE_GROUP > 1
typedef float ridge_real;
#elif RIDGE_WIDTH == 16
typedef float16 ridge_real;
#define RIDGE_LOAD(p)     vload16(0, p)
#define RIDGE_STORE(v, p) VECTORS_STORE16(__private, v, p)
#else
typedef float8 ridge_real;
#define RIDGE_LOAD(p)     vload8(0, p)
#define RIDGE_STORE(v, p) VECTORS_STORE8(__private, v, p)
#endif

/* What filter k's response adds, by the derivative of its potential. */
RIDGE_INLINE ridge_real ridge_shape(ridge_real response, const hada_ridge_step *step, int k)
{
    const ridge_real t = step->in[k] * response;
    return step->out[k] * t / fma(t, t, (ridge_real)1.0f);
}

/* A pixel's step. x, gradient: at the pixel. */
RIDGE_INLINE float ridge_move(float given, float x, float before, float gradient, const hada_ridge_step *step)
{
    const float moved = fma(-step->length, x - given + gradient, x), next = fma(step->momentum, x - before, moved);
    return step->last ? max(next, 0.0f) : next;
}

#if RIDGE_GROUP == 1
/* Vectors of a row, and of them those that registers hold sums for; rows in memory, whose last vectors are read from
 * any place on. */
enum { STRIPS = WIDE / RIDGE_WIDTH, FEW = 4, SEEN_ROOM = SEEN_COLS + RIDGE_WIDTH, ROOM = WIDE + RIDGE_WIDTH };

/* x around a tile, 0 beyond the image. */
RIDGE_INLINE void ridge_see(__global const float *x, int rows, int cols, int row0, int col0,
                            float seen[RIDGE_CHANNELS][SEEN_ROWS][SEEN_ROOM])
{
    for (int c = 0; c < RIDGE_CHANNELS; ++c)
        for (int i = 0; i < SEEN_ROWS; ++i) {
            const int top = row0 - REACH + i, there = (uint)top < (uint)rows;
            __global const float *row = x + ((size_t)c * rows + (there ? top : 0)) * cols;
            for (int j = 0; j < SEEN_COLS; ++j) {
                const int left = col0 - REACH + j;
                seen[c][i][j] = there && (uint)left < (uint)cols ? row[left] : 0.0f;
            }
        }
}

/* A row of responses of filters from `first` on, shaped; 0 where first_j <= j < end_j does not hold. */
RIDGE_INLINE void ridge_respond(float seen[RIDGE_CHANNELS][SEEN_ROWS][SEEN_ROOM], int i, int first, int first_j,
                                int end_j, const hada_ridge_step *step, float response[SOME][HIGH][ROOM])
{
    for (int s = 0; s < STRIPS; s += FEW) {
        ridge_real sum[SOME][FEW];
        RIDGE_EACH (k, SOME)
            RIDGE_EACH (e, FEW)
                sum[k][e] = (ridge_real)0.0f;
        for (int c = 0; c < RIDGE_CHANNELS; ++c)
            for (int a = 0; a < SIZE; ++a) {
                const float *row = seen[c][i + a] + s * RIDGE_WIDTH;
                __constant const float *weight = RIDGE_FILTERS(step, first) + (c * SIZE + a) * SIZE * SOME;
                RIDGE_EACH (b, SIZE) {
                    ridge_real v[FEW];
                    RIDGE_EACH (e, FEW)
                        v[e] = RIDGE_LOAD(row + e * RIDGE_WIDTH + b);
                    RIDGE_EACH (k, SOME)
                        RIDGE_EACH (e, FEW)
                            sum[k][e] = fma((ridge_real)weight[b * SOME + k], v[e], sum[k][e]);
                }
            }
        RIDGE_EACH (k, SOME)
            RIDGE_EACH (e, FEW)
                RIDGE_STORE(ridge_shape(sum[k][e], step, first + k), response[k][i] + (s + e) * RIDGE_WIDTH);
    }
    for (int k = 0; k < SOME; ++k) {
        for (int j = 0; j < first_j; ++j)
            response[k][i][j] = 0.0f;
        for (int j = end_j; j < WIDE; ++j)
            response[k][i][j] = 0.0f;
    }
}

/* Adds the filters' share to a row of the gradient. */
RIDGE_INLINE void ridge_gather(float response[SOME][HIGH][ROOM], int i, int first, const hada_ridge_step *step,
                               float gradient[RIDGE_CHANNELS][ROWS][WIDE])
{
    for (int s = 0; s < STRIPS; s += FEW) {
        ridge_real sum[RIDGE_CHANNELS][FEW];
        RIDGE_EACH (c, RIDGE_CHANNELS)
            RIDGE_EACH (e, FEW)
                sum[c][e] = RIDGE_LOAD(gradient[c][i] + (s + e) * RIDGE_WIDTH);
        for (int k = 0; k < SOME; ++k)
            for (int a = 0; a < SIZE; ++a) {
                const float *row = response[k][i + a] + s * RIDGE_WIDTH;
                __constant const float *weight = RIDGE_FILTERS(step, first) + (REACH - a) * SIZE * SOME + k;
                RIDGE_EACH (b, SIZE) {
                    ridge_real v[FEW];
                    RIDGE_EACH (e, FEW)
                        v[e] = RIDGE_LOAD(row + e * RIDGE_WIDTH + b);
                    RIDGE_EACH (c, RIDGE_CHANNELS)
                        RIDGE_EACH (e, FEW)
                            sum[c][e] = fma((ridge_real)weight[(c * SIZE * SIZE + REACH - b) * SOME], v[e], sum[c][e]);
                }
            }
        RIDGE_EACH (c, RIDGE_CHANNELS)
            RIDGE_EACH (e, FEW)
                RIDGE_STORE(sum[c][e], gradient[c][i] + (s + e) * RIDGE_WIDTH);
    }
}
#endif

/* given: y; the others begin where the step says. next may be the array of `before` and, in the last step, that of y.
 * Dimensions: tiles, images. */
__kernel __attribute__((reqd_work_group_size(RIDGE_GROUP, 1, 1))) void
refine_ridge_step(__global const float *given, __global const float *x, __global const float *before,
                  __global float *next, hada_ridge_step step)
{
    const int rows = step.rows, cols = step.cols, across = (cols + COLS - 1) / COLS, tile = get_group_id(0);
    const int row0 = tile / across * ROWS, col0 = tile % across * COLS;
    const size_t each = (size_t)rows * cols, image = get_global_id(1) * RIDGE_CHANNELS * each;
    __global const float *now = x + step.x_at + image;
    given += image;
    before += step.before_at + image;
    next += step.next_at + image;
    /* responses lie at the top left pixel that their filter sees, the first ones REACH before the tile; those of
     * filters that do not lie within the image are 0 */
#if RIDGE_GROUP == 1
    float seen[RIDGE_CHANNELS][SEEN_ROWS][SEEN_ROOM], gradient[RIDGE_CHANNELS][ROWS][WIDE];
    float response[SOME][HIGH][ROOM];
    const int first_j = max(REACH - col0, 0), end_j = clamp(cols - col0, 0, (int)WIDE),
              end = min((int)ROWS, rows - row0);
    ridge_see(now, rows, cols, row0, col0, seen);
    for (int c = 0; c < RIDGE_CHANNELS; ++c)
        for (int i = 0; i < ROWS; ++i)
            for (int j = 0; j < WIDE; ++j)
                gradient[c][i][j] = 0.0f;
    for (int k = 0; k < SOME; ++k)
        for (int i = 0; i < HIGH; ++i)
            for (int j = WIDE; j < ROOM; ++j)
                response[k][i][j] = 0.0f;
    for (int first = 0; first < HADA_RIDGE_FILTERS; first += SOME) {
        for (int i = 0; i < HIGH; ++i) {
            const int top = row0 - REACH + i, inside = top >= 0 && top + REACH < rows;
            ridge_respond(seen, i, first, inside ? first_j : WIDE, inside ? end_j : 0, &step, response);
        }
        for (int i = 0; i < end; ++i)
            ridge_gather(response, i, first, &step, gradient);
    }
    for (int c = 0; c < RIDGE_CHANNELS; ++c)
        for (int i = 0; i < end; ++i) {
            const size_t at = ((size_t)c * rows + row0 + i) * cols + col0;
            for (int j = 0; j < min((int)COLS, cols - col0); ++j)
                next[at + j] =
                    ridge_move(given[at + j], seen[c][i + REACH][j + REACH], before[at + j], gradient[c][i][j], &step);
        }
#else
    __local float seen[RIDGE_CHANNELS][SEEN_ROWS][SEEN_COLS];
    __local float response[SOME][HIGH][WIDE];
    enum { EACH = ROWS * COLS / RIDGE_GROUP };
    const int item = get_local_id(0), seen_area = SEEN_ROWS * SEEN_COLS;
    float gradient[RIDGE_CHANNELS][EACH];
    RIDGE_EACH (c, RIDGE_CHANNELS)
        RIDGE_EACH (e, EACH)
            gradient[c][e] = 0.0f;
    for (int i = item; i < RIDGE_CHANNELS * seen_area; i += RIDGE_GROUP) {
        const int c = i / seen_area, y = i % seen_area / SEEN_COLS, z = i % SEEN_COLS;
        const int row = row0 - REACH + y, col = col0 - REACH + z;
        seen[c][y][z] =
            (uint)row < (uint)rows && (uint)col < (uint)cols ? now[((size_t)c * rows + row) * cols + col] : 0.0f;
    }
    for (int first = 0; first < HADA_RIDGE_FILTERS; first += SOME) {
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int i = item; i < HIGH * WIDE; i += RIDGE_GROUP) {
            const int y = i / WIDE, z = i % WIDE, row = row0 - REACH + y, col = col0 - REACH + z;
            const int inside = row >= 0 && row + REACH < rows && col >= 0 && col + REACH < cols;
            float sum[SOME];
            RIDGE_EACH (k, SOME)
                sum[k] = 0.0f;
            for (int c = 0; c < RIDGE_CHANNELS; ++c)
                for (int a = 0; a < SIZE; ++a) {
                    __constant const float *weight = RIDGE_FILTERS(&step, first) + (c * SIZE + a) * SIZE * SOME;
                    RIDGE_EACH (b, SIZE) {
                        const float v = seen[c][y + a][z + b];
                        RIDGE_EACH (k, SOME)
                            sum[k] = fma(weight[b * SOME + k], v, sum[k]);
                    }
                }
            RIDGE_EACH (k, SOME)
                response[k][y][z] = inside ? ridge_shape(sum[k], &step, first + k) : 0.0f;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        RIDGE_EACH (e, EACH) {
            const int y = (item + e * RIDGE_GROUP) / COLS, z = item % COLS;
            for (int k = 0; k < SOME; ++k)
                for (int a = 0; a < SIZE; ++a) {
                    __constant const float *weight = RIDGE_FILTERS(&step, first) + (REACH - a) * SIZE * SOME + k;
                    RIDGE_EACH (b, SIZE) {
                        const float v = response[k][y + a][z + b];
                        RIDGE_EACH (c, RIDGE_CHANNELS)
                            gradient[c][e] = fma(weight[(c * SIZE * SIZE + REACH - b) * SOME], v, gradient[c][e]);
                    }
                }
        }
    }
    RIDGE_EACH (c, RIDGE_CHANNELS)
        RIDGE_EACH (e, EACH) {
            const int y = (item + e * RIDGE_GROUP) / COLS, z = item % COLS;
            const size_t at = ((size_t)c * rows + row0 + y) * cols + col0 + z;
            if (row0 + y < rows && col0 + z < cols)
                next[at] = ridge_move(given[at], seen[c][y + REACH][z + REACH], before[at], gradient[c][e], &step);
        }
#endif
}
