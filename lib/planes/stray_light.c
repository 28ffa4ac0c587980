/* Stray light of a frame: the smooth surface s with which planes explain it best,
 *
 *     min  |b - s - M sum_z h_z * x_z|^2  over smooth s and over x_z >= 0 in the window, 0 outside,
 *
 * M the sensor's frame. s follows from what the planes leave, by least squares; what remains is a problem in x alone,
 * |P (b - M sum h * x)|^2, where P takes smooth light off (G. Golub, V. Pereyra, "The differentiation of
 * pseudo-inverses and nonlinear least squares problems whose variables separate", SIAM J. Numer. Anal. 10(2), 1973).
 * FISTA solves it (A. Beck, M. Teboulle, SIAM J. Imaging Sciences 2(1), 2009), begun again where its momentum leads
 * uphill (B. O'Donoghue, E. Candes, Found. Comput. Math. 15, 2015): scene and surface differ at low frequencies, where
 * gradients are exact steps, and where the steps of refinement take hundreds. For the same reason a few cells of the
 * grid are enough. perf/results/learning.md has the figures. */
#include "planes/maker.h"

#include <float.h>

#include "image/correct.h"
#include "image/small_fft.h"
#include "model/model.h"

/* Cells a side of the grid, for a first look and for the answer; the least pixels of a cell's side; channels
 * at most, depths that take part at most; iterations of the first look, those that tell whether there is any, and those
 * after which its surface is known. */
enum {
    FEW_CELLS = 16,
    CELLS = 32,
    LEAST_PIXELS = 2,
    MOST_CHANNELS = 8,
    MOST_DEPTHS = 4,
    FEW_STEPS = 100,
    STEPS = 150,
    MORE_STEPS = 400
};
enum { TERMS = HADA_SMOOTH_TERMS };
/* A cell is known where this share of its values is, and at most that share is saturated. */
#define KNOWN_SHARE     0.1
#define SATURATED_SHARE 0.1
/* Energy that planes leave without stray light, in units of what they leave with it. The first look goes on above
 * DOUBT. Frames without any had up to 1.04 with a constant and 1.3 with a surface, real captures 1.4 and 2.9: their
 * cameras are not known exactly, and a surface takes some of that up. Frames with 6 % and more had 2.6 to 300. A
 * surface must leave so much less than a constant. */
#define DOUBT           1.2
#define CONSTANT_BETTER 2.0
#define SURFACE_BETTER  4.0
#define SURFACE_PAYS    1.5
/* No channel has less than nothing: the mean may be negative by this part of the frame's light, for what was taken off
 * as a dark level may have been too much. */
#define LEAST_MEAN (-0.1)

/* Two channels are one complex image: the real part of number k is channel 2 k, the imaginary part the next one. */
typedef struct cells {
    hada_small_fft fft;
    int side, channels, pairs, depths;
    size_t area;                   /* of an image: side * side */
    float *otf;                    /* [depth][channel][area] complex, [kx][ky] */
    float *frame, *seen;           /* [channel][area]; seen: 1 where it is known, else 0 */
    unsigned char *window;         /* [area]: 1 inside */
    double *basis;                 /* [channel][TERMS][area]: orthonormal where it is seen */
    double (*made)[TERMS][TERMS];  /* of which terms, [channel] */
    float *step;                   /* [channel] */
    float *planes, *from, *before; /* [depth][pair][area] complex: x, where a step starts, x of the step before */
    float *light, *light_from, *light_before; /* [pair][area] complex: what they make of the frame */
    float *residual, *work;                   /* [pair][area] complex; room for one image */
} cells;

static void free_cells(cells *of)
{
    hada_small_fft_destroy(&of->fft);
    HADA_FREE(of->otf, of->frame, of->seen, of->window, of->basis, of->made, of->step, of->planes, of->from, of->before,
              of->light, of->light_from, of->light_before, of->residual, of->work);
}

