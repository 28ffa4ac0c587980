/* Skipping under a stated error: what is measured is at most the bound, and the bound at most what was allowed. */
#include "skip_fixture.h"

static const double errors[] = {1e-1, 3e-2, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6};
enum { ERRORS = sizeof errors / sizeof *errors };
static const unsigned bounded = HADA_SKIP_FREQUENCIES | HADA_SKIP_HALF;

typedef struct tally {
    int limited, halved, again;
} tally;

static void hold(const skip_fixture *f, int model, unsigned skip, double most, int which, hada_plan *plan,
                 const hada_result *dense, tally *seen)
{
    SCOPED(hada_result) result = {0};
    (void)f;
    ASSERT_OK(hada_plan_run(plan, &f->frame[which], &result, err));
    const hada_skip_report *report = result.report->skipped;
    const double change = skip_change(&result, dense);
    if (!(change <= report->bound) || !(report->bound <= most))
        fail_msg("model %d, frame %d, skip %u: change %g, bound %g, allowed %g", model, which, skip, change,
                 report->bound, most);
    assert_int_equal(report->kinds & ~skip, 0);
    if (!(report->kinds & bounded)) {
        assert_true(same_result(&result, dense));
        assert_true(report->bound == 0.0);
    }
    assert_int_equal(report->frequencies > 0.0, (report->kinds & HADA_SKIP_FREQUENCIES) != 0);
    seen->limited += (report->kinds & HADA_SKIP_FREQUENCIES) != 0;
    seen->halved += (report->kinds & HADA_SKIP_HALF) != 0;
    seen->again += report->recomputed;
}

static void all_frames(const skip_fixture *f, int model, unsigned skip, tally *seen)
{
    const hada_plan_options plain = skip_options(HADA_SKIP_PRUNE, 0.0);
    hada_plan *exact = skip_plan(f, model, &plain);
    hada_result dense[SKIP_FRAMES] = {0};
    for (int which = 0; which < SKIP_FRAMES; which++)
        ASSERT_OK(hada_plan_run(exact, &f->frame[which], &dense[which], err));
    hada_plan_destroy(&exact);
    for (int e = 0; e < ERRORS; e++) {
        const hada_plan_options options = skip_options(skip, errors[e]);
        SCOPED(hada_plan) *plan = skip_plan(f, model, &options);
        for (int which = 0; which < SKIP_FRAMES; which++)
            hold(f, model, skip, errors[e], which, plan, &dense[which], &seen[e]);
    }
    for (int which = 0; which < SKIP_FRAMES; which++)
        hada_result_destroy(&dense[which]);
}

TEST(frequencies_stay_within_the_error)
{
    tally seen[ERRORS] = {{0}}, smooth[ERRORS] = {{0}};
    for (int model = 0; model < SKIP_MODELS; model++)
        all_frames(*state, model, HADA_SKIP_PRUNE | HADA_SKIP_FREQUENCIES, model == SKIP_SMOOTH ? smooth : seen);
    /* filters that let little pass at high frequencies save much, and still at small errors */
    assert_true(smooth[0].limited >= SKIP_FRAMES - 3);
    assert_true(smooth[4].limited >= SKIP_FRAMES / 2);
    assert_true(seen[0].limited > SKIP_FRAMES / 2);
    /* and only of the black frame where rounding alone is as large as what is allowed */
    assert_int_equal(seen[ERRORS - 1].limited, SKIP_MODELS - 1);
}

TEST(half_filters_stay_within_the_error)
{
    tally seen[ERRORS] = {{0}};
    for (int model = 0; model < SKIP_MODELS; model++)
        all_frames(*state, model, HADA_SKIP_PRUNE | HADA_SKIP_HALF, seen);
    assert_true(seen[0].halved >= SKIP_MODELS * (SKIP_FRAMES - 3));
    assert_int_equal(seen[3].halved, 0); /* 1e-3 is too little */
}

TEST(all_kinds_together_stay_within_the_error)
{
    tally seen[ERRORS] = {{0}};
    for (int model = 0; model < SKIP_MODELS; model++)
        all_frames(*state, model, HADA_SKIP_ALL, seen);
    assert_true(seen[0].limited > 0 && seen[0].halved > 0);
}

/* A frame whose light the window does not see: the bound cannot be shown, and the dense result comes, from filters in
 * single precision. */
