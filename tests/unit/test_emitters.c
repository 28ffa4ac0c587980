/* Emitters of a frame, fitted between pixels and depths: hada_plan_emitters(); tables of them against the truth. */
#include <hadalens/emitters.h>
#include <hadalens/task_evaluate.h>

#include "camera_small.h"

enum { SIDE = 96, DEPTHS = 12, SPOTS = 12, EMITTERS = 12, FIELD = 56, WRONG = 20 };

typedef struct fixture {
    hada_context *context;
    hada_model *model, *flat; /* flat: of the first depth alone */
} fixture;

typedef struct point {
    double row, col, depth, light;
} point;

static double pick(unsigned *state)
{
    *state = *state * 1664525U + 1013904223U;
    return (double)(*state >> 8) / 0x1p24;
}

/* Spots that move outward by a quarter of their distance from the axis, from the farthest depth to the nearest; `light`
 * is that of all of them. */
static void add_point(const point *p, hada_image *frame)
{
    const double s = 1.25 - 0.25 * p->depth / (DEPTHS - 1), width = 1.0;
    unsigned seed = 7;
    for (int k = 0; k < SPOTS; k++) {
        const double y = p->row + s * (48.0 * pick(&seed) - 24.0), x = p->col + s * (48.0 * pick(&seed) - 24.0);
        for (int i = 0; i < SIDE * SIDE; i++) {
            const double dy = i / SIDE - y, dx = i % SIDE - x;
            frame->data[i] += (float)(p->light / (SPOTS * 6.283185307 * width * width) *
                                      exp(-(dy * dy + dx * dx) / (2.0 * width * width)));
        }
    }
}

static int setup(void **state)
{
    fixture *f = calloc(1, sizeof *f);
    double distances[DEPTHS];
    hada_image psf[DEPTHS];
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = FIELD;
    options.psf_dark = 0.0;
    ASSERT_OK(hada_context_create(&f->context, NULL, err));
    for (int z = 0; z < DEPTHS; z++) {
        const point axis = {SIDE / 2.0, SIDE / 2.0, z, 1.0};
        distances[z] = 2.0 / (1.0 - 0.5 * z / (DEPTHS - 1));
        ASSERT_OK(hada_image_create(&psf[z], 1, SIDE, SIDE, err));
        add_point(&axis, &psf[z]);
    }
    ASSERT_OK(hada_model_from_psf(&f->model, f->context, psf, DEPTHS, distances, &options, err));
    ASSERT_OK(hada_model_from_psf(&f->flat, f->context, psf, 1, distances, &options, err));
    for (int z = 0; z < DEPTHS; z++)
        hada_image_destroy(&psf[z]);
    *state = f;
    return 0;
}

static int teardown(void **state)
{
    fixture *f = *state;
    hada_model_destroy(&f->model);
    hada_model_destroy(&f->flat);
    hada_context_destroy(&f->context);
    free(f);
    return 0;
}

/* Places that are apart; depth: of all, where it is not negative. */
static void emit(unsigned seed, double depth, point *points, hada_image *frame)
{
    ASSERT_OK(hada_image_create(frame, 1, SIDE, SIDE, err));
    for (int k = 0; k < EMITTERS; k++) {
        const int margin = (SIDE - FIELD) / 2;
        const double row = margin + 7 + 14 * (k / 4) + 4.0 * pick(&seed), /* three rows of four */
            col = margin + 4 + 14 * (k % 4) + 4.0 * pick(&seed), own = (DEPTHS - 1) * pick(&seed),
                     light = 50.0 + 50.0 * pick(&seed);
        points[k] = (point){row, col, depth < 0.0 ? own : depth, light};
        add_point(&points[k], frame);
    }
}

