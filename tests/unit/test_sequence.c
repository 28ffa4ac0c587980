/* Frames of a sequence that go on from the one before. */
#include <hadalens/job.h>

#include "camera_small.h"

enum {
    ROWS = 96,
    COLS = 128,
    WINDOW = 48,
    CHANNELS = 3,
    DEPTHS = 2,
    FRAMES = 7,
    STEPS = 14,
    CROPPED_STEPS = 8,
    OBJECT = 10
};
#define NOISE 0.006

typedef struct fixture {
    hada_context *context;
    hada_image psf[DEPTHS];
    hada_model *circular, *padded;
} fixture;

static hada_model *model_of(const fixture *f, hada_boundary boundary)
{
    static const double distances[DEPTHS] = {100.0, 200.0};
    hada_model *model;
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = WINDOW;
    options.boundary = boundary;
    ASSERT_OK(hada_model_from_psf(&model, f->context, f->psf, DEPTHS, distances, &options, err));
    return model;
}

static int setup(void **state)
{
    static fixture f;
    ASSERT_OK(hada_context_create(&f.context, NULL, err));
    for (int z = 0; z < DEPTHS; z++)
        f.psf[z] = small_psf(CHANNELS, ROWS, COLS, 14, (uint64_t)z + 3);
    f.circular = model_of(&f, HADA_BOUNDARY_CIRCULAR);
    f.padded = model_of(&f, HADA_BOUNDARY_PADDED);
    *state = &f;
    return 0;
}

static int teardown(void **state)
{
    fixture *f = *state;
    destroy_images(f->psf, DEPTHS);
    hada_model_destroy(&f->circular);
    hada_model_destroy(&f->padded);
    close_context(&f->context);
    return 0;
}

/* Tiles of random colours, and an object whose left side is at `place`; below 0: none. */
static hada_image scene_of(uint64_t seed, int place)
{
    enum { TILE = 3, TILES = WINDOW / TILE };
    SCOPED(hada_image) tiles = small_scene(CHANNELS, TILES, TILES, seed);
    hada_image scene;
    ASSERT_OK(hada_image_create(&scene, CHANNELS, WINDOW, WINDOW, err));
    for (int c = 0; c < CHANNELS; c++)
        for (int row = 0; row < WINDOW; row++)
            for (int col = 0; col < WINDOW; col++) {
                const int inside = place >= 0 && row >= 20 && row < 20 + OBJECT && col >= place && col < place + OBJECT;
                scene.data[(c * WINDOW + row) * WINDOW + col] =
                    inside ? 1.0f : 0.2f + 0.4f * tiles.data[(c * TILES + row / TILE) * TILES + col / TILE];
            }
    return scene;
}

static hada_image frame_of(const fixture *f, const hada_model *model, const hada_image *scene, int depth, int number)
{
    return small_frame(&f->psf[depth], scene, model == f->padded, NOISE, (uint64_t)number + 1);
}

/* One depth, or both, refined by so many steps. */
static hada_plan_options options_of(int warm, int depths)
{
    static const int list[DEPTHS] = {0, 1};
    DEFAULTS(hada_plan_options, options);
    options.dark = HADA_DARK_NONE;
    options.refine = STEPS;
    options.refine_tv = 4e-3;
    options.scene = HADA_SCENE_PLANES;
    options.occupied = HADA_OCCUPIED_LIST;
    options.occupied_list = list;
    options.occupied_count = depths;
    options.skip = HADA_SKIP_ALL & ~(unsigned)HADA_SKIP_FRAMES;
    options.warm_start = warm;
    return options;
}

static hada_plan *plan_of(const fixture *f, const hada_model *model, int warm, int depths, int steps)
{
    hada_plan_options options = options_of(warm, depths);
    hada_plan *plan;
    options.refine = steps;
    ASSERT_OK(hada_plan_create(&plan, f->context, model, &options, err));
    return plan;
}

