/* What a sensor sees of the scenes' colours: found in pairs, kept by models and sums, undone in frames. */
#include <hadalens/task_fit.h>

#include "camera_small.h"
#include "dataset/dataset.h"
#include "device_fixture.h"
#include "fit/fitter.h"
#include "image/colour_matrix.h"
#include "image/correct.h"
#include "image/mosaic.h"
#include "image/statistics.h"
#include "model/model.h"

enum { ROWS = 72, COLS = 96, WINDOW = 40, CHANNELS = 3, PAIRS = 4, AREA = ROWS * COLS };
#define NOISE 0.002
static const double distance = 100.0;
static const double mixing[] = {0.75, 0.2, 0.05, 0.15, 0.65, 0.2, 0.05, 0.25, 0.7};

typedef struct pairs {
    hada_image psf, frame[PAIRS], scene[PAIRS];
} pairs;

/* m NULL: the sensor has the colours of the scenes. mosaic: frames that suit one; what it keeps is keep_mosaic(). */
static void make_pairs(pairs *set, const double *m, double response, int grey, int mosaic)
{
    set->psf = small_psf(CHANNELS, ROWS, COLS, 9, 5);
    if (mosaic)
        small_soften(&set->psf);
    for (int i = 0; i < PAIRS; i++) {
        hada_image *frame = &set->frame[i], *scene = &set->scene[i];
        ASSERT_OK(hada_scene_procedural(scene, 70 + (uint64_t)i, CHANNELS, WINDOW, WINDOW, err));
        for (size_t k = 0; grey && k < hada_image_count(scene); k++)
            scene->data[k] = scene->data[k % (WINDOW * WINDOW)];
        for (size_t k = 0; mosaic && k < (size_t)WINDOW * WINDOW; k++) /* many colours */
            scene->data[WINDOW * WINDOW + k] = scene->data[WINDOW * WINDOW - 1 - k];
        *frame = small_frame(&set->psf, scene, 1, 0.0, (uint64_t)i);
        if (m)
            hada_colours_mix(frame->data, AREA, m);
        hada_random random;
        hada_random_seed(&random, 3, (uint64_t)i);
        for (size_t k = 0; k < hada_image_count(frame); k++)
            frame->data[k] += (float)(NOISE * hada_random_normal(&random));
        hada_response_convert(scene->data, hada_image_count(scene), HADA_RESPONSE_LINEAR, response);
    }
}

static void free_pairs(pairs *set)
{
    hada_image_destroy(&set->psf);
    destroy_images(set->frame, PAIRS);
    destroy_images(set->scene, PAIRS);
}

static hada_status read_pair(void *user, int depth, int i, hada_image *frame, hada_image *scene, hada_error *error)
{
    const pairs *set = user;
    (void)depth;
    HADA_TRY(hada_image_copy(frame, &set->frame[i], error));
    return hada_image_copy(scene, &set->scene[i], error);
}

/* What a sensor with a colour filter mosaic keeps of a frame. */
static void keep_mosaic(hada_image *frame)
{
    hada_mosaic_take(HADA_MOSAIC_GRBG, frame->data, ROWS, COLS, frame->data);
    frame->channels = 1;
}

static hada_dataset *data_of(pairs *set)
{
    static const int count = PAIRS;
    hada_dataset *data;
    DEFAULTS(hada_dataset_options, how);
    how.mosaic = set->frame[0].channels == 1 ? HADA_MOSAIC_GRBG : HADA_MOSAIC_NONE;
    ASSERT_OK(hada_dataset_create(&data, 1, &distance, &count, read_pair, set, &how, err));
    return data;
}

static hada_model *learn(pairs *set, const hada_fit_options *fit)
{
    DEFAULTS(hada_fit_task, task);
    SCOPED(hada_dataset) *data = data_of(set);
    hada_model *model;
    task.fit = fit;
    task.boundary = HADA_BOUNDARY_PADDED;
    if (hada_colours_known(fit->colour_matrix) && fit->scene_response != HADA_AUTO)
        task.exposure = HADA_EXPOSURE_SAME; /* nothing is to be found */
    ASSERT_OK(hada_fit_run(&model, NULL, context, data, &task, err));
    return model;
}

static double farthest(const double *a, const double *b)
{
    double most = 0.0;
    for (int i = 0; i < HADA_COLOUR_MATRIX; i++)
        most = fmax(most, fabs(a[i] - b[i]));
    return most;
}

