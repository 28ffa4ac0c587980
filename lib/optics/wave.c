/* PSFs by wave optics: one channel after the other, lens by lens or the whole mask. */
#include "optics/wave.h"
#include "core/callers.h"
#include "launch/optics_wave_lens.h"
#include "launch/optics_wave_whole.h"

/* The kernels of wave optics. */

static size_t side_of(const hada_slot *slot)
{
    return slot->context->shape == HADA_SHAPE_GROUPS ? 8 : 1;
}

/* Items along each axis, in work-groups that suit the shape of the device: of one item, or 8 x 8. */
static hada_range items_of(const hada_slot *slot, size_t across, size_t down, size_t planes)
{
    const size_t side = side_of(slot);
    return (hada_range){{hada_round_up(across, side), hada_round_up(down, side), planes}, {side, side, 1}, 0};
}

hada_status hada_wave_launch_pupil(hada_slot *slot, cl_mem field, cl_mem phase, hada_wave_lens_array lenses,
                                   cl_mem planes, int first, int count, const hada_wave_spot *spot, double radius,
                                   double aperture, hada_error *err)
{
    const hada_optics_field lens_field = {spot->points, spot->pitch, (float)spot->step, (float)radius, (float)aperture};
    /* an item has a row, or every eighth piece of it */
    const hada_range range = items_of(slot, side_of(slot), (size_t)spot->points, (size_t)count);
    const double values = (double)count * spot->points * spot->pitch;
    hada_slot_cost(slot, 8.0 * values, 30.0 * values);
    return hada_launch_optics_wave_pupil(slot, HADA_PROGRAM_OPTICS_WAVE_LENS_DEFAULT, &range, err, .field = field,
                                         .phase = phase, .lenses = lenses, .planes = planes, .first = first,
                                         .lens_field = lens_field);
}

hada_status hada_wave_launch_spots(hada_slot *slot, cl_mem image, cl_mem part, cl_mem spectra, int count, int pixels,
                                   int samples, hada_error *err)
{
    const int blocks = (pixels * samples / 2 + HADA_FFT_BLOCK) / HADA_FFT_BLOCK;
    const hada_range rows = items_of(slot, (size_t)blocks, (size_t)pixels, (size_t)count);
    const hada_range cols = items_of(slot, (size_t)pixels, (size_t)pixels, (size_t)count);
    const double values = 8.0 * count * blocks * (double)pixels * samples;
    hada_slot_cost(slot, 16.0 * values, 12.0 * values);
    HADA_TRY(hada_launch_optics_wave_spot_rows(slot, HADA_PROGRAM_OPTICS_WAVE_LENS_DEFAULT, &rows, err, .part = part,
                                               .spectra = spectra, .pixels = pixels, .samples = samples,
                                               .blocks = blocks));
    hada_slot_cost(slot, 64.0 * count * blocks * (double)pixels, 16.0 * count * blocks * (double)pixels);
    return hada_launch_optics_wave_spot_cols(slot, HADA_PROGRAM_OPTICS_WAVE_LENS_DEFAULT, &cols, err, .image = image,
                                             .part = part, .pixels = pixels, .samples = samples, .blocks = blocks);
}

hada_status hada_wave_launch_mask(hada_slot *slot, cl_mem field, cl_mem path, cl_mem open, int n, double waves,
                                  hada_error *err)
{
    const hada_range range = items_of(slot, hada_divide_up((size_t)n, 8), (size_t)n, 1);
    hada_slot_cost(slot, 16.0 * n * (double)n, 40.0 * n * (double)n);
    return hada_launch_optics_wave_mask(slot, HADA_PROGRAM_OPTICS_WAVE_WHOLE_DEFAULT, &range, err, .field = field,
                                        .path = path, .open = open, .n = n, .waves = (float)waves);
}

