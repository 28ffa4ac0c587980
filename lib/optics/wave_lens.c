/* Wave optics, lens by lens. Behind the lens on p, with q = p + u on the mask and s = p (1 + d/z) + v on the sensor,
 * the Fresnel integral's terms in |u|^2 and in u are U(v) ~ integral P(u) exp(i pi (1/z + 1/d - 1/f) |u|^2 / lambda)
 * exp(-2 pi i u v / (lambda d)) du, a Fourier transform on a small grid round the spot, whatever the lens's place; the
 * rest has modulus 1. Light of different lenses adds up as intensity. */

#include "core/callers.h"
#include "optics/wave.h"

#define PI                3.14159265358979323846
#define OVERSAMPLING      1.5 /* of the field of a lens on the sensor, beyond lambda d / diameter, at least */
#define OVERSAMPLING_MOST 4.0
#define SAMPLES_GOOD      8                  /* on a pixel: with so many, the least oversampling is enough */
#define SAMPLES_LEAST     3                  /* on a pixel */
#define SPOT_MOST         4096               /* samples of the square round a spot, a side */
#define SPOT_BYTES        ((size_t)48 << 20) /* of spectra at a time */

static int is_smooth(int n)
{
    static const int primes[] = {2, 3, 5, 7};
    for (int i = 0; i < 4; i++)
        while (n % primes[i] == 0)
            n /= primes[i];
    return n == 1;
}

static int smooth_at_least(double least, int step)
{
    int n = (int)ceil(least / step) * step;
    while (!is_smooth(n))
        n += step;
    return n;
}

hada_status hada_wave_spot_size(const hada_wave *wave, double distance_mm, double wavelength_mm, double path_scale,
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

void hada_wave_phase(const hada_wave_spot *spot, double wavelength_mm, double shift, float *phase)
{
    for (int i = 0; i < spot->pitch; i++) {
        const double index = i - 0.5 * (spot->points - 1), u = index * spot->step;
        const double angle = PI * spot->chirp * u * u / wavelength_mm - 2.0 * PI * index * shift / spot->n;
        phase[2 * i] = i < spot->points ? (float)cos(angle) : 0.0f;
        phase[2 * i + 1] = i < spot->points ? (float)sin(angle) : 0.0f;
    }
}

hada_status hada_wave_lens_tables(const hada_mask_design *design, hada_wave_lens **lenses, hada_wave_plane **planes,
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

hada_status hada_wave_lens_area(const hada_mask_design *design, const hada_wave_lens *lenses,
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

hada_status hada_wave_by_lens(hada_wave *wave, double distance_mm, double wavelength_mm, double path_scale, int rows,
                              int cols, double *sum, double *light, hada_error *err)
{
    const hada_sites *sites = &wave->design.sites;
    const double magnification = hada_camera_magnification(&wave->camera, distance_mm),
                 pitch = wave->camera.pixel_pitch_mm;
    hada_wave_spot spot;
    work w = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_wave_spot_size(wave, distance_mm, wavelength_mm, path_scale, &spot, err));
    HADA_TRY_OR_DONE(work_make(&w, wave, &spot, err));
    for (int first = 0; first < sites->count; first += w.batch) {
        const int count = sites->count - first < w.batch ? sites->count - first : w.batch;
        HADA_TRY_OR_DONE(hada_monitor_check(wave->design.monitor, err));
        for (int i = 0; i < count; i++) {
            double shift;
            float *phase = w.phases + (size_t)i * 4 * (size_t)spot.pitch;
            spot_place(sites->x[first + i] * magnification, pitch, cols / 2, spot.samples, &shift);
            hada_wave_phase(&spot, wavelength_mm, shift, phase);
            spot_place(sites->y[first + i] * magnification, pitch, rows / 2, spot.samples, &shift);
            hada_wave_phase(&spot, wavelength_mm, shift, phase + 2 * spot.pitch);
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
