/* Planes for training: those of a plan with given depths, bit for bit, also of a frame that was composed. */
#include "camera_small.h"
#include "model/model.h"
#include "train/examples.h"
#include "train_fixture.h"

enum { CHANNELS = 3, ROWS = 26, COLS = 35, WINDOW_ROWS = 12, WINDOW_COLS = 20, DEPTHS = 3 };

typedef struct planes_case {
    int padded, steps, half;
    double dark, tv;
    int mixes; /* the sensor mixes the scenes' colours */
} planes_case;
static const double mixing[] = {0.75, 0.2, 0.05, 0.15, 0.65, 0.2, 0.05, 0.25, 0.7};

static const planes_case cases[] = {
    {0, 5, 0, 0.0, 0, 0},   {1, 4, 0, 0.01, 0, 0},     {0, 0, 0, -1.0, 0, 0},    {1, 0, 1, 0.02, 0, 0},
    {0, 12, 1, -1.0, 0, 0}, {0, 12, 0, 0.01, 3e-3, 0}, {1, 6, 0, -1.0, 1e-3, 0}, {1, 6, 0, 0.01, 1e-3, 1},
};

static hada_model *model_of(hada_context *context, const planes_case *c, hada_image *psfs)
{
    static const double distances[DEPTHS] = {100.0, 200.0, 300.0};
    hada_model *model, *half;
    DEFAULTS(hada_psf_options, options);
    options.window_rows = WINDOW_ROWS;
    options.window_cols = WINDOW_COLS;
    options.boundary = c->padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR;
    options.refine_steps = c->steps;
    options.refine_tv = c->tv;
    options.dark = c->dark;
    if (c->mixes)
        memcpy(options.colour_matrix, mixing, sizeof mixing);
    ASSERT_OK(hada_model_from_psf(&model, context, psfs, DEPTHS, distances, &options, err));
    if (!c->half)
        return model;
    ASSERT_OK(hada_model_to_half(&half, model, err));
    hada_model_destroy(&model);
    return half;
}

static const hada_composed as_captured = {0};

TEST(planes_are_those_of_a_plan)
{
    net_device *device = *state;
    hada_image psfs[DEPTHS], scene = small_scene(CHANNELS, WINDOW_ROWS, WINDOW_COLS, 1);
    for (int z = 0; z < DEPTHS; z++)
        psfs[z] = small_psf(CHANNELS, ROWS, COLS, 12, (uint64_t)z + 1);
    for (size_t i = 0; i < HADA_COUNT(cases); i++) {
        SCOPED(hada_model) *model = model_of(device->context, &cases[i], psfs);
        SCOPED(hada_image) frame = small_frame(&psfs[1], &scene, cases[i].padded, 0.003, i), plane = {0};
        SCOPED(hada_planes) * planes;
        size_t bytes;
        const uint64_t before = hada_context_bytes(device->context);
        ASSERT_OK(hada_planes_bytes(device->context, model, 0, &bytes, err));
        ASSERT_OK(hada_planes_create(&planes, device->slot, model, 0, 0, err));
        assert_int_equal(hada_context_bytes(device->context) - before, bytes);
        for (int z = 0; z < DEPTHS; z++) {
            SCOPED(hada_result) result = {0};
            DEFAULTS(hada_plan_options, options);
            options.occupied = HADA_OCCUPIED_LIST;
            options.occupied_list = &z;
            options.occupied_count = 1;
            plan_once(device->context, model, &options, &frame, &result);
            ASSERT_OK(hada_planes_make(planes, z, &frame, &as_captured, &plane, err));
            assert_int_equal(result.report->refine_steps > 0, cases[i].steps > 0);
            assert_int_equal(hada_image_count(&plane), hada_image_count(&result.planes[z]));
            assert_memory_equal(plane.data, result.planes[z].data, hada_image_count(&plane) * sizeof(float));
        }
    }
    hada_image_destroy(&scene);
    destroy_images(psfs, DEPTHS);
}

/* A scene at depths 0 and 2 in place of the captured one at depth 1: left half, right half, and a neighbour told. */
static hada_composed halves(const hada_image *scene)
{
    hada_composed out = {.count = DEPTHS, .depth = {0, 1, 2}};
    for (int z = 0; z < DEPTHS; z++) {
        ASSERT_OK(hada_image_create(&out.light[z], CHANNELS, WINDOW_ROWS, WINDOW_COLS, err));
        for (size_t i = 0; i < hada_image_count(scene); i++) {
            const int right = i % WINDOW_COLS >= WINDOW_COLS / 2;
            out.light[z].data[i] = z == 1 ? -scene->data[i] : right == (z == 2) ? 0.8f * scene->data[i] : 0.0f;
        }
    }
    return out;
}

/* What the frame should become, in double precision: what each depth has in addition, convolved with its PSF, as the
 * sensor sees it. */
static double *expected_frame(const hada_image *psfs, const hada_image *frame, const hada_composed *composed,
                              const planes_case *how)
{
    double *out = calloc(hada_image_count(frame), sizeof *out);
    for (size_t i = 0; i < hada_image_count(frame); i++)
        out[i] = frame->data[i];
    for (int z = 0; z < composed->count; z++) {
        SCOPED(hada_image) seen = small_frame(&psfs[z], &composed->light[z], how->padded, 0.0, 0);
        if (how->mixes)
            hada_colours_mix(seen.data, (size_t)ROWS * COLS, mixing);
        for (size_t i = 0; i < hada_image_count(frame); i++)
            out[i] += seen.data[i];
    }
    return out;
}

