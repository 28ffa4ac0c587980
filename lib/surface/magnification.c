#include "surface/magnification.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "launch/refine.h"
#include "surface/spline.h"

/* Steps of a search, in pixels that light at the edge moves between neighbours: spots are wider. */
#define SEARCH_STEP 0.5
/* How far the law's a is looked for, in units of the nearest distance: masks stand much closer than scenes; in
 * microscopes a few times farther. Below 0: optics in front of the mask that turn the order round. */
#define MASK_LOW  (-0.5)
#define MASK_HIGH 4.0
/* Places of the axis, and magnifications of a pair: pixels that they move light at the edge between neighbours; then
 * half of that, and again, to the last. */
#define REACH      4.0
#define LAST_REACH 1.0
#define WIDE_REACH 16.0 /* the first where light's centre moves otherwise: haze draws it away */
#define PRECISION  0.03 /* a search ends with this part of its step */
/* Pairs of depths are compared from which light at the edge has moved by so many pixels: what learned PSFs have wrong
 * alike, at the same place, then no longer correlates. */
#define APART 4.0
/* A kind with more parameters is taken where it correlates better by this. */
#define BETTER 0.02
/* A plane beyond the farthest depth stands at this share of what is left to infinity at most. */
#define TOWARDS_INFINITY 0.5
/* While a search steps, one bright pixel in so many is looked at. */
enum { THIN = 4 };

hada_magnified hada_magnified_between(const hada_magnified *from, const hada_magnified *to)
{
    const double scale = to->scale / from->scale;
    return (hada_magnified){scale, to->row - scale * from->row, to->col - scale * from->col};
}

hada_magnified hada_magnification_at(const hada_magnification *m, double depth)
{
    if (m->depths < 2)
        return m->depth[0];
    const int low = hada_within((int)floor(depth), m->depths - 1);
    const hada_magnified *a = &m->depth[low], *b = a + 1;
    const double f = depth - low;
    return (hada_magnified){(1.0 - f) * a->scale + f * b->scale, (1.0 - f) * a->row + f * b->row,
                            (1.0 - f) * a->col + f * b->col};
}

static double shift_of(const hada_magnification *m, int k, double radius)
{
    const hada_magnified by = hada_magnified_between(&m->depth[k], &m->depth[k + 1]);
    return fabs(by.scale - 1.0) * radius + hypot(by.row, by.col);
}

double hada_magnification_shift(const hada_magnification *m, int k, double radius)
{
    return m->kind == HADA_MAGNIFICATION_NONE ? m->unexplained[HADA_MAGNIFICATION_NONE] : shift_of(m, k, radius);
}

int hada_magnification_steps(const hada_magnification *m, double pixels)
{
    return (int)fmax(1.0, ceil(m->shift / pixels));
}

/* The same for a grid `zoom` times as fine. */
static void zoom_at(hada_magnification *m, double zoom)
{
    for (int k = 0; k < m->depths; k++) {
        m->depth[k].row *= zoom;
        m->depth[k].col *= zoom;
    }
    m->row *= zoom;
    m->col *= zoom;
    m->edge *= zoom;
    m->spread *= zoom;
    m->shift *= zoom;
}

double hada_magnification_beyond(const hada_magnification *m, int far)
{
    const double *inverse = m->inverse + (far ? m->depths - 2 : 0);
    if (m->depths < 2 || m->kind != HADA_MAGNIFICATION_LAW)
        return 0.0;
    return far ? fmin(1.0, TOWARDS_INFINITY * inverse[1] / (inverse[0] - inverse[1])) : 1.0;
}

/* What a fit works with. */
typedef struct fit {
    hada_magnification *m;
    const float *coefficients;
    int rows, cols;
    hada_bright *bright; /* [depths] */
    int apart;           /* depths between those of a pair */
    int pair;            /* free: the pair in hand */
    int thin;            /* one bright pixel in so many */
} fit;

static void set_law(hada_magnification *m, const double *p)
{
    for (int k = 0; k < m->depths; k++)
        m->depth[k] = (hada_magnified){1.0 + p[0] * m->inverse[k], p[1] * m->inverse[k], p[2] * m->inverse[k]};
}