TEST(matrices_are_inverted)
{
    double inverse[HADA_COLOUR_MATRIX], product[HADA_COLOUR_MATRIX] = {0.0};
    static const double one[] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, none[HADA_COLOUR_MATRIX] = {0.0};
    static const double alike[] = {1, 0, 0, 1, 0, 0, 0, 0, 1};
    float planes[] = {1, 2, 3, 4, 5, 6};
    hada_colours_invert(mixing, inverse);
    for (int i = 0; i < HADA_COLOUR_MATRIX; i++)
        for (int k = 0; k < HADA_COLOURS; k++)
            product[i] += mixing[i / HADA_COLOURS * HADA_COLOURS + k] * inverse[k * HADA_COLOURS + i % HADA_COLOURS];
    assert_true(farthest(product, one) < 1e-12);
    assert_true(hada_colours_usable(none) && hada_colours_usable(mixing) && !hada_colours_usable(alike));
    assert_true(!hada_colours_known(none) && hada_colours_known(one));
    hada_colours_mix(planes, 2, mixing);
    assert_true(fabsf(planes[1] - (float)(0.75 * 2 + 0.2 * 4 + 0.05 * 6)) < 1e-6f);
    assert_true(fabsf(planes[4] - (float)(0.05 * 1 + 0.25 * 3 + 0.7 * 5)) < 1e-6f);
}

/* What one colour does not know, no colour does once they are mixed; in a mosaic, what a neighbour does not. */
TEST(mixed_colours_share_what_is_unknown)
{
    float colours[] = {1.0f, -1.0f, 1.0f, 0.5f, /* red of 2 x 2 pixels */
                       1.0f, 1.0f,  0.0f, 1.0f, 0.25f, 1.0f, 1.0f, 1.0f};
    static const float least[] = {0.25f, 0.0f, 0.0f, 0.5f};
    assert_int_equal(hada_colours_weigh(colours, 2, 2, HADA_MOSAIC_NONE), 2 * HADA_COLOURS);
    for (int k = 0; k < 4 * HADA_COLOURS; k++)
        assert_float_equal(colours[k], least[k % 4], 0.0f);
    enum { HIGH = 4, WIDE = 6 };
    float mosaic[HADA_COLOURS * HIGH * WIDE] = {0.0f};
    for (int i = 0; i < HIGH * WIDE; i++)
        mosaic[hada_mosaic_channel(HADA_MOSAIC_RGGB, i / WIDE, i % WIDE) * HIGH * WIDE + i] = i ? 1.0f : -1.0f;
    assert_int_equal(hada_colours_weigh(mosaic, HIGH, WIDE, HADA_MOSAIC_RGGB), HIGH * WIDE - 4);
    for (int i = 0; i < HIGH * WIDE; i++)
        for (int c = 0; c < HADA_COLOURS; c++) {
            const int own = c == hada_mosaic_channel(HADA_MOSAIC_RGGB, i / WIDE, i % WIDE);
            assert_float_equal(mosaic[c * HIGH * WIDE + i], own && (i / WIDE > 1 || i % WIDE > 1) ? 1.0f : 0.0f, 0.0f);
        }
}

/* Cuts off a frame at what nine in ten of its values do not reach. */
static void saturate(hada_image *frame)
{
    const size_t count = hada_image_count(frame);
    SCOPED(hada_image) sorted = {0};
    ASSERT_OK(hada_image_copy(&sorted, frame, err));
    const float most = hada_select_rank(sorted.data, count, count * 9 / 10);
    for (size_t i = 0; i < count; i++)
        frame->data[i] = fminf(frame->data[i], most);
}

/* By linear and by encoded scenes, with exposures that differ besides, with a dark level, which is found as well,
 * with smooth light left in frames, by mosaics, and where values are saturated; none of frames that are not mixed, or
 * whose scenes are grey, or where nobody shall look. */
