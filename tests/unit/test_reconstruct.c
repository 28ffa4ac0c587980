/* The main job: quality on scenes not fitted, occupancy unknown; stated bytes; same bits. */
#include "learned_camera.h"
#include "model/model.h"

static void plan_of(const learned_camera *learned, const hada_plan_options *options, hada_plan **plan)
{
    ASSERT_OK(hada_plan_create(plan, learned->context, learned->model, options, err));
}

/* Share of the covered pixels whose distance is within half a depth step of the truth. */
static double map_right(const hada_camera *camera, const hada_image *map, const hada_image *parts, const int *depths,
                        int count, double *covered)
{
    const size_t pixels = hada_image_count(map);
    size_t seen = 0, right = 0;
    for (size_t i = 0; i < pixels; i++) {
        if (isnan(map->data[i]))
            continue;
        seen++;
        double near = INFINITY;
        for (int z = 0; z < count; z++)
            if (parts[z].data[i] > 0) {
                /* depths are equal steps in 1/z */
                const double step =
                    (1 / camera->distances_mm[0] - 1 / camera->distances_mm[camera->depths - 1]) / (camera->depths - 1);
                near = fmin(near, fabs(1 / map->data[i] - 1 / camera->distances_mm[depths[z]]) / step);
            }
        right += near <= 0.5;
    }
    *covered = (double)seen / (double)pixels;
    return seen ? (double)right / (double)seen : 0;
}

TEST(finds_one_depth_and_refines_it)
{
    const learned_camera *learned = *state;
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) result = {0};
    double mean = 0;
    plan_of(learned, NULL, &plan);
    for (int i = 0; i < 2 * LEARNED_DEPTHS; i++) {
        const int z = i % LEARNED_DEPTHS;
        SCOPED(hada_image) scene = learned_scene(learned, 900 + (uint64_t)i);
        SCOPED(hada_image) raw = learned_frame(learned, &(hada_plane){z, &scene}, 1, 50 + (uint64_t)i);
        ASSERT_OK(hada_plan_run(plan, &raw, &result, err));
        assert_int_equal(result.depths, LEARNED_DEPTHS);
        for (int k = 0; k < LEARNED_DEPTHS; k++)
            assert_int_equal(result.report->occupied[k], k == z);
        assert_true(result.report->refine_steps > 0);
        assert_true(result.report->residual < 0.2);
        mean += learned_psnr(&result.planes[z], &scene) / (2 * LEARNED_DEPTHS);
        for (size_t k = 0; k < hada_image_count(&scene); k++)
            assert_true(result.planes[z].data[k] >= 0);
    }
    /* perf/results/quality-sim300.md has the figures in colour over many scenes: 28.4 dB and more. Eight grey scenes
     * scatter about them by half a decibel. */
    if (mean < 27.4)
        fail_msg("one depth: %.2f dB", mean);
}

TEST(finds_two_depths_and_tells_them_apart)
{
    const learned_camera *learned = *state;
    static const int pairs[][2] = {{0, 3}, {0, 1}, {1, 3}, {2, 3}};
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) result = {0};
    SCOPED(hada_result) counted = {0};
    double mean = 0;
    plan_of(learned, NULL, &plan);
    for (size_t p = 0; p < 4; p++) {
        hada_image scene = learned_scene(learned, 800 + p), parts[2];
        hada_plane planes[2];
        learned_split(learned, &scene, pairs[p], 2, p, parts, planes);
        SCOPED(hada_image) raw = learned_frame(learned, planes, 2, 60 + p);
        ASSERT_OK(hada_plan_run(plan, &raw, &result, err));
        for (int k = 0; k < LEARNED_DEPTHS; k++)
            assert_int_equal(result.report->occupied[k], k == pairs[p][0] || k == pairs[p][1]);
        for (int i = 0; i < 2; i++)
            mean += learned_psnr(&result.planes[pairs[p][i]], &parts[i]) / 8;
        double covered, right = map_right(&learned->camera, &result.distance_map, parts, pairs[p], 2, &covered);
        assert_true(right >= 0.9);
        assert_true(covered >= 0.5);
        assert_true(learned_psnr(&result.all_in_focus, &scene) >= 22);
        for (size_t k = 0; k < hada_image_count(&raw); k++) /* as floats that count electrons */
            raw.data[k] *= 4096.0f;
        ASSERT_OK(hada_plan_run(plan, &raw, &counted, err));
        for (int k = 0; k < LEARNED_DEPTHS; k++)
            assert_int_equal(counted.report->occupied[k], result.report->occupied[k]);
        hada_image_destroy(&scene);
        destroy_images(parts, 2);
    }
    if (mean < 24.8)
        fail_msg("two depths: %.2f dB", mean);
}

