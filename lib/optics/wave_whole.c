/* Wave optics of a whole mask. Light from a point at distance z that has passed the mask T travels to the sensor at d
 * as a plane wave would over d z / (d + z), in coordinates shrunk by the magnification M = 1 + d/z (the Fresnel scaling
 * theorem); pixels are that much smaller there. Free space is a product in the frequency domain, without the
 * frequencies whose light would leave the grid (K. Matsushima, T. Shimobaba, Optics Express 17(22), 19662 (2009)). */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "optics/wave.h"

#define STRAY_FACTOR 9.8696044 /* pi^2: see wave_lens.c */
#define PI           3.14159265358979323846
#define OVERSAMPLING 1.25 /* of the steepest slope of the mask */
#define PIXEL_PARTS  8    /* samples on a pixel or on the light's finest detail, whichever is larger */
#define EDGE_PARTS   48   /* samples on a hole, a cell or a strip, at least */

typedef struct grid {
    int points, n;      /* samples of the mask, of the transform, a side */
    double step, reach; /* reach: the distance that light travels, shrunk */
    double limit;       /* of frequencies: light beyond would leave the grid, and is left out */
} grid;

static hada_status size_grid(const hada_wave *wave, double distance_mm, double wavelength_mm, double path_scale,
                             grid *g, hada_error *err)
{
    const hada_camera *c = &wave->camera;
    const double magnification = hada_camera_magnification(c, distance_mm);
    const double slope = wave->design.slope * path_scale, feature = wave->design.feature;
    const double pixel = c->pixel_pitch_mm / magnification;
    g->reach = c->distance_mm / magnification;
    /* the finest detail of the light: of a lens or hole, or what slopes in both directions make */
    double detail = feature > 0.0 ? wavelength_mm * g->reach / feature : wavelength_mm / (2.0 * slope + 1e-9);
    g->step = fmax(pixel, detail) / PIXEL_PARTS;
    if (slope > 0.0)
        g->step = fmin(g->step, wavelength_mm / (2.0 * OVERSAMPLING * slope));
    if (feature > 0.0)
        g->step = fmin(g->step, feature / EDGE_PARTS);
    g->points = (int)ceil(c->aperture_mm / g->step);
    /* how far light goes aside: by slopes and, as an Airy pattern's tail, from edges */
    double aside = OVERSAMPLING * slope + 2.0 * wavelength_mm / (c->aperture_mm * STRAY_FACTOR * wave->options.stray);
    if (feature > 0.0)
        aside += 2.0 * wavelength_mm / (feature * STRAY_FACTOR * wave->options.stray);
    aside = fmin(aside, wavelength_mm / (2.0 * g->step));
    g->limit = aside / wavelength_mm;
    const double n = ceil((c->aperture_mm + 2.0 * g->reach * aside) / g->step);
    const hada_device_info *info = &wave->slot->context->info;
    /* mask and opening, two parts, two spectra (the transform's scratch as much again), a spectrum in one piece */
    const double bytes = 4.0 * (2.0 * g->points * (double)g->points + 8.0 * n * n), piece = 8.0 * n * (n + 16.0);
    if (n > 32768.0 || bytes > 0.8 * (double)info->memory_bytes || piece > (double)info->max_allocation_bytes)
        return hada_fail(
            err, HADA_ERROR_UNSUPPORTED,
            "the waves of the whole mask need %.0f x %.0f samples (%.1f GiB), more than the device has room "
            "for; use a smaller aperture, larger pixels or gentler slopes, and compute lenses one by one",
            n, n, bytes / (1 << 30));
    g->n = hada_fft_good_size((int)n);
    return HADA_OK;
}

void hada_wave_share(hada_wave_pixel *table, int pixels, double pixel, double width, int samples, double begin,
                     double step)
{
    for (int i = 0; i < pixels; i++) {
        const double low = fmax((pixel + i * width - begin) / step, 0.0),
                     high = fmin((pixel + (i + 1) * width - begin) / step, samples);
        hada_wave_pixel *p = &table[i];
        *p = (hada_wave_pixel){0};
        if (!(high > low))
            continue;
        p->first = (int)floor(low);
        const int last = (int)ceil(high) - 1;
        p->count = last - p->first + 1;
        p->begin = (float)(fmin(high, p->first + 1) - low);
        p->end = (float)(high - last);
    }
}

void hada_wave_travel_phase(float *phase, int count, int n, double step, double wavelength_mm, double distance_mm,
                            double limit)
{
    for (int k = 0; k < count; k++) {
        const double frequency = (k <= n / 2 ? k : k - n) / (n * step);
        const double angle = -PI * wavelength_mm * distance_mm * frequency * frequency;
        const double passes = fabs(frequency) <= limit;
        phase[2 * k] = (float)(passes * cos(angle));
        phase[2 * k + 1] = (float)(passes * sin(angle));
    }
}