static hada_status allocate(cells *of, hada_error *err)
{
    static const char what[] = "looking for stray light";
    const size_t area = of->area, channels = (size_t)of->channels, depths = (size_t)of->depths,
                 frame = 2 * (size_t)of->pairs * area;
    float **frames[] = {&of->light, &of->light_from, &of->light_before, &of->residual};
    float **planes[] = {&of->planes, &of->from, &of->before};
    HADA_TRY(hada_small_fft_create(&of->fft, of->side, err));
    HADA_TRY(HADA_NEW(of->otf, 2 * depths * channels * area, what, err));
    HADA_TRY(HADA_NEW(of->frame, channels * area, what, err));
    HADA_TRY(HADA_NEW(of->seen, channels * area, what, err));
    HADA_TRY(HADA_NEW(of->window, area, what, err));
    HADA_TRY(HADA_NEW(of->basis, channels * TERMS * area, what, err));
    HADA_TRY(HADA_NEW(of->made, channels, what, err));
    HADA_TRY(HADA_NEW(of->step, channels, what, err));
    HADA_TRY(HADA_NEW(of->work, 2 * area, what, err));
    for (size_t i = 0; i < HADA_COUNT(frames); i++)
        HADA_TRY(HADA_NEW(*frames[i], frame, what, err));
    for (size_t i = 0; i < HADA_COUNT(planes); i++)
        HADA_TRY(HADA_NEW(*planes[i], depths * frame, what, err));
    return HADA_OK;
}

/* A depth's transfer function of a channel at the cells' frequencies, without the highest one. */
static void take_otf(const hada_model *model, int depth, int channel, int side, float *to)
{
    const hada_model_info *info = &model->info;
    const size_t half = (size_t)info->grid_cols / 2 + 1, plane = half * (size_t)info->grid_rows;
    const float *from = model->otf + 2 * plane * ((size_t)depth * (size_t)info->channels + (size_t)channel);
    for (int i = 0; i < side * side; i++, to += 2) {
        int kx = i / side, ky = i % side, mirrored;
        if (2 * kx == side || 2 * ky == side)
            continue;
        kx -= 2 * kx > side ? side : 0;
        ky -= 2 * ky > side ? side : 0;
        mirrored = kx < 0;
        kx = mirrored ? -kx : kx;
        ky = mirrored ? -ky : ky;
        const float *at = from + 2 * ((size_t)(ky < 0 ? ky + info->grid_rows : ky) * half + (size_t)kx);
        to[0] = at[0];
        to[1] = mirrored ? -at[1] : at[1];
    }
}

static void take_camera(cells *of, const hada_model *model, const int *depths, int count)
{
    for (int z = 0; z < of->depths; z++)
        for (int c = 0; c < of->channels; c++)
            take_otf(model, depths[of->depths > 1 ? z * (count - 1) / (of->depths - 1) : 0], c, of->side,
                     of->otf + 2 * of->area * (size_t)(z * of->channels + c));
    for (int c = 0; c < of->channels; c++) {
        double most = DBL_MIN;
        for (size_t i = 0; i < of->area; i++) {
            double power = 0.0;
            for (int z = 0; z < of->depths; z++) {
                const float *h = of->otf + 2 * (of->area * (size_t)(z * of->channels + c) + i);
                power += (double)h[0] * h[0] + (double)h[1] * h[1];
            }
            most = fmax(most, power);
        }
        of->step[c] = (float)(1.0 / most);
    }
}

/* Where a row or column of the cells, or a part of one, begins on an image that begins at `first` of a grid. */
static double begins(double cell, int side, int grid, int first)
{
    return cell * grid / side - first;
}

/* The window, with cells that lie partly in it. */
static void mark_window(cells *of, const hada_model_info *info, const hada_geometry *at)
{
    for (int i = 0; i < of->side * of->side; i++) {
        const int row = i / of->side, col = i % of->side;
        of->window[i] = begins(row + 1, of->side, info->grid_rows, at->window_row) > 0.0 &&
                        begins(row, of->side, info->grid_rows, at->window_row) < info->window_rows &&
                        begins(col + 1, of->side, info->grid_cols, at->window_col) > 0.0 &&
                        begins(col, of->side, info->grid_cols, at->window_col) < info->window_cols;
    }
}

