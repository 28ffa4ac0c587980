/* The sums of a fit: accuracy, files, merging, and pairs that must not get in. */
#include "fit_fixture.h"

/* Ten thousand additions: the sums stay within a few 1e-12 of double precision; float sums would be off by 1e-5. */
TEST(many_additions_stay_accurate)
{
    fixture *f = *state;
    enum { MANY = 10000 };
    hada_fit_options options = usual(1, HADA_FORM_SPLIT);
    SCOPED(hada_fitter) * fitter;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    const size_t spectrum = (size_t)CHANNELS * fitter->grid.layout.count * 2, count = fitter->grid.layout.count;
    const size_t stride = fitter->grid.stride;
    SCOPED_MEMORY float *x = malloc(spectrum * 4), *b = malloc(spectrum * 4), *sums = malloc(12 * stride * 4);
    hada_random random;
    hada_random_seed(&random, 1, 1);
    for (size_t i = 0; i < spectrum; i++) {
        x[i] = (float)(hada_random_uniform(&random) + 0.1);
        b[i] = (float)(hada_random_uniform(&random) + 0.1);
    }
    hada_slot *slot = fitter->grid.slot;
    ASSERT_OK(hada_buffer_write(&fitter->pair.scene_spectrum, slot, 0, x, spectrum * 4, err));
    ASSERT_OK(hada_buffer_write(&fitter->pair.raw_spectrum, slot, 0, b, spectrum * 4, err));
    ASSERT_OK(hada_fit_sums_select(&fitter->sums, 0, err));
    for (int i = 0; i < MANY; i++)
        ASSERT_OK(hada_fit_sums_accumulate(&fitter->sums, &fitter->pair, 1.0, err));
    ASSERT_OK(hada_buffer_read(&fitter->sums.sums[0], slot, 0, sums, 12 * stride * 4, err));
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
}

TEST(bad_pairs_leave_the_sums_as_they_were)
{
    fixture *f = *state;
    hada_fit_options options = usual(1, HADA_FORM_COMPLEX);
    SCOPED(hada_fitter) * fitter;
    SCOPED(hada_model) * before, *after;
    options.lambda = 1e-3;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    ASSERT_FAILS(hada_fitter_finish(fitter, NULL, &before, err), HADA_ERROR_STATE, "100 mm");
    add_all(f, fitter, 1, 0, 2);
    ASSERT_OK(hada_fitter_finish(fitter, NULL, &before, err));
    SCOPED(hada_image) bad = small_scene(CHANNELS, ROWS, COLS, 1), small = small_scene(CHANNELS, WINDOW - 1, WINDOW, 1);
    bad.data[77] = NAN;
    ASSERT_FAILS(hada_fitter_add_pair(fitter, 0, &bad, &f->scene[0][0], err), HADA_ERROR_NOT_FINITE, "");
    bad.data[77] = INFINITY;
    ASSERT_FAILS(hada_fitter_add_pair(fitter, 0, &f->frame[0][0], &bad, err), HADA_ERROR_NOT_FINITE, "");
    ASSERT_FAILS(hada_fitter_add_pair(fitter, 0, &f->frame[0][0], &small, err), HADA_ERROR_SIZE, "");
    ASSERT_FAILS(hada_fitter_add_pair(fitter, 0, &small, &f->scene[0][0], err), HADA_ERROR_SIZE, "");
    ASSERT_FAILS(hada_fitter_add_pair(fitter, 1, &f->frame[0][0], &f->scene[0][0], err), HADA_ERROR_ARGUMENT, "");
    assert_int_equal(hada_fitter_get_info(fitter)->pairs[0], 2);
    ASSERT_OK(hada_fitter_finish(fitter, NULL, &after, err));
    assert_memory_equal(before->filter, after->filter, hada_model_plane(before) * 2 * CHANNELS * sizeof(float));
}

