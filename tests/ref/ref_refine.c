#include "ref/ref_refine.h"

#include <math.h>
#include <stdlib.h>

#include "ref/ref_fft.h"
#include "ref/ref_ridge.h"
#include "ref/ref_tv.h"

/* A channel: images of the whole grid (x, u, d per depth; data, v, e, y once) and half spectra. */
typedef struct ref_state {
    const hada_ref_refine *p;
    const double *given; /* [pixels] */
    size_t channel;
    size_t pixels, values;
    double *memory;
    double *x, *u, *d;         /* [depth][pixels] */
    double *v, *e, *y, *image; /* [pixels] */
    double *spectra;           /* [depth][values] complex */
    double *data;              /* [values] complex */
} ref_state;

static const double *otf_of(const ref_state *s, int z)
{
    return s->p->otf + 2 * ((size_t)z * (size_t)s->p->channels + s->channel) * s->values;
}

/* X_z: minimises |Y - sum H X|^2 + prior |X|^2 + rho sum |X - V|^2, Y in s->data and V in s->spectra, in place. */
static void solve(ref_state *s, double rho)
{
    const hada_ref_refine *p = s->p;
    for (size_t f = 0; f < s->values; f++) {
        const double g = rho + (p->prior ? p->prior[s->channel * s->values + f] : 0.0);
        double square = 0.0, t_re = 0.0, t_im = 0.0;
        for (int z = 0; z < p->depths; z++) { /* c = conj(H) Y + rho V, in place; t = sum H c / (g + sum |H|^2) */
            const double *h = otf_of(s, z) + 2 * f;
            double *c = s->spectra + 2 * ((size_t)z * s->values + f);
            const double re = h[0] * s->data[2 * f] + h[1] * s->data[2 * f + 1] + rho * c[0];
            const double im = h[0] * s->data[2 * f + 1] - h[1] * s->data[2 * f] + rho * c[1];
            c[0] = re;
            c[1] = im;
            square += h[0] * h[0] + h[1] * h[1];
            t_re += h[0] * re - h[1] * im;
            t_im += h[0] * im + h[1] * re;
        }
        t_re /= g + square;
        t_im /= g + square;
        for (int z = 0; z < p->depths; z++) {
            const double *h = otf_of(s, z) + 2 * f;
            double *c = s->spectra + 2 * ((size_t)z * s->values + f);
            c[0] = (c[0] - (h[0] * t_re + h[1] * t_im)) / g;
            c[1] = (c[1] - (h[0] * t_im - h[1] * t_re)) / g;
        }
    }
}

/* y = sum PSF * (what s->spectra holds). */
static hada_status project(ref_state *s, hada_error *err)
{
    const hada_ref_refine *p = s->p;
    for (size_t f = 0; f < s->values; f++) {
        double re = 0.0, im = 0.0;
        for (int z = 0; z < p->depths; z++) {
            const double *h = otf_of(s, z) + 2 * f;
            const double *c = s->spectra + 2 * ((size_t)z * s->values + f);
            re += h[0] * c[0] - h[1] * c[1];
            im += h[0] * c[1] + h[1] * c[0];
        }
        s->data[2 * f] = re;
        s->data[2 * f + 1] = im;
    }
    return hada_ref_fft_inverse(s->data, p->rows, p->cols, s->y, err);
}

/* The weight of a pixel whose light is `light`. */
static double weight_of(const ref_state *s, size_t i, double light)
{
    const double weight = s->p->weights ? s->p->weights[s->channel * s->pixels + i] : 1.0;
    const int known = !s->p->padded || hada_ref_inside(&s->p->frame, s->p->cols, i);
    return !known || (weight < 0.0 && light > s->given[i]) ? 0.0 : fabs(weight);
}

static double energy(const ref_state *s, const double *image)
{
    double sum = 0.0;
    for (size_t i = 0; i < s->pixels; i++)
        if (weight_of(s, i, image[i]) > 0.0)
            sum += (s->given[i] - image[i]) * (s->given[i] - image[i]);
    return sum;
}

