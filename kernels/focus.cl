/* Depth from focus: a measure of contrast of the planes at each pixel, averaged by a window (focus_measure across it,
 * focus_select down it), the running best over the planes (focus_select), and distances and images from it
 * (focus_finish).
 *
 * Vectors of FOCUS_WIDTH pixels side by side in work-groups of one, or one pixel in groups of FOCUS_GROUP. Rows of
 * responses and of the running best are `pitch` apart, whole vectors, so that only planes have an incomplete last
 * vector.
 * Planes: float [plane][channel][row][col]. */
#include "inc_focus.h"

/* Luminance (Rec. 709) of LIGHT_ROWS rows from `top` on and `wide` columns from `left` on; the image's edge pixels are
 * repeated. */
FOCUS_INLINE void make_light(__global const float *plane, int channels, int rows, int cols, int top, int left, int wide,
                             __local float *light)
{
    const size_t pixels = (size_t)rows * cols;
    for (int i = 0; i < LIGHT_ROWS; i++) {
        __global const float *row = plane + (size_t)clamp(top + i, 0, rows - 1) * cols;
        for (int x = FOCUS_WIDTH * get_local_id(0); x < wide; x += FOCUS_WIDTH * FOCUS_GROUP) {
            real value = load_row(row, left + x, cols);
            if (channels == 3)
                value = 0.2126f * value + 0.7152f * load_row(row + pixels, left + x, cols) +
                        0.0722f * load_row(row + 2 * pixels, left + x, cols);
            STORE(value, light + i * LIGHT_PITCH + x);
        }
    }
}

/* Responses from luminance that begins a row and a column earlier: the squared edge response (Sobel) and, or, the
 * intensity. `noise`: where the absolute response of Immerkaer's noise operator is counted at the image's inner pixels.
 * Column x here is column left + x of the image; the tile's own columns are left + radius .. end - 1. */
FOCUS_INLINE void make_edges(__local const float *light, int measure, int rows, int cols, int top, int left, int radius,
                             int end, int wide, __local float *contrast, __local float *energy, focus_bins noise)
{
    for (int i = 0; i < FOCUS_ROWS; i++) {
        const int row = top + i, counts = row > 0 && row < rows - 1;
        for (int x = FOCUS_WIDTH * get_local_id(0); x < wide; x += FOCUS_WIDTH * FOCUS_GROUP) {
            __local const float *up = light + i * LIGHT_PITCH + x, *here = up + LIGHT_PITCH, *down = here + LIGHT_PITCH;
            const real a = LOAD(up), b = LOAD(up + 1), c = LOAD(up + 2), d = LOAD(here), e = LOAD(here + 1),
                       f = LOAD(here + 2), g = LOAD(down), h = LOAD(down + 1), j = LOAD(down + 2);
            if (measure & CONTRAST) {
                const real across = (c - a + 2.0f * (f - d) + j - g) * 0.125f,
                           along = (g - a + 2.0f * (h - b) + j - c) * 0.125f;
                STORE(fma(across, across, along * along), contrast + i * EDGES_PITCH + x);
            }
            if (measure & ENERGY)
                STORE(max(e, (real)0.0f), energy + i * EDGES_PITCH + x);
            if (counts)
                count_values(noise, fabs(a + c + g + j - 2.0f * (b + h + d + f) + 4.0f * e), left + x,
                             max(left + radius, 1), min(end, cols - 1));
        }
    }
}

/* The window across `wide` columns of FOCUS_ROWS rows of responses, of which `count` are in the image; four rows at a
 * time, so that sums do not wait for each other. */
FOCUS_INLINE void window_across(__local const float *edges, __global const float *weights, int radius, int count,
                                int wide, int pitch, __global float *out)
{
    for (int i = 0; i < count; i += 4)
        for (int x = FOCUS_WIDTH * get_local_id(0); x < wide; x += FOCUS_WIDTH * FOCUS_GROUP) {
            __local const float *from = edges + i * EDGES_PITCH + x;
            real a = (real)0.0f, b = a, c = a, d = a;
            for (int k = 0; k <= 2 * radius; k++, from++) {
                const real weight = (real)weights[k];
                a = fma(weight, LOAD(from), a);
                b = fma(weight, LOAD(from + EDGES_PITCH), b);
                c = fma(weight, LOAD(from + 2 * EDGES_PITCH), c);
                d = fma(weight, LOAD(from + 3 * EDGES_PITCH), d);
            }
            __global float *to = out + (size_t)i * pitch + x;
            STORE(a, to);
            if (i + 1 < count)
                STORE(b, to + pitch);
            if (i + 2 < count)
                STORE(c, to + 2 * pitch);
            if (i + 3 < count)
                STORE(d, to + 3 * pitch);
        }
}

