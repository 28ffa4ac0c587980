/* The exact fit against the double reference, and what it is for: recovering a camera. */
#include "fit_fixture.h"
#include "ref/ref_fft.h"
#include "ref/ref_filter.h"
#include "ref/ref_fit.h"

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
    const hada_model_info *info = &fitter->grid.info;
    const hada_geometry *at = &fitter->grid.geometry;
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
    HADA_FREE(r->sums, r->x, r->b, r->other, r->seen, r->weights);
}

/* By the library's rule, with its weights written out. `energy`: of the channel's scenes; `ratio`: the noise's power
 * over that of the frames. */
static void reference_nonnegative(const reference *r, const double *sums, double energy, double ratio, double *otf)
{
    double weights[64];
    DEFAULTS(hada_nonnegative_rule, rule);
    assert_true(rule.steps > 1 && rule.steps <= 64);
    for (int i = 0; i < rule.steps; i++)
        weights[i] = rule.first * pow(rule.last / rule.first, i / (rule.steps - 1.0));
    ASSERT_OK(hada_ref_fit_nonnegative(sums, r->grid.rows, r->grid.cols, energy, rule.steps, weights, rule.relaxation,
                                       fmin(1e4 * ratio, 1.0), otf, err));
}

TEST(filters_agree_with_the_reference)
{
    fixture *f = *state;
    for (int k = 0; k < 8; k++) {
        const int split = k & 1;
        hada_fit_options options = usual(DEPTHS, split ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX);
        options.boundary = k & 2 ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR;
        options.alpha = 0.2;
        options.lambda = 1e-3;
        options.nonnegative = k >> 2;
        SCOPED(hada_fitter) * fitter;
        SCOPED(hada_model) * model;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        add_all(f, fitter, DEPTHS, 0, PAIRS);
        ASSERT_OK(hada_fitter_finish(fitter, NULL, &model, err));
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
                const double error = relative_error(model->filter + image * r.plane * 2, expected, r.plane * 2);
                if (!(error < 2e-6))
                    fail_msg("case %d, depth %d, channel %d: relative error %g of the filter", k, z, c, error);
                hada_ref_fit_transfer(reference_sums(&r, z, c), r.plane, least, expected);
                const double noise = hada_ref_fit_unexplained(reference_sums(&r, z, c), r.weights, r.plane, least) /
                                     ((double)model->info.grid_rows * model->info.grid_cols) / (PAIRS - 1);
                if (options.nonnegative)
                    reference_nonnegative(&r, reference_sums(&r, z, c), least * 1e6, noise / scale, expected);
                assert_true(relative_error(model->otf + image * r.plane * 2, expected, r.plane * 2) < 2e-6);
                assert_true(fabs(model->noise_power[image] / noise - 1.0) < 1e-3);
            }
        if (!(k & 2)) /* with circular convolution the model is exact and the noise is what the frames were given */
            assert_true(fabs(model->info.noise / 0.003 - 1.0) < 0.05);
        free(expected);
        reference_free(&r);
    }
}

TEST(scores_agree_with_brute_force)
{
    fixture *f = *state;
    for (int k = 0; k < 4; k++) {
        const int split = k & 1, z = 1, held = 2;
        hada_fit_options options = usual(DEPTHS, split ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX);
        options.boundary = k & 2 ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR;
        SCOPED(hada_fitter) * fitter;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        add_all(f, fitter, DEPTHS, 0, PAIRS);
        reference r = reference_make(f, fitter);
        ASSERT_OK(hada_fit_score_pair(fitter, z, held, &f->frame[z][held], &f->scene[z][held], NULL, err));
        assert_int_equal(fitter->scores.distinct, 10);
        for (int s = 0; s < fitter->scores.setting_count; s++) {
            double own = 0.0, leak = 0.0;
            for (int c = 0; c < CHANNELS; c++) {
                double scale = 0.0, part;
                for (int i = 0; i < PAIRS; i++)
                    for (int p = 0; p < ROWS * COLS; p++)
                        scale += pow(f->frame[z][i].data[c * ROWS * COLS + p], 2);
                reference_others(&r, z, c);
                reference_spectra(f, &r, z, held, c);
                own += hada_ref_fit_leave_one_out(&r.grid, r.x, r.b, reference_sums(&r, z, c), r.other, r.seen,
                                                  r.weights, fitter->scores.settings[s].alpha,
                                                  fitter->scores.settings[s].lambda * scale, split, &part);
                leak += part / ((double)r.grid.rows * r.grid.cols);
            }
            const double pixels = CHANNELS * WINDOW * WINDOW;
            const double single = -10.0 * log10(own / pixels), twofold = -10.0 * log10((own + leak) / pixels);
            const hada_fit_score *got = &fitter->scores.depth[z];
            if (!(fabs(got->single[s] - single) < 1e-3 && fabs(got->twofold[s] - twofold) < 1e-3))
                fail_msg("case %d, setting %d: %g and %g dB, expected %g and %g", k, s, got->single[s], got->twofold[s],
                         single, twofold);
        }
        reference_free(&r);
    }
}