static hada_status all_forward(ref_state *s, const double *images, hada_error *err)
{
    for (int z = 0; z < s->p->depths; z++)
        HADA_TRY(hada_ref_fft_forward(images + (size_t)z * s->pixels, s->p->rows, s->p->cols,
                                      s->spectra + 2 * (size_t)z * s->values, err));
    return HADA_OK;
}

static double rho_of(const hada_ref_refine *p, int step)
{
    if (step >= p->steps)
        return p->ridge_rho;
    return p->first_rho > 0.0 ? fmin(p->rho, p->first_rho * pow(p->growth, step)) : p->rho;
}

/* The linear step; x becomes the relaxed x plus the dual. */
static hada_status linear(ref_state *s, int number, hada_error *err)
{
    const hada_ref_refine *p = s->p;
    const size_t all = (size_t)p->depths * s->pixels;
    const double usual = number < p->first_steps ? p->first_relaxation : p->relaxation;
    const int ridge = number >= p->steps;
    const double relaxation = number && !ridge ? usual : 1.0, rho = rho_of(p, number);
    for (size_t i = 0; number && i < all; i++) /* the dual is scaled: rho d stays what it is */
        s->d[i] *= ridge ? 0.0 : rho_of(p, number - 1) / rho;
    for (size_t i = 0; i < s->pixels; i++)
        s->image[i] = p->padded ? s->v[i] - s->e[i] : s->given[i];
    for (size_t i = 0; i < all; i++)
        s->x[i] = s->u[i] - s->d[i];
    HADA_TRY(hada_ref_fft_forward(s->image, p->rows, p->cols, s->data, err));
    HADA_TRY(all_forward(s, s->x, err));
    solve(s, rho);
    for (int z = 0; z < p->depths; z++)
        HADA_TRY(hada_ref_fft_inverse(s->spectra + 2 * (size_t)z * s->values, p->rows, p->cols,
                                      s->x + (size_t)z * s->pixels, err));
    HADA_TRY(project(s, err));
    for (size_t i = 0; i < all; i++)
        s->x[i] = relaxation * s->x[i] + (1.0 - relaxation) * s->u[i] + s->d[i];
    for (size_t i = 0; p->padded && i < s->pixels; i++) {
        const double y = relaxation * s->y[i] + (1.0 - relaxation) * s->v[i], a = y + s->e[i];
        const double w = weight_of(s, i, a);
        s->v[i] = w > 0.0 ? (w * s->given[i] + p->mu * a) / (w + p->mu) : a;
        s->e[i] = a - s->v[i];
    }
    return HADA_OK;
}

/* The proximal step from x to u, all channels, and the duals. */
typedef struct tv_room {
    double *w, *u; /* [channel][window]: a depth's */
    double *duals; /* [depth][channel][2][window] */
} tv_room;

/* From w to u with total variation, or with the learned regulariser in the last steps. */
static hada_status smooth(const hada_ref_refine *p, int number, const tv_room *tv, double *duals, hada_error *err)
{
    if (number >= p->steps)
        return hada_ref_ridge(tv->w, p->channels, p->window.rows, p->window.cols, p->ridge_noise, tv->u, err);
    return hada_ref_tv_coupled(tv->w, p->channels, p->window.rows, p->window.cols, p->tv / rho_of(p, number),
                               p->tv_colour, p->tv_length, p->tv_steps, duals, tv->u, err);
}