/* A scene of the frame's size counts by its centre; a dark level is taken off; identical pairs change nothing. */
TEST(equal_inputs_give_equal_models)
{
    fixture *f = *state;
    hada_fit_options options = usual(1, HADA_FORM_COMPLEX);
    hada_model *models[4];
    options.lambda = 1e-4;
    for (int k = 0; k < 4; k++) {
        SCOPED(hada_fitter) * fitter;
        options.dark = k == 1 ? 0.25 : k == 3 ? 0.125 : 0.0;
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        SCOPED(hada_image) frame, scene;
        ASSERT_OK(hada_image_create(&frame, CHANNELS, ROWS, COLS, err));
        ASSERT_OK(hada_image_create(&scene, CHANNELS, ROWS, COLS, err));
        for (int i = 0; i < CHANNELS * ROWS * COLS; i++)
            frame.data[i] = f->frame[0][0].data[i] + (float)options.dark;
        for (int c = 0; c < CHANNELS; c++)
            for (int row = 0; row < WINDOW; row++)
                memcpy(scene.data + (c * ROWS + row + (ROWS - WINDOW) / 2) * COLS + (COLS - WINDOW) / 2,
                       f->scene[0][0].data + (c * WINDOW + row) * WINDOW, WINDOW * sizeof(float));
        for (int i = 0; i < (k == 2 ? 4 : 1); i++)
            ASSERT_OK(hada_fitter_add_pair(fitter, 0, &frame, k == 1 ? &scene : &f->scene[0][0], err));
        ASSERT_OK(hada_fitter_finish(fitter, NULL, &models[k], err));
    }
    const size_t values = hada_model_plane(models[0]) * 2 * CHANNELS;
    double distance[4] = {0};
    for (int k = 1; k < 4; k++)
        distance[k] = relative_change(models[k]->filter, models[0]->filter, values);
    assert_true(distance[1] < 1e-4); /* the level costs bits of the frame */
    assert_true(distance[2] < 1e-6);
    assert_true(distance[3] < 1e-4);
    for (int k = 0; k < 4; k++)
        hada_model_destroy(&models[k]);
}

/* No number but HADA_AUTO has anything chosen. */
TEST(negative_numbers_choose_nothing)
{
    fixture *f = *state;
    hada_fitter *fitter;
    for (int k = 0; k < 9; k++) {
        hada_fit_options options = usual(1, HADA_FORM_COMPLEX);
        double *const numbers[] = {&options.alpha,        &options.lambda,  &options.refine_tv, &options.refine_colour,
                                   &options.refine_ridge, &options.outside, &options.dark};
        if (k < 7)
            *numbers[k] = -0.5;
        else
            *(k == 7 ? &options.refine_steps : &options.crop_passes) = -2;
        ASSERT_FAILS(hada_fitter_create(&fitter, f->context, &options, err), HADA_ERROR_ARGUMENT, "HADA_AUTO");
    }
}

TEST(sums_merge_and_go_on)
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
        ASSERT_OK(hada_fitter_finish(fitter, NULL, &whole, err));
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
        assert_int_equal(hada_fitter_get_info(fitter)->pairs[DEPTHS - 1], 2);
        add_all(f, fitter, DEPTHS, 2, PAIRS);
        ASSERT_OK(hada_fitter_finish(fitter, NULL, &resumed, err));
        hada_fitter_destroy(&fitter);
        ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
        ASSERT_OK(hada_fitter_load_sums(fitter, path[1], err));
        ASSERT_OK(hada_fitter_load_sums(fitter, path[0], err));
        ASSERT_OK(hada_fitter_finish(fitter, NULL, &merged, err));
        const size_t values = hada_model_plane(whole) * 2 * DEPTHS * CHANNELS;
        assert_memory_equal(whole->filter, resumed->filter, values * sizeof(float));
        assert_memory_equal(whole->otf, resumed->otf, values * sizeof(float));
        assert_true(relative_change(merged->filter, whole->filter, values) < 1e-6);
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
        assert_int_equal(hada_fitter_get_info(other)->pairs[0], 0);
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
/* The same scenes in another encoding give the same camera, which remembers it; sums of one do not go with another. */
TEST(scenes_are_brought_to_light)
{
    fixture *f = *state;
    char path[] = "/tmp/hadalens-test-XXXXXX";
    close(mkstemp(path));
    hada_fit_options options = usual(1, HADA_FORM_COMPLEX);
    hada_fitter *linear, *encoded;
    SCOPED(hada_model) * expected, *model;
    options.lambda = 1e-3;
    ASSERT_OK(hada_fitter_create(&linear, f->context, &options, err));
    options.scene_response = 2.0;
    ASSERT_OK(hada_fitter_create(&encoded, f->context, &options, err));
    for (int i = 0; i < PAIRS; i++) {
        SCOPED(hada_image) scene = small_scene(CHANNELS, WINDOW, WINDOW, 1);
        for (size_t k = 0; k < hada_image_count(&scene); k++)
            scene.data[k] = sqrtf(f->scene[0][i].data[k]);
        ASSERT_OK(hada_fitter_add_pair(linear, 0, &f->frame[0][i], &f->scene[0][i], err));
        ASSERT_OK(hada_fitter_add_pair(encoded, 0, &f->frame[0][i], &scene, err));
    }
    ASSERT_OK(hada_fitter_finish(linear, NULL, &expected, err));
    ASSERT_OK(hada_fitter_finish(encoded, NULL, &model, err));
    assert_true(expected->info.scene_response == HADA_RESPONSE_LINEAR && model->info.scene_response == 2.0);
    double off = 0.0, size = 0.0;
    for (size_t i = 0; i < hada_model_plane(model) * 2 * CHANNELS; i++) {
        off += pow((double)model->filter[i] - (double)expected->filter[i], 2.0);
        size += pow((double)expected->filter[i], 2.0);
    }
    assert_true(off < 1e-10 * size); /* the root of a float and its square: 1e-7, which the fit makes larger */
    ASSERT_OK(hada_fitter_save_sums(encoded, path, err));
    ASSERT_FAILS(hada_fitter_load_sums(linear, path, err), HADA_ERROR_SIZE, "'2'");
    assert_int_equal(hada_fitter_get_info(linear)->pairs[0], PAIRS);
    ASSERT_OK(hada_fitter_load_sums(encoded, path, err));
    assert_int_equal(hada_fitter_get_info(encoded)->pairs[0], 2 * PAIRS);
    hada_fitter_destroy(&encoded);
    DEFAULTS(hada_fit_options, of_file);
    of_file.sums = path; /* which says it */
    ASSERT_OK(hada_fitter_create(&encoded, f->context, &of_file, err));
    assert_true(encoded->grid.info.scene_response == 2.0);
    hada_fitter_destroy(&encoded);
    options.scene_response = 7.0;
    ASSERT_FAILS(hada_fitter_create(&encoded, f->context, &options, err), HADA_ERROR_ARGUMENT, "");
    unlink(path);
    hada_fitter_destroy(&linear);
}