hada_status hada_wave_launch_travel(hada_slot *slot, cl_mem spectrum, cl_mem across, cl_mem down, int rows, int blocks,
                                    hada_error *err)
{
    const hada_range range = items_of(slot, (size_t)rows, (size_t)blocks, 1);
    const double values = (double)HADA_FFT_BLOCK * rows * blocks;
    hada_slot_cost(slot, 32.0 * values, 22.0 * values);
    return hada_launch_optics_wave_travel(slot, HADA_PROGRAM_OPTICS_WAVE_WHOLE_DEFAULT, &range, err,
                                          .spectrum = spectrum, .across = across, .down = down, .rows = rows,
                                          .blocks = blocks);
}

hada_status hada_wave_launch_sensor(hada_slot *slot, cl_mem image, cl_mem part, cl_mem field,
                                    hada_wave_pixel_array across, hada_wave_pixel_array down, int rows, int cols,
                                    int pixel_rows, int pixel_cols, hada_error *err)
{
    const hada_range over = items_of(slot, (size_t)pixel_cols, (size_t)rows, 1);
    const hada_range along = items_of(slot, (size_t)pixel_cols, (size_t)pixel_rows, 1);
    hada_slot_cost(slot, 8.0 * rows * (double)cols, 6.0 * rows * (double)cols);
    HADA_TRY(hada_launch_optics_wave_sensor_rows(slot, HADA_PROGRAM_OPTICS_WAVE_WHOLE_DEFAULT, &over, err, .part = part,
                                                 .field = field, .table = across, .rows = rows, .cols = cols,
                                                 .pixels = pixel_cols));
    hada_slot_cost(slot, 4.0 * rows * (double)pixel_cols, 2.0 * rows * (double)pixel_cols);
    return hada_launch_optics_wave_sensor_cols(slot, HADA_PROGRAM_OPTICS_WAVE_WHOLE_DEFAULT, &along, err,
                                               .image = image, .part = part, .table = down, .pixels = pixel_cols,
                                               .pixel_rows = pixel_rows);
}

/* Wave optics, lens by lens. Behind the lens on p, with q = p + u on the mask and s = p (1 + d/z) + v on the sensor,
 * the Fresnel integral's terms in |u|^2 and in u are U(v) ~ integral P(u) exp(i pi (1/z + 1/d - 1/f) |u|^2 / lambda)
 * exp(-2 pi i u v / (lambda d)) du, a Fourier transform on a small grid round the spot, whatever the lens's place; the
 * rest has modulus 1. Light of different lenses adds up as intensity. */

#define PI                3.14159265358979323846
#define OVERSAMPLING      1.5 /* of the field of a lens on the sensor, beyond lambda d / diameter, at least */
#define OVERSAMPLING_MOST 4.0
#define SAMPLES_GOOD      8                  /* on a pixel: with so many, the least oversampling is enough */
#define SAMPLES_LEAST     3                  /* on a pixel */
#define SPOT_MOST         4096               /* samples of the square round a spot, a side */
#define SPOT_BYTES        ((size_t)48 << 20) /* of spectra at a time */

static int smooth_at_least(double least, int step)
{
    int n = (int)ceil(least / step) * step;
    while (!hada_fft_smooth(n))
        n += step;
    return n;
}

