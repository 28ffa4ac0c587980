/* The linear path (frame, bank, Hadamard stage) against the double reference; models from point spread functions. */
#include "camera_small.h"
#include "dry.h"
#include "filter/bank.h"
#include "filter/hadamard.h"
#include "image/statistics.h"
#include "io/safetensors.h"
#include "ref/ref_filter.h"

typedef struct fixture {
    hada_context *context;
    hada_slot *slot;
} fixture;

static int setup(void **state)
{
    static fixture f;
    ASSERT_OK(hada_context_create(&f.context, NULL, err));
    ASSERT_OK(hada_slot_create(&f.slot, f.context, err));
    *state = &f;
    return 0;
}

/* As on a GPU: kernels by work-groups, and the layout of spectra that goes with them. */
static int setup_groups(void **state)
{
    setup(state);
    ((fixture *)*state)->context->shape = HADA_SHAPE_GROUPS;
    return 0;
}

static int teardown(void **state)
{
    fixture *f = *state;
    hada_slot_destroy(&f->slot);
    close_context(&f->context);
    return 0;
}

static hada_model *random_model(int depths, int channels, int rows, int cols, int window_rows, int window_cols,
                                hada_form form, hada_boundary boundary, uint64_t seed)
{
    double distances[16];
    hada_model_info info = {.depths = depths, .channels = channels, .form = form, .boundary = boundary, .has_otf = 1};
    hada_model *model;
    hada_random random;
    for (int z = 0; z < depths; z++)
        distances[z] = 100.0 + 50.0 * z;
    info.distances_mm = distances;
    ASSERT_OK(hada_model_set_sizes(&info, rows, cols, window_rows, window_cols, err));
    ASSERT_OK(hada_model_create(&model, &info, 0, err));
    hada_random_seed(&random, seed, 0);
    const size_t values = hada_model_plane(model) * 2 * (size_t)(depths * channels);
    for (size_t i = 0; i < values; i++) {
        model->filter[i] = (float)hada_random_normal(&random);
        model->otf[i] = (float)hada_random_normal(&random);
    }
    /* a window holds a real image: the values that its spectrum must have real are made so */
    for (size_t image = 0; image < (size_t)(depths * channels); image++)
        for (int edge = 0; edge < 2; edge++)
            for (int ky = 0; ky < model->info.grid_rows; ky++) {
                const size_t half = (size_t)model->info.grid_cols / 2 + 1;
                const size_t at = image * hada_model_plane(model) + (size_t)ky * half + (edge ? half - 1 : 0);
                if (!edge || model->info.grid_cols % 2 == 0) {
                    const int mirror = (model->info.grid_rows - ky) % model->info.grid_rows;
                    const size_t other =
                        image * hada_model_plane(model) + (size_t)mirror * half + (edge ? half - 1 : 0);
                    model->filter[2 * other] = model->filter[2 * at];
                    model->filter[2 * other + 1] = (form == HADA_FORM_SPLIT ? 1.0f : -1.0f) * model->filter[2 * at + 1];
                    if (mirror == ky && form != HADA_FORM_SPLIT)
                        model->filter[2 * at + 1] = 0.0f;
                }
            }
    return model;
}

