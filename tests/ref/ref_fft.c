/* Mixed radix by recursion: split off the smallest prime factor, combine by the definition. Plain and slow enough to
 * be read; primes cost their square. */
#include "ref/ref_fft.h"

#include <complex.h>
#include <math.h>
#include <stdlib.h>

#define TURN 6.283185307179586476925286766559

/* out = transform of n values in[0], in[stride], ...; roots[k * step] = exp(-+ 2 pi i k / n). */
static void transform(int n, const double complex *in, int stride, double complex *out, double complex *work,
                      const double complex *roots, int step)
{
    if (n == 1) {
        out[0] = in[0];
        return;
    }
    int p = 2;
    while (n % p)
        p++;
    const int m = n / p;
    for (int k = 0; k < p; k++)
        transform(m, in + (size_t)k * (size_t)stride, stride * p, work + (size_t)k * (size_t)m, out, roots, step * p);
    for (int at = 0; at < n; at++) {
        double complex sum = 0.0;
        for (int k = 0; k < p; k++)
            sum += work[k * m + at % m] * roots[(size_t)((long long)k * at % n) * (size_t)step];
        out[at] = sum;
    }
}

static void fill_roots(double complex *roots, int n, int sign)
{
    for (int k = 0; k < n; k++)
        roots[k] = cexp(sign * TURN * k / n * I);
}

/* Full transforms of all rows and then all columns, in place. */
static hada_status transform_2d(double complex *grid, int rows, int cols, int sign, hada_error *err)
{
    const size_t n = (size_t)(rows > cols ? rows : cols);
    double complex *memory;
    hada_status status = hada_allocated(memory = hada_alloc(4 * n, sizeof *memory, "a reference transform", err));
    if (status)
        return status;
    double complex *roots = memory, *line = memory + n, *out = memory + 2 * n, *work = memory + 3 * n;
    fill_roots(roots, cols, sign);
    for (int y = 0; y < rows; y++) {
        transform(cols, grid + (size_t)y * (size_t)cols, 1, out, work, roots, 1);
        for (int x = 0; x < cols; x++)
            grid[(size_t)y * (size_t)cols + (size_t)x] = out[x];
    }
    fill_roots(roots, rows, sign);
    for (int x = 0; x < cols; x++) {
        for (int y = 0; y < rows; y++)
            line[y] = grid[(size_t)y * (size_t)cols + (size_t)x];
        transform(rows, line, 1, out, work, roots, 1);
        for (int y = 0; y < rows; y++)
            grid[(size_t)y * (size_t)cols + (size_t)x] = out[y];
    }
    free(memory);
    return HADA_OK;
}

static hada_status make_grid(double complex **grid, int rows, int cols, hada_error *err)
{
    if (rows < 1 || cols < 1)
        return hada_fail(err, HADA_ERROR_SIZE, "a reference transform of %d x %d: give positive sizes", rows, cols);
    return hada_allocated(
        *grid = hada_alloc(hada_size_product((size_t)rows, (size_t)cols), sizeof **grid, "a reference transform", err));
}

hada_status hada_ref_fft_forward(const double *image, int rows, int cols, double *spectrum, hada_error *err)
{
    double complex *grid;
    hada_status status = make_grid(&grid, rows, cols, err);
    if (status)
        return status;
    for (size_t i = 0; i < (size_t)rows * (size_t)cols; i++)
        grid[i] = image[i];
    status = transform_2d(grid, rows, cols, -1, err);
    for (int y = 0; y < rows && !status; y++)
        for (int x = 0; x <= cols / 2; x++) {
            *spectrum++ = creal(grid[(size_t)y * (size_t)cols + (size_t)x]);
            *spectrum++ = cimag(grid[(size_t)y * (size_t)cols + (size_t)x]);
        }
    free(grid);
    return status;
}

hada_status hada_ref_fft_inverse(const double *spectrum, int rows, int cols, double *image, hada_error *err)
{
    const int half = cols / 2 + 1;
    double complex *grid;
    hada_status status = make_grid(&grid, rows, cols, err);
    if (status)
        return status;
    /* A column kx and its mirror image: X(-ky, -kx) = conj X(ky, kx). In the columns that are their own mirror image
     * only the part with that symmetry reaches a real image. */
    for (int y = 0; y < rows; y++)
        for (int x = 0; x < cols; x++) {
            const int my = (rows - y) % rows, mx = (cols - x) % cols;
            const size_t at = 2 * ((size_t)y * (size_t)half + (size_t)x);
            const size_t mirror = 2 * ((size_t)my * (size_t)half + (size_t)mx);
            double complex value;
            if (x < half && mx < half)
                value = 0.5 * (spectrum[at] + spectrum[mirror] + I * (spectrum[at + 1] - spectrum[mirror + 1]));
            else if (x < half)
                value = spectrum[at] + I * spectrum[at + 1];
            else
                value = spectrum[mirror] - I * spectrum[mirror + 1];
            grid[(size_t)y * (size_t)cols + (size_t)x] = value;
        }
    status = transform_2d(grid, rows, cols, 1, err);
    for (size_t i = 0; i < (size_t)rows * (size_t)cols && !status; i++)
        image[i] = creal(grid[i]) / ((double)rows * (double)cols);
    free(grid);
    return status;
}