/* Sizes of a spot: HADA_ERROR_UNSUPPORTED where they are too large. */
static hada_status wave_spot_size(const hada_wave *wave, double distance_mm, double wavelength_mm, double path_scale,
                                  hada_wave_spot *spot, hada_error *err)
{
    const hada_camera *c = &wave->camera;
    const double d = c->distance_mm, width = 2.0 * wave->design.reach, pitch = c->pixel_pitch_mm;
    *spot = (hada_wave_spot){.chirp = 1.0 / distance_mm + 1.0 / d - hada_mask_power(c) * path_scale};
    /* beyond the geometric spot: the Airy pattern leaves 2 / (pi v) of its light outside v = pi width r / (lambda d) */
    const double stray = 2.0 * wavelength_mm * d / (PI * PI * width * wave->options.stray);
    const double pixels = (width * fabs(spot->chirp) * d + 2.0 * stray) / pitch + 1.0;
    /* what a pixel's sum leaves of the errors of sampling falls with the number of samples */
    const double spots = pitch * width / (wavelength_mm * d);
    const double samples =
        fmax(fmax(SAMPLES_LEAST, OVERSAMPLING * spots), fmin(OVERSAMPLING_MOST * spots, SAMPLES_GOOD));
    if (pixels * samples > SPOT_MOST)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "the spot of a lens takes %.0f samples a side at %g mm, more than %d; use smaller lenses, a "
                         "focal length nearer to the distance to the sensor, or allow more stray light",
                         pixels * samples, distance_mm, SPOT_MOST);
    spot->pixels = smooth_at_least(pixels, 2);
    spot->samples = smooth_at_least(samples, 1);
    spot->n = spot->pixels * spot->samples;
    spot->step = wavelength_mm * d / (spot->pixels * pitch);
    spot->points = (int)ceil(width / spot->step) + 1;
    spot->points = spot->points < spot->n ? spot->points : spot->n;
    spot->pitch = (spot->points + 7) / 8 * 8;
    return HADA_OK;
}

/* The phase of a lens along an axis, `points` complex values (interleaved) and zeros up to `pitch`: its chirp, and a
 * slope that puts the spot `shift` samples (of the field on the sensor) from where the transform has its middle. */
static void wave_phase(const hada_wave_spot *spot, double wavelength_mm, double shift, float *phase)
{
    for (int i = 0; i < spot->pitch; i++) {
        const double index = i - 0.5 * (spot->points - 1), u = index * spot->step;
        const double angle = PI * spot->chirp * u * u / wavelength_mm - 2.0 * PI * index * shift / spot->n;
        phase[2 * i] = i < spot->points ? (float)cos(angle) : 0.0f;
        phase[2 * i + 1] = i < spot->points ? (float)sin(angle) : 0.0f;
    }
}

/* The lenses and the lines between them. */
static hada_status wave_lens_tables(const hada_mask_design *design, hada_wave_lens **lenses, hada_wave_plane **planes,
                                    int *plane_count, hada_error *err)
{
    const hada_sites *sites = &design->sites;
    hada_wave_lens *lens = NULL;
    hada_wave_plane *lines = NULL;
    int count = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(lens, (size_t)sites->count, "the lenses", err));
    for (int pass = 0; pass < 2; pass++) { /* count, then write */
        count = 0;
        for (int l = 0; l < sites->count; l++) {
            lens[l] = (hada_wave_lens){(float)sites->x[l], (float)sites->y[l], count, 0};
            for (int i = 0; i < sites->count; i++) {
                const double dx = sites->x[i] - sites->x[l], dy = sites->y[i] - sites->y[l];
                const double apart = sqrt(dx * dx + dy * dy);
                if (!(apart > 0.0) || apart > 2.0 * design->reach)
                    continue;
                if (pass)
                    lines[count] =
                        (hada_wave_plane){(float)(dx / apart), (float)(dy / apart), (float)(apart / 2.0), 0.0f};
                count++;
                lens[l].planes++;
            }
        }
        if (!pass)
            HADA_TRY_OR_DONE(HADA_NEW(lines, (size_t)count + 1, "the lenses", err));
    }
    *lenses = lens;
    *planes = lines;
    *plane_count = count;
done:
    if (status)
        free(lens);
    return status;
}