TEST(a_bound_that_is_not_kept_leads_to_the_dense_result)
{
    const skip_fixture *f = *state;
    int again = 0;
    for (int model = 0; model < SKIP_MODELS; model++) {
        const hada_plan_options plain = skip_options(HADA_SKIP_PRUNE, 0.0),
                                options = skip_options(HADA_SKIP_PRUNE | HADA_SKIP_HALF, 0x1p-8);
        hada_plan *exact = skip_plan(f, model, &plain), *plan = skip_plan(f, model, &options);
        for (int which = 0; which < SKIP_FRAMES; which++) {
            SCOPED(hada_result) dense = {0}, result = {0};
            SCOPED(hada_image) hidden;
            ASSERT_OK(hada_image_create(&hidden, SKIP_CHANNELS, SKIP_ROWS, SKIP_COLS, err));
            for (size_t i = 0; i < hada_image_count(&hidden); i++) /* the negative of a frame, on a little light */
                hidden.data[i] = 1e-4f - f->frame[which].data[i];
            const hada_status status = hada_plan_run(exact, &hidden, &dense, NULL);
            assert_int_equal(hada_plan_run(plan, &hidden, &result, NULL), status);
            if (status == HADA_ERROR_NUMERIC) /* all is black */
                continue;
            assert_int_equal(status, HADA_OK);
            if (result.report->skipped->recomputed) {
                assert_true(same_result(&result, &dense));
                assert_true(result.report->skipped->bound == 0.0);
                assert_int_equal(result.report->skipped->kinds & bounded, 0);
            }
            again += result.report->skipped->recomputed;
        }
        hada_plan_destroy(&exact);
        hada_plan_destroy(&plan);
    }
    assert_true(again > 0);
}

TEST(a_band_keeps_its_bound_and_its_size)
{
    static const double bands[] = {1e-9, 0.1, 0.5, 0.668, 0.99};
    const skip_fixture *f = *state;
    for (int model = 0; model < SKIP_MODELS; model++) {
        const hada_plan_options plain = skip_options(HADA_SKIP_PRUNE, 0.0);
        SCOPED(hada_plan) *exact = skip_plan(f, model, &plain);
        for (size_t b = 0; b < 5; b++) {
            hada_plan_options options = skip_options(HADA_SKIP_PRUNE, 0.0);
            options.band = bands[b];
            SCOPED(hada_plan) *plan = skip_plan(f, model, &options);
            for (int which = 0; which < SKIP_FRAMES; which++) {
                SCOPED(hada_result) dense = {0}, result = {0};
                ASSERT_OK(hada_plan_run(exact, &f->frame[which], &dense, err));
                ASSERT_OK(hada_plan_run(plan, &f->frame[which], &result, err));
                const hada_skip_report *report = result.report->skipped;
                /* rounding is not part of what a band changes */
                assert_true(skip_change(&result, &dense) <= report->bound + 1e-5);
                assert_true(report->frequencies > 0.9 - bands[b] && report->frequencies < 1.0);
            }
        }
    }
}

/* The error is counted from the run that leaves out the same band. */
TEST(a_band_and_an_error_go_together)
{
    const skip_fixture *f = *state;
    int limited = 0;
    for (int model = 0; model < SKIP_MODELS; model++) {
        hada_plan_options plain = skip_options(HADA_SKIP_PRUNE, 0.0), options = skip_options(HADA_SKIP_ALL, 1e-2);
        plain.band = options.band = 0.7;
        SCOPED(hada_plan) *exact = skip_plan(f, model, &plain), *plan = skip_plan(f, model, &options);
        for (int which = 0; which < SKIP_FRAMES; which++) {
            SCOPED(hada_result) dense = {0}, result = {0};
            ASSERT_OK(hada_plan_run(exact, &f->frame[which], &dense, err));
            ASSERT_OK(hada_plan_run(plan, &f->frame[which], &result, err));
            assert_true(skip_change(&result, &dense) <= 1e-2);
            limited += result.report->skipped->frequencies > dense.report->skipped->frequencies;
        }
    }
    assert_true(limited > 0);
}

TEST(wrong_options_are_refused)
{
    const skip_fixture *f = *state;
    hada_plan_options bad[6];
    for (int i = 0; i < 6; i++)
        bad[i] = skip_options(HADA_SKIP_ALL, 0.0);
    bad[0].max_error = -1e-9;
    bad[1].max_error = 1.0;
    bad[2].max_error = NAN;
    bad[3].band = 0.0;
    bad[4].band = 1.5;
    bad[5].skip = 128;
    for (int i = 0; i < 6; i++) {
        hada_plan *plan;
        ASSERT_FAILS(hada_plan_create(&plan, f->context, f->model[0], &bad[i], err), HADA_ERROR_ARGUMENT, "max_error");
        assert_null(plan);
    }
    hada_plan_options refined = skip_options(HADA_SKIP_ALL, 0.0);
    refined.refine = 4;
    refined.band = 0.5;
    hada_plan *plan;
    ASSERT_FAILS(hada_plan_create(&plan, f->context, f->model[0], &refined, err), HADA_ERROR_ARGUMENT,
                 "options.refine 0");
}

FIXTURE(skip_setup, skip_teardown)
