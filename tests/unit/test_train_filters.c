/* Training of filters: gradients against the reference, the reference against differences, convergence. */
#include "train_fixture.h"

typedef struct filter_case {
    int channels, rows, cols, window_rows, window_cols, padded, split;
} filter_case;

/* Even and odd columns, both boundaries, both forms, the window as large as the frame. */
static const filter_case cases[] = {
    {1, 12, 16, 8, 10, 0, 0},  {2, 11, 13, 7, 6, 0, 1}, {3, 12, 15, 6, 7, 1, 0},
    {1, 10, 14, 10, 14, 0, 1}, {2, 9, 12, 5, 8, 1, 1},  {1, 13, 11, 13, 11, 0, 0},
};

static hada_model *model_of(const filter_case *c)
{
    return train_model(c->channels, c->rows, c->cols, c->window_rows, c->window_cols, c->padded, c->split);
}

/* The filters' gradient of depth z by the reference. */
static void expected_gradient(const train_case *c, int depth, double *gradient)
{
    const hada_ref_grid grid = train_grid(c->info);
    const size_t spectrum = 2 * hada_model_info_plane(c->info), frame = (size_t)grid.raw_rows * (size_t)grid.raw_cols;
    const size_t window = (size_t)grid.window_rows * (size_t)grid.window_cols,
                 plane = window * (size_t)c->info->channels;
    SCOPED_MEMORY double *b = calloc(spectrum, sizeof *b), *x = train_output(c), *t = train_scenes(c);
    SCOPED_MEMORY double *dx = calloc(plane * (size_t)c->count, sizeof *dx);
    memset(gradient, 0, spectrum * (size_t)c->info->channels * sizeof *gradient);
    hada_ref_mse(plane * (size_t)c->count, c->options->mse, x, t, dx);
    for (int i = 0; i < c->count; i++)
        for (size_t k = 0; c->samples[i].depth == depth && k < (size_t)c->info->channels; k++) {
            ASSERT_OK(hada_ref_grid_forward(&grid, c->samples[i].input->data + k * frame, grid.raw_row, grid.raw_col,
                                            grid.raw_rows, grid.raw_cols, b, err));
            ASSERT_OK(hada_ref_train_filter(&grid, b, dx + (size_t)i * plane + k * window,
                                            c->info->form == HADA_FORM_SPLIT, gradient + k * spectrum, err));
        }
}

static train_case case_of(const hada_model *model, const hada_train_options *options, const train_pairs *pairs)
{
    const hada_model_info *info = hada_model_get_info(model);
    train_case c = {.info = info, .options = options, .samples = pairs->samples, .count = TRAIN_PAIRS};
    const size_t floats = 2 * hada_model_plane(model) * (size_t)info->channels;
    for (size_t z = 0; z < TRAIN_DEPTHS; z++)
        c.filters[z] = doubles(model->filter + z * floats, floats);
    return c;
}

TEST(gradients_are_the_references)
{
    for (size_t i = 0; i < HADA_COUNT(cases); i++) {
        SCOPED(hada_model) *model = model_of(&cases[i]);
        const hada_train_options options = train_options(HADA_STAGE_FILTERS);
        const hada_replica_desc desc = {.model = model, .options = &options, .at_once = TRAIN_PAIRS};
        train_pairs pairs;
        hada_terms terms;
        unsigned char touched[TRAIN_DEPTHS] = {0};
        train_pairs_make(&pairs, hada_model_get_info(model), 1);
        train_case c = case_of(model, &options, &pairs);
        hada_replica *replica = train_replica(*state, &desc);
        hada_parameters_clear(hada_replica_parameters(replica));
        ASSERT_OK(
            hada_replica_backward(replica, pairs.samples, TRAIN_PAIRS, 1.0 / TRAIN_PAIRS, 1, 0, &terms, touched, err));
        const double loss = train_terms(&c).mse;
        assert_true(fabs(terms.mse - loss) < 1e-5 * loss);
        for (int z = 0; z < TRAIN_DEPTHS; z++) {
            const size_t count =
                hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_FILTERS + z, HADA_CONTENT_GRADIENT);
            SCOPED_MEMORY double *expected = calloc(count, sizeof *expected);
            assert_int_equal(touched[z], 1);
            expected_gradient(&c, z, expected);
            SCOPED_MEMORY float *got = train_read(replica, HADA_GROUP_FILTERS + z, HADA_CONTENT_GRADIENT);
            double size = 0.0;
            for (size_t k = 0; k < count; k++)
                size += expected[k] * expected[k];
            assert_true(size > 0.0);
            assert_true(relative_error(got, expected, count) < 2e-6);
        }
        hada_replica_destroy(&replica);
        train_case_free(&c);
        train_pairs_free(&pairs);
    }
}

