/* The exact fit against the double reference, and what it is for: recovering a camera. */
#include <string.h>
#include <unistd.h>

#include "camera_small.h"
#include "filter/layout.h"
#include "fit/fitter.h"
#include "ref/ref_filter.h"
#include "ref/ref_fit.h"

enum { ROWS = 30, COLS = 40, WINDOW = 14, DEPTHS = 3, CHANNELS = 2, PAIRS = 4 };
static const double distances[] = {100.0, 200.0, 400.0};

typedef struct fixture {
    hada_context *context;
    char tuning[64];
    hada_image psf[DEPTHS], scene[DEPTHS][PAIRS], frame[DEPTHS][PAIRS];
} fixture;

static int setup_with(void **state, const char *tuning)
{
    static fixture f;
    hada_context_options options;
    hada_context_options_init(&options);
    if (tuning) {
        strcpy(f.tuning, "/tmp/hadalens-test-XXXXXX");
        const int file = mkstemp(f.tuning);
        assert_int_equal(write(file, tuning, strlen(tuning)), strlen(tuning));
        close(file);
        options.tuning = f.tuning;
    }
    ASSERT_OK(hada_context_create(&f.context, &options, err));
    for (int z = 0; z < DEPTHS; z++) {
        f.psf[z] = small_psf(CHANNELS, ROWS, COLS, 12, (uint64_t)z + 1);
        for (int i = 0; i < PAIRS; i++) {
            const uint64_t seed = (uint64_t)(100 * z + i + 1);
            f.scene[z][i] = small_scene(CHANNELS, WINDOW, WINDOW, seed);
            f.frame[z][i] = small_frame(&f.psf[z], &f.scene[z][i], 0, 0.003, seed);
        }
    }
    *state = &f;
    return 0;
}

static int setup(void **state)
{
    return setup_with(state, NULL);
}

/* clFFT has spectra in rows, whose number of values is no multiple of what kernels take at a time. */
static int setup_rows(void **state)
{
    return setup_with(state, "fft * * clfft\n");
}

/* As on a GPU: kernels by work-groups, and the layout of spectra that goes with them. */
static int setup_groups(void **state)
{
    setup(state);
    ((fixture *)*state)->context->shape = HADA_SHAPE_GROUPS;
    return 0;
}

static int teardown(void **state)
{
    fixture *f = *state;
    for (int z = 0; z < DEPTHS; z++) {
        hada_image_destroy(&f->psf[z]);
        for (int i = 0; i < PAIRS; i++) {
            hada_image_destroy(&f->scene[z][i]);
            hada_image_destroy(&f->frame[z][i]);
        }
    }
    assert_int_equal(hada_context_bytes(f->context), 0);
    hada_context_destroy(&f->context);
    if (*f->tuning)
        unlink(f->tuning);
    *f->tuning = '\0';
    return 0;
}

static hada_fit_options usual(int depths, hada_form form)
{
    hada_fit_options options;
    hada_fit_options_init(&options);
    options.depths = depths;
    options.channels = CHANNELS;
    options.distances_mm = distances;
    options.raw_rows = ROWS;
    options.raw_cols = COLS;
    options.window_rows = options.window_cols = WINDOW;
    options.form = form;
    options.refine_steps = 0;
    return options;
}

static void add_all(fixture *f, hada_fitter *fitter, int depths, int first, int last)
{
    for (int z = 0; z < depths; z++)
        for (int i = first; i < last; i++)
            ASSERT_OK(hada_fitter_add(fitter, z, &f->frame[z][i], &f->scene[z][i], err));
}

/* Sums of the reference: [depth][channel][sum][frequency], and a pair's spectra. */
typedef struct reference {
    hada_ref_grid grid;
    size_t plane;
    double *sums, *x, *b, *other, *seen, *weights;
} reference;

static void reference_spectra(const fixture *f, reference *r, int z, int i, int c)
{
    const hada_ref_grid *grid = &r->grid;
    ASSERT_OK(hada_ref_grid_forward(grid, f->frame[z][i].data + c * ROWS * COLS, grid->raw_row, grid->raw_col, ROWS,
                                    COLS, r->b, err));
    ASSERT_OK(hada_ref_grid_forward(grid, f->scene[z][i].data + c * WINDOW * WINDOW, grid->window_row, grid->window_col,
                                    WINDOW, WINDOW, r->x, err));
}

