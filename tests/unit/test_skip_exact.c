/* Kinds of skipping that are exact: the same bits as without them. */
#include "skip_fixture.h"

static void run(const skip_fixture *f, int model, const hada_plan_options *options, const hada_image *frame,
                hada_result *result)
{
    SCOPED(hada_plan) *plan = skip_plan(f, model, options);
    ASSERT_OK(hada_plan_run(plan, frame, result, err));
}

/* Pruning alone rounds otherwise. */
TEST(pruning_changes_rounding_alone)
{
    const skip_fixture *f = *state;
    for (int model = 0; model < SKIP_MODELS; model++)
        for (int which = 0; which < SKIP_FRAMES; which++) {
            const hada_plan_options whole = skip_options(0, 0.0), pruned = skip_options(HADA_SKIP_PRUNE, 0.0);
            SCOPED(hada_result) a = {0}, b = {0};
            run(f, model, &whole, &f->frame[which], &a);
            run(f, model, &pruned, &f->frame[which], &b);
            /* relative to the light in the window, which may be little of what the transform carries */
            assert_true(skip_change(&b, &a) <= 1e-5);
            assert_int_equal(a.report->skipped->kinds, 0);
            assert_int_equal(b.report->skipped->kinds, HADA_SKIP_PRUNE);
        }
}

static void assert_channels(const hada_result *result, int skipped, int by_spectrum)
{
    assert_int_equal(result->report->skipped->channels, skipped);
    assert_int_equal((result->report->skipped->kinds & HADA_SKIP_CHANNELS) != 0, skipped || by_spectrum);
    assert_true(result->report->skipped->bound == 0.0);
}

/* Black and equal channels, with filters that are equal in two channels of one model and differ in the others. */
TEST(channels_give_the_same_bits)
{
    const skip_fixture *f = *state;
    for (int model = 0; model < SKIP_MODELS; model++)
        for (int which = 0; which < SKIP_FRAMES; which++)
            for (int batch = 1; batch <= SKIP_DEPTHS; batch += SKIP_DEPTHS - 1) {
                hada_plan_options dense = skip_options(HADA_SKIP_PRUNE, 0.0),
                                  options = skip_options(HADA_SKIP_PRUNE | HADA_SKIP_CHANNELS, 0.0);
                SCOPED(hada_result) a = {0}, b = {0};
                dense.batch = options.batch = batch;
                run(f, model, &dense, &f->frame[which], &a);
                run(f, model, &options, &f->frame[which], &b);
                assert_true(same_result(&a, &b));
                if (which == SKIP_BLACK)
                    assert_channels(&b, 3, 0);
                else if (which == SKIP_ONE_COLOUR || which == SKIP_SPIKE)
                    assert_channels(&b, 2, 0);
                else if (which == SKIP_GREY || which == SKIP_CONSTANT)
                    assert_channels(&b, model == SKIP_SPLIT, 1);
                else
                    assert_channels(&b, 0, 0);
            }
}

