/* The exact fit: few, equal and many pairs, and extreme lambda, against double precision. */
#include "camera_small.h"
#include "fit/fitter.h"
#include "model/model.h"
#include "ref/ref_filter.h"
#include "ref/ref_fit.h"
#include "stress.h"

typedef struct data_set {
    int rows, cols;
    hada_image psf;
    hada_ref_grid grid;
    size_t plane;
    double *sums;              /* as ref_fit.h has them */
    double *wrong, *wrong_raw; /* per frequency: what rounding may add to |Sxb| and to Sbb */
    double *x, *b;
    double raw_energy, scene_energy; /* of all pairs */
} data_set;

static data_set set_make(int rows, int cols)
{
    data_set s = {.rows = rows, .cols = cols, .grid = {rows, cols, 0, 0, rows, cols, 0, 0, rows, cols}};
    s.plane = (size_t)rows * (size_t)(cols / 2 + 1);
    s.psf = small_psf(1, rows, cols, 6, 9);
    s.sums = stress_memory(HADA_REF_FIT_SUMS * s.plane, sizeof *s.sums);
    s.wrong = stress_memory(s.plane, sizeof *s.wrong);
    s.wrong_raw = stress_memory(s.plane, sizeof *s.wrong_raw);
    s.x = stress_memory(2 * s.plane, sizeof *s.x);
    s.b = stress_memory(2 * s.plane, sizeof *s.b);
    return s;
}

static void set_free(data_set *s)
{
    hada_image_destroy(&s->psf);
    HADA_FREE(s->sums, s->wrong, s->wrong_raw, s->x, s->b);
}

/* Takes a pair into the sums in double precision, and bounds what the device's single precision makes of it (F1): each
 * spectrum value is off by 6 standard deviations of its transform's error at most. */
static void set_add(data_set *s, const hada_image *raw, const hada_image *scene)
{
    const size_t n = hada_image_count(raw);
    const double once = 6.0 * stress_fft_bound(s->rows, s->cols);
    const double of_b = once * stress_norm(raw->data, n), of_x = once * stress_norm(scene->data, n);
    ASSERT_OK(hada_ref_grid_forward(&s->grid, raw->data, 0, 0, s->rows, s->cols, s->b, err));
    ASSERT_OK(hada_ref_grid_forward(&s->grid, scene->data, 0, 0, s->rows, s->cols, s->x, err));
    hada_ref_fit_pair(s->x, s->b, s->plane, 1.0, s->sums);
    for (size_t i = 0; i < s->plane; i++) {
        const double b = hypot(s->b[2 * i], s->b[2 * i + 1]), x = hypot(s->x[2 * i], s->x[2 * i + 1]);
        s->wrong[i] += x * of_b + b * of_x + of_x * of_b + 4.0 * STRESS_U * x * b;
        s->wrong_raw[i] += 2.0 * b * of_b + of_b * of_b + 4.0 * STRESS_U * b * b;
    }
    s->raw_energy += pow(stress_norm(raw->data, n), 2.0);
    s->scene_energy += pow(stress_norm(scene->data, n), 2.0);
}

/* The largest error of a filter value over its own bound (so the bound of the row is 1); frequencies whose denominator
 * is rounding error for the most part can be anything finite. */
static void filter_row(const data_set *s, const hada_model *model, double lambda, int64_t pairs, const char *what)
{
    double worst = 0.0, *want = stress_memory(2 * s->plane, sizeof *want);
    SCOPED_MEMORY double *none = stress_memory(2 * s->plane, sizeof *none);
    size_t lost = 0;
    const double ridge = lambda * s->raw_energy;
    hada_ref_fit_filter(s->sums, none, s->plane, 0.0, ridge, 0, want);
    for (size_t i = 0; i < s->plane; i++) {
        const float *w = model->filter + 2 * i;
        const double under = s->sums[2 * s->plane + i] + ridge, size = hypot(want[2 * i], want[2 * i + 1]);
        const double off = hypot(w[0] - want[2 * i], w[1] - want[2 * i + 1]);
        if (!isfinite(w[0]) || !isfinite(w[1])) {
            worst = INFINITY;
        } else if (s->wrong_raw[i] > 0.5 * under) {
            lost++;
        } else {
            const double bound =
                (s->wrong[i] + size * s->wrong_raw[i]) / (under - s->wrong_raw[i]) + 8.0 * STRESS_U * size + 0x1p-126;
            worst = fmax(worst, off / bound);
        }
    }
    stress_row("F1", lost * 2 > s->plane ? INFINITY : worst, 1.0, "fit, %s (%lld pairs), lambda %.0e: error over bound",
               what, (long long)pairs, lambda);
    free(want);
}

/* Also of transfer functions: H = conj(Sxb) / max(Sxx, 1e-6 of the mean). */
static void transfer_row(const data_set *s, const hada_model *model, int64_t pairs, const char *what)
{
    const double once = 6.0 * stress_fft_bound(s->rows, s->cols), least = 1e-6 * s->scene_energy;
    double worst = 0.0, *want = stress_memory(2 * s->plane, sizeof *want);
    hada_ref_fit_transfer(s->sums, s->plane, least, want);
    for (size_t i = 0; i < s->plane; i++) {
        const float *h = model->otf + 2 * i;
        const double under = fmax(s->sums[3 * s->plane + i], least), size = hypot(want[2 * i], want[2 * i + 1]);
        const double wrong =
            once * once * s->scene_energy + 2.0 * once * sqrt(s->sums[3 * s->plane + i] * s->scene_energy);
        const double bound = (s->wrong[i] + size * wrong) / fmax(under - wrong, 0.1 * under) + 8.0 * STRESS_U * size;
        const double off = hypot(h[0] - want[2 * i], h[1] - want[2 * i + 1]);
        worst = fmax(worst, isfinite(off) ? off / bound : INFINITY);
    }
    stress_row("F1", worst, 1.0, "fit, %s (%lld pairs), transfer function: error over bound", what, (long long)pairs);
    free(want);
}

