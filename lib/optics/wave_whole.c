/* Wave optics of a whole mask. Light from a point at distance z that has passed the mask T travels to the sensor at d
 * as a plane wave would over d z / (d + z), in coordinates shrunk by the magnification M = 1 + d/z (the Fresnel scaling
 * theorem); pixels are that much smaller there. Free space is a product in the frequency domain, without the
 * frequencies whose light would leave the grid (K. Matsushima, T. Shimobaba, Optics Express 17(22), 19662 (2009)). */

#include "core/callers.h"
#include "optics/wave.h"

#define STRAY_FACTOR 9.8696044 /* pi^2: see wave_lens.c */
#define PI           3.14159265358979323846
#define OVERSAMPLING 1.25 /* of the steepest slope of the mask */
#define PIXEL_PARTS  8    /* samples on a pixel or on the light's finest detail, whichever is larger */
#define EDGE_PARTS   48   /* samples on a hole, a cell or a strip, at least */

typedef struct grid {
    int points, n; /* samples of the mask, of the transform, a side */
    double step;
} grid;

/* How light of a wavelength goes on from the mask. */
typedef struct travel {
    double wavelength;
    double slope; /* the mask's steepest */
    double reach; /* the distance, shrunk */
} travel;

static travel travel_of(const hada_wave *wave, double distance_mm, double wavelength_mm, double path_scale)
{
    const hada_camera *c = &wave->camera;
    return (travel){wavelength_mm, wave->design.slope * path_scale,
                    c->distance_mm / hada_camera_magnification(c, distance_mm)};
}

static double step_for(const hada_wave *wave, const travel *t)
{
    const double feature = wave->design.feature;
    const double pixel = wave->camera.pixel_pitch_mm * t->reach / wave->camera.distance_mm;
    /* the finest detail of the light: of a lens or hole, or what slopes in both directions make */
    double detail = feature > 0.0 ? t->wavelength * t->reach / feature : t->wavelength / (2.0 * t->slope + 1e-9);
    double step = fmax(pixel, detail) / PIXEL_PARTS;
    if (t->slope > 0.0)
        step = fmin(step, t->wavelength / (2.0 * OVERSAMPLING * t->slope));
    return feature > 0.0 ? fmin(step, feature / EDGE_PARTS) : step;
}

/* How far light goes aside, as an angle: by slopes and, as an Airy pattern's tail, from edges. */
static double aside_of(const hada_wave *wave, const travel *t, double step)
{
    const double tail = 2.0 * t->wavelength / (STRAY_FACTOR * wave->options.stray);
    double aside = OVERSAMPLING * t->slope + tail / wave->camera.aperture_mm;
    if (wave->design.feature > 0.0)
        aside += tail / wave->design.feature;
    return fmin(aside, t->wavelength / (2.0 * step));
}

/* One grid for all colours and all of the camera's distances, so that the mask is sampled once; a distance beyond the
 * camera's has one of its own. */
