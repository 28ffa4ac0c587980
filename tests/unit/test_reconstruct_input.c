/* Frames and options that cannot work, broken pixels, dark levels. */
#include <limits.h>

#include "learned_camera.h"
#include "netlist/net_list.h"
#include "planes/maker.h"

static hada_image frame_of_one_depth(const learned_camera *learned, int depth, hada_image *scene)
{
    *scene = learned_scene(learned, 40);
    return learned_frame(learned, &(hada_plane){depth, scene}, 1, 40);
}

TEST(refuses_frames_of_another_sensor)
{
    const learned_camera *learned = *state;
    SCOPED(hada_plan) * plan;
    hada_result result = {0};
    hada_error error;
    SCOPED(hada_image) small, colour;
    ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, NULL, err));
    ASSERT_OK(hada_image_create(&small, 1, 300, 399, err));
    ASSERT_OK(hada_image_create(&colour, 3, 300, 400, err));
    assert_int_equal(hada_plan_run(plan, &small, &result, &error), HADA_ERROR_MODEL);
    assert_non_null(strstr(error.message, "300 x 399"));
    assert_non_null(strstr(error.message, "300 x 400"));
    assert_int_equal(hada_plan_run(plan, &colour, &result, &error), HADA_ERROR_MODEL);
    assert_int_equal(hada_plan_run(plan, &colour, NULL, &error), HADA_ERROR_ARGUMENT);
}

TEST(refuses_or_repairs_broken_pixels)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene, raw = frame_of_one_depth(learned, 2, &scene);
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) whole = {0}, mended = {0};
    hada_error error;
    DEFAULTS(hada_plan_options, options);
    options.repair_not_finite = 1;
    ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, &options, err));
    ASSERT_OK(hada_plan_run(plan, &raw, &whole, err));
    assert_int_equal(whole.report->repaired_pixels, 0);
    raw.data[150 * 400 + 200] = NAN;
    raw.data[150 * 400 + 201] = INFINITY;
    raw.data[0] = -INFINITY;
    ASSERT_OK(hada_plan_run(plan, &raw, &mended, err));
    assert_int_equal(mended.report->repaired_pixels, 3);
    assert_true(learned_psnr(&mended.planes[2], &scene) > learned_psnr(&whole.planes[2], &scene) - 0.5);
    hada_plan_destroy(&plan);

    options.repair_not_finite = 0;
    ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, &options, err));
    assert_int_equal(hada_plan_run(plan, &raw, &mended, &error), HADA_ERROR_NOT_FINITE);
    assert_non_null(strstr(error.message, "3 pixel"));
    assert_non_null(strstr(error.message, "options.repair_not_finite"));
    hada_plan_destroy(&plan);

    /* nothing is left to repair them from */
    options.repair_not_finite = 1;
    for (size_t i = 0; i < hada_image_count(&raw); i++)
        raw.data[i] = NAN;
    ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, &options, err));
    ASSERT_FAILS(hada_plan_run(plan, &raw, &mended, err), HADA_ERROR_NOT_FINITE, "nothing is left to repair it from");
}

TEST(repairs_from_the_nearest_finite_pixels)
{
    SCOPED(hada_image) frame;
    size_t repaired;
    ASSERT_OK(hada_image_create(&frame, 2, 20, 20, err));
    for (int i = 0; i < 400; i++) {
        frame.data[i] = (float)(i / 20); /* rows */
        frame.data[400 + i] = NAN;       /* a plane with one finite pixel */
    }
    frame.data[400 + 399] = 7;
    frame.data[5 * 20 + 5] = NAN;
    frame.data[0] = INFINITY;
    ASSERT_OK(hada_frame_repair(&frame, HADA_MOSAIC_NONE, &repaired, err));
    assert_int_equal(repaired, 2 + 399);
    assert_true(frame.data[5 * 20 + 5] == 5); /* median of rows 4, 5, 6 */
    assert_true(frame.data[0] == 1);          /* of 0, 1, 1 */
    for (int i = 0; i < 400; i++)
        assert_true(frame.data[400 + i] == 7);
}

