/* Transfer functions where the sensor crops: against the double reference, nearer to the truth than one pass, the same
 * bits whether pairs stay on the device, and what is refused. */
#include "camera_small.h"
#include "fit/coarse.h"
#include "fit/cropped.h"
#include "fit/fitter.h"
#include "image/pixels.h"
#include "image/statistics.h"
#include "patience.h"
#include "ref/ref_fft.h"
#include "ref/ref_filter.h"
#include "ref/ref_fit.h"
#include "ref/ref_fit_cropped.h"

enum { ROWS = 36, COLS = 44, WINDOW = 15, DEPTHS = 2, CHANNELS = 2, PAIRS = 4, SPOTS = 12 };
enum { TALL = ROWS + WINDOW - 1, WIDE = COLS + WINDOW - 1, AREA = ROWS * COLS };
static const double distances[] = {100.0, 300.0};

typedef struct fixture {
    hada_context *context;
    hada_image psf[DEPTHS], scene[DEPTHS][PAIRS], frame[DEPTHS][PAIRS];
} fixture;

/* Spots up to `reach` of the half sensor from the axis: with 1 the outermost ones have half of their light beyond it.
 */
static hada_image spots(double reach, uint64_t seed)
{
    hada_image psf;
    hada_random random;
    ASSERT_OK(hada_image_create(&psf, CHANNELS, TALL, WIDE, err));
    for (int c = 0; c < CHANNELS; c++) {
        hada_random_seed(&random, seed, 0); /* colours are cast alike */
        for (int i = 0; i < SPOTS; i++) {
            const int row = TALL / 2 + (int)(reach * ROWS / 2 * hada_random_range(&random, -1.0, 1.0));
            const int col = WIDE / 2 + (int)(reach * COLS / 2 * hada_random_range(&random, -1.0, 1.0));
            psf.data[(c * TALL + row) * WIDE + col] += (float)hada_random_range(&random, 0.04, 0.12);
        }
    }
    return psf;
}

/* A scene with the power of photographs at low frequencies: a ramp and squares. */
static hada_image squares(uint64_t seed)
{
    hada_image scene;
    hada_random random;
    ASSERT_OK(hada_image_create(&scene, CHANNELS, WINDOW, WINDOW, err));
    hada_random_seed(&random, seed, 3);
    const float base = (float)hada_random_range(&random, 0.1, 0.5);
    for (size_t i = 0; i < hada_image_count(&scene); i++)
        scene.data[i] = base + 0.02f * (float)(i % WINDOW) + 0.02f * (float)hada_random_normal(&random);
    for (int k = 0; k < 8; k++) {
        const int c = k % CHANNELS, size = 3 + (int)hada_random_below(&random, 4);
        const int row = (int)hada_random_below(&random, (uint32_t)(WINDOW - size)),
                  col = (int)hada_random_below(&random, (uint32_t)(WINDOW - size));
        const float value = (float)hada_random_range(&random, 0.1, 1.0);
        for (int i = 0; i < size * size; i++)
            scene.data[(c * WINDOW + row + i / size) * WINDOW + col + i % size] = value;
    }
    return scene;
}

static hada_image expose(const hada_image *psf, const hada_image *scene, uint64_t seed)
{
    static const double noise = 0.002;
    hada_image frame;
    hada_random random;
    double seen[AREA];
    float whole[AREA];
    ASSERT_OK(hada_image_create(&frame, CHANNELS, ROWS, COLS, err));
    hada_random_seed(&random, seed, 7);
    for (int c = 0; c < CHANNELS; c++) {
        memset(seen, 0, sizeof seen);
        memset(whole, 0, sizeof whole);
        for (int i = 0; i < WINDOW * WINDOW; i++)
            whole[((ROWS - WINDOW) / 2 + i / WINDOW) * COLS + (COLS - WINDOW) / 2 + i % WINDOW] =
                scene->data[c * WINDOW * WINDOW + i];
        hada_ref_convolve_crop(ROWS, COLS, whole, TALL, WIDE, psf->data + (size_t)c * TALL * WIDE, seen);
        for (int i = 0; i < AREA; i++)
            frame.data[c * AREA + i] = (float)(seen[i] + noise * hada_random_normal(&random));
    }
    return frame;
}

static void set_up(fixture *f, double reach)
{
    ASSERT_OK(hada_context_create(&f->context, NULL, err));
    for (int z = 0; z < DEPTHS; z++) {
        f->psf[z] = spots(reach / (1.0 + 0.1 * z), (uint64_t)z + 1); /* smaller from afar */
        for (int i = 0; i < PAIRS; i++) {
            f->scene[z][i] = squares((uint64_t)(10 * z + i));
            f->frame[z][i] = expose(&f->psf[z], &f->scene[z][i], (uint64_t)(10 * z + i));
        }
    }
}

/* Two cameras: with the first the sensor crops light, with the second no light of a scene reaches the border. */
static int set_up_both(void **state)
{
    static fixture cameras[2];
    *state = cameras;
    set_up(&cameras[0], 1.0);
    set_up(&cameras[1], 0.5);
    return 0;
}

static void tear_down(fixture *f)
{
    destroy_images(f->psf, DEPTHS);
    destroy_images(f->scene[0], DEPTHS * PAIRS);
    destroy_images(f->frame[0], DEPTHS * PAIRS);
    close_context(&f->context);
}

static int tear_down_both(void **state)
{
    tear_down(*state);
    tear_down((fixture *)*state + 1);
    return 0;
}

