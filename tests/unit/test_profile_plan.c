/* Profiling of plans: the stages of a frame, each launch with its cost, and the same pictures. */
#include "learned_camera.h"

typedef struct sums {
    double seconds, kernels, bytes, flops;
    uint64_t launches, transfers;
} sums;

static sums of_stage(const hada_kernel_time *rows, size_t count, const char *stage)
{
    sums s = {0};
    for (size_t i = 0; i < count; i++) {
        if (strcmp(rows[i].stage, stage))
            continue;
        assert_true(rows[i].launches > 0);
        assert_true(rows[i].seconds > 0);
        /* whoever launches has said what it costs */
        if (!(rows[i].bytes > 0))
            fail_msg("%s %s has no bytes", stage, rows[i].name);
        s.seconds += rows[i].seconds;
        s.bytes += rows[i].bytes;
        s.flops += rows[i].flops;
        *(rows[i].transfer ? &s.transfers : &s.launches) += rows[i].launches;
    }
    return s;
}

/* Frames that are the same ask for the same. */
static void same_calls(hada_plan *plan, const hada_image *raw, hada_result *result)
{
    hada_call_counts counts[3];
    for (int i = 0; i < 3; i++) {
        ASSERT_OK(hada_plan_calls(plan, &counts[i], err));
        ASSERT_OK(hada_plan_run(plan, raw, result, err));
    }
    const uint64_t launches = counts[2].launches - counts[1].launches;
    assert_true(launches >= 5);
    assert_int_equal(launches, counts[1].launches - counts[0].launches);
    assert_int_equal(counts[2].waits - counts[1].waits, counts[1].waits - counts[0].waits);
    assert_int_equal(counts[2].transfers - counts[1].transfers, counts[1].transfers - counts[0].transfers);
    /* the frame goes up, the planes and pictures come down */
    const double up = (double)hada_image_count(raw) * sizeof(float);
    const double down = (double)(hada_image_count(&result->planes[0]) + hada_image_count(&result->all_in_focus) +
                                 hada_image_count(&result->distance_map)) *
                        sizeof(float);
    assert_true(counts[2].bytes_up - counts[1].bytes_up >= up);
    assert_true(counts[2].bytes_down - counts[1].bytes_down >= down);
}

static void run(const learned_camera *learned, int refine, const char *const *stages, int frames)
{
    const int depths[2] = {0, 3};
    SCOPED(hada_image) scene = learned_scene(learned, 900);
    hada_image parts[2];
    hada_plane planes[2];
    learned_split(learned, &scene, depths, 2, 1, parts, planes);
    SCOPED(hada_image) raw = learned_frame(learned, planes, 2, 5);
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) plain = {0}, profiled = {0};
    hada_kernel_time *rows = NULL;
    size_t count = 0;
    DEFAULTS(hada_plan_options, options);
    options.refine = refine;
    options.skip &= ~(unsigned)HADA_SKIP_FRAMES; /* the same frame is computed each time */
    ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, &options, err));
    ASSERT_OK(hada_plan_run(plan, &raw, &plain, err));
    ASSERT_FAILS(hada_plan_kernel_times(plan, &rows, &count, err), HADA_ERROR_STATE, "");
    ASSERT_OK(hada_plan_profile(plan, 1, err));
    ASSERT_OK(hada_plan_kernel_times(plan, &rows, &count, err));
    assert_int_equal(count, 0);
    hada_memory_destroy(&rows);
    double wall = 0;
    sums first[8] = {0};
    for (int frame = 1; frame <= frames; frame++) {
        double seconds = 0;
        ASSERT_OK(hada_plan_run(plan, &raw, &profiled, err));
        wall += profiled.report->seconds_total;
        ASSERT_OK(hada_plan_kernel_times(plan, &rows, &count, err));
        for (int i = 0; stages[i]; i++) {
            const sums s = of_stage(rows, count, stages[i]);
            assert_true(s.launches + s.transfers > 0);
            if (frame == 1)
                first[i] = s;
            /* the same work in every frame */
            assert_int_equal(s.launches, (uint64_t)frame * first[i].launches);
            assert_float_equal(s.flops, frame * first[i].flops, 1e-9 * s.flops);
        }
        for (size_t i = 0; i < count; i++)
            seconds += rows[i].seconds;
        /* a queue in order: its commands do not overlap */
        assert_true(seconds > 0 && seconds < 1.02 * wall);
        hada_memory_destroy(&rows);
    }
    assert_true(same_result(&plain, &profiled));
    ASSERT_OK(hada_plan_profile(plan, 0, err));
    ASSERT_OK(hada_plan_run(plan, &raw, &profiled, err));
    ASSERT_FAILS(hada_plan_kernel_times(plan, &rows, &count, err), HADA_ERROR_STATE, "");
    assert_null(rows);
    same_calls(plan, &raw, &profiled);
    destroy_images(parts, 2);
}

TEST(stages_of_the_linear_way)
{
    static const char *const stages[] = {"upload", "linear", "focus", "download", NULL};
    run(*state, 0, stages, 3);
}

TEST(stages_of_the_refined_way)
{
    static const char *const stages[] = {"upload", "pursuit", "refine", "focus", "download", NULL};
    run(*state, 6, stages, 2);
}

FIXTURE(learned_setup, learned_teardown)