/* The area of all lenses; the design's monitor is asked. */
static hada_status wave_lens_area(const hada_mask_design *design, const hada_wave_lens *lenses,
                                  const hada_wave_plane *planes, double *area, hada_error *err)
{
    const int across = design->sites.count > 256 ? 64 : 256;
    const double reach = design->reach, step = 2.0 * reach / across, radius = design->camera.lens_diameter_mm / 2.0;
    double sum = 0.0;
    for (int l = 0; l < design->sites.count; l++) {
        HADA_TRY(hada_monitor_check(design->monitor, err));
        for (int i = 0; i < across * across; i++) {
            const double u = (i % across + 0.5) * step - reach, v = (i / across + 0.5) * step - reach;
            double edge = fmin(radius - sqrt(u * u + v * v),
                               design->camera.aperture_mm / 2.0 - hypot(lenses[l].x + u, lenses[l].y + v));
            for (int p = lenses[l].first; p < lenses[l].first + lenses[l].planes; p++)
                edge = fmin(edge, planes[p].c - planes[p].a * u - planes[p].b * v);
            sum += hada_mask_open(edge, step);
        }
    }
    *area = sum * step * step;
    return HADA_OK;
}

typedef struct work {
    hada_fft *fft;
    hada_buffer field, phase, spectra, part, image;
    float *phases, *images;
    int batch;
} work;

static hada_status work_make(work *w, const hada_wave *wave, const hada_wave_spot *spot, hada_error *err)
{
    hada_context *context = wave->slot->context;
    const hada_spectrum_layout layout = hada_fft_layout(context, spot->n, spot->n, HADA_FFT_OWN);
    const size_t spectra = 4 * sizeof(float) * layout.count; /* of a lens */
    const size_t parts = (size_t)spot->pixels * 2 * (size_t)layout.blocks * HADA_FFT_BLOCK;
    const size_t pixels = (size_t)spot->pixels * (size_t)spot->pixels;
    const size_t values = (size_t)spot->points * (size_t)spot->pitch;
    w->batch = spectra * 2 > SPOT_BYTES ? 1 : (int)(SPOT_BYTES / spectra);
    w->batch = w->batch < wave->design.sites.count ? w->batch : wave->design.sites.count;
    const size_t batch = (size_t)w->batch;
    hada_fft_desc desc = hada_fft_of(HADA_FFT_FORWARD, spot->n, spot->n, 2 * w->batch,
                                     (hada_rectangle){0, 0, spot->points, spot->points});
    desc.backend = HADA_FFT_OWN;
    desc.real_pitch = (size_t)spot->pitch;
    desc.real_distance = values;
    HADA_TRY(HADA_NEW(w->phases, batch * 4 * (size_t)spot->pitch, "phases of lenses", err));
    HADA_TRY(HADA_NEW(w->images, batch * pixels, "spots of lenses", err));
    HADA_TRY(hada_fft_create(&w->fft, wave->slot, &desc, err));
    HADA_TRY(hada_buffer_create(&w->field, context, 2 * batch * values * sizeof(float), "fields of lenses", err));
    HADA_TRY(hada_buffer_create(&w->phase, context, batch * 4 * (size_t)spot->pitch * sizeof(float), "phases of lenses",
                                err));
    HADA_TRY(hada_buffer_create(&w->spectra, context, batch * spectra, "spectra of lenses", err));
    HADA_TRY(hada_buffer_create(&w->part, context, batch * parts * sizeof(float), "spots of lenses", err));
    return hada_buffer_create(&w->image, context, batch * pixels * sizeof(float), "spots of lenses", err);
}

/* Where a spot is along an axis: the pixel it is in, and how many samples its middle lies from the transform's. A
 * pixel's samples are at (k + 1/2 - samples/2) / samples pixels from its middle. */
static int spot_place(double position_mm, double pitch, int middle, int samples, double *shift)
{
    const double at = middle + position_mm / pitch;
    const double pixel = rint(at);
    *shift = (pixel - at) * samples + 0.5 - 0.5 * samples;
    return (int)pixel;
}

