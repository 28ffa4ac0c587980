/* The grid of a classic method's transforms: how small it becomes, and that planes are those of the model's grid. */
#include "camera_small.h"
#include "classic/classic.h"
#include "device_fixture.h"
#include "dispatch/plan.h"
#include "fft/fft_fused.h"
#include "model/model.h"

enum { ROWS = 40, COLS = 48, CHANNELS = 3, DEPTHS = 2 };

/* A spot in each corner of a rectangle about a middle of the sensor, and one within it. */
static hada_image corners(int above, int below, int left, int right)
{
    const int rows[] = {-above, -above, below, below, 0}, cols[] = {-left, right, -left, right, 0};
    hada_image psf;
    ASSERT_OK(hada_image_create(&psf, CHANNELS, ROWS, COLS, err));
    for (int c = 0; c < CHANNELS; c++)
        for (int i = 0; i < 5; i++)
            psf.data[(c * ROWS + ROWS / 2 + rows[i]) * COLS + COLS / 2 + cols[i]] += i < 4 ? 0.15f : 0.4f;
    return psf;
}

static hada_model *model_of(hada_image *psf, int window_rows, int window_cols, hada_boundary boundary)
{
    const double distances[DEPTHS] = {100.0, 200.0};
    hada_model *model;
    DEFAULTS(hada_psf_options, options);
    options.window_rows = window_rows;
    options.window_cols = window_cols;
    options.psf_dark = options.dark = 0;
    options.boundary = boundary;
    ASSERT_OK(hada_model_from_psf(&model, context, psf, DEPTHS, distances, &options, err));
    return model;
}

/* Of the options that were made last. */
static hada_classic_options choice;

static hada_plan_options options_of(hada_method method)
{
    DEFAULTS(hada_plan_options, options);
    hada_classic_options_init(&choice);
    options.classic = &choice;
    choice.method = method;
    choice.iterations = 12;
    options.skip = 0;
    return options;
}

/* Planes of a frame of noise, on the grid that fits and (`whole`) on the model's. */
static void planes_of(const hada_classic_shape *shape, const hada_model *model, float *out, size_t bytes)
{
    static const int list[DEPTHS] = {0, 1};
    const size_t pixels = (size_t)CHANNELS * ROWS * COLS;
    SCOPED_MEMORY float *frame = calloc(pixels, sizeof *frame);
    hada_random random;
    SCOPED(hada_slot) * slot;
    SCOPED(hada_buffer) otf, seen;
    hada_classic *classic;
    hada_classic_camera camera;
    hada_classic_result result;
    hada_random_seed(&random, 3, 0);
    for (size_t i = 0; i < pixels; i++)
        frame[i] = (float)hada_random_uniform(&random);
    ASSERT_OK(hada_slot_create(&slot, context, err));
    ASSERT_OK(hada_buffer_create_from(&seen, slot, frame, pixels * sizeof *frame, "a frame", err));
    ASSERT_OK(hada_classic_optics(&otf, context, shape, model, NULL, DEPTHS, err));
    ASSERT_OK(hada_classic_camera_of(&camera, model, list, DEPTHS, err));
    const hada_refine_data data = {.frame = seen.mem, .otf = otf.mem, .otf_depths = DEPTHS};
    const hada_classic_job job = {
        .data = &data, .camera = &camera, .depths = DEPTHS, .list = list, .brightness = sqrt(1.0 / 3.0)};
    ASSERT_OK(hada_classic_create(&classic, slot, shape, err));
    ASSERT_OK(hada_classic_run(classic, &job, &result, err));
    assert_int_equal(
        clEnqueueReadBuffer(slot->queue, hada_classic_planes(classic), CL_TRUE, 0, bytes, out, 0, NULL, NULL),
        CL_SUCCESS);
    hada_classic_destroy(&classic);
    hada_classic_camera_free(&camera);
}

typedef struct grid_case {
    int above, below, left, right, window_rows, window_cols;
    int rows, cols; /* that transforms need at least */
} grid_case;

static const grid_case cases[] = {
    {10, 10, 12, 12, 16, 16, 40, 48}, /* the frame's own size is the limit */
    {10, 10, 12, 12, 40, 48, 50, 60}, /* window as large as the frame: 39 + 10 + 1, 47 + 12 + 1 */
    {0, 0, 0, 0, 40, 48, 40, 48},     {2, 14, 20, 3, 40, 48, 54, 68},   /* off centre */
    {3, 1, 2, 5, 17, 31, 40, 48},     {20, 19, 24, 23, 40, 48, 60, 72}, /* as far as the sensor measures */
};