static hada_fit_options options_of(hada_boundary boundary, int passes, int refine_steps)
{
    hada_fit_options options = helpers_fit(DEPTHS, CHANNELS, distances, ROWS, COLS, WINDOW);
    options.boundary = boundary;
    options.crop_passes = passes;
    options.refine_steps = refine_steps;
    return options;
}

static hada_fitter *fitter_of(fixture *f, hada_boundary boundary, int passes, int refine_steps)
{
    const hada_fit_options options = options_of(boundary, passes, refine_steps);
    hada_fitter *fitter;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS; i++)
            ASSERT_OK(hada_fitter_add_pair(fitter, z, &f->frame[z][i], &f->scene[z][i], err));
    return fitter;
}

typedef struct shower {
    fixture *f;
    int shown, swap; /* swap: another pair in the first one's place */
} shower;

static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    shower *at = user;
    (void)error;
    at->shown++;
    const int number = at->swap && pair == 0 ? 1 : pair;
    ASSERT_OK(hada_image_crop(raw, &at->f->frame[depth][number], 0, 0, ROWS, COLS, err));
    ASSERT_OK(hada_image_crop(scene, &at->f->scene[depth][number], 0, 0, WINDOW, WINDOW, err));
    return HADA_OK;
}

/* A data set that keeps nothing, so that every look at a pair reads it. */
static hada_dataset *shown_by(shower *at, int pairs)
{
    const int counts[DEPTHS] = {pairs, pairs};
    hada_dataset *data;
    DEFAULTS(hada_dataset_options, options);
    options.cache_bytes = 0;
    ASSERT_OK(hada_dataset_create(&data, DEPTHS, distances, counts, read_pair, at, &options, err));
    return data;
}

static hada_status learn_cropped(hada_fitter *fitter, shower *at, hada_error *error)
{
    SCOPED(hada_dataset) *data = shown_by(at, PAIRS);
    return hada_fit_learn_cropped(fitter, data, error);
}

/* The truth of a depth and channel on the grid of a fit. */
static void truth(const fixture *f, const hada_fit_grid *grid, int z, int c, double *otf)
{
    const int rows = grid->info.grid_rows, cols = grid->info.grid_cols;
    SCOPED_MEMORY double *image = calloc((size_t)rows * (size_t)cols, sizeof *image);
    for (int row = 0; row < TALL; row++)
        for (int col = 0; col < WIDE; col++)
            image[(row - TALL / 2 + rows) % rows * cols + (col - WIDE / 2 + cols) % cols] +=
                f->psf[z].data[(c * TALL + row) * WIDE + col];
    ASSERT_OK(hada_ref_fft_forward(image, rows, cols, otf, err));
}

/* The relative error of a model's transfer functions. */
static double error_of(const fixture *f, const hada_fit_grid *grid, const hada_model *model)
{
    const size_t plane = hada_model_plane(model);
    double *otf = malloc(2 * plane * sizeof *otf), error = 0.0;
    for (int z = 0; z < DEPTHS; z++)
        for (int c = 0; c < CHANNELS; c++) {
            truth(f, grid, z, c, otf);
            error += relative_error(model->otf + (size_t)(z * CHANNELS + c) * plane * 2, otf, 2 * plane);
        }
    free(otf);
    return error / (DEPTHS * CHANNELS);
}

static hada_model *learn(fixture *f, int passes, double *error, int *shown)
{
    SCOPED(hada_fitter) *fitter = fitter_of(f, HADA_BOUNDARY_PADDED, passes, 0);
    hada_model *model;
    shower at = {.f = f};
    ASSERT_OK(learn_cropped(fitter, &at, err));
    ASSERT_OK(hada_fit_solve(fitter, &model, err));
    if (error)
        *error = error_of(f, &fitter->grid, model);
    if (shown)
        *shown = at.shown;
    return model;
}

/* The error of what is learned with such options, on their grid. */
static void learn_on(fixture *f, const hada_fit_options *options, double *error)
{
    SCOPED(hada_fitter) * fitter;
    SCOPED(hada_model) * model;
    shower at = {.f = f};
    ASSERT_OK(hada_fitter_create(&fitter, f->context, options, err));
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS; i++)
            ASSERT_OK(hada_fitter_add_pair(fitter, z, &f->frame[z][i], &f->scene[z][i], err));
    ASSERT_OK(learn_cropped(fitter, &at, err));
    ASSERT_OK(hada_fit_solve(fitter, &model, err));
    *error = error_of(f, &fitter->grid, model);
}

/* Every third value of a frame has another weight than 1. */
static void weigh_some(float weight, float *weights, size_t count)
{
    for (size_t k = 0; k < count; k++)
        weights[k] = k % AREA % 3 == 1 ? weight : 1.0f;
}

