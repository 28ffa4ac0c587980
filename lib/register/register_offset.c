/* Shifts between depths, from their PSFs. */

#include "core/callers.h"
#include "register/register_inside.h"

hada_status hada_register_psf(hada_image *psf, double *pitch, const hada_image *raws, const hada_image *scenes,
                              int count, const hada_registration *registration, hada_error *err)
{
    hada_register_set set = {0};
    hada_register_level level = {0};
    hada_status status = HADA_OK;
    if (!(registration->magnification > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a magnification of %g is not possible",
                         registration->magnification);
    *psf = (hada_image){0};
    HADA_TRY_OR_DONE(hada_register_set_create(&set, raws, scenes, count, err));
    int size = HADA_REGISTER_COARSE;
    while (size < HADA_REGISTER_FINEST && 2 * size <= 1.2 * set.frame_side)
        size *= 2;
    HADA_TRY_OR_DONE(hada_register_level_create(&level, &set, size, err));
    HADA_TRY_OR_DONE(hada_register_level_take(&level, registration, err));
    HADA_TRY_OR_DONE(hada_image_create(psf, 1, size - 1, size - 1, err));
    hada_register_level_psf(&level, psf->data);
    *pitch = level.pitch;
done:
    hada_register_level_destroy(&level);
    hada_register_set_destroy(&set);
    return status;
}

/* Two PSFs on a grid that holds both without wrapping half of them. */
typedef struct match {
    hada_small_fft fft;
    hada_register_plane plane; /* the one that is scaled */
    float *work, *other;       /* complex: the transform of the other one */
    int side;
    double other_energy;
} match;

typedef struct peak {
    double log_scale, row, col, likeness;
} peak;

static double energy_of(const float *x, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += (double)x[2 * i] * x[2 * i];
    return sum;
}

/* The largest correlation coefficient over all shifts, at one scale. */
static hada_status correlate(match *m, peak *at, hada_error *err)
{
    const int n = m->fft.size, mask = n - 1;
    const size_t area = (size_t)n * (size_t)n;
    const double per = exp(-at->log_scale);
    const hada_register_map map = {.inverse = {{per, 0}, {0, per}}};
    hada_register_view view;
    HADA_TRY(hada_register_view_create(&view, &m->plane, per, err));
    memset(m->work, 0, 2 * area * sizeof(float));
    hada_register_sample(&view, &map, 1.0, m->side, m->side, m->work, 2 * n, 2);
    hada_register_view_destroy(&view);
    const double energy = energy_of(m->work, area) * m->other_energy;
    hada_small_fft_run(&m->fft, m->work);
    for (size_t i = 0; i < area; i++) {
        const float re = m->work[2 * i], im = m->work[2 * i + 1], a = m->other[2 * i], b = m->other[2 * i + 1];
        m->work[2 * i] = a * re + b * im;
        m->work[2 * i + 1] = -(b * re - a * im); /* conjugate: a forward transform is then the inverse one */
    }
    hada_small_fft_run(&m->fft, m->work);
    size_t best = 0;
    for (size_t i = 1; i < area; i++)
        if (m->work[2 * i] > m->work[2 * best])
            best = i;
    const int r = (int)(best / (size_t)n), c = (int)(best % (size_t)n);
#define AT(row, col) ((double)m->work[2 * ((size_t)((row)&mask) * (size_t)n + (size_t)((col)&mask))])
    at->row = (r < n / 2 ? r : r - n) + hada_parabola_top(AT(r - 1, c), AT(r, c), AT(r + 1, c));
    at->col = (c < n / 2 ? c : c - n) + hada_parabola_top(AT(r, c - 1), AT(r, c), AT(r, c + 1));
    at->likeness = energy > 0.0 ? AT(r, c) / ((double)area * sqrt(energy)) : 0.0;
#undef AT
    return HADA_OK;
}

/* Every scale from 0.4 to 2.5, then the best one by golden section. */
static hada_status find(match *m, peak *best, hada_error *err)
{
    enum { SCALES = 46, SECTIONS = 12 };
    const double widest = log(2.5), step = 2.0 * widest / SCALES, golden = 0.5 * (sqrt(5.0) - 1.0);
    best->likeness = -1.0;
    for (int i = 0; i <= SCALES; i++) {
        peak at = {.log_scale = step * i - widest};
        HADA_TRY(correlate(m, &at, err));
        if (at.likeness > best->likeness)
            *best = at;
    }
    double low = best->log_scale - step, high = best->log_scale + step;
    peak a = {.log_scale = high - golden * (high - low)}, b = {.log_scale = low + golden * (high - low)};
    HADA_TRY(correlate(m, &a, err));
    HADA_TRY(correlate(m, &b, err));
    for (int i = 0; i < SECTIONS; i++) {
        if (a.likeness > b.likeness) {
            high = b.log_scale;
            b = a;
            a.log_scale = high - golden * (high - low);
            HADA_TRY(correlate(m, &a, err));
        } else {
            low = a.log_scale;
            a = b;
            b.log_scale = low + golden * (high - low);
            HADA_TRY(correlate(m, &b, err));
        }
    }
    const peak *finest = a.likeness > b.likeness ? &a : &b;
    if (finest->likeness > best->likeness)
        *best = *finest;
    return HADA_OK;
}

/* Without the mean, into every second float of n x n. */
static void put(const hada_image *psf, float *to, int n)
{
    const size_t count = hada_image_count(psf);
    double mean = 0.0;
    for (size_t i = 0; i < count; i++)
        mean += psf->data[i] / (double)count;
    for (int r = 0; r < psf->rows; r++)
        for (int c = 0; c < psf->cols; c++)
            to[2 * ((size_t)r * (size_t)n + (size_t)c)] =
                (float)(psf->data[(size_t)r * (size_t)psf->cols + (size_t)c] - mean);
}

hada_status hada_register_offset(const hada_image *psf, const hada_image *other, double pitch, double *scale,
                                 double *row, double *col, double *likeness, hada_error *err)
{
    if (!psf || !other || !psf->data || !other->data || psf->channels != 1 || other->channels != 1 ||
        psf->rows != psf->cols || psf->rows != other->rows || psf->cols != other->cols || !scale || !row || !col ||
        !likeness)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_register_offset: two PSFs of one size from hada_register_psf() are needed");
    match m = {.side = psf->rows};
    peak best = {0};
    int n = 2;
    while (n < 2 * psf->rows)
        n *= 2;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_small_fft_create(&m.fft, n, err));
    HADA_TRY_OR_DONE(hada_register_plane_create(&m.plane, psf->data, psf->rows, psf->cols, err));
    HADA_TRY_OR_DONE(HADA_NEW(m.work, 2 * (size_t)n * (size_t)n, "a transform", err));
    HADA_TRY_OR_DONE(HADA_NEW(m.other, 2 * (size_t)n * (size_t)n, "a transform", err));
    put(other, m.other, n);
    m.other_energy = energy_of(m.other, (size_t)n * (size_t)n);
    hada_small_fft_run(&m.fft, m.other);
    HADA_TRY_OR_DONE(find(&m, &best, err));
    *scale = exp(best.log_scale);
    *row = best.row * pitch;
    *col = best.col * pitch;
    *likeness = best.likeness > 0.0 ? best.likeness : 0.0;
done:
    HADA_FREE(m.work, m.other);
    hada_register_plane_destroy(&m.plane);
    hada_small_fft_destroy(&m.fft);
    return status;
}
