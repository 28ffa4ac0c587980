/* Runs a reference of tests/ref on raw doubles from standard input and writes its results as raw doubles to standard
 * output, for oracle_ref.py, which computes the same with NumPy and SciPy.
 *   oracle_ref forward|inverse ROWS COLS
 *   oracle_ref convolve ROWS COLS            scene, psf
 *   oracle_ref convolve_crop ROWS COLS PSF_ROWS PSF_COLS
 *   oracle_ref hadamard SPLIT (ten numbers of hada_ref_grid)      raw frame, filter
 *   oracle_ref fit COUNT PAIRS SPLIT ALPHA RIDGE LEAST   spectra x and b pair by pair, other (2 x count), weights
 *   oracle_ref score SPLIT ALPHA RIDGE (ten numbers of hada_ref_grid)   x, b, sums, other, seen, weights
 *   oracle_ref refine ROWS COLS WINDOW(4) PADDED FRAME(4) DEPTHS STEPS RHO RELAXATION MU   otf, prior, image
 *   oracle_ref variation CHANNELS ROWS COLS THETA LENGTH STEPS   planes; gives planes, duals
 *   oracle_ref crosstalk DEPTHS CHANNELS ROWS COLS SHARE    planes; gives planes
 *   oracle_ref focus MEASURE SUM SIGMA CHANNELS ROWS COLS DEPTHS    planes
 *   oracle_ref crop IN_ROWS IN_COLS CHANNELS ROWS COLS PARTS FACTOR TAPERS INVERT
 *   oracle_ref train SPLIT (ten numbers of hada_ref_grid)   raw frame, filter, gradient of the window
 *   oracle_ref product PRODUCT ROWS COLS BAND_ROWS BAND_COLS   spectrum, filter */
#include <string.h>

#include "helpers.h"
#include "oracle_words.h"
#include "ref/ref_convolve.h"
#include "ref/ref_crosstalk.h"
#include "ref/ref_fft.h"
#include "ref/ref_fit.h"
#include "ref/ref_focus.h"
#include "ref/ref_refine.h"
#include "ref/ref_spectrum.h"
#include "ref/ref_train.h"
#include "ref/ref_tv.h"

static size_t half_count(int rows, int cols)
{
    return (size_t)rows * (size_t)(cols / 2 + 1);
}

static void transform(int inverse)
{
    hada_error error;
    const int rows = whole(), cols = whole();
    const size_t pixels = (size_t)rows * (size_t)cols, values = 2 * half_count(rows, cols);
    const size_t in = inverse ? values : pixels, out = inverse ? pixels : values;
    SCOPED_MEMORY double *from = take(in), *to = room(out);
    check(inverse ? hada_ref_fft_inverse(from, rows, cols, to, &error)
                  : hada_ref_fft_forward(from, rows, cols, to, &error),
          &error);
    give(to, out);
}

static void convolve(int crop)
{
    const int rows = whole(), cols = whole(), psf_rows = crop ? whole() : rows, psf_cols = crop ? whole() : cols;
    const size_t pixels = (size_t)rows * (size_t)cols;
    SCOPED_MEMORY float *scene = take_floats(pixels), *psf = take_floats((size_t)psf_rows * (size_t)psf_cols);
    SCOPED_MEMORY double *out = room(pixels);
    if (crop)
        hada_ref_convolve_crop(rows, cols, scene, psf_rows, psf_cols, psf, out);
    else
        hada_ref_convolve(rows, cols, scene, psf, out);
    give(out, pixels);
}

static hada_ref_grid take_grid(void)
{
    hada_ref_grid grid;
    int *to[] = {&grid.rows,     &grid.cols,       &grid.raw_row,    &grid.raw_col,     &grid.raw_rows,
                 &grid.raw_cols, &grid.window_row, &grid.window_col, &grid.window_rows, &grid.window_cols};
    for (size_t i = 0; i < sizeof to / sizeof *to; i++)
        *to[i] = whole();
    return grid;
}

