/* Filters judged in the window: against the double reference, the choice of the weight, and what is refused. */
#include "fit/window.h"
#include "fit_fixture.h"
#include "ref/ref_filter.h"
#include "ref/ref_fit.h"
#include "ref/ref_fit_window.h"

/* Double-precision sums of a channel of the first depth, and of the others; spectra of the first depth's frames. */
typedef struct reference {
    hada_ref_grid grid;
    size_t plane;
    double *b[PAIRS], *x, *sums, *other, scale;
} reference;

static reference reference_make(const fixture *f, const hada_fitter *fitter, int depths, int c)
{
    const hada_model_info *info = &fitter->grid.info;
    const hada_geometry *at = &fitter->grid.geometry;
    reference r = {.grid = {info->grid_rows, info->grid_cols, at->raw_row, at->raw_col, ROWS, COLS, at->window_row,
                            at->window_col, WINDOW, WINDOW}};
    r.plane = hada_model_info_plane(info);
    r.x = calloc(r.plane * 2, sizeof(double));
    r.sums = calloc(r.plane * HADA_REF_FIT_SUMS, sizeof(double));
    r.other = calloc(r.plane * 2, sizeof(double));
    SCOPED_MEMORY double *rest = calloc(r.plane * HADA_REF_FIT_SUMS, sizeof(double)),
                         *b = calloc(r.plane * 2, sizeof(double));
    for (int i = 0; i < PAIRS; i++)
        r.b[i] = calloc(r.plane * 2, sizeof(double));
    for (int z = 0; z < depths; z++)
        for (int i = 0; i < PAIRS; i++) {
            double *to = z ? b : r.b[i];
            ASSERT_OK(hada_ref_grid_forward(&r.grid, f->frame[z][i].data + c * ROWS * COLS, at->raw_row, at->raw_col,
                                            ROWS, COLS, to, err));
            ASSERT_OK(hada_ref_grid_forward(&r.grid, f->scene[z][i].data + c * WINDOW * WINDOW, at->window_row,
                                            at->window_col, WINDOW, WINDOW, r.x, err));
            hada_ref_fit_pair(r.x, to, r.plane, 1.0, z ? rest : r.sums);
            for (int k = 0; !z && k < ROWS * COLS; k++)
                r.scale += pow(f->frame[z][i].data[c * ROWS * COLS + k], 2);
        }
    memcpy(r.other, rest + 2 * r.plane, r.plane * sizeof *rest);
    memcpy(r.other + r.plane, rest + 5 * r.plane, r.plane * sizeof *rest);
    return r;
}

static void reference_free(reference *r)
{
    for (int i = 0; i < PAIRS; i++)
        free(r->b[i]);
    HADA_FREE(r->x, r->sums, r->other);
}