/* The PSF of depth `from`, made that of another, at a pixel. */
static double magnified(const fit *f, int from, const hada_magnified *by, double y, double x)
{
    const float *image = f->coefficients + (size_t)from * (size_t)f->rows * (size_t)f->cols;
    return hada_spline_value(image, f->rows, f->cols, (y - by->row) / by->scale, (x - by->col) / by->scale) /
           (by->scale * by->scale);
}

/* How well a depth, magnified so that its norm stays, correlates with a later one's bright pixels. */
static double correlation(const fit *f, int from, int to, const hada_magnified *by)
{
    const hada_bright *bright = &f->bright[to];
    double sum = 0.0;
    for (int i = 0; i < bright->count; i += f->thin)
        sum += bright->point[i].value * magnified(f, from, by, bright->point[i].y, bright->point[i].x);
    return f->thin * sum * by->scale / (bright->norm * f->bright[from].norm + 1e-300);
}

/* The mean over pairs, by the depths as they stand. */
static double correlations(const fit *f)
{
    const int pairs = f->m->depths - f->apart;
    double sum = 0.0;
    for (int k = 0; k < pairs; k++) {
        const hada_magnified by = hada_magnified_between(&f->m->depth[k], &f->m->depth[k + f->apart]);
        sum += correlation(f, k, k + f->apart, &by);
    }
    return sum / pairs;
}

static double law_objective(const fit *f, double *p)
{
    set_law(f->m, p);
    return correlations(f);
}

/* p[0] alone: the axis is where the centres of the first and the last depth's light say. */
static double centred_objective(const fit *f, double *p)
{
    const int last = f->m->depths - 1;
    const double a = f->m->inverse[0], b = f->m->inverse[last];
    for (int i = 0; i < 2; i++)
        p[1 + i] = ((1.0 + p[0] * b) * f->bright->centre[i] - (1.0 + p[0] * a) * f->bright[last].centre[i]) / (a - b);
    return law_objective(f, p);
}

/* p: what light at the edge moves outwards, and down, and right. */
static hada_magnified free_pair(const fit *f, const double *p)
{
    return (hada_magnified){1.0 + p[0] / f->m->edge, p[1], p[2]};
}

static double free_objective(const fit *f, double *p)
{
    const hada_magnified by = free_pair(f, p);
    return by.scale > 0.1 ? correlation(f, f->pair, f->pair + 1, &by) : -1.0;
}

/* The place of the largest of three values at -reach, 0 and reach, by a parabola. */
static double summit(double low, double middle, double high, double reach)
{
    const double bend = low - 2.0 * middle + high, at = bend < 0.0 ? reach * (low - high) / (2.0 * bend) : 0.0;
    return at < -reach ? -reach : at > reach ? reach : at;
}

/* p[which], from low to high: where the objective is largest, in steps, then by parabolas. */
static void improve(fit *f, double (*objective)(const fit *, double *), double *p, int which, double low, double high,
                    double step)
{
    const int steps = (int)ceil((high - low) / step);
    double q[3] = {p[0], p[1], p[2]}, most;
    f->thin = THIN;
    most = objective(f, p);
    for (int i = 0; i <= steps; i++) {
        q[which] = low + i * step;
        const double value = objective(f, q);
        if (value > most) {
            most = value;
            p[which] = q[which];
        }
    }
    f->thin = 1;
    most = objective(f, p);
    for (double reach = step; reach > PRECISION * step; reach /= 4.0) {
        double side[2];
        for (int i = 0; i < 2; i++) {
            q[which] = p[which] + (i ? reach : -reach);
            side[i] = objective(f, q);
        }
        p[which] += summit(side[0], most, side[1], reach);
        most = objective(f, p);
    }
}

/* The share of the bright pixels' energy, and with it the amplitude, that predictions by the neighbours miss. */
static double unexplained(const fit *f)
{
    const hada_magnification *m = f->m;
    double missed = 0.0, all = 0.0;
    for (int k = m->depths > 2 ? 1 : 0; k < (m->depths > 2 ? m->depths - 1 : 2); k++) {
        const int near = m->depths > 2 ? k - 1 : 1 - k, far = m->depths > 2 ? k + 1 : near;
        const double part =
            near == far ? 0.0 : (m->inverse[near] - m->inverse[k]) / (m->inverse[near] - m->inverse[far]);
        const hada_magnified a = hada_magnified_between(&m->depth[near], &m->depth[k]);
        const hada_magnified b = hada_magnified_between(&m->depth[far], &m->depth[k]);
        double square = 0.0, energy = 0.0;
        for (int i = 0; i < f->bright[k].count; i++) {
            const hada_bright_point *p = &f->bright[k].point[i];
            const double guess = (1.0 - part) * magnified(f, near, &a, p->y, p->x) +
                                 (part > 0.0 ? part * magnified(f, far, &b, p->y, p->x) : 0.0);
            square += (p->value - guess) * (p->value - guess);
            energy += p->value * p->value;
        }
        missed += energy > 0.0 ? square / energy : 0.0;
        all += 1.0;
    }
    return sqrt(missed / all);
}