/* What the reference makes of a channel of the first depth. */
static void expect(const fixture *f, const hada_fit_grid *grid, int c, double trust, int iterations, float weight,
                   double *otf, double *left)
{
    static float weights[AREA];
    static const double lengths[] = {1.0, 3.0, 1.0, 1.0, 3.0, 1.0};
    const hada_geometry *at = &grid->geometry;
    const hada_ref_grid sizes = {grid->info.grid_rows, grid->info.grid_cols, at->raw_row, at->raw_col, ROWS, COLS,
                                 at->window_row,       at->window_col,       WINDOW,      WINDOW};
    const size_t plane = hada_model_info_plane(&grid->info);
    double *x[PAIRS], *b = calloc(2 * plane, sizeof *b), *sums = calloc(plane * HADA_REF_FIT_SUMS, sizeof *sums);
    const float *frames[PAIRS];
    double mean = 0.0;
    for (int i = 0; i < PAIRS; i++) {
        const float *scene = f->scene[0][i].data + c * WINDOW * WINDOW;
        frames[i] = f->frame[0][i].data + c * AREA;
        x[i] = calloc(2 * plane, sizeof *x[i]);
        ASSERT_OK(hada_ref_grid_forward(&sizes, frames[i], at->raw_row, at->raw_col, ROWS, COLS, b, err));
        ASSERT_OK(hada_ref_grid_forward(&sizes, scene, at->window_row, at->window_col, WINDOW, WINDOW, x[i], err));
        hada_ref_fit_pair(x[i], b, plane, 1.0, sums);
        for (int k = 0; k < WINDOW * WINDOW; k++)
            mean += (double)scene[k] * scene[k];
    }
    weigh_some(weight, weights, AREA);
    const hada_ref_fit_cropped fit = {.grid = &sizes,
                                      .x = (const double *const *)x,
                                      .b = frames,
                                      .weights = weight != 1.0f ? weights : NULL,
                                      .pairs = PAIRS,
                                      .sums = sums,
                                      .mean = mean,
                                      .iterations = iterations,
                                      .steps = 2,
                                      .length = lengths,
                                      .first = 0.1,
                                      .last = 0.03,
                                      .relaxation = 1.7,
                                      .trust = trust};
    ASSERT_OK(hada_ref_fit_cropped_solve(&fit, otf, left, err));
    for (int i = 0; i < PAIRS; i++)
        free(x[i]);
    HADA_FREE(b, sums);
}

static void agrees(fixture *f, float weight)
{
    enum { ITERATIONS = 6 };
    SCOPED(hada_fitter) *fitter = fitter_of(f, HADA_BOUNDARY_PADDED, ITERATIONS, 0);
    const hada_fit_grid *grid = &fitter->grid;
    const size_t plane = hada_model_info_plane(&grid->info);
    SCOPED(hada_nonnegative) * nonnegative;
    SCOPED(hada_fit_cropped) * cropped;
    const hada_buffer *transfers;
    double noise[CHANNELS], left, *otf = malloc(2 * plane * sizeof *otf);
    SCOPED_MEMORY float *got = malloc(2 * plane * sizeof *got), *blocks = malloc(2 * grid->stride * sizeof *blocks);
    hada_buffer weights;
    int more;
    ASSERT_OK(hada_buffer_create(&weights, grid->slot->context, fitter->pair.raw.bytes, "weights", err));
    weigh_some(weight, fitter->pair.raw_weights, CHANNELS * AREA);
    ASSERT_OK(hada_buffer_write(&weights, grid->slot, 0, fitter->pair.raw_weights, weights.bytes, err));
    ASSERT_OK(
        hada_nonnegative_create(&nonnegative, grid->slot, grid->info.grid_rows, grid->info.grid_cols, CHANNELS, err));
    ASSERT_OK(hada_fit_cropped_create(&cropped, &fitter->sums, &fitter->pair, nonnegative, err));
    ASSERT_OK(hada_fit_sums_select(&fitter->sums, 0, err));
    ASSERT_OK(hada_fit_cropped_begin(cropped, PAIRS, fitter->sums.depth[0].scene_energy, ITERATIONS, 0, NULL, err));
    ASSERT_OK(hada_fit_cropped_next(cropped, &more, err));
    while (more) {
        for (int i = 0; i < PAIRS; i++) {
            hada_fit_pair_take(&fitter->pair, &f->frame[0][i], &f->scene[0][i], NULL);
            ASSERT_OK(hada_fit_pair_transform(&fitter->pair, fitter->pair.raw_pixels, fitter->pair.scene_pixels, err));
            ASSERT_OK(hada_fit_cropped_pair(cropped, fitter->pair.raw.mem, weight != 1.0f ? weights.mem : NULL,
                                            fitter->pair.scene_spectrum.mem, err));
        }
        ASSERT_OK(hada_fit_cropped_next(cropped, &more, err));
    }
    ASSERT_OK(hada_fit_cropped_end(cropped, fitter->sums.depth[0].raw_energy, noise, &transfers, err));
    for (int c = 0; c < CHANNELS; c++) {
        expect(f, grid, c, hada_nonnegative_trust(noise[c], fitter->sums.depth[0].raw_energy[c]), ITERATIONS, weight,
               otf, &left);
        ASSERT_OK(hada_fit_read_plane(grid, transfers, (size_t)c * grid->layout.count, blocks, got, "a transfer", err));
        const double error = relative_error(got, otf, 2 * plane);
        if (!(error < 2e-5))
            fail_msg("channel %d: relative error %g", c, error);
        if (!(fabs(hada_fit_cropped_left(cropped)[c] - left) < 1e-4 * left))
            fail_msg("channel %d: left %g, expected %g", c, hada_fit_cropped_left(cropped)[c], left);
    }
    HADA_DESTROY_BUFFERS(&weights);
    free(otf);
}

TEST(iterations_agree_with_the_reference)
{
    agrees(*state, 1.0f);
}

TEST(values_that_are_not_known_have_no_part)
{
    agrees(*state, 0.0f);
}

TEST(values_that_may_be_more_are_a_bound)
{
    agrees(*state, -1.0f);
}

