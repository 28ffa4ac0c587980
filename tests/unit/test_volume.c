/* Scenes with light at all depths: reconstruct --scene volume, and when it is found. */
#include "camera_small.h"

enum { SIDE = 96, DEPTHS = 16, SPOTS = 12, EMITTERS = 40, FIELD = 56 };

typedef struct fixture {
    hada_context *context;
    hada_model *model;
    hada_image psf[DEPTHS];
} fixture;

/* A number from 0 to below `most`. */
static int pick(unsigned *state, int most)
{
    *state = *state * 1664525U + 1013904223U;
    return (int)((*state >> 8) % (unsigned)most);
}

/* Spots that move outward by a quarter of their distance from the axis, from the farthest depth to the nearest. */
static void draw_psf(hada_image *psf, int depth)
{
    unsigned seed = 7;
    for (int k = 0; k < SPOTS; k++) {
        const double s = 1.25 - 0.25 * depth / (DEPTHS - 1);
        const double y = SIDE / 2 + s * (pick(&seed, 49) - 24), x = SIDE / 2 + s * (pick(&seed, 49) - 24);
        for (int i = 0; i < SIDE * SIDE; i++) {
            const double dy = i / SIDE - y, dx = i % SIDE - x;
            psf->data[i] += (float)exp(-(dy * dy + dx * dx) / 1.6);
        }
    }
}

static int setup(void **state)
{
    fixture *f = calloc(1, sizeof *f);
    double distances[DEPTHS];
    ASSERT_OK(hada_context_create(&f->context, NULL, err));
    for (int z = 0; z < DEPTHS; z++) {
        distances[z] = 2.0 / (1.0 - 0.5 * z / (DEPTHS - 1));
        ASSERT_OK(hada_image_create(&f->psf[z], 1, SIDE, SIDE, err));
        draw_psf(&f->psf[z], z);
    }
    ASSERT_OK(hada_model_from_psf(&f->model, f->context, f->psf, DEPTHS, distances, NULL, err));
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    fixture *f = *state;
    for (int z = 0; z < DEPTHS; z++)
        hada_image_destroy(&f->psf[z]);
    hada_model_destroy(&f->model);
    hada_context_destroy(&f->context);
    free(f);
    return 0;
}

/* Light of a point, as far as the sensor has it. */
static void add_point(const fixture *f, int depth, int row, int col, hada_image *frame)
{
    for (int i = 0; i < SIDE * SIDE; i++) {
        const int y = i / SIDE - row + SIDE / 2, x = i % SIDE - col + SIDE / 2;
        if (y >= 0 && y < SIDE && x >= 0 && x < SIDE)
            frame->data[i] += f->psf[depth].data[y * SIDE + x];
    }
}

typedef struct point {
    int depth, row, col;
} point;

static void emit(const fixture *f, unsigned seed, point *points, hada_image *frame)
{
    for (int k = 0; k < EMITTERS; k++) {
        const int margin = (SIDE - FIELD) / 2;
        points[k] = (point){pick(&seed, DEPTHS), margin + pick(&seed, FIELD), margin + pick(&seed, FIELD)};
        add_point(f, points[k].depth, points[k].row, points[k].col, frame);
    }
    for (int i = 0; i < SIDE * SIDE; i++)
        frame->data[i] *= 0.25f;
    hada_image_add_noise(frame, 0.01, seed);
}

/* Emitters with most of a neighbourhood's light near their place; some have others before or behind them. */
static int found(const hada_result *result, const point *points)
{
    int count = 0;
    for (int k = 0; k < EMITTERS; k++) {
        double near = 0.0, all = 0.0;
        for (int z = 0; z < DEPTHS; z++)
            for (int i = -1; i <= 1; i++)
                for (int j = -1; j <= 1; j++) {
                    const int at = (points[k].row + i) * SIDE + points[k].col + j;
                    const double light = result->planes[z].data[at];
                    all += light;
                    near += abs(z - points[k].depth) <= 2 ? light : 0.0;
                }
        count += near > 0.7 * all && near > 0.05;
    }
    return count;
}

static void run(const fixture *f, hada_scene scene, const hada_image *weights, const hada_image *frame,
                hada_result *result)
{
    DEFAULTS(hada_plan_options, options);
    options.scene = scene;
    options.pixel_weights = weights;
    plan_once(f->context, f->model, &options, frame, result);
}

/* Emitters at all depths: a volume, whether it is found or asked for, with the same bits, for its iterations go on
 * where those that recognised it ended. */
