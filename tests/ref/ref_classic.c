#include "ref/ref_classic.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ref/ref_fft.h"

typedef struct work {
    const hada_ref_classic *p;
    size_t pixels, values, all; /* of the grid; half spectrum; planes of all depths */
    double *spectra;            /* [depth][values] complex */
    double *sum;                /* [values] complex */
} work;

static int seen(const hada_ref_classic *p, size_t pixel)
{
    return !p->padded || hada_ref_inside(&p->frame, p->cols, pixel);
}

static double size_of(const hada_ref_classic *p, size_t pixel)
{
    return !seen(p, pixel) ? 0.0 : p->weights ? fabs(p->weights[pixel]) : 1.0;
}

/* Whether a saturated value says nothing against this prediction, for it is above it. */
static int above(const hada_ref_classic *p, size_t pixel, double prediction)
{
    return p->weights && p->weights[pixel] < 0.0 && prediction > p->image[pixel];
}

static hada_status room(double **out, size_t count, hada_error *err)
{
    return hada_allocated(*out = hada_alloc(count, sizeof(double), "the reference", err));
}

static hada_status to_spectra(work *w, const double *planes, hada_error *err)
{
    for (size_t z = 0; z < (size_t)w->p->depths; z++)
        HADA_TRY(
            hada_ref_fft_forward(planes + z * w->pixels, w->p->rows, w->p->cols, w->spectra + z * 2 * w->values, err));
    return HADA_OK;
}

static hada_status from_spectra(work *w, double *planes, hada_error *err)
{
    for (size_t z = 0; z < (size_t)w->p->depths; z++)
        HADA_TRY(
            hada_ref_fft_inverse(w->spectra + z * 2 * w->values, w->p->rows, w->p->cols, planes + z * w->pixels, err));
    return HADA_OK;
}

/* y = sum PSF * x on the whole grid. */
static hada_status project(work *w, const double *planes, double *y, hada_error *err)
{
    HADA_TRY(to_spectra(w, planes, err));
    for (size_t f = 0; f < w->values; f++) {
        w->sum[2 * f] = w->sum[2 * f + 1] = 0.0;
        for (size_t z = 0; z < (size_t)w->p->depths; z++) {
            const double *h = w->p->otf + 2 * (z * w->values + f), *x = w->spectra + 2 * (z * w->values + f);
            w->sum[2 * f] += h[0] * x[0] - h[1] * x[1];
            w->sum[2 * f + 1] += h[0] * x[1] + h[1] * x[0];
        }
    }
    return hada_ref_fft_inverse(w->sum, w->p->rows, w->p->cols, y, err);
}

/* The transpose: correlations of an image with every PSF. */
static hada_status transpose(work *w, const double *image, double *planes, hada_error *err)
{
    HADA_TRY(hada_ref_fft_forward(image, w->p->rows, w->p->cols, w->sum, err));
    for (size_t z = 0; z < (size_t)w->p->depths; z++)
        for (size_t f = 0; f < w->values; f++) {
            const double *h = w->p->otf + 2 * (z * w->values + f);
            double *x = w->spectra + 2 * (z * w->values + f);
            x[0] = h[0] * w->sum[2 * f] + h[1] * w->sum[2 * f + 1];
            x[1] = h[0] * w->sum[2 * f + 1] - h[1] * w->sum[2 * f];
        }
    return from_spectra(w, planes, err);
}