TEST(becomes_as_small_as_can_be)
{
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const grid_case *c = &cases[i];
        hada_image psf[DEPTHS] = {corners(c->above, c->below, c->left, c->right), corners(0, 0, 0, 0)};
        hada_model *model = model_of(psf, c->window_rows, c->window_cols, HADA_BOUNDARY_PADDED);
        const hada_model_info *info = hada_model_get_info(model);
        const size_t count = (size_t)(DEPTHS * CHANNELS * c->window_rows * c->window_cols);
        float *small = malloc(count * sizeof *small), *again = malloc(count * sizeof *again),
              *large = malloc(count * sizeof *large);
        for (hada_method method = HADA_METHOD_RL; method <= HADA_METHOD_FISTA; method++) {
            /* pixels that no plane reaches would have Richardson-Lucy divide roundings */
            if (method == HADA_METHOD_RL && c->window_rows < ROWS)
                continue;
            options_of(method);
            hada_classic_shape shape;
            ASSERT_OK(hada_classic_shape_of(info, DEPTHS, &choice, &shape, err));
            planes_of(&shape, model, large, count * sizeof *large);
            ASSERT_OK(hada_classic_fit_grid(&shape, context, model, NULL, DEPTHS, err));
            /* a GPU's transforms round otherwise: what they leave of zeros may count as light, one lag further out */
            const int quick_rows = hada_fft_quick_size(c->rows, 1), quick_cols = hada_fft_quick_size(c->cols, 0);
            const int slack = hada_context_device(context)->kind == HADA_DEVICE_GPU ? 8 : 0;
            assert_in_range(shape.grid_rows, quick_rows, quick_rows + slack);
            assert_in_range(shape.grid_cols, quick_cols, quick_cols + slack);
            assert_true(shape.grid_rows < info->grid_rows && shape.grid_cols < info->grid_cols);
            planes_of(&shape, model, small, count * sizeof *small);
            planes_of(&shape, model, again, count * sizeof *again);
            assert_memory_equal(small, again, count * sizeof *small);
            if (relative_change(small, large, count) > 2e-6)
                fail_msg("case %zu, method %d: %.2g", i, method, relative_change(small, large, count));
        }
        HADA_FREE(small, again, large);
        hada_model_destroy(&model);
        destroy_images(psf, DEPTHS);
    }
}

/* Nothing may be cut that shows: faint light far away counts, roundings do not. */
TEST(faint_light_counts)
{
    static const float faint[] = {1e-3f, 1e-6f, 1e-9f};
    for (int i = 0; i < 3; i++) {
        hada_image psf[DEPTHS] = {corners(5, 5, 5, 5), corners(4, 4, 4, 4)};
        psf[1].data[0] = faint[i]; /* the top left pixel */
        SCOPED(hada_model) *model = model_of(psf, ROWS, COLS, HADA_BOUNDARY_PADDED);
        const hada_plan_options options = options_of(HADA_METHOD_FISTA);
        SCOPED(hada_plan) * plan;
        ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
        const int expected = hada_fft_quick_size(i < 2 ? ROWS - 1 + ROWS / 2 + 1 : ROWS + 5, 1);
        assert_int_equal(plan->setup.config.method.grid_rows, expected);
        destroy_images(psf, DEPTHS);
    }
}

/* Where the planes or the frame are the whole grid, and for methods that live on it. */
TEST(stays_where_it_must)
{
    hada_image psf[DEPTHS] = {corners(5, 5, 5, 5), corners(4, 4, 4, 4)};
    for (int k = 0; k < 4; k++) {
        SCOPED(hada_model) *model = model_of(psf, 16, 16, k == 0 ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED);
        hada_plan_options options = options_of(k == 1   ? HADA_METHOD_ADMM
                                               : k == 2 ? HADA_METHOD_WIENER
                                                        : HADA_METHOD_FISTA);
        choice.support = k == 3 ? HADA_SUPPORT_GRID : HADA_SUPPORT_AUTO;
        SCOPED(hada_plan) * plan;
        ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
        assert_int_equal(plan->setup.config.method.grid_rows, hada_model_get_info(model)->grid_rows);
        assert_int_equal(plan->setup.config.method.grid_cols, hada_model_get_info(model)->grid_cols);
        assert_int_equal(plan->setup.config.method.reach.rows, 0);
    }
    destroy_images(psf, DEPTHS);
}

/* A plan on a smaller grid holds less, as its estimate says. */
TEST(estimates_include_it)
{
    uint64_t bytes[2], host, held;
    for (int wide = 0; wide < 2; wide++) {
        hada_image psf[DEPTHS] = {corners(2, 2, 2, 2), wide ? corners(20, 19, 24, 23) : corners(2, 2, 2, 2)};
        SCOPED(hada_model) *model = model_of(psf, ROWS, COLS, HADA_BOUNDARY_PADDED);
        const hada_plan_options options = options_of(HADA_METHOD_FISTA);
        SCOPED(hada_plan) * plan;
        ASSERT_OK(hada_plan_estimate(context, model, &options, &bytes[wide], &host, err));
        ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
        hada_plan_memory(plan, &held, NULL);
        assert_true(held <= bytes[wide] && held > bytes[wide] / 2);
        destroy_images(psf, DEPTHS);
    }
    assert_true(bytes[0] < bytes[1]);
}

TEST(refuses_broken_models)
{
    hada_image psf[DEPTHS] = {corners(2, 2, 2, 2), corners(2, 2, 2, 2)};
    for (hada_method method = HADA_METHOD_RL; method <= HADA_METHOD_ADMM; method++) {
        SCOPED(hada_model) *model = model_of(psf, ROWS, COLS, HADA_BOUNDARY_PADDED);
        const hada_plan_options options = options_of(method);
        hada_plan *plan;
        model->otf[2 * hada_model_plane(model) + 5] = NAN;
        ASSERT_FAILS(hada_plan_create(&plan, context, model, &options, err), HADA_ERROR_MODEL, "not finite");
    }
    destroy_images(psf, DEPTHS);
}

FIXTURE(open_device, close_device)