static double *reference_sums(const reference *r, int z, int c)
{
    return r->sums + (size_t)(z * CHANNELS + c) * HADA_REF_FIT_SUMS * r->plane;
}

static reference reference_make(const fixture *f, const hada_fitter *fitter)
{
    const hada_model_info *info = &fitter->info;
    const hada_geometry *at = &fitter->geometry;
    reference r = {.grid = {info->grid_rows, info->grid_cols, at->raw_row, at->raw_col, ROWS, COLS, at->window_row,
                            at->window_col, WINDOW, WINDOW}};
    r.plane = hada_model_info_plane(info);
    r.sums = calloc(r.plane * DEPTHS * CHANNELS * HADA_REF_FIT_SUMS, sizeof(double));
    r.x = calloc(r.plane * 2, sizeof(double));
    r.b = calloc(r.plane * 2, sizeof(double));
    r.other = calloc(r.plane * 2, sizeof(double));
    r.seen = calloc(r.plane * 2, sizeof(double));
    r.weights = calloc(r.plane, sizeof(double));
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS; i++)
            for (int c = 0; c < CHANNELS; c++) {
                reference_spectra(f, &r, z, i, c);
                hada_ref_fit_pair(r.x, r.b, r.plane, 1.0, reference_sums(&r, z, c));
            }
    const size_t half = (size_t)info->grid_cols / 2 + 1;
    for (size_t k = 0; k < r.plane; k++)
        r.weights[k] = k % half == 0 || 2 * (k % half) == (size_t)info->grid_cols ? 1.0 : 2.0;
    return r;
}

static void reference_others(reference *r, int z, int c)
{
    for (size_t k = 0; k < r->plane; k++) {
        r->other[k] = r->other[r->plane + k] = 0.0;
        for (int other = 0; other < DEPTHS; other++)
            if (other != z) {
                r->other[k] += reference_sums(r, other, c)[2 * r->plane + k];
                r->other[r->plane + k] += reference_sums(r, other, c)[5 * r->plane + k];
            }
        r->seen[k] = r->other[k] / (PAIRS * (DEPTHS - 1));
        r->seen[r->plane + k] = r->other[r->plane + k] / (PAIRS * (DEPTHS - 1));
    }
}

static void reference_free(reference *r)
{
    free(r->sums);
    free(r->x);
    free(r->b);
    free(r->other);
    free(r->seen);
    free(r->weights);
}

static void filters_agree_with_the_reference(void **state)
{
    fixture *f = *state;
    for (int k = 0; k < 4; k++) {
        const int split = k & 1;
        hada_fit_options options = usual(DEPTHS, split ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX);
        options.boundary = k & 2 ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR;
        options.alpha = 0.2;
        options.lambda = 1e-3;
        hada_fitter *fitter;
        hada_model *model;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        add_all(f, fitter, DEPTHS, 0, PAIRS);
        ASSERT_OK(hada_fitter_finish(fitter, &model, NULL, NULL, err));
        reference r = reference_make(f, fitter);
        double *expected = malloc(r.plane * 2 * sizeof *expected);
        for (int z = 0; z < DEPTHS; z++)
            for (int c = 0; c < CHANNELS; c++) {
                double scale = 0.0, least = 0.0;
                for (int i = 0; i < PAIRS; i++) {
                    for (int p = 0; p < ROWS * COLS; p++)
                        scale += pow(f->frame[z][i].data[c * ROWS * COLS + p], 2);
                    for (int p = 0; p < WINDOW * WINDOW; p++)
                        least += 1e-6 * pow(f->scene[z][i].data[c * WINDOW * WINDOW + p], 2);
                }
                const size_t image = (size_t)(z * CHANNELS + c);
                reference_others(&r, z, c);
                hada_ref_fit_filter(reference_sums(&r, z, c), r.other, r.plane, 0.2, 1e-3 * scale, split, expected);
                const double error = small_distance(model->filter + image * r.plane * 2, expected, r.plane * 2);
                if (!(error < 2e-6))
                    fail_msg("case %d, depth %d, channel %d: relative error %g of the filter", k, z, c, error);
                hada_ref_fit_transfer(reference_sums(&r, z, c), r.plane, least, expected);
                assert_true(small_distance(model->otf + image * r.plane * 2, expected, r.plane * 2) < 2e-6);
                const double noise = hada_ref_fit_unexplained(reference_sums(&r, z, c), r.weights, r.plane, least) /
                                     ((double)model->info.grid_rows * model->info.grid_cols) / (PAIRS - 1);
                assert_true(fabs(model->noise_power[image] / noise - 1.0) < 1e-3);
            }
        if (!(k & 2)) /* with circular convolution the model is exact and the noise is what the frames were given */
            assert_true(fabs(model->info.noise / 0.003 - 1.0) < 0.05);
        free(expected);
        reference_free(&r);
        hada_model_destroy(&model);
        hada_fitter_destroy(&fitter);
    }
}