static double error_of(const hada_result *result, int depth, const hada_image *scene)
{
    double sum = 0.0;
    for (size_t i = 0; i < hada_image_count(scene); i++) {
        const double error = result->planes[depth].data[i] - scene->data[i];
        sum += error * error;
    }
    return sum / (double)hada_image_count(scene);
}

TEST(a_still_scene_takes_fewer_steps_and_has_less_noise)
{
    const fixture *f = *state;
    SCOPED(hada_image) scene = scene_of(5, -1);
    for (int kind = 0; kind < 3; kind++) {
        const hada_model *model = kind ? f->padded : f->circular;
        const int steps = kind == 1 ? CROPPED_STEPS : STEPS;
        SCOPED(hada_plan) *cold = plan_of(f, model, 0, 1 + kind / 2, steps),
                          *warm = plan_of(f, model, 1, 1 + kind / 2, steps);
        double errors[2] = {0.0, 0.0};
        for (int t = 0; t < FRAMES; t++) {
            SCOPED(hada_image) frame = frame_of(f, model, &scene, 0, t);
            SCOPED(hada_result) anew = {0}, on = {0};
            ASSERT_OK(hada_plan_run(cold, &frame, &anew, err));
            ASSERT_OK(hada_plan_run(warm, &frame, &on, err));
            assert_int_equal(anew.report->refine_steps, steps);
            assert_int_equal(anew.report->warm_started, 0);
            assert_int_equal(on.report->warm_started, t > 0);
            if (!t) {
                assert_true(same_result(&anew, &on));
                continue;
            }
            assert_true(on.report->refine_steps <= 4);
            errors[0] += error_of(&anew, 0, &scene);
            errors[1] += error_of(&on, 0, &scene);
        }
        assert_true(errors[1] <= errors[0]);
    }
}

/* Another scene, and a frame after one that failed, have the bits of frames on their own. */
TEST(a_cut_and_a_failure_begin_anew)
{
    const fixture *f = *state;
    SCOPED(hada_image) first = scene_of(5, -1), second = scene_of(6, -1);
    for (size_t i = 0; i < hada_image_count(&second); i++)
        second.data[i] = 1.0f - second.data[i];
    SCOPED(hada_image) one = frame_of(f, f->circular, &first, 0, 0), other = frame_of(f, f->circular, &second, 0, 1);
    SCOPED(hada_image) broken = frame_of(f, f->circular, &first, 0, 0);
    SCOPED(hada_plan) *cold = plan_of(f, f->circular, 0, 1, STEPS), *warm = plan_of(f, f->circular, 1, 1, STEPS);
    SCOPED(hada_result) expected = {0}, result = {0};
    hada_error failure = {0};
    ASSERT_OK(hada_plan_run(cold, &other, &expected, err));
    ASSERT_OK(hada_plan_run(warm, &one, &result, err));
    ASSERT_OK(hada_plan_run(warm, &other, &result, err));
    assert_int_equal(result.report->warm_started, 0);
    assert_true(same_result(&expected, &result));
    broken.data[9] = NAN;
    assert_int_equal(hada_plan_run(warm, &broken, &result, &failure), HADA_ERROR_NOT_FINITE);
    ASSERT_OK(hada_plan_run(warm, &other, &result, err));
    assert_int_equal(result.report->warm_started, 0);
    assert_true(same_result(&expected, &result));
}

/* How much of what left its place since the frame before is still there, as a part of it. */
static double ghost_of(const hada_result *result, const hada_image *before, const hada_image *now)
{
    double product = 0.0, squares = 0.0;
    for (size_t i = 0; i < hada_image_count(now); i++) {
        const double left = before->data[i] - now->data[i];
        product += left * (result->planes[0].data[i] - now->data[i]);
        squares += left * left;
    }
    return product / squares;
}

/* A plan that begins anew with each frame and one that goes on, what they make of a frame, and how far off it was. */
typedef struct contest {
    hada_plan *cold, *warm;
    hada_result anew, on;
    double errors[2];
} contest;

