/* The light of a point between pixels and depths. */
#include <math.h>
#include <stdlib.h>

#include "core/base.h"
#include "emitters/emitters.h"
#include "filter/bank.h"
#include "surface/spline.h"

static const char what[] = "the light of emitters";

/* A PSF is looked at where this share of its energy lies, and no more than so many pixels: others hold less light than
 * splines miss (2 to 3 % of the amplitude). */
#define ENERGY 0.9995
enum { MOST_PIXELS = 32768 };

/* The splines of the depths, [depth][rows][cols]. */
static hada_status read_splines(const hada_point_optics *o, hada_slot *slot, const hada_model *model, const int *depths,
                                float *out, hada_error *err)
{
    const size_t plane = hada_model_plane(model), area = (size_t)o->rows * (size_t)o->cols;
    const hada_spectrum_layout layout = hada_surface_layout(slot->context, o->rows, o->cols);
    const hada_fft_desc desc = hada_fft_whole(HADA_FFT_INVERSE, o->rows, o->cols, 1);
    hada_buffer prefilter = {0}, spectrum = {0}, image = {0};
    hada_fft *inverse = NULL;
    float *values = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(values, 2 * layout.count, what, err));
    HADA_TRY_OR_DONE(hada_surface_prefilter(&prefilter, slot, &layout, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&spectrum, slot->context, layout.count * 2 * sizeof(float), what, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&image, slot->context, area * sizeof(float), what, err));
    HADA_TRY_OR_DONE(hada_fft_create(&inverse, slot, &desc, err));
    for (int k = 0; k < o->depths; k++) {
        const hada_fft_filter use = {.product = HADA_FFT_COMPLEX, .filter = prefilter.mem, .spectrum_count = 1};
        hada_layout_pack(&layout, model->otf + (size_t)depths[k] * plane * 2, values);
        HADA_TRY_OR_DONE(hada_buffer_write(&spectrum, slot, 0, values, spectrum.bytes, err));
        HADA_TRY_OR_DONE(hada_fft_inverse(inverse, 1, spectrum.mem, 0, image.mem, 0, &use, err));
        HADA_TRY_OR_DONE(hada_buffer_read(&image, slot, 0, out + (size_t)k * area, image.bytes, err));
    }
done:
    hada_slot_finish(slot, NULL);
    hada_fft_destroy(&inverse);
    HADA_DESTROY_BUFFERS(&image, &spectrum, &prefilter);
    free(values);
    return status;
}

/* Splines with their first rows and columns again behind the last, so that taps stand behind each other. */
static void repeat_edges(const hada_point_optics *o, const float *plain)
{
    const int more = HADA_POINT_MORE;
    float *to = o->coefficients;
    for (int k = 0; k < o->depths; k++)
        for (int row = 0; row < o->rows + more; row++) {
            const float *from = plain + ((size_t)k * (size_t)o->rows + (size_t)(row % o->rows)) * (size_t)o->cols;
            for (int col = 0; col < o->cols + more; col++)
                *to++ = from[col % o->cols];
        }
}

/* The least square of a value that belongs to the brightest of an image; and its norm. */
static float least_square(const float *image, size_t area, double *norm)
{
    double energy = 0.0, low = 0.0, high = 0.0;
    for (size_t k = 0; k < area; k++) {
        const double square = (double)image[k] * image[k];
        energy += square;
        high = fmax(high, square);
    }
    *norm = sqrt(energy);
    for (int i = 0; i < 40; i++) {
        const double middle = 0.5 * (low + high);
        double sum = 0.0;
        size_t count = 0;
        for (size_t k = 0; k < area; k++) {
            const double square = (double)image[k] * image[k];
            sum += square >= middle ? square : 0.0;
            count += square >= middle;
        }
        if (sum >= ENERGY * energy || count > MOST_PIXELS)
            low = middle;
        else
            high = middle;
    }
    return (float)low;
}