/* Runs all depths in batches and returns the largest relative error against the reference. */
static double path_error(fixture *f, const hada_model *model, int batch, int half, const double *levels)
{
    const hada_model_info *info = &model->info;
    const hada_spectrum_layout layout = hada_hadamard_layout(f->context, info);
    const size_t window = (size_t)info->window_rows * (size_t)info->window_cols;
    const size_t area = (size_t)info->raw_rows * (size_t)info->raw_cols;
    SCOPED(hada_bank) * bank;
    SCOPED(hada_hadamard) * stage;
    SCOPED(hada_buffer) planes;
    hada_geometry at;
    const uint64_t before = hada_context_bytes(f->context);
    ASSERT_OK(hada_bank_create(&bank, f->slot, model, &layout, NULL, 0, HADA_BANK_FILTERS, half, err));
    ASSERT_DRY(hada_context_bytes(f->context) - before, f->context, hada_bank,
               hada_bank_create(&object, &dry.slot, model, &layout, NULL, 0, HADA_BANK_FILTERS, half, NULL),
               hada_bank_destroy);
    ASSERT_OK(hada_hadamard_create(&stage, f->slot, info, batch, err));
    ASSERT_OK(hada_geometry_of(info, &at, err));
    const size_t count = (size_t)(info->depths * info->channels) * window;
    ASSERT_OK(hada_buffer_create(&planes, f->context, (count + 5) * 4, "planes", err));
    SCOPED(hada_image) raw = small_scene(info->channels, info->raw_rows, info->raw_cols, 5);
    hada_pixels pixels;
    hada_pixels_of_image(&pixels, &raw);
    ASSERT_OK(hada_hadamard_frame(stage, &pixels, levels, err));
    ASSERT_OK(hada_hadamard_run(stage, bank, 0, info->depths, planes.mem, 5, err));
    SCOPED_MEMORY float *got = malloc(count * sizeof *got);
    ASSERT_OK(hada_buffer_read(&planes, f->slot, 5 * 4, got, count * 4, err));

    const hada_ref_grid grid = {info->grid_rows, info->grid_cols, at.raw_row,    at.raw_col,        info->raw_rows,
                                info->raw_cols,  at.window_row,   at.window_col, info->window_rows, info->window_cols};
    SCOPED_MEMORY double *spectrum = malloc(hada_model_plane(model) * 2 * sizeof *spectrum),
                         *expected = malloc(window * sizeof *expected);
    double worst = 0.0;
    for (int c = 0; c < info->channels; c++) {
        for (size_t i = 0; levels && i < area; i++)
            raw.data[(size_t)c * area + i] -= (float)levels[c];
        ASSERT_OK(hada_ref_grid_forward(&grid, raw.data + (size_t)c * area, at.raw_row, at.raw_col, info->raw_rows,
                                        info->raw_cols, spectrum, err));
        for (int z = 0; z < info->depths; z++) {
            const size_t image = (size_t)(z * info->channels + c);
            ASSERT_OK(hada_ref_hadamard(&grid, spectrum, model->filter + image * hada_model_plane(model) * 2,
                                        info->form == HADA_FORM_SPLIT, expected, err));
            worst = fmax(worst, relative_error(got + image * window, expected, window));
        }
    }
    return worst;
}

TEST(linear_path_agrees_with_the_reference)
{
    static const struct {
        int depths, channels, rows, cols, window_rows, window_cols, batch;
        hada_form form;
        hada_boundary boundary;
    } cases[] = {{3, 3, 60, 80, 24, 24, 2, HADA_FORM_COMPLEX, HADA_BOUNDARY_CIRCULAR},
                 {2, 1, 43, 86, 43, 86, 2, HADA_FORM_COMPLEX, HADA_BOUNDARY_CIRCULAR},
                 {4, 2, 48, 64, 17, 30, 3, HADA_FORM_SPLIT, HADA_BOUNDARY_CIRCULAR},
                 {2, 3, 33, 50, 20, 31, 1, HADA_FORM_COMPLEX, HADA_BOUNDARY_PADDED},
                 {1, 1, 37, 31, 5, 7, 4, HADA_FORM_SPLIT, HADA_BOUNDARY_PADDED}};
    for (size_t i = 0; i < HADA_COUNT(cases); i++) {
        SCOPED(hada_model) *model =
            random_model(cases[i].depths, cases[i].channels, cases[i].rows, cases[i].cols, cases[i].window_rows,
                         cases[i].window_cols, cases[i].form, cases[i].boundary, i);
        const double error = path_error(*state, model, cases[i].batch, 0, NULL);
        if (!(error < 1e-6))
            fail_msg("case %zu: relative error %g", i, error);
    }
}

TEST(dark_levels_are_taken_off)
{
    static const double levels[] = {0.25, 0.0, 0.125};
    SCOPED(hada_model) *model = random_model(1, 3, 45, 51, 20, 20, HADA_FORM_COMPLEX, HADA_BOUNDARY_CIRCULAR, 3);
    assert_true(path_error(*state, model, 1, 0, levels) < 1e-6);
}

TEST(half_filters_cost_little)
{
    SCOPED(hada_model) *model = random_model(2, 2, 40, 56, 30, 30, HADA_FORM_COMPLEX, HADA_BOUNDARY_CIRCULAR, 4), *half;
    const double error = path_error(*state, model, 2, 1, NULL);
    /* half keeps 11 bits: a relative error of up to 2^-11 a value, about 0.3 * 2^-10 in the mean square */
    assert_true(error < 4.9e-4 && error > 1e-6);
    ASSERT_OK(hada_model_to_half(&half, model, err));
    assert_int_equal(half->info.half, 1);
    const size_t values = hada_model_plane(model) * 8;
    for (size_t i = 0; i < values; i++) {
        const float back = hada_float_from_half(half->filter_half[i]);
        assert_true(fabsf(back - model->filter[i]) <= fabsf(model->filter[i]) / 2048.0f + 6e-8f);
    }
    model->filter[7] = 1e6f;
    hada_model *refused;
    ASSERT_FAILS(hada_model_to_half(&refused, model, err), HADA_ERROR_NUMERIC, "");
    assert_null(refused);
}