typedef enum pair_kind { RANDOM_PAIRS, EQUAL_PAIRS, DARK_PAIRS, WIDE_PAIRS, BOX_PAIRS } pair_kind;

static void fill_pair(pair_kind kind, int64_t i, hada_image *raw, hada_image *scene)
{
    const size_t n = hada_image_count(raw);
    hada_random random;
    stress_fill_uniform(scene->data, n, kind == EQUAL_PAIRS ? 1 : (uint64_t)i + 1);
    hada_random_seed(&random, kind == EQUAL_PAIRS ? 1 : (uint64_t)i + 1, 77);
    if (kind == WIDE_PAIRS)
        stress_fill_range(scene->data, n, (uint64_t)i + 1);
    /* a cheap camera: the scene and a shifted copy of it */
    for (size_t k = 0; k < n && kind == BOX_PAIRS; k++) { /* a box of four columns, whose transfer function has zeros */
        const size_t cols = (size_t)raw->cols, row = k / cols * cols, col = k % cols;
        raw->data[k] = 0.0f;
        for (size_t shift = 0; shift < 4; shift++)
            raw->data[k] += 0.25f * scene->data[row + (col + shift) % cols];
    }
    for (size_t k = 0; k < n && kind != BOX_PAIRS; k++)
        raw->data[k] = kind == DARK_PAIRS && i % 2 ? 0.0f : 0.7f * scene->data[k] + 0.3f * scene->data[(k + 5) % n];
    for (size_t k = 0; k < n && (kind == RANDOM_PAIRS || kind == EQUAL_PAIRS); k++)
        raw->data[k] += (float)(0.01 * hada_random_normal(&random));
}

static void fit(const stress_device *device, pair_kind kind, int64_t pairs, const double *lambdas, size_t lambda_count,
                const char *what)
{
    static const double distance[] = {100.0};
    const int small = stress_form_now == STRESS_TINY, rows = small ? 6 : 16, cols = small ? 8 : 24;
    data_set s = set_make(rows, cols);
    hada_image raw, scene;
    ASSERT_OK(hada_image_create(&raw, 1, rows, cols, err));
    ASSERT_OK(hada_image_create(&scene, 1, rows, cols, err));
    for (size_t k = 0; k < lambda_count; k++) {
        SCOPED(hada_fitter) * fitter;
        SCOPED(hada_model) * model;
        DEFAULTS(hada_fit_options, options);
        options.depths = options.channels = 1;
        options.distances_mm = distance;
        options.raw_rows = options.window_rows = rows;
        options.raw_cols = options.window_cols = cols;
        options.lambda = lambdas[k];
        options.refine_steps = 0;
        options.nonnegative = 0; /* F1 bounds the quotient of the sums */
        ASSERT_OK(hada_fitter_create(&fitter, device->context, &options, err));
        for (int64_t i = 0; i < pairs; i++) {
            fill_pair(kind, i, &raw, &scene);
            ASSERT_OK(hada_fitter_add_pair(fitter, 0, &raw, &scene, err));
            if (!k)
                set_add(&s, &raw, &scene);
        }
        ASSERT_OK(hada_fitter_finish(fitter, NULL, &model, err));
        filter_row(&s, model, lambdas[k], pairs, what);
        if (!k)
            transfer_row(&s, model, pairs, what);
        /* what equal pairs leave unexplained is 0, and rounding error on the device */
        if (!k && kind == EQUAL_PAIRS)
            stress_row("F2", model->info.noise / sqrt(s.raw_energy / (double)pairs / (rows * cols)),
                       sqrt(6.0 * STRESS_U), "fit, %s (%lld pairs): noise found over the frames' rms", what,
                       (long long)pairs);
    }
    hada_image_destroy(&raw);
    hada_image_destroy(&scene);
    set_free(&s);
}

void stress_fit(void **state)
{
    (void)state;
    static const double extreme[] = {1e-4, 0.0, 1e-30, 1e3, 1e30}, usual[] = {1e-4};
    stress_device device = stress_open();
    fit(&device, RANDOM_PAIRS, 1, extreme, HADA_COUNT(extreme), "one pair");
    fit(&device, EQUAL_PAIRS, 8, extreme, 2, "equal pairs");
    fit(&device, DARK_PAIRS, 8, extreme, 2, "every other frame black");
    fit(&device, WIDE_PAIRS, 8, extreme, 2, "pixels from 1 to 1e12");
    fit(&device, BOX_PAIRS, 8, extreme, 2, "zeros in the transfer function");
    if (stress_form_now != STRESS_TINY)
        fit(&device, RANDOM_PAIRS, stress_form_now == STRESS_FULL ? 10000 : 1000, usual, 1, "many pairs");
    stress_close(&device);
    stress_end_group();
}