TEST(depths_may_come_in_any_order)
{
    fixture *f = *state;
    hada_fit_options options = usual(DEPTHS, HADA_FORM_COMPLEX);
    SCOPED(hada_fitter) * a, *b;
    SCOPED(hada_model) * one, *two;
    options.alpha = 0.3;
    options.lambda = 1e-4;
    ASSERT_OK(hada_fitter_create(&a, f->context, &options, err));
    const uint64_t bytes = hada_fitter_get_info(a)->bytes;
    assert_int_equal(hada_context_bytes(f->context), bytes);
    ASSERT_OK(hada_fitter_create(&b, f->context, &options, err));
    add_all(f, a, DEPTHS, 0, PAIRS);
    for (int i = 0; i < PAIRS; i++)
        for (int z = DEPTHS - 1; z >= 0; z--)
            ASSERT_OK(hada_fitter_add_pair(b, z, &f->frame[z][i], &f->scene[z][i], err));
    ASSERT_OK(hada_fitter_finish(a, NULL, &one, err));
    ASSERT_OK(hada_fitter_finish(b, NULL, &two, err));
    assert_memory_equal(one->filter, two->filter, hada_model_plane(one) * 2 * DEPTHS * CHANNELS * sizeof(float));
}

TEST(bad_options_are_refused)
{
    fixture *f = *state;
    static const double backwards[] = {300.0, 200.0, 100.0};
    hada_fitter *fitter;
    hada_fit_options options = usual(DEPTHS, HADA_FORM_WIENER);
    ASSERT_FAILS(hada_fitter_create(&fitter, f->context, &options, err), HADA_ERROR_ARGUMENT, "");
    options = usual(DEPTHS, HADA_FORM_COMPLEX);
    options.distances_mm = backwards;
    ASSERT_FAILS(hada_fitter_create(&fitter, f->context, &options, err), HADA_ERROR_MODEL, "");
    options = usual(DEPTHS, HADA_FORM_COMPLEX);
    options.window_rows = ROWS + 1;
    ASSERT_FAILS(hada_fitter_create(&fitter, f->context, &options, err), HADA_ERROR_SIZE, "");
    options = usual(0, HADA_FORM_COMPLEX);
    ASSERT_FAILS(hada_fitter_create(&fitter, f->context, &options, err), HADA_ERROR_MODEL, "");
    assert_null(fitter);
}

FIXTURE(fit_setup, fit_teardown)
