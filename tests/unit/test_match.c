/* Whether a camera belongs to a frame: right, turned, magnified and unrelated ones, and frames that say nothing. */
#include <hadalens/match.h>

#include "camera_small.h"
#include "device_fixture.h"
#include "model/model.h"

enum { ROWS = 80, COLS = 96, WINDOW = 40, SPOTS = 14 };

/* Soft spots at random places about the axis, magnified; symmetric: each with its three mirror images. */
static hada_image spots(uint64_t seed, double magnification, int symmetric)
{
    hada_image psf;
    hada_random random;
    double total = 0.0;
    ASSERT_OK(hada_image_create(&psf, 1, ROWS, COLS, err));
    hada_random_seed(&random, seed, 3);
    for (int s = 0; s < SPOTS; s++) {
        const double y = magnification * hada_random_range(&random, -0.3, 0.3) * ROWS;
        const double x = magnification * hada_random_range(&random, -0.3, 0.3) * COLS;
        for (int k = 0; k < (symmetric ? 4 : 1); k++)
            for (int row = 1; row < ROWS; row++)
                for (int col = 1; col < COLS; col++) {
                    const double dy = row - ROWS / 2 - (k & 2 ? -y : y), dx = col - COLS / 2 - (k & 1 ? -x : x);
                    psf.data[row * COLS + col] += (float)exp(-0.5 * (dy * dy + dx * dx));
                }
    }
    for (int i = 0; i < ROWS * COLS; i++)
        total += psf.data[i];
    for (int i = 0; i < ROWS * COLS; i++)
        psf.data[i] = (float)(psf.data[i] / total);
    return psf;
}

static hada_match match_pixels(const hada_model *model, const hada_image *frame)
{
    hada_match match = {.size = sizeof match};
    hada_plan *plan;
    hada_pixels pixels;
    hada_pixels_init(&pixels);
    hada_pixels_of_image(&pixels, frame);
    ASSERT_OK(hada_plan_create(&plan, context, model, NULL, err));
    ASSERT_OK(hada_plan_match(plan, &pixels, &match, err));
    hada_plan_destroy(&plan);
    return match;
}

/* A frame that `taker` took, with a camera made of `known` and turned. */
static hada_match match_camera(const hada_image *known, const hada_image *taker, hada_turn turn, hada_boundary boundary,
                               double noise)
{
    const double distance = 100.0;
    hada_image scene = small_scene(1, WINDOW, WINDOW, 4), frame;
    hada_model *model;
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = WINDOW;
    options.boundary = boundary;
    options.psf_dark = 0.0;
    options.turn = turn;
    for (int i = 0; i < WINDOW * WINDOW; i++) /* objects rather than noise */
        scene.data[i] = i / WINDOW % 20 < 7 && i % WINDOW % 13 < 9 ? 0.5f + 0.2f * scene.data[i] : 0.05f;
    frame = small_frame(taker, &scene, boundary == HADA_BOUNDARY_PADDED, noise, 5);
    ASSERT_OK(hada_model_from_psf(&model, context, known, 1, &distance, &options, err));
    const hada_match match = match_pixels(model, &frame);
    hada_model_destroy(&model);
    hada_image_destroy(&scene);
    hada_image_destroy(&frame);
    return match;
}

TEST(turned_cameras_are_found)
{
    static const hada_boundary boundaries[] = {HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED};
    SCOPED(hada_image) psf = spots(1, 1.0, 0);
    for (size_t b = 0; b < HADA_COUNT(boundaries); b++)
        for (int turn = HADA_TURN_NONE; turn <= HADA_TURN_180; turn++) {
            const hada_match match = match_camera(&psf, &psf, (hada_turn)turn, boundaries[b], 1e-4);
            print_message("%s, turn %d: verdict %d, turn %d, factor %.2f, %.4f left\n", b ? "padded" : "circular", turn,
                          match.verdict, match.turn, match.factor, match.unexplained);
            assert_int_equal(match.verdict, turn ? HADA_MATCH_TURNED : HADA_MATCH_BELONGS);
            assert_int_equal(match.turn, turn);
            assert_true(match.magnification == 1.0);
            assert_true(turn ? match.factor > 1.5 : match.factor < 1.0 / 1.5);
        }
}

/* A turned point spread function is the same as one of pixels in the other order about the axis. */
TEST(turns_are_about_the_axis)
{
    SCOPED(hada_image) psf = spots(2, 1.0, 0);
    hada_image turned;
    const double distance = 100.0;
    for (int turn = HADA_TURN_NONE; turn <= HADA_TURN_270; turn++) {
        const int across = (turn & HADA_TURN_TRANSPOSE) != 0, rows = across ? COLS : ROWS, cols = across ? ROWS : COLS;
        SCOPED(hada_model) * model, *expected;
        DEFAULTS(hada_psf_options, options);
        options.psf_dark = 0.0;
        ASSERT_OK(hada_image_create(&turned, 1, rows, cols, err));
        for (int row = 1; row < rows; row++)
            for (int col = 1; col < cols; col++)
                turned.data[(turn & HADA_TURN_FLIP ? rows - row : row) * cols +
                            (turn & HADA_TURN_MIRROR ? cols - col : col)] =
                    psf.data[across ? col * COLS + row : row * COLS + col];
        ASSERT_OK(hada_model_from_psf(&expected, context, &turned, 1, &distance, &options, err));
        options.turn = (hada_turn)turn;
        ASSERT_OK(hada_model_from_psf(&model, context, &psf, 1, &distance, &options, err));
        const size_t count = 2 * hada_model_plane(model);
        assert_int_equal(hada_model_get_info(model)->raw_rows, rows);
        assert_true(relative_change(model->otf, expected->otf, count) < 1e-5);
        hada_image_destroy(&turned);
    }
    DEFAULTS(hada_psf_options, options);
    hada_model *model;
    options.turn = (hada_turn)7;
    ASSERT_FAILS(hada_model_from_psf(&model, context, &psf, 1, &distance, &options, err), HADA_ERROR_ARGUMENT,
                 "no turn 7");
}