TEST(takes_a_dark_level_off)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene, raw = frame_of_one_depth(learned, 1, &scene), dark;
    SCOPED(hada_result) plain = {0}, offset = {0};
    hada_plan *plan;
    ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, NULL, err));
    ASSERT_OK(hada_plan_run(plan, &raw, &plain, err));
    hada_plan_destroy(&plan);
    for (size_t i = 0; i < hada_image_count(&raw); i++)
        raw.data[i] += 0.25f;
    ASSERT_OK(hada_image_create(&dark, 1, raw.rows, raw.cols, err));
    for (size_t i = 0; i < hada_image_count(&dark); i++)
        dark.data[i] = 0.25f;
    /* a level or a frame that is given is used, whether dark says so or has its default */
    static const hada_dark kinds[] = {HADA_DARK_LEVEL, HADA_DARK_FRAME, HADA_DARK_AUTO,
                                      HADA_DARK_MODEL, HADA_DARK_MODEL, HADA_DARK_LEVEL};
    static const double levels[] = {0.25, 0.0, 0.0, 0.25, 0.0, HADA_AUTO};
    for (int k = 0; k < 6; k++) {
        DEFAULTS(hada_plan_options, options);
        options.dark = kinds[k];
        options.dark_level = levels[k];
        options.dark_frame = k == 1 || k == 4 ? &dark : NULL;
        ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, &options, err));
        ASSERT_OK(hada_plan_run(plan, &raw, &offset, err));
        hada_plan_destroy(&plan);
        assert_int_equal(offset.report->occupied_count, 1);
        /* the exact level gives the same picture but for float rounding; the estimate is off by the noise */
        assert_true(learned_psnr(&offset.planes[1], &plain.planes[1]) > (k == 2 || k == 5 ? 25 : 60));
    }
}

/* A level of other units than the frame's, which would leave nothing of it; a frame in those units has no trouble. */
TEST(refuses_a_dark_level_above_everything)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene, raw = frame_of_one_depth(learned, 1, &scene);
    SCOPED(hada_result) result = {0};
    SCOPED(hada_plan) * plan;
    DEFAULTS(hada_plan_options, options);
    options.dark = HADA_DARK_LEVEL;
    options.dark_level = 200.0;
    ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, &options, err));
    ASSERT_FAILS(hada_plan_run(plan, &raw, &result, err), HADA_ERROR_MODEL, "above the dark level of 200");
    for (size_t i = 0; i < hada_image_count(&raw); i++)
        raw.data[i] = 200.0f + 1000.0f * raw.data[i];
    ASSERT_OK(hada_plan_run(plan, &raw, &result, err));
}

/* All that makes planes black is an error where the frame shows something, and none where it does not. */
TEST(black_results_of_frames_that_show_something_are_an_error)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene, raw = frame_of_one_depth(learned, 1, &scene), dark, nothing;
    SCOPED(hada_result) result = {0};
    DEFAULTS(hada_classic_options, classic);
    ASSERT_OK(hada_image_create(&dark, 1, raw.rows, raw.cols, err));
    ASSERT_OK(hada_image_create(&nothing, 1, raw.rows, raw.cols, err));
    hada_random random;
    hada_random_seed(&random, 3, 0);
    for (size_t i = 0; i < hada_image_count(&dark); i++) {
        dark.data[i] = 64.0f; /* counts */
        nothing.data[i] = 0.1f + 0.003f * (float)hada_random_normal(&random);
    }
    for (int i = 0; i < 300; i++) /* hot pixels */
        nothing.data[i * 331] = 1.0f;
    for (int k = 0; k < 9; k++) {
        SCOPED(hada_plan) * plan;
        DEFAULTS(hada_plan_options, options);
        options.dark = k == 0 || k == 1 ? HADA_DARK_LEVEL : k < 4 ? HADA_DARK_FRAME : HADA_DARK_MODEL;
        options.dark_level = k < 2 ? 0.95 : 0.0;
        options.dark_frame = k == 2 || k == 3 ? &dark : NULL;
        options.refine = k % 2 ? 0 : HADA_AUTO;
        hada_classic_options_init(&classic);
        classic.method = k < 6 ? HADA_METHOD_WIENER : HADA_METHOD_ADMM;
        classic.iterations = 3;
        classic.lambda = k == 4 ? 1e-38 : 1e38;
        classic.weight = 0.003;
        classic.mu1 = classic.mu2 = classic.mu3 = k == 6 ? 1e-40 : 1e38;
        options.classic = k < 4 || k == 8 ? NULL : &classic;
        if (k == 8)
            options.dark = HADA_DARK_AUTO;
        hada_error error = {0};
        ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, &options, err));
        const hada_status status = hada_plan_run(plan, k == 8 ? &nothing : &raw, &result, &error);
        if (status != (k == 8 ? HADA_OK : HADA_ERROR_NUMERIC) || (k < 8 && !strstr(error.message, "black")))
            fail_msg("case %d: %s '%s'", k, hada_status_name(status), error.message);
    }
}

/* Nets that make nothing of planes, or numbers that are none. */
TEST(nets_that_break_down_are_an_error)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene, raw = frame_of_one_depth(learned, 1, &scene);
    SCOPED(hada_result) result = {0};
    SCOPED(hada_net) * net;
    DEFAULTS(hada_unet_options, unet);
    unet.channels = unet.out_channels = 1;
    unet.down = "4";
    unet.up = "";
    ASSERT_OK(hada_net_create_unet(&net, &unet, 3, err));
    for (int k = 0; k < 2; k++) {
        SCOPED(hada_model) * model;
        SCOPED(hada_plan) * plan;
        for (size_t i = 0; i < net->floats; i++)
            net->values[i] = k ? 1e38f : 0.0f;
        ASSERT_OK(hada_model_with_enhance(&model, learned->model, net, 0, 0, err));
        ASSERT_OK(hada_plan_create(&plan, learned->context, model, NULL, err));
        ASSERT_FAILS(hada_plan_run(plan, &raw, &result, err), HADA_ERROR_NUMERIC, k ? "" : "black");
    }
}