/* Marks pixels where a depth has light, `wide` pixels round. */
static void mark(const hada_point_optics *o, const float *image, float least, int wide, unsigned char *marks)
{
    for (int row = 0; row < o->rows; row++)
        for (int col = 0; col < o->cols; col++) {
            const float value = image[(size_t)row * (size_t)o->cols + (size_t)col];
            if (value * value < least || value == 0.0F)
                continue;
            for (int y = row - wide; y <= row + wide; y++)
                for (int x = col - wide; x <= col + wide; x++)
                    marks[(size_t)((y + o->rows) % o->rows) * (size_t)o->cols + (size_t)((x + o->cols) % o->cols)] = 1;
        }
}

static hada_status list_reach(hada_reach *reach, const hada_point_optics *o, const unsigned char *marks,
                              hada_error *err)
{
    const int rows = o->rows, cols = o->cols;
    int count = 0;
    for (int i = 0; i < rows * cols; i++)
        count += marks[i];
    HADA_TRY(HADA_NEW(reach->offset, (size_t)count + 1, what, err));
    for (int y = -(rows / 2); y < rows - rows / 2; y++)
        for (int x = -(cols / 2); x < cols - cols / 2; x++)
            if (marks[(size_t)((y + rows) % rows) * (size_t)cols + (size_t)((x + cols) % cols)]) {
                reach->offset[reach->count][0] = (short)y;
                reach->offset[reach->count++][1] = (short)x;
            }
    return HADA_OK;
}

/* The values of a spline at the pixels themselves: 5 x 5 taps, rows after columns. */
static void at_pixels(const hada_point_optics *o, const float *spline, float *image)
{
    double taps[HADA_SPLINE_TAPS];
    hada_spline_weights(0.0, taps);
    for (int row = 0; row < o->rows; row++)
        for (int col = 0; col < o->cols; col++) {
            double sum = 0.0;
            for (int i = -2; i <= 2; i++) {
                const float *from = spline + (size_t)((row + i + o->rows) % o->rows) * (size_t)o->cols;
                double line = 0.0;
                if (col >= 2 && col < o->cols - 2)
                    for (int j = -2; j <= 2; j++)
                        line += taps[j + 2] * from[col + j];
                else
                    for (int j = -2; j <= 2; j++)
                        line += taps[j + 2] * from[(col + j + o->cols) % o->cols];
                sum += taps[i + 2] * line;
            }
            image[(size_t)row * (size_t)o->cols + (size_t)col] = (float)sum;
        }
}

/* Of a point from each depth to the next: what either has, and what moves between. */
static hada_status find_reach(hada_point_optics *o, const float *plain, hada_error *err)
{
    const size_t area = (size_t)o->rows * (size_t)o->cols;
    float *image = NULL;
    unsigned char *marks = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(image, area, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(marks, area * (size_t)o->depths, what, err));
    for (int k = 0; k < o->depths; k++) {
        double shift = 0.0;
        for (int near = k - 1; near <= k; near++)
            if (near >= 0 && near + 1 < o->depths && o->law.kind != HADA_MAGNIFICATION_NONE)
                shift = fmax(shift, hada_magnification_shift(&o->law, near, o->law.edge));
        at_pixels(o, plain + (size_t)k * area, image);
        const float least = least_square(image, area, &o->norm[k]);
        const int wide = 1 + (int)fmin(4.0, floor(0.5 * shift));
        for (int gap = k ? k - 1 : 0; gap <= k; gap++)
            mark(o, image, least, wide, marks + (size_t)gap * area);
    }
    for (int k = 0; k < o->depths; k++)
        HADA_TRY_OR_DONE(list_reach(&o->reach[k], o, marks + (size_t)k * area, err));
done:
    HADA_FREE(image, marks);
    return status;
}

