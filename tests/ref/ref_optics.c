#include "ref/ref_optics.h"

#include <math.h>

#define PI 3.14159265358979323846

void hada_ref_fresnel(const double *field, int n, double step, double middle_x, double middle_y, double lambda,
                      double z, double d, double x, double y, double out[2])
{
    double re = 0.0, im = 0.0;
    for (int r = 0; r < n; r++)
        for (int c = 0; c < n; c++) {
            const double qx = middle_x + (c - 0.5 * (n - 1)) * step, qy = middle_y + (r - 0.5 * (n - 1)) * step;
            const double path = (qx * qx + qy * qy) / z + ((x - qx) * (x - qx) + (y - qy) * (y - qy)) / d;
            const double co = cos(PI * path / lambda), si = sin(PI * path / lambda);
            const double *f = field + 2 * ((size_t)r * (size_t)n + (size_t)c);
            re += f[0] * co - f[1] * si;
            im += f[0] * si + f[1] * co;
        }
    out[0] = re * step * step / (lambda * d);
    out[1] = im * step * step / (lambda * d);
}

double hada_ref_wave_pixel(const double *field, int n, double step, double middle_x, double middle_y, double lambda,
                           double z, double d, double x, double y, double width, int parts)
{
    double sum = 0.0;
    for (int i = 0; i < parts; i++)
        for (int j = 0; j < parts; j++) {
            double u[2];
            hada_ref_fresnel(field, n, step, middle_x, middle_y, lambda, z, d, x + width * ((j + 0.5) / parts - 0.5),
                             y + width * ((i + 0.5) / parts - 0.5), u);
            sum += u[0] * u[0] + u[1] * u[1];
        }
    return sum * width * width / ((double)parts * parts);
}

void hada_ref_wave_pupil(const float *phase, double x, double y, const float *planes, int plane_count, int n, int pitch,
                         double step, double radius, double aperture, double *out)
{
    for (int r = 0; r < n; r++)
        for (int c = 0; c < pitch; c++) {
            const double u = (c - 0.5 * (n - 1)) * step, v = (r - 0.5 * (n - 1)) * step;
            double edge = fmin(radius - sqrt(u * u + v * v), aperture - sqrt((x + u) * (x + u) + (y + v) * (y + v)));
            for (int p = 0; p < plane_count; p++)
                edge = fmin(edge, planes[4 * p + 2] - planes[4 * p] * u - planes[4 * p + 1] * v);
            const double open = c < n ? fmin(fmax(0.5 + edge / step, 0.0), 1.0) : 0.0;
            const float *h = phase + 2 * c, *w = phase + 2 * (pitch + r);
            const size_t at = (size_t)r * (size_t)pitch + (size_t)c;
            out[at] = open * ((double)h[0] * w[0] - (double)h[1] * w[1]);
            out[(size_t)n * (size_t)pitch + at] = open * ((double)h[0] * w[1] + (double)h[1] * w[0]);
        }
}

static size_t blocked(int rows, int row, int col)
{
    return 2 * (((size_t)(col / 8) * (size_t)rows + (size_t)row) * 8 + (size_t)(col % 8));
}

/* A value of the whole spectrum, by the half that is kept of a real image's. Column n/2 stands for -n/2. */
static void whole(const float *half, int n, int row, int col, double out[2])
{
    const int mirrored = col >= n / 2;
    const float *at = half + blocked(n, mirrored ? (n - row) % n : row, mirrored ? n - col : col);
    out[0] = at[0];
    out[1] = mirrored ? -at[1] : at[1];
}

void hada_ref_wave_spot(const float *a, const float *b, int pixels, int samples, double *out)
{
    const int n = pixels * samples;
    for (int i = 0; i < pixels * pixels; i++)
        out[i] = 0.0;
    for (int r = 0; r < n; r++)
        for (int c = 0; c < n; c++) {
            const int row = (r + n - n / 2) % n, col = (c + n - n / 2) % n; /* frequencies r - n/2, c - n/2 */
            double x[2], y[2];
            whole(a, n, row, col, x);
            whole(b, n, row, col, y);
            const double re = x[0] - y[1], im = x[1] + y[0];
            out[(size_t)(r / samples) * (size_t)pixels + (size_t)(c / samples)] += re * re + im * im;
        }
}

void hada_ref_wave_mask(const float *path, const float *open, size_t count, double waves, double *out)
{
    for (size_t i = 0; i < count; i++) {
        out[i] = open[i] * cos(2.0 * PI * waves * path[i]);
        out[count + i] = open[i] * sin(2.0 * PI * waves * path[i]);
    }
}

void hada_ref_wave_travel(const float *real, const float *imaginary, const float *across, const float *down, int rows,
                          int blocks, double *out)
{
    const size_t count = (size_t)rows * 8 * (size_t)blocks;
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < 8 * blocks; c++) {
            const double re = (double)across[2 * c] * down[2 * r] - (double)across[2 * c + 1] * down[2 * r + 1];
            const double im = (double)across[2 * c] * down[2 * r + 1] + (double)across[2 * c + 1] * down[2 * r];
            const size_t at = blocked(rows, r, c);
            for (size_t part = 0; part < 2; part++) { /* re and im stand for the transforms of real even images */
                out[at + part] = real[at + part] * re - imaginary[at + part] * im;
                out[2 * count + at + part] = real[at + part] * im + imaginary[at + part] * re;
            }
        }
}

static double common(double low, double high, double from, double to)
{
    return fmax(0.0, fmin(high, to) - fmax(low, from));
}

void hada_ref_wave_sensor(const float *real, const float *imaginary, int rows, int cols, double row, double col,
                          double width, int pixel_rows, int pixel_cols, double *out)
{
    for (int i = 0; i < pixel_rows; i++)
        for (int j = 0; j < pixel_cols; j++) {
            double sum = 0.0;
            for (int r = 0; r < rows; r++) {
                const double tall = common(row + i * width, row + (i + 1) * width, r, r + 1);
                for (int c = 0; c < cols && tall > 0.0; c++) {
                    const size_t at = (size_t)r * (size_t)cols + (size_t)c;
                    sum += tall * common(col + j * width, col + (j + 1) * width, c, c + 1) *
                           ((double)real[at] * real[at] + (double)imaginary[at] * imaginary[at]);
                }
            }
            out[(size_t)i * (size_t)pixel_cols + (size_t)j] = sum;
        }
}