static void add_spot(const float *image, const hada_wave_spot *spot, int row, int col, int rows, int cols, double *sum)
{
    for (int r = 0; r < spot->pixels; r++)
        for (int c = 0; c < spot->pixels; c++) {
            const double value = image[(size_t)r * (size_t)spot->pixels + (size_t)c];
            const int at_row = row + r - spot->pixels / 2, at_col = col + c - spot->pixels / 2;
            if (at_row >= 0 && at_row < rows && at_col >= 0 && at_col < cols)
                sum[(size_t)at_row * (size_t)cols + (size_t)at_col] += value;
        }
}

static hada_status run_batch(hada_wave *wave, work *w, const hada_wave_spot *spot, int first, int count,
                             hada_error *err)
{
    HADA_TRY(hada_buffer_write(&w->phase, wave->slot, 0, w->phases,
                               (size_t)count * 4 * (size_t)spot->pitch * sizeof(float), err));
    HADA_TRY(hada_wave_launch_pupil(wave->slot, w->field.mem, w->phase.mem, (hada_wave_lens_array)wave->lenses.mem,
                                    wave->planes.mem, first, count, spot, wave->camera.lens_diameter_mm / 2.0,
                                    wave->camera.aperture_mm / 2.0, err));
    HADA_TRY(hada_fft_forward(w->fft, 2 * count, w->field.mem, 0, w->spectra.mem, 0, err));
    HADA_TRY(hada_wave_launch_spots(wave->slot, w->image.mem, w->part.mem, w->spectra.mem, count, spot->pixels,
                                    spot->samples, err));
    return hada_buffer_read(&w->image, wave->slot, 0, w->images,
                            (size_t)count * (size_t)spot->pixels * (size_t)spot->pixels * sizeof(float), err);
}

static hada_status wave_by_lens(hada_wave *wave, double distance_mm, double wavelength_mm, double path_scale, int rows,
                                int cols, double *sum, double *light, hada_error *err)
{
    const hada_sites *sites = &wave->design.sites;
    const double magnification = hada_camera_magnification(&wave->camera, distance_mm),
                 pitch = wave->camera.pixel_pitch_mm;
    hada_wave_spot spot;
    work w = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(wave_spot_size(wave, distance_mm, wavelength_mm, path_scale, &spot, err));
    HADA_TRY_OR_DONE(work_make(&w, wave, &spot, err));
    for (int first = 0; first < sites->count; first += w.batch) {
        const int count = sites->count - first < w.batch ? sites->count - first : w.batch;
        HADA_TRY_OR_DONE(hada_monitor_check(wave->design.monitor, err));
        for (int i = 0; i < count; i++) {
            double shift;
            float *phase = w.phases + (size_t)i * 4 * (size_t)spot.pitch;
            spot_place(sites->x[first + i] * magnification, pitch, cols / 2, spot.samples, &shift);
            wave_phase(&spot, wavelength_mm, shift, phase);
            spot_place(sites->y[first + i] * magnification, pitch, rows / 2, spot.samples, &shift);
            wave_phase(&spot, wavelength_mm, shift, phase + 2 * spot.pitch);
        }
        HADA_TRY_OR_DONE(run_batch(wave, &w, &spot, first, count, err));
        for (int i = 0; i < count; i++) {
            double shift;
            const int col = spot_place(sites->x[first + i] * magnification, pitch, cols / 2, spot.samples, &shift);
            const int row = spot_place(sites->y[first + i] * magnification, pitch, rows / 2, spot.samples, &shift);
            add_spot(w.images + (size_t)i * (size_t)spot.pixels * (size_t)spot.pixels, &spot, row, col, rows, cols,
                     sum);
        }
    }
    /* Parseval, with the true area: what the softened edges lack in |P|^2 is the light beyond a spot's square */
    *light = (double)spot.n * spot.n * wave->area / (spot.step * spot.step);
done:
    hada_fft_destroy(&w.fft);
    HADA_DESTROY_BUFFERS(&w.field, &w.phase, &w.spectra, &w.part, &w.image);
    HADA_FREE(w.phases, w.images);
    return status;
}

