/* The grid that a method's transforms have: as small as the point spread functions allow.
 *
 * With y = h * x round the edges of the model's grid of n pixels, planes x in a window and y looked at in a frame, all
 * that is used of h are the lags d = i - j from window pixels j to frame pixels i: frame + window - 1 of them, from
 * `low` to `high`. Let h be 0 there but from `first` to `last`. On a grid of m pixels lags d and d + m are one. That
 * does no harm where one of both is 0 or not used, so that
 *     m >= max(high - first, last - low) + 1        and        m >= frame, window
 * gives the same matrix, and its transpose with it, along each axis by itself. Where h reaches half the frame's size to
 * both sides and window and frame are of one size, m is 1.5 of them, where the model's grid has 2. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "classic/classic.h"
#include "classic/classic_psf.h"
#include "core/alloc.h"
#include "fft/fft_fused.h"

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

static int larger(int a, int b)
{
    return a > b ? a : b;
}

static int size_for(const axis *a)
{
    int least = a->least;
    if (a->first <= a->last)
        least = larger(least, larger(a->high - a->first, a->last - a->low) + 1);
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
static hada_status widen_by_image(hada_psf_reader *reader, int depth, int channel, axis *rows, axis *cols, int *small,
                                  hada_error *err)
{
    double cut = 1.0;
    for (double limit = small_value; cut > negligible * reader->largest; limit /= 4.0) {
        float largest = 0.0f;
        HADA_TRY(hada_psf_read(reader, depth, channel, err));
        for (size_t i = 0; i < reader->pixels; i++)
            largest = fmaxf(largest, fabsf(reader->psf[i]));
        reach(reader->psf, (float)(limit * largest), rows, cols);
        *small = pays(rows, cols);
        if (!*small)
            break;
        keep_cut(reader->psf, rows, cols);
        HADA_TRY(hada_psf_largest(reader, &cut, err));
    }
    return HADA_OK;
}

hada_status hada_classic_fit_grid(hada_classic_shape *shape, hada_context *context, const hada_model *model,
                                  const int *depths, int count, hada_error *err)
{
    const hada_refine_shape *place = &shape->place;
    const hada_refine_rect *plane = &shape->support, *frame = &place->frame;
    const hada_method method = shape->options.method;
    const int channels = place->channels;
    axis rows = axis_of(place->grid_rows, 1, plane->row0, plane->rows, frame->row0, frame->rows);
    axis cols = axis_of(place->grid_cols, 0, plane->col0, plane->cols, frame->col0, frame->cols);
    hada_psf_reader reader = {0};
    int small = pays(&rows, &cols);
    hada_status status = HADA_OK;
    if ((method != HADA_METHOD_RL && method != HADA_METHOD_FISTA) || place->boundary != HADA_BOUNDARY_PADDED)
        small = 0;
    if (!small)
        goto done;
    HADA_TRY_OR_DONE(hada_allocated(rows.state = hada_alloc((size_t)rows.grid, 1, "a plan", err)));
    HADA_TRY_OR_DONE(hada_allocated(cols.state = hada_alloc((size_t)cols.grid, 1, "a plan", err)));
    HADA_TRY_OR_DONE(hada_psf_reader_open(&reader, context, model, method == HADA_METHOD_RL, err));
    for (int i = 0; small && i < count * channels; i++)
        HADA_TRY_OR_DONE(widen_by_image(&reader, depths ? depths[i / channels] : i / channels, i % channels, &rows,
                                        &cols, &small, err));
    if (small && rows.first <= rows.last) {
        shape->grid_rows = size_for(&rows);
        shape->grid_cols = size_for(&cols);
        shape->reach =
            (hada_refine_rect){rows.first, cols.first, rows.last - rows.first + 1, cols.last - cols.first + 1};
    }
done:
    hada_psf_reader_close(&reader);
    free(rows.state);
    free(cols.state);
    return status;
}

int hada_classic_has_optics(const hada_classic_shape *shape)
{
    return shape->options.method == HADA_METHOD_RL || shape->reach.rows > 0;
}

/* A point spread function on the method's grid, where window and frame both begin at the top left. */
static void place_on_grid(const hada_classic_shape *shape, const float *psf, float *out)
{
    const hada_refine_shape *place = &shape->place;
    const hada_refine_rect *lags = &shape->reach;
    const int row_shift = place->frame.row0 - shape->support.row0, col_shift = place->frame.col0 - shape->support.col0;
    memset(out, 0, (size_t)shape->grid_rows * (size_t)shape->grid_cols * sizeof *out);
    for (int i = lags->row0; i < lags->row0 + lags->rows; i++) {
        const float *from = psf + (size_t)round_edges(i, place->grid_rows) * (size_t)place->grid_cols;
        float *to = out + (size_t)round_edges(i - row_shift, shape->grid_rows) * (size_t)shape->grid_cols;
        for (int j = lags->col0; j < lags->col0 + lags->cols; j++)
            to[round_edges(j - col_shift, shape->grid_cols)] = from[round_edges(j, place->grid_cols)];
    }
}

static hada_status transform_all(hada_buffer *out, hada_psf_reader *reader, const hada_classic_shape *shape,
                                 const int *depths, int count, hada_error *err)
{
    const size_t pixels = (size_t)shape->grid_rows * (size_t)shape->grid_cols;
    const int channels = shape->place.channels;
    const hada_fft_desc desc = {.direction = HADA_FFT_FORWARD,
                                .rows = shape->grid_rows,
                                .cols = shape->grid_cols,
                                .batch = 1,
                                .real_rows = shape->grid_rows,
                                .real_cols = shape->grid_cols,
                                .real_pitch = (size_t)shape->grid_cols,
                                .real_distance = pixels};
    hada_fft *forward = NULL;
    hada_buffer image = {0};
    float *psf = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_fft_create(&forward, reader->slot, &desc, err));
    HADA_TRY_OR_DONE(
        hada_buffer_create(&image, reader->slot->context, pixels * sizeof *psf, "a point spread function", err));
    HADA_TRY_OR_DONE(hada_allocated(psf = hada_alloc_raw(pixels, sizeof *psf, "a point spread function", err)));
    for (int i = 0; i < count * channels && !reader->slot->context->dry; i++) {
        const size_t at = (size_t)i * hada_fft_plan_layout(forward)->count;
        HADA_TRY_OR_DONE(hada_psf_read(reader, depths ? depths[i / channels] : i / channels, i % channels, err));
        if (shape->reach.rows)
            place_on_grid(shape, reader->psf, psf);
        HADA_TRY_OR_DONE(
            hada_buffer_write(&image, reader->slot, 0, shape->reach.rows ? psf : reader->psf, image.bytes, err));
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

hada_status hada_classic_optics(hada_buffer *out, hada_context *context, const hada_classic_shape *shape,
                                const hada_model *model, const int *depths, int count, hada_error *err)
{
    const hada_spectrum_layout layout = hada_fft_layout(context, shape->grid_rows, shape->grid_cols, HADA_FFT_AUTO);
    const size_t images = (size_t)count * (size_t)shape->place.channels;
    hada_psf_reader reader = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(
        hada_buffer_create(out, context, images * layout.count * 2 * sizeof(float), "the transfer functions", err));
    HADA_TRY_OR_DONE(hada_psf_reader_open(&reader, context, model, shape->options.method == HADA_METHOD_RL, err));
    HADA_TRY_OR_DONE(transform_all(out, &reader, shape, depths, count, err));
done:
    hada_psf_reader_close(&reader);
    if (status)
        hada_buffer_destroy(out);
    return status;
}