/* Far beyond the number of rounds that a fit takes, every weight at once must come to the unique minimum. */
TEST(iterations_lead_to_the_minimum)
{
    enum { WEIGHTS = 3, ITERATIONS = 60 };
    static const double outside[WEIGHTS] = {0.05, 0.2, 0.7};
    static const hada_fit_setting setting = {.alpha = 0.1, .lambda = 1e-2};
    fixture *f = *state;
    for (int k = 0; k < 4; k++) {
        hada_fit_options options = usual(DEPTHS, k & 1 ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX);
        options.boundary = k & 2 ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR;
        SCOPED(hada_fitter) * fitter;
        SCOPED(hada_fit_window) * window;
        int converged = 0;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        add_all(f, fitter, DEPTHS, 0, PAIRS);
        ASSERT_OK(hada_fit_sums_pool(&fitter->sums, err));
        ASSERT_OK(hada_fit_sums_select(&fitter->sums, 0, err));
        ASSERT_OK(hada_fit_window_create(&window, &fitter->sums, &fitter->pair, WEIGHTS, err));
        ASSERT_OK(hada_fit_window_begin(window, 0, setting, outside, WEIGHTS, err));
        for (int round = 0; round < ITERATIONS; round++) {
            for (int i = 0; i < PAIRS; i++) {
                hada_fit_pair_take(&fitter->pair, &f->frame[0][i], &f->scene[0][i], NULL);
                ASSERT_OK(hada_fit_pair_transform(&fitter->pair, fitter->pair.raw_pixels, NULL, err));
                ASSERT_OK(hada_fit_window_pair(window, err));
            }
            ASSERT_OK(hada_fit_window_iterate(window, &converged, err));
        }
        assert_true(converged);
        const size_t plane = hada_model_info_plane(&fitter->grid.info);
        SCOPED_MEMORY float *blocks = malloc(2 * fitter->grid.stride * sizeof *blocks),
                            *got = malloc(2 * plane * sizeof *got);
        SCOPED_MEMORY double *expected = malloc(2 * plane * sizeof *expected);
        for (int c = 0; c < CHANNELS; c++) {
            reference r = reference_make(f, fitter, DEPTHS, c);
            for (int s = 0; s < WEIGHTS; s++) {
                const hada_ref_fit_window fit = {.grid = &r.grid,
                                                 .b = (const double *const *)r.b,
                                                 .pairs = PAIRS,
                                                 .split = k & 1,
                                                 .sums = r.sums,
                                                 .other = r.other,
                                                 .alpha = setting.alpha,
                                                 .ridge = setting.lambda * r.scale,
                                                 .outside = outside[s]};
                ASSERT_OK(hada_ref_fit_window_solve(&fit, expected, err));
                ASSERT_OK(hada_fit_read_plane(&fitter->grid, hada_fit_window_filters(window, s),
                                              (size_t)c * fitter->grid.layout.count, blocks, got, "a filter", err));
                const double error = relative_error(got, expected, 2 * plane);
                if (!(error < 2e-5))
                    fail_msg("case %d, channel %d, weight %g: relative error %g", k, c, outside[s], error);
            }
            reference_free(&r);
        }
    }
}

typedef struct shower {
    fixture *f;
    int shown, refuse_at, swap; /* swap: another pair in the first one's place */
} shower;

static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    shower *at = user;
    if (++at->shown == at->refuse_at)
        return hada_fail(error, HADA_ERROR_FILE_OPEN, "the pair is gone");
    assert_in_range(depth, 0, DEPTHS - 1);
    assert_in_range(pair, 0, PAIRS - 1);
    const int number = at->swap && pair == 0 ? 1 : pair;
    ASSERT_OK(hada_image_crop(raw, &at->f->frame[depth][number], 0, 0, ROWS, COLS, err));
    ASSERT_OK(hada_image_crop(scene, &at->f->scene[depth][number], 0, 0, WINDOW, WINDOW, err));
    return HADA_OK;
}

/* A data set that keeps nothing, so that every look at a pair reads it. */
static hada_dataset *shown_by(shower *at)
{
    static const int counts[DEPTHS] = {PAIRS, PAIRS, PAIRS};
    hada_dataset *data;
    DEFAULTS(hada_dataset_options, options);
    options.cache_bytes = 0;
    ASSERT_OK(hada_dataset_create(&data, DEPTHS, distances, counts, read_pair, at, &options, err));
    return data;
}

static hada_fitter *fitter_of(fixture *f, double outside, hada_form form)
{
    hada_fit_options options = usual(DEPTHS, form);
    options.outside = outside;
    options.alpha = 0.0;
    options.lambda = 1e-3;
    hada_fitter *fitter;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    add_all(f, fitter, DEPTHS, 0, PAIRS);
    return fitter;
}