static void hadamard(void)
{
    hada_error error;
    const int split = whole();
    const hada_ref_grid grid = take_grid();
    const size_t values = 2 * half_count(grid.rows, grid.cols),
                 window = (size_t)grid.window_rows * (size_t)grid.window_cols;
    SCOPED_MEMORY float *raw = take_floats((size_t)grid.raw_rows * (size_t)grid.raw_cols),
                        *filter = take_floats(values);
    SCOPED_MEMORY double *spectrum = room(values), *out = room(window);
    check(hada_ref_grid_forward(&grid, raw, grid.raw_row, grid.raw_col, grid.raw_rows, grid.raw_cols, spectrum, &error),
          &error);
    check(hada_ref_hadamard(&grid, spectrum, filter, split, out, &error), &error);
    give(out, window);
}

/* The plane of a filter, and the gradient of the filter. */
static void train(void)
{
    hada_error error;
    const int split = whole();
    const hada_ref_grid grid = take_grid();
    const size_t values = 2 * half_count(grid.rows, grid.cols),
                 window = (size_t)grid.window_rows * (size_t)grid.window_cols;
    SCOPED_MEMORY float *raw = take_floats((size_t)grid.raw_rows * (size_t)grid.raw_cols);
    double *filter = take(values), *fall = take(window);
    double *spectrum = room(values), *out = room(window), *gradient = room(values);
    check(hada_ref_grid_forward(&grid, raw, grid.raw_row, grid.raw_col, grid.raw_rows, grid.raw_cols, spectrum, &error),
          &error);
    check(hada_ref_train_plane(&grid, spectrum, filter, split, out, &error), &error);
    check(hada_ref_train_filter(&grid, spectrum, fall, split, gradient, &error), &error);
    give(out, window);
    give(gradient, values);
    double *all[] = {filter, fall, spectrum, out, gradient};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        free(all[i]);
}

static void fit(void)
{
    const size_t count = (size_t)whole();
    const int pairs = whole(), split = whole();
    const double alpha = number(), ridge = number(), least = number();
    SCOPED_MEMORY double *sums = room(HADA_REF_FIT_SUMS * count), *out = room(2 * count);
    for (int i = 0; i < pairs; i++) {
        SCOPED_MEMORY double *x = take(2 * count), *b = take(2 * count);
        hada_ref_fit_pair(x, b, count, 1.0, sums);
    }
    SCOPED_MEMORY double *other = take(2 * count), *weights = take(count);
    give(sums, HADA_REF_FIT_SUMS * count);
    hada_ref_fit_filter(sums, other, count, alpha, ridge, split, out);
    give(out, 2 * count);
    hada_ref_fit_transfer(sums, count, least, out);
    give(out, 2 * count);
    const double unexplained = hada_ref_fit_unexplained(sums, weights, count, least);
    give(&unexplained, 1);
}

static void score(void)
{
    const int split = whole();
    const double alpha = number(), ridge = number();
    const hada_ref_grid grid = take_grid();
    const size_t count = half_count(grid.rows, grid.cols);
    double *x = take(2 * count), *b = take(2 * count), *sums = take(HADA_REF_FIT_SUMS * count),
           *other = take(2 * count), *seen = take(2 * count), *weights = take(count), both[2];
    both[0] = hada_ref_fit_leave_one_out(&grid, x, b, sums, other, seen, weights, alpha, ridge, split, &both[1]);
    give(both, 2);
    double *all[] = {x, b, sums, other, seen, weights};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        free(all[i]);
}

static void refine(void)
{
    hada_error error;
    hada_ref_refine p = {.rows = whole(), .channels = 1};
    int *to[] = {&p.cols,       &p.window.row0, &p.window.col0, &p.window.rows, &p.window.cols, &p.padded,
                 &p.frame.row0, &p.frame.col0,  &p.frame.rows,  &p.frame.cols,  &p.depths,      &p.steps};
    for (size_t i = 0; i < sizeof to / sizeof *to; i++)
        *to[i] = whole();
    p.rho = number();
    p.relaxation = number();
    p.mu = number();
    const size_t values = half_count(p.rows, p.cols), depths = (size_t)p.depths, steps = (size_t)p.steps;
    const size_t planes = depths * (size_t)p.window.rows * (size_t)p.window.cols;
    double *otf = take(2 * depths * values), *prior = take(values), *image = take((size_t)p.rows * (size_t)p.cols);
    double *out = room(planes), *residual = room(steps + 1), *split = room(steps + 1);
    p.otf = otf;
    p.prior = prior;
    p.image = image;
    check(hada_ref_refine_run(&p, out, residual, split, &error), &error);
    give(out, planes);
    give(residual, steps + 1);
    give(split, steps + 1);
    double *all[] = {otf, prior, image, out, residual, split};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        free(all[i]);
}