static void scores_agree_with_brute_force(void **state)
{
    fixture *f = *state;
    for (int k = 0; k < 4; k++) {
        const int split = k & 1, z = 1, held = 2;
        hada_fit_options options = usual(DEPTHS, split ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX);
        options.boundary = k & 2 ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR;
        hada_fitter *fitter;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        add_all(f, fitter, DEPTHS, 0, PAIRS);
        reference r = reference_make(f, fitter);
        ASSERT_OK(hada_fitter_score(fitter, z, &f->frame[z][held], &f->scene[z][held], err));
        assert_int_equal(fitter->distinct, 10);
        for (int s = 0; s < fitter->setting_count; s++) {
            double own = 0.0, leak = 0.0;
            for (int c = 0; c < CHANNELS; c++) {
                double scale = 0.0, part;
                for (int i = 0; i < PAIRS; i++)
                    for (int p = 0; p < ROWS * COLS; p++)
                        scale += pow(f->frame[z][i].data[c * ROWS * COLS + p], 2);
                reference_others(&r, z, c);
                reference_spectra(f, &r, z, held, c);
                own +=
                    hada_ref_fit_leave_one_out(&r.grid, r.x, r.b, reference_sums(&r, z, c), r.other, r.seen, r.weights,
                                               fitter->alphas[s], fitter->lambdas[s] * scale, split, &part);
                leak += part / ((double)r.grid.rows * r.grid.cols);
            }
            const double pixels = CHANNELS * WINDOW * WINDOW;
            const double single = -10.0 * log10(own / pixels), twofold = -10.0 * log10((own + leak) / pixels);
            const hada_fitter_depth *got = &fitter->depth[z];
            if (!(fabs(got->single[s] - single) < 1e-3 && fabs(got->twofold[s] - twofold) < 1e-3))
                fail_msg("case %d, setting %d: %g and %g dB, expected %g and %g", k, s, got->single[s], got->twofold[s],
                         single, twofold);
        }
        reference_free(&r);
        hada_fitter_destroy(&fitter);
    }
}

static void the_table_marks_the_best_row(void **state)
{
    fixture *f = *state;
    hada_fit_options options = usual(DEPTHS, HADA_FORM_COMPLEX);
    hada_fitter *fitter;
    hada_model *model;
    hada_fit_row *rows;
    size_t count, chosen = 0;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    add_all(f, fitter, DEPTHS, 0, PAIRS);
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS; i++)
            ASSERT_OK(hada_fitter_score(fitter, z, &f->frame[z][i], &f->scene[z][i], err));
    ASSERT_OK(hada_fitter_finish(fitter, &model, &rows, &count, err));
    assert_int_equal(count, 10);
    for (size_t i = 0; i < count; i++) {
        assert_true(isfinite(rows[i].psnr_single) && rows[i].psnr_single > rows[i].psnr_double);
        if (rows[i].chosen) {
            chosen++;
            assert_true(model->info.alpha == rows[i].alpha && model->info.lambda == rows[i].lambda);
            for (size_t k = 0; k < count; k++)
                assert_true(rows[k].psnr_single + rows[k].psnr_double <= rows[i].psnr_single + rows[i].psnr_double);
        }
    }
    assert_int_equal(chosen, 1);
    /* more pairs make the scores stale: without new ones the defaults serve */
    ASSERT_OK(hada_fitter_add(fitter, 0, &f->frame[0][0], &f->scene[0][0], err));
    free(rows);
    hada_model_destroy(&model);
    ASSERT_OK(hada_fitter_finish(fitter, &model, &rows, &count, err));
    assert_int_equal(count, 0);
    assert_null(rows);
    assert_true(model->info.lambda == HADA_FIT_LAMBDA && model->info.alpha == HADA_FIT_ALPHA);
    hada_model_destroy(&model);
    hada_fitter_destroy(&fitter);
}

