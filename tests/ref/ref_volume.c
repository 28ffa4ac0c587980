#include "ref/ref_volume.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ref/ref_dct.h"
#include "ref/ref_fft.h"
#include "ref/ref_tv.h"

typedef struct state {
    const hada_ref_volume *p;
    size_t pixels, values, area, unknown; /* of the grid, its half spectrum, the window, the run */
    double *image, *kept, *sum, *spectrum, *weight;
    double *at, *gradient, *point, *duals;
} state;

static double share(const hada_ref_volume *p, int plane, size_t pixel)
{
    return p->depth ? fmax(0.0, 1.0 - fabs(p->depth[pixel] - plane)) : 1.0;
}

/* The place of the unknown of a plane and a channel. */
static size_t place(const state *s, int plane, int channel)
{
    return ((s->p->depth ? 0 : (size_t)plane * (size_t)s->p->channels) + (size_t)channel) * s->area;
}

static const double *otf_of(const state *s, int plane, int channel)
{
    return s->p->otf + 2 * ((size_t)plane * (size_t)s->p->channels + (size_t)channel) * s->values;
}

static void crop(const hada_ref_volume *p, double *image)
{
    for (size_t i = 0; p->padded && i < (size_t)p->rows * (size_t)p->cols; i++)
        if (!hada_ref_inside(&p->frame, p->cols, i))
            image[i] = 0.0;
}

static void make_weight(state *s, int channel)
{
    const hada_ref_volume *p = s->p;
    for (size_t f = 0; f < s->values; f++) {
        double square = 0, still = 0;
        for (int z = 0; z < p->planes; z++) {
            const double *h = otf_of(s, z, channel);
            square += h[2 * f] * h[2 * f] + h[2 * f + 1] * h[2 * f + 1];
            still += h[0] * h[0];
        }
        s->weight[f] = p->planes / (square + p->floor * still);
    }
}

/* sum = what the planes at s->at make, in this channel */
static hada_status explain(state *s, int channel, hada_error *err)
{
    const hada_ref_volume *p = s->p;
    memset(s->sum, 0, 2 * s->values * sizeof *s->sum);
    for (int z = 0; z < p->planes; z++) {
        const double *h = otf_of(s, z, channel), *x = s->at + place(s, z, channel);
        memset(s->image, 0, s->pixels * sizeof *s->image);
        for (size_t i = 0; i < s->area; i++)
            s->image[hada_ref_on_grid(&p->window, p->cols, i)] = share(p, z, i) * x[i];
        HADA_TRY(hada_ref_fft_forward(s->image, p->rows, p->cols, s->spectrum, err));
        for (size_t f = 0; f < s->values; f++) {
            s->sum[2 * f] += h[2 * f] * s->spectrum[2 * f] - h[2 * f + 1] * s->spectrum[2 * f + 1];
            s->sum[2 * f + 1] += h[2 * f] * s->spectrum[2 * f + 1] + h[2 * f + 1] * s->spectrum[2 * f];
        }
    }
    return HADA_OK;
}

/* The weight of a value of the data by its residual, model - data. */
static double weight_of(const hada_ref_volume *p, size_t value, double residual)
{
    const double weight = p->weights ? p->weights[value] : 1.0;
    return weight < 0 ? (residual < 0 ? -weight : 0.0) : weight;
}

/* sum = the spectrum of M' W P W M (model - data) */
static hada_status weigh_residual(state *s, int channel, hada_error *err)
{
    const hada_ref_volume *p = s->p;
    const size_t first = (size_t)channel * s->pixels;
    HADA_TRY(hada_ref_fft_inverse(s->sum, p->rows, p->cols, s->image, err));
    for (size_t i = 0; i < s->pixels; i++) {
        const double residual = s->image[i] - p->image[first + i];
        s->kept[i] = weight_of(p, first + i, residual);
        s->image[i] = s->kept[i] * residual;
    }
    crop(p, s->image);
    HADA_TRY(hada_ref_fft_forward(s->image, p->rows, p->cols, s->sum, err));
    for (size_t f = 0; f < 2 * s->values; f++)
        s->sum[f] *= s->weight[f / 2];
    HADA_TRY(hada_ref_fft_inverse(s->sum, p->rows, p->cols, s->image, err));
    for (size_t i = 0; i < s->pixels; i++)
        s->image[i] *= s->kept[i];
    crop(p, s->image);
    return hada_ref_fft_forward(s->image, p->rows, p->cols, s->sum, err);
}