/* Wave optics of a whole mask. Light from a point at distance z that has passed the mask T travels to the sensor at d
 * as a plane wave would over d z / (d + z), in coordinates shrunk by the magnification M = 1 + d/z (the Fresnel scaling
 * theorem); pixels are that much smaller there. Free space is a product in the frequency domain, without the
 * frequencies whose light would leave the grid (K. Matsushima, T. Shimobaba, Optics Express 17(22), 19662 (2009)). */

#define STRAY_FACTOR  9.8696044 /* pi^2, as for a lens */
#define MASK_SAMPLING 1.25      /* of the steepest slope of the mask */
#define PIXEL_PARTS   8         /* samples on a pixel or on the light's finest detail, whichever is larger */
#define EDGE_PARTS    48        /* samples on a hole, a cell or a strip, at least */

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
        step = fmin(step, t->wavelength / (2.0 * MASK_SAMPLING * t->slope));
    return feature > 0.0 ? fmin(step, feature / EDGE_PARTS) : step;
}

/* How far light goes aside, as an angle: by slopes and, as an Airy pattern's tail, from edges. */
static double aside_of(const hada_wave *wave, const travel *t, double step)
{
    const double tail = 2.0 * t->wavelength / (STRAY_FACTOR * wave->options.stray);
    double aside = MASK_SAMPLING * t->slope + tail / wave->camera.aperture_mm;
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

/* Phase of free space over `distance` for frequencies 0 .. count - 1 (negative above n/2) of n samples of `step`: the
 * transfer function exp(-i pi lambda distance f^2), interleaved; 0 beyond the frequency `limit`. */
static void wave_travel_phase(float *phase, int count, int n, double step, double wavelength_mm, double distance_mm,
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
    HADA_DESTROY_BUFFERS(&w->path, &w->open, &w->field, &w->spectrum);
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
    wave_travel_phase(phase, count, g->n, g->step, t->wavelength, t->reach, limit);
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
    HADA_DESTROY_BUFFERS(&table_down, &table_across, &part, &pixel);
    free(image);
    return status;
}

/* A channel of a PSF, added to `sum` (rows x cols); *light: what all light of the mask adds up to. path_scale: the
 * mask's optical path at the wavelength, over that at 587.6 nm. */
static hada_status wave_whole(hada_wave *wave, double distance_mm, double wavelength_mm, double path_scale, int rows,
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

/* Where nothing is chosen: below the rounding of frames of 8 bits (docs/explanation/simulation.md). */
#define STRAY 0.002

static int by_lens(const hada_wave *wave)
{
    return wave->design.sites.count && hada_mask_has_lenses(&wave->camera) && !wave->options.coherent;
}

static hada_status upload_lenses(hada_wave *wave, hada_error *err)
{
    hada_wave_lens *lenses = NULL;
    hada_wave_plane *planes = NULL;
    int count;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(wave_lens_tables(&wave->design, &lenses, &planes, &count, err));
    HADA_TRY_OR_DONE(wave_lens_area(&wave->design, lenses, planes, &wave->area, err));
    HADA_TRY_OR_DONE(hada_buffer_create_from(&wave->lenses, wave->slot, lenses,
                                             (size_t)wave->design.sites.count * sizeof *lenses, "the lenses", err));
    /* one more than there are: a buffer is never empty */
    HADA_TRY_OR_DONE(hada_buffer_create_from(&wave->planes, wave->slot, planes, (size_t)(count + 1) * sizeof *planes,
                                             "the lenses", err));
done:
    HADA_FREE(lenses, planes);
    return status;
}

hada_status hada_wave_create(hada_wave **out, hada_context *context, const hada_camera *camera,
                             const hada_wave_options *callers, hada_error *err)
{
    HADA_NEED(out && context && camera, err);
    hada_wave *wave = NULL;
    hada_wave_options options;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&options, callers, hada_wave_options, err));
    if (options.stray == HADA_AUTO)
        options.stray = STRAY;
    if (!(options.stray >= 1e-5 && options.stray <= 0.2))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "stray light of %g is not possible; use 1e-5 to 0.2", options.stray);
    HADA_TRY_OR_DONE(HADA_NEW(wave, 1, "wave optics", err));
    wave->options = options;
    HADA_TRY_OR_DONE(hada_mask_make_watched(&wave->design, camera, options.monitor, err));
    hada_mask_find_bounds(&wave->design);
    wave->camera = wave->design.camera;
    HADA_TRY_OR_DONE(hada_slot_create(&wave->slot, context, err));
    hada_slot_watch(wave->slot, options.monitor);
    if (by_lens(wave))
        HADA_TRY_OR_DONE(upload_lenses(wave, err));