/* A model whose held-out pairs preferred a blend: the refined plane and that of the linear filter, by its share. Two
 * depths are refined alone, for both linear planes hold the light of both; so are steps that the caller gives. */
TEST(refined_and_linear_planes_are_blended)
{
    const learned_camera *learned = *state;
    static const int listed[] = {0, 2};
    const double share = 0.25;
    enum { REFINED, LINEAR, BLENDED, GIVEN, TWO, TWO_BLENDED, KINDS };
    SCOPED(hada_model) * blended;
    hada_result of[KINDS] = {0};
    ASSERT_OK(hada_model_with_enhance(&blended, learned->model, NULL, 0, 0, err));
    blended->info.refine_share = share;
    SCOPED(hada_image) scene = learned_scene(learned, 31);
    hada_image parts[2];
    hada_plane planes[2];
    learned_split(learned, &scene, listed, 2, 31, parts, planes);
    SCOPED(hada_image) raw = learned_frame(learned, planes, 2, 31);
    for (int i = 0; i < KINDS; i++) {
        SCOPED(hada_plan) * plan;
        uint64_t device, host;
        const uint64_t before = hada_context_bytes(learned->context);
        const hada_model *model = i == BLENDED || i == GIVEN || i == TWO_BLENDED ? blended : learned->model;
        DEFAULTS(hada_plan_options, options);
        options.occupied = HADA_OCCUPIED_LIST;
        options.occupied_list = listed;
        options.occupied_count = i < TWO ? 1 : 2;
        options.scene = HADA_SCENE_PLANES;
        options.refine = i == LINEAR ? 0 : i == GIVEN ? 3 : HADA_AUTO;
        ASSERT_OK(hada_plan_estimate(learned->context, model, &options, &device, &host, err));
        ASSERT_OK(hada_plan_create(&plan, learned->context, model, &options, err));
        ASSERT_OK(hada_plan_run(plan, &raw, &of[i], err));
        const double held = (double)(hada_context_bytes(learned->context) - before);
        if (fabs(held / (double)device - 1) > 0.1)
            fail_msg("plan %d: %llu bytes stated, %.0f held", i, (unsigned long long)device, held);
    }
    const hada_image *plane[KINDS];
    double apart = 0.0, wrong = 0.0, far = 0.0;
    for (int i = 0; i < KINDS; i++)
        plane[i] = of[i].planes;
    for (size_t i = 0; i < hada_image_count(&scene); i++) {
        const double refined = plane[REFINED]->data[i], linear = plane[LINEAR]->data[i];
        wrong = fmax(wrong, fabs(plane[BLENDED]->data[i] - share * refined - (1.0 - share) * linear));
        apart = fmax(apart, fabs(plane[GIVEN]->data[i] - refined));
        far = fmax(far, fabs(linear - refined));
    }
    if (!(wrong <= 1e-6 && apart < 0.5 * far))
        fail_msg("%g off the blend; %g off the refined plane, which is %g off the linear one", wrong, apart, far);
    for (int k = 0; k < 2; k++)
        assert_memory_equal(of[TWO].planes[listed[k]].data, of[TWO_BLENDED].planes[listed[k]].data,
                            hada_image_count(&scene) * sizeof(float));
    for (int i = 0; i < KINDS; i++)
        hada_result_destroy(&of[i]);
    destroy_images(parts, 2);
}

/* A surface's memory is known before it is taken, for all queues; where there is too little, nothing is taken. */
TEST(surfaces_are_planned)
{
    const learned_camera *learned = *state;
    const uint64_t memory = learned->context->info.memory_bytes, before = hada_context_bytes(learned->context);
    hada_plan *plan;
    hada_result result = {0};
    uint64_t without, with;
    DEFAULTS(hada_plan_options, options);
    options.scene = HADA_SCENE_SURFACE;
    options.queues = 2;
    SCOPED(hada_image) scene = learned_scene(learned, 5);
    SCOPED(hada_image) raw = learned_frame(learned, &(hada_plane){1, &scene}, 1, 5);
    plan_of(learned, &options, &plan);
    hada_plan_memory(plan, &without, NULL);
    assert_true(without == hada_context_bytes(learned->context) - before);
    learned->context->info.memory_bytes = without / 3 * 4 + 4000000; /* less than the three quarters that count */
    ASSERT_FAILS(hada_plan_run(plan, &raw, &result, err), HADA_ERROR_DEVICE_MEMORY, "options.scene planes");
    assert_true(without == hada_context_bytes(learned->context) - before);
    learned->context->info.memory_bytes = memory;
    for (int i = 0; i < 3; i++) {
        ASSERT_OK(hada_plan_run(plan, &raw, &result, err));
        hada_plan_memory(plan, &with, NULL);
        assert_true(with > without && with == hada_context_bytes(learned->context) - before);
    }
    hada_result_destroy(&result);
    hada_plan_destroy(&plan);
    assert_true(hada_context_bytes(learned->context) == before);
}