/* What the fit minimises, of depth 0 and channel 0, but for the ridge. */
static double objective(const fixture *f, const hada_fitter *fitter, const hada_model *model, double outside)
{
    reference r = reference_make(f, fitter, 1, 0);
    double *y = malloc(ROWS * COLS * sizeof *y), sum = 0.0;
    hada_ref_grid whole = r.grid;
    whole.window_row = whole.window_col = 0;
    whole.window_rows = r.grid.rows;
    whole.window_cols = r.grid.cols;
    for (int i = 0; i < PAIRS; i++) {
        ASSERT_OK(hada_ref_hadamard(&whole, r.b[i], model->filter, model->info.form == HADA_FORM_SPLIT, y, err));
        for (int row = 0; row < ROWS; row++)
            for (int col = 0; col < COLS; col++) {
                const int at_row = row - r.grid.window_row, at_col = col - r.grid.window_col;
                const int inside = at_row >= 0 && at_row < WINDOW && at_col >= 0 && at_col < WINDOW;
                const double want = inside ? f->scene[0][i].data[at_row * WINDOW + at_col] : 0.0;
                sum += (inside ? 1.0 : outside) * pow(y[row * COLS + col] - want, 2);
            }
    }
    free(y);
    reference_free(&r);
    return sum;
}

TEST(a_lower_weight_lowers_the_error_in_the_window)
{
    fixture *f = *state;
    for (int split = 0; split < 2; split++) {
        static const double weights[] = {1.0, 0.5, 0.1, 0.02};
        double inside[4];
        for (int s = 0; s < 4; s++) {
            SCOPED(hada_fitter) *fitter = fitter_of(f, weights[s], split ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX);
            SCOPED(hada_model) * model;
            shower at = {.f = f};
            hada_dataset *data = shown_by(&at);
            ASSERT_OK(hada_fit_learn_windowed(fitter, data, err));
            hada_dataset_destroy(&data);
            assert_true(s ? at.shown >= DEPTHS * PAIRS : at.shown == 0);
            assert_true(at.shown <= DEPTHS * PAIRS * HADA_FIT_ITERATIONS);
            ASSERT_OK(hada_fit_solve(fitter, &model, err));
            inside[s] = objective(f, fitter, model, 0.0);
        }
        for (int s = 1; s < 4; s++)
            if (!(inside[s] < inside[s - 1]))
                fail_msg("split %d: weight %g leaves %g in the window, weight %g only %g", split, weights[s], inside[s],
                         weights[s - 1], inside[s - 1]);
    }
}

TEST(the_weight_is_chosen_on_held_out_pairs)
{
    fixture *f = *state;
    SCOPED(hada_fitter) *fitter = fitter_of(f, -1.0, HADA_FORM_COMPLEX);
    SCOPED(hada_dataset) *data = data_of(f, PAIRS);
    SCOPED(hada_model) * plain, *first, *second;
    const hada_fit_outside_score *row, *taken = NULL, *last = NULL;
    double best = -INFINITY;
    size_t count;
    ASSERT_OK(hada_fitter_finish(fitter, NULL, &plain, err));
    ASSERT_OK(hada_fitter_finish(fitter, data, &first, err));
    for (count = 0; (row = hada_fitter_get_info(fitter)->scores->outsides[count]); count++) {
        assert_true(isfinite(row->psnr) && row->outside > 0.0);
        best = fmax(best, row->psnr);
        last = row;
        if (row->chosen)
            taken = row;
    }
    assert_int_equal(count, HADA_FIT_OUTSIDES);
    assert_true(last->outside == 1.0 && first->info.lambda == 1e-3);
    assert_true(taken && taken->psnr > best - 0.03);
    const double outside = taken->outside;
    /* transfer functions are not touched; the same pairs give the same bits */
    const size_t values = hada_model_plane(plain) * DEPTHS * CHANNELS * 2;
    assert_memory_equal(plain->otf, first->otf, values * sizeof(float));
    assert_int_equal(memcmp(plain->filter, first->filter, values * sizeof(float)) == 0, taken == last);
    ASSERT_OK(hada_fitter_finish(fitter, data, &second, err));
    assert_memory_equal(second->filter, first->filter, values * sizeof(float));
    hada_model_destroy(&second);
    /* a fixed weight of that size gives these filters too */
    hada_fitter *fixed = fitter_of(f, outside, HADA_FORM_COMPLEX);
    ASSERT_OK(hada_fitter_finish(fixed, data, &second, err));
    assert_memory_equal(second->filter, first->filter, values * sizeof(float));
    hada_fitter_destroy(&fixed);
    hada_model_destroy(&second);
    /* without the pairs the exact fit stays */
    ASSERT_OK(hada_fitter_finish(fitter, NULL, &second, err));
    assert_null(fitter->outside.filters);
    assert_memory_equal(second->filter, plain->filter, values * sizeof(float));
}

