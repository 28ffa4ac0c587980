/* Point spread functions, as a method takes them: from the model's transfer functions by an inverse transform. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classic/classic.h"
#include "core/base.h"
#include "fft/fft.h"
#include "fft/fft_fused.h"
#include "filter/bank.h"
#include "model/model.h"
#include <hadalens/model.h>

typedef struct psf_reader {
    hada_slot *slot; /* its own */
    const hada_model *model;
    int positive; /* without negative values and what is taken for noise, of the same sum: for Richardson-Lucy */
    hada_spectrum_layout layout;
    size_t pixels; /* of the grid */
    hada_fft_pair fft;
    hada_buffer image, spectrum;
    float *psf;     /* the last one that was read, [grid rows][grid cols], about the top left pixel, round the edges */
    float *values;  /* room for a spectrum */
    double largest; /* |OTF| of the last one that was read */
} psf_reader;

static const char what[] = "a point spread function";

/* Values below so many times the noise are taken for noise: of a million normal ones less than one is above. */
static const double noises = 5.0;

/* Richardson-Lucy cannot do with negative values; functions that were learned from pairs have noise on both sides of
 * zero. The noise is what the negative values say; the sum, which is what the frame's brightness fixes best, is kept.
 */
static void make_positive(float *psf, size_t count)
{
    double square = 0.0, before = 0.0, after = 0.0;
    size_t negative = 0;
    for (size_t i = 0; i < count; i++) {
        before += psf[i];
        if (psf[i] < 0.0f) {
            square += (double)psf[i] * psf[i];
            negative++;
        }
    }
    const double least = negative ? noises * sqrt(square / (double)negative) : 0.0;
    for (size_t i = 0; i < count; i++) {
        if (!(psf[i] > least))
            psf[i] = 0.0f;
        after += psf[i];
    }
    for (size_t i = 0; after > 0.0 && before > 0.0 && i < count; i++)
        psf[i] = (float)(psf[i] * (before / after));
}

static void psf_close(psf_reader *reader)
{
    if (reader->slot)
        hada_slot_finish(reader->slot, NULL);
    hada_fft_pair_destroy(&reader->fft);
    HADA_DESTROY_BUFFERS(&reader->image, &reader->spectrum);
    hada_slot_destroy(&reader->slot);
    HADA_FREE(reader->psf, reader->values);
    *reader = (psf_reader){0};
}

/* Components have both signs, and only their sum is a point spread function: what little is negative in that is left.
 */
static int makes_positive(const hada_classic_shape *shape)
{
    return shape->options.method == HADA_METHOD_RL && shape->components == 1;
}

static hada_status psf_open(psf_reader *reader, hada_context *context, const hada_model *model, int positive,
                            hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    *reader = (psf_reader){.model = model, .positive = positive};
    reader->layout = hada_fft_layout(context, info->grid_rows, info->grid_cols, HADA_FFT_AUTO);
    reader->pixels = (size_t)info->grid_rows * (size_t)info->grid_cols;
    const hada_fft_desc desc = hada_fft_whole(HADA_FFT_FORWARD, info->grid_rows, info->grid_cols, 1);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_slot_create(&reader->slot, context, err));
    HADA_TRY_OR_DONE(hada_fft_pair_create(&reader->fft, reader->slot, desc, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&reader->image, context, reader->pixels * sizeof(float), what, err));
    HADA_TRY_OR_DONE(
        hada_buffer_create(&reader->spectrum, context, reader->layout.count * 2 * sizeof(float), what, err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(reader->psf, reader->pixels, what, err));
    HADA_TRY_OR_DONE(
        hada_allocated(reader->values = hada_alloc_raw(reader->layout.count, 2 * sizeof(float), what, err)));
done:
    if (status)
        psf_close(reader);
    return status;
}

static double square_of(const float *value)
{
    return (double)value[0] * value[0] + (double)value[1] * value[1];
}

/* Whether all values are finite: x - x is 0 for finite x alone. */
static int is_finite(const float *values, size_t count)
{
    float sum = 0.0f;
    for (size_t i = 0; i < count; i++)
        sum += values[i] - values[i];
    return sum == 0.0f;
}