/* Without noise the filter of a circular camera inverts it: W H = 1 wherever scenes had light. */
static void a_camera_without_noise_is_recovered(void **state)
{
    fixture *f = *state;
    for (int pairs = 1; pairs <= 3; pairs += 2) {
        hada_fit_options options = usual(1, HADA_FORM_COMPLEX);
        options.lambda = 0.0;
        options.window_rows = options.window_cols = 0; /* scenes of the frame's size */
        hada_fitter *fitter;
        hada_model *model;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        for (int i = 0; i < pairs; i++) {
            hada_image scene = small_scene(CHANNELS, ROWS, COLS, (uint64_t)(50 + i));
            hada_image frame = small_frame(&f->psf[0], &scene, 0, 0.0, 0);
            ASSERT_OK(hada_fitter_add(fitter, 0, &frame, &scene, err));
            hada_image_destroy(&scene);
            hada_image_destroy(&frame);
        }
        ASSERT_OK(hada_fitter_finish(fitter, &model, NULL, NULL, err));
        double worst = 0.0;
        for (size_t k = 0; k < hada_model_plane(model) * CHANNELS; k++) {
            const float *w = model->filter + 2 * k, *h = model->otf + 2 * k;
            worst = fmax(worst, hypot(w[0] * h[0] - w[1] * h[1] - 1.0, w[0] * h[1] + w[1] * h[0]));
        }
        if (!(worst < 1e-3))
            fail_msg("%d pairs: W H differs from 1 by %g", pairs, worst);
        hada_model_destroy(&model);
        hada_fitter_destroy(&fitter);
    }
}

/* Ten thousand additions: the sums stay within a few 1e-12 of double precision; float sums would be off by 1e-5. */
static void many_additions_stay_accurate(void **state)
{
    fixture *f = *state;
    enum { MANY = 10000 };
    hada_fit_options options = usual(1, HADA_FORM_SPLIT);
    hada_fitter *fitter;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    const size_t spectrum = (size_t)CHANNELS * fitter->layout.count * 2, count = fitter->layout.count;
    const cl_ulong stride = fitter->stride, vectors = fitter->vectors, offset = 0;
    const cl_float plus = 1.0f;
    float *x = malloc(spectrum * 4), *b = malloc(spectrum * 4), *sums = malloc(12 * stride * 4);
    hada_random random;
    hada_random_seed(&random, 1, 1);
    for (size_t i = 0; i < spectrum; i++) {
        x[i] = (float)(hada_random_uniform(&random) + 0.1);
        b[i] = (float)(hada_random_uniform(&random) + 0.1);
    }
    ASSERT_OK(hada_buffer_write(&fitter->x, fitter->slot, 0, x, spectrum * 4, err));
    ASSERT_OK(hada_buffer_write(&fitter->b, fitter->slot, 0, b, spectrum * 4, err));
    ASSERT_OK(hada_fitter_select(fitter, 0, err));
    hada_arg args[] = {
        HADA_ARG(fitter->x.mem), HADA_ARG(fitter->b.mem), HADA_ARG(offset), HADA_ARG(fitter->sums[0].mem),
        HADA_ARG(stride),        HADA_ARG(plus),          HADA_ARG(vectors)};
    for (int i = 0; i < MANY; i++)
        ASSERT_OK(hada_fitter_launch(fitter, "fit_sums", "fit_pair", args, HADA_COUNT(args), err));
    ASSERT_OK(hada_buffer_read(&fitter->sums[0], fitter->slot, 0, sums, 12 * stride * 4, err));
    double worst = 0.0;
    for (size_t i = 0; i < count; i++) {
        /* what one addition is worth, with the products rounded to float as the device does */
        const float xr = x[2 * i], xi = x[2 * i + 1], br = b[2 * i], bi = b[2 * i + 1];
        const float rr = xr * br, ii = xi * bi, bb = br * br, bj = bi * bi, xx = xr * xr, xj = xi * xi;
        const float one[] = {rr + ii, 0.0f, bb + bj, xx + xj, rr, bb};
        for (size_t k = 0; k < 6; k++)
            if (k != 1)
                worst = fmax(worst, fabs(((double)sums[2 * k * stride + i] + sums[(2 * k + 1) * stride + i]) /
                                             ((double)one[k] * MANY) -
                                         1.0));
    }
    if (!(worst < 1e-11))
        fail_msg("relative error %g after %d additions", worst, MANY);
    free(x);
    free(b);
    free(sums);
    hada_fitter_destroy(&fitter);
}