TEST(emitters_are_a_volume)
{
    const fixture *f = *state;
    SCOPED(hada_image) frame;
    SCOPED(hada_result) of_auto = {0}, asked = {0};
    point points[EMITTERS];
    ASSERT_OK(hada_image_create(&frame, 1, SIDE, SIDE, err));
    emit(f, 3, points, &frame);
    run(f, HADA_SCENE_AUTO, NULL, &frame, &of_auto);
    run(f, HADA_SCENE_VOLUME, NULL, &frame, &asked);
    assert_int_equal(of_auto.report->scene, HADA_SCENE_VOLUME);
    assert_int_equal(asked.report->scene, HADA_SCENE_VOLUME);
    assert_int_equal(of_auto.report->method, HADA_METHOD_RL);
    assert_int_equal(of_auto.report->refine_steps, asked.report->refine_steps);
    assert_int_equal(of_auto.report->occupied_count, DEPTHS);
    assert_true(same_result(&of_auto, &asked));
    if (found(&of_auto, points) < EMITTERS * 17 / 20)
        fail_msg("%d of %d emitters", found(&of_auto, points), EMITTERS);
}

/* A tube of light on a winding path. */
static void add_tube(int number, float *volume)
{
    for (int k = 0; k < 80; k++) {
        const double t = 0.06 * k + number,
                     at[3] = {7.5 + 7 * sin(0.9 * t + number), 48 + 30 * sin((1.7 - 0.1 * number) * t),
                              48 + 30 * cos((1.1 + 0.2 * number) * t)};
        for (int i = 0; i < DEPTHS * SIDE * SIDE; i++) {
            const double dz = i / (SIDE * SIDE) - at[0], dy = i / SIDE % SIDE - at[1], dx = i % SIDE - at[2];
            if (fabs(dy) < 8 && fabs(dx) < 8)
                volume[i] += (float)exp(-dz * dz / 1.2 - (dy * dy + dx * dx) / (4.0 + number));
        }
    }
}

static void see(const fixture *f, const float *volume, hada_image *frame)
{
    for (int i = 0; i < DEPTHS * SIDE * SIDE; i++)
        for (int k = 0; k < SIDE * SIDE && volume[i] > 1e-3f; k++) {
            const int y = k / SIDE - i / SIDE % SIDE + SIDE / 2, x = k % SIDE - i % SIDE + SIDE / 2;
            if (y >= 0 && y < SIDE && x >= 0 && x < SIDE)
                frame->data[k] += 1e-3f * volume[i] * f->psf[i / (SIDE * SIDE)].data[y * SIDE + x];
        }
    hada_image_add_noise(frame, 0.01, 5);
}

/* What is wrong with planes of any brightness, of the truth. */
static double wrong(const hada_result *result, const float *truth)
{
    double both = 0.0, own = 0.0, all = 0.0;
    for (int i = 0; i < DEPTHS * SIDE * SIDE; i++) {
        const double x = result->planes[i / (SIDE * SIDE)].data[i % (SIDE * SIDE)];
        both += x * truth[i];
        own += x * x;
        all += (double)truth[i] * truth[i];
    }
    return 1.0 - both * both / (own * all);
}

/* Light that is spread over all depths: found, with the same bits as where it is asked for, and better than
 * Richardson-Lucy's, which takes noise for light. */
TEST(tissue_is_a_volume)
{
    const fixture *f = *state;
    SCOPED(hada_image) frame;
    SCOPED(hada_result) of_auto = {0}, asked = {0}, lucy = {0};
    SCOPED(hada_plan) * plan;
    DEFAULTS(hada_plan_options, options);
    DEFAULTS(hada_classic_options, classic);
    SCOPED_MEMORY float *truth = calloc((size_t)DEPTHS * SIDE * SIDE, sizeof *truth);
    ASSERT_OK(hada_image_create(&frame, 1, SIDE, SIDE, err));
    for (int k = 0; k < 9; k++)
        add_tube(k, truth);
    see(f, truth, &frame);
    run(f, HADA_SCENE_AUTO, NULL, &frame, &of_auto);
    run(f, HADA_SCENE_VOLUME, NULL, &frame, &asked);
    classic.method = HADA_METHOD_RL;
    classic.iterations = 30;
    options.classic = &classic;
    ASSERT_OK(hada_plan_create(&plan, f->context, f->model, &options, err));
    ASSERT_OK(hada_plan_run(plan, &frame, &lucy, err));
    assert_int_equal(of_auto.report->scene, HADA_SCENE_VOLUME);
    for (int z = 0; z < DEPTHS; z++)
        assert_memory_equal(of_auto.planes[z].data, asked.planes[z].data, sizeof(float) * SIDE * SIDE);
    if (wrong(&asked, truth) > 0.8 * wrong(&lucy, truth))
        fail_msg("%.3f is wrong, of Richardson-Lucy %.3f", wrong(&asked, truth), wrong(&lucy, truth));
}

