/* Planes for training: those of a plan that is told the depth, bit for bit. */
#include <hadalens/job.h>

#include "camera_small.h"
#include "model/model.h"
#include "train/planes.h"
#include "train_fixture.h"

enum { CHANNELS = 3, ROWS = 26, COLS = 35, WINDOW_ROWS = 12, WINDOW_COLS = 20, DEPTHS = 3 };

typedef struct planes_case {
    int padded, steps, half;
    double dark, tv;
} planes_case;

static const planes_case cases[] = {
    {0, 5, 0, 0.0, 0},   {1, 4, 0, 0.01, 0},     {0, 0, 0, -1.0, 0},    {1, 0, 1, 0.02, 0},
    {0, 12, 1, -1.0, 0}, {0, 12, 0, 0.01, 3e-3}, {1, 6, 0, -1.0, 1e-3},
};

static hada_model *model_of(hada_context *context, const planes_case *c, hada_image *psfs)
{
    static const double distances[DEPTHS] = {100.0, 200.0, 300.0};
    hada_psf_options options;
    hada_model *model, *half;
    hada_psf_options_init(&options);
    options.window_rows = WINDOW_ROWS;
    options.window_cols = WINDOW_COLS;
    options.boundary = c->padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR;
    options.refine_steps = c->steps;
    options.refine_tv = c->tv;
    options.dark = c->dark;
    ASSERT_OK(hada_model_from_psf(&model, context, psfs, DEPTHS, distances, &options, err));
    if (!c->half)
        return model;
    ASSERT_OK(hada_model_to_half(&half, model, err));
    hada_model_destroy(&model);
    return half;
}

static void planes_are_those_of_a_plan(void **state)
{
    train_device *device = *state;
    hada_image psfs[DEPTHS], scene = small_scene(CHANNELS, WINDOW_ROWS, WINDOW_COLS, 1);
    for (int z = 0; z < DEPTHS; z++)
        psfs[z] = small_psf(CHANNELS, ROWS, COLS, 12, (uint64_t)z + 1);
    for (size_t i = 0; i < HADA_COUNT(cases); i++) {
        hada_model *model = model_of(device->context, &cases[i], psfs);
        hada_image frame = small_frame(&psfs[1], &scene, cases[i].padded, 0.003, i), plane = {0};
        hada_planes *planes;
        size_t bytes;
        const uint64_t before = hada_context_bytes(device->context);
        ASSERT_OK(hada_planes_bytes(device->context, model, &bytes, err));
        ASSERT_OK(hada_planes_create(&planes, device->slot, model, err));
        assert_int_equal(hada_context_bytes(device->context) - before, bytes);
        for (int z = 0; z < DEPTHS; z++) {
            hada_plan *plan;
            hada_plan_options options;
            hada_result result = {0};
            hada_plan_options_init(&options);
            options.occupied = HADA_OCCUPIED_LIST;
            options.occupied_list = &z;
            options.occupied_count = 1;
            ASSERT_OK(hada_plan_create(&plan, device->context, model, &options, err));
            ASSERT_OK(hada_plan_run(plan, &frame, &result, err));
            ASSERT_OK(hada_planes_make(planes, z, &frame, &plane, err));
            assert_int_equal(result.report->refine_steps > 0, cases[i].steps > 0);
            assert_int_equal(hada_image_count(&plane), hada_image_count(&result.planes[z]));
            assert_memory_equal(plane.data, result.planes[z].data, hada_image_count(&plane) * sizeof(float));
            hada_result_destroy(&result);
            hada_plan_destroy(&plan);
        }
        hada_image_destroy(&plane);
        hada_image_destroy(&frame);
        hada_planes_destroy(&planes);
        hada_model_destroy(&model);
    }
    hada_image_destroy(&scene);
    for (int z = 0; z < DEPTHS; z++)
        hada_image_destroy(&psfs[z]);
}

static void what_does_not_fit_is_refused(void **state)
{
    train_device *device = *state;
    hada_model *model = train_model(1, 12, 14, 8, 10, 0, 0);
    hada_planes *planes;
    hada_image frame, plane = {0};
    hada_error error;
    ASSERT_OK(hada_image_create(&frame, 1, 12, 14, err));
    ASSERT_OK(hada_planes_create(&planes, device->slot, model, err));
    assert_int_equal(hada_planes_make(planes, -1, &frame, &plane, &error), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_planes_make(planes, TRAIN_DEPTHS, &frame, &plane, &error), HADA_ERROR_ARGUMENT);
    frame.data[3] = NAN;
    assert_int_equal(hada_planes_make(planes, 0, &frame, &plane, &error), HADA_ERROR_NOT_FINITE);
    frame.rows = 11;
    assert_int_equal(hada_planes_make(planes, 0, &frame, &plane, &error), HADA_ERROR_SIZE);
    assert_null(plane.data);
    hada_image_destroy(&frame);
    hada_planes_destroy(&planes);
    hada_model_destroy(&model);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(planes_are_those_of_a_plan),
        cmocka_unit_test(what_does_not_fit_is_refused),
    };
    return cmocka_run_group_tests(tests, train_open, train_close);
}