TEST(what_cannot_be_judged_is_refused)
{
    fixture *f = *state;
    hada_error error = {0};
    SCOPED(hada_model) * plain, *after;
    hada_fit_options options = usual(DEPTHS, HADA_FORM_COMPLEX);
    SCOPED(hada_fitter) *fitter = NULL;
    static const double wrong[] = {0.0, 0.005, 1.5, NAN};
    for (size_t i = 0; i < HADA_COUNT(wrong); i++) {
        options.outside = wrong[i];
        ASSERT_FAILS(hada_fitter_create(&fitter, f->context, &options, err), HADA_ERROR_ARGUMENT, "");
        assert_null(fitter);
    }
    fitter = fitter_of(f, -1.0, HADA_FORM_COMPLEX);
    ASSERT_OK(hada_fitter_finish(fitter, NULL, &plain, err));
    shower swapped = {.f = f, .swap = 1};
    hada_dataset *data = shown_by(&swapped);
    ASSERT_FAILS(hada_fit_learn_windowed(fitter, data, err), HADA_ERROR_STATE, "not those in its sums");
    hada_dataset_destroy(&data);
    /* whenever reading fails, the fit is as it was; pairs that were read ahead are not always taken */
    shower all = {.f = f};
    data = shown_by(&all);
    ASSERT_OK(hada_fit_learn_windowed(fitter, data, err));
    hada_dataset_destroy(&data);
    for (int at = 1; at <= all.shown; at += at < 12 ? 1 : 7) {
        shower refusing = {.f = f, .refuse_at = at};
        data = shown_by(&refusing);
        const hada_status status = hada_fit_learn_windowed(fitter, data, &error);
        hada_dataset_destroy(&data);
        assert_true(status == HADA_ERROR_FILE_OPEN || (!status && at > 1));
    }
    hada_fit_forget(fitter);
    ASSERT_OK(hada_fit_solve(fitter, &after, err));
    const size_t values = hada_model_plane(plain) * DEPTHS * CHANNELS * 2;
    assert_memory_equal(plain->filter, after->filter, values * sizeof(float));
    assert_memory_equal(plain->otf, after->otf, values * sizeof(float));
}

/* One pair a depth: nothing can be left out, so the exact fit stays and no pair is read. */
TEST(single_pairs_are_left_alone)
{
    fixture *f = *state;
    hada_fit_options options = usual(DEPTHS, HADA_FORM_COMPLEX);
    SCOPED(hada_fitter) * fitter;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    add_all(f, fitter, DEPTHS, 0, 1);
    shower at = {.f = f};
    hada_dataset *data = shown_by(&at);
    ASSERT_OK(hada_fit_learn_windowed(fitter, data, err));
    hada_dataset_destroy(&data);
    assert_int_equal(at.shown, 0);
    assert_null(fitter->outside.filters);
}

FIXTURE(fit_setup, fit_teardown)
AGAIN(fit_setup_groups, fit_teardown, iterations_lead_to_the_minimum, the_weight_is_chosen_on_held_out_pairs)
AGAIN(fit_setup_rows, fit_teardown, iterations_lead_to_the_minimum, the_weight_is_chosen_on_held_out_pairs)