/* Depths of unknown distance count as 1, 2, 3: so do blends between them. */
static hada_status find_law(hada_point_optics *o, const double *distances, const float *plain, hada_error *err)
{
    double *own = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(own, (size_t)o->depths, what, err));
    o->known_distances = 1;
    for (int k = 0; k < o->depths; k++)
        o->known_distances &= distances[k] > (k ? distances[k - 1] : 0.0);
    for (int k = 0; k < o->depths; k++)
        own[k] = o->known_distances ? distances[k] : k + 1.0;
    HADA_TRY_OR_DONE(hada_magnification_fit(&o->law, o->depths, own, plain, o->rows, o->cols, err));
done:
    free(own);
    return status;
}

hada_status hada_point_optics_create(hada_point_optics **out, hada_slot *slot, const hada_model *model,
                                     const int *depths, int count, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const size_t area = (size_t)info->grid_rows * (size_t)info->grid_cols, number = (size_t)count;
    hada_point_optics *o = NULL;
    float *plain = NULL;
    double *distances = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    if (info->grid_rows < 8 || info->grid_cols < 8)
        return hada_fail(err, HADA_ERROR_SIZE, "emitters need a grid of 8 x 8 pixels at least (got %d x %d)",
                         info->grid_rows, info->grid_cols);
    HADA_TRY_OR_DONE(HADA_NEW(o, 1, what, err));
    *o = (hada_point_optics){.depths = count,
                             .rows = info->grid_rows,
                             .cols = info->grid_cols,
                             .frame_rows = info->raw_rows,
                             .frame_cols = info->raw_cols,
                             .window_rows = info->window_rows,
                             .window_cols = info->window_cols,
                             .wraps = info->boundary == HADA_BOUNDARY_CIRCULAR};
    HADA_TRY_OR_DONE(HADA_NEW(plain, number * area, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(distances, number, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(o->norm, number, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(o->reach, number, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(o->coefficients,
                              number * (size_t)(o->rows + HADA_POINT_MORE) * (size_t)(o->cols + HADA_POINT_MORE), what,
                              err));
    for (int k = 0; k < count; k++)
        distances[k] = info->distances_mm[depths[k]];
    HADA_TRY_OR_DONE(read_splines(o, slot, model, depths, plain, err));
    HADA_TRY_OR_DONE(find_law(o, distances, plain, err));
    HADA_TRY_OR_DONE(find_reach(o, plain, err));
    repeat_edges(o, plain);
    *out = o;
    o = NULL;
done:
    hada_point_optics_destroy(&o);
    HADA_FREE(plain, distances);
    return status;
}

void hada_point_optics_destroy(hada_point_optics **pointer)
{
    hada_point_optics *o = hada_taken(pointer);
    if (!o)
        return;
    for (int k = 0; o->reach && k < o->depths; k++)
        free(o->reach[k].offset);
    hada_magnification_free(&o->law);
    HADA_FREE(o->coefficients, o->norm, o->reach, o);
}

int hada_point_most(const hada_point_optics *o)
{
    int most = 0;
    for (int k = 0; k < o->depths; k++)
        most = o->reach[k].count > most ? o->reach[k].count : most;
    return most;
}

/* How an axis is read, at each of its offsets: the first tap; weights of taps for the value and its slope, zeros
 * behind; how the place that is read moves with depth. */
typedef struct axis {
    int *base;
    float (*value)[HADA_POINT_MORE], (*slope)[HADA_POINT_MORE], *moves;
} axis;

enum { SOURCES = 2, AXES = 2 };

struct hada_point_renderer {
    const hada_point_optics *optics;
    axis axes[SOURCES][AXES];
};

hada_status hada_point_renderer_create(hada_point_renderer **out, const hada_point_optics *optics, hada_error *err)
{
    hada_point_renderer *r = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(r, 1, what, err));
    r->optics = optics;
    for (int i = 0; i < SOURCES * AXES; i++) {
        axis *a = &r->axes[i / AXES][i % AXES];
        const size_t n = (size_t)(i % AXES ? optics->cols : optics->rows);
        HADA_TRY_OR_DONE(HADA_NEW(a->base, n, what, err));
        HADA_TRY_OR_DONE(HADA_NEW(a->value, n, what, err));
        HADA_TRY_OR_DONE(HADA_NEW(a->slope, n, what, err));
        HADA_TRY_OR_DONE(HADA_NEW(a->moves, n, what, err));
    }
    *out = r;
    r = NULL;
done:
    hada_point_renderer_destroy(&r);
    return status;
}

void hada_point_renderer_destroy(hada_point_renderer **pointer)
{
    hada_point_renderer *r = hada_taken(pointer);
    if (!r)
        return;
    for (int i = 0; i < SOURCES * AXES; i++) {
        axis *a = &r->axes[i / AXES][i % AXES];
        HADA_FREE(a->base, a->value, a->slope, a->moves);
    }
    free(r);
}

/* Differences over so much stand for derivatives: of weights in pixels, in depth. */
#define STEP_OF_PLACE 1e-6
#define STEP_OF_DEPTH 1e-3

/* A pattern read at (offset - place) / scale; before and after: the same at depths nearby. */
static void fill_axis(const axis *a, int n, double fraction, const double place[3], const double scale[3])
{
    for (int i = 0; i < n; i++) {
        const double offset = i - n / 2 - fraction, at = (offset - place[0]) / scale[0], low = floor(at);
        double taps[HADA_SPLINE_TAPS], after[HADA_SPLINE_TAPS];
        const int outside = !(at >= -(n / 2) && at <= n / 2);
        a->base[i] = outside ? 0 : (((int)low - 2) % n + n) % n;
        a->moves[i] =
            outside
                ? 0.0F
                : (float)(((offset - place[2]) / scale[2] - (offset - place[1]) / scale[1]) / (2.0 * STEP_OF_DEPTH));
        hada_spline_weights(at - low, taps);
        hada_spline_weights(at - low + STEP_OF_PLACE, after);
        for (int k = 0; k < HADA_SPLINE_TAPS; k++) {
            a->value[i][k] = outside ? 0.0F : (float)taps[k];
            a->slope[i][k] = outside ? 0.0F : (float)((after[k] - taps[k]) / STEP_OF_PLACE);
        }
    }
}

/* A depth's part in the light of a point. */
typedef struct source {
    const float *coefficients;
    const axis *rows, *cols;
    double factor, slope, inverse; /* of the pattern, and how it changes with depth; 1 / scale */
} source;

static void make_source(source *s, const hada_point_renderer *r, int number, int depth, const hada_point *point,
                        double weight, double change)
{
    const hada_point_optics *o = r->optics;
    double scale[3], row[3], col[3];
    for (int k = 0; k < 3; k++) {
        const double step = k == 0 ? 0.0 : k == 1 ? -STEP_OF_DEPTH : STEP_OF_DEPTH;
        const hada_magnified to = hada_magnification_at(&o->law, point->depth + step);
        const hada_magnified by = hada_magnified_between(&o->law.depth[depth], &to);
        scale[k] = by.scale;
        row[k] = by.row;
        col[k] = by.col;
    }
    const size_t area = (size_t)(o->rows + HADA_POINT_MORE) * (size_t)(o->cols + HADA_POINT_MORE);
    *s = (source){.coefficients = o->coefficients + (size_t)depth * area,
                  .rows = &r->axes[number][0],
                  .cols = &r->axes[number][1],
                  .inverse = 1.0 / scale[0],
                  .factor = weight / (scale[0] * scale[0])};
    s->slope = change / (scale[0] * scale[0]) +
               weight * (1.0 / (scale[2] * scale[2]) - 1.0 / (scale[1] * scale[1])) / (2.0 * STEP_OF_DEPTH);
    fill_axis(s->rows, o->rows, point->row - floor(point->row), row, scale);
    fill_axis(s->cols, o->cols, point->col - floor(point->col), col, scale);
}

/* The taps of a source at an offset: its value, and its slopes along rows and columns. */
static void read_source(const source *s, size_t pitch, int y, int x, double *value, double *down, double *along)
{
    const float *from = s->coefficients + (size_t)s->rows->base[y] * pitch + s->cols->base[x];
    const float *of_row = s->rows->value[y], *slope_row = s->rows->slope[y];
    const float *of_col = s->cols->value[x], *slope_col = s->cols->slope[x];
    float lines[HADA_POINT_MORE] = {0}, slopes[HADA_POINT_MORE] = {0};
    float v = 0.0F, d = 0.0F, a = 0.0F;
    for (int k = 0; k < HADA_SPLINE_TAPS; k++, from += pitch)
        for (int i = 0; i < HADA_POINT_MORE; i++) {
            lines[i] += of_row[k] * from[i];
            slopes[i] += slope_row[k] * from[i];
        }
    for (int i = 0; i < HADA_SPLINE_TAPS; i++) {
        v += lines[i] * of_col[i];
        a += lines[i] * slope_col[i];
        d += slopes[i] * of_col[i];
    }
    *value = v;
    *down = d;
    *along = a;
}

static int place_on_frame(const hada_point_optics *o, int row, int col)
{
    if (o->wraps) {
        row = (row % o->frame_rows + o->frame_rows) % o->frame_rows;
        col = (col % o->frame_cols + o->frame_cols) % o->frame_cols;
    }
    return row >= 0 && row < o->frame_rows && col >= 0 && col < o->frame_cols ? row * o->frame_cols + col : -1;
}

int hada_point_render(hada_point_renderer *r, const hada_point *point, const float *weights, hada_touch *out)
{
    const hada_point_optics *o = r->optics;
    const size_t pitch = (size_t)(o->cols + HADA_POINT_MORE);
    const int most = o->depths > 1 ? o->depths - 2 : 0, low = (int)fmax(0.0, fmin(floor(point->depth), most));
    const double part = fmin(1.0, fmax(0.0, point->depth - low)); /* beyond the ends the nearest is magnified alone */
    const double change = point->depth >= 0.0 && point->depth <= o->depths - 1 ? 1.0 : 0.0;
    const hada_reach *reach = &o->reach[point->depth > o->depths - 1 ? o->depths - 1 : low];
    const int row = (int)floor(point->row), col = (int)floor(point->col);
    source sources[SOURCES];
    int count = 0, used = 1;
    make_source(&sources[0], r, 0, low, point, 1.0 - part, -change);
    if (o->depths > 1) {
        make_source(&sources[1], r, 1, low + 1, point, part, change);
        used = 2;
    }
    for (int i = 0; i < reach->count; i++) {
        const int dy = reach->offset[i][0], dx = reach->offset[i][1];
        const int pixel = place_on_frame(o, row + dy, col + dx), y = dy + o->rows / 2, x = dx + o->cols / 2;
        double by[HADA_POINT_UNKNOWNS] = {0};
        if (pixel < 0 || !(weights[pixel] > 0.0F))
            continue;
        for (int k = 0; k < used; k++) {
            const source *s = &sources[k];
            double value, down, along;
            read_source(s, pitch, y, x, &value, &down, &along);
            by[HADA_POINT_LIGHT] += s->factor * value;
            by[HADA_POINT_ROW] -= s->factor * s->inverse * down;
            by[HADA_POINT_COL] -= s->factor * s->inverse * along;
            by[HADA_POINT_DEPTH] +=
                s->slope * value + s->factor * (down * s->rows->moves[y] + along * s->cols->moves[x]);
        }
        out[count].pixel = pixel;
        for (int k = 0; k < HADA_POINT_UNKNOWNS; k++)
            out[count].by[k] = (float)(o->depths == 1 && k == HADA_POINT_DEPTH ? 0.0 : by[k]);
        count++;
    }
    return count;
}