/* Solves (d + m sum conj(H) H) X = C for all depths, C in w->spectra, d the weight at a frequency, in place. */
static void divide(work *w, const double *d, double m)
{
    const size_t depths = (size_t)w->p->depths;
    for (size_t f = 0; f < w->values; f++) {
        double square = 0.0, re = 0.0, im = 0.0;
        for (size_t z = 0; z < depths; z++) {
            const double *h = w->p->otf + 2 * (z * w->values + f), *c = w->spectra + 2 * (z * w->values + f);
            square += h[0] * h[0] + h[1] * h[1];
            re += h[0] * c[0] - h[1] * c[1];
            im += h[0] * c[1] + h[1] * c[0];
        }
        re *= m / (d[f] + m * square);
        im *= m / (d[f] + m * square);
        for (size_t z = 0; z < depths; z++) {
            const double *h = w->p->otf + 2 * (z * w->values + f);
            double *c = w->spectra + 2 * (z * w->values + f);
            c[0] = (c[0] - (h[0] * re + h[1] * im)) / d[f];
            c[1] = (c[1] - (h[0] * im - h[1] * re)) / d[f];
        }
    }
}

static double distance(const double *a, const double *b, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += (a[i] - (b ? b[i] : 0.0)) * (a[i] - (b ? b[i] : 0.0));
    return sqrt(sum);
}

/* X = conj(H) B / (sum |H|^2 + lambda). */
static hada_status wiener(work *w, double *x, hada_error *err)
{
    double *d;
    hada_status status = room(&d, w->values, err);
    if (status)
        return status;
    for (size_t f = 0; f < w->values; f++)
        d[f] = w->p->lambda;
    status = transpose(w, w->p->image, x, err);
    if (!status)
        status = to_spectra(w, x, err);
    if (!status)
        divide(w, d, 1.0);
    if (!status)
        status = from_spectra(w, x, err);
    for (size_t i = 0; !status && i < w->all; i++)
        if (!hada_ref_inside(&w->p->support, w->p->cols, i % w->pixels))
            x[i] = 0.0;
    free(d);
    return status;
}

static double difference(const double *image, const hada_ref_rect *rect, int cols, int row, int col, int row2, int col2)
{
    if (row < rect->row0 || col < rect->col0 || row >= rect->row0 + rect->rows || col >= rect->col0 + rect->cols)
        return 0.0;
    if (row2 >= rect->row0 + rect->rows || col2 >= rect->col0 + rect->cols)
        return 0.0;
    return image[(size_t)row2 * (size_t)cols + (size_t)col2] - image[(size_t)row * (size_t)cols + (size_t)col];
}

/* div(grad y / |grad y|) at a pixel of one plane, within the support. */
static double curvature(const double *y, const hada_ref_classic *p, int row, int col)
{
    static const int at[4][3] = {{0, 0, 0}, {-1, 0, 0}, {0, 0, 1}, {0, -1, 1}};
    double sum = 0.0;
    for (int k = 0; k < 4; k++) {
        const int i = row + at[k][0], j = col + at[k][1], way = at[k][2];
        const double down = difference(y, &p->support, p->cols, i, j, i + 1, j);
        const double right = difference(y, &p->support, p->cols, i, j, i, j + 1);
        sum += (k % 2 ? -1.0 : 1.0) * (way ? right : down) / sqrt(down * down + right * right + 1e-30);
    }
    return sum;
}

/* out = a Gaussian of the support of each plane, of 7 standard deviations across, and of nothing beyond it. */
static void blur(const work *w, const double *x, double *out)
{
    const hada_ref_classic *p = w->p;
    const int reach = (int)ceil(3.5 * p->sieve);
    double sum = 0.0;
    for (int i = -reach; i <= reach; i++)
        sum += exp(-0.5 * i * i / (p->sieve * p->sieve));
    memset(out, 0, w->all * sizeof *out);
    for (size_t at = 0; at < w->all; at++) {
        const int row = (int)(at % w->pixels / (size_t)p->cols), col = (int)(at % w->pixels % (size_t)p->cols);
        for (int i = -reach; i <= reach; i++)
            for (int j = -reach; j <= reach; j++) {
                const int r = row + i, c = col + j;
                if (r < 0 || c < 0 || r >= p->rows || c >= p->cols)
                    continue;
                const size_t pixel = (size_t)r * (size_t)p->cols + (size_t)c;
                if (hada_ref_inside(&p->support, p->cols, at % w->pixels) &&
                    hada_ref_inside(&p->support, p->cols, pixel))
                    out[at] += exp(-0.5 * (i * i + j * j) / (p->sieve * p->sieve)) / (sum * sum) *
                               x[at - at % w->pixels + pixel];
            }
    }
}