/* In place of a volume: bright voxels where nothing is, and dim ones where the points are. */
static void mislead(hada_result *result, const point *points)
{
    const int margin = (SIDE - FIELD) / 2;
    memset(result->planes[0].data, 0, (size_t)DEPTHS * FIELD * FIELD * sizeof(float));
    for (int k = 0; k < WRONG; k++)
        result->planes[2 + k % 3].data[(2 + 13 * (k / 5)) * FIELD + 1 + 13 * (k % 5)] = 1000.0F;
    for (int k = 0; k < EMITTERS; k++) {
        const point *p = &points[k];
        const int row = (int)lround(p->row) - margin, col = (int)lround(p->col) - margin;
        result->planes[lround(p->depth)].data[row * FIELD + col] = 0.4F;
    }
}

/* misleading: points for mislead(), or NULL for the volume as it is. */
static void find(const fixture *f, const hada_model *model, const hada_image *frame, const hada_image *weights,
                 const point *misleading, hada_emitters **emitters)
{
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) result = {0};
    DEFAULTS(hada_plan_options, options);
    DEFAULTS(hada_pixels, pixels);
    options.scene = HADA_SCENE_VOLUME;
    options.pixel_weights = weights;
    ASSERT_OK(hada_plan_create(&plan, f->context, model, &options, err));
    ASSERT_OK(hada_plan_run(plan, frame, &result, err));
    if (misleading)
        mislead(&result, misleading);
    hada_pixels_of_image(&pixels, frame);
    ASSERT_OK(hada_plan_emitters(emitters, plan, &pixels, &result, NULL, err));
}

/* The emitter that is nearest to a point, with its place in the frame. */
static hada_emitter nearest(const hada_emitters *emitters, const point *p)
{
    hada_emitter best = {.x = NAN};
    double least = INFINITY;
    for (int i = 0; i < emitters->count; i++) {
        hada_emitter one = *emitters->list[i];
        one.x += (SIDE - FIELD) / 2;
        one.y += (SIDE - FIELD) / 2;
        const double off = hypot(one.x - p->col, one.y - p->row);
        if (off < least) {
            least = off;
            best = one;
        }
    }
    return best;
}

static void assert_all_near(hada_emitters **emitters, const point *points)
{
    assert_int_equal((*emitters)->count, EMITTERS);
    for (int k = 0; k < EMITTERS; k++) {
        const hada_emitter one = nearest(*emitters, &points[k]);
        assert_true(hypot(one.x - points[k].col, one.y - points[k].row) < 0.1 && fabs(one.z - points[k].depth) < 0.4);
    }
    hada_memory_destroy(emitters);
}

/* Without noise: to what splines and the law between depths leave. */
TEST(places_between_pixels_and_depths)
{
    const fixture *f = *state;
    SCOPED(hada_image) frame;
    hada_emitters *emitters;
    point points[EMITTERS];
    emit(3, -1.0, points, &frame);
    find(f, f->model, &frame, NULL, NULL, &emitters);
    assert_int_equal(emitters->count, EMITTERS);
    for (int k = 0; k < EMITTERS; k++) {
        const hada_emitter one = nearest(emitters, &points[k]);
        const double mm = 2.0 / (1.0 - 0.5 * one.z / (DEPTHS - 1));
        if (!(hypot(one.x - points[k].col, one.y - points[k].row) < 0.02) || !(fabs(one.z - points[k].depth) < 0.05) ||
            !(fabs(one.amplitude / points[k].light - 1.0) < 0.02) || !(fabs(one.distance_mm / mm - 1.0) < 1e-6))
            fail_msg("%g %g %g %g (%g mm) for %g %g %g %g", one.x, one.y, one.z, one.amplitude, one.distance_mm,
                     points[k].col, points[k].row, points[k].depth, points[k].light);
    }
    for (int i = 1; i < EMITTERS; i++)
        assert_true(emitters->list[i]->amplitude <= emitters->list[i - 1]->amplitude);
    hada_memory_destroy(&emitters);
    assert_null(emitters);
}

