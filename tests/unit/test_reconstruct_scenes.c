/* Scenes that are hard to tell apart: slanted, between depths, black, constant. */
#include "learned_camera.h"

static void run(const learned_camera *learned, const hada_plan_options *options, const hada_image *raw,
                hada_result *result)
{
    plan_once(learned->context, learned->model, options, raw, result);
}

/* A scene whose distance runs from nearest to farthest across the window, each depth a stripe. */
TEST(a_slanted_plane_occupies_every_depth)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene = learned_scene(learned, 31);
    hada_image parts[LEARNED_DEPTHS];
    hada_plane planes[LEARNED_DEPTHS];
    const int rows = scene.rows, cols = scene.cols;
    SCOPED_MEMORY int *labels = malloc((size_t)rows * (size_t)cols * sizeof *labels);
    for (int i = 0; i < rows * cols; i++)
        labels[i] = i % cols * LEARNED_DEPTHS / cols;
    for (int z = 0; z < LEARNED_DEPTHS; z++) {
        ASSERT_OK(hada_scene_part(&parts[z], &scene, labels, z, err));
        planes[z] = (hada_plane){z, &parts[z]};
    }
    SCOPED(hada_image) raw = learned_frame(learned, planes, LEARNED_DEPTHS, 31);
    SCOPED(hada_result) result = {0};
    run(learned, NULL, &raw, &result);
    assert_int_equal(result.report->occupied_count, LEARNED_DEPTHS);
    /* the distance falls into the right stripe for most of what the map covers */
    size_t seen = 0, right = 0;
    for (int i = 0; i < rows * cols; i++)
        if (!isnan(result.distance_map.data[i])) {
            const double inverse = 1 / result.distance_map.data[i], *mm = learned->camera.distances_mm;
            int best = 0;
            for (int z = 1; z < LEARNED_DEPTHS; z++)
                if (fabs(1 / mm[z] - inverse) < fabs(1 / mm[best] - inverse))
                    best = z;
            seen++;
            right += best == labels[i];
        }
    assert_true(seen * 2 >= (size_t)(rows * cols));
    assert_true((double)right >= 0.85 * (double)seen);
    assert_true(learned_psnr(&result.all_in_focus, &scene) > 20);
    destroy_images(parts, LEARNED_DEPTHS);
}

/* An object between two depths of the model, which knows no such response, shows at its neighbours: most of its light
 * stands there, and so does the distance map. */
TEST(an_object_between_depths_shows_at_its_neighbours)
{
    const learned_camera *learned = *state;
    hada_camera between = learned->camera;
    SCOPED(hada_simulator) * simulator;
    between.depths = 1;
    between.distances_mm[0] = 2 / (1 / learned->camera.distances_mm[1] + 1 / learned->camera.distances_mm[2]);
    ASSERT_OK(hada_simulator_create(&simulator, learned->context, &between, NULL, err));
    SCOPED(hada_image) scene = learned_scene(learned, 32), raw;
    ASSERT_OK(hada_simulator_render(simulator, &(hada_plane){0, &scene}, 1, learned_noise, 32, &raw, err));
    SCOPED(hada_result) result = {0};
    run(learned, NULL, &raw, &result);
    assert_true(result.report->occupied[1] + result.report->occupied[2] >= 1);
    double light[LEARNED_DEPTHS] = {0}, all = 0;
    for (int z = 0; z < LEARNED_DEPTHS; z++) {
        for (size_t i = 0; i < hada_image_count(&scene); i++)
            light[z] += result.planes[z].data[i];
        all += light[z];
    }
    size_t seen = 0, right = 0;
    for (size_t i = 0; i < hada_image_count(&scene); i++)
        if (!isnan(result.distance_map.data[i])) {
            seen++;
            right += result.distance_map.data[i] > 0.99 * learned->camera.distances_mm[1] &&
                     result.distance_map.data[i] < 1.01 * learned->camera.distances_mm[2];
        }
    if (fmin(light[1], light[2]) < 1.5 * fmax(light[0], light[3]) || (double)right < 0.9 * (double)seen)
        fail_msg("light %.2f %.2f %.2f %.2f of %.2f; map right at %zu of %zu", light[0], light[1], light[2], light[3],
                 all, right, seen);
}