static contest contest_of(const fixture *f, int padded, int depths, int steps)
{
    const hada_model *model = padded ? f->padded : f->circular;
    return (contest){.cold = plan_of(f, model, 0, depths, steps), .warm = plan_of(f, model, 1, depths, steps)};
}

/* The next frame, of scenes at the first depths; the steps that it took, 0 for the first one. */
static int go_on(contest *c, const hada_image *frame, const hada_image *const *scenes, int depths, int first)
{
    ASSERT_OK(hada_plan_run(c->cold, frame, &c->anew, err));
    ASSERT_OK(hada_plan_run(c->warm, frame, &c->on, err));
    if (first)
        return 0;
    assert_int_equal(c->on.report->warm_started, 1);
    for (int z = 0; z < depths; z++) {
        c->errors[0] += error_of(&c->anew, z, scenes[z]);
        c->errors[1] += error_of(&c->on, z, scenes[z]);
    }
    return c->on.report->refine_steps;
}

static void end_contest(contest *c)
{
    assert_true(c->errors[1] < 1.05 * c->errors[0]);
    hada_result_destroy(&c->anew);
    hada_result_destroy(&c->on);
    hada_plan_destroy(&c->cold);
    hada_plan_destroy(&c->warm);
}

TEST(what_moves_leaves_no_ghost)
{
    const fixture *f = *state;
    for (int padded = 0; padded < 2; padded++) {
        contest c = contest_of(f, padded, 1, STEPS);
        double ghost = 0.0;
        for (int t = 0; t < FRAMES; t++) {
            SCOPED(hada_image) before = scene_of(5, 2 + 4 * (t ? t - 1 : 0)), scene = scene_of(5, 2 + 4 * t);
            SCOPED(hada_image) frame = frame_of(f, padded ? f->padded : f->circular, &scene, 0, t);
            assert_true(go_on(&c, &frame, (const hada_image *[]){&scene}, 1, !t) < STEPS);
            ghost += t ? ghost_of(&c.on, &before, &scene) / (FRAMES - 1) : 0.0;
        }
        assert_true(fabs(ghost) < 0.01); /* of what was there */
        end_contest(&c);
    }
}

/* Smooth light, seen by a camera that points to (row, col). */
static hada_image smooth_scene(double row, double col)
{
    hada_image scene;
    ASSERT_OK(hada_image_create(&scene, CHANNELS, WINDOW, WINDOW, err));
    for (int c = 0; c < CHANNELS; c++)
        for (int i = 0; i < WINDOW; i++)
            for (int j = 0; j < WINDOW; j++) {
                const double y = i + row, x = j + col;
                scene.data[(c * WINDOW + i) * WINDOW + j] =
                    (float)(0.5 + 0.2 * (sin(0.5 * y + c) * cos(0.4 * x) + sin(0.23 * y - 0.31 * x + c)));
            }
    return scene;
}

/* A scene that moves as a whole is followed, in a few steps. */
TEST(a_drift_is_followed)
{
    enum { FOLLOWING_STEPS = 5 };
    const fixture *f = *state;
    for (int padded = 0; padded < 2; padded++) {
        contest c = contest_of(f, padded, 1, padded ? CROPPED_STEPS : STEPS);
        for (int t = 0; t < FRAMES; t++) {
            SCOPED(hada_image) scene = smooth_scene(0.2 * t, 0.3 * t);
            SCOPED(hada_image) frame = frame_of(f, padded ? f->padded : f->circular, &scene, 0, t);
            assert_true(go_on(&c, &frame, (const hada_image *[]){&scene}, 1, !t) <= FOLLOWING_STEPS);
        }
        end_contest(&c);
    }
}

/* A scene in light that flickers takes as few steps as in steady light, where it moves as a whole as well; small
 * changes are not followed at once. */