/* Transfer functions of a depth: of its channels, or of all its components. */
static int images_of(const hada_model_info *info)
{
    return info->channels * (info->components > 1 ? info->components : 1);
}

/* Number `number` of those of the depths of a list. HADA_ERROR_MODEL where the model holds values that are not finite.
 */
static hada_status psf_read(psf_reader *reader, const int *depths, int number, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(reader->model);
    const size_t plane = hada_model_plane(reader->model);
    const int each = images_of(info), depth = depths ? depths[number / each] : number / each;
    const float *all = info->components > 1 ? reader->model->component_otf : reader->model->otf;
    const float *otf = all + ((size_t)depth * (size_t)each + (size_t)(number % each)) * plane * 2;
    if (!is_finite(otf, 2 * plane))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "%s: the transfer function of depth %d holds values that are not finite; the model is "
                         "damaged, make it again",
                         *info->name ? info->name : "the model", depth);
    reader->largest = 0.0;
    for (size_t i = 0; i < plane; i++)
        reader->largest = fmax(reader->largest, square_of(otf + 2 * i));
    reader->largest = sqrt(reader->largest);
    hada_layout_pack(&reader->layout, otf, reader->values);
    HADA_TRY(hada_buffer_write(&reader->spectrum, reader->slot, 0, reader->values, reader->spectrum.bytes, err));
    HADA_TRY(hada_fft_inverse(reader->fft.inverse, 1, reader->spectrum.mem, 0, reader->image.mem, 0, NULL, err));
    HADA_TRY(hada_buffer_read(&reader->image, reader->slot, 0, reader->psf, reader->image.bytes, err));
    if (reader->positive)
        make_positive(reader->psf, reader->pixels);
    return HADA_OK;
}

/* The largest absolute value of the transform of reader->psf, as it is now. */
static hada_status psf_largest(psf_reader *reader, double *largest, hada_error *err)
{
    const hada_spectrum_layout *layout = &reader->layout;
    *largest = 0.0;
    HADA_TRY(hada_buffer_write(&reader->image, reader->slot, 0, reader->psf, reader->image.bytes, err));
    HADA_TRY(hada_fft_forward(reader->fft.forward, 1, reader->image.mem, 0, reader->spectrum.mem, 0, err));
    HADA_TRY(hada_buffer_read(&reader->spectrum, reader->slot, 0, reader->values, reader->spectrum.bytes, err));
    for (int ky = 0; ky < layout->rows; ky++)
        for (int kx = 0; kx <= layout->cols / 2; kx++)
            *largest = fmax(*largest, square_of(reader->values + 2 * hada_spectrum_index(layout, ky, kx)));
    *largest = sqrt(*largest);
    return HADA_OK;
}

/* The grid that a method's transforms have: as small as the point spread functions allow.
 *
 * With y = h * x round the edges of the model's grid of n pixels, planes x in a window and y looked at in a frame, all
 * that is used of h are the lags d = i - j from window pixels j to frame pixels i: frame + window - 1 of them, from
 * `low` to `high`. Let h be 0 there but from `first` to `last`. On a grid of m pixels lags d and d + m are one. That
 * does no harm where one of both is 0 or not used, so that
 *     m >= max(high - first, last - low) + 1        and        m >= frame, window
 * gives the same matrix, and its transpose with it, along each axis by itself. Where h reaches half the frame's size to
 * both sides and window and frame are of one size, m is 1.5 of them, where the model's grid has 2. */

/* What is cut from a point spread function may change its transfer function by so much of the largest value: the
 * rounding of two floats. */
static const double negligible = 0x1p-22;
/* Values below this share of the largest one are tried as cut. */
static const double small_value = 0x1p-21;
/* A smaller grid must save this much. */
static const double worthwhile = 0.9;

typedef struct axis {
    int grid, low, high;  /* lags that are used */
    int first, last;      /* those where something is; first > last: nothing yet */
    int least;            /* pixels of frame and of window */
    int columns;          /* transforms run down the grid */
    unsigned char *state; /* of each place on the grid: 1 used, 2 within reach */
} axis;