typedef struct work {
    hada_fft *forward, *inverse;
    hada_buffer path, open, field, spectrum, across, down, table_across, table_down, part, image;
} work;

static void work_free(work *w)
{
    hada_buffer *buffers[] = {&w->path, &w->open,         &w->field,      &w->spectrum, &w->across,
                              &w->down, &w->table_across, &w->table_down, &w->part,     &w->image};
    hada_fft_destroy(&w->forward);
    hada_fft_destroy(&w->inverse);
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
}

/* The mask on its grid; *light: what passes. */
static hada_status upload_mask(const hada_wave *wave, work *w, const grid *g, double *light, hada_error *err)
{
    const size_t count = (size_t)g->points * (size_t)g->points;
    void *path = NULL, *open = NULL;
    hada_status status = hada_alloc_raw(&path, count, sizeof(float), "a mask", err);
    if (!status)
        status = hada_alloc_raw(&open, count, sizeof(float), "a mask", err);
    const double middle = 0.5 * (g->points - 1);
    for (int r = 0; r < g->points && !status; r++)
        for (int c = 0; c < g->points; c++) {
            const size_t at = (size_t)r * (size_t)g->points + (size_t)c;
            hada_mask_point point;
            hada_mask_at(&wave->design, (c - middle) * g->step, (r - middle) * g->step, &point);
            const float share = (float)hada_mask_open(point.edge, g->step);
            ((float *)path)[at] = (float)point.path;
            ((float *)open)[at] = share;
            *light += share; /* the area; |T|^2 of softened edges lacks what they scatter */
        }
    if (!status)
        status = hada_buffer_create_from(&w->path, wave->slot, path, count * sizeof(float), "a mask", err);
    if (!status)
        status = hada_buffer_create_from(&w->open, wave->slot, open, count * sizeof(float), "a mask", err);
    free(path);
    free(open);
    return status;
}

/* From the mask to the transform of the field on the sensor. */
static hada_status spread(const hada_wave *wave, work *w, const grid *g, double wavelength_mm, double path_scale,
                          hada_error *err)
{
    hada_slot *slot = wave->slot;
    const int off = (g->n - g->points) / 2;
    const size_t points = (size_t)g->points * (size_t)g->points;
    const hada_fft_desc desc = {.direction = HADA_FFT_FORWARD,
                                .backend = HADA_FFT_OWN,
                                .rows = g->n,
                                .cols = g->n,
                                .batch = 2,
                                .row0 = off,
                                .col0 = off,
                                .real_rows = g->points,
                                .real_cols = g->points,
                                .real_pitch = (size_t)g->points,
                                .real_distance = points};
    const hada_spectrum_layout layout = hada_fft_layout(slot->context, g->n, g->n, HADA_FFT_OWN);
    const int columns = layout.blocks * HADA_WAVE_BLOCK;
    void *phase;
    hada_status status =
        hada_alloc(&phase, 2 * (size_t)(columns > g->n ? columns : g->n), sizeof(float), "phases", err);
    if (status)
        return status;
    hada_wave_travel_phase(phase, columns, g->n, g->step, wavelength_mm, g->reach, g->limit);
    status = hada_buffer_create_from(&w->across, slot, phase, 2 * (size_t)columns * sizeof(float), "phases", err);
    hada_wave_travel_phase(phase, g->n, g->n, g->step, wavelength_mm, g->reach, g->limit);
    if (!status)
        status = hada_buffer_create_from(&w->down, slot, phase, 2 * (size_t)g->n * sizeof(float), "phases", err);
    free(phase);
    if (!status)
        status = hada_buffer_create(&w->field, slot->context, 2 * points * sizeof(float), "a field", err);
    if (!status)
        status = hada_buffer_create(&w->spectrum, slot->context, 4 * layout.count * sizeof(float), "a field", err);
    if (!status)
        status = hada_fft_create(&w->forward, slot, &desc, err);
    if (!status)
        status = hada_wave_launch_mask(slot, w->field.mem, w->path.mem, w->open.mem, g->points,
                                       path_scale / wavelength_mm, err);
    if (!status)
        status = hada_fft_forward(w->forward, 2, w->field.mem, 0, w->spectrum.mem, 0, err);
    if (!status)
        status = hada_wave_launch_travel(slot, w->spectrum.mem, w->across.mem, w->down.mem, g->n, layout.blocks, err);
    if (!status)
        status = hada_slot_finish(slot, err);
    hada_fft_destroy(&w->forward);
    hada_buffer_destroy(&w->field);
    return status;
}

/* The samples and pixels that lie on each other along an axis: of `pixels` about the pixel pixels/2, `first` and on. */
typedef struct overlap {
    int first, count;         /* pixels */
    int sample, sample_count; /* samples, of the transform's */
} overlap;

