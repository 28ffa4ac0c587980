/* The splits of ADMM on the planes, in one pass: non-negativity and total variation, with their duals.
 *
 * For a split w = A x with scaled dual d, ADMM takes w = prox(A x + d), then d += A x - w with the next x. Keeping
 * s = d - w alone, a step is s' = s + A x - prox(s + 2 A x), and what the next least-squares step needs is -A^T s':
 *     planes:    A = 1, prox = max(0, .) within the support and 0 outside:  r' = min(r + 2x, 0) - x;  r + x outside
 *     gradients: A = (x[i-1] - x[i], x[j-1] - x[j]), round the edges, prox = soft threshold:
 *                t' = clamp(t + 2 A x, -theta, theta) - A x
 *     q = -mu3 r' - mu2 A^T t'
 * `x` is the new planes; `old` holds those before and takes q; r is in place; t goes from t_old to t_new ([plane][2]
 * images), since neighbours read it. has_tv 0: no gradients.
 * Dimensions: bands of rows, planes. partial: the sums of (x - old)^2, then those of x^2. */
#include "inc_classic.h"
#include "shared_classic.h"

REFINE_INLINE refine_real dual_step(refine_real t, refine_real ax, float theta)
{
    return clamp(fma(2.0f, ax, t), -theta, theta) - ax;
}

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_split(__global const float *planes, __global float *old, __global const float *t_old, __global float *t_new,
              __global float *duals, hada_classic_bands image, hada_classic_splits splits, __global float *partial)
{
    REFINE_LOCAL
    const int rows = image.rows, cols = image.cols, pitch = image.pitch, band = image.band, has_tv = splits.has_tv;
    const float mu2 = splits.gradient, mu3 = splits.planes, theta = splits.threshold;
    const int from = get_group_id(0) * band, to = min(rows, from + band);
    const size_t distance = (size_t)rows * pitch, plane = (size_t)get_global_id(1) * distance;
    __global const float *x = planes + plane;
    __global float *q = old + plane, *r = duals + plane;
    __global const float *ti = t_old + (has_tv ? 2 * plane : 0), *tj = ti + (has_tv ? distance : 0);
    __global float *new_ti = t_new + (has_tv ? 2 * plane : 0), *new_tj = new_ti + (has_tv ? distance : 0);
    refine_real change = (refine_real)0.0f, size = change;

    for (int i = from; i < to; ++i) {
        const size_t row = (size_t)i * pitch, up = (size_t)(i ? i - 1 : rows - 1) * pitch,
                     down = (size_t)(i + 1 < rows ? i + 1 : 0) * pitch;
        const int supported = i >= splits.row0 && i < splits.row1;
        for (int j = get_local_id(0) * REFINE_WIDTH; j < cols; j += REFINE_GROUP * REFINE_WIDTH) {
            const refine_real here = image_get(x, row + j), step = here - image_get(q, row + j);
            const refine_real kept = image_get(r, row + j), sum = kept + here;
            change = fma(step, step, change);
            size = fma(here, here, size);
            /* min(r + 2x, 0) - x = r + x - max(r + 2x, 0) */
            refine_real dual = sum - image_cut(max(sum + here, 0.0f), j, supported ? splits.col0 : cols, splits.col1);
            image_put(r, row + j, dual);
            dual *= -mu3;
            if (has_tv) {
                const int last = j + REFINE_WIDTH >= cols;
                const refine_real tj_here = image_get(tj, row + j);
                const refine_real left = image_left(here, x[row + (j ? j - 1 : cols - 1)]);
                refine_real right = image_right(here, x[row + (last ? 0 : j + REFINE_WIDTH)]);
                refine_real tj_right = image_right(tj_here, tj[row + (last ? 0 : j + REFINE_WIDTH)]);
                if (last) {
                    right = image_set(right, x[row], j, cols - 1);
                    tj_right = image_set(tj_right, tj[row], j, cols - 1);
                }
                const refine_real ti_here = dual_step(image_get(ti, row + j), image_get(x, up + j) - here, theta);
                const refine_real ti_down = dual_step(image_get(ti, down + j), here - image_get(x, down + j), theta);
                const refine_real tj_here_new = dual_step(tj_here, left - here, theta);
                const refine_real tj_right_new = dual_step(tj_right, here - right, theta);
                image_put(new_ti, row + j, image_cut(ti_here, j, 0, cols));
                image_put(new_tj, row + j, image_cut(tj_here_new, j, 0, cols));
                dual -= mu2 * (ti_down - ti_here + tj_right_new - tj_here_new);
            }
            image_put(q, row + j, image_cut(dual, j, 0, cols));
        }
    }
    IMAGE_PARTIAL(partial, IMAGE_PLACE(0), refine_sum(change))
    IMAGE_PARTIAL(partial, IMAGE_PLACE(1), refine_sum(size))
}