TEST(holds_the_bytes_it_states)
{
    const learned_camera *learned = *state;
    hada_plan_options variants[4];
    for (int i = 0; i < 4; i++)
        hada_plan_options_init(&variants[i]);
    variants[1].refine = 0;
    variants[2].refine = 0;
    variants[2].half = 1;
    variants[3].occupied = HADA_OCCUPIED_ALL;
    SCOPED(hada_image) scene = learned_scene(learned, 5);
    SCOPED(hada_image) raw = learned_frame(learned, &(hada_plane){1, &scene}, 1, 5);
    for (int i = 0; i < 4; i++) {
        uint64_t device, host, before = hada_context_bytes(learned->context);
        hada_plan *plan;
        hada_result result = {0};
        ASSERT_OK(hada_plan_estimate(learned->context, learned->model, &variants[i], &device, &host, err));
        hada_context_reset_peak(learned->context);
        plan_of(learned, &variants[i], &plan);
        ASSERT_OK(hada_plan_run(plan, &raw, &result, err));
        const double held = (double)(hada_context_peak_bytes(learned->context) - before);
        if (fabs(held / (double)device - 1) > 0.1)
            fail_msg("variant %d: %llu bytes stated, %.0f held", i, (unsigned long long)device, held);
        hada_result_destroy(&result);
        hada_plan_destroy(&plan);
        assert_int_equal(hada_context_bytes(learned->context), before);
    }
}

TEST(gives_the_same_bits_in_every_batch_and_run)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene = learned_scene(learned, 6);
    hada_image parts[2];
    hada_plane planes[2];
    learned_split(learned, &scene, (int[]){0, 2}, 2, 6, parts, planes);
    SCOPED(hada_image) raw = learned_frame(learned, planes, 2, 6);
    for (int refine = -1; refine <= 0; refine++) {
        SCOPED(hada_result) first = {0}, other = {0};
        for (int batch = 0; batch <= 3; batch++) {
            SCOPED(hada_plan) * plan;
            DEFAULTS(hada_plan_options, options);
            options.refine = refine;
            options.batch = batch;
            SCOPED(hada_model) * model; /* which the plan outlives */
            ASSERT_OK(hada_model_with_enhance(&model, learned->model, NULL, 0, 0, err));
            ASSERT_OK(hada_plan_create(&plan, learned->context, model, &options, err));
            hada_model_destroy(&model);
            ASSERT_OK(hada_plan_run(plan, &raw, batch ? &other : &first, err));
            if (batch)
                assert_true(same_result(&first, &other));
            ASSERT_OK(hada_plan_run(plan, &raw, &other, err));
            assert_true(same_result(&first, &other));
        }
    }
    destroy_images(parts, 2);
}

TEST(half_filters_stay_close)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene = learned_scene(learned, 8);
    SCOPED(hada_image) raw = learned_frame(learned, &(hada_plane){2, &scene}, 1, 8);
    hada_result results[2] = {{0}, {0}};
    for (int half = 0; half < 2; half++) {
        SCOPED(hada_plan) * plan;
        DEFAULTS(hada_plan_options, options);
        options.refine = 0;
        options.half = half;
        plan_of(learned, &options, &plan);
        ASSERT_OK(hada_plan_run(plan, &raw, &results[half], err));
    }
    double difference = 0, norm = 0;
    for (size_t i = 0; i < hada_image_count(&scene); i++) {
        const double a = results[0].planes[2].data[i], b = results[1].planes[2].data[i];
        difference += (a - b) * (a - b);
        norm += a * a;
    }
    assert_true(difference > 0); /* half was really used */
    /* 11 bits of mantissa, errors independent over frequencies: below 2^-11 */
    assert_true(sqrt(difference / norm) < 1.0 / 2048);
    hada_result_destroy(&results[0]);
    hada_result_destroy(&results[1]);
}

FIXTURE(learned_setup, learned_teardown)