static axis axis_of(int grid, int columns, int plane0, int plane, int frame0, int frame)
{
    axis a = {
        .grid = grid, .columns = columns, .low = frame0 - (plane0 + plane - 1), .high = frame0 + frame - 1 - plane0};
    a.first = a.high + 1;
    a.last = a.low - 1;
    a.least = plane > frame ? plane : frame;
    return a;
}

static int size_for(const axis *a)
{
    int least = a->least;
    if (a->first <= a->last)
        least = hada_most(least, hada_most(a->high - a->first, a->last - a->low) + 1);
    least = hada_fft_quick_size(least, a->columns);
    return least < a->grid ? least : a->grid;
}

static double cost(int rows, int cols)
{
    return (double)rows * cols * log2((double)rows * cols + 1.0);
}

static int pays(const axis *rows, const axis *cols)
{
    return cost(size_for(rows), size_for(cols)) < worthwhile * cost(rows->grid, cols->grid);
}

static int round_edges(int lag, int grid)
{
    const int rest = lag % grid;
    return rest < 0 ? rest + grid : rest;
}

static void widen(axis *a, int lag)
{
    a->first = lag < a->first ? lag : a->first;
    a->last = lag > a->last ? lag : a->last;
}

/* The lags where something is above a limit. */
static void reach(const float *psf, float limit, axis *rows, axis *cols)
{
    for (int i = rows->low; i <= rows->high; i++) {
        const float *row = psf + (size_t)round_edges(i, rows->grid) * (size_t)cols->grid;
        int found = 0;
        for (int j = cols->low, at = round_edges(j, cols->grid); j <= cols->high; j++) {
            if (fabsf(row[at]) > limit) {
                widen(cols, j);
                found = 1;
            }
            at = at + 1 < cols->grid ? at + 1 : 0;
        }
        if (found)
            widen(rows, i);
    }
}

static void mark(axis *a)
{
    memset(a->state, 0, (size_t)a->grid);
    for (int lag = a->low; lag <= a->high; lag++)
        a->state[round_edges(lag, a->grid)] |= lag >= a->first && lag <= a->last ? 3 : 1;
}

/* Leaves what would be cut: what is used and not within reach. */
static void keep_cut(float *psf, axis *rows, axis *cols)
{
    mark(rows);
    mark(cols);
    for (int i = 0; i < rows->grid; i++)
        for (int j = 0; j < cols->grid; j++)
            if ((rows->state[i] & cols->state[j]) != 1)
                psf[(size_t)i * (size_t)cols->grid + (size_t)j] = 0.0f;
}

/* Widens the reach by one image; *small becomes 0 where no smaller grid will do. */
static hada_status widen_by_image(psf_reader *reader, const int *depths, int number, axis *rows, axis *cols, int *small,
                                  hada_error *err)
{
    double cut = 1.0;
    for (double limit = small_value; cut > negligible * reader->largest; limit /= 4.0) {
        float largest = 0.0f;
        HADA_TRY(psf_read(reader, depths, number, err));
        for (size_t i = 0; i < reader->pixels; i++)
            largest = fmaxf(largest, fabsf(reader->psf[i]));
        reach(reader->psf, (float)(limit * largest), rows, cols);
        *small = pays(rows, cols);
        if (!*small)
            break;
        keep_cut(reader->psf, rows, cols);
        HADA_TRY(psf_largest(reader, &cut, err));
    }
    return HADA_OK;
}