/* W. Richardson 1972, L. Lucy 1974; D. Biggs and M. Andrews, Applied Optics 36(8), 1997; N. Dey et al., Microscopy
 * Research and Technique 69, 2006. */
static hada_status lucy(work *w, double *x, double *change, hada_error *err)
{
    const hada_ref_classic *p = w->p;
    double *memory;
    hada_status status = room(&memory, 7 * w->all + w->pixels, err);
    if (status)
        return status;
    double *y = memory, *norm = y + w->all, *old = norm + w->all, *correct = old + w->all, *g = correct + w->all;
    double *g_last = g + w->all, *blurred = g_last + w->all, *image = blurred + w->all;
    const double *shown = p->sieve > 0.0 ? blurred : y;
    for (size_t i = 0; i < w->pixels; i++)
        image[i] = size_of(p, i);
    status = transpose(w, image, p->sieve > 0.0 ? blurred : norm, err);
    if (p->sieve > 0.0)
        blur(w, blurred, norm);
    for (size_t i = 0; i < w->all; i++)
        x[i] = y[i] = hada_ref_inside(&p->support, p->cols, i % w->pixels) ? p->flat : 0.0;
    for (int k = 0; !status && k < p->iterations; k++) {
        const double floor = p->beside > 0.0 ? 0.1 * p->beside : p->floor;
        if (p->sieve > 0.0)
            blur(w, y, blurred);
        status = project(w, shown, image, err);
        for (size_t i = 0; i < w->pixels; i++)
            image[i] =
                size_of(p, i) *
                (above(p, i, image[i]) ? 1.0 : fmax(p->image[i] + p->beside, 0.0) / fmax(image[i] + p->beside, floor));
        if (!status)
            status = transpose(w, image, p->sieve > 0.0 ? blurred : correct, err);
        if (p->sieve > 0.0)
            blur(w, blurred, correct);
        memcpy(old, x, w->all * sizeof *x);
        memcpy(g_last, g, w->all * sizeof *g);
        double mixed = 0.0, last = 0.0;
        for (size_t i = 0; i < w->all; i++) {
            const size_t pixel = i % w->pixels;
            if (!hada_ref_inside(&p->support, p->cols, pixel))
                continue;
            double divisor = fmax(norm[i], p->seen);
            if (p->weight > 0.0)
                divisor *= fmax(0.1, 1.0 - p->weight * curvature(y + i - pixel, p, (int)(pixel / (size_t)p->cols),
                                                                 (int)(pixel % (size_t)p->cols)));
            x[i] = y[i] * fmax(correct[i], 0.0) / divisor;
            g[i] = x[i] - y[i];
            mixed += g[i] * g_last[i];
            last += g_last[i] * g_last[i];
        }
        const double factor = p->accelerate && last > 0.0 ? fmax(0.0, fmin(mixed / last, 0.999)) : 0.0;
        for (size_t i = 0; i < w->all; i++)
            y[i] = fmax(0.0, x[i] + factor * (x[i] - old[i]));
        *change = distance(x, old, w->all) / distance(x, NULL, w->all);
    }
    if (p->sieve > 0.0) {
        blur(w, x, blurred);
        memcpy(x, blurred, w->all * sizeof *x);
    }
    free(memory);
    return status;
}

/* The support of a plane, out of it or into it. */
static void cut(const hada_ref_classic *p, double *plane, double *part, int back)
{
    for (int row = 0; row < p->support.rows; row++) {
        double *here = plane + (size_t)(row + p->support.row0) * (size_t)p->cols + (size_t)p->support.col0;
        double *there = part + (size_t)row * (size_t)p->support.cols;
        memcpy(back ? here : there, back ? there : here, (size_t)p->support.cols * sizeof *part);
    }
}