TEST(light_that_changes_is_followed)
{
    enum { MOST_STEPS = 5, NOT_FOLLOWED = 4 };
    static const double light[FRAMES + 1] = {1.0, 0.9, 0.95, 1.15, 1.151, 1.2, 1.0};
    const fixture *f = *state;
    for (int kind = 0; kind < 5; kind++) {
        const int padded = kind % 2, drifts = kind / 2 == 1;
        contest c = contest_of(f, padded, kind < 4 ? 1 : DEPTHS, padded ? CROPPED_STEPS : STEPS);
        double before = 1.0;
        for (int t = 0; t < FRAMES; t++) {
            SCOPED(hada_image) scene = drifts ? smooth_scene(0.2 * t, 0.3 * t) : scene_of(5, -1);
            for (size_t i = 0; i < hada_image_count(&scene); i++)
                scene.data[i] *= (float)light[t];
            SCOPED(hada_image) frame = frame_of(f, padded ? f->padded : f->circular, &scene, 0, t);
            const int steps = go_on(&c, &frame, (const hada_image *[]){&scene}, 1, !t), small = t == NOT_FOLLOWED;
            assert_true(c.anew.report->gain == 0.0);
            if (!t)
                continue;
            const double gain = c.on.report->gain;
            if (steps > MOST_STEPS ||
                !(small ? gain == 1.0 : fabs(gain / (light[t] / before) - 1.0) < (drifts ? 0.02 : 0.002)))
                fail_msg("kind %d, frame %d: %g for %g, %d steps", kind, t, gain, light[t] / before, steps);
            before = small ? before : light[t];
        }
        assert_true(drifts || c.errors[1] < c.errors[0]);
        end_contest(&c);
    }
}

/* Halves of it at two depths, where the edge between them moves with it, or stays. */
TEST(a_drift_of_several_depths_is_followed)
{
    enum { FOLLOWING_STEPS = 4 };
    const fixture *f = *state;
    for (int kind = 0; kind < 4; kind++) {
        const int padded = kind % 2, stays = kind / 2;
        const hada_model *model = padded ? f->padded : f->circular;
        contest c = contest_of(f, padded, DEPTHS, STEPS);
        for (int t = 0; t < FRAMES; t++) {
            SCOPED(hada_image) near = smooth_scene(0.3 * t, 0.5 * t), far = smooth_scene(0.3 * t, 0.5 * t);
            for (size_t i = 0; i < hada_image_count(&near); i++)
                (((int)i % WINDOW < WINDOW / 2 - (stays ? 0 : t / 2)) ? far : near).data[i] = 0.0f;
            SCOPED(hada_image) frame = frame_of(f, model, &near, 0, t), other = frame_of(f, model, &far, 1, t + 50);
            for (size_t i = 0; i < hada_image_count(&frame); i++)
                frame.data[i] += other.data[i];
            assert_true(go_on(&c, &frame, (const hada_image *[]){&near, &far}, DEPTHS, !t) <= FOLLOWING_STEPS);
        }
        end_contest(&c);
    }
}

/* Frames depend on those before them alone, not on how many are under way. */
TEST(queues_find_the_same)
{
    const fixture *f = *state;
    hada_image frames[FRAMES];
    hada_result results[2][FRAMES] = {{{0}}};
    for (int t = 0; t < FRAMES; t++) {
        SCOPED(hada_image) scene = scene_of(5, t < 3 ? -1 : 4 * t);
        frames[t] = frame_of(f, f->padded, &scene, 0, t);
    }
    for (int queues = 1; queues <= 2; queues++) {
        hada_plan_options options = options_of(1, DEPTHS);
        hada_job *jobs[FRAMES];
        SCOPED(hada_plan) * plan;
        options.queues = queues;
        ASSERT_OK(hada_plan_create(&plan, f->context, f->padded, &options, err));
        assert_int_equal(hada_plan_queues(plan, NULL, 0), 1);
        for (int t = 0; t < FRAMES; t++)
            ASSERT_OK(hada_job_submit(&jobs[t], plan, &frames[t], &results[queues - 1][t], err));
        for (int t = 0; t < FRAMES; t++) {
            ASSERT_OK(hada_job_wait(jobs[t], err));
            hada_job_destroy(&jobs[t]);
        }
    }
    for (int t = 0; t < FRAMES; t++) {
        assert_int_equal(results[1][t].report->warm_started, t > 0);
        assert_true(same_result(&results[0][t], &results[1][t]));
        hada_result_destroy(&results[0][t]);
        hada_result_destroy(&results[1][t]);
    }
    destroy_images(frames, FRAMES);
}