/* The share of pixel i that lies between two places. */
static double overlap(int i, double begin, double end)
{
    return fmin(i + 1, end) - fmax(i, begin);
}

/* The mean of the values of a frame's channel that a cell covers; NaN where too few are known. weights: of all values,
 * or NULL. */
static double cell_mean(const hada_frame_exposure *exposure, const float *weights, int channel, double top, double left,
                        double bottom, double right)
{
    const hada_pixels *pixels = &exposure->pixels;
    const size_t first = (size_t)channel * (size_t)pixels->rows * (size_t)pixels->cols, cols = (size_t)pixels->cols;
    const double whole = (bottom - top) * (right - left);
    double sum = 0.0, known = 0.0, saturated = 0.0;
    for (int row = (int)top; row < bottom; row++)
        for (int col = (int)left; col < right; col++) {
            const double share = overlap(row, top, bottom) * overlap(col, left, right);
            const size_t in_plane = (size_t)row * cols + (size_t)col, i = first + in_plane;
            float room;
            if (weights && weights[i] <= 0.0f) {
                saturated += weights[i] < 0.0f ? share : 0.0;
                continue;
            }
            sum += share * (double)(*hada_pixels_floats(pixels, channel, in_plane, 1, &room) -
                                    (exposure->dark_frame ? exposure->dark_frame[i] : 0.0f));
            known += share;
        }
    return known > KNOWN_SHARE * whole && saturated <= SATURATED_SHARE * whole ? sum / known - exposure->levels[channel]
                                                                               : NAN;
}

static void take_frame(cells *of, const hada_frame_exposure *exposure, const float *weights, const hada_geometry *at)
{
    const hada_model_info *info = exposure->info;
    for (int c = 0; c < of->channels; c++)
        for (int i = 0; i < of->side * of->side; i++) {
            const size_t place = (size_t)c * of->area + (size_t)i;
            const int row = i / of->side, col = i % of->side;
            const double top = begins(row, of->side, info->grid_rows, at->raw_row),
                         left = begins(col, of->side, info->grid_cols, at->raw_col),
                         bottom = begins(row + 1, of->side, info->grid_rows, at->raw_row),
                         right = begins(col + 1, of->side, info->grid_cols, at->raw_col);
            const int inside = top >= 0.0 && left >= 0.0 && bottom <= info->raw_rows && right <= info->raw_cols;
            const double mean = inside ? cell_mean(exposure, weights, c, top, left, bottom, right) : NAN;
            of->seen[place] = isfinite(mean) ? 1.0f : 0.0f;
            of->frame[place] = isfinite(mean) ? (float)mean : 0.0f;
        }
}