/* Beck and Teboulle, SIAM J. Imaging Sciences 2(1), 2009. The prior acts on the support, an image by itself. */
static hada_status fista(work *w, double *x, double *change, hada_error *err)
{
    const hada_ref_classic *p = w->p;
    const size_t part = (size_t)p->support.rows * (size_t)p->support.cols;
    double *memory, t = 1.0;
    hada_status status = room(&memory, 2 * w->all + w->pixels + part * (1 + 2 * (size_t)p->depths), err);
    if (status)
        return status;
    double *v = memory, *z = v + w->all, *image = z + w->all, *small = image + w->pixels, *duals = small + part;
    const double limit = p->weight * p->step;
    for (int k = 0; !status && k < p->iterations; k++) {
        status = project(w, v, image, err);
        for (size_t i = 0; i < w->pixels; i++)
            image[i] = above(p, i, image[i]) ? 0.0 : size_of(p, i) * (p->image[i] - image[i]);
        if (!status)
            status = transpose(w, image, z, err);
        for (size_t i = 0; i < w->all; i++)
            z[i] = hada_ref_inside(&p->support, p->cols, i % w->pixels) ? v[i] + p->step * z[i] : 0.0;
        for (size_t d = 0; !status && p->prior != HADA_REF_NONE && d < (size_t)p->depths; d++) {
            cut(p, z + d * w->pixels, small, 0);
            status = p->prior == HADA_REF_TV ? hada_ref_tv(small, duals + 2 * d * part, p->support.rows,
                                                           p->support.cols, limit, p->inner, err)
                                             : hada_ref_haar(small, p->support.rows, p->support.cols, limit, p->levels,
                                                             p->prior == HADA_REF_HAAR, err);
            cut(p, z + d * w->pixels, small, 1);
        }
        const double t_next = (1.0 + sqrt(1.0 + 4.0 * t * t)) / 2.0;
        for (size_t i = 0; i < w->all; i++)
            z[i] = fmax(0.0, z[i]);
        *change = distance(z, x, w->all) / distance(z, NULL, w->all);
        for (size_t i = 0; i < w->all; i++) {
            v[i] = z[i] + (t - 1.0) / t_next * (z[i] - x[i]);
            x[i] = z[i];
        }
        t = t_next;
    }
    free(memory);
    return status;
}

static size_t before(size_t i, size_t n)
{
    return (i + n - 1) % n;
}

/* out[0], out[1]: x[i-1, j] - x[i, j] and x[i, j-1] - x[i, j], round the edges. */
static void gradient(const hada_ref_classic *p, const double *x, double *out)
{
    const size_t rows = (size_t)p->rows, cols = (size_t)p->cols;
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < cols; j++) {
            out[i * cols + j] = x[before(i, rows) * cols + j] - x[i * cols + j];
            out[(rows + i) * cols + j] = x[i * cols + before(j, cols)] - x[i * cols + j];
        }
}

/* Its transpose, added to out with a factor. */
static void gradient_back(const hada_ref_classic *p, const double *u, double factor, double *out)
{
    const size_t rows = (size_t)p->rows, cols = (size_t)p->cols;
    for (size_t i = 0; i < rows; i++)
        for (size_t j = 0; j < cols; j++)
            out[i * cols + j] += factor * (u[(i + 1) % rows * cols + j] - u[i * cols + j] +
                                           u[(rows + i) * cols + (j + 1) % cols] - u[(rows + i) * cols + j]);
}

static void add_duals(double *dual, const double *ax, const double *split, size_t count)
{
    for (size_t i = 0; i < count; i++)
        dual[i] += ax[i] - split[i];
}

/* M. Almeida and M. Figueiredo, IEEE TIP 22(8), 2013; Antipa et al., Optica 5(1), 2018: splits of the data (v), of the
 * gradient (u) and of the planes (n), their duals a, e, r. */
