/* Runs a reference of ref_optics.h on raw doubles from standard input and writes its results as raw doubles to standard
 * output, for oracle_optics.py, which computes the same with NumPy and SciPy.
 *   oracle_optics fresnel N STEP X Y LAMBDA Z D POINTS      field, points
 *   oracle_optics pixel N STEP X Y LAMBDA Z D WIDTH PARTS POINTS   field, points
 *   oracle_optics pupil X Y PLANES N PITCH STEP RADIUS APERTURE    phase, planes
 *   oracle_optics spot PIXELS SAMPLES                       spectra a and b, columns in blocks of 8
 *   oracle_optics mask COUNT WAVES                          path, open
 *   oracle_optics travel ROWS BLOCKS                        spectra, across, down
 *   oracle_optics sensor ROWS COLS ROW COL WIDTH PIXEL_ROWS PIXEL_COLS   real and imaginary part */
#include <string.h>

#include "oracle_words.h"
#include "ref/ref_optics.h"

static void give_away(double *values, size_t count)
{
    give(values, count);
    free(values);
}

static void points(int pixel)
{
    const int n = whole();
    const double step = number(), x = number(), y = number(), lambda = number(), z = number(), d = number();
    const double width = pixel ? number() : 0.0;
    const int parts = pixel ? whole() : 0, count = whole(), each = pixel ? 1 : 2;
    double *field = take(2 * (size_t)n * (size_t)n), *at = take(2 * (size_t)count);
    double *out = room((size_t)each * (size_t)count);
    for (int i = 0; i < count; i++)
        if (pixel)
            out[i] = hada_ref_wave_pixel(field, n, step, x, y, lambda, z, d, at[2 * i], at[2 * i + 1], width, parts);
        else
            hada_ref_fresnel(field, n, step, x, y, lambda, z, d, at[2 * i], at[2 * i + 1], out + 2 * i);
    give_away(out, (size_t)each * (size_t)count);
    free(field);
    free(at);
}

static void pupil(void)
{
    const double x = number(), y = number();
    const int planes = whole(), n = whole(), pitch = whole();
    const double step = number(), radius = number(), aperture = number();
    float *phase = take_floats(4 * (size_t)pitch), *bounds = take_floats(4 * (size_t)planes);
    double *out = room(2 * (size_t)n * (size_t)pitch);
    hada_ref_wave_pupil(phase, x, y, bounds, planes, n, pitch, step, radius, aperture, out);
    give_away(out, 2 * (size_t)n * (size_t)pitch);
    free(phase);
    free(bounds);
}

static void spot(void)
{
    const int pixels = whole(), samples = whole(), n = pixels * samples;
    const size_t half = 16 * (size_t)((n / 2 + 8) / 8) * (size_t)n;
    float *spectra = take_floats(2 * half);
    double *out = room((size_t)pixels * (size_t)pixels);
    hada_ref_wave_spot(spectra, spectra + half, pixels, samples, out);
    give_away(out, (size_t)pixels * (size_t)pixels);
    free(spectra);
}

static void mask(void)
{
    const size_t count = (size_t)whole();
    const double waves = number();
    float *path = take_floats(count), *open = take_floats(count);
    double *out = room(2 * count);
    hada_ref_wave_mask(path, open, count, waves, out);
    give_away(out, 2 * count);
    free(path);
    free(open);
}

static void travel(void)
{
    const int rows = whole(), blocks = whole();
    const size_t count = 16 * (size_t)rows * (size_t)blocks;
    float *spectra = take_floats(2 * count), *across = take_floats(16 * (size_t)blocks),
          *down = take_floats(2 * (size_t)rows);
    double *out = room(2 * count);
    hada_ref_wave_travel(spectra, spectra + count, across, down, rows, blocks, out);
    give_away(out, 2 * count);
    free(spectra);
    free(across);
    free(down);
}

static void sensor(void)
{
    const int rows = whole(), cols = whole();
    const double row = number(), col = number(), width = number();
    const int pixel_rows = whole(), pixel_cols = whole();
    const size_t count = (size_t)rows * (size_t)cols, pixels = (size_t)pixel_rows * (size_t)pixel_cols;
    float *field = take_floats(2 * count);
    double *out = room(pixels);
    hada_ref_wave_sensor(field, field + count, rows, cols, row, col, width, pixel_rows, pixel_cols, out);
    give_away(out, pixels);
    free(field);
}

int main(int count, char **arguments)
{
    const char *what = count > 1 ? arguments[1] : "";
    words = arguments + (count > 1 ? 2 : 1);
    if (!strcmp(what, "fresnel") || !strcmp(what, "pixel"))
        points(*what == 'p');
    else if (!strcmp(what, "pupil"))
        pupil();
    else if (!strcmp(what, "spot"))
        spot();
    else if (!strcmp(what, "mask"))
        mask();
    else if (!strcmp(what, "travel"))
        travel();
    else if (!strcmp(what, "sensor"))
        sensor();
    else {
        fprintf(stderr, "oracle_optics: see the head of oracle_optics.c\n");
        return 2;
    }
    return 0;
}