/* Responses of the planes of a batch, averaged across. measure: CONTRAST, ENERGY or COMBINED (both).
 * response[plane][kind: contrast, energy][rows + 2][pitch]: the image's rows and one more at either end, which is used
 * for all rows beyond. bins[group][0]: counts of the noise operator. */
__kernel __attribute__((reqd_work_group_size(FOCUS_GROUP, 1, 1))) void
focus_measure(__global const float *planes, const hada_focus_batch batch, const hada_focus_image image,
              __global const float *weights, __global float *response, __global int *bins)
{
    __local float light[LIGHT_ROWS * LIGHT_PITCH];
    __local float contrast[FOCUS_ROWS * EDGES_PITCH], energy[FOCUS_ROWS * EDGES_PITCH];
    LOCAL_COUNTS
    const focus_bins noise = BINS_OF(OWN_BINS(bins));
    BEGIN_COUNTS
    const int channels = image.channels, rows = image.rows, cols = image.cols, pitch = image.pitch;
    const int radius = image.radius, measure = image.measure;
    const int down = (rows + 2 + FOCUS_ROWS - 1) / FOCUS_ROWS, across = (cols + FOCUS_COLS - 1) / FOCUS_COLS;
    const size_t whole_image = (size_t)(rows + 2) * pitch;
    FOR_TILES (t, batch.count * down * across) {
        const int plane = t / (down * across), i = t / across % down * FOCUS_ROWS, x = t % across * FOCUS_COLS;
        const int end = min(x + FOCUS_COLS, cols), wide = end - x + 2 * radius;
        __global float *out =
            response + (size_t)plane * (measure == COMBINED ? 2 : 1) * whole_image + (size_t)i * pitch + x;
        make_light(planes + batch.offset + (size_t)batch.place[plane] * channels * rows * cols, channels, rows, cols,
                   i - 2, x - radius - 1, wide + 2, light);
        WAIT;
        make_edges(light, measure, rows, cols, i - 1, x - radius, radius, end, wide, contrast, energy, noise);
        WAIT;
        const int height = min(FOCUS_ROWS, rows + 2 - i);
        if (measure & CONTRAST)
            window_across(contrast, weights, radius, height, end - x, pitch, out);
        if (measure & ENERGY)
            window_across(energy, weights, radius, height, end - x, pitch,
                          out + (measure == COMBINED ? whole_image : 0));
    }
    END_COUNTS(OWN_BINS(bins))
}

/* The window down: image row r and its neighbours, at FOCUS_SIDE vectors of a response. */
FOCUS_INLINE void window_down(__global const float *response, __global const float *weights, int radius, int r,
                              int rows, int pitch, real *sum)
{
    for (int v = 0; v < FOCUS_SIDE; v++)
        sum[v] = (real)0.0f;
    for (int k = 0; k <= 2 * radius; k++) {
        __global const float *from = response + (size_t)clamp(r + 1 - radius + k, 0, rows + 1) * pitch;
        const real weight = (real)weights[k];
        EACH_SIDE
        for (int v = 0; v < FOCUS_SIDE; v++)
            sum[v] = fma(weight, LOAD(from + v * FOCUS_WIDTH), sum[v]);
    }
}

/* The state kept from push to push: images of rows x pitch, in this order, then the all-in-focus sums of each channel.
 * Best measure and its depth, the measures of the depths before and after it (0 where these do not compete), the
 * largest measure of a depth that is not next to it, the measure of the last depth, and the sum of all measures. */
enum { BEST, BEST_DEPTH, BEFORE, AFTER, SECOND, LAST, WEIGHTS, FUSED };

/* The running best over the planes of a batch, and the all-in-focus sums. In every plane but the first, each pixel has
 * one loser: the smaller of the new measure and the best so far; bins[group][1] counts them. The mean weighted by the
 * measures is updated plane by plane, which works at every scale; where every measure so far is 0, it is the plain
 * mean. */