/* Black is what the dark level and the dark frame leave nothing of, to the last bit. */
TEST(black_is_counted_from_the_dark_level)
{
    const skip_fixture *f = *state;
    SCOPED(hada_image) frame, dark;
    ASSERT_OK(hada_image_create(&frame, SKIP_CHANNELS, SKIP_ROWS, SKIP_COLS, err));
    ASSERT_OK(hada_image_create(&dark, SKIP_CHANNELS, SKIP_ROWS, SKIP_COLS, err));
    for (size_t i = 0; i < hada_image_count(&dark); i++) {
        dark.data[i] = 0.01f * (float)(i % 7);
        frame.data[i] = dark.data[i] + (i / skip_pixels() == 1 ? 0.2f : 0.0f);
    }
    for (int kind = 0; kind < 3; kind++) {
        hada_plan_options dense = skip_options(HADA_SKIP_PRUNE, 0.0), options = skip_options(HADA_SKIP_ALL, 0.0);
        SCOPED(hada_result) a = {0}, b = {0};
        dense.dark = options.dark = kind == 0 ? HADA_DARK_FRAME : kind == 1 ? HADA_DARK_LEVEL : HADA_DARK_AUTO;
        dense.dark_frame = options.dark_frame = kind == 0 ? &dark : NULL;
        dense.dark_level = options.dark_level = kind == 1 ? 0.05 : 0.0;
        run(f, SKIP_WIENER, &dense, kind ? &f->frame[SKIP_CONSTANT] : &frame, &a);
        run(f, SKIP_WIENER, &options, kind ? &f->frame[SKIP_CONSTANT] : &frame, &b);
        assert_true(same_result(&a, &b));
        assert_int_equal(b.report->skipped->channels, kind == 0 ? 2 : kind == 1 ? 0 : 3);
    }
    frame.data[5] += 1e-6f; /* one pixel more than black */
    hada_plan_options options = skip_options(HADA_SKIP_ALL, 0.0);
    SCOPED(hada_result) b = {0};
    options.dark = HADA_DARK_FRAME;
    options.dark_frame = &dark;
    run(f, SKIP_WIENER, &options, &frame, &b);
    assert_int_equal(b.report->skipped->channels, 1);
}

TEST(depths_that_are_known_to_be_empty_are_not_computed)
{
    const skip_fixture *f = *state;
    const int list[] = {1, 3};
    hada_plan_options options = skip_options(HADA_SKIP_ALL, 0.0);
    SCOPED(hada_result) a = {0};
    options.occupied = HADA_OCCUPIED_LIST;
    options.occupied_list = list;
    options.occupied_count = 2;
    run(f, SKIP_WIENER, &options, &f->frame[SKIP_BETWEEN], &a);
    assert_int_equal(a.report->skipped->depths, 2);
    assert_true(a.report->skipped->kinds & HADA_SKIP_DEPTHS);
}

/* The search on small grids finds what the reference search finds. */
TEST(both_looks_find_the_same_depths)
{
    const skip_fixture *f = *state;
    for (int which = SKIP_TINY; which <= SKIP_ONE_COLOUR; which++) {
        hada_plan_options full = skip_options(HADA_SKIP_ALL & ~(unsigned)HADA_SKIP_DEPTHS, 0.0),
                          options = skip_options(HADA_SKIP_ALL, 0.0);
        SCOPED(hada_result) a = {0}, b = {0};
        full.refine = options.refine = 4;
        run(f, SKIP_WIENER, &full, &f->frame[which], &a);
        run(f, SKIP_WIENER, &options, &f->frame[which], &b);
        assert_int_equal(a.report->skipped->kinds & HADA_SKIP_DEPTHS, 0);
        for (int z = 0; z < SKIP_DEPTHS; z++)
            assert_int_equal(a.report->occupied[z], b.report->occupied[z]);
        assert_int_equal(b.report->skipped->depths, SKIP_DEPTHS - b.report->occupied_count);
        assert_true(same_result(&a, &b));
    }
}

/* Refined planes: bounded kinds do not act, exact ones do. */
TEST(refinement_takes_exact_kinds_alone)
{
    const skip_fixture *f = *state;
    for (int which = 0; which < SKIP_FRAMES; which++) {
        hada_plan_options dense = skip_options(HADA_SKIP_ALL & ~(unsigned)(HADA_SKIP_CHANNELS | HADA_SKIP_FRAMES), 0.0),
                          options = skip_options(HADA_SKIP_ALL, 0.1);
        SCOPED(hada_result) a = {0}, b = {0};
        dense.refine = options.refine = 4;
        if (which == SKIP_LIMITED) /* no depth explains it */
            continue;
        run(f, SKIP_WIENER, &dense, &f->frame[which], &a);
        run(f, SKIP_WIENER, &options, &f->frame[which], &b);
        assert_true(same_result(&a, &b));
        assert_true(b.report->skipped->bound == 0.0);
        assert_int_equal(b.report->skipped->kinds & (HADA_SKIP_FREQUENCIES | HADA_SKIP_HALF), 0);
    }
}

FIXTURE(skip_setup, skip_teardown)