static void bad_pairs_leave_the_sums_as_they_were(void **state)
{
    fixture *f = *state;
    hada_fit_options options = usual(1, HADA_FORM_COMPLEX);
    hada_fitter *fitter;
    hada_model *before, *after;
    hada_error error;
    options.lambda = 1e-3;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    assert_int_equal(hada_fitter_finish(fitter, &before, NULL, NULL, &error), HADA_ERROR_STATE);
    assert_non_null(strstr(error.message, "100 mm"));
    add_all(f, fitter, 1, 0, 2);
    ASSERT_OK(hada_fitter_finish(fitter, &before, NULL, NULL, err));
    hada_image bad = small_scene(CHANNELS, ROWS, COLS, 1), small = small_scene(CHANNELS, WINDOW - 1, WINDOW, 1);
    bad.data[77] = NAN;
    assert_int_equal(hada_fitter_add(fitter, 0, &bad, &f->scene[0][0], &error), HADA_ERROR_NOT_FINITE);
    bad.data[77] = INFINITY;
    assert_int_equal(hada_fitter_add(fitter, 0, &f->frame[0][0], &bad, &error), HADA_ERROR_NOT_FINITE);
    assert_int_equal(hada_fitter_add(fitter, 0, &f->frame[0][0], &small, &error), HADA_ERROR_SIZE);
    assert_int_equal(hada_fitter_add(fitter, 0, &small, &f->scene[0][0], &error), HADA_ERROR_SIZE);
    assert_int_equal(hada_fitter_add(fitter, 1, &f->frame[0][0], &f->scene[0][0], &error), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_fitter_pairs(fitter, 0), 2);
    ASSERT_OK(hada_fitter_finish(fitter, &after, NULL, NULL, err));
    assert_memory_equal(before->filter, after->filter, hada_model_plane(before) * 2 * CHANNELS * sizeof(float));
    hada_image_destroy(&bad);
    hada_image_destroy(&small);
    hada_model_destroy(&before);
    hada_model_destroy(&after);
    hada_fitter_destroy(&fitter);
}