TEST(a_black_frame_holds_nothing)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) raw;
    SCOPED(hada_result) result = {0};
    ASSERT_OK(hada_image_create(&raw, 1, learned->camera.rows, learned->camera.cols, err));
    for (int noisy = 0; noisy < 2; noisy++) {
        if (noisy)
            hada_image_add_noise(&raw, 1e-3, 3);
        run(learned, NULL, &raw, &result);
        assert_int_equal(result.report->occupied_count, 0);
        for (int z = 0; z < result.depths; z++)
            for (size_t i = 0; i < hada_image_count(&result.planes[z]); i++)
                assert_true(result.planes[z].data[i] == 0);
        for (size_t i = 0; i < hada_image_count(&result.distance_map); i++)
            assert_true(isnan(result.distance_map.data[i]));
    }
    /* the linear filters show the noise as it is, and all of it is finite */
    DEFAULTS(hada_plan_options, options);
    options.refine = 0;
    run(learned, &options, &raw, &result);
    assert_int_equal(hada_image_count_not_finite(&result.all_in_focus), 0);
}

TEST(a_constant_frame_stays_finite)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) raw;
    SCOPED(hada_result) result = {0};
    ASSERT_OK(hada_image_create(&raw, 1, learned->camera.rows, learned->camera.cols, err));
    for (size_t i = 0; i < hada_image_count(&raw); i++)
        raw.data[i] = 0.5f;
    run(learned, NULL, &raw, &result);
    for (int z = 0; z < result.depths; z++)
        assert_int_equal(hada_image_count_not_finite(&result.planes[z]), 0);
    assert_int_equal(hada_image_count_not_finite(&result.all_in_focus), 0);
}

/* A frame with a twentieth of its values saturated: the same depths, planes nearly as good, and nothing of it in the
 * frame that follows. */
TEST(saturated_values_mislead_nobody)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene = learned_scene(learned, 33), near = {0}, far = {0}, cut = {0};
    const size_t pixels = (size_t)scene.rows * (size_t)scene.cols;
    SCOPED_MEMORY int *labels = malloc(pixels * sizeof *labels);
    for (size_t i = 0; i < pixels; i++)
        labels[i] = i % (size_t)scene.cols * 2 >= (size_t)scene.cols;
    ASSERT_OK(hada_scene_part(&near, &scene, labels, 0, err));
    ASSERT_OK(hada_scene_part(&far, &scene, labels, 1, err));
    const hada_plane planes[] = {{0, &near}, {2, &far}};
    SCOPED(hada_image) raw = learned_frame(learned, planes, 2, 33);
    const size_t count = hada_image_count(&raw);
    ASSERT_OK(hada_image_create(&cut, raw.channels, raw.rows, raw.cols, err));
    SCOPED_MEMORY float *sorted = malloc(count * sizeof *sorted);
    memcpy(sorted, raw.data, count * sizeof *sorted);
    qsort(sorted, count, sizeof *sorted, ascending_floats);
    for (size_t i = 0; i < count; i++)
        cut.data[i] = fminf(raw.data[i], sorted[count - count / 20]);
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) whole = {0}, saturated = {0}, after = {0};
    ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, NULL, err));
    ASSERT_OK(hada_plan_run(plan, &raw, &whole, err));
    ASSERT_OK(hada_plan_run(plan, &cut, &saturated, err));
    ASSERT_OK(hada_plan_run(plan, &raw, &after, err));
    assert_true(saturated.report->saturated_pixels >= count / 20 && !whole.report->saturated_pixels);
    assert_int_equal(whole.report->occupied_count, 2);
    assert_memory_equal(whole.report->occupied, saturated.report->occupied, LEARNED_DEPTHS);
    const double good = learned_psnr(&whole.all_in_focus, &scene),
                 clipped = learned_psnr(&saturated.all_in_focus, &scene);
    if (clipped < good - 2.5)
        fail_msg("%.2f dB, with saturated values %.2f", good, clipped);
    assert_memory_equal(whole.all_in_focus.data, after.all_in_focus.data,
                        hada_image_count(&scene) * sizeof *scene.data);
    assert_true(whole.report->residual == after.report->residual);
}