static void told(hada_context *context, const hada_model *model, const hada_composed *composed, const hada_image *frame,
                 hada_result *result)
{
    DEFAULTS(hada_plan_options, options);
    options.occupied = HADA_OCCUPIED_LIST;
    options.occupied_list = composed->depth;
    options.occupied_count = composed->count;
    plan_once(context, model, &options, frame, result);
}

/* Beside a plane stands what the others hold; 0 where they were not explained together, or the frame is as captured. */
static void check_others(const net_device *device, const hada_model *model, const hada_composed *composed,
                         const hada_image *psfs, const hada_result *result, int padded)
{
    const hada_image scene = small_scene(CHANNELS, WINDOW_ROWS, WINDOW_COLS, 1);
    const size_t values = hada_image_count(&scene);
    const int refined = hada_model_get_info(model)->refine_steps > 0;
    hada_planes *planes;
    SCOPED(hada_image) plane = {0};
    ASSERT_OK(hada_planes_create(&planes, device->slot, model, 1, 1, err));
    for (int alone = 0; alone < 2; alone++) {
        SCOPED(hada_image) frame = small_frame(&psfs[1], &scene, padded, 0.003, 5);
        ASSERT_OK(hada_planes_make(planes, 1, &frame, alone ? &as_captured : composed, &plane, err));
        assert_int_equal(plane.channels, 2 * CHANNELS);
        for (size_t i = 0; i < values; i++) {
            const float sum = result->planes[0].data[i] + result->planes[1].data[i] + result->planes[2].data[i];
            assert_true(plane.data[values + i] == (alone || !refined ? 0.0f : sum - plane.data[i]));
            assert_true(alone || plane.data[i] == result->planes[1].data[i]);
        }
    }
    hada_planes_destroy(&planes);
    hada_image_destroy((hada_image *)&scene);
}

static void check_composed(const net_device *device, const hada_model *model, const hada_image *psfs,
                           const planes_case *how)
{
    const int padded = how->padded;
    const hada_image scene = small_scene(CHANNELS, WINDOW_ROWS, WINDOW_COLS, 1);
    hada_composed composed = halves(&scene);
    hada_planes *planes;
    hada_result result = {0};
    SCOPED(hada_image) plane = {0}, all = {0}, first = {0};
    size_t bytes;
    const uint64_t before = hada_context_bytes(device->context);
    ASSERT_OK(hada_planes_bytes(device->context, model, 1, &bytes, err));
    ASSERT_OK(hada_planes_create(&planes, device->slot, model, 1, 0, err));
    assert_int_equal(hada_context_bytes(device->context) - before, bytes);
    for (int z = 0; z < DEPTHS; z++) {
        SCOPED(hada_image) frame = small_frame(&psfs[1], &scene, padded, 0.003, 5);
        SCOPED_MEMORY double *expected = expected_frame(psfs, &frame, &composed, how);
        ASSERT_OK(hada_planes_make(planes, z, &frame, &composed, &plane, err));
        assert_true(relative_error(frame.data, expected, hada_image_count(&frame)) < 2e-6);
        if (!z)
            told(device->context, model, &composed, &frame, &result);
        assert_memory_equal(plane.data, result.planes[z].data, hada_image_count(&plane) * sizeof(float));
    }
    check_others(device, model, &composed, psfs, &result, padded);
    composed.whole = 1;
    first = small_frame(&psfs[1], &scene, padded, 0.003, 5);
    ASSERT_OK(hada_planes_make(planes, 1, &first, &composed, &all, err));
    for (size_t i = 0; i < hada_image_count(&all); i++)
        assert_true(all.data[i] == result.planes[0].data[i] + result.planes[1].data[i] + result.planes[2].data[i]);
    hada_result_destroy(&result);
    hada_planes_destroy(&planes);
    hada_composed_free(&composed);
    hada_image_destroy((hada_image *)&scene);
}

TEST(composed_frames_are_those_of_their_scene)
{
    static const planes_case how[] = {{0, 8, 0, 0.0, 3e-3, 0},
                                      {1, 5, 0, 0.01, 1e-3, 0},
                                      {0, 4, 1, -1.0, 0, 0},
                                      {1, 0, 0, 0.0, 0, 0},
                                      {0, 8, 0, 0.0, 3e-3, 1}};
    net_device *device = *state;
    hada_image psfs[DEPTHS];
    for (int z = 0; z < DEPTHS; z++)
        psfs[z] = small_psf(CHANNELS, ROWS, COLS, 12, (uint64_t)z + 1);
    for (size_t i = 0; i < HADA_COUNT(how); i++) {
        SCOPED(hada_model) *model = model_of(device->context, &how[i], psfs);
        check_composed(device, model, psfs, &how[i]);
    }
    destroy_images(psfs, DEPTHS);
}

TEST(what_does_not_fit_is_refused)
{
    net_device *device = *state;
    SCOPED(hada_model) *model = train_model(1, 12, 14, 8, 10, 0, 0);
    SCOPED(hada_planes) * planes;
    hada_image frame, plane = {0};
    ASSERT_OK(hada_image_create(&frame, 1, 12, 14, err));
    ASSERT_OK(hada_planes_create(&planes, device->slot, model, 0, 0, err));
    frame.data[3] = NAN;
    ASSERT_FAILS(hada_planes_make(planes, 0, &frame, &as_captured, &plane, err), HADA_ERROR_NOT_FINITE, "");
    assert_null(plane.data);
    hada_image_destroy(&frame);
}

FIXTURE(net_device_open, net_device_close)