static overlap overlap_of(const grid *g, int pixels, double width)
{
    const double half = 0.5 * g->n * g->step, left = (-0.5 - pixels / 2) * width;
    const double low = fmax(-half, left), high = fmin(half, left + pixels * width);
    overlap o;
    o.first = (int)floor((low - left) / width);
    o.count = (int)fmin(ceil((high - left) / width), pixels) - o.first;
    o.sample = (int)floor((low + half) / g->step);
    o.sample_count = (int)fmin(ceil((high + half) / g->step), g->n) - o.sample;
    return o;
}

static hada_status upload_shares(const hada_wave *wave, hada_buffer *buffer, const grid *g, const overlap *o,
                                 int pixels, double width, hada_error *err)
{
    void *table;
    hada_status status = hada_alloc(&table, (size_t)o->count, sizeof(hada_wave_pixel), "pixels", err);
    if (status)
        return status;
    /* sample i of the mask, of `points`, stands at (i - (points - 1) / 2) step, and (n - points) / 2 are before it */
    const double begin = (o->sample - (g->n - g->points) / 2 - 0.5 * g->points) * g->step;
    hada_wave_share(table, o->count, (o->first - 0.5 - pixels / 2) * width, width, o->sample_count, begin, g->step);
    status =
        hada_buffer_create_from(buffer, wave->slot, table, (size_t)o->count * sizeof(hada_wave_pixel), "pixels", err);
    free(table);
    return status;
}

/* From the transform of the field to pixels. */
static hada_status collect(const hada_wave *wave, work *w, const grid *g, double width, int rows, int cols, double *sum,
                           hada_error *err)
{
    hada_slot *slot = wave->slot;
    const overlap down = overlap_of(g, rows, width), across = overlap_of(g, cols, width);
    const size_t samples = (size_t)down.sample_count * (size_t)across.sample_count;
    const size_t pixels = (size_t)down.count * (size_t)across.count;
    const hada_fft_desc desc = {.direction = HADA_FFT_INVERSE,
                                .backend = HADA_FFT_OWN,
                                .rows = g->n,
                                .cols = g->n,
                                .batch = 2,
                                .row0 = down.sample,
                                .col0 = across.sample,
                                .real_rows = down.sample_count,
                                .real_cols = across.sample_count,
                                .real_pitch = (size_t)across.sample_count,
                                .real_distance = samples};
    void *image = NULL;
    hada_status status = hada_alloc(&image, pixels, sizeof(float), "a point spread function", err);
    if (!status)
        status = upload_shares(wave, &w->table_down, g, &down, rows, width, err);
    if (!status)
        status = upload_shares(wave, &w->table_across, g, &across, cols, width, err);
    if (!status)
        status = hada_buffer_create(&w->field, slot->context, 2 * samples * sizeof(float), "a field", err);
    if (!status)
        status = hada_fft_create(&w->inverse, slot, &desc, err);
    if (!status)
        status = hada_fft_inverse(w->inverse, 2, w->spectrum.mem, 0, w->field.mem, 0, NULL, err);
    if (!status)
        status = hada_buffer_create(&w->part, slot->context,
                                    (size_t)down.sample_count * (size_t)across.count * sizeof(float), "pixels", err);
    if (!status)
        status = hada_buffer_create(&w->image, slot->context, pixels * sizeof(float), "pixels", err);
    if (!status)
        status = hada_wave_launch_sensor(slot, w->image.mem, w->part.mem, w->field.mem, w->table_across.mem,
                                         w->table_down.mem, down.sample_count, across.sample_count, down.count,
                                         across.count, err);
    if (!status)
        status = hada_buffer_read(&w->image, slot, 0, image, pixels * sizeof(float), err);
    for (int r = 0; r < down.count && !status; r++)
        for (int c = 0; c < across.count; c++)
            sum[(size_t)(down.first + r) * (size_t)cols + (size_t)(across.first + c)] +=
                ((float *)image)[(size_t)r * (size_t)across.count + (size_t)c];
    free(image);
    return status;
}

hada_status hada_wave_whole(hada_wave *wave, double distance_mm, double wavelength_mm, double path_scale, int rows,
                            int cols, double *sum, double *light, hada_error *err)
{
    grid g = {0};
    work w = {0};
    hada_status status = size_grid(wave, distance_mm, wavelength_mm, path_scale, &g, err);
    if (!status)
        status = upload_mask(wave, &w, &g, light, err);
    if (!status)
        status = spread(wave, &w, &g, wavelength_mm, path_scale, err);
    if (!status) {
        hada_buffer_destroy(&w.path);
        hada_buffer_destroy(&w.open);
        const double width = wave->camera.pixel_pitch_mm / hada_camera_magnification(&wave->camera, distance_mm);
        status = collect(wave, &w, &g, width, rows, cols, sum, err);
    }
    work_free(&w);
    return status;
}
