/* Images magnified and summed: out = sum over sources of the spline with the source's coefficients, at points that are
 * a product of tables along rows and columns (lib/surface/spline.h): an entry has the first of the taps and their
 * weights. Images are periodic; pixels outside an image have weight 0.
 *
 * A work-group does a row: the taps along columns to `lines`, then those along the row. Vectors of eight where the taps
 * of eight columns follow one another, as they do but for a few columns of a row; a row's last vector overlaps the one
 * before. SURFACE_WIDTH 8 needs images of at least eight columns. Dimensions: one, rows, channels. */
#include "inc_vectors.h"
#include "shared_surface.h"

#ifndef SURFACE_WIDTH
#define SURFACE_WIDTH 8
#endif
/* Work-items in a group; more than one only with SURFACE_WIDTH 1. */
#ifndef SURFACE_GROUP
#define SURFACE_GROUP 1
#endif

/* one column of a row */
static inline float magnify_column(__global const float *line, __global const float *weights, int base, int x, int cols)
{
    float sum = 0.0f;
    for (int k = 0; k < HADA_SPLINE_TAPS; ++k) {
        const int at = base + k < cols ? base + k : base + k - cols;
        sum = fma(weights[k * cols + x], line[at], sum);
    }
    return sum;
}

#if SURFACE_WIDTH == 8
typedef float8 surface_real;

static inline float8 magnify_get(__global const float *p, int i)
{
    return vload8(0, p + i);
}

static inline void magnify_put(__global float *p, int i, float8 v)
{
    VECTORS_STORE8(__global, v, p + i);
}

static inline float8 magnify_columns(__global const float *line, __global const float *weights,
                                     __global const int *bases, int x, int cols)
{
    const int base = bases[x];
    float8 sum = 0.0f;
    if (bases[x + 7] == base + 7 && base + 7 + HADA_SPLINE_TAPS <= cols) {
        for (int k = 0; k < HADA_SPLINE_TAPS; ++k)
            sum = fma(vload8(0, weights + k * cols + x), vload8(0, line + base + k), sum);
        return sum;
    }
    float v[8];
    for (int i = 0; i < 8; ++i)
        v[i] = magnify_column(line, weights, bases[x + i], x + i, cols);
    return vload8(0, v);
}
#else
typedef float surface_real;

static inline float magnify_get(__global const float *p, int i)
{
    return p[i];
}

static inline void magnify_put(__global float *p, int i, float v)
{
    p[i] = v;
}

static inline float magnify_columns(__global const float *line, __global const float *weights,
                                    __global const int *bases, int x, int cols)
{
    return magnify_column(line, weights, bases[x], x, cols);
}
#endif

__kernel __attribute__((reqd_work_group_size(SURFACE_GROUP, 1, 1))) void
surface_magnify(__global const float *coefficients, __global const int *bases, __global const float *weights,
                __global float *lines, __global float *out, hada_surface_sources sources)
{
    const int rows = sources.rows, cols = sources.cols, entries = rows + cols;
    const int y = get_global_id(1), channel = get_global_id(2), first = get_local_id(0) * SURFACE_WIDTH;
    const size_t area = (size_t)rows * cols, line = ((size_t)channel * rows + y) * cols;
    const size_t all = (size_t)sources.channels * area;
    for (int s = 0; s < sources.count; ++s) {
        const size_t table = sources.table + (size_t)s * entries;
        __global const float *in = coefficients + ((size_t)sources.slot[s] * sources.channels + channel) * area;
        __global const float *w = weights + HADA_SPLINE_TAPS * table;
        const int base = bases[table + y];
        for (int x = first; x < cols; x += SURFACE_GROUP * SURFACE_WIDTH) {
            const int col = min(x, cols - SURFACE_WIDTH);
            surface_real sum = (surface_real)0.0f;
            for (int k = 0; k < HADA_SPLINE_TAPS; ++k) {
                const int row = base + k < rows ? base + k : base + k - rows;
                sum = fma((surface_real)w[k * rows + y], magnify_get(in, row * cols + col), sum);
            }
            magnify_put(lines + s * all + line, col, sum);
        }
    }
    barrier(CLK_GLOBAL_MEM_FENCE);
    for (int x = first; x < cols; x += SURFACE_GROUP * SURFACE_WIDTH) {
        const int col = min(x, cols - SURFACE_WIDTH);
        surface_real sum = (surface_real)0.0f;
        for (int s = 0; s < sources.count; ++s) {
            const size_t table = sources.table + (size_t)s * entries + rows;
            sum +=
                magnify_columns(lines + s * all + line, weights + HADA_SPLINE_TAPS * table, bases + table, col, cols);
        }
        magnify_put(out + line, col, sum);
    }
}