static hada_status size_grid(const hada_wave *wave, double distance_mm, grid *g, hada_error *err)
{
    const hada_camera *c = &wave->camera;
    const int inside = distance_mm >= c->distances_mm[0] && distance_mm <= c->distances_mm[c->depths - 1];
    const double ends[2] = {inside ? c->distances_mm[0] : distance_mm,
                            inside ? c->distances_mm[c->depths - 1] : distance_mm};
    double n = 0.0;
    g->step = HUGE_VAL;
    for (int pass = 0; pass < 2; pass++) /* the step, then the number; both change one way with the distance */
        for (int i = 0; i < 2 * c->channels; i++) {
            double wavelength, path_scale;
            hada_wave_colour(c, i / 2, &wavelength, &path_scale);
            const travel t = travel_of(wave, ends[i % 2], wavelength, path_scale);
            if (!pass)
                g->step = fmin(g->step, step_for(wave, &t));
            else
                n = fmax(n, ceil((c->aperture_mm + 2.0 * t.reach * aside_of(wave, &t, g->step)) / g->step));
        }
    g->points = (int)ceil(c->aperture_mm / g->step);
    const hada_device_info *info = &wave->slot->context->info;
    /* mask and opening, two parts, two spectra (the transforms' scratch twice as much), a spectrum in one piece */
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

/* The samples and pixels that lie on each other along an axis: of `pixels` about the pixel pixels/2, `first` and on. */
typedef struct overlap {
    int first, count;         /* pixels */
    int sample, sample_count; /* samples, of the transform's */
} overlap;

/* What stays from colour to colour and from distance to distance. */
struct hada_wave_work {
    grid grid;
    double light; /* what passes the mask */
    hada_fft *forward, *inverse;
    overlap down, across; /* of the inverse transform */
    hada_buffer path, open, field, spectrum;
};

void hada_wave_rest(hada_wave *wave)
{
    struct hada_wave_work *w = wave->work;
    if (!w)
        return;
    wave->work = NULL;
    hada_slot_finish(wave->slot, NULL);
    hada_fft_destroy(&w->forward);
    hada_fft_destroy(&w->inverse);
    hada_buffer *buffers[] = {&w->path, &w->open, &w->field, &w->spectrum};
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
    free(w);
}

/* The mask on its grid. */
static hada_status upload_mask(const hada_wave *wave, struct hada_wave_work *w, hada_error *err)
{
    const grid *g = &w->grid;
    const size_t count = (size_t)g->points * (size_t)g->points;
    float *path = NULL, *open = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(path, count, "a mask", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(open, count, "a mask", err));
    const double middle = 0.5 * (g->points - 1);
    for (int r = 0; r < g->points; r++) {
        HADA_TRY_OR_DONE(hada_monitor_check(wave->design.monitor, err));
        for (int c = 0; c < g->points; c++) {
            const size_t at = (size_t)r * (size_t)g->points + (size_t)c;
            hada_mask_point point;
            hada_mask_at(&wave->design, (c - middle) * g->step, (r - middle) * g->step, &point);
            const float share = (float)hada_mask_open(point.edge, g->step);
            path[at] = (float)point.path;
            open[at] = share;
            w->light += share; /* the area; |T|^2 of softened edges lacks what they scatter */
        }
    }
    HADA_TRY_OR_DONE(hada_buffer_create_from(&w->path, wave->slot, path, count * sizeof(float), "a mask", err));
    HADA_TRY_OR_DONE(hada_buffer_create_from(&w->open, wave->slot, open, count * sizeof(float), "a mask", err));
done:
    HADA_FREE(path, open);
    return status;
}

/* The field on the mask, or on the samples that the sensor sees: two parts. */
static hada_status make_field(const hada_wave *wave, struct hada_wave_work *w, size_t samples, hada_error *err)
{
    if (w->field.bytes >= 2 * samples * sizeof(float))
        return HADA_OK;
    hada_buffer_destroy(&w->field);
    return hada_buffer_create(&w->field, wave->slot->context, 2 * samples * sizeof(float), "a field", err);
}

/* The mask, its field, and the transform from it. */
static hada_status make_work(hada_wave *wave, const grid *g, hada_error *err)
{
    struct hada_wave_work *w;
    if (wave->work && wave->work->grid.step == g->step && wave->work->grid.n == g->n)
        return HADA_OK;
    hada_wave_rest(wave);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(wave->work, 1, "wave optics", err));
    w = wave->work;
    hada_slot *slot = wave->slot;
    w->grid = *g;
    const int off = (g->n - g->points) / 2;
    hada_fft_desc desc = hada_fft_of(HADA_FFT_FORWARD, g->n, g->n, 2, (hada_rectangle){off, off, g->points, g->points});
    desc.backend = HADA_FFT_OWN;
    const hada_spectrum_layout layout = hada_fft_layout(slot->context, g->n, g->n, HADA_FFT_OWN);
    HADA_TRY_OR_DONE(upload_mask(wave, w, err));
    HADA_TRY_OR_DONE(make_field(wave, w, desc.real_distance, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&w->spectrum, slot->context, 4 * layout.count * sizeof(float), "a field", err));
    HADA_TRY_OR_DONE(hada_fft_create(&w->forward, slot, &desc, err));
done:
    if (status)
        hada_wave_rest(wave);
    return status;
}

/* The phases of free space, down or across, go to the device. */
static hada_status upload_phase(const hada_wave *wave, hada_buffer *to, int count, const travel *t, double limit,
                                hada_error *err)
{
    const grid *g = &wave->work->grid;
    float *phase = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(phase, 2 * (size_t)count, "phases", err));
    hada_wave_travel_phase(phase, count, g->n, g->step, t->wavelength, t->reach, limit);
    HADA_TRY_OR_DONE(hada_buffer_create_from(to, wave->slot, phase, 2 * (size_t)count * sizeof(float), "phases", err));
done:
    free(phase);
    return status;
}

/* From the mask to the transform of the field on the sensor. */
static hada_status spread(const hada_wave *wave, const travel *t, double path_scale, hada_error *err)
{
    struct hada_wave_work *w = wave->work;
    hada_slot *slot = wave->slot;
    const grid *g = &w->grid;
    const int blocks = hada_fft_layout(slot->context, g->n, g->n, HADA_FFT_OWN).blocks;
    const double limit = aside_of(wave, t, g->step) / t->wavelength; /* light beyond would leave the grid */
    hada_buffer across = {0}, down = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(upload_phase(wave, &across, blocks * HADA_FFT_BLOCK, t, limit, err));
    HADA_TRY_OR_DONE(upload_phase(wave, &down, g->n, t, limit, err));
    HADA_TRY_OR_DONE(hada_wave_launch_mask(slot, w->field.mem, w->path.mem, w->open.mem, g->points,
                                           path_scale / t->wavelength, err));
    HADA_TRY_OR_DONE(hada_fft_forward(w->forward, 2, w->field.mem, 0, w->spectrum.mem, 0, err));
    HADA_TRY_OR_DONE(hada_wave_launch_travel(slot, w->spectrum.mem, across.mem, down.mem, g->n, blocks, err));
    HADA_TRY_OR_DONE(hada_slot_finish(slot, err));
done:
    HADA_DESTROY_BUFFERS(&across, &down);
    return status;
}

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