/* Pixels without a weight have no part in it, in the first frame of a plan as in any other. */
TEST(volumes_use_weights)
{
    const fixture *f = *state;
    SCOPED(hada_image) frame, weights;
    SCOPED(hada_result) of_auto = {0}, asked = {0};
    point points[EMITTERS];
    ASSERT_OK(hada_image_create(&frame, 1, SIDE, SIDE, err));
    ASSERT_OK(hada_image_create(&weights, 1, SIDE, SIDE, err));
    emit(f, 3, points, &frame);
    for (int i = 0; i < SIDE * SIDE; i++) {
        weights.data[i] = i % 41 ? 1.0f : 0.0f;
        frame.data[i] = i % 41 ? frame.data[i] : 0.3f;
    }
    run(f, HADA_SCENE_AUTO, &weights, &frame, &of_auto);
    run(f, HADA_SCENE_VOLUME, &weights, &frame, &asked);
    assert_int_equal(of_auto.report->scene, HADA_SCENE_VOLUME);
    assert_true(same_result(&of_auto, &asked));
    if (found(&of_auto, points) < EMITTERS * 17 / 20)
        fail_msg("%d of %d emitters", found(&of_auto, points), EMITTERS);
}

/* A photograph at one depth, and a plan's frame after a volume: planes, as without volumes. */
TEST(a_plane_is_none)
{
    const fixture *f = *state;
    SCOPED(hada_image) volume, flat, texture;
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) first = {0}, then = {0}, planes = {0};
    point points[EMITTERS];
    ASSERT_OK(hada_image_create(&volume, 1, SIDE, SIDE, err));
    emit(f, 4, points, &volume);
    ASSERT_OK(hada_image_create(&flat, 1, SIDE, SIDE, err));
    ASSERT_OK(hada_scene_procedural(&texture, 5, 1, FIELD, FIELD, err));
    for (int i = 0; i < SIDE * SIDE; i++)
        for (int k = 0; k < FIELD * FIELD; k++) {
            const int margin = (SIDE - FIELD) / 2, y = i / SIDE - margin - k / FIELD + SIDE / 2,
                      x = i % SIDE - margin - k % FIELD + SIDE / 2;
            if (y >= 0 && y < SIDE && x >= 0 && x < SIDE)
                flat.data[i] += 0.002f * texture.data[k] * f->psf[9].data[y * SIDE + x];
        }
    hada_image_add_noise(&flat, 0.002, 6);
    ASSERT_OK(hada_plan_create(&plan, f->context, f->model, NULL, err));
    ASSERT_OK(hada_plan_run(plan, &volume, &first, err));
    ASSERT_OK(hada_plan_run(plan, &flat, &then, err));
    run(f, HADA_SCENE_PLANES, NULL, &flat, &planes);
    assert_int_equal(first.report->scene, HADA_SCENE_VOLUME);
    assert_int_equal(then.report->scene, HADA_SCENE_PLANES);
    assert_true(then.report->occupied_count < DEPTHS && then.report->occupied[9]);
    assert_int_equal(then.report->method, HADA_METHOD_MODEL);
}

/* Memory that a volume takes is said, and given back; where there is too little, there is none. */
TEST(volumes_are_planned)
{
    const fixture *f = *state;
    const uint64_t memory = f->context->info.memory_bytes, before = hada_context_bytes(f->context);
    SCOPED(hada_image) frame;
    SCOPED(hada_result) result = {0};
    point points[EMITTERS];
    uint64_t without, with;
    ASSERT_OK(hada_image_create(&frame, 1, SIDE, SIDE, err));
    emit(f, 8, points, &frame);
    for (int little = 0; little < 2; little++) {
        hada_plan *plan;
        ASSERT_OK(hada_plan_create(&plan, f->context, f->model, NULL, err));
        hada_plan_memory(plan, &without, NULL);
        if (little)
            f->context->info.memory_bytes = without / 3 * 4 + 4000000;
        ASSERT_OK(hada_plan_run(plan, &frame, &result, err));
        hada_plan_memory(plan, &with, NULL);
        assert_true(with == hada_context_bytes(f->context) - before);
        assert_int_equal(result.report->scene == HADA_SCENE_VOLUME, !little);
        assert_true(little ? with == without : with > without);
        hada_plan_destroy(&plan);
        f->context->info.memory_bytes = memory;
        assert_true(hada_context_bytes(f->context) == before);
    }
}

TEST(refuses_a_method_beside_it)
{
    const fixture *f = *state;
    hada_plan *plan;
    DEFAULTS(hada_plan_options, options);
    DEFAULTS(hada_classic_options, classic);
    classic.method = HADA_METHOD_FISTA;
    options.scene = HADA_SCENE_VOLUME;
    options.classic = &classic;
    ASSERT_FAILS(hada_plan_create(&plan, f->context, f->model, &options, err), HADA_ERROR_ARGUMENT,
                 "options.scene volume");
    options.classic = NULL;
    options.scene = (hada_scene)(HADA_SCENE_VOLUME + 1);
    ASSERT_FAILS(hada_plan_create(&plan, f->context, f->model, &options, err), HADA_ERROR_ARGUMENT, "HADA_SCENE_");
}

FIXTURE(setup, teardown)