done:
    if (status)
        hada_wave_destroy(&wave);
    *out = wave;
    return status;
}

void hada_wave_destroy(hada_wave **wave)
{
    hada_wave *w = hada_taken(wave);
    if (!w)
        return;
    if (w->slot)
        hada_slot_finish(w->slot, NULL);
    hada_wave_rest(w);
    HADA_DESTROY_BUFFERS(&w->lenses, &w->planes);
    hada_slot_destroy(&w->slot);
    hada_mask_free(&w->design);
    free(w);
}

hada_status hada_wave_psf(hada_wave *wave, double distance_mm, int rows, int cols, hada_image *psf, hada_error *err)
{
    HADA_NEED(wave && psf, err);
    const hada_camera *camera = &wave->camera;
    const size_t count = hada_size_product((size_t)rows, (size_t)cols);
    double *sum = NULL;
    *psf = (hada_image){0};
    if (!(distance_mm > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a distance of %g mm is not possible; it must be above 0",
                         distance_mm);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(psf, camera->channels, rows, cols, err));
    HADA_TRY_OR_DONE(HADA_NEW(sum, count, "a point spread function", err));
    for (int c = 0; c < camera->channels; c++) {
        double wavelength, path_scale, light = 0.0;
        hada_wave_colour(camera, c, &wavelength, &path_scale);
        for (size_t i = 0; i < count; i++)
            sum[i] = 0.0;
        HADA_TRY_OR_DONE(by_lens(wave)
                             ? wave_by_lens(wave, distance_mm, wavelength, path_scale, rows, cols, sum, &light, err)
                             : wave_whole(wave, distance_mm, wavelength, path_scale, rows, cols, sum, &light, err));
        for (size_t i = 0; i < count; i++)
            psf->data[(size_t)c * count + i] = (float)(sum[i] / light);
    }
done:
    free(sum);
    if (status)
        hada_image_destroy(psf);
    return status;
}

hada_status hada_camera_psf_stack(hada_context *context, const hada_camera *callers, hada_image *psf, hada_error *err)
{
    HADA_NEED(callers && psf, err);
    hada_wave *wave = NULL;
    hada_camera own, *camera = &own;
    hada_status status = hada_camera_take(camera, callers, err);
    if (status)
        return status; /* how many PSFs there are is not known */
    for (int z = 0; z < camera->depths; z++)
        psf[z] = (hada_image){0};
    if (camera->optics == HADA_OPTICS_WAVE && !context)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "wave optics need a device; give a context");
    if (camera->optics == HADA_OPTICS_WAVE)
        HADA_TRY_OR_DONE(hada_wave_create(&wave, context, camera, NULL, err));
    for (int z = 0; z < camera->depths; z++)
        HADA_TRY_OR_DONE(wave ? hada_wave_psf(wave, camera->distances_mm[z], camera->rows, camera->cols, &psf[z], err)
                              : hada_camera_psf(camera, camera->distances_mm[z], 0, 0, &psf[z], err));
done:
    hada_wave_destroy(&wave);
    for (int z = 0; z < camera->depths && status; z++)
        hada_image_destroy(&psf[z]);
    return status;
}