TEST(light_beyond_the_sensor_is_found)
{
    double before, now;
    SCOPED(hada_model) *one = learn(*state, 0, &before, NULL), *model = learn(*state, HADA_AUTO, &now, NULL);
    if (!(now < before / 4.0))
        fail_msg("error %g in one pass, %g with the crop in the model", before, now);
    if (!(model->info.noise < 0.5 * one->info.noise))
        fail_msg("noise %g in one pass, %g with the crop in the model", one->info.noise, model->info.noise);
}

/* Cuts the brightest sixteenth of each frame off; whole: the frames before. */
static void saturate(fixture *f, hada_image whole[DEPTHS][PAIRS])
{
    enum { COUNT = CHANNELS * AREA };
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS; i++) {
            float sorted[COUNT], *values = f->frame[z][i].data;
            ASSERT_OK(hada_image_copy(&whole[z][i], &f->frame[z][i], err));
            memcpy(sorted, values, sizeof sorted);
            const float white = hada_select_rank(sorted, COUNT, COUNT - COUNT / 16);
            for (int k = 0; k < COUNT; k++)
                values[k] = fminf(values[k], white);
        }
}

static void restore(fixture *f, hada_image whole[DEPTHS][PAIRS])
{
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS; i++) {
            hada_image_destroy(&f->frame[z][i]);
            f->frame[z][i] = whole[z][i];
        }
}

/* Saturated values are found and only bound what may be there, so that transfer functions are nearly those of whole
 * frames. */
TEST(saturated_values_are_a_bound)
{
    fixture *f = *state;
    hada_image whole[DEPTHS][PAIRS];
    double error[3];
    SCOPED(hada_model) *unclipped = learn(f, HADA_AUTO, &error[0], NULL);
    saturate(f, whole);
    SCOPED(hada_model) *clipped = learn(f, HADA_AUTO, &error[1], NULL);
    SCOPED(hada_model) *one = learn(f, 0, &error[2], NULL);
    restore(f, whole);
    if (!(error[1] < 2.0 * error[0] && error[1] < error[2] / 12.0))
        fail_msg("error %g of whole frames, %g of saturated ones, %g of those in one pass", error[0], error[1],
                 error[2]);
}

/* The error of transfer functions that a whole fit learns where no light leaves the sensor. */
static double learn_circular(fixture *f, int passes)
{
    hada_fit_options options = options_of(HADA_BOUNDARY_CIRCULAR, passes, 0);
    SCOPED(hada_fitter) * fitter;
    SCOPED(hada_model) * model;
    shower at = {.f = f};
    SCOPED(hada_dataset) *data = shown_by(&at, PAIRS);
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    ASSERT_OK(hada_fitter_add(fitter, data, err));
    ASSERT_OK(hada_fitter_finish(fitter, data, &model, err));
    return error_of(f, &fitter->grid, model);
}

/* The same where the sums of pairs would do if nothing was saturated. */
TEST(circular_cameras_know_saturated_values)
{
    fixture *f = (fixture *)*state + 1;
    hada_image whole[DEPTHS][PAIRS];
    const double sound = learn_circular(f, HADA_AUTO);
    saturate(f, whole);
    const double found = learn_circular(f, HADA_AUTO), one = learn_circular(f, 0);
    restore(f, whole);
    if (!(found < 1.5 * sound && found < one / 3.0))
        print_message("error %g of whole frames, %g of saturated ones, %g of those in one pass", sound, found, one);
}

/* Passes over pairs that stay on the device read none, and can be stopped all the same. */
TEST(passes_can_be_stopped)
{
    fixture *f = *state;
    patience of = {.most = -1};
    const hada_monitor monitor = patience_monitor(&of);
    hada_fit_options options = options_of(HADA_BOUNDARY_PADDED, HADA_AUTO, 0);
    SCOPED(hada_fitter) * fitter;
    SCOPED(hada_model) * model, *expected = learn(f, HADA_AUTO, NULL, NULL);
    shower at = {.f = f};
    SCOPED(hada_dataset) *data = shown_by(&at, PAIRS);
    options.monitor = &monitor;
    options.leave_one_out = 0;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    ASSERT_OK(hada_fitter_add(fitter, data, err));
    of = (patience){.most = -1};
    ASSERT_OK(hada_fitter_finish(fitter, data, &model, err));
    hada_model_destroy(&model);
    const int asked = of.asked;
    assert_true(asked > 2 * DEPTHS * PAIRS);
    of = (patience){.most = asked / 2};
    ASSERT_FAILS(hada_fitter_finish(fitter, data, &model, err), HADA_ERROR_CANCELLED, "");
    of = (patience){.most = -1};
    ASSERT_OK(hada_fitter_finish(fitter, data, &model, err));
    assert_memory_equal(model->otf, expected->otf, 2 * hada_model_plane(model) * DEPTHS * CHANNELS * sizeof(float));
}

TEST(light_that_stays_costs_little)
{
    fixture *f = (fixture *)*state + 1;
    double before, now;
    int shown;
    SCOPED(hada_model) *one = learn(f, 0, &before, &shown), *model;
    assert_non_null(one);
    assert_int_equal(shown, 0);
    model = learn(f, HADA_AUTO, &now, &shown);
    assert_int_equal(shown, DEPTHS * PAIRS);
    if (!(now < 1.15 * before)) /* one pass takes for granted what is so here: no light beyond the sensor */
        fail_msg("error %g in one pass, %g with the crop in the model", before, now);
}