hada_status hada_classic_fit_grid(hada_classic_shape *shape, hada_context *context, const hada_model *model,
                                  const int *depths, int count, hada_error *err)
{
    const hada_refine_shape *place = &shape->place;
    const hada_rectangle *plane = &shape->support, *frame = &place->frame;
    const hada_method method = shape->options.method;
    axis rows = axis_of(place->grid_rows, 1, plane->row0, plane->rows, frame->row0, frame->rows);
    axis cols = axis_of(place->grid_cols, 0, plane->col0, plane->cols, frame->col0, frame->cols);
    psf_reader reader = {0};
    int small = pays(&rows, &cols);
    hada_status status = HADA_OK;
    if ((method != HADA_METHOD_RL && method != HADA_METHOD_FISTA) || model->info.boundary != HADA_BOUNDARY_PADDED)
        small = 0;
    if (!small)
        goto done;
    HADA_TRY_OR_DONE(HADA_NEW(rows.state, (size_t)rows.grid, "a plan", err));
    HADA_TRY_OR_DONE(HADA_NEW(cols.state, (size_t)cols.grid, "a plan", err));
    HADA_TRY_OR_DONE(psf_open(&reader, context, model, makes_positive(shape), err));
    for (int i = 0; small && i < count * images_of(&model->info); i++)
        HADA_TRY_OR_DONE(widen_by_image(&reader, depths, i, &rows, &cols, &small, err));
    if (small && rows.first <= rows.last) {
        shape->grid_rows = size_for(&rows);
        shape->grid_cols = size_for(&cols);
        shape->reach = (hada_rectangle){rows.first, cols.first, rows.last - rows.first + 1, cols.last - cols.first + 1};
    }
done:
    psf_close(&reader);
    HADA_FREE(rows.state, cols.state);
    return status;
}

int hada_classic_has_optics(const hada_classic_shape *shape)
{
    return shape->options.method == HADA_METHOD_RL || shape->reach.rows > 0 || shape->components > 1;
}

/* A point spread function on the method's grid, where window and frame both begin at the top left. */
static void place_on_grid(const hada_classic_shape *shape, const float *psf, float *out)
{
    const hada_refine_shape *place = &shape->place;
    const hada_rectangle *lags = &shape->reach;
    const int row_shift = place->frame.row0 - shape->support.row0, col_shift = place->frame.col0 - shape->support.col0;
    memset(out, 0, (size_t)shape->grid_rows * (size_t)shape->grid_cols * sizeof *out);
    for (int i = lags->row0; i < lags->row0 + lags->rows; i++) {
        const float *from = psf + (size_t)round_edges(i, place->grid_rows) * (size_t)place->grid_cols;
        float *to = out + (size_t)round_edges(i - row_shift, shape->grid_rows) * (size_t)shape->grid_cols;
        for (int j = lags->col0; j < lags->col0 + lags->cols; j++)
            to[round_edges(j - col_shift, shape->grid_cols)] = from[round_edges(j, place->grid_cols)];
    }
}

/* The point spread function of what is no longer sharp anywhere, as bright as a depth's. */
#define HAZE_WIDTH 0.19 /* standard deviation, of the frame's shorter side */

static void make_haze(const hada_classic_shape *shape, double gain, float *out)
{
    const hada_refine_shape *place = &shape->place;
    const int rows = shape->grid_rows, cols = shape->grid_cols;
    const int row0 = shape->reach.rows ? shape->support.row0 - place->frame.row0 : 0,
              col0 = shape->reach.rows ? shape->support.col0 - place->frame.col0 : 0;
    const double width = HAZE_WIDTH * hada_least(place->frame.rows, place->frame.cols);
    double sum = 0.0;
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < rows; i++)
            for (int j = 0; j < cols; j++) {
                const double down = hada_least(abs(i - row0), rows - abs(i - row0)),
                             along = hada_least(abs(j - col0), cols - abs(j - col0));
                const double value = exp(-0.5 * (down * down + along * along) / (width * width));
                sum += pass ? 0.0 : value;
                out[(size_t)i * (size_t)cols + (size_t)j] = (float)(sqrt(gain) * value / sum);
            }
}

