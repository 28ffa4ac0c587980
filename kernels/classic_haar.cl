/* Soft thresholds of Haar wavelets. The plain transform (plain 1) is orthonormal but for the edges; the
 * translation-invariant one is the mean over all shifts of the plain one: R. Coifman and D. Donoho,
 * "Translation-invariant de-noising", 1995, done a level at a time with holes ("a trous").
 *
 * Level l works with spacing s = 2^l. a_0 is the image, a_(l+1) the mean over 2 x 2 pixels of a_l, s apart. The way
 * down makes all a_l; the way up what thresholding changes, y_l = (threshold(d) - d of this level, synthesised) +
 * y_(l+1), and the result is a_0 + y_0. Pixels beyond an edge are the edge's. Coefficients here are means: those of the
 * orthonormal transform over 2^(l+1). Offsets count floats. Dimensions: bands of rows, planes. */
#include "inc_classic.h"
#include "shared_classic.h"

/* The partners of pixel i, s before and s after it; in the plain transform both are in its own block. */
REFINE_INLINE int haar_before(int i, int s, int plain)
{
    return plain ? i & ~s : max(i - s, 0);
}

REFINE_INLINE int haar_after(int i, int s, int n, int plain)
{
    return min(plain ? i | s : i + s, n - 1);
}

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void classic_haar_down(__global const float *fine,
                                                                                          __global float *result,
                                                                                          hada_classic_level level,
                                                                                          hada_classic_bands image)
{
    const int rows = image.rows, cols = image.cols, pitch = image.pitch, band = image.band;
    const int s = level.spacing, plain = level.decimated;
    __global const float *in = fine + level.fine;
    __global float *out = result + level.result;
    const int from = get_group_id(0) * band, to = min(rows, from + band);
    const size_t plane = (size_t)get_global_id(1) * (size_t)rows * pitch;
    for (int i = from; i < to; ++i) {
        const int other = plain ? haar_before(i, s, 1) : i;
        __global const float *a = in + plane + (size_t)other * pitch;
        __global const float *b = in + plane + (size_t)haar_after(i, s, rows, plain) * pitch;
        __global float *to_row = out + plane + (size_t)i * pitch;
        int j = get_local_id(0);
#if REFINE_WIDTH == 8
        for (; !plain && j + 8 + s <= cols; j += 8) {
            const float8 sum = image_get(a, j) + image_get(a, j + s) + image_get(b, j) + image_get(b, j + s);
            image_put(to_row, j, 0.25f * sum);
        }
#endif
        for (; j < cols; j += REFINE_GROUP) {
            const int left = plain ? haar_before(j, s, 1) : j, right = haar_after(j, s, cols, plain);
            to_row[j] = 0.25f * (a[left] + a[right] + b[left] + b[right]);
        }
    }
}

/* What thresholding the block p q / r t changes at its upper left pixel (h and v: 1), or (-1) at its right, lower ones.
 */
#define HAAR_BLOCK(p, q, r, t, h, v)                                                                                   \
    (h * clamp(p - q + r - t, -edge, edge) + v * clamp(p + q - r - t, -edge, edge) +                                   \
     h * v * clamp(p - q - r + t, -edge, edge))

/* y_l from a_l and, where `more`, y_(l+1); at level 0 (`image`) a_0 is added. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_haar_up(__global const float *fine, __global const float *coarser, __global float *result,
                hada_classic_level level, __global const float *alpha, float weight, uint channels,
                hada_classic_bands image)
{
    const int rows = image.rows, cols = image.cols, pitch = image.pitch, band = image.band;
    const int s = level.spacing, plain = level.decimated, more = level.more, whole = level.image;
    __global const float *in = fine + level.fine, *coarse = coarser + level.coarse;
    __global float *out = result + level.result;
    const int from = get_group_id(0) * band, to = min(rows, from + band);
    const size_t plane = (size_t)get_global_id(1) * (size_t)rows * pitch;
    /* 4 times the coefficients' threshold: the block's sums are not divided by 4 */
    const float edge = 4.0f * weight * alpha[get_global_id(1) % channels] / (float)(2 * s);
    for (int i = from; i < to; ++i) {
        const size_t before = plane + (size_t)haar_before(i, s, plain) * pitch, row = plane + (size_t)i * pitch,
                     after = plane + (size_t)haar_after(i, s, rows, plain) * pitch;
        int j = get_local_id(0);
        if (plain) {
            for (; j < cols; j += REFINE_GROUP) {
                const int left = haar_before(j, s, 1), right = haar_after(j, s, cols, 1);
                const float h = j == left ? 1.0f : -1.0f, v = i == haar_before(i, s, 1) ? 1.0f : -1.0f;
                const float p = in[before + left], q = in[before + right], r = in[after + left], t = in[after + right];
                const float change = -0.25f * HAAR_BLOCK(p, q, r, t, h, v);
                out[row + j] = change + (more ? coarse[row + j] : 0.0f) + (whole ? in[row + j] : 0.0f);
            }
            continue;
        }
#if REFINE_WIDTH == 8
        /* the edges, then the inner pixels eight by eight; the last eight may overlap */
        const int inner = cols - 2 * s >= 8;
        for (int k = 0; inner && k < cols - 2 * s; k += 8) {
            const int at = min(s + k, cols - s - 8);
            const float8 p = image_get(in, before + at - s), q = image_get(in, before + at),
                         r = image_get(in, before + at + s);
            const float8 t = image_get(in, row + at - s), u = image_get(in, row + at), w = image_get(in, row + at + s);
            const float8 x = image_get(in, after + at - s), y = image_get(in, after + at),
                         z = image_get(in, after + at + s);
            float8 change = -0.25f * (HAAR_BLOCK(p, q, t, u, -1.0f, -1.0f) + HAAR_BLOCK(q, r, u, w, 1.0f, -1.0f) +
                                      HAAR_BLOCK(t, u, x, y, -1.0f, 1.0f) + HAAR_BLOCK(u, w, y, z, 1.0f, 1.0f));
            if (more)
                change += image_get(coarse, before + at - s) + image_get(coarse, before + at) +
                          image_get(coarse, row + at - s) + image_get(coarse, row + at);
            image_put(out, row + at, whole ? fma(change, 0.25f, u) : 0.25f * change);
        }
#else
        const int inner = 0;
#endif
        for (; j < cols; j += REFINE_GROUP) {
            if (inner && j >= s && j < cols - s)
                j = cols - s; /* only lanes take this branch */
            const int left = haar_before(j, s, 0), right = haar_after(j, s, cols, 0);
            const float p = in[before + left], q = in[before + j], r = in[before + right];
            const float t = in[row + left], u = in[row + j], w = in[row + right];
            const float x = in[after + left], y = in[after + j], z = in[after + right];
            float change = -0.25f * (HAAR_BLOCK(p, q, t, u, -1.0f, -1.0f) + HAAR_BLOCK(q, r, u, w, 1.0f, -1.0f) +
                                     HAAR_BLOCK(t, u, x, y, -1.0f, 1.0f) + HAAR_BLOCK(u, w, y, z, 1.0f, 1.0f));
            if (more)
                change += coarse[before + left] + coarse[before + j] + coarse[row + left] + coarse[row + j];
            out[row + j] = whole ? fma(change, 0.25f, u) : 0.25f * change;
        }
    }
}