TEST(streamed_pairs_give_the_same_bits)
{
    fixture *f = *state;
    int shown;
    SCOPED(hada_model) *kept = learn(f, 6, NULL, &shown), *streamed;
    const uint64_t memory = f->context->info.memory_bytes;
    assert_int_equal(shown, DEPTHS * PAIRS);
    f->context->info.memory_bytes = 0;
    streamed = learn(f, 6, NULL, &shown);
    f->context->info.memory_bytes = memory;
    assert_int_equal(shown, DEPTHS * PAIRS * 6); /* the first look, and five passes */
    assert_memory_equal(kept->otf, streamed->otf, DEPTHS * CHANNELS * hada_model_plane(kept) * 2 * sizeof(float));
}

TEST(the_trial_has_transfer_functions_of_its_own)
{
    fixture *f = *state;
    SCOPED(hada_fitter) *fitter = fitter_of(f, HADA_BOUNDARY_PADDED, (int)HADA_AUTO, (int)HADA_AUTO);
    SCOPED(hada_model) * model;
    shower at = {.f = f};
    SCOPED(hada_dataset) *data = shown_by(&at, PAIRS);
    ASSERT_OK(hada_fitter_finish(fitter, data, &model, err));
    assert_int_equal(fitter->kept.count, HADA_FIT_KEPT);
    const size_t bytes = CHANNELS * fitter->grid.layout.count * 2 * sizeof(float);
    for (int k = 0; k < HADA_FIT_KEPT; k++) {
        assert_non_null(fitter->kept.pair[k].transfers);
        assert_true(k == 0 || memcmp(fitter->kept.pair[0].transfers, fitter->kept.pair[3].transfers, bytes));
    }
    assert_non_null(hada_fitter_get_info(fitter)->scores->refinements[0]);
}

TEST(other_pairs_are_refused)
{
    fixture *f = *state;
    shower at = {.f = f, .swap = 1};
    SCOPED(hada_fitter) *fitter = fitter_of(f, HADA_BOUNDARY_PADDED, (int)HADA_AUTO, 0);
    ASSERT_FAILS(learn_cropped(fitter, &at, err), HADA_ERROR_STATE, "");
    at.swap = 0;
    ASSERT_OK(learn_cropped(fitter, &at, err));
    hada_fitter_destroy(&fitter);
    at.shown = 0;
    fitter = fitter_of(f, HADA_BOUNDARY_CIRCULAR, (int)HADA_AUTO, 0);
    ASSERT_OK(learn_cropped(fitter, &at, err));
    assert_int_equal(at.shown, 0);
}

static hada_status find_boundary(hada_fit_options *options, fixture *f, shower *at, int pairs, hada_error *error)
{
    hada_dataset *data = shown_by(at, pairs);
    const hada_status status = hada_fit_find_boundary(options, f->context, data, error);
    hada_dataset_destroy(&data);
    options->distances_mm = distances;
    return status;
}

TEST(a_boundary_is_found_that_pads)
{
    fixture *f = *state;
    hada_fit_options options = options_of(HADA_BOUNDARY_CIRCULAR, (int)HADA_AUTO, 0);
    shower at = {.f = f};
    hada_model *model;
    double found, whole;
    ASSERT_OK(find_boundary(&options, f, &at, PAIRS, err));
    assert_int_equal(options.boundary, HADA_BOUNDARY_PADDED);
    assert_in_range(options.grid_rows, ROWS + 1, hada_fft_good_size(TALL));
    assert_in_range(options.grid_cols, COLS + 1, hada_fft_good_size(WIDE));
    learn_on(f, &options, &found);
    model = learn(f, (int)HADA_AUTO, &whole, NULL);
    if (!(found < 1.1 * whole))
        fail_msg("error %g on the grid that was found, %g on the whole one", found, whole);
    hada_model_destroy(&model);
    /* from two pairs, and where nothing can be held out, the grid has room for all light */
    for (int pairs = 2; pairs; pairs--, at.shown = 0) {
        options.boundary = HADA_BOUNDARY_CIRCULAR;
        ASSERT_OK(find_boundary(&options, f, &at, pairs, err));
        assert_int_equal(options.boundary, HADA_BOUNDARY_PADDED);
        assert_int_equal(options.grid_rows + options.grid_cols,
                         pairs == 2 ? hada_fft_good_size(TALL) + hada_fft_good_size(WIDE) : 0);
        assert_true(pairs == 2 || at.shown == 1); /* for the sizes */
    }
}

TEST(a_boundary_is_found_that_is_circular)
{
    fixture *f = (fixture *)*state + 1;
    shower at = {.f = f};
    for (int pairs = 2; pairs <= PAIRS; pairs += PAIRS - 2) {
        hada_fit_options options = options_of(HADA_BOUNDARY_PADDED, (int)HADA_AUTO, 0);
        ASSERT_OK(find_boundary(&options, f, &at, pairs, err));
        assert_int_equal(options.boundary, HADA_BOUNDARY_CIRCULAR);
        assert_int_equal(options.grid_rows + options.grid_cols, 0);
    }
}