TEST(the_reference_is_the_difference)
{
    for (size_t i = 0; i < HADA_COUNT(cases); i++) {
        SCOPED(hada_model) *model = model_of(&cases[i]);
        const hada_train_options options = train_options(HADA_STAGE_FILTERS);
        const size_t count = 2 * hada_model_plane(model) * (size_t)cases[i].channels;
        train_pairs pairs;
        train_pairs_make(&pairs, hada_model_get_info(model), 1);
        train_case c = case_of(model, &options, &pairs);
        double *gradient = calloc(count, sizeof *gradient);
        float *floats = calloc(count, sizeof *floats);
        for (int z = 0; z < TRAIN_DEPTHS; z++) {
            expected_gradient(&c, z, gradient);
            for (size_t k = 0; k < count; k++)
                floats[k] = (float)gradient[k];
            train_difference(&c, c.filters[z], floats, count, 0);
        }
        HADA_FREE(gradient, floats);
        train_case_free(&c);
        train_pairs_free(&pairs);
    }
}

/* One call with three pairs, three with one each, and the first again: the same bits. */
TEST(pieces_give_the_same_bits)
{
    SCOPED(hada_model) *model = model_of(&cases[2]);
    const hada_train_options options = train_options(HADA_STAGE_FILTERS);
    train_pairs pairs;
    float *gradients[3];
    train_pairs_make(&pairs, hada_model_get_info(model), 1);
    size_t count = 0;
    for (int run = 0; run < 3; run++) {
        const int at_once = run == 1 ? 1 : TRAIN_PAIRS;
        const hada_replica_desc desc = {.model = model, .options = &options, .at_once = at_once};
        SCOPED(hada_replica) *replica = train_replica(*state, &desc);
        hada_terms terms;
        hada_parameters_clear(hada_replica_parameters(replica));
        for (int i = 0; i < TRAIN_PAIRS; i += at_once)
            ASSERT_OK(hada_replica_backward(replica, pairs.samples + i, at_once, 0.25, 1, 0, &terms, NULL, err));
        gradients[run] = train_read(replica, HADA_GROUP_FILTERS + 1, HADA_CONTENT_GRADIENT);
        count = hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_FILTERS + 1, HADA_CONTENT_GRADIENT);
    }
    assert_memory_equal(gradients[0], gradients[1], count * sizeof(float));
    assert_memory_equal(gradients[0], gradients[2], count * sizeof(float));
    for (int run = 0; run < 3; run++)
        free(gradients[run]);
    train_pairs_free(&pairs);
}

/* Random starts belong to the seed; values, gradients and state come back as they were written. */
TEST(starts_and_contents)
{
    SCOPED(hada_model) *model = model_of(&cases[0]);
    hada_train_options options = train_options(HADA_STAGE_FILTERS);
    float *starts[3];
    size_t count = 0;
    options.random_start = 1;
    for (int i = 0; i < 3; i++) {
        const hada_replica_desc desc = {.model = model, .options = &options, .at_once = 1};
        options.seed = i == 2 ? 6 : 5;
        options.rule = HADA_RULE_ADAM;
        SCOPED(hada_replica) *replica = train_replica(*state, &desc);
        starts[i] = train_read(replica, HADA_GROUP_FILTERS, HADA_CONTENT_VALUES);
        count = hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_FILTERS, HADA_CONTENT_VALUES);
        assert_int_equal(hada_replica_parameters(replica)->count, HADA_GROUP_FILTERS + TRAIN_DEPTHS);
        assert_int_equal(hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_NET, HADA_CONTENT_VALUES),
                         0);
        for (hada_content content = HADA_CONTENT_VALUES; content <= HADA_CONTENT_STATE; content++) {
            const size_t values =
                hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_FILTERS + 1, content);
            SCOPED_MEMORY float *in = calloc(values, sizeof *in);
            assert_int_equal(values, content == HADA_CONTENT_STATE ? 2 * count : count);
            train_fill(in, values, 0.0, 1.0, 9);
            ASSERT_OK(
                hada_parameters_write(hada_replica_parameters(replica), HADA_GROUP_FILTERS + 1, content, in, err));
            SCOPED_MEMORY float *out = train_read(replica, HADA_GROUP_FILTERS + 1, content);
            assert_memory_equal(in, out, values * sizeof *in);
        }
    }
    assert_memory_equal(starts[0], starts[1], count * sizeof(float));
    assert_memory_not_equal(starts[0], starts[2], count * sizeof(float));
    for (int i = 0; i < 3; i++)
        free(starts[i]);
}

