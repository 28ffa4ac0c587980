/* Scenes with light at all depths: found, asked for, and planes that are none. */
#include "camera_small.h"

enum { SIDE = 64, FIELD = 32, DEPTHS = 16, FLAT = 9 };

/* Spots that move outward by a half of their distance from the axis. */
static hada_image psf_of(int depth)
{
    hada_image psf = {0};
    hada_random random;
    hada_random_seed(&random, 3, 0);
    ASSERT_OK(hada_image_create(&psf, 1, SIDE, SIDE, err));
    for (int k = 0; k < 9; k++) {
        const double s = 1.5 - 0.5 * depth / (DEPTHS - 1), y = SIDE / 2 + s * hada_random_range(&random, -16, 16),
                     x = SIDE / 2 + s * hada_random_range(&random, -16, 16);
        for (int i = 0; i < SIDE * SIDE; i++)
            psf.data[i] += (float)exp(-(pow(i / SIDE - y, 2) + pow(i % SIDE - x, 2)) / 1.5);
    }
    return psf;
}

/* Sixteen emitters, each at a depth of its own, are a volume; its iterations go on where those that recognised it
 * ended, to the same bits. A textured plane is none, on the same plan. */
TEST(emitters_are_a_volume)
{
    hada_image psf[DEPTHS], frame[2] = {{0}, {0}};
    double distances[DEPTHS];
    SCOPED(hada_context) * context;
    SCOPED(hada_model) * model;
    SCOPED(hada_plan) * plan, *told;
    SCOPED(hada_result) volume = {0}, asked = {0}, plane = {0};
    DEFAULTS(hada_plan_options, options);
    ASSERT_OK(hada_context_create(&context, NULL, err));
    for (int k = 0; k < 2; k++)
        ASSERT_OK(hada_image_create(&frame[k], 1, SIDE, SIDE, err));
    for (int z = 0; z < DEPTHS; z++) {
        distances[z] = 2.0 / (1.0 - 0.5 * z / (DEPTHS - 1));
        psf[z] = psf_of(z);
        for (int k = 0; k < 2; k++) {
            SCOPED(hada_image) scene = small_scene(1, FIELD, FIELD, 5);
            for (int i = 0; i < FIELD * FIELD; i++) /* emitters far from each other, or a plane */
                scene.data[i] *= k ? z == FLAT : i == (z * 7 % DEPTHS * 2 + 1) * FIELD + z * 2;
            SCOPED(hada_image) part = small_frame(&psf[z], &scene, 1, 0.002, (uint64_t)z);
            for (int i = 0; i < SIDE * SIDE; i++)
                frame[k].data[i] += part.data[i];
        }
    }
    ASSERT_OK(hada_model_from_psf(&model, context, psf, DEPTHS, distances, NULL, err));
    ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
    options.scene = HADA_SCENE_VOLUME;
    ASSERT_OK(hada_plan_create(&told, context, model, &options, err));
    ASSERT_OK(hada_plan_run(plan, &frame[0], &volume, err));
    ASSERT_OK(hada_plan_run(plan, &frame[1], &plane, err));
    ASSERT_OK(hada_plan_run(told, &frame[0], &asked, err));
    assert_int_equal(volume.report->scene, HADA_SCENE_VOLUME);
    assert_int_equal(asked.report->scene, HADA_SCENE_VOLUME);
    assert_int_equal(plane.report->scene, HADA_SCENE_PLANES);
    assert_int_equal(plane.report->occupied_count, 1);
    for (int z = 0; z < DEPTHS; z++)
        assert_memory_equal(volume.planes[z].data, asked.planes[z].data, sizeof(float) * SIDE * SIDE);
    destroy_images(psf, DEPTHS);
    destroy_images(frame, 2);
}