/* Where few pairs leave a survey unsure of the response, the crop in the model tells it. */
TEST(responses_are_confirmed)
{
    enum { CASES = 24, FEW = 3 };
    const fixture *f = *state;
    const int count = FEW;
    int unsure[2] = {0, 0}, right[2] = {0, 0};
    for (uint64_t seed = 1; seed <= CASES; seed++)
        for (int encoded = 0; encoded < 2; encoded++) {
            hada_fit_options options = helpers_fit(1, CHANNELS, distances, ROWS, COLS, WINDOW);
            hada_image scenes[FEW], frames[FEW];
            SCOPED(hada_image) psf = spots(1.0, seed + 100);
            for (int i = 0; i < FEW; i++) {
                scenes[i] = squares(100 * seed + (uint64_t)i);
                frames[i] = expose(&psf, &scenes[i], 100 * seed + (uint64_t)i);
                if (encoded)
                    hada_response_convert(scenes[i].data, hada_image_count(&scenes[i]), HADA_RESPONSE_LINEAR,
                                          HADA_RESPONSE_SRGB);
            }
            hada_dataset *data;
            hada_survey *survey;
            options.boundary = HADA_BOUNDARY_PADDED;
            ASSERT_OK(hada_dataset_from_images(&data, 1, distances, &count, frames, scenes, err));
            ASSERT_OK(hada_survey_create(&survey, &options, data, HADA_EXPOSURE_SAME, err));
            int least = 0;
            for (int r = 0; survey->rows[r]; r++)
                least = survey->rows[r]->unexplained < survey->rows[least]->unexplained ? r : least;
            if (!survey->rows[least]->chosen) {
                ASSERT_OK(hada_fit_confirm_survey(survey, &options, HADA_EXPOSURE_SAME, f->context, data, err));
                unsure[encoded]++;
                right[encoded] += encoded ? survey->response > 1.7 || survey->response == HADA_RESPONSE_SRGB
                                          : survey->response == HADA_RESPONSE_LINEAR;
                int chosen = 0;
                for (int r = 0; survey->rows[r]; r++)
                    chosen += survey->rows[r]->chosen && survey->rows[r]->response == survey->response;
                assert_int_equal(chosen, 1);
            }
            hada_survey_destroy(&survey);
            hada_dataset_destroy(&data);
            destroy_images(scenes, FEW);
            destroy_images(frames, FEW);
        }
    assert_true(unsure[1] >= 2 && right[1] >= unsure[1] - unsure[1] / 8);
    assert_true(right[0] >= unsure[0] - unsure[0] / 8);
}

/* Exposures that a survey finds become precise, and scenes keep their response; alike ones are not taken apart. */
TEST(exposures_are_confirmed)
{
    enum { CASES = 6 };
    static const double gains[PAIRS] = {0.6, 1.0, 1.5, 1.1};
    const fixture *f = *state;
    const int count = PAIRS;
    for (uint64_t seed = 1; seed <= CASES; seed++)
        for (int exposed = 0; exposed < 2; exposed++) {
            hada_fit_options options = helpers_fit(1, CHANNELS, distances, ROWS, COLS, WINDOW);
            hada_image scenes[PAIRS], frames[PAIRS];
            SCOPED(hada_image) psf = spots(0.8, seed + 200);
            double mean = 0.0;
            for (int i = 0; i < PAIRS; i++) {
                scenes[i] = squares(100 * seed + (uint64_t)i);
                frames[i] = expose(&psf, &scenes[i], 100 * seed + (uint64_t)i);
                for (size_t k = 0; k < hada_image_count(&frames[i]) && exposed; k++)
                    frames[i].data[k] *= (float)gains[i];
                hada_response_convert(scenes[i].data, hada_image_count(&scenes[i]), HADA_RESPONSE_LINEAR,
                                      HADA_RESPONSE_SRGB);
                mean += log(gains[i]) / PAIRS;
            }
            hada_dataset *data;
            hada_survey *survey;
            options.boundary = HADA_BOUNDARY_PADDED;
            ASSERT_OK(hada_dataset_from_images(&data, 1, distances, &count, frames, scenes, err));
            ASSERT_OK(hada_survey_create(&survey, &options, data, HADA_EXPOSURE_AUTO, err));
            ASSERT_OK(hada_fit_confirm_survey(survey, &options, HADA_EXPOSURE_AUTO, f->context, data, err));
            if (survey->exposed != exposed || (survey->response != HADA_RESPONSE_SRGB && survey->response < 1.9))
                fail_msg("seed %d, exposed %d: %d, response %g", (int)seed, exposed, survey->exposed, survey->response);
            assert_int_equal(survey->gains != NULL, exposed);
            for (int i = 0; i < PAIRS && exposed; i++)
                if (fabs(survey->gains[0][i] / gains[i] * exp(mean) - 1.0) > 0.03)
                    fail_msg("seed %d: exposure %g was found for %g", (int)seed, survey->gains[0][i],
                             gains[i] / exp(mean));
            hada_survey_destroy(&survey);
            hada_dataset_destroy(&data);
            destroy_images(scenes, PAIRS);
            destroy_images(frames, PAIRS);
        }
}