/* The largest shift of light at the edge between neighbours. */
static double largest_shift(const hada_magnification *m)
{
    double shift = 0.0;
    for (int k = 0; k + 1 < m->depths; k++)
        shift = fmax(shift, shift_of(m, k, m->edge));
    return shift;
}

/* Pairs of depths between which light at the edge moves by APART pixels. */
static void set_apart(fit *f)
{
    f->apart = (int)fmin(f->m->depths - 1, ceil(APART / (largest_shift(f->m) + 1e-300)));
}

/* The law by neighbours, then by pairs farther apart. */
static void fit_law(fit *f)
{
    hada_magnification *m = f->m;
    double gap = 0.0, reach = REACH, p[3] = {0}, q[3];
    for (int k = 0; k + 1 < m->depths; k++)
        gap = fmax(gap, m->inverse[k] - m->inverse[k + 1]);
    double nearest = 1.0 / m->inverse[0], pixel = 1.0 / gap, a = pixel / m->edge;
    improve(f, law_objective, p, 0, MASK_LOW * nearest, MASK_HIGH * nearest, SEARCH_STEP * a);
    centred_objective(f, memcpy(q, p, sizeof q));
    if (hypot(q[1], q[2]) * gap > LAST_REACH) { /* the source was moved, or the axis is far off */
        reach = WIDE_REACH;
        improve(f, centred_objective, q, 0, MASK_LOW * nearest, MASK_HIGH * nearest, SEARCH_STEP * a);
        if (law_objective(f, q) > law_objective(f, p) + BETTER)
            memcpy(p, q, sizeof p);
    }
    for (; reach >= LAST_REACH; reach /= 2.0) {
        improve(f, law_objective, p, 1, p[1] - reach * pixel, p[1] + reach * pixel, SEARCH_STEP * pixel);
        improve(f, law_objective, p, 2, p[2] - reach * pixel, p[2] + reach * pixel, SEARCH_STEP * pixel);
        improve(f, law_objective, p, 0, fmax(p[0] - reach * a, MASK_LOW * nearest), p[0] + reach * a, SEARCH_STEP * a);
        set_law(m, p);
        set_apart(f);
        pixel = 1.0 / (f->apart * gap);
        a = pixel / m->edge;
    }
    set_law(m, p);
    m->mask = p[0];
    m->row = p[1];
    m->col = p[2];
}

/* From the law, each pair by itself. */
static void fit_free(fit *f)
{
    hada_magnification *m = f->m;
    hada_magnified next = m->depth[0];
    for (int k = 0; k + 1 < m->depths; k++) {
        const hada_magnified law = hada_magnified_between(&m->depth[k], &m->depth[k + 1]);
        double p[3] = {(law.scale - 1.0) * m->edge, law.row, law.col};
        f->pair = k;
        for (double reach = REACH; reach >= LAST_REACH; reach /= 2.0)
            for (int i = 0; i < 3; i++)
                improve(f, free_objective, p, i, p[i] - reach, p[i] + reach, SEARCH_STEP);
        const hada_magnified by = free_pair(f, p);
        m->depth[k] = next;
        next = (hada_magnified){by.scale * next.scale, by.row + by.scale * next.row, by.col + by.scale * next.col};
    }
    m->depth[m->depths - 1] = next;
}

/* Keeps how the depths stand now, as one kind; returns how well they correlate. */
static double keep(const fit *f, hada_magnification_kind kind, hada_magnified *kept)
{
    const size_t count = (size_t)f->m->depths;
    memcpy(kept + kind * count, f->m->depth, count * sizeof *kept);
    f->m->unexplained[kind] = unexplained(f);
    return correlations(f);
}