/* Occupied depths by list: only those are refined; the rest is dark. */
/* Three objects at 7 depths behind a diffuser, where depths look so alike that one plane explains most of the frame and
 * no single depth more much of the rest. They are no single plane. */
TEST(objects_behind_a_diffuser_are_no_single_plane)
{
    enum { DEPTHS = 7, OBJECTS = 3 };
    static const int depths[OBJECTS] = {3, 4, 6};
    learned_camera own = {.context = ((const learned_camera *)*state)->context, .camera.size = sizeof own.camera};
    hada_camera *camera = &own.camera;
    hada_image parts[OBJECTS];
    hada_plane planes[OBJECTS];
    ASSERT_OK(hada_camera_preset(camera, "crop300", err));
    ASSERT_OK(hada_camera_resize(camera, 150, 200, 72, 72, err));
    ASSERT_OK(hada_camera_set_depths(camera, 100, 600, DEPTHS, err));
    camera->channels = 1;
    camera->seed = 2;
    ASSERT_OK(hada_camera_set_mask(camera, HADA_MASK_DIFFUSER, err));
    ASSERT_OK(hada_simulator_create(&own.simulator, own.context, camera, NULL, err));
    learned_fit(&own);
    SCOPED(hada_image) scene = learned_scene(&own, 41);
    learned_split(&own, &scene, depths, OBJECTS, 41, parts, planes);
    SCOPED(hada_image) raw = learned_frame(&own, planes, OBJECTS, 36);
    SCOPED(hada_result) result = {0};
    DEFAULTS(hada_plan_options, options);
    options.refine_tv = 3e-4;
    run(&own, &options, &raw, &result);
    if (result.report->occupied_count < OBJECTS)
        fail_msg("%d depths of %d, %.2f dB", result.report->occupied_count, OBJECTS,
                 learned_psnr(&result.all_in_focus, &scene));
    destroy_images(parts, OBJECTS);
    hada_model_destroy(&own.model);
    hada_simulator_destroy(&own.simulator);
}

TEST(a_list_of_occupied_depths_is_obeyed)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene = learned_scene(learned, 34);
    SCOPED(hada_image) raw = learned_frame(learned, &(hada_plane){1, &scene}, 1, 34);
    SCOPED(hada_result) result = {0};
    hada_plan_options options;
    for (int refine = -1; refine <= 0; refine++) {
        hada_plan_options_init(&options);
        options.refine = refine;
        options.occupied = HADA_OCCUPIED_LIST;
        options.occupied_list = (int[]){1, 2};
        options.occupied_count = 2;
        run(learned, &options, &raw, &result);
        for (int z = 0; z < LEARNED_DEPTHS; z++)
            assert_int_equal(result.report->occupied[z], z == 1 || z == 2);
        for (size_t i = 0; i < hada_image_count(&scene); i++)
            assert_true(result.planes[0].data[i] == 0 && result.planes[3].data[i] == 0);
    }
    /* computing a few depths alone names them by their distances */
    hada_plan_options_init(&options);
    options.depths = (int[]){1, 3};
    options.depth_count = 2;
    run(learned, &options, &raw, &result);
    assert_int_equal(result.depths, 2);
    assert_true(result.distances_mm[1] == learned->camera.distances_mm[3]);
    assert_int_equal(result.report->occupied[0], 1);
    assert_int_equal(result.report->occupied[1], 0);
    assert_true(learned_psnr(&result.planes[0], &scene) > 25);
}

FIXTURE(learned_setup, learned_teardown)
