/* Frames that equal the one before, or nearly so. */
#include "skip_fixture.h"

static hada_image copy_of(const hada_image *image)
{
    hada_image copy;
    ASSERT_OK(hada_image_create(&copy, image->channels, image->rows, image->cols, err));
    memcpy(copy.data, image->data, hada_image_count(image) * sizeof *image->data);
    return copy;
}

/* The pixels decide; the caller may have changed or freed the frame and the result in the meantime. */
TEST(an_equal_frame_takes_the_result_of_the_one_before)
{
    const skip_fixture *f = *state;
    for (int refine = 0; refine <= 3; refine += 3) {
        hada_plan_options options = skip_options(HADA_SKIP_ALL, 0.0);
        options.refine = refine;
        options.gamma = 0.5;
        SCOPED(hada_plan) *plan = skip_plan(f, SKIP_WIENER, &options);
        SCOPED(hada_image) frame = copy_of(&f->frame[SKIP_EDGE]);
        SCOPED(hada_result) first = {0}, again = {0}, third = {0};
        ASSERT_OK(hada_plan_run(plan, &frame, &first, err));
        assert_int_equal(first.report->skipped->frame, 0);
        SCOPED(hada_result) kept = {0};
        ASSERT_OK(hada_plan_run(plan, &frame, &kept, err));
        assert_int_equal(kept.report->skipped->frame, 1);
        assert_true(kept.report->skipped->kinds & HADA_SKIP_FRAMES);
        assert_true(kept.report->skipped->bound == 0.0);
        assert_true(same_result(&first, &kept));
        memset(first.planes[0].data, 0xff, hada_image_count(&first.planes[0]) * sizeof(float));
        hada_image_destroy(&frame);
        frame = copy_of(&f->frame[SKIP_EDGE]);
        ASSERT_OK(hada_plan_run(plan, &frame, &again, err));
        assert_int_equal(again.report->skipped->frame, 1);
        assert_int_equal(again.report->refine_steps, kept.report->refine_steps);
        assert_int_equal(again.report->occupied_count, kept.report->occupied_count);
        assert_true(same_result(&again, &kept));
        frame.data[hada_image_count(&frame) - 1] += 1e-7f; /* the last pixel alone */
        ASSERT_OK(hada_plan_run(plan, &frame, &third, err));
        assert_int_equal(third.report->skipped->frame, 0);
        ASSERT_OK(hada_plan_run(plan, &f->frame[SKIP_EDGE], &third, err)); /* not the one before any more */
        assert_int_equal(third.report->skipped->frame, 0);
    }
}

TEST(the_switch_is_obeyed)
{
    const skip_fixture *f = *state;
    const hada_plan_options options = skip_options(HADA_SKIP_ALL & ~(unsigned)HADA_SKIP_FRAMES, 0.1);
    SCOPED(hada_plan) *plan = skip_plan(f, SKIP_WIENER, &options);
    for (int i = 0; i < 2; i++) {
        SCOPED(hada_result) result = {0};
        ASSERT_OK(hada_plan_run(plan, &f->frame[SKIP_EDGE], &result, err));
        assert_int_equal(result.report->skipped->frame, 0);
    }
}

/* The result of a failed frame is not reused. */
TEST(a_failed_frame_is_not_reused)
{
    const skip_fixture *f = *state;
    const hada_plan_options options = skip_options(HADA_SKIP_ALL, 0.0);
    SCOPED(hada_plan) *plan = skip_plan(f, SKIP_WIENER, &options);
    SCOPED(hada_image) broken = copy_of(&f->frame[SKIP_EDGE]);
    broken.data[7] = NAN;
    for (int i = 0; i < 3; i++) {
        hada_result result = {0};
        hada_error err = {0};
        assert_int_equal(hada_plan_run(plan, &broken, &result, &err), HADA_ERROR_NOT_FINITE);
        assert_null(result.planes);
    }
}

/* The same results, in the same way, however many queues a plan has and however many frames are in flight. */
TEST(queues_and_batches_find_the_same)
{
    enum { LONG = 12 };
    const skip_fixture *f = *state;
    const int order[LONG] = {0, 1, 1, 2, 2, 2, 8, 8, 8, 3, 9, 9};
    hada_image frames[LONG];
    hada_result expected[LONG] = {{0}};
    for (int i = 0; i < LONG; i++) {
        frames[i] = copy_of(&f->frame[order[i]]);
        if (i == 5 || i == 8) /* nearly the one before */
            frames[i].data[100] *= 1.0f + 1e-5f;
    }
    for (int variant = 0; variant < 4; variant++) {
        hada_plan_options options = skip_options(HADA_SKIP_ALL, 1e-2);
        hada_job *jobs[LONG];
        hada_result results[LONG] = {{0}};
        options.queues = variant ? variant : 1;
        options.batch = variant == 2 ? 1 : 0;
        SCOPED(hada_plan) *plan = skip_plan(f, SKIP_SMOOTH, &options);
        for (int i = 0; i < LONG; i++)
            if (variant)
                ASSERT_OK(hada_job_submit(&jobs[i], plan, &frames[i], &results[i], err));
            else
                ASSERT_OK(hada_plan_run(plan, &frames[i], &expected[i], err));
        for (int i = 0; variant && i < LONG; i++) {
            ASSERT_OK(hada_job_wait(jobs[i], err));
            hada_job_destroy(&jobs[i]);
            assert_true(same_result(&results[i], &expected[i]));
            assert_true(results[i].report->skipped->bound == expected[i].report->skipped->bound);
            assert_int_equal(results[i].report->skipped->frame, expected[i].report->skipped->frame);
            hada_result_destroy(&results[i]);
        }
    }
    assert_int_equal(expected[2].report->skipped->frame, 1);
    assert_int_equal(expected[4].report->skipped->frame, 1);
    for (int i = 0; i < LONG; i++) {
        hada_image_destroy(&frames[i]);
        hada_result_destroy(&expected[i]);
    }
}

FIXTURE(skip_setup, skip_teardown)