/* Scenes that a known filter makes of the frames: training from a random start finds a filter that does the same, by
 * each rule; `forward` shows it, clipped. */
TEST(random_starts_converge)
{
    for (int run = 0; run < 4; run++) {
        SCOPED(hada_model) *model = train_model(1, 12, 14, 8, 10, 0, run & 1);
        const hada_model_info *info = hada_model_get_info(model);
        hada_train_options options = train_options(HADA_STAGE_FILTERS);
        train_pairs pairs;
        hada_terms terms;
        double first = 0.0;
        options.mse = 1.0;
        options.random_start = 1;
        options.form = info->form;
        options.rule = run < 2 ? HADA_RULE_RMSPROP : HADA_RULE_ADAM;
        train_pairs_make(&pairs, info, 1);
        train_case c = case_of(model, &options, &pairs);
        for (int i = 0; i < TRAIN_PAIRS; i++) {
            double plane[80];
            train_plane(&c, &pairs.samples[i], plane);
            for (size_t k = 0; k < 80; k++)
                pairs.scene[i].data[k] = (float)plane[k];
        }
        const hada_replica_desc desc = {.model = model, .options = &options, .at_once = TRAIN_PAIRS};
        hada_replica *replica = train_replica(*state, &desc);
        for (uint64_t step = 1; step <= 600; step++) {
            const double rate = 0.02 * pow(0.99, (double)step);
            hada_parameters_clear(hada_replica_parameters(replica));
            ASSERT_OK(hada_replica_backward(replica, pairs.samples, TRAIN_PAIRS, 1.0 / TRAIN_PAIRS, step, 0, &terms,
                                            NULL, err));
            first = step == 1 ? terms.mse : first;
            for (int z = 0; z < TRAIN_DEPTHS; z++)
                ASSERT_OK(hada_parameters_update(hada_replica_parameters(replica), HADA_GROUP_FILTERS + z, step, rate,
                                                 1.0, err));
        }
        if (!(terms.mse < 5e-3 * first))
            fail_msg("run %d: from %g to %g", run, first, terms.mse);
        SCOPED(hada_image) before = {0}, after = {0};
        ASSERT_OK(hada_replica_forward(replica, &pairs.samples[0], &before, &after, err));
        for (size_t k = 0; k < 80; k++) {
            assert_true(before.data[k] == after.data[k] && after.data[k] >= 0.0f);
            assert_true(fabs(after.data[k] - fmax(pairs.scene[0].data[k], 0.0)) < 0.1);
        }
        hada_replica_destroy(&replica);
        train_case_free(&c);
        train_pairs_free(&pairs);
    }
}

TEST(what_does_not_fit_is_refused)
{
    net_device *device = *state;
    SCOPED(hada_model) *model = model_of(&cases[1]);
    hada_train_options options = train_options(HADA_STAGE_FILTERS);
    hada_replica_desc desc = {.model = model, .options = &options, .at_once = 2};
    size_t bytes;
    options.form = HADA_FORM_COMPLEX; /* the model is split */
    ASSERT_FAILS(hada_replica_bytes(device->context, &desc, &bytes, err), HADA_ERROR_MODEL, "split");
    options.form = HADA_FORM_WIENER;
    ASSERT_FAILS(hada_replica_bytes(device->context, &desc, &bytes, err), HADA_ERROR_ARGUMENT, "");
}

FIXTURE(net_device_open, net_device_close)
