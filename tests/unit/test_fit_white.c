/* Pairs that were cut off: scenes at white are filled in from their frames, frames are left out; scenes in place of
 * others. */
#include <hadalens/task_fit.h>

#include "camera_small.h"
#include "dataset/dataset.h"
#include "device_fixture.h"
#include "fit/fitter.h"
#include "patience.h"

enum { ROWS = 48, COLS = 64, WINDOW = 24, CHANNELS = 3, PAIRS = 5, CUT = 2 };
#define BRIGHTER 3.0f

typedef struct pairs {
    hada_image frame[PAIRS], scene[PAIRS], whole[PAIRS]; /* whole: what scenes were before they were cut off */
} pairs;

static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    const pairs *set = user;
    (void)depth;
    (void)error;
    ASSERT_OK(hada_image_crop(raw, &set->frame[pair], 0, 0, ROWS, COLS, err));
    ASSERT_OK(hada_image_crop(scene, &set->scene[pair], 0, 0, WINDOW, WINDOW, err));
    return HADA_OK;
}

/* The first CUT pairs are exposed longer: their scenes (or frames) lose what is above 1 (or 0.6 of the most). */
static void make_pairs(pairs *set, int scenes_cut, int frames_cut)
{
    SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 9, 5);
    for (int i = 0; i < PAIRS; i++) {
        hada_image *whole = &set->whole[i], *frame = &set->frame[i];
        ASSERT_OK(hada_scene_procedural(whole, 70 + (uint64_t)i, CHANNELS, WINDOW, WINDOW, err));
        for (size_t k = 0; i < CUT && scenes_cut && k < hada_image_count(whole); k++)
            whole->data[k] *= BRIGHTER;
        *frame = small_frame(&psf, whole, 1, 0.002, (uint64_t)i);
        ASSERT_OK(hada_image_crop(&set->scene[i], whole, 0, 0, WINDOW, WINDOW, err));
        for (size_t k = 0; i < CUT && k < hada_image_count(whole); k++)
            set->scene[i].data[k] = fminf(set->scene[i].data[k], 1.0f);
        float most = 0.0f;
        for (size_t k = 0; k < hada_image_count(frame); k++)
            most = fmaxf(most, frame->data[k]);
        for (size_t k = 0; i < CUT && frames_cut && k < hada_image_count(frame); k++)
            frame->data[k] = fminf(BRIGHTER * frame->data[k], 0.6f * most);
    }
}

static void free_pairs(pairs *set)
{
    destroy_images(set->frame, PAIRS);
    destroy_images(set->scene, PAIRS);
    destroy_images(set->whole, PAIRS);
}

static hada_dataset *data_of(pairs *set)
{
    static const double distance = 100.0;
    static const int count = PAIRS;
    hada_dataset *data;
    ASSERT_OK(hada_dataset_create(&data, 1, &distance, &count, read_pair, set, NULL, err));
    return data;
}

TEST(pairs_that_were_cut_off_are_found)
{
    static const hada_left_out kinds[] = {HADA_STAYS, HADA_CUT_OFF, HADA_CONTRADICTS};
    for (int kind = 0; kind < 3; kind++) {
        const hada_fit_options options = helpers_fit(1, CHANNELS, NULL, ROWS, COLS, WINDOW);
        pairs set;
        hada_dataset *sound;
        unsigned char **left_out;
        make_pairs(&set, kind == 1, kind == 2);
        SCOPED(hada_dataset) *data = data_of(&set);
        ASSERT_OK(hada_fit_screen(&sound, &left_out, data, &options, err));
        assert_true((left_out == NULL) == (kinds[kind] == HADA_STAYS));
        for (int i = 0; left_out && i < PAIRS; i++)
            assert_int_equal(left_out[0][i], i < CUT ? kinds[kind] : HADA_STAYS);
        if (left_out)
            assert_int_equal(hada_dataset_get_info(sound)->pairs, PAIRS - CUT);
        hada_fit_left_out_free(&left_out, 1);
        hada_dataset_destroy(&sound);
        free_pairs(&set);
    }
}

static hada_image scene_of(const hada_dataset *data, int pair)
{
    SCOPED(hada_image) raw;
    hada_image scene;
    ASSERT_OK(hada_dataset_read(data, 0, pair, &raw, &scene, err));
    return scene;
}