__kernel __attribute__((reqd_work_group_size(FOCUS_GROUP, 1, 1))) void
focus_select(__global const float *response, __global const float *weights, __global const float *planes,
             const hada_focus_batch batch, const hada_focus_image image, const hada_focus_past past,
             __global float *kept, __global int *bins)
{
    const int channels = image.channels, rows = image.rows, cols = image.cols, pitch = image.pitch;
    const int radius = image.radius, measure = image.measure, count = batch.count;
    const int seen = past.seen, last_depth = past.last_depth, weighted = past.weighted;
    const size_t pixels = (size_t)rows * cols, one = (size_t)rows * pitch, whole_image = (size_t)(rows + 2) * pitch;
    const int down = (rows + FOCUS_BAND - 1) / FOCUS_BAND, step = FOCUS_SIDE * FOCUS_WIDTH * FOCUS_GROUP,
              across = (cols + step - 1) / step, kinds = measure == COMBINED ? 2 : 1;
    LOCAL_COUNTS
    const focus_bins losers = BINS_OF(OWN_BINS(bins) + HADA_FOCUS_BINS);
    BEGIN_COUNTS
    __global const float *first_plane = planes + batch.offset;
    int places[HADA_FOCUS_DEPTHS], depths[HADA_FOCUS_DEPTHS];
    FOCUS_COPY(places, batch.place);
    FOCUS_COPY(depths, batch.depth);
    FOR_TILES (t, down * across) {
        const int first = t / across * FOCUS_BAND, x = t % across * step + FOCUS_SIDE * FOCUS_WIDTH * get_local_id(0);
        for (int r = first; r < min(first + FOCUS_BAND, rows) && x < cols; r++) {
            real value[HADA_FOCUS_DEPTHS]
                      [FOCUS_SIDE]; /* the measure, then the plane's share in the all-in-focus image */
            for (int p = 0; p < count; p++) {
                __global const float *from = response + (size_t)p * kinds * whole_image + x;
                window_down(from, weights, radius, r, rows, pitch, value[p]);
                if (measure == COMBINED) {
                    real energy[FOCUS_SIDE];
                    window_down(from + whole_image, weights, radius, r, rows, pitch, energy);
                    for (int v = 0; v < FOCUS_SIDE; v++)
                        value[p][v] = sqrt(value[p][v]) * energy[v];
                }
            }
            __global float *at = kept + (size_t)r * pitch + x;
            for (int v = 0; v < FOCUS_SIDE; v++, at += FOCUS_WIDTH) {
                real best = (real)0.0f, best_depth = best, before = best, after = best, second = best, last = best,
                     total = best;
                if (seen) {
                    best = LOAD(at);
                    best_depth = LOAD(at + BEST_DEPTH * one);
                    before = LOAD(at + BEFORE * one);
                    after = LOAD(at + AFTER * one);
                    second = LOAD(at + SECOND * one);
                    last = LOAD(at + LAST * one);
                    total = LOAD(at + WEIGHTS * one);
                }
                for (int p = 0; p < count; p++) {
                    const real now = value[p][v], number = (real)(float)depths[p];
                    if (seen + p == 0) {
                        best = now;
                        best_depth = number;
                    } else {
                        const int adjacent = (p ? depths[p - 1] : last_depth) == depths[p] - 1;
                        const whole next = best_depth == number - 1.0f, wins = now > best; /* ties: the nearer depth */
                        count_values(losers, max(min(now, best), (real)0.0f), x + v * FOCUS_WIDTH, 0, cols);
                        second = select(select(max(second, now), second, next), select(best, max(second, before), next),
                                        wins);
                        before = select(before, adjacent ? last : (real)0.0f, wins);
                        after = select(select(after, now, next), (real)0.0f, wins);
                        best = select(best, now, wins);
                        best_depth = select(best_depth, number, wins);
                    }
                    last = now;
                    if (weighted) {
                        total += now;
                        value[p][v] = select((real)(1.0f / (float)(seen + p + 1)), now / total, total > (real)0.0f);
                    }
                }
                STORE(best, at);
                STORE(best_depth, at + BEST_DEPTH * one);
                STORE(before, at + BEFORE * one);
                STORE(after, at + AFTER * one);
                STORE(second, at + SECOND * one);
                STORE(last, at + LAST * one);
                STORE(total, at + WEIGHTS * one);
            }
            for (int c = 0; c < channels; c++) {
                __global const float *row = first_plane + (size_t)c * pixels + (size_t)r * cols;
                at = kept + (FUSED + c) * one + (size_t)r * pitch + x;
                for (int v = 0; v < FOCUS_SIDE && x + v * FOCUS_WIDTH < cols; v++, at += FOCUS_WIDTH) {
                    real fused = seen ? LOAD(at) : (real)0.0f;
                    for (int p = 0; p < count; p++) {
                        const real light =
                            load_row(row + (size_t)places[p] * channels * pixels, x + v * FOCUS_WIDTH, cols);
                        fused = seen + p == 0 ? light
                                : weighted    ? fused + value[p][v] * (light - fused)
                                              : fused + light;
                    }
                    STORE(fused, at);
                }
            }
        }
    }
    END_COUNTS(OWN_BINS(bins) + HADA_FOCUS_BINS)
}