TEST(refuses_options_that_cannot_work)
{
    const learned_camera *learned = *state;
    static const int beyond[] = {0, 4}, descending[] = {2, 1}, computed[] = {0, 1}, occupied[] = {3};
    hada_plan_options options;
    hada_plan *plan;
    hada_error error;
    SCOPED(hada_image) dark;
    ASSERT_OK(hada_image_create(&dark, 1, 10, 10, err));
    for (int k = 0; k < 21; k++) {
        hada_plan_options_init(&options);
        hada_status expected = HADA_ERROR_ARGUMENT;
        const char *member = "";
        switch (k) {
        case 0: options.size = 1; break;
        case 1:
            options.depths = beyond;
            options.depth_count = 2;
            break;
        case 2:
            options.depths = descending;
            options.depth_count = 2;
            break;
        case 3: options.occupied = HADA_OCCUPIED_LIST; break;
        case 4: options.gamma = 0; break;
        case 11:
            options.gamma = 1e300;
            member = "options.gamma is 1e+300";
            break;
        case 12:
            options.dark = (hada_dark)77;
            member = "options.dark is 77";
            break;
        case 13: options.occupied = (hada_occupied)3; break;
        case 14:
            options.dark = HADA_DARK_NONE;
            options.dark_frame = &dark;
            member = "options.dark_frame is given";
            break;
        case 15: options.dark_level = -0.5; break;
        case 16:
            options.dark = HADA_DARK_FRAME;
            member = "options.dark_frame is NULL";
            break;
        case 17:
            options.depth_count = 2;
            member = "options.depth_count is 2";
            break;
        case 18:
            options.occupied = HADA_OCCUPIED_ALL;
            options.occupied_list = occupied;
            options.occupied_count = 1;
            break;
        case 19:
            options.dark_level = 0.1;
            options.dark_frame = &dark;
            break;
        case 20:
            options.refine = INT_MAX;
            member = "refine 2147483647";
            break;
        case 5: options.batch = -2; break;
        case 8: /* no number but HADA_AUTO has something chosen */ options.refine_colour = -2; break;
        case 9: options.refine = -2; break;
        case 10:
            options.dark = HADA_DARK_LEVEL;
            options.dark_level = NAN;
            break;
        case 6:
            options.dark = HADA_DARK_FRAME;
            options.dark_frame = &dark;
            expected = HADA_ERROR_SIZE;
            break;
        case 7: /* the occupied depth is not computed */
            options.depths = computed;
            options.depth_count = 2;
            options.occupied = HADA_OCCUPIED_LIST;
            options.occupied_list = occupied;
            options.occupied_count = 1;
            break;
        }
        if (hada_plan_create(&plan, learned->context, learned->model, &options, &error) != expected ||
            !strstr(error.message, member))
            fail_msg("case %d was not refused as it should: %s", k, error.message);
        assert_null(plan);
    }
}

/* HADA_AUTO leaves the batch and the queues to the library; 0, as older programs have it, says the same. */
TEST(zero_leaves_open_as_auto_does)
{
    const learned_camera *learned = *state;
    uint64_t bytes[3];
    for (int k = 0; k < 3; k++) {
        SCOPED(hada_plan) * plan;
        DEFAULTS(hada_plan_options, options);
        assert_true(options.batch == HADA_AUTO && options.queues == HADA_AUTO);
        if (k == 1)
            options.batch = options.queues = 0;
        if (k == 2)
            options.queues = 2;
        ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, &options, err));
        hada_plan_memory(plan, &bytes[k], NULL);
    }
    assert_true(bytes[0] == bytes[1] && bytes[0] < bytes[2]);
}

TEST(gamma_is_an_exponent_on_the_pictures)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene, raw = frame_of_one_depth(learned, 0, &scene);
    SCOPED(hada_result) plain = {0}, root = {0};
    for (int k = 0; k < 2; k++) {
        DEFAULTS(hada_plan_options, options);
        options.gamma = k ? 0.5 : 1.0;
        plan_once(learned->context, learned->model, &options, &raw, k ? &root : &plain);
    }
    for (size_t i = 0; i < hada_image_count(&scene); i++)
        assert_true(fabsf(root.planes[0].data[i] - sqrtf(plain.planes[0].data[i])) < 1e-6f);
}

FIXTURE(learned_setup, learned_teardown)