static hada_status upload_shares(const hada_wave *wave, hada_buffer *buffer, const overlap *o, int pixels, double width,
                                 hada_error *err)
{
    const grid *g = &wave->work->grid;
    hada_wave_pixel *table = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(table, (size_t)o->count, "pixels", err));
    /* sample i of the mask, of `points`, is at (i - (points - 1) / 2) step, and (n - points) / 2 are before it */
    const double begin = (o->sample - (g->n - g->points) / 2 - 0.5 * g->points) * g->step;
    hada_wave_share(table, o->count, (o->first - 0.5 - pixels / 2) * width, width, o->sample_count, begin, g->step);
    HADA_TRY_OR_DONE(
        hada_buffer_create_from(buffer, wave->slot, table, (size_t)o->count * sizeof *table, "pixels", err));
done:
    free(table);
    return status;
}

/* The transform back, to samples that the sensor sees. */
static hada_status make_inverse(const hada_wave *wave, const overlap *down, const overlap *across, hada_error *err)
{
    struct hada_wave_work *w = wave->work;
    const hada_rectangle seen = {down->sample, across->sample, down->sample_count, across->sample_count};
    hada_fft_desc desc = hada_fft_of(HADA_FFT_INVERSE, w->grid.n, w->grid.n, 2, seen);
    desc.backend = HADA_FFT_OWN;
    HADA_TRY(make_field(wave, w, desc.real_distance, err));
    if (w->inverse && w->down.sample == down->sample && w->down.sample_count == down->sample_count &&
        w->across.sample == across->sample && w->across.sample_count == across->sample_count)
        return HADA_OK;
    hada_fft_destroy(&w->inverse);
    w->down = *down;
    w->across = *across;
    return hada_fft_create(&w->inverse, wave->slot, &desc, err);
}

/* From the transform of the field to pixels. */
static hada_status collect(const hada_wave *wave, double width, int rows, int cols, double *sum, hada_error *err)
{
    struct hada_wave_work *w = wave->work;
    hada_slot *slot = wave->slot;
    const overlap down = overlap_of(&w->grid, rows, width), across = overlap_of(&w->grid, cols, width);
    const size_t pixels = (size_t)down.count * (size_t)across.count;
    hada_buffer table_down = {0}, table_across = {0}, part = {0}, pixel = {0};
    hada_buffer *buffers[] = {&table_down, &table_across, &part, &pixel};
    float *image = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(image, pixels, "a point spread function", err));
    HADA_TRY_OR_DONE(upload_shares(wave, &table_down, &down, rows, width, err));
    HADA_TRY_OR_DONE(upload_shares(wave, &table_across, &across, cols, width, err));
    HADA_TRY_OR_DONE(make_inverse(wave, &down, &across, err));
    HADA_TRY_OR_DONE(hada_fft_inverse(w->inverse, 2, w->spectrum.mem, 0, w->field.mem, 0, NULL, err));
    HADA_TRY_OR_DONE(hada_buffer_create(
        &part, slot->context, (size_t)down.sample_count * (size_t)across.count * sizeof(float), "pixels", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&pixel, slot->context, pixels * sizeof(float), "pixels", err));
    HADA_TRY_OR_DONE(hada_wave_launch_sensor(
        slot, pixel.mem, part.mem, w->field.mem, (hada_wave_pixel_array)table_across.mem,
        (hada_wave_pixel_array)table_down.mem, down.sample_count, across.sample_count, down.count, across.count, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&pixel, slot, 0, image, pixels * sizeof(float), err));
    for (int r = 0; r < down.count; r++)
        for (int c = 0; c < across.count; c++)
            sum[(size_t)(down.first + r) * (size_t)cols + (size_t)(across.first + c)] +=
                image[(size_t)r * (size_t)across.count + (size_t)c];
done:
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
    free(image);
    return status;
}

hada_status hada_wave_whole(hada_wave *wave, double distance_mm, double wavelength_mm, double path_scale, int rows,
                            int cols, double *sum, double *light, hada_error *err)
{
    grid g;
    const travel t = travel_of(wave, distance_mm, wavelength_mm, path_scale);
    const double width = wave->camera.pixel_pitch_mm / hada_camera_magnification(&wave->camera, distance_mm);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_monitor_check(wave->design.monitor, err));
    HADA_TRY_OR_DONE(size_grid(wave, distance_mm, &g, err));
    HADA_TRY_OR_DONE(make_work(wave, &g, err));
    HADA_TRY_OR_DONE(spread(wave, &t, path_scale, err));
    HADA_TRY_OR_DONE(collect(wave, width, rows, cols, sum, err));
    *light += wave->work->light;
done:
    if (status) /* nothing half made is kept */
        hada_wave_rest(wave);
    return status;
}