/* A scene of the frame's size counts by its centre; a dark level is taken off; identical pairs change nothing. */
static void equal_inputs_give_equal_models(void **state)
{
    fixture *f = *state;
    hada_fit_options options = usual(1, HADA_FORM_COMPLEX);
    hada_model *models[3];
    options.lambda = 1e-4;
    for (int k = 0; k < 3; k++) {
        hada_fitter *fitter;
        options.dark = k == 1 ? 0.25 : 0.0;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        hada_image frame, scene;
        ASSERT_OK(hada_image_create(&frame, CHANNELS, ROWS, COLS, err));
        ASSERT_OK(hada_image_create(&scene, CHANNELS, ROWS, COLS, err));
        for (int i = 0; i < CHANNELS * ROWS * COLS; i++)
            frame.data[i] = f->frame[0][0].data[i] + (float)options.dark;
        for (int c = 0; c < CHANNELS; c++)
            for (int row = 0; row < WINDOW; row++)
                memcpy(scene.data + (c * ROWS + row + (ROWS - WINDOW) / 2) * COLS + (COLS - WINDOW) / 2,
                       f->scene[0][0].data + (c * WINDOW + row) * WINDOW, WINDOW * sizeof(float));
        for (int i = 0; i < (k == 2 ? 4 : 1); i++)
            ASSERT_OK(hada_fitter_add(fitter, 0, &frame, k == 1 ? &scene : &f->scene[0][0], err));
        ASSERT_OK(hada_fitter_finish(fitter, &models[k], NULL, NULL, err));
        hada_image_destroy(&frame);
        hada_image_destroy(&scene);
        hada_fitter_destroy(&fitter);
    }
    const size_t values = hada_model_plane(models[0]) * 2 * CHANNELS;
    double distance[3] = {0};
    for (int k = 1; k < 3; k++)
        distance[k] = small_image_distance(models[k]->filter, models[0]->filter, values);
    assert_true(distance[1] < 1e-4); /* the level costs bits of the frame */
    assert_true(distance[2] < 1e-6);
    for (int k = 0; k < 3; k++)
        hada_model_destroy(&models[k]);
}

static void sums_merge_and_go_on(void **state)
{
    fixture *f = *state;
    char folder[] = "/tmp/hadalens-test-XXXXXX", path[2][64];
    assert_non_null(mkdtemp(folder));
    for (int form = HADA_FORM_COMPLEX; form <= HADA_FORM_SPLIT; form++) {
        hada_fit_options options = usual(DEPTHS, (hada_form)form);
        hada_fitter *fitter;
        hada_model *whole, *resumed, *merged;
        options.alpha = 0.1;
        options.lambda = 1e-4;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        add_all(f, fitter, DEPTHS, 0, PAIRS);
        ASSERT_OK(hada_fitter_finish(fitter, &whole, NULL, NULL, err));
        hada_fitter_destroy(&fitter);
        for (int part = 0; part < 2; part++) {
            snprintf(path[part], sizeof path[part], "%s/%d-%d.safetensors", folder, form, part);
            ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
            add_all(f, fitter, DEPTHS, part ? 2 : 0, part ? PAIRS : 2);
            ASSERT_OK(hada_fitter_save_sums(fitter, path[part], err));
            hada_fitter_destroy(&fitter);
        }
        /* loaded into nothing and continued in the same order: the same bits */
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        ASSERT_OK(hada_fitter_load_sums(fitter, path[0], err));
        assert_int_equal(hada_fitter_pairs(fitter, DEPTHS - 1), 2);
        add_all(f, fitter, DEPTHS, 2, PAIRS);
        ASSERT_OK(hada_fitter_finish(fitter, &resumed, NULL, NULL, err));
        hada_fitter_destroy(&fitter);
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        ASSERT_OK(hada_fitter_load_sums(fitter, path[1], err));
        ASSERT_OK(hada_fitter_load_sums(fitter, path[0], err));
        ASSERT_OK(hada_fitter_finish(fitter, &merged, NULL, NULL, err));
        const size_t values = hada_model_plane(whole) * 2 * DEPTHS * CHANNELS;
        assert_memory_equal(whole->filter, resumed->filter, values * sizeof(float));
        assert_memory_equal(whole->otf, resumed->otf, values * sizeof(float));
        assert_true(small_image_distance(merged->filter, whole->filter, values) < 1e-6);
        assert_true(merged->pairs[0] == PAIRS);
        hada_model_destroy(&whole);
        hada_model_destroy(&resumed);
        hada_model_destroy(&merged);

        /* what does not belong together is refused, and nothing is added */
        hada_error error;
        hada_fitter *other;
        hada_fit_options wrong = options;
        wrong.window_rows = WINDOW - 2;
        ASSERT_OK(hada_fitter_create(&other, f->context, &wrong, err));
        assert_int_equal(hada_fitter_load_sums(other, path[0], &error), HADA_ERROR_SIZE);
        assert_int_equal(hada_fitter_pairs(other, 0), 0);
        hada_fitter_destroy(&other);
        wrong = options;
        wrong.form = form == HADA_FORM_SPLIT ? HADA_FORM_COMPLEX : HADA_FORM_SPLIT;
        ASSERT_OK(hada_fitter_create(&other, f->context, &wrong, err));
        assert_int_equal(hada_fitter_load_sums(other, path[0], &error),
                         form == HADA_FORM_SPLIT ? HADA_OK : HADA_ERROR_SIZE);
        hada_fitter_destroy(&other);
        assert_int_equal(hada_fitter_load_sums(fitter, "/nonexistent/sums", &error), HADA_ERROR_FILE_OPEN);
        hada_fitter_destroy(&fitter);
        unlink(path[0]);
        unlink(path[1]);
    }
    rmdir(folder);
}