static hada_status admm(work *w, double *x, double *change, hada_error *err)
{
    const hada_ref_classic *p = w->p;
    const size_t n = w->pixels, all = w->all, cols = (size_t)p->cols / 2 + 1;
    const double pi = acos(-1.0), theta = p->mu2 > 0.0 ? p->weight / p->mu2 : 0.0;
    double *memory;
    hada_status status = room(&memory, 11 * all + 4 * n + w->values, err);
    if (status)
        return status;
    double *u = memory, *e = u + 2 * all, *ax = e + 2 * all, *split = ax + 2 * all, *r = split + all, *q = r + all;
    double *old = q + all, *v = old + 2 * all, *a = v + n, *y = a + n, *image = y + n, *d = image + n;
    for (size_t f = 0; f < w->values; f++)
        d[f] = p->mu3 + p->mu2 * (4.0 - 2.0 * cos(2.0 * pi * (double)(f / cols) / p->rows) -
                                  2.0 * cos(2.0 * pi * (double)(f % cols) / p->cols));
    for (int k = 0; !status && k < p->iterations; k++) {
        for (size_t i = 0; i < 2 * all; i++) {
            const double s = ax[i] + e[i];
            u[i] = copysign(fmax(fabs(s) - theta, 0.0), s);
        }
        for (size_t i = 0; i < all; i++)
            split[i] = hada_ref_inside(&p->support, p->cols, i % n) ? fmax(0.0, x[i] + r[i]) : 0.0;
        for (size_t i = 0; i < n; i++) {
            const double size = above(p, i, y[i] + a[i]) ? 0.0 : size_of(p, i);
            v[i] = (size * p->image[i] + p->mu1 * (y[i] + a[i])) / (size + p->mu1);
            image[i] = p->padded ? p->mu1 * (v[i] - a[i]) : p->image[i];
        }
        status = transpose(w, image, q, err);
        for (size_t z = 0; z < (size_t)p->depths; z++) {
            double *back = old + 2 * z * n, *to = q + z * n; /* `old` is scratch here */
            for (size_t i = 0; i < 2 * n; i++)
                back[i] = u[2 * z * n + i] - e[2 * z * n + i];
            gradient_back(p, back, p->mu2, to);
            for (size_t i = 0; i < n; i++)
                to[i] += p->mu3 * (split[z * n + i] - r[z * n + i]);
        }
        memcpy(old, x, all * sizeof *x);
        if (!status)
            status = to_spectra(w, q, err);
        if (!status)
            divide(w, d, p->padded ? p->mu1 : 1.0);
        if (!status)
            status = from_spectra(w, x, err);
        if (!status)
            status = project(w, x, y, err);
        for (size_t z = 0; z < (size_t)p->depths; z++)
            gradient(p, x + z * n, ax + 2 * z * n);
        add_duals(e, ax, u, 2 * all);
        add_duals(r, x, split, all);
        add_duals(a, y, v, n);
        *change = distance(x, old, all) / distance(x, NULL, all);
    }
    free(memory);
    return status;
}

hada_status hada_ref_classic_run(const hada_ref_classic *p, double *planes, double *change, hada_error *err)
{
    work w = {.p = p, .pixels = (size_t)p->rows * (size_t)p->cols};
    double none;
    w.values = (size_t)p->rows * (size_t)(p->cols / 2 + 1);
    w.all = w.pixels * (size_t)p->depths;
    hada_status status = room(&w.spectra, 2 * w.values * ((size_t)p->depths + 1), err);
    if (status)
        return status;
    w.sum = w.spectra + 2 * w.values * (size_t)p->depths;
    memset(planes, 0, w.all * sizeof *planes);
    if (!change)
        change = &none;
    *change = 0.0;
    status = p->method == HADA_REF_WIENER  ? wiener(&w, planes, err)
             : p->method == HADA_REF_RL    ? lucy(&w, planes, change, err)
             : p->method == HADA_REF_FISTA ? fista(&w, planes, change, err)
                                           : admm(&w, planes, change, err);
    free(w.spectra);
    return status;
}