/* With noise the errors are as large as they are said to be, and what is left is the noise. */
TEST(errors_are_as_stated)
{
    const fixture *f = *state;
    enum { FRAMES = 4 };
    double squares = 0.0, along = 0.0, light = 0.0, left = 0.0;
    for (unsigned seed = 1; seed <= FRAMES; seed++) {
        SCOPED(hada_image) frame;
        hada_emitters *emitters;
        point points[EMITTERS];
        emit(seed, -1.0, points, &frame);
        float most = 0.0F;
        for (int i = 0; i < SIDE * SIDE; i++)
            most = fmaxf(most, frame.data[i]);
        hada_image_add_noise(&frame, 0.02 * most, seed);
        find(f, f->model, &frame, NULL, NULL, &emitters);
        assert_int_equal(emitters->count, EMITTERS);
        for (int k = 0; k < EMITTERS; k++) {
            const hada_emitter one = nearest(emitters, &points[k]);
            squares += pow((one.x - points[k].col) / one.sd_x, 2.0) + pow((one.y - points[k].row) / one.sd_y, 2.0);
            along += pow((one.z - points[k].depth) / one.sd_z, 2.0);
            light += pow((one.amplitude - points[k].light) / one.sd_amplitude, 2.0);
            left += one.residual / (0.02 * most);
        }
        hada_memory_destroy(&emitters);
    }
    const double number = FRAMES * EMITTERS;
    if (!(squares / (2.0 * number) > 0.6 && squares / (2.0 * number) < 1.6 && along / number > 0.5 &&
          along / number < 1.7 && light / number > 0.5 && light / number < 1.7 && fabs(left / number - 1.0) < 0.05))
        fail_msg("squared errors in units of those stated: %g across, %g along, %g of light; %g of the noise left",
                 squares / (2.0 * number), along / number, light / number, left / number);
}

TEST(noise_has_none)
{
    const fixture *f = *state;
    for (unsigned seed = 1; seed <= 3; seed++) {
        SCOPED(hada_image) frame;
        hada_emitters *emitters;
        ASSERT_OK(hada_image_create(&frame, 1, SIDE, SIDE, err));
        hada_image_add_noise(&frame, 0.02, seed);
        find(f, f->model, &frame, NULL, NULL, &emitters);
        assert_int_equal(emitters->count, 0);
        hada_memory_destroy(&emitters);
    }
}

/* Many are taken at first and dropped, for they have no light; then the true ones stand out of what is left. */
TEST(dropped_ones_make_room)
{
    const fixture *f = *state;
    SCOPED(hada_image) frame;
    hada_emitters *emitters;
    point points[EMITTERS];
    emit(6, -1.0, points, &frame);
    hada_image_add_noise(&frame, 0.01, 3);
    find(f, f->model, &frame, NULL, points, &emitters);
    assert_all_near(&emitters, points);
}

/* Pixels of weight 0 change nothing, and light that all pixels see is no emitter's. */
TEST(bad_pixels_and_background)
{
    const fixture *f = *state;
    SCOPED(hada_image) frame, weights;
    hada_emitters *emitters;
    point points[EMITTERS];
    emit(5, -1.0, points, &frame);
    ASSERT_OK(hada_image_create(&weights, 1, SIDE, SIDE, err));
    for (int i = 0; i < SIDE * SIDE; i++) {
        weights.data[i] = i % 37 ? 1.0F : 0.0F;
        frame.data[i] = i % 37 ? frame.data[i] + 0.05F : 2.0F;
    }
    hada_image_add_noise(&frame, 0.01, 2);
    find(f, f->model, &frame, &weights, NULL, &emitters);
    assert_all_near(&emitters, points);
}