/* Parts, selections and brighter sets have the scenes that are in place of others, and only those. */
TEST(scenes_in_place_of_others)
{
    static const unsigned char none[PAIRS] = {1, 0, 0, 0, 0};
    static const unsigned char *const leave[] = {none};
    const double gain[PAIRS] = {1, 2, 2, 2, 2};
    const double *const gains[] = {gain};
    pairs set;
    hada_dataset *filled, *some, *bright;
    make_pairs(&set, 1, 0);
    SCOPED(hada_dataset) *data = data_of(&set);
    hada_filled_scene scene = {hada_pair_number(data, 0, 1), set.whole[1]};
    const hada_filled_scenes all = {1, &scene};
    ASSERT_OK(hada_dataset_fill(&filled, data, &all, err));
    ASSERT_OK(hada_dataset_select(&some, filled, leave, err));
    ASSERT_OK(hada_dataset_brighten(&bright, filled, gains, HADA_RESPONSE_LINEAR, err));
    for (int round = 0; round < 2; round++) { /* read, and kept */
        SCOPED(hada_image) cut = scene_of(data, 1);
        SCOPED(hada_image) whole = scene_of(filled, 1);
        SCOPED(hada_image) selected = scene_of(some, 0);
        SCOPED(hada_image) twice = scene_of(bright, 1);
        SCOPED(hada_image) other = scene_of(filled, 2);
        const size_t bytes = hada_image_count(&cut) * sizeof(float);
        assert_memory_equal(cut.data, set.scene[1].data, bytes);
        assert_memory_equal(whole.data, set.whole[1].data, bytes);
        assert_memory_equal(selected.data, set.whole[1].data, bytes);
        assert_memory_equal(other.data, set.scene[2].data, bytes);
        for (size_t k = 0; k < hada_image_count(&cut); k++)
            assert_true(twice.data[k] == 2.0f * set.whole[1].data[k]);
    }
    SCOPED(hada_image) frame = {0};
    ASSERT_OK(hada_pair_load_raw(some, 0, 0, &frame, err));
    assert_memory_equal(frame.data, set.frame[1].data, hada_image_count(&frame) * sizeof(float));
    hada_dataset_destroy(&bright);
    hada_dataset_destroy(&some);
    hada_dataset_destroy(&filled);
    free_pairs(&set);
}

/* The mean square error of the scene of a new frame, over its light. */
static double error_of(pairs *set, int all_pairs, const hada_monitor *monitor)
{
    DEFAULTS(hada_fit_task, task);
    DEFAULTS(hada_plan_options, options);
    SCOPED(hada_dataset) *data = data_of(set);
    SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 9, 5);
    SCOPED(hada_image) scene = {0};
    hada_model *model;
    hada_fit_report *report;
    hada_plan *plan;
    hada_result result = {0};
    task.all_pairs = all_pairs;
    task.monitor = monitor;
    ASSERT_OK(hada_fit_run(&model, &report, context, data, &task, err));
    assert_null(report->left_out);
    hada_fit_report_destroy(&report);
    ASSERT_OK(hada_scene_procedural(&scene, 99, CHANNELS, WINDOW, WINDOW, err));
    SCOPED(hada_image) frame = small_frame(&psf, &scene, 1, 0.002, 99);
    ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
    ASSERT_OK(hada_plan_run(plan, &frame, &result, err));
    double error = 0.0, light = 0.0;
    for (size_t k = 0; k < hada_image_count(&scene); k++) {
        error += pow((double)result.planes[0].data[k] - scene.data[k], 2.0);
        light += pow(scene.data[k], 2.0);
    }
    hada_result_destroy(&result);
    hada_plan_destroy(&plan);
    hada_model_destroy(&model);
    return error / light;
}

/* The camera that is learned with scenes filled in is close to that of the whole scenes. */
TEST(what_was_cut_off_is_filled_in)
{
    pairs set;
    patience of = {.most = -1};
    const hada_monitor monitor = patience_monitor(&of);
    make_pairs(&set, 1, 0);
    const double spoilt = error_of(&set, 1, NULL), filled = error_of(&set, 0, &monitor);
    const int asked = of.asked;
    for (int i = 0; i < CUT; i++)
        memcpy(set.scene[i].data, set.whole[i].data, hada_image_count(&set.whole[i]) * sizeof(float));
    const double whole = error_of(&set, 1, NULL);
    if (!(filled < 0.2 * spoilt) || !(filled < 2.0 * whole))
        fail_msg("errors of %.5f with scenes cut off, %.5f filled in, %.5f with whole ones", spoilt, filled, whole);

    free_pairs(&set);

    /* it can be stopped anywhere */
    make_pairs(&set, 1, 0);
    for (int k = 1; k <= 8; k++) {
        DEFAULTS(hada_fit_task, task);
        SCOPED(hada_dataset) *data = data_of(&set);
        hada_model *model;
        of = (patience){.most = k * (asked - 1) / 8};
        task.monitor = &monitor;
        ASSERT_FAILS(hada_fit_run(&model, NULL, context, data, &task, err), HADA_ERROR_CANCELLED, "");
        assert_null(model);
    }
    free_pairs(&set);
}

FIXTURE(open_device, close_device)