/* Tries all kinds and takes the simplest of those that correlate best, far apart as well. */
static void choose(fit *f, hada_magnified *kept)
{
    hada_magnification *m = f->m;
    const size_t count = (size_t)m->depths;
    hada_magnified *plain = kept + HADA_MAGNIFICATION_NONE * count;
    memcpy(plain, m->depth, count * sizeof *plain);
    fit_law(f);
    const double law = keep(f, HADA_MAGNIFICATION_LAW, kept);
    memcpy(m->depth, plain, count * sizeof *plain);
    const double none = keep(f, HADA_MAGNIFICATION_NONE, kept);
    if (law > none)
        memcpy(m->depth, kept + HADA_MAGNIFICATION_LAW * count, count * sizeof *kept);
    fit_free(f);
    const double each = keep(f, HADA_MAGNIFICATION_FREE, kept);
    hada_magnification_kind kind = law > none + BETTER ? HADA_MAGNIFICATION_LAW : HADA_MAGNIFICATION_NONE;
    if (each > (kind == HADA_MAGNIFICATION_LAW ? law : none) + BETTER)
        kind = HADA_MAGNIFICATION_FREE;
    memcpy(m->depth, kept + kind * count, count * sizeof *kept);
    m->kind = kind;
    m->shift = largest_shift(m);
}

static hada_status check_distances(int depths, const double *distances, hada_error *err)
{
    for (int k = 0; k < depths; k++)
        if (!(distances[k] > (k ? distances[k - 1] : 0.0)))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "optics between depths need distances that rise from above 0; number %d is %g", k + 1,
                             distances[k]);
    return HADA_OK;
}