TEST(mixed_colours_are_found)
{
    static const double left[2][CHANNELS * HADA_SMOOTH_TERMS] = {{2, 0, 1, 1, 0, 0, 1, 0, 1, 0, 0, 0, -1, 0, 0, 1},
                                                                 {-1, 1, 0, 0, 0, 0, 1, -1, 0, 0, 0, 0, 2, 1}};
    static const double none[HADA_COLOUR_MATRIX] = {0.0};
    for (int k = 0; k < 11; k++) {
        const int mixes = k != 3 && k != 7, found = k < 3 || k == 6 || k >= 8;
        DEFAULTS(hada_fit_options, fit);
        pairs set;
        make_pairs(&set, mixes ? mixing : NULL, k == 1 ? HADA_RESPONSE_SRGB : HADA_RESPONSE_LINEAR, k == 4,
                   k == 6 || k == 7);
        for (size_t i = 0; k == 2 && i < hada_image_count(&set.frame[1]); i++)
            set.frame[1].data[i] *= 0.6f;
        for (int i = 0; (k == 6 || k == 7) && i < PAIRS; i++)
            keep_mosaic(&set.frame[i]);
        for (int i = 0; k == 8 && i < PAIRS * CHANNELS * AREA; i++)
            set.frame[i / (CHANNELS * AREA)].data[i % (CHANNELS * AREA)] += 0.05f;
        for (int i = 0; k == 9 && i < PAIRS; i++)
            hada_smooth_add(left[i % 2], 0.01, &set.frame[i]);
        for (int i = 0; k == 10 && i < PAIRS; i++)
            saturate(&set.frame[i]);
        fit.find_colours = k != 5;
        SCOPED(hada_model) *model = learn(&set, &fit);
        const double off = farthest(hada_model_get_info(model)->colour_matrix, found ? mixing : none);
        const double dark = hada_model_get_info(model)->dark;
        print_message("%d: off by %.4f, dark level %.5f\n", k, off, dark);
        assert_true(off < (found ? 0.02 : 1e-12));
        assert_true(k != 8 || fabs(dark - 0.05) < 0.001);
        free_pairs(&set);
    }
}

/* A model that knows the matrix, from a file, makes of mixed frames what one without makes of frames that are not
 * mixed: with a dark level, and where pixels of one channel are saturated, those of the others are left out as well. */
TEST(frames_get_the_colours_of_scenes)
{
    SCOPED(hada_model) * plain, *told, *loaded;
    SCOPED(hada_plan) * usual, *mixed;
    SCOPED(hada_result) pure = {0}, back = {0};
    SCOPED(hada_image) frame, grey;
    DEFAULTS(hada_psf_options, options);
    DEFAULTS(hada_plan_options, how);
    hada_error error = {0};
    pairs set;
    char path[] = "/tmp/hadalens-test-XXXXXX";
    close(mkstemp(path));
    make_pairs(&set, NULL, HADA_RESPONSE_LINEAR, 0, 0);
    options.window_rows = options.window_cols = WINDOW;
    options.psf_dark = 0.0;
    ASSERT_OK(hada_model_from_psf(&plain, context, &set.psf, 1, &distance, &options, err));
    memcpy(options.colour_matrix, mixing, sizeof mixing);
    ASSERT_OK(hada_model_from_psf(&told, context, &set.psf, 1, &distance, &options, err));
    ASSERT_OK(hada_model_save(told, path, err));
    ASSERT_OK(hada_model_load(&loaded, path, err));
    unlink(path);
    assert_memory_equal(hada_model_get_info(loaded)->colour_matrix, mixing, sizeof mixing);
    how.refine_tv = 1e-3;
    how.dark = HADA_DARK_LEVEL;
    how.dark_level = 0.05;
    ASSERT_OK(hada_plan_create(&usual, context, plain, &how, err));
    ASSERT_OK(hada_plan_create(&mixed, context, loaded, &how, err));
    ASSERT_OK(hada_image_copy(&frame, &set.frame[0], err));
    hada_colours_mix(frame.data, AREA, mixing);
    for (size_t i = 0; i < hada_image_count(&frame); i++) {
        frame.data[i] += 0.05f;
        set.frame[0].data[i] += 0.05f;
    }
    ASSERT_OK(hada_plan_run(usual, &set.frame[0], &pure, err));
    ASSERT_OK(hada_plan_run(mixed, &frame, &back, err));
    const size_t count = hada_image_count(&pure.planes[0]);
    assert_true(relative_change(back.planes[0].data, pure.planes[0].data, count) < 1e-3);
    float most = 0.0f; /* of the green channel, which is cut off */
    for (int i = 0; i < AREA; i++)
        most = fmaxf(most, frame.data[AREA + i]);
    for (int i = 0; i < CHANNELS * AREA; i++)
        frame.data[i] = fminf(frame.data[i], 0.9f * most);
    ASSERT_OK(hada_plan_run(mixed, &frame, &back, err));
    assert_true(back.report->saturated_pixels > 5);
    const double off = relative_change(back.planes[0].data, pure.planes[0].data, count);
    print_message("cut off: off by %.4f\n", off);
    assert_true(off < 0.1);
    ASSERT_OK(hada_image_create(&grey, 1, ROWS, COLS, err));
    assert_int_equal(hada_plan_run(mixed, &grey, &back, &error), HADA_ERROR_MODEL);
    free_pairs(&set);
}