/* A camera of one depth: all are there. */
TEST(one_depth)
{
    const fixture *f = *state;
    SCOPED(hada_image) frame;
    hada_emitters *emitters;
    point points[EMITTERS];
    emit(4, 0.0, points, &frame);
    hada_image_add_noise(&frame, 0.005, 1);
    find(f, f->flat, &frame, NULL, NULL, &emitters);
    assert_int_equal(emitters->count, EMITTERS);
    for (int k = 0; k < EMITTERS; k++) {
        const hada_emitter one = nearest(emitters, &points[k]);
        assert_true(hypot(one.x - points[k].col, one.y - points[k].row) < 0.05);
        assert_true(one.z == 0.0 && one.sd_z == 0.0 && fabs(one.distance_mm - 2.0) < 1e-9);
    }
    hada_memory_destroy(&emitters);
}

TEST(refuses_what_is_no_volume)
{
    const fixture *f = *state;
    SCOPED(hada_image) frame;
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) result = {0};
    DEFAULTS(hada_plan_options, options);
    DEFAULTS(hada_pixels, pixels);
    hada_emitters *emitters = NULL;
    point points[EMITTERS];
    emit(4, 2.0, points, &frame);
    options.scene = HADA_SCENE_PLANES;
    ASSERT_OK(hada_plan_create(&plan, f->context, f->model, &options, err));
    hada_pixels_of_image(&pixels, &frame);
    ASSERT_FAILS(hada_plan_emitters(&emitters, plan, &pixels, &result, NULL, err), HADA_ERROR_ARGUMENT, "nothing");
    ASSERT_OK(hada_plan_run(plan, &frame, &result, err));
    ASSERT_FAILS(hada_plan_emitters(&emitters, plan, &pixels, &result, NULL, err), HADA_ERROR_ARGUMENT,
                 "was taken for planes");
    assert_null(emitters);
}

/* By hand: in frame 0 the nearest true one of a is 1, but then b has none: a goes with 0, at 1.2 pixels, and b with 1,
 * at 0.6 and 0.5 depths; c is 3 depths off. In frame 1 d is alone, and the third true one is missed. */
TEST(tables_are_scored_by_assignment)
{
    char folder[] = "/tmp/hadalens-emitters-XXXXXX", found[64], truth[64];
    assert_non_null(mkdtemp(folder));
    snprintf(found, sizeof found, "%s/found.csv", folder);
    snprintf(truth, sizeof truth, "%s/truth.csv", folder);
    write_whole_text(found, "frame,x,y,z,amplitude\n0,11.2,10,5,1\n0,12.6,10,5.5,1\n0,30,30,8,1\n1,11,10,5,1\n");
    write_whole_text(truth, "z,y,x,frame\r\n5,10,10,0\r\n5,10,12,0\r\n5,30,30,0\r\n");
    hada_evaluate_report *report;
    ASSERT_OK(hada_evaluate_run(&report, found, truth, NULL, err));
    const hada_evaluation *score = hada_evaluate_report_get(report, 0);
    assert_int_equal(score->what, HADA_EVALUATED_EMITTERS);
    assert_int_equal(score->emitters, 4);
    assert_int_equal(score->emitters_truth, 3);
    assert_true(fabs(score->recall - 2.0 / 3.0) < 1e-12 && fabs(score->precision - 0.5) < 1e-12);
    assert_true(fabs(score->f1 - 4.0 / 7.0) < 1e-12 && fabs(score->jaccard - 0.4) < 1e-12);
    assert_true(fabs(score->lateral_rmse - sqrt(0.9)) < 1e-9 && fabs(score->axial_rmse - sqrt(0.125)) < 1e-9);
    hada_evaluate_report_destroy(&report);
    write_whole_text(truth, "x,y\n1,2\n");
    ASSERT_FAILS(hada_evaluate_run(&report, found, truth, NULL, err), HADA_ERROR_FILE_FORMAT, "no column 'z'");
    write_whole_text(truth, "x,y,z\n1,2,3\n1,2\n");
    ASSERT_FAILS(hada_evaluate_run(&report, found, truth, NULL, err), HADA_ERROR_FILE_FORMAT, "line 3");
    remove(found);
    remove(truth);
    remove(folder);
}

FIXTURE(setup, teardown)