static void variation(void)
{
    hada_error error;
    const int channels = whole(), rows = whole(), cols = whole();
    const double theta = number(), colour = number(), length = number();
    const int steps = whole();
    const size_t values = (size_t)channels * (size_t)rows * (size_t)cols;
    SCOPED_MEMORY double *w = take(values), *duals = room(2 * values), *u = room(values);
    check(hada_ref_tv_coupled(w, channels, rows, cols, theta, colour, length, steps, duals, u, &error), &error);
    give(u, values);
    give(duals, 2 * values);
}

static void crosstalk(void)
{
    const int depths = whole(), channels = whole(), rows = whole(), cols = whole();
    const double share = number();
    const size_t values = (size_t)depths * (size_t)channels * (size_t)rows * (size_t)cols;
    SCOPED_MEMORY double *planes = take(values);
    hada_ref_crosstalk(planes, depths, channels, rows, cols, share);
    give(planes, values);
}

static void focus(void)
{
    hada_error error;
    hada_focus_options options;
    hada_focus_report report;
    double distances[64];
    hada_focus_options_init(&options, 0);
    options.measure = (hada_focus_measure)whole();
    options.fuse = whole() ? HADA_FOCUS_SUM : HADA_FOCUS_WEIGHTED;
    options.window_sigma = number();
    const int channels = whole(), rows = whole(), cols = whole(), depths = whole();
    const size_t pixels = (size_t)rows * (size_t)cols, all = (size_t)channels * pixels;
    for (int z = 0; z < 64; z++)
        distances[z] = 100.0 + 10.0 * z;
    SCOPED_MEMORY float *planes = take_floats(all * (size_t)depths);
    SCOPED_MEMORY double *fused = room(all), *distance = room(pixels), *lead = room(pixels);
    check(hada_ref_focus(planes, channels, rows, cols, depths, distances, NULL, &options, fused, distance, lead,
                         &report, &error),
          &error);
    give(fused, all);
    give(distance, pixels);
    const double numbers[] = {report.noise, report.threshold, report.margin, report.coverage};
    give(numbers, 4);
}

static void crop(void)
{
    const int in_rows = whole(), in_cols = whole(), channels = whole(), rows = whole(), cols = whole();
    const int parts = whole();
    const double factor = number(), tapers = number();
    const size_t out_count = half_count(rows, cols) * (size_t)parts;
    SCOPED_MEMORY float *in = take_floats((size_t)channels * half_count(in_rows, in_cols) * (size_t)parts);
    SCOPED_MEMORY double *out = room(out_count);
    hada_ref_crop(in, in_rows, in_cols, channels, rows, cols, parts, factor, tapers, whole(), out);
    give(out, out_count);
}

static void product(void)
{
    const int kind = whole(), rows = whole(), cols = whole(), band_rows = whole(), band_cols = whole();
    const size_t values = 2 * half_count(rows, cols);
    SCOPED_MEMORY float *in = take_floats(values), *filter = take_floats(values);
    SCOPED_MEMORY double *out = room(values);
    hada_ref_product(in, filter, kind, rows, cols, band_rows, band_cols, out);
    give(out, values);
}

int main(int count, char **arguments)
{
    const char *what = count > 1 ? arguments[1] : "";
    words = arguments + (count > 1 ? 2 : 1);
    if (!strcmp(what, "forward") || !strcmp(what, "inverse"))
        transform(*what == 'i');
    else if (!strcmp(what, "convolve") || !strcmp(what, "convolve_crop"))
        convolve(what[8] == '_');
    else if (!strcmp(what, "hadamard"))
        hadamard();
    else if (!strcmp(what, "fit"))
        fit();
    else if (!strcmp(what, "score"))
        score();
    else if (!strcmp(what, "refine"))
        refine();
    else if (!strcmp(what, "variation"))
        variation();
    else if (!strcmp(what, "crosstalk"))
        crosstalk();
    else if (!strcmp(what, "focus"))
        focus();
    else if (!strcmp(what, "crop"))
        crop();
    else if (!strcmp(what, "train"))
        train();
    else if (!strcmp(what, "product"))
        product();
    else
        quit("see the head of oracle_ref.c");
    return 0;
}