/* What a mosaic keeps of mixed frames is nearly as good as what it keeps of frames that are not mixed, and far better
 * than mixed colours; where pixels are saturated, those beside them are left out as well. */
TEST(mosaics_get_the_colours_of_scenes)
{
    SCOPED(hada_model) * plain, *told;
    SCOPED(hada_plan) * usual, *mixed;
    SCOPED(hada_result) result = {0};
    DEFAULTS(hada_psf_options, options);
    DEFAULTS(hada_plan_options, how);
    double off[4];
    pairs set;
    make_pairs(&set, NULL, HADA_RESPONSE_LINEAR, 0, 1);
    options.window_rows = options.window_cols = WINDOW;
    options.psf_dark = 0.0;
    options.mosaic = HADA_MOSAIC_GRBG;
    ASSERT_OK(hada_model_from_psf(&plain, context, &set.psf, 1, &distance, &options, err));
    memcpy(options.colour_matrix, mixing, sizeof mixing);
    ASSERT_OK(hada_model_from_psf(&told, context, &set.psf, 1, &distance, &options, err));
    how.refine_tv = 1e-3;
    ASSERT_OK(hada_plan_create(&usual, context, plain, &how, err));
    ASSERT_OK(hada_plan_create(&mixed, context, told, &how, err));
    for (int k = 0; k < 4; k++) { /* not mixed; mixed, taken for not mixed; mixed; saturated as well */
        SCOPED(hada_image) frame = {0};
        float most = 0.0f;
        ASSERT_OK(hada_image_copy(&frame, &set.frame[0], err));
        if (k)
            hada_colours_mix(frame.data, AREA, mixing);
        keep_mosaic(&frame);
        for (int i = 0; i < AREA; i++)
            most = fmaxf(most, frame.data[i]);
        for (int i = 0; k == 3 && i < AREA; i++)
            frame.data[i] = fminf(frame.data[i], 0.8f * most);
        ASSERT_OK(hada_plan_run(k < 2 ? usual : mixed, &frame, &result, err));
        assert_true((result.report->saturated_pixels > 5) == (k == 3));
        off[k] = relative_change(result.planes[0].data, set.scene[0].data, hada_image_count(&result.planes[0]));
        print_message("%d: off by %.4f\n", k, off[k]);
    }
    assert_true(off[2] < 1.1 * off[0] && off[1] > 1.3 * off[0] && off[3] < off[1]);
    free_pairs(&set);
}

/* One channel, and matrices that cannot be inverted. */
TEST(matrices_that_fit_nothing_are_refused)
{
    SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 9, 5), grey = small_psf(1, ROWS, COLS, 9, 5);
    hada_error error = {0};
    for (int k = 0; k < 3; k++) {
        SCOPED(hada_model) *model = NULL;
        DEFAULTS(hada_psf_options, options);
        options.window_rows = options.window_cols = WINDOW;
        memcpy(options.colour_matrix, mixing, sizeof mixing);
        if (k == 1)
            memcpy(options.colour_matrix, options.colour_matrix + HADA_COLOURS, HADA_COLOURS * sizeof(double));
        if (k == 2)
            options.colour_matrix[4] = NAN;
        assert_int_equal(hada_model_from_psf(&model, context, k ? &psf : &grey, 1, &distance, &options, &error),
                         HADA_ERROR_MODEL);
    }
}

/* Sums remember the matrix of their fit, and are not added to those of another. */
TEST(sums_remember_the_colours)
{
    hada_fit_options options = helpers_fit(1, CHANNELS, &distance, ROWS, COLS, WINDOW), again;
    SCOPED(hada_fitter) * fitter, *other;
    hada_error error = {0};
    pairs set;
    char path[] = "/tmp/hadalens-test-XXXXXX";
    close(mkstemp(path));
    unlink(path);
    make_pairs(&set, mixing, HADA_RESPONSE_LINEAR, 0, 0);
    memcpy(options.colour_matrix, mixing, sizeof mixing);
    SCOPED(hada_dataset) *data = data_of(&set);
    ASSERT_OK(hada_fitter_create(&fitter, context, &options, err));
    ASSERT_OK(hada_fitter_add(fitter, data, err));
    ASSERT_OK(hada_fitter_save_sums(fitter, path, err));
    hada_fit_options_init(&again);
    ASSERT_OK(hada_fit_sums_options(path, &again, err));
    assert_memory_equal(again.colour_matrix, mixing, sizeof mixing);
    options.colour_matrix[0] += 0.01;
    ASSERT_OK(hada_fitter_create(&other, context, &options, err));
    assert_int_equal(hada_fitter_load_sums(other, path, &error), HADA_ERROR_SIZE);
    assert_non_null(strstr(error.message, "colour_matrix"));
    unlink(path);
    free_pairs(&set);
}