/* Between depths, of which one has a single pair, nothing but the light that they have says what the exposures are. */
TEST(depths_become_as_bright)
{
    enum { SEVERAL = 3 };
    static const double gains[SEVERAL * PAIRS] = {0.6, 1.0, 1.5, 1.1, 2.1, 0.9, 1.3, 1.6, 0.7}, at[] = {90, 150, 400};
    static const int pairs[SEVERAL] = {PAIRS, PAIRS, 1};
    const fixture *f = *state;
    for (uint64_t seed = 1; seed < 4; seed++) {
        hada_fit_options options = helpers_fit(SEVERAL, CHANNELS, at, ROWS, COLS, WINDOW);
        hada_image scenes[SEVERAL * PAIRS] = {{0}}, frames[SEVERAL * PAIRS] = {{0}};
        hada_dataset *data;
        hada_survey *survey;
        for (int i = 0; i <= 2 * PAIRS; i++) {
            SCOPED(hada_image) psf = spots(0.8, seed + 300 + (uint64_t)(i / PAIRS));
            double light = 0.0;
            for (size_t k = 0; k < hada_image_count(&psf); k++)
                light += (double)psf.data[k] / CHANNELS;
            for (size_t k = 0; k < hada_image_count(&psf); k++)
                psf.data[k] /= (float)light;
            scenes[i] = squares(100 * seed + (uint64_t)i);
            frames[i] = expose(&psf, &scenes[i], 100 * seed + (uint64_t)i);
            for (size_t k = 0; k < hada_image_count(&frames[i]); k++)
                frames[i].data[k] *= (float)gains[i];
        }
        options.boundary = HADA_BOUNDARY_PADDED;
        options.scene_response = HADA_RESPONSE_LINEAR;
        ASSERT_OK(hada_dataset_from_images(&data, SEVERAL, at, pairs, frames, scenes, err));
        ASSERT_OK(hada_survey_create(&survey, &options, data, HADA_EXPOSURE_EACH, err));
        ASSERT_OK(hada_fit_confirm_survey(survey, &options, HADA_EXPOSURE_EACH, f->context, data, err));
        for (int i = 0; i <= 2 * PAIRS; i++) {
            const double found = survey->gains[i / PAIRS][i % PAIRS] / survey->gains[0][0] * gains[0] / gains[i];
            if (fabs(found - 1.0) > 0.02)
                fail_msg("seed %d, pair %d: the exposure is wrong by a factor of %g", (int)seed, i, found);
        }
        hada_survey_destroy(&survey);
        hada_dataset_destroy(&data);
        destroy_images(scenes, SEVERAL * PAIRS);
        destroy_images(frames, SEVERAL * PAIRS);
    }
}

/* What the coarse level learns solves its normal equations, of cells that are averaged and transformed here in double
 * precision: sum conj(X) F(crop(F^-1(X H)) - b) + w H = 0. */
TEST(coarse_transfer_functions_solve_their_equations)
{
    enum { CELL = 2, HIGH = 25, LONG = 27, CELLS = HIGH * LONG, PLANE = HIGH * (LONG / 2 + 1) };
    static const unsigned char left_out[PAIRS] = {0, 1, 0, 0};
    static const double q = 0.1;
    fixture *f = *state;
    hada_fit_options options = options_of(HADA_BOUNDARY_PADDED, HADA_AUTO, 0);
    options.grid_rows = CELL * HIGH;
    options.grid_cols = CELL * LONG; /* an odd number of cells: no highest frequency is lost */
    SCOPED(hada_fitter) * fitter;
    SCOPED(hada_fit_coarse) * coarse;
    ASSERT_OK(hada_fitter_create(&fitter, f->context, &options, err));
    const hada_fit_grid *grid = &fitter->grid;
    const size_t fine = hada_model_info_plane(&grid->info), pitch = CELL * LONG / 2 + 1;
    SCOPED_MEMORY float *otf = malloc(2 * CHANNELS * fine * sizeof *otf);
    ASSERT_OK(hada_fit_coarse_create(&coarse, grid, NULL, err));
    ASSERT_OK(hada_fit_coarse_begin(coarse, PAIRS, err));
    for (int i = 0; i < PAIRS; i++) {
        hada_fit_pair_take(&fitter->pair, &f->frame[0][i], &f->scene[0][i], NULL);
        ASSERT_OK(hada_fit_coarse_add(coarse, &fitter->pair, err));
    }
    ASSERT_OK(hada_fit_coarse_solve(coarse, left_out, otf, err));
    for (int c = 0; c < CHANNELS; c++) {
        static double h[2 * PLANE], x[2 * PLANE], e[2 * PLANE], sum[2 * PLANE], right[2 * PLANE], power[PLANE];
        double mean = 0.0, left = 0.0, all = 0.0;
        memset(sum, 0, sizeof sum);
        memset(right, 0, sizeof right);
        memset(power, 0, sizeof power);
        for (int k = 0; k < PLANE; k++) {
            const int row = k / (LONG / 2 + 1), col = k % (LONG / 2 + 1);
            const size_t at = (size_t)c * fine + (size_t)(row > HIGH / 2 ? row + HIGH : row) * pitch + (size_t)col;
            h[2 * k] = otf[2 * at];
            h[2 * k + 1] = otf[2 * at + 1];
        }
        for (int i = 0; i < PAIRS; i++) {
            double scene[CELLS] = {0.0}, frame[CELLS] = {0.0}, seen[CELLS] = {0.0}, made[CELLS];
            if (left_out[i])
                continue;
            for (int k = 0; k < WINDOW * WINDOW; k++) {
                const int row = grid->geometry.window_row + k / WINDOW, col = grid->geometry.window_col + k % WINDOW;
                scene[row / CELL * LONG + col / CELL] +=
                    f->scene[0][i].data[c * WINDOW * WINDOW + k] / (double)(CELL * CELL);
            }
            for (int k = 0; k < AREA; k++) {
                const int row = grid->geometry.raw_row + k / COLS, col = grid->geometry.raw_col + k % COLS;
                frame[row / CELL * LONG + col / CELL] += f->frame[0][i].data[c * AREA + k] / (double)(CELL * CELL);
                seen[row / CELL * LONG + col / CELL] += 1.0 / (CELL * CELL);
            }
            ASSERT_OK(hada_ref_fft_forward(scene, HIGH, LONG, x, err));
            for (int part = 0; part < 2; part++) { /* the frame, then what H makes */
                for (int k = 0; k < PLANE; k++) {
                    e[2 * k] = x[2 * k] * h[2 * k] - x[2 * k + 1] * h[2 * k + 1];
                    e[2 * k + 1] = x[2 * k] * h[2 * k + 1] + x[2 * k + 1] * h[2 * k];
                }
                if (part)
                    ASSERT_OK(hada_ref_fft_inverse(e, HIGH, LONG, made, err));
                for (int k = 0; k < CELLS; k++) /* cells that the sensor has in part do not count */
                    made[k] = seen[k] < 1.0 ? 0.0 : part ? made[k] : frame[k];
                ASSERT_OK(hada_ref_fft_forward(made, HIGH, LONG, e, err));
                double *to = part ? sum : right;
                for (int k = 0; k < PLANE; k++) {
                    to[2 * k] += x[2 * k] * e[2 * k] + x[2 * k + 1] * e[2 * k + 1];
                    to[2 * k + 1] += x[2 * k] * e[2 * k + 1] - x[2 * k + 1] * e[2 * k];
                }
            }
            for (int k = 0; k < PLANE; k++)
                power[k] += x[2 * k] * x[2 * k] + x[2 * k + 1] * x[2 * k + 1];
        }
        for (int k = 0; k < PLANE; k++)
            mean += (k % (LONG / 2 + 1) ? 2.0 : 1.0) * power[k] / CELLS;
        for (int k = 0; k < 2 * PLANE; k++) {
            left += pow(sum[k] + q * mean * h[k] - right[k], 2.0) / (power[k / 2] + q * mean);
            all += right[k] * right[k] / (power[k / 2] + q * mean);
        }
        if (!(sqrt(left / all) < 1e-3))
            fail_msg("channel %d: %g of the right side is left", c, sqrt(left / all));
    }
}