static hada_status correlate(state *s, int channel, hada_error *err)
{
    const hada_ref_volume *p = s->p;
    for (int z = 0; z < p->planes; z++) {
        const double *h = otf_of(s, z, channel);
        double *g = s->gradient + place(s, z, channel);
        for (size_t f = 0; f < s->values; f++) {
            s->spectrum[2 * f] = h[2 * f] * s->sum[2 * f] + h[2 * f + 1] * s->sum[2 * f + 1];
            s->spectrum[2 * f + 1] = h[2 * f] * s->sum[2 * f + 1] - h[2 * f + 1] * s->sum[2 * f];
        }
        HADA_TRY(hada_ref_fft_inverse(s->spectrum, p->rows, p->cols, s->image, err));
        for (size_t i = 0; i < s->area; i++)
            g[i] += share(p, z, i) * s->image[hada_ref_on_grid(&p->window, p->cols, i)];
    }
    return HADA_OK;
}

/* The proximal step of one texture or plane, from the point to the gradient's place. */
static hada_status smooth(state *s, int number, size_t first, hada_error *err)
{
    const hada_ref_volume *p = s->p;
    const int shrinks = number >= p->steps - p->shrink_steps;
    const double theta = p->variation / p->bound;
    double *u = s->gradient + first, *w = s->point + first;
    HADA_TRY(hada_ref_tv_coupled(w, p->channels, p->window.rows, p->window.cols, shrinks ? p->shrink_tv * theta : theta,
                                 fmax(p->colour, 1.0), p->tv_length, p->tv_steps, s->duals + 2 * first, u, err));
    if (shrinks) {
        HADA_TRY(hada_ref_dct_shrink(u, p->channels, p->window.rows, p->window.cols, p->shrink * theta,
                                     p->shrink_colour, w, err));
        memcpy(u, w, (size_t)p->channels * s->area * sizeof *u);
    }
    return HADA_OK;
}

static hada_status step(state *s, int number, double momentum, double *u, hada_error *err)
{
    const hada_ref_volume *p = s->p;
    const size_t each = (size_t)p->channels * s->area;
    memset(s->gradient, 0, s->unknown * sizeof *s->gradient);
    for (int c = 0; c < p->channels; c++) {
        make_weight(s, c);
        HADA_TRY(explain(s, c, err));
        HADA_TRY(weigh_residual(s, c, err));
        HADA_TRY(correlate(s, c, err));
    }
    for (size_t i = 0; i < s->unknown; i++)
        s->point[i] = (p->allowed ? p->allowed[i] : 1.0) * (s->at[i] - s->gradient[i] / p->bound);
    for (size_t first = 0; p->variation > 0 && first < s->unknown; first += each)
        HADA_TRY(smooth(s, number, first, err));
    for (size_t i = 0; i < s->unknown; i++) {
        const double v =
            (p->allowed ? p->allowed[i] : 1.0) * fmax(p->variation > 0 ? s->gradient[i] : s->point[i], 0.0);
        s->at[i] = v + momentum * (v - u[i]);
        u[i] = v;
    }
    return HADA_OK;
}

hada_status hada_ref_volume_run(const hada_ref_volume *p, double *values, hada_error *err)
{
    static const char what[] = "the reference of volumes";
    state s = {.p = p,
               .pixels = (size_t)p->rows * (size_t)p->cols,
               .values = (size_t)p->rows * (size_t)(p->cols / 2 + 1),
               .area = (size_t)p->window.rows * (size_t)p->window.cols};
    double t = 1, *memory = NULL;
    hada_status status = HADA_OK;
    s.unknown = (p->depth ? 1 : (size_t)p->planes) * (size_t)p->channels * s.area;
    HADA_TRY_OR_DONE(
        hada_allocated(memory = hada_alloc(2 * s.pixels + 5 * s.values + 5 * s.unknown, sizeof *memory, what, err)));
    s.image = memory;
    s.kept = s.image + s.pixels;
    s.sum = s.kept + s.pixels;
    s.spectrum = s.sum + 2 * s.values;
    s.weight = s.spectrum + 2 * s.values;
    s.at = s.weight + s.values;
    s.gradient = s.at + s.unknown;
    s.point = s.gradient + s.unknown;
    s.duals = s.point + s.unknown;
    memcpy(s.at, values, s.unknown * sizeof *values);
    for (int k = 0; k < p->steps; k++) {
        const double next = (1 + sqrt(1 + 4 * t * t)) / 2;
        HADA_TRY_OR_DONE(step(&s, k, (t - 1) / next, values, err));
        t = next;
    }
done:
    free(memory);
    return status;
}