TEST(the_table_marks_the_best_row)
{
    fixture *f = *state;
    hada_fit_options options = usual(DEPTHS, HADA_FORM_COMPLEX);
    SCOPED(hada_dataset) *data = data_of(f, PAIRS);
    SCOPED(hada_fitter) * fitter;
    SCOPED(hada_model) * model;
    const hada_fit_filter_score *row, *other;
    size_t count, chosen = 0;
    options.outside = 1.0;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    ASSERT_OK(hada_fitter_add(fitter, data, err));
    ASSERT_OK(hada_fitter_finish(fitter, data, &model, err));
    const hada_fit_scores *scores = hada_fitter_get_info(fitter)->scores;
    for (count = 0; (row = scores->filters[count]); count++) {
        assert_true(isfinite(row->psnr_single) && row->psnr_single > row->psnr_double);
        if (row->chosen) {
            chosen++;
            assert_true(model->info.alpha == row->alpha && model->info.lambda == row->lambda);
            for (size_t k = 0; (other = scores->filters[k]); k++)
                assert_true(other->psnr_single + other->psnr_double <= row->psnr_single + row->psnr_double);
        }
    }
    assert_int_equal(count, 10);
    assert_null(scores->outsides[0]);
    assert_null(scores->refinements[0]);
    assert_int_equal(chosen, 1);
    /* without pairs to leave out the defaults are taken */
    hada_model_destroy(&model);
    ASSERT_OK(hada_fitter_finish(fitter, NULL, &model, err));
    assert_null(hada_fitter_get_info(fitter)->scores->filters[0]);
    assert_true(model->info.lambda == HADA_FIT_LAMBDA && model->info.alpha == HADA_FIT_ALPHA);
}

/* Depths of a data set are found by their distances; what does not belong to the fit is refused. */
TEST(data_sets_must_fit)
{
    fixture *f = *state;
    const hada_fit_options options = usual(DEPTHS, HADA_FORM_COMPLEX);
    const double other = 150.0;
    const int counts[] = {PAIRS};
    SCOPED(hada_dataset) *all = data_of(f, PAIRS), *one, *foreign;
    SCOPED(hada_fitter) * fitter;
    hada_model *model;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    ASSERT_OK(hada_dataset_from_images(&one, 1, &distances[1], counts, f->frame[1], f->scene[1], err));
    ASSERT_OK(hada_dataset_from_images(&foreign, 1, &other, counts, f->frame[1], f->scene[1], err));
    ASSERT_OK(hada_fitter_add(fitter, one, err));
    const int64_t *pairs = hada_fitter_get_info(fitter)->pairs;
    assert_true(pairs[0] == 0 && pairs[1] == PAIRS && pairs[2] == 0);
    ASSERT_FAILS(hada_fitter_add(fitter, foreign, err), HADA_ERROR_ARGUMENT, "150 mm");
    ASSERT_FAILS(hada_fitter_finish(fitter, one, &model, err), HADA_ERROR_STATE, "");
    ASSERT_FAILS(hada_fitter_finish(fitter, all, &model, err), HADA_ERROR_STATE, "only 0 are in the sums");
}