TEST(banks_refuse_what_does_not_fit)
{
    fixture *f = *state;
    SCOPED(hada_model) *model = random_model(2, 1, 16, 16, 8, 8, HADA_FORM_COMPLEX, HADA_BOUNDARY_CIRCULAR, 4);
    hada_spectrum_layout layout = hada_hadamard_layout(f->context, &model->info);
    hada_bank *bank;
    const int depths[] = {1, 2};
    ASSERT_FAILS(hada_bank_create(&bank, f->slot, model, &layout, depths, 2, HADA_BANK_FILTERS, 0, err),
                 HADA_ERROR_ARGUMENT, "");
    assert_null(bank);
    model->otf[3] = NAN;
    ASSERT_FAILS(hada_bank_create(&bank, f->slot, model, &layout, NULL, 0, HADA_BANK_OTFS, 0, err), HADA_ERROR_MODEL,
                 "not finite");
    /* a device that takes only one depth at a time: two buffers */
    const uint64_t limit = f->context->info.max_allocation_bytes;
    f->context->info.max_allocation_bytes = layout.count * 8;
    ASSERT_OK(hada_bank_create(&bank, f->slot, model, &layout, NULL, 0, HADA_BANK_FILTERS, 0, err));
    size_t first;
    int left;
    cl_mem a = hada_bank_filter(bank, 0, &first, &left);
    assert_int_equal(left, 1);
    assert_true(a != hada_bank_filter(bank, 1, &first, &left));
    assert_int_equal(first, 0);
    hada_bank_destroy(&bank);
    f->context->info.max_allocation_bytes = layout.count * 8 - 1;
    ASSERT_FAILS(hada_bank_create(&bank, f->slot, model, &layout, NULL, 0, HADA_BANK_FILTERS, 0, err),
                 HADA_ERROR_DEVICE_MEMORY, "");
    f->context->info.max_allocation_bytes = limit;
}

TEST(layouts_go_both_ways)
{
    const hada_spectrum_layout layout = {5, 20, 8, 2, 80};
    float rows[110], blocks[160], back[110], weights[80];
    double sum = 0.0;
    for (int i = 0; i < 110; i++)
        rows[i] = (float)i;
    hada_layout_pack(&layout, rows, blocks);
    hada_layout_unpack(&layout, blocks, back);
    assert_memory_equal(rows, back, sizeof rows);
    assert_true(blocks[2 * hada_spectrum_index(&layout, 3, 9)] == rows[2 * (3 * 11 + 9)]);
    assert_true(blocks[2 * 47 + 1] == 0.0f); /* padding */
    hada_layout_weights(&layout, weights);
    for (int i = 0; i < 80; i++)
        sum += weights[i];
    assert_true(sum == 100.0); /* every frequency of the whole spectrum once */
}

TEST(dark_level_is_the_first_percentile_of_means)
{
    enum { RUNS = 5000, RUN = 16, COUNT = RUNS * RUN + 8 };
    static float pixels[COUNT], room[COUNT];
    for (int i = 0; i < COUNT; i++) /* in a row 16 pixels of one mean; fewer at the end are left out */
        pixels[i] = i < RUNS * RUN ? (float)((i / RUN * 337) % RUNS + (i % 2 ? 500 : -500)) : -1e6f;
    assert_true(hada_dark_estimate(pixels, COUNT, room) == 49.0 && hada_dark_estimate(pixels, 1, room) == pixels[0]);
    assert_true(hada_dark_estimate(pixels, COUNT, pixels) == 49.0);
    for (int i = 0; i < 1000; i++) /* of a small frame each pixel counts */
        pixels[i] = (float)((i * 337) % 1000);
    assert_true(hada_dark_estimate(pixels, 1000, room) == 9.0);
}