static double product(const double *a, const double *b, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Orthonormal surfaces on the cells that are seen of a channel, and of which terms each is made. *enough: 0 where the
 * terms cannot be told apart there. */
static void make_basis(cells *of, int channel, const hada_model_info *info, const hada_geometry *at, int *enough)
{
    const float *seen = of->seen + (size_t)channel * of->area;
    double *basis = of->basis + (size_t)channel * TERMS * of->area;
    double(*made)[TERMS] = of->made[channel];
    for (int k = 0; k < TERMS; k++) {
        double *own = basis + (size_t)k * of->area;
        for (int i = 0; i < of->side * of->side; i++) {
            const double y = begins(i / of->side + 0.5, of->side, info->grid_rows, at->raw_row),
                         x = begins(i % of->side + 0.5, of->side, info->grid_cols, at->raw_col);
            own[i] = seen[i] *
                     hada_smooth_term(k, hada_smooth_place(y, info->raw_rows), hada_smooth_place(x, info->raw_cols));
        }
        made[k][k] = 1.0;
        const double whole = product(own, own, of->area);
        for (int n = 0; n < k; n++) {
            const double *other = basis + (size_t)n * of->area, along = product(own, other, of->area);
            for (size_t i = 0; i < of->area; i++)
                own[i] -= along * other[i];
            for (int m = 0; m <= n; m++)
                made[k][m] -= along * made[n][m];
        }
        const double left = product(own, own, of->area);
        *enough &= left > 1e-3 * whole && whole > 2 * TERMS * DBL_EPSILON;
        const double size = left > 0.0 ? 1.0 / sqrt(left) : 0.0;
        for (size_t i = 0; i < of->area; i++)
            own[i] *= size;
        for (int n = 0; n <= k; n++)
            made[k][n] *= size;
    }
}

/* Of two channels that went through one transform: multiplies each by its transfer function, or the conjugate, adding
 * to `to`. The last of an odd number of channels is alone. */
static void multiply(const cells *of, int depth, int pair, int conjugate, const float *from, float *to)
{
    const size_t side = (size_t)of->side;
    const float *a = of->otf + 2 * of->area * (size_t)(depth * of->channels + 2 * pair);
    const float *b = 2 * pair + 1 < of->channels ? a + 2 * of->area : NULL;
    const float sign = conjugate ? -1.0f : 1.0f;
    for (size_t kx = 0; kx < side; kx++)
        for (size_t ky = 0; ky < side; ky++) {
            const size_t i = kx * side + ky, opposite = (side - kx) % side * side + (side - ky) % side;
            const float *z = from + 2 * i, *o = from + 2 * opposite;
            const float first[2] = {0.5f * (z[0] + o[0]), 0.5f * (z[1] - o[1])};
            const float second[2] = {0.5f * (z[1] + o[1]), 0.5f * (o[0] - z[0])};
            const float ha[2] = {a[2 * i], sign * a[2 * i + 1]};
            const float hb[2] = {b ? b[2 * i] : 0.0f, b ? sign * b[2 * i + 1] : 0.0f};
            const float y[2] = {hb[0] * second[0] - hb[1] * second[1], hb[0] * second[1] + hb[1] * second[0]};
            to[2 * i] += ha[0] * first[0] - ha[1] * first[1] - y[1];
            to[2 * i + 1] += ha[0] * first[1] + ha[1] * first[0] + y[0];
        }
}

/* The image of a spectrum, in place. */
static void invert(const cells *of, float *data)
{
    const float scale = 1.0f / (float)of->area;
    for (size_t i = 0; i < of->area; i++)
        data[2 * i + 1] = -data[2 * i + 1];
    hada_small_fft_run(&of->fft, data);
    for (size_t i = 0; i < of->area; i++) {
        data[2 * i] *= scale;
        data[2 * i + 1] *= -scale;
    }
}

/* light = sum_z h_z * planes_z */
static void predict(const cells *of, const float *planes, float *light)
{
    const size_t image = 2 * of->area;
    memset(light, 0, (size_t)of->pairs * image * sizeof *light);
    for (int k = 0; k < of->pairs; k++) {
        float *to = light + (size_t)k * image;
        for (int z = 0; z < of->depths; z++) {
            memcpy(of->work, planes + (size_t)(z * of->pairs + k) * image, image * sizeof *of->work);
            hada_small_fft_run(&of->fft, of->work);
            multiply(of, z, k, 0, of->work, to);
        }
        invert(of, to);
    }
}

/* Values of a channel among those of two: every other one, from here on. */
static float *channel_in(float *images, const cells *of, int channel)
{
    return images + 2 * of->area * (size_t)(channel / 2) + channel % 2;
}

/* residual = P (frame - light) with so many terms of surfaces; their shares of the basis. Returns its energy. */
static double leave(const cells *of, float *light, int terms, double (*share)[TERMS])
{
    double energy = 0.0;
    memset(of->residual, 0, 2 * (size_t)of->pairs * of->area * sizeof *of->residual);
    for (int c = 0; c < of->channels; c++) {
        const float *frame = of->frame + (size_t)c * of->area, *seen = of->seen + (size_t)c * of->area;
        const float *made = channel_in(light, of, c);
        const double *basis = of->basis + (size_t)c * TERMS * of->area;
        float *to = channel_in(of->residual, of, c);
        for (size_t i = 0; i < of->area; i++)
            to[2 * i] = seen[i] * (frame[i] - made[2 * i]);
        for (int k = 0; k < terms; k++) {
            const double *own = basis + (size_t)k * of->area;
            double along = 0.0;
            for (size_t i = 0; i < of->area; i++)
                along += own[i] * (double)to[2 * i];
            for (size_t i = 0; i < of->area; i++)
                to[2 * i] -= (float)(along * own[i]);
            share[c][k] = along;
        }
        for (size_t i = 0; i < of->area; i++)
            energy += (double)to[2 * i] * (double)to[2 * i];
    }
    return energy;
}

/* planes = max(from + step h^T residual, 0) in the window. Returns how much of this goes against the last change. */
static double descend(const cells *of)
{
    const size_t image = 2 * of->area;
    double uphill = 0.0;
    for (int k = 0; k < of->pairs; k++) {
        float *spectrum = of->residual + (size_t)k * image;
        const float step[2] = {of->step[2 * k], 2 * k + 1 < of->channels ? of->step[2 * k + 1] : 0.0f};
        hada_small_fft_run(&of->fft, spectrum);
        for (int z = 0; z < of->depths; z++) {
            const size_t first = (size_t)(z * of->pairs + k) * image;
            float *planes = of->planes + first;
            const float *from = of->from + first, *before = of->before + first;
            memset(of->work, 0, image * sizeof *of->work);
            multiply(of, z, k, 1, spectrum, of->work);
            invert(of, of->work);
            for (size_t i = 0; i < image; i++) {
                planes[i] = of->window[i / 2] ? fmaxf(from[i] + step[i % 2] * of->work[i], 0.0f) : 0.0f;
                uphill += (double)(from[i] - planes[i]) * (double)(planes[i] - before[i]);
            }
        }
    }
    return uphill;
}

/* from = now + momentum (now - before); before = now */
static void extrapolate(float *from, const float *now, float *before, size_t count, float momentum)
{
    for (size_t i = 0; i < count; i++) {
        from[i] = now[i] + momentum * (now[i] - before[i]);
        before[i] = now[i];
    }
}

/* The surface with so many terms, 0 to TERMS: their shares of the basis, after so many iterations. Returns the energy
 * that is left. */
static double solve(cells *of, int terms, int steps, double (*share)[TERMS])
{
    const size_t frame = 2 * (size_t)of->pairs * of->area, planes = (size_t)of->depths * frame;
    double t = 1.0;
    memset(of->from, 0, planes * sizeof *of->from);
    memset(of->before, 0, planes * sizeof *of->before);
    memset(of->light_from, 0, frame * sizeof *of->light_from);
    memset(of->light_before, 0, frame * sizeof *of->light_before);
    for (int step = 0; step < steps; step++) {
        leave(of, of->light_from, terms, share);
        if (descend(of) > 0.0)
            t = 1.0;
        predict(of, of->planes, of->light);
        const double next = 0.5 * (1.0 + sqrt(1.0 + 4.0 * t * t));
        const float momentum = (float)((t - 1.0) / next);
        extrapolate(of->from, of->planes, of->before, planes, momentum);
        extrapolate(of->light_from, of->light, of->light_before, frame, momentum);
        t = next;
    }
    return leave(of, of->light, terms, share);
}

/* Makes everything for so many cells a side. *enough: 0 where the frame says too little. */
static hada_status begin(cells *of, int side, const hada_frame_exposure *exposure, const float *weights,
                         const hada_model *model, const int *depths, int count, int *enough, hada_error *err)
{
    const hada_model_info *info = exposure->info;
    hada_geometry at;
    *of = (cells){.side = side,
                  .channels = info->channels,
                  .pairs = (info->channels + 1) / 2,
                  .depths = count < MOST_DEPTHS ? count : MOST_DEPTHS,
                  .area = (size_t)side * (size_t)side};
    *enough = 1;
    HADA_TRY(hada_geometry_of(info, &at, err));
    HADA_TRY(allocate(of, err));
    take_camera(of, model, depths, count);
    mark_window(of, info, &at);
    take_frame(of, exposure, weights, &at);
    for (int c = 0; c < info->channels; c++)
        make_basis(of, c, info, &at, enough);
    return HADA_OK;
}

/* A first look at few cells: 1 where there may be some. */
static int may_be_there(cells *of, double (*share)[TERMS])
{
    const double none = solve(of, 0, FEW_STEPS, share);
    return DOUBT * solve(of, TERMS, FEW_STEPS, share) < none;
}

/* How many terms the stray light has, with their shares of the basis; 0: there is none. */
static int find_terms(cells *of, double (*share)[TERMS])
{
    const double none = solve(of, 0, STEPS, share), constant = solve(of, 1, STEPS, share),
                 surface = solve(of, TERMS, STEPS, share);
    const int is_there = CONSTANT_BETTER * constant < none, pays = SURFACE_PAYS * surface < constant;
    const int terms = pays && (is_there || SURFACE_BETTER * surface < none) ? TERMS : is_there;
    if (terms)
        solve(of, terms, MORE_STEPS, share);
    return terms;
}

/* Weights of terms from shares of the basis. levels: of the channels, which light may be less than; NULL: none.
 * *possible: 0 where a channel would have less than nothing. */
static void take_weights(const cells *of, int terms, double (*share)[TERMS], const double *levels, double *weight,
                         int *possible)
{
    for (int c = 0; c < of->channels; c++) {
        const float *frame = of->frame + (size_t)c * of->area;
        double light = 0.0, known = 0.0, *own = weight + (size_t)c * TERMS;
        for (int k = 0; k < TERMS; k++)
            own[k] = 0.0;
        for (int k = 0; k < terms; k++)
            for (int n = 0; n <= k; n++)
                own[n] += share[c][k] * of->made[c][k][n];
        for (size_t i = 0; i < of->area; i++) {
            light += fabs((double)frame[i]);
            known += (double)of->seen[(size_t)c * of->area + i];
        }
        *possible &= hada_smooth_mean(own) + (levels ? levels[c] : 0.0) >= LEAST_MEAN * light / known;
    }
}

static int cells_of(const hada_model_info *info, int side)
{
    return info->grid_rows >= LEAST_PIXELS * side && info->grid_cols >= LEAST_PIXELS * side;
}

hada_status hada_stray_light_find(const hada_frame_exposure *exposure, const hada_model *model, const int *depths,
                                  int count, int level_found, double *weight, int *found, hada_error *err)
{
    const int channels = exposure->info->channels;
    double(*share)[TERMS] = NULL;
    float *weights = NULL;
    cells of = {0};
    int terms, possible = 1;
    hada_status status = HADA_OK;
    *found = 0;
    if (!model->otf || channels > MOST_CHANNELS || !cells_of(exposure->info, CELLS))
        return HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(share, (size_t)channels, "stray light", err));
    if (hada_exposure_is_weighted(exposure)) {
        HADA_TRY_OR_DONE(HADA_NEW_RAW(weights, hada_exposure_count(exposure), "the weights of pixels", err));
        hada_exposure_weigh(exposure, weights);
    }
    HADA_TRY_OR_DONE(begin(&of, FEW_CELLS, exposure, weights, model, depths, count, &possible, err));
    if (!possible || !may_be_there(&of, share))
        goto done;
    free_cells(&of);
    HADA_TRY_OR_DONE(begin(&of, CELLS, exposure, weights, model, depths, count, &possible, err));
    terms = possible ? find_terms(&of, share) : 0;
    take_weights(&of, terms, share, level_found ? exposure->levels : NULL, weight, &possible);
    *found = terms && possible;
done:
    free_cells(&of);
    HADA_FREE(share, weights);
    return status;
}