TEST(magnified_cameras_are_found)
{
    SCOPED(hada_image) psf = spots(1, 1.0, 0), larger = spots(1, 1.07, 0);
    const hada_match match = match_camera(&psf, &larger, HADA_TURN_NONE, HADA_BOUNDARY_PADDED, 1e-4);
    assert_int_equal(match.verdict, HADA_MATCH_MAGNIFIED);
    assert_true(match.magnification == 1.07);
    assert_true(match.factor > 1.5);
}

TEST(unrelated_cameras_are_told)
{
    for (uint64_t seed = 2; seed < 6; seed++) {
        SCOPED(hada_image) psf = spots(1, 1.0, 0), other = spots(seed, 1.0, 0);
        const hada_match match = match_camera(&psf, &other, HADA_TURN_NONE, HADA_BOUNDARY_PADDED, 1e-4);
        print_message("seed %d: verdict %d, factor %.2f, %.4f left\n", (int)seed, match.verdict, match.factor,
                      match.unexplained);
        assert_int_equal(match.verdict, HADA_MATCH_UNRELATED);
    }
}

/* A camera that is symmetric has no turned ones, but magnified ones beside it. */
TEST(symmetric_cameras_are_not_turned)
{
    SCOPED(hada_image) psf = spots(3, 1.0, 1), other = spots(4, 1.0, 1);
    const hada_match right = match_camera(&psf, &psf, HADA_TURN_180, HADA_BOUNDARY_PADDED, 1e-4);
    const hada_match wrong = match_camera(&psf, &other, HADA_TURN_NONE, HADA_BOUNDARY_PADDED, 1e-4);
    assert_int_equal(right.verdict, HADA_MATCH_BELONGS);
    assert_int_not_equal(wrong.verdict, HADA_MATCH_BELONGS);
    assert_int_not_equal(wrong.verdict, HADA_MATCH_TURNED);
}

TEST(frames_of_nothing_say_nothing)
{
    SCOPED(hada_image) psf = spots(1, 1.0, 0), frame;
    const double distance = 100.0;
    SCOPED(hada_model) * model;
    DEFAULTS(hada_psf_options, options);
    hada_random random;
    ASSERT_OK(hada_model_from_psf(&model, context, &psf, 1, &distance, &options, err));
    ASSERT_OK(hada_image_create(&frame, 1, ROWS, COLS, err));
    hada_match match = match_pixels(model, &frame);
    assert_int_equal(match.verdict, HADA_MATCH_UNKNOWN);
    assert_true(isnan(match.unexplained));
    for (int i = 0; i < ROWS * COLS; i++)
        frame.data[i] = NAN;
    assert_int_equal(match_pixels(model, &frame).verdict, HADA_MATCH_UNKNOWN);
    hada_random_seed(&random, 1, 1);
    for (int i = 0; i < ROWS * COLS; i++)
        frame.data[i] = (float)(0.5 + 0.05 * hada_random_normal(&random));
    assert_int_equal(match_pixels(model, &frame).verdict, HADA_MATCH_UNKNOWN);
}

TEST(wrong_arguments_are_refused)
{
    SCOPED(hada_image) psf = spots(1, 1.0, 0), frame;
    const double distance = 100.0;
    SCOPED(hada_model) * model;
    SCOPED(hada_plan) * plan;
    hada_pixels pixels;
    hada_match match = {.size = sizeof match};
    hada_pixels_init(&pixels);
    ASSERT_OK(hada_model_from_psf(&model, context, &psf, 1, &distance, NULL, err));
    ASSERT_OK(hada_plan_create(&plan, context, model, NULL, err));
    ASSERT_OK(hada_image_create(&frame, 1, ROWS, COLS - 1, err));
    hada_pixels_of_image(&pixels, &frame);
    ASSERT_FAILS(hada_plan_match(plan, &pixels, &match, err), HADA_ERROR_MODEL, "80 x 95");
    ASSERT_FAILS(hada_plan_match(plan, NULL, &match, err), HADA_ERROR_ARGUMENT, "");
    match.size = 0;
    hada_pixels_of_image(&pixels, &psf);
    ASSERT_FAILS(hada_plan_match(plan, &pixels, &match, err), HADA_ERROR_ARGUMENT, "");
}

FIXTURE(open_device, close_device)