/* counts[i]: the sum over the groups' bins; the noise operator's, then the losers'. Each group takes `share` of them.
 */
__kernel __attribute__((reqd_work_group_size(FOCUS_GROUP, 1, 1))) void
focus_counts(__global const int *bins, const int groups, const int share, __global int *counts)
{
    const int first = share * (int)get_group_id(0);
    for (int i = first + FOCUS_WIDTH * get_local_id(0); i < first + share; i += FOCUS_WIDTH * FOCUS_GROUP) {
        whole sum = LOAD(bins + i);
        for (int g = 1; g < groups; g++)
            sum += LOAD(bins + (size_t)g * 2 * HADA_FOCUS_BINS + i);
        STORE(sum, counts + i);
    }
}

/* 1/z between the depths' 1/z by the vertex of the parabola through the measures before, at and after the best depth,
 * less `base` (the level of losing depths). At the ends of the list nothing is refined. */
FOCUS_INLINE real between_depths(real best, real before, real after, real best_depth, int depths, float base,
                                 __global const float *inverse_distances)
{
    const whole depth = TO_WHOLE(best_depth);
    const real left = max(before - base, (real)0.0f), right = max(after - base, (real)0.0f),
               bend = 2.0f * (best - base) - left - right;
    const whole inside = (depth > 0) & (depth < depths - 1) & (bend > 0.0f);
    const real step = select((real)0.0f, clamp(0.5f * (right - left) / bend, (real)-0.5f, (real)0.5f), inside);
    const whole other = clamp(select(depth + 1, depth - 1, step < 0.0f), (whole)0, (whole)(depths - 1));
    const real here = look_up(inverse_distances, depth), there = look_up(inverse_distances, other);
    /* without a step the distance itself, which may be 0 (its inverse infinite) */
    return select(mix(here, there, fabs(step)), here, step == 0.0f);
}

/* The sum of the all-in-focus image over all channels, HADA_FOCUS_NEAR pixels to every side of row r, columns x .. */
FOCUS_INLINE real light_near(__global const float *fused, const hada_focus_image image, int r, int x)
{
    const size_t one = (size_t)image.rows * image.pitch;
    real sum = (real)0.0f;
    for (int c = 0; c < image.channels; c++)
        for (int i = r - HADA_FOCUS_NEAR; i <= r + HADA_FOCUS_NEAR; i++) {
            __global const float *row = fused + c * one + (size_t)clamp(i, 0, image.rows - 1) * image.pitch;
            for (int k = x - HADA_FOCUS_NEAR; k <= x + HADA_FOCUS_NEAR; k++)
                sum += load_row(row, k, image.cols);
        }
    return sum;
}

/* The distance of each pixel, row by row; NaN where it has none. The all-in-focus image from its sums. */
__kernel __attribute__((reqd_work_group_size(FOCUS_GROUP, 1, 1))) void
focus_finish(__global const float *kept, __global const float *inverse_distances, const int depths,
             const hada_focus_image image, const hada_focus_limits limits, __global float *all_in_focus,
             const ulong all_in_focus_offset, __global float *distance, const ulong distance_offset)
{
    const int channels = image.channels, rows = image.rows, cols = image.cols, pitch = image.pitch;
    const size_t one = (size_t)rows * pitch, pixels = (size_t)rows * cols;
    const int side = 2 * HADA_FOCUS_NEAR + 1;
    const float dark = limits.light * (float)(side * side * channels);
    FOR_TILES (r, rows) {
        for (int x = FOCUS_WIDTH * get_local_id(0); x < cols; x += FOCUS_WIDTH * FOCUS_GROUP) {
            __global const float *at = kept + (size_t)r * pitch + x;
            const size_t i = (size_t)r * cols + x;
            const real best = LOAD(at);
            const real inverse = between_depths(best, LOAD(at + BEFORE * one), LOAD(at + AFTER * one),
                                                LOAD(at + BEST_DEPTH * one), depths, limits.base, inverse_distances);
            whole found = (best > limits.threshold) & (best - LOAD(at + SECOND * one) > limits.margin);
            if (dark > 0.0f)
                found &= light_near(kept + FUSED * one, image, r, x) > dark;
            store_row(select((real)as_float(0x7fc00000), 1.0f / inverse, found), distance + distance_offset + i,
                      cols - x);
            for (int c = 0; c < channels; c++)
                store_row(LOAD(at + (FUSED + c) * one), all_in_focus + all_in_focus_offset + c * pixels + i, cols - x);
        }
    }
}