hada_status hada_magnification_fit(hada_magnification *out, int depths, const double *distances,
                                   const float *coefficients, int rows, int cols, hada_error *err)
{
    const char what[] = "the optics between depths";
    const size_t count = (size_t)depths, area = (size_t)rows * (size_t)cols;
    hada_magnified *memory = NULL;
    fit f = {.m = out, .coefficients = coefficients, .rows = rows, .cols = cols, .apart = 1, .thin = 1};
    hada_status status = HADA_OK;
    *out = (hada_magnification){.depths = depths};
    HADA_TRY_OR_DONE(check_distances(depths, distances, err));
    HADA_TRY_OR_DONE(HADA_NEW(out->inverse, count, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(out->depth, count, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(memory, HADA_MAGNIFICATION_KINDS * count, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(f.bright, count, what, err));
    for (size_t k = 0; k < count; k++) {
        out->inverse[k] = 1.0 / distances[k];
        out->depth[k].scale = 1.0;
    }
    HADA_TRY_OR_DONE(hada_bright_edge(coefficients, depths, rows, cols, &out->edge, &out->spread, err));
    for (size_t k = 0; k < count; k++)
        HADA_TRY_OR_DONE(hada_bright_find(&f.bright[k], coefficients + k * area, rows, cols, out->edge, err));
    if (depths > 1)
        choose(&f, memory);
done:
    for (size_t k = 0; f.bright && k < count; k++)
        free(f.bright[k].point);
    HADA_FREE(f.bright, memory);
    if (status)
        hada_magnification_free(out);
    return status;
}

void hada_magnification_free(hada_magnification *magnification)
{
    HADA_FREE(magnification->inverse, magnification->depth);
    *magnification = (hada_magnification){0};
}

/* The law is looked for on a grid of at most about this many pixels a side. */
enum { LARGEST_SIDE = 1024 };
/* A transfer function that is cut off there would ring. */
#define TAPERS 3.0

hada_spectrum_layout hada_surface_layout(const hada_context *context, int rows, int cols)
{
    return hada_fft_layout(context, rows, cols, HADA_FFT_AUTO);
}

hada_status hada_surface_prefilter(hada_buffer *out, hada_slot *slot, const hada_spectrum_layout *layout,
                                   hada_error *err)
{
    const char what[] = "the optics between depths";
    const int width = layout->blocks * layout->block;
    float *values = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(values = hada_alloc(layout->count, 2 * sizeof *values, what, err)));
    for (int ky = 0; ky < layout->rows && !slot->context->dry; ky++)
        for (int kx = 0; kx < width; kx++)
            values[2 * hada_spectrum_index(layout, ky, kx)] =
                (float)(1.0 / (hada_spline_gain(ky, layout->rows) * hada_spline_gain(kx, layout->cols)));
    HADA_TRY_OR_DONE(hada_buffer_create_from(out, slot, values, layout->count * 2 * sizeof *values, what, err));
done:
    free(values);
    return status;
}

hada_status hada_surface_crop(hada_slot *slot, cl_mem in, size_t in_offset, const hada_spectrum_layout *from,
                              int images, int channels, double factor, double tapers, cl_mem out, size_t out_offset,
                              const hada_spectrum_layout *to, hada_error *err)
{
    const hada_range range =
        hada_range_of((size_t)to->blocks * (size_t)to->block, to->block < 8 ? 1 : 8, (size_t)to->rows, (size_t)images);
    const hada_refine_crop crop = {.parts = 2, .channels = channels, .factor = (float)factor, .tapers = (float)tapers};
    hada_slot_cost(slot, 8.0 * images * (channels + 1.0) * to->rows * (to->cols / 2 + 1.0), 0);
    return hada_launch_refine_crop(slot, HADA_PROGRAM_REFINE_DEFAULT, &range, err, .in = in, .in_offset = in_offset,
                                   .in_shape = hada_spectrum_shape_of(from), .out = out,
                                   .out_offset = (cl_uint)out_offset, .out_shape = hada_spectrum_shape_of(to),
                                   .crop = crop);
}

/* How many times the grid is as fine as the one where the law is looked for. */
static double zoom_of(const hada_surface_camera *camera)
{
    return fmax(1.0, fmax(camera->rows, camera->cols) / LARGEST_SIDE);
}

static int shrink(int size, double zoom)
{
    return zoom > 1.0 ? hada_fft_good_size((int)(size / zoom)) : size;
}

hada_status hada_magnification_measure(hada_magnification *out, hada_slot *slot, const hada_surface_camera *camera,
                                       const double *distances, hada_error *err)
{
    const char what[] = "the optics between depths";
    const double zoom = zoom_of(camera);
    const int rows = shrink(camera->rows, zoom), cols = shrink(camera->cols, zoom);
    const hada_spectrum_layout full = hada_surface_layout(slot->context, camera->rows, camera->cols);
    const hada_spectrum_layout small = hada_surface_layout(slot->context, rows, cols);
    const size_t area = (size_t)rows * (size_t)cols, step = (size_t)camera->channels * full.count;
    const hada_fft_desc desc = hada_fft_whole(HADA_FFT_INVERSE, rows, cols, 1);
    hada_buffer prefilter = {0}, spectrum = {0}, image = {0};
    hada_fft *plan = NULL;
    float *coefficients = NULL;
    hada_status status = HADA_OK;
    *out = (hada_magnification){0};
    HADA_TRY_OR_DONE(HADA_NEW_RAW(coefficients, (size_t)camera->depths * area, what, err));
    HADA_TRY_OR_DONE(hada_surface_prefilter(&prefilter, slot, &small, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&spectrum, slot->context, small.count * 2 * sizeof(float), what, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&image, slot->context, area * sizeof(float), what, err));
    HADA_TRY_OR_DONE(hada_fft_create(&plan, slot, &desc, err));
    if (slot->context->dry)
        goto done;
    for (size_t k = 0; k < (size_t)camera->depths; k++) {
        const hada_fft_filter use = {.product = HADA_FFT_COMPLEX, .filter = prefilter.mem, .spectrum_count = 1};
        HADA_TRY_OR_DONE(hada_surface_crop(slot, camera->otf, camera->first * full.count + k * step, &full, 1,
                                           camera->channels, 1.0, zoom > 1.0 ? TAPERS : 0.0, spectrum.mem, 0, &small,
                                           err));
        HADA_TRY_OR_DONE(hada_fft_inverse(plan, 1, spectrum.mem, 0, image.mem, 0, &use, err));
        HADA_TRY_OR_DONE(hada_buffer_read(&image, slot, 0, coefficients + k * area, area * sizeof(float), err));
    }
    HADA_TRY_OR_DONE(hada_magnification_fit(out, camera->depths, distances, coefficients, rows, cols, err));
    /* rows and columns shrink alike but for a pixel or so of a good size */
    zoom_at(out, (double)camera->cols / cols);
done:
    hada_fft_destroy(&plan);
    HADA_DESTROY_BUFFERS(&image, &spectrum, &prefilter);
    free(coefficients);
    return status;
}