static hada_status proximal(ref_state *states, int number, const tv_room *tv, hada_error *err)
{
    const hada_ref_refine *p = states->p;
    const size_t channels = (size_t)p->channels, area = (size_t)p->window.rows * (size_t)p->window.cols;
    for (size_t z = 0; z < (size_t)p->depths; z++) {
        for (size_t i = 0; i < channels * area; i++)
            tv->w[i] = states[i / area].x[z * states->pixels + hada_ref_on_grid(&p->window, p->cols, i % area)];
        if (p->tv > 0.0)
            HADA_TRY(smooth(p, number, tv, tv->duals + z * 2 * channels * area, err));
        for (size_t i = 0; i < channels * area; i++)
            states[i / area].u[z * states->pixels + hada_ref_on_grid(&p->window, p->cols, i % area)] =
                p->tv > 0.0 ? tv->u[i] : fmax(tv->w[i], 0.0);
    }
    for (size_t c = 0; c < channels; c++)
        for (size_t i = 0; i < (size_t)p->depths * states->pixels; i++)
            states[c].d[i] = states[c].x[i] - states[c].u[i];
    return HADA_OK;
}

static hada_status start(ref_state *s, const hada_ref_refine *p, size_t channel, hada_error *err)
{
    const size_t depths = (size_t)p->depths;
    *s = (ref_state){.p = p,
                     .channel = channel,
                     .pixels = (size_t)p->rows * (size_t)p->cols,
                     .values = (size_t)p->rows * (size_t)(p->cols / 2 + 1)};
    s->given = p->image + channel * s->pixels;
    const size_t count = (3 * depths + 4) * s->pixels + (depths + 1) * 2 * s->values;
    hada_status status = hada_allocated(s->memory = hada_alloc(count, sizeof(double), "the reference refinement", err));
    if (status)
        return status;
    s->x = s->memory;
    s->u = s->x + depths * s->pixels;
    s->d = s->u + depths * s->pixels;
    s->v = s->d + depths * s->pixels;
    s->e = s->v + s->pixels;
    s->y = s->e + s->pixels;
    s->image = s->y + s->pixels;
    s->spectra = s->image + s->pixels;
    s->data = s->spectra + depths * 2 * s->values;
    for (size_t i = 0; i < s->pixels; i++)
        s->v[i] = s->given[i];
    return HADA_OK;
}

static hada_status run(ref_state *states, const tv_room *tv, double *residual, double *split, hada_error *err)
{
    const hada_ref_refine *p = states->p;
    for (int k = 0; k <= p->steps + p->ridge_steps; k++) {
        if (residual)
            residual[k] = 0.0;
        if (split)
            split[k] = 0.0;
        for (int c = 0; k && c < p->channels; c++)
            HADA_TRY(linear(states + c, k - 1, err));
        if (k)
            HADA_TRY(proximal(states, k - 1, tv, err));
        for (int c = 0; c < p->channels; c++) {
            ref_state *s = states + c;
            if (split)
                split[k] += energy(s, k ? s->v : s->y);
            if (!residual)
                continue;
            HADA_TRY(all_forward(s, s->u, err));
            HADA_TRY(project(s, err));
            residual[k] += energy(s, s->y);
        }
    }
    return HADA_OK;
}

hada_status hada_ref_refine_run(const hada_ref_refine *p, double *planes, double *residual, double *split,
                                hada_error *err)
{
    const size_t channels = (size_t)p->channels, depths = (size_t)p->depths;
    const size_t area = (size_t)p->window.rows * (size_t)p->window.cols;
    ref_state *states;
    double *memory;
    hada_status status = hada_allocated(states = hada_alloc(channels, sizeof *states, "the reference refinement", err));
    if (status)
        return status;
    status = hada_allocated(
        memory = hada_alloc((2 + 2 * depths) * channels * area, sizeof *memory, "the reference refinement", err));
    for (size_t c = 0; !status && c < channels; c++)
        status = start(states + c, p, c, err);
    if (!status) {
        const tv_room tv = {memory, memory + channels * area, memory + 2 * channels * area};
        status = run(states, &tv, residual, split, err);
    }
    for (size_t i = 0; !status && i < depths * channels * area; i++)
        planes[i] = states[i / area % channels]
                        .u[i / area / channels * states->pixels + hada_ref_on_grid(&p->window, p->cols, i % area)];
    for (size_t c = 0; c < channels; c++)
        free(states[c].memory);
    HADA_FREE(states, memory);
    return status;
}