/* Smooth light of all frames is found to a tenth of a percent. */
TEST(light_is_found_beside_other_faults)
{
    static const float exposure[PAIRS] = {0.8f, 1.0f, 1.4f, 1.1f};
    static const double light[CHANNELS * HADA_SMOOTH_TERMS] = {5, 3, 0, 0, 0, 0, 4, 0, 2, 0, 0, 0, 3, 0, -2, 0, 1, 0};
    static const double little[] = {0.9, 0.1, 0, 0.05, 0.9, 0.05, 0, 0.1, 0.9};
    for (int k = 0; k < 4; k++) { /* colours not mixed; mixed; matrix and response given; exposures */
        DEFAULTS(hada_fit_options, fit);
        SCOPED(hada_image) added = {0};
        pairs set;
        make_pairs(&set, k == 1 || k == 2 ? little : NULL, HADA_RESPONSE_LINEAR, 0, 0);
        for (int i = 0; i < PAIRS; i++) {
            for (size_t at = 0; k == 3 && at < (size_t)CHANNELS * AREA; at++)
                set.frame[i].data[at] *= exposure[i];
            hada_smooth_add(light, 0.1, &set.frame[i]);
        }
        hada_image window = set.scene[1]; /* and one scene as large as its frame */
        ASSERT_OK(hada_image_crop(&set.scene[1], &window, (WINDOW - ROWS) / 2, (WINDOW - COLS) / 2, ROWS, COLS, err));
        hada_image_destroy(&window);
        memcpy(fit.colour_matrix, little, k == 2 ? sizeof little : 0);
        fit.scene_response = k == 2 ? HADA_RESPONSE_LINEAR : HADA_AUTO;
        SCOPED(hada_model) *model = learn(&set, &fit);
        const hada_image *found = hada_model_get_info(model)->dark_frame;
        ASSERT_OK(hada_image_create(&added, CHANNELS, ROWS, COLS, err));
        hada_smooth_add(light, 0.1, &added);
        assert_true(found && relative_change(found->data, added.data, hada_image_count(&added)) < 0.0015);
        free_pairs(&set);
    }
}

/* But for an exposure of each frame and each channel, which are others' to find. */
TEST(white_balance_is_found)
{
    static const double by[PAIRS][CHANNELS] = {{1.1, 1, 0.8}, {0.9, 1, 1.2}, {1, 1.05, 1}, {1.2, 0.95, 1}};
    for (int k = 0; k < 2; k++) { /* alike; not */
        DEFAULTS(hada_fit_options, fit);
        double *found, left[PAIRS][CHANNELS], row[PAIRS] = {0.0}, column[CHANNELS] = {0.0};
        pairs set;
        make_pairs(&set, NULL, HADA_RESPONSE_LINEAR, 0, 0);
        for (int i = 0; k && i < PAIRS * CHANNELS; i++)
            for (int at = 0; at < AREA; at++)
                set.frame[i / CHANNELS].data[i % CHANNELS * AREA + at] *= (float)by[i / CHANNELS][i % CHANNELS];
        SCOPED(hada_dataset) *data = data_of(&set);
        ASSERT_OK(hada_fit_sizes_from(&fit, data, err));
        fit.boundary = HADA_BOUNDARY_PADDED;
        ASSERT_OK(hada_fit_find_balance(&fit, context, data, &found, err));
        assert_int_equal(found != NULL, k);
        for (int i = 0; k && i < PAIRS * CHANNELS; i++) {
            left[i / CHANNELS][i % CHANNELS] = log(found[i] * by[i / CHANNELS][i % CHANNELS]);
            row[i / CHANNELS] += left[i / CHANNELS][i % CHANNELS] / CHANNELS;
            column[i % CHANNELS] += left[i / CHANNELS][i % CHANNELS] / PAIRS;
        }
        for (int i = 0; k && i < PAIRS * CHANNELS; i++)
            assert_true(fabs(left[i / CHANNELS][i % CHANNELS] - row[i / CHANNELS] - column[i % CHANNELS] +
                             (column[0] + column[1] + column[2]) / CHANNELS) < 0.005);
        free(found);
        free_pairs(&set);
    }
}

FIXTURE(open_device, close_device)