TEST(a_delta_psf_gives_the_identity)
{
    fixture *f = *state;
    static const double distances[] = {250.0};
    static const hada_form forms[] = {HADA_FORM_MATCHED, HADA_FORM_WIENER};
    SCOPED(hada_image) psf;
    ASSERT_OK(hada_image_create(&psf, 2, 21, 30, err));
    psf.data[10 * 30 + 15] = psf.data[630 + 10 * 30 + 15] = 0.7f;
    for (int i = 0; i < 4; i++) {
        SCOPED(hada_model) * model;
        DEFAULTS(hada_psf_options, options);
        options.form = forms[i % 2];
        options.boundary = i < 2 ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED;
        options.window_rows = 9;
        options.window_cols = 12;
        options.lambda = 1e-9;
        ASSERT_OK(hada_model_from_psf(&model, f->context, &psf, 1, distances, &options, err));
        for (size_t k = 0; k < hada_model_plane(model) * 4; k += 2) {
            assert_true(fabsf(model->filter[k] - 1.0f) < 1e-6f && fabsf(model->filter[k + 1]) < 1e-6f);
            assert_true(fabsf(model->otf[k] - 1.0f) < 1e-6f && fabsf(model->otf[k + 1]) < 1e-6f);
        }
    }
}

/* A Wiener filter from the camera's PSF turns the frame back into the scene, padded and circular. */
TEST(wiener_models_invert_the_camera)
{
    fixture *f = *state;
    static const double distances[] = {100.0};
    for (int padded = 0; padded < 2; padded++) {
        SCOPED(hada_image) psf = small_psf(2, 36, 48, 12, 3), scene = small_scene(2, 12, 16, 8);
        SCOPED(hada_image) frame = small_frame(&psf, &scene, padded, 0.0, 0);
        SCOPED(hada_model) * model;
        SCOPED(hada_hadamard) * stage;
        SCOPED(hada_bank) * bank;
        SCOPED(hada_buffer) planes;
        DEFAULTS(hada_psf_options, options);
        options.boundary = padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR;
        options.window_rows = 12;
        options.window_cols = 16;
        options.lambda = 1e-7;
        options.psf_dark = 0.0;
        ASSERT_OK(hada_model_from_psf(&model, f->context, &psf, 1, distances, &options, err));
        const hada_spectrum_layout layout = hada_hadamard_layout(f->context, &model->info);
        ASSERT_OK(hada_bank_create(&bank, f->slot, model, &layout, NULL, 0, HADA_BANK_FILTERS, 0, err));
        ASSERT_OK(hada_hadamard_create(&stage, f->slot, &model->info, 1, err));
        ASSERT_OK(hada_buffer_create(&planes, f->context, 2 * 12 * 16 * 4, "planes", err));
        hada_pixels pixels;
        hada_pixels_of_image(&pixels, &frame);
        ASSERT_OK(hada_hadamard_frame(stage, &pixels, NULL, err));
        ASSERT_OK(hada_hadamard_run(stage, bank, 0, 1, planes.mem, 0, err));
        float got[2 * 12 * 16];
        ASSERT_OK(hada_buffer_read(&planes, f->slot, 0, got, sizeof got, err));
        const double error = relative_change(got, scene.data, 2 * 12 * 16);
        /* the cropped frame loses a little light at its edges */
        if (!(error < (padded ? 0.02 : 1e-4)))
            fail_msg("%s: relative error %g", padded ? "padded" : "circular", error);
    }
}

TEST(bad_psfs_are_refused)
{
    fixture *f = *state;
    static const double distances[] = {100.0, 200.0};
    hada_model *model;
    hada_image psfs[2] = {small_psf(1, 16, 16, 4, 1), small_psf(1, 16, 18, 4, 1)};
    DEFAULTS(hada_psf_options, options);
    ASSERT_FAILS(hada_model_from_psf(&model, f->context, psfs, 2, distances, NULL, err), HADA_ERROR_SIZE, "");
    options.form = HADA_FORM_SPLIT;
    ASSERT_FAILS(hada_model_from_psf(&model, f->context, psfs, 1, distances, &options, err), HADA_ERROR_ARGUMENT, "");
    options.form = HADA_FORM_WIENER;
    options.window_rows = options.window_cols = 17;
    ASSERT_FAILS(hada_model_from_psf(&model, f->context, psfs, 1, distances, &options, err), HADA_ERROR_SIZE, "");
    psfs[0].data[5] = NAN;
    ASSERT_FAILS(hada_model_from_psf(&model, f->context, psfs, 1, distances, NULL, err), HADA_ERROR_NOT_FINITE, "");
    memset(psfs[0].data, 0, 16 * 16 * sizeof(float));
    ASSERT_FAILS(hada_model_from_psf(&model, f->context, psfs, 1, distances, NULL, err), HADA_ERROR_NUMERIC, "");
    assert_null(model);
    hada_image_destroy(&psfs[0]);
    hada_image_destroy(&psfs[1]);
}

FIXTURE(setup, teardown)
AGAIN(setup_groups, teardown, linear_path_agrees_with_the_reference, half_filters_cost_little)