/* A point spread function that covers the whole sensor and more: its smooth part is not exchanged for light beyond. */
TEST(wide_point_spread_functions_are_found)
{
    fixture wide = {.context = ((fixture *)*state)->context};
    hada_fit_options options = helpers_fit(1, CHANNELS, distances, ROWS, COLS, WINDOW);
    SCOPED(hada_fitter) * fitter;
    SCOPED(hada_model) * model;
    hada_random random;
    const size_t half = TALL * WIDE;
    ASSERT_OK(hada_image_create(&wide.psf[0], CHANNELS, TALL, WIDE, err));
    hada_random_seed(&random, 5, 0);
    for (size_t k = 0; k < half; k++) {
        const double row = ((double)(k / WIDE) - TALL / 2) / (0.45 * TALL),
                     col = ((double)(k % WIDE) - WIDE / 2) / (0.45 * WIDE);
        wide.psf[0].data[k] = (float)(hada_random_below(&random, 4) ? 0.0 : exp(-row * row - col * col) / 500.0);
        for (size_t c = 1; c < CHANNELS; c++)
            wide.psf[0].data[c * half + k] = wide.psf[0].data[k];
    }
    options.boundary = HADA_BOUNDARY_PADDED;
    options.refine_steps = 0;
    ASSERT_OK(hada_fitter_create(&fitter, wide.context, &options, err));
    for (int i = 0; i < PAIRS; i++) {
        wide.scene[0][i] = squares((uint64_t)i);
        wide.frame[0][i] = expose(&wide.psf[0], &wide.scene[0][i], (uint64_t)i);
        ASSERT_OK(hada_fitter_add_pair(fitter, 0, &wide.frame[0][i], &wide.scene[0][i], err));
    }
    SCOPED(hada_dataset) * data;
    static const int count = PAIRS;
    ASSERT_OK(hada_dataset_from_images(&data, 1, distances, &count, wide.frame[0], wide.scene[0], err));
    ASSERT_OK(hada_fit_learn_cropped(fitter, data, err));
    ASSERT_OK(hada_fit_solve(fitter, &model, err));
    const size_t plane = hada_model_plane(model), cols = (size_t)model->info.grid_cols / 2 + 1;
    SCOPED_MEMORY double *otf = malloc(2 * plane * sizeof *otf);
    for (int c = 0; c < CHANNELS; c++) {
        double off = 0.0, all = 0.0;
        truth(&wide, &fitter->grid, 0, c, otf);
        for (size_t k = 1; k < plane; k++) { /* low frequencies but 0 */
            const size_t row = k / cols,
                         far = row < (size_t)model->info.grid_rows / 2 ? row : (size_t)model->info.grid_rows - row;
            for (size_t part = 0; part < 2 && far < 6 && k % cols < 6; part++) {
                const double want = otf[2 * k + part];
                off += pow(model->otf[2 * ((size_t)c * plane + k) + part] - want, 2.0);
                all += want * want;
            }
        }
        print_message("channel %d: %.3f\n", c, sqrt(off / all));
        assert_true(sqrt(off / all) < 0.3);
    }
    destroy_images(wide.psf, 1);
    destroy_images(wide.scene[0], PAIRS);
    destroy_images(wide.frame[0], PAIRS);
}

FIXTURE(set_up_both, tear_down_both)
