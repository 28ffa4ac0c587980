/* The multiplicative step of Richardson-Lucy: x = y c / (norm (1 - weight div(grad y / |grad y|))), c the transpose of
 * the ratios, norm the transpose of the sensor's frame, taken as `least` at least. The divergence is total variation
 * (Dey et al., 2006), with forward differences that end at the edges; weight 0 leaves it out. `corrected` holds c and
 * takes x; `direction` holds the last g = x - y and takes this one. partial: the sums of g g_last, g_last^2,
 * (x - before)^2, x^2. Dimensions: bands of rows, planes. */
#include "inc_classic.h"
#include "shared_classic.h"

/* The smallest that the divisor may become. */
#define LUCY_DIVISOR 0.1f

/* One component of grad y / |grad y|. */
REFINE_INLINE refine_real unit(refine_real this, refine_real other)
{
    return this / sqrt(fma(this, this, fma(other, other, (refine_real)1e-30f)));
}

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_lucy(__global const float *start, __global float *corrected, __global const float *norms,
             __global const float *before, __global float *direction, hada_classic_bands image, float weight,
             float least, __global float *partial)
{
    REFINE_LOCAL
    const int rows = image.rows, cols = image.cols, pitch = image.pitch, band = image.band;
    const int from = get_group_id(0) * band, to = min(rows, from + band);
    const size_t plane = (size_t)get_global_id(1) * (size_t)rows * pitch;
    __global const float *y = start + plane;
    refine_real mixed = (refine_real)0.0f, last = mixed, change = mixed, size = mixed;

    for (int i = from; i < to; ++i) {
        const size_t row = (size_t)i * pitch, up = i ? row - pitch : row, down = i + 1 < rows ? row + pitch : row;
        for (int j = get_local_id(0) * REFINE_WIDTH; j < cols; j += REFINE_GROUP * REFINE_WIDTH) {
            const size_t at = plane + row + j;
            const refine_real here = image_cut(image_get(y, row + j), j, 0, cols), gone = image_get(direction, at);
            refine_real divisor = max(image_get(norms, at), least);
            if (weight > 0.0f) {
                /* forward differences here, of the row above and of the column to the left; 0 at the far edges */
                const int end = j + REFINE_WIDTH >= cols, next = end ? cols - 1 : j + REFINE_WIDTH;
                const int prev = j ? j - 1 : 0;
                const refine_real above = image_get(y, up + j), below = image_get(y, down + j);
                const refine_real left = image_left(here, y[row + prev]);
                const refine_real left_below = image_left(below, y[down + prev]);
                refine_real right = image_right(here, y[row + next]);
                refine_real above_right = image_right(above, y[up + next]);
                if (end) {
                    right = image_set(right, y[row + cols - 1], j, cols - 1);
                    above_right = image_set(above_right, y[up + cols - 1], j, cols - 1);
                }
                const refine_real dj_left = here - left, di_left = left_below - left;
                const refine_real di_here = below - here, dj_here = right - here;
                const refine_real di_up = here - above, dj_up = above_right - above;
                const refine_real div = unit(di_here, dj_here) - (i ? unit(di_up, dj_up) : (refine_real)0.0f) +
                                        unit(dj_here, di_here) - image_cut(unit(dj_left, di_left), j, 1, cols);
                divisor *= max(fma((refine_real)-weight, div, (refine_real)1.0f), LUCY_DIVISOR);
            }
            const refine_real x = image_cut(here * max(image_get(corrected, at), 0.0f) / divisor, j, 0, cols);
            const refine_real g = x - here, step = x - image_cut(image_get(before, at), j, 0, cols);
            mixed = fma(g, gone, mixed);
            last = fma(gone, gone, last);
            change = fma(step, step, change);
            size = fma(x, x, size);
            image_put(corrected, at, x);
            image_put(direction, at, g);
        }
    }
    IMAGE_PARTIAL(partial, IMAGE_PLACE(0), refine_sum(mixed))
    IMAGE_PARTIAL(partial, IMAGE_PLACE(1), refine_sum(last))
    IMAGE_PARTIAL(partial, IMAGE_PLACE(2), refine_sum(change))
    IMAGE_PARTIAL(partial, IMAGE_PLACE(3), refine_sum(size))
}