static hada_status transform_all(hada_buffer *out, psf_reader *reader, const hada_classic_shape *shape,
                                 const int *depths, int count, hada_error *err)
{
    const size_t pixels = (size_t)shape->grid_rows * (size_t)shape->grid_cols;
    const hada_fft_desc desc = hada_fft_whole(HADA_FFT_FORWARD, shape->grid_rows, shape->grid_cols, 1);
    hada_fft *forward = NULL;
    hada_buffer image = {0};
    float *psf = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_fft_create(&forward, reader->slot, &desc, err));
    HADA_TRY_OR_DONE(
        hada_buffer_create(&image, reader->slot->context, pixels * sizeof *psf, "a point spread function", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(psf, pixels, "a point spread function", err));
    const int images = images_of(&reader->model->info);
    for (int i = 0; i < (count + shape->haze) * images && !reader->slot->context->dry; i++) {
        const size_t at = (size_t)i * hada_fft_plan_layout(forward)->count;
        const int haze = i >= count * images;
        if (i == count * images) /* the same for all channels */
            make_haze(shape, hada_model_gain(reader->model), psf);
        if (!haze)
            HADA_TRY_OR_DONE(psf_read(reader, depths, i, err));
        if (!haze && shape->reach.rows)
            place_on_grid(shape, reader->psf, psf);
        HADA_TRY_OR_DONE(hada_buffer_write(&image, reader->slot, 0, haze || shape->reach.rows ? psf : reader->psf,
                                           image.bytes, err));
        HADA_TRY_OR_DONE(hada_fft_forward(forward, 1, image.mem, 0, out->mem, at, err));
    }
    HADA_TRY_OR_DONE(hada_slot_finish(reader->slot, err)); /* other queues read what this one wrote */
done:
    if (status)
        hada_slot_finish(reader->slot, NULL);
    hada_fft_destroy(&forward);
    hada_buffer_destroy(&image);
    free(psf);
    return status;
}

/* The weights of all components as images of planes, behind `offset` bytes. */
static hada_status write_weights(hada_buffer *out, size_t offset, psf_reader *reader, const hada_classic_shape *shape,
                                 const int *depths, int count, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(reader->model);
    const hada_rectangle *window = &shape->place.window, *support = &shape->support;
    const size_t pitch = hada_classic_pitch(support->cols), pixels = (size_t)support->rows * pitch,
                 area = (size_t)window->rows * (size_t)window->cols;
    float *image = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(image, pixels, "weights of components", err));
    for (int i = 0; i < count * info->components && !reader->slot->context->dry; i++) {
        const int depth = depths ? depths[i / info->components] : i / info->components;
        const size_t term = (size_t)depth * (size_t)info->components + (size_t)(i % info->components);
        const float *from = reader->model->component_weights + term * area;
        for (int row = 0; row < support->rows; row++)
            for (int col = 0; col < support->cols; col++)
                image[(size_t)row * pitch + (size_t)col] =
                    from[(size_t)hada_within(row + support->row0 - window->row0, window->rows) * (size_t)window->cols +
                         (size_t)hada_within(col + support->col0 - window->col0, window->cols)];
        HADA_TRY_OR_DONE(hada_buffer_write(out, reader->slot, offset + (size_t)i * pixels * sizeof *image, image,
                                           pixels * sizeof *image, err));
    }
    HADA_TRY_OR_DONE(hada_slot_finish(reader->slot, err));
done:
    free(image);
    return status;
}

hada_status hada_classic_optics(hada_buffer *out, hada_context *context, const hada_classic_shape *shape,
                                const hada_model *model, const int *depths, int count, hada_error *err)
{
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    const size_t images = (size_t)(count + shape->haze) * (size_t)images_of(&model->info),
                 spectra = images * layout.count * 2 * sizeof(float);
    const size_t pixels = (size_t)shape->support.rows * hada_classic_pitch(shape->support.cols);
    const size_t weights =
        shape->components > 1 ? (size_t)count * (size_t)shape->components * pixels * sizeof(float) : 0;
    psf_reader reader = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_buffer_create(out, context, spectra + weights, "the transfer functions", err));
    HADA_TRY_OR_DONE(psf_open(&reader, context, model, makes_positive(shape), err));
    HADA_TRY_OR_DONE(transform_all(out, &reader, shape, depths, count, err));
    if (weights)
        HADA_TRY_OR_DONE(write_weights(out, spectra, &reader, shape, depths, count, err));
done:
    psf_close(&reader);
    if (status)
        hada_buffer_destroy(out);
    return status;
}