/* Without noise the filter of a circular camera inverts it: W H = 1 wherever scenes had light. */
TEST(a_camera_without_noise_is_recovered)
{
    fixture *f = *state;
    for (int pairs = 1; pairs <= 3; pairs += 2) {
        hada_fit_options options = usual(1, HADA_FORM_COMPLEX);
        options.lambda = 0.0;
        options.nonnegative = 0;
        options.window_rows = options.window_cols = 0; /* scenes of the frame's size */
        SCOPED(hada_fitter) * fitter;
        SCOPED(hada_model) * model;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        for (int i = 0; i < pairs; i++) {
            SCOPED(hada_image) scene = small_scene(CHANNELS, ROWS, COLS, (uint64_t)(50 + i));
            SCOPED(hada_image) frame = small_frame(&f->psf[0], &scene, 0, 0.0, 0);
            ASSERT_OK(hada_fitter_add_pair(fitter, 0, &frame, &scene, err));
        }
        ASSERT_OK(hada_fitter_finish(fitter, NULL, &model, err));
        double worst = 0.0;
        for (size_t k = 0; k < hada_model_plane(model) * CHANNELS; k++) {
            const float *w = model->filter + 2 * k, *h = model->otf + 2 * k;
            worst = fmax(worst, hypot(w[0] * h[0] - w[1] * h[1] - 1.0, w[0] * h[1] + w[1] * h[0]));
        }
        if (!(worst < 1e-3))
            fail_msg("%d pairs: W H differs from 1 by %g", pairs, worst);
    }
}

/* Noisy pairs of scenes with little fine detail: what is missing comes from the sign of light. */
TEST(point_spread_functions_are_nowhere_negative)
{
    fixture *f = *state;
    double *image = calloc(ROWS * COLS, sizeof *image), *truth = malloc(ROWS * (COLS / 2 + 1) * 2 * sizeof *truth);
    for (int p = 0; p < ROWS * COLS; p++) { /* the axis comes to (0, 0) */
        const int row = (p / COLS + ROWS / 2) % ROWS, col = (p % COLS + COLS / 2) % COLS;
        image[p] = f->psf[0].data[row * COLS + col];
    }
    ASSERT_OK(hada_ref_fft_forward(image, ROWS, COLS, truth, err));
    double error[2];
    for (int nonnegative = 0; nonnegative < 2; nonnegative++) {
        hada_fit_options options = usual(1, HADA_FORM_COMPLEX);
        options.nonnegative = nonnegative;
        SCOPED(hada_fitter) * fitter;
        SCOPED(hada_model) * model;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        for (int i = 0; i < 2; i++) {
            SCOPED(hada_image) scene = small_scene(CHANNELS, WINDOW, WINDOW, (uint64_t)(70 + i));
            for (size_t k = 0; k + 1 < hada_image_count(&scene); k++)
                scene.data[k] = 0.5f * (scene.data[k] + scene.data[k + 1]);
            SCOPED(hada_image) frame = small_frame(&f->psf[0], &scene, 0, 0.02, (uint64_t)i + 1);
            ASSERT_OK(hada_fitter_add_pair(fitter, 0, &frame, &scene, err));
        }
        const uint64_t held = hada_context_bytes(f->context);
        ASSERT_OK(hada_fitter_finish(fitter, NULL, &model, err));
        assert_int_equal(hada_context_bytes(f->context), held);
        error[nonnegative] = relative_error(model->otf, truth, hada_model_plane(model) * 2);
    }
    HADA_FREE(image, truth);
    if (!(error[1] < 0.25 * error[0]))
        fail_msg("error of the transfer function: %g, from the pairs alone %g", error[1], error[0]);
    print_message("error %.3f, from the pairs alone %.3f\n", error[1], error[0]);
}

FIXTURE(fit_setup, fit_teardown)
AGAIN(fit_setup_groups, fit_teardown, filters_agree_with_the_reference, scores_agree_with_brute_force)
AGAIN(fit_setup_rows, fit_teardown, filters_agree_with_the_reference, scores_agree_with_brute_force)