/* The order in which depths come changes nothing: sums wait on the host while another depth is at work. */
static void depths_may_come_in_any_order(void **state)
{
    fixture *f = *state;
    hada_fit_options options = usual(DEPTHS, HADA_FORM_COMPLEX);
    hada_fitter *a, *b;
    hada_model *one, *two;
    options.alpha = 0.3;
    options.lambda = 1e-4;
    ASSERT_OK(hada_fitter_create(&a, f->context, &options, err));
    const uint64_t bytes = hada_fitter_bytes(a);
    assert_int_equal(hada_context_bytes(f->context), bytes);
    ASSERT_OK(hada_fitter_create(&b, f->context, &options, err));
    add_all(f, a, DEPTHS, 0, PAIRS);
    for (int i = 0; i < PAIRS; i++)
        for (int z = DEPTHS - 1; z >= 0; z--)
            ASSERT_OK(hada_fitter_add(b, z, &f->frame[z][i], &f->scene[z][i], err));
    ASSERT_OK(hada_fitter_finish(a, &one, NULL, NULL, err));
    ASSERT_OK(hada_fitter_finish(b, &two, NULL, NULL, err));
    assert_memory_equal(one->filter, two->filter, hada_model_plane(one) * 2 * DEPTHS * CHANNELS * sizeof(float));
    hada_model_destroy(&one);
    hada_model_destroy(&two);
    hada_fitter_destroy(&a);
    hada_fitter_destroy(&b);
}

static void bad_options_are_refused(void **state)
{
    fixture *f = *state;
    static const double backwards[] = {300.0, 200.0, 100.0};
    hada_fitter *fitter;
    hada_error error;
    hada_fit_options options = usual(DEPTHS, HADA_FORM_WIENER);
    assert_int_equal(hada_fitter_create(&fitter, f->context, &options, &error), HADA_ERROR_ARGUMENT);
    options = usual(DEPTHS, HADA_FORM_COMPLEX);
    options.distances_mm = backwards;
    assert_int_equal(hada_fitter_create(&fitter, f->context, &options, &error), HADA_ERROR_MODEL);
    options = usual(DEPTHS, HADA_FORM_COMPLEX);
    options.window_rows = ROWS + 1;
    assert_int_equal(hada_fitter_create(&fitter, f->context, &options, &error), HADA_ERROR_SIZE);
    options = usual(0, HADA_FORM_COMPLEX);
    assert_int_equal(hada_fitter_create(&fitter, f->context, &options, &error), HADA_ERROR_MODEL);
    assert_null(fitter);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(filters_agree_with_the_reference), cmocka_unit_test(scores_agree_with_brute_force),
        cmocka_unit_test(the_table_marks_the_best_row),     cmocka_unit_test(a_camera_without_noise_is_recovered),
        cmocka_unit_test(many_additions_stay_accurate),     cmocka_unit_test(bad_pairs_leave_the_sums_as_they_were),
        cmocka_unit_test(equal_inputs_give_equal_models),   cmocka_unit_test(sums_merge_and_go_on),
        cmocka_unit_test(depths_may_come_in_any_order),     cmocka_unit_test(bad_options_are_refused),
    };
    const struct CMUnitTest by_groups[] = {
        cmocka_unit_test(filters_agree_with_the_reference),
        cmocka_unit_test(scores_agree_with_brute_force),
    };
    int failed = cmocka_run_group_tests(tests, setup, teardown);
    failed += cmocka_run_group_tests(by_groups, setup_groups, teardown);
    return failed + cmocka_run_group_tests(by_groups, setup_rows, teardown);
}