/* Another set of depths, and what no refinement makes, have no past. */
TEST(other_depths_begin_anew)
{
    const fixture *f = *state;
    SCOPED(hada_image) scene = scene_of(5, -1);
    hada_plan_options options = options_of(1, 1);
    options.occupied = HADA_OCCUPIED_AUTO;
    options.occupied_list = NULL;
    options.occupied_count = 0;
    SCOPED(hada_plan) * warm;
    ASSERT_OK(hada_plan_create(&warm, f->context, f->circular, &options, err));
    for (int t = 0; t < 4; t++) {
        SCOPED(hada_image) frame = frame_of(f, f->circular, &scene, t / 2, t);
        SCOPED(hada_result) result = {0};
        ASSERT_OK(hada_plan_run(warm, &frame, &result, err));
        assert_int_equal(result.report->occupied[t / 2], 1);
        assert_int_equal(result.report->warm_started, t % 2);
    }
    options.refine = 0;
    options.occupied = HADA_OCCUPIED_ALL;
    SCOPED(hada_plan) * linear;
    ASSERT_OK(hada_plan_create(&linear, f->context, f->circular, &options, err));
    for (int t = 0; t < 2; t++) {
        SCOPED(hada_image) frame = frame_of(f, f->circular, &scene, 0, t);
        SCOPED(hada_result) result = {0};
        ASSERT_OK(hada_plan_run(linear, &frame, &result, err));
        assert_int_equal(result.report->warm_started, 0);
    }
}

/* Depths are looked for in every third frame of a still scene, and wherever a frame shows something new. */
TEST(a_depth_that_appears_is_found)
{
    const fixture *f = *state;
    SCOPED(hada_image) scene = scene_of(5, -1), more = scene_of(9, 12);
    hada_plan_options options = options_of(1, 1);
    options.occupied = HADA_OCCUPIED_AUTO;
    options.occupied_list = NULL;
    options.occupied_count = 0;
    for (int faint = 0; faint < 2; faint++) {
        SCOPED(hada_plan) * warm, *cold;
        int found = -1, looked = 0;
        options.warm_start = 0;
        ASSERT_OK(hada_plan_create(&cold, f->context, f->circular, &options, err));
        options.warm_start = 1;
        ASSERT_OK(hada_plan_create(&warm, f->context, f->circular, &options, err));
        for (int t = 0; t < 10; t++) {
            SCOPED(hada_image)
            frame = frame_of(f, f->circular, &scene, 0, t), other = frame_of(f, f->circular, &more, 1, t + 50);
            SCOPED(hada_result) result = {0}, anew = {0};
            for (size_t i = 0; t >= 6 && i < hada_image_count(&frame); i++)
                frame.data[i] += (faint ? 0.36f : 0.8f) * other.data[i];
            ASSERT_OK(hada_plan_run(warm, &frame, &result, err));
            looked += t < 6 && result.report->seconds_pursuit > 0.0;
            if (t == 6) {
                ASSERT_OK(hada_plan_run(cold, &frame, &anew, err));
                assert_int_equal(anew.report->occupied[1], 1);
            }
            if (found < 0 && result.report->occupied[1])
                found = t;
        }
        assert_int_equal(looked, 2);
        if (found < 6 || found > (faint ? 8 : 6))
            fail_msg("found in frame %d", found);
    }
}

FIXTURE(setup, teardown)
