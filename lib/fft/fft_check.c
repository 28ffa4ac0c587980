/* A new plan is run once on a few points whose transform is evaluated directly in double precision. The points reach
 * every output, so that a wrong lane, block or twiddle factor anywhere on their way shows. */

#include "fft/fft_internal.h"

#define POINTS    24
#define TOLERANCE 1e-5 /* of the root of the sum of squares */
#define TWO_PI    6.283185307179586476925286766559

typedef struct point {
    int y, x;
    double re, im;
} point;

static unsigned next_random(unsigned *state)
{
    *state = *state * 1664525u + 1013904223u;
    return *state >> 8;
}

/* Points of a grid: its corners and middle first, then pseudo-random ones; none twice. Returns how many. */
static int choose(point *points, int rows, int cols, int y0, int x0, unsigned seed)
{
    const int corners[5][2] = {{0, 0}, {0, cols - 1}, {rows - 1, 0}, {rows - 1, cols - 1}, {rows / 2, cols / 2}};
    int count = 0;
    for (int i = 0; i < 4 * POINTS && count < POINTS; i++) {
        unsigned a = next_random(&seed), b = next_random(&seed);
        point p = {.y = y0 + (i < 5 ? corners[i][0] : (int)(a % (unsigned)rows)),
                   .x = x0 + (i < 5 ? corners[i][1] : (int)(b % (unsigned)cols))};
        p.re = (float)next_random(&seed) / 8388608.0f - 1.0f;
        p.im = (float)next_random(&seed) / 8388608.0f - 1.0f;
        int known = 0;
        for (int k = 0; k < count; k++)
            known |= points[k].y == p.y && points[k].x == p.x;
        if (!known)
            points[count++] = p;
    }
    return count;
}

static double angle(const point *a, const point *b, int rows, int cols)
{
    return TWO_PI * ((double)((long long)a->y * b->y % rows) / rows + (double)((long long)a->x * b->x % cols) / cols);
}

static double norm(const point *points, int count)
{
    double sum = 0.0;
    for (int i = 0; i < count; i++)
        sum += points[i].re * points[i].re + points[i].im * points[i].im;
    return sqrt(sum);
}

static size_t real_index(const hada_fft_desc *desc, const point *p)
{
    return (size_t)(p->y - desc->row0) * desc->real_pitch + (size_t)(p->x - desc->col0);
}

static hada_status failed(const hada_fft *plan, double error, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_SELF_TEST,
                     "the %s transform of %d x %d gives wrong results on %s (error %.1e where %.0e is allowed): choose "
                     "another back end in the tuning file or another device",
                     plan->desc.direction == HADA_FFT_FORWARD ? "forward" : "inverse", plan->desc.rows, plan->desc.cols,
                     plan->slot->context->info.name, error, TOLERANCE);
}

static hada_status check_forward(hada_fft *plan, hada_buffer *real, hada_buffer *spectrum, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    point in[POINTS], out[POINTS];
    const int in_count = choose(in, desc->real_rows, desc->real_cols, desc->row0, desc->col0, 1u);
    const int out_count = choose(out, desc->rows, desc->band_cols + 1, 0, 0, 2u);
    HADA_TRY(hada_buffer_clear(real, plan->slot, 0, real->bytes, err));
    for (int i = 0; i < in_count; i++) {
        const float value = (float)in[i].re;
        in[i].im = 0.0;
        HADA_TRY(
            hada_buffer_write(real, plan->slot, real_index(desc, &in[i]) * sizeof value, &value, sizeof value, err));
    }
    HADA_TRY(plan->engine->forward(plan, 1, real->mem, 0, spectrum->mem, 0, err));
    const double scale = norm(in, in_count);
    for (int k = 0; k < out_count; k++) {
        float got[2];
        double re = 0.0, im = 0.0;
        HADA_TRY(hada_buffer_read(spectrum, plan->slot,
                                  hada_spectrum_index(&plan->layout, out[k].y, out[k].x) * sizeof got, got, sizeof got,
                                  err));
        for (int i = 0; i < in_count; i++) {
            const double a = angle(&in[i], &out[k], desc->rows, desc->cols);
            re += in[i].re * cos(a);
            im -= in[i].re * sin(a);
        }
        const double error = hypot(got[0] - re, got[1] - im) / scale;
        if (!(error <= TOLERANCE))
            return failed(plan, error, err);
    }
    return HADA_OK;
}

static hada_status check_inverse(hada_fft *plan, hada_buffer *real, hada_buffer *spectrum, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    point in[POINTS], out[POINTS];
    const int in_count = choose(in, desc->band_rows + 1, desc->band_cols + 1, 0, 0, 3u);
    const int out_count = choose(out, desc->real_rows, desc->real_cols, desc->row0, desc->col0, 4u);
    const double size = (double)desc->rows * desc->cols;
    const hada_fft_filter none = {.product = HADA_FFT_PLAIN,
                                  .spectrum_count = 1,
                                  .stride = 1,
                                  .band_rows = desc->band_rows,
                                  .band_cols = desc->band_cols};
    HADA_TRY(hada_buffer_clear(spectrum, plan->slot, 0, spectrum->bytes, err));
    for (int i = 0; i < in_count; i++) {
        const float value[2] = {(float)in[i].re, (float)in[i].im};
        if (in[i].y && i % 2) /* half of them at negative frequencies */
            in[i].y = desc->rows - in[i].y;
        HADA_TRY(hada_buffer_write(spectrum, plan->slot,
                                   hada_spectrum_index(&plan->layout, in[i].y, in[i].x) * sizeof value, value,
                                   sizeof value, err));
    }
    HADA_TRY(plan->engine->inverse(plan, 1, spectrum->mem, 0, real->mem, 0, &none, err));
    const double scale = norm(in, in_count);
    for (int k = 0; k < out_count; k++) {
        float got;
        double sum = 0.0;
        HADA_TRY(hada_buffer_read(real, plan->slot, real_index(desc, &out[k]) * sizeof got, &got, sizeof got, err));
        for (int i = 0; i < in_count; i++) {
            const double a = angle(&in[i], &out[k], desc->rows, desc->cols);
            const int single = in[i].x == 0 || 2 * in[i].x == desc->cols;
            sum += (single ? 1.0 : 2.0) * (in[i].re * cos(a) - in[i].im * sin(a));
        }
        const double error = fabs(got * size - sum) / scale;
        if (!(error <= TOLERANCE))
            return failed(plan, error, err);
    }
    return HADA_OK;
}

hada_status hada_fft_check(hada_fft *plan, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    const size_t floats = (size_t)(desc->real_rows - 1) * desc->real_pitch + (size_t)desc->real_cols;
    hada_buffer real = {0}, spectrum = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(
        hada_buffer_create(&real, plan->slot->context, floats * sizeof(float), "a transform's check", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&spectrum, plan->slot->context, plan->layout.count * 2 * sizeof(float),
                                        "a transform's check", err));
    if (!plan->slot->context->dry)
        HADA_TRY_OR_DONE(desc->direction == HADA_FFT_FORWARD ? check_forward(plan, &real, &spectrum, err)
                                                             : check_inverse(plan, &real, &spectrum, err));
done:
    hada_slot_finish(plan->slot, NULL);
    HADA_DESTROY_BUFFERS(&real, &spectrum);
    return status;
}
