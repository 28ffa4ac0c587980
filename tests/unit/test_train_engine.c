/* Training of nets: every gradient against differences of the terms in double precision, alone, against a
 * discriminator, and together with filters; the forward run against reconstruction. */
#include <hadalens/job.h>

#include "net/enhance.h"
#include "train_fixture.h"

typedef struct engine_case {
    const char *name;
    hada_stage stage;
    int channels, shared, norm, net_rows, net_cols, vgg, critic, squared, padded, split;
} engine_case;

static const engine_case cases[] = {
    {"plain", HADA_STAGE_ENHANCE, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0},
    {"shared, batch norm, squared variation", HADA_STAGE_ENHANCE, 3, 1, 1, 0, 0, 0, 0, 1, 0, 0},
    {"another size, perceptual", HADA_STAGE_ENHANCE, 3, 1, 0, 10, 8, 1, 0, 0, 0, 0},
    {"grey, perceptual", HADA_STAGE_ENHANCE, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0},
    {"adversarial", HADA_STAGE_ADVERSARIAL, 3, 0, 1, 0, 0, 0, 1, 0, 0, 0},
    {"adversarial, shared, perceptual", HADA_STAGE_ADVERSARIAL, 3, 1, 0, 16, 12, 1, 1, 0, 0, 0},
    {"joint", HADA_STAGE_JOINT, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0},
    {"joint, split, padded, shared, another size", HADA_STAGE_JOINT, 3, 1, 1, 9, 11, 0, 0, 0, 1, 1},
    {"joint, adversarial", HADA_STAGE_JOINT, 1, 0, 0, 0, 0, 1, 1, 1, 0, 0},
    {"conventional", HADA_STAGE_CONVENTIONAL, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0},
};
enum { ROWS = 15, COLS = 18, WINDOW_ROWS = 12, WINDOW_COLS = 14 };

/* A case made ready; the engine looks at all pairs at once. */
typedef struct engine_run {
    hada_model *model;
    hada_net *net, *critic, *vgg;
    hada_train_options options;
    train_pairs pairs;
    hada_engine_desc desc;
} engine_run;

static hada_net *net_from(const char *description, uint64_t seed)
{
    hada_net *net;
    ASSERT_OK(hada_net_create(&net, description, seed, err));
    return net;
}

/* Batch norms that do something, biases that are not zero. */
static void shake(hada_net *net, uint64_t stream)
{
    hada_random random;
    hada_random_seed(&random, 21, stream);
    for (size_t i = 0; i < net->trained; i++)
        net->values[i] += (float)(0.05 * hada_random_normal(&random));
}

static void run_make(engine_run *run, const engine_case *c)
{
    static const char critic[] =
        "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": %d},"
        "{\"layer\": \"conv\", \"name\": \"a\", \"channels\": 5, \"stride\": 2, \"activation\": \"leaky_relu\","
        " \"slope\": 0.2}, {\"layer\": \"linear\", \"name\": \"b\", \"in\": 210, \"channels\": 1}]}";
    static const char vgg[] =
        "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 3},"
        "{\"layer\": \"conv\", \"name\": \"a\", \"channels\": 6, \"activation\": \"relu\"}, {\"layer\": \"pool\"},"
        "{\"layer\": \"conv\", \"name\": \"b\", \"channels\": 9, \"activation\": \"relu\"}]}";
    char text[512];
    hada_unet_options unet;
    memset(run, 0, sizeof *run);
    run->model = train_model(c->channels, ROWS, COLS, WINDOW_ROWS, WINDOW_COLS, c->padded, c->split);
    hada_unet_options_init(&unet);
    unet.channels = unet.out_channels = c->channels;
    unet.down = "5|6";
    unet.up = "4";
    unet.shared = c->shared;
    unet.last_norm = c->norm;
    ASSERT_OK(hada_net_create_unet(&run->net, &unet, 3, err));
    shake(run->net, 1);
    if (c->critic) {
        snprintf(text, sizeof text, critic, c->channels);
        run->critic = net_from(text, 4);
    }
    if (c->vgg) {
        run->vgg = net_from(vgg, 5);
        shake(run->vgg, 2);
    }
    run->options = train_options(c->stage);
    run->options.net_rows = c->net_rows;
    run->options.net_cols = c->net_cols;
    run->options.variation_squared = c->squared;
    train_pairs_make(&run->pairs, hada_model_get_info(run->model), c->stage == HADA_STAGE_JOINT);
    run->desc = (hada_engine_desc){.model = run->model,
                                   .options = &run->options,
                                   .net = run->net,
                                   .critic = run->critic,
                                   .vgg = run->vgg,
                                   .at_once = TRAIN_PAIRS};
}

static void run_free(engine_run *run)
{
    train_pairs_free(&run->pairs);
    hada_model_destroy(&run->model);
    hada_net_destroy(&run->net);
    hada_net_destroy(&run->critic);
    hada_net_destroy(&run->vgg);
}

static train_case case_of(const engine_run *run, int count)
{
    const hada_model_info *info = hada_model_get_info(run->model);
    const size_t floats = 2 * hada_model_plane(run->model) * (size_t)info->channels;
    train_case c = {.info = info,
                    .options = &run->options,
                    .samples = run->pairs.samples,
                    .count = count,
                    .net = run->net,
                    .critic = run->critic,
                    .vgg = run->vgg};
    for (size_t z = 0; z < TRAIN_DEPTHS; z++)
        c.filters[z] = train_doubles(run->model->filter + z * floats, floats);
    c.values = train_doubles(run->net->values, run->net->floats);
    if (run->critic)
        c.critic_values = train_doubles(run->critic->values, run->critic->floats);
    return c;
}

static void case_free(train_case *c)
{
    for (int z = 0; z < TRAIN_DEPTHS; z++)
        free(c->filters[z]);
    free(c->values);
    free(c->critic_values);
}

static void near(double got, double expected, const char *what)
{
    if (fabs(got - expected) > 2e-5 * fabs(expected) + 1e-12)
        fail_msg("%s: %.9g, expected %.9g", what, got, expected);
}

static void check_terms(const hada_terms *got, const hada_terms *expected)
{
    near(got->mse, expected->mse, "mse");
    near(got->variation, expected->variation, "variation");
    near(got->perceptual, expected->perceptual, "perceptual");
    near(got->adversarial, expected->adversarial, "adversarial");
    near(got->critic, expected->critic, "critic");
}

static void check_group(hada_engine *engine, const train_case *c, int group, double *values)
{
    const size_t count = hada_engine_count(engine, group, HADA_CONTENT_GRADIENT);
    float *gradient = train_read(engine, group, HADA_CONTENT_GRADIENT);
    train_difference(c, values, gradient, count, group == HADA_GROUP_CRITIC);
    free(gradient);
}

static void gradients_are_differences(void **state)
{
    for (size_t i = 0; i < HADA_COUNT(cases); i++) {
        engine_run run;
        hada_terms terms;
        unsigned char touched[TRAIN_DEPTHS] = {0};
        run_make(&run, &cases[i]);
        train_case c = case_of(&run, TRAIN_PAIRS);
        hada_engine *engine = train_engine(*state, &run.desc);
        print_message("%s\n", cases[i].name);
        ASSERT_OK(hada_engine_clear(engine, err));
        ASSERT_OK(hada_engine_backward(engine, run.pairs.samples, TRAIN_PAIRS, 1.0 / TRAIN_PAIRS, 1, 0, &terms, touched,
                                       err));
        const hada_terms expected = train_terms(&c);
        check_terms(&terms, &expected);
        check_group(engine, &c, HADA_GROUP_NET, c.values);
        if (run.critic)
            check_group(engine, &c, HADA_GROUP_CRITIC, c.critic_values);
        for (int z = 0; z < TRAIN_DEPTHS; z++) {
            assert_int_equal(touched[z], cases[i].stage == HADA_STAGE_JOINT);
            if (touched[z])
                check_group(engine, &c, HADA_GROUP_FILTERS + z, c.filters[z]);
        }
        hada_engine_destroy(&engine);
        case_free(&c);
        run_free(&run);
    }
}

/* Fewer samples than the engine was made for: those that are missing count nothing. */
static void fewer_samples_count_alone(void **state)
{
    static const int which[] = {2, 4, 6, 8};
    for (size_t i = 0; i < HADA_COUNT(which); i++) {
        engine_case without_norm = cases[which[i]];
        engine_run run;
        hada_terms terms;
        without_norm.norm = 0;
        run_make(&run, &without_norm);
        train_case c = case_of(&run, 2);
        hada_engine *engine = train_engine(*state, &run.desc);
        ASSERT_OK(hada_engine_clear(engine, err));
        ASSERT_OK(hada_engine_backward(engine, run.pairs.samples, 2, 0.5, 1, 0, &terms, NULL, err));
        const hada_terms expected = train_terms(&c);
        check_terms(&terms, &expected);
        check_group(engine, &c, HADA_GROUP_NET, c.values);
        if (run.critic)
            check_group(engine, &c, HADA_GROUP_CRITIC, c.critic_values);
        if (without_norm.stage == HADA_STAGE_JOINT)
            check_group(engine, &c, HADA_GROUP_FILTERS, c.filters[0]);
        hada_engine_destroy(&engine);
        case_free(&c);
        run_free(&run);
    }
}

static double distance(const float *a, const float *b, size_t count)
{
    double error = 0.0, size = 0.0;
    for (size_t i = 0; i < count; i++) {
        error += ((double)a[i] - b[i]) * ((double)a[i] - b[i]);
        size += (double)b[i] * b[i];
    }
    return sqrt(error / size);
}

/* All at once twice, with less kept, and one by one. */
static void pieces_and_recomputing(void **state)
{
    engine_case without_norm = cases[7];
    float *gradients[2][4];
    size_t counts[2] = {0, 0};
    without_norm.norm = 0;
    for (int way = 0; way < 4; way++) {
        engine_run run;
        hada_terms terms, sum = {0};
        run_make(&run, &without_norm);
        run.desc.at_once = way == 3 ? 1 : TRAIN_PAIRS;
        run.options.recompute = way == 2;
        hada_engine *engine = train_engine(*state, &run.desc);
        ASSERT_OK(hada_engine_clear(engine, err));
        for (int i = 0; i < TRAIN_PAIRS; i += run.desc.at_once) {
            ASSERT_OK(hada_engine_backward(engine, run.pairs.samples + i, run.desc.at_once, 1.0 / TRAIN_PAIRS, 1, 0,
                                           &terms, NULL, err));
            sum.mse += terms.mse;
        }
        train_case c = case_of(&run, TRAIN_PAIRS);
        near(sum.mse, train_terms(&c).mse, "mse of the pieces");
        for (int g = 0; g < 2; g++) {
            const int group = g ? HADA_GROUP_FILTERS + 1 : HADA_GROUP_NET;
            gradients[g][way] = train_read(engine, group, HADA_CONTENT_GRADIENT);
            counts[g] = hada_engine_count(engine, group, HADA_CONTENT_GRADIENT);
        }
        case_free(&c);
        hada_engine_destroy(&engine);
        run_free(&run);
    }
    for (int g = 0; g < 2; g++) {
        assert_memory_equal(gradients[g][0], gradients[g][1], counts[g] * sizeof(float));
        assert_memory_equal(gradients[g][0], gradients[g][2], counts[g] * sizeof(float));
        assert_true(distance(gradients[g][3], gradients[g][0], counts[g]) < 1e-5);
        for (int way = 0; way < 4; way++)
            free(gradients[g][way]);
    }
}

/* Steps of the discriminator alone leave the net's gradient as it is, and give its own as other steps do. */
static void the_critic_alone(void **state)
{
    engine_run run;
    hada_terms both, alone;
    run_make(&run, &cases[5]);
    hada_engine *engine = train_engine(*state, &run.desc);
    const size_t count = hada_engine_count(engine, HADA_GROUP_CRITIC, HADA_CONTENT_GRADIENT);
    ASSERT_OK(hada_engine_clear(engine, err));
    ASSERT_OK(hada_engine_backward(engine, run.pairs.samples, TRAIN_PAIRS, 1.0, 1, 0, &both, NULL, err));
    float *first = train_read(engine, HADA_GROUP_CRITIC, HADA_CONTENT_GRADIENT);
    ASSERT_OK(hada_engine_clear(engine, err));
    ASSERT_OK(hada_engine_backward(engine, run.pairs.samples, TRAIN_PAIRS, 1.0, 1, 1, &alone, NULL, err));
    float *second = train_read(engine, HADA_GROUP_CRITIC, HADA_CONTENT_GRADIENT);
    float *net = train_read(engine, HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
    assert_memory_equal(first, second, count * sizeof(float));
    assert_true(alone.critic == both.critic && alone.mse == 0.0 && alone.adversarial == 0.0);
    for (size_t i = 0; i < hada_engine_count(engine, HADA_GROUP_NET, HADA_CONTENT_GRADIENT); i++)
        assert_true(net[i] == 0.0f);
    free(first);
    free(second);
    free(net);
    hada_engine_destroy(&engine);
    run_free(&run);
}

/* Norms are those of the gradients; an update is the optimiser's, on the gradient times the scale. */
static void norms_and_updates(void **state)
{
    engine_run run;
    hada_terms terms;
    double norm, critic_norm, sums[3] = {0.0};
    const unsigned char touched[TRAIN_DEPTHS] = {0, 1};
    const int groups[3] = {HADA_GROUP_NET, HADA_GROUP_FILTERS + 1, HADA_GROUP_CRITIC};
    run_make(&run, &cases[8]);
    hada_engine *engine = train_engine(*state, &run.desc);
    ASSERT_OK(hada_engine_clear(engine, err));
    ASSERT_OK(hada_engine_backward(engine, run.pairs.samples, TRAIN_PAIRS, 1.0, 1, 0, &terms, NULL, err));
    ASSERT_OK(hada_engine_norm(engine, touched, &norm, &critic_norm, err));
    for (int g = 0; g < 3; g++) {
        const double rate = 1e-3, scale = 0.25, eps = groups[g] >= HADA_GROUP_FILTERS ? 1e-24 : 1e-7;
        const size_t count = hada_engine_count(engine, groups[g], HADA_CONTENT_GRADIENT);
        float *gradient = train_read(engine, groups[g], HADA_CONTENT_GRADIENT);
        float *before = train_read(engine, groups[g], HADA_CONTENT_VALUES);
        ASSERT_OK(hada_engine_update(engine, groups[g], 1, rate, scale, err));
        float *after = train_read(engine, groups[g], HADA_CONTENT_VALUES);
        float *squares = train_read(engine, groups[g], HADA_CONTENT_STATE);
        for (size_t i = 0; i < count; i++) {
            const double v = 0.1 * scale * scale * gradient[i] * (double)gradient[i];
            const double step = gradient[i] != 0.0f ? rate * scale * gradient[i] / sqrt(v + eps) : 0.0;
            assert_true(fabs(after[i] - (before[i] - step)) < 1e-6 * (1.0 + fabs(before[i])));
            assert_true(fabs(squares[i] - v) < 1e-5 * v + 1e-30);
            sums[g] += (double)gradient[i] * gradient[i];
        }
        free(gradient);
        free(before);
        free(after);
        free(squares);
    }
    near(norm, sqrt(sums[0] + sums[1]), "norm");
    near(critic_norm, sqrt(sums[2]), "norm of the critic");
    hada_engine_destroy(&engine);
    run_free(&run);
}

/* What reconstruction makes of the same plane, bit for bit, also after the weights were changed. */
static void forward_is_the_enhancement(void **state)
{
    static const int which[] = {0, 1, 2, 9};
    train_device *device = *state;
    for (size_t i = 0; i < HADA_COUNT(which); i++) {
        engine_run run;
        hada_terms terms;
        hada_image before = {0}, after = {0};
        run_make(&run, &cases[which[i]]);
        hada_engine *engine = train_engine(device, &run.desc);
        ASSERT_OK(hada_engine_clear(engine, err));
        ASSERT_OK(hada_engine_backward(engine, run.pairs.samples, TRAIN_PAIRS, 1.0, 1, 0, &terms, NULL, err));
        ASSERT_OK(hada_engine_update(engine, HADA_GROUP_NET, 1, 1e-3, 1.0, err));
        hada_image *input = &run.pairs.input[0];
        ASSERT_OK(hada_engine_forward(engine, &run.pairs.samples[0], &before, &after, err));
        assert_memory_equal(before.data, input->data, hada_image_count(input) * sizeof(float));
        ASSERT_OK(hada_engine_read(engine, HADA_GROUP_NET, HADA_CONTENT_VALUES, run.net->values, err));
        const hada_enhance_desc desc = {.net = run.net,
                                        .channels = cases[which[i]].channels,
                                        .rows = WINDOW_ROWS,
                                        .cols = WINDOW_COLS,
                                        .net_rows = run.options.net_rows,
                                        .net_cols = run.options.net_cols};
        hada_enhance *enhance;
        hada_buffer buffer;
        const size_t bytes = hada_image_count(input) * sizeof(float);
        ASSERT_OK(hada_enhance_create(&enhance, device->slot, &desc, err));
        ASSERT_OK(hada_buffer_create_from(&buffer, device->slot, input->data, bytes, "a plane", err));
        ASSERT_OK(hada_enhance_run(enhance, buffer.mem, 0, 1, err));
        ASSERT_OK(hada_buffer_read(&buffer, device->slot, 0, before.data, bytes, err));
        assert_memory_equal(before.data, after.data, bytes);
        memset(input->data, 0, bytes);
        ASSERT_OK(hada_engine_forward(engine, &run.pairs.samples[0], NULL, &after, err));
        assert_memory_equal(input->data, after.data, bytes);
        hada_enhance_destroy(&enhance);
        hada_buffer_destroy(&buffer);
        hada_image_destroy(&before);
        hada_image_destroy(&after);
        hada_engine_destroy(&engine);
        run_free(&run);
    }
}

/* Joint: what the model with that net reconstructs, bit for bit. */
static void forward_is_the_reconstruction(void **state)
{
    train_device *device = *state;
    static const int listed[] = {1};
    for (int i = 6; i <= 8; i++) {
        engine_run run;
        hada_model *model;
        hada_plan *plan;
        hada_plan_options options;
        hada_result result = {0};
        hada_image before = {0}, after = {0};
        run_make(&run, &cases[i]);
        hada_engine *engine = train_engine(device, &run.desc);
        ASSERT_OK(hada_engine_forward(engine, &run.pairs.samples[0], &before, &after, err));
        ASSERT_OK(hada_model_with_enhance(&model, run.model, run.net, run.options.net_rows, run.options.net_cols, err));
        hada_plan_options_init(&options);
        options.occupied = HADA_OCCUPIED_LIST;
        options.occupied_list = listed;
        options.occupied_count = 1;
        for (int enhance = 0; enhance < 2; enhance++) {
            options.enhance = enhance;
            ASSERT_OK(hada_plan_create(&plan, device->context, model, &options, err));
            ASSERT_OK(hada_plan_run(plan, &run.pairs.input[0], &result, err));
            assert_memory_equal(result.planes[1].data, enhance ? after.data : before.data,
                                hada_image_count(&after) * sizeof(float));
            hada_plan_destroy(&plan);
        }
        hada_result_destroy(&result);
        hada_image_destroy(&before);
        hada_image_destroy(&after);
        hada_model_destroy(&model);
        hada_engine_destroy(&engine);
        run_free(&run);
    }
}

static void nets_that_do_not_fit_are_refused(void **state)
{
    train_device *device = *state;
    engine_run run;
    hada_error error;
    size_t bytes;
    run_make(&run, &cases[5]);
    hada_engine_desc desc = run.desc;
    desc.net = run.vgg; /* gives nine channels */
    assert_int_equal(hada_engine_bytes(device->context, &desc, &bytes, &error), HADA_ERROR_MODEL);
    desc = run.desc;
    desc.critic = run.net;
    assert_int_equal(hada_engine_bytes(device->context, &desc, &bytes, &error), HADA_ERROR_MODEL);
    desc.critic = NULL;
    assert_int_equal(hada_engine_bytes(device->context, &desc, &bytes, &error), HADA_ERROR_ARGUMENT);
    desc = run.desc;
    run.options.size = 0;
    assert_int_equal(hada_engine_bytes(device->context, &desc, &bytes, &error), HADA_ERROR_ARGUMENT);
    run_free(&run);
    run_make(&run, &cases[0]);
    desc = run.desc;
    assert_int_equal(hada_net_create_preset(&run.vgg, "compact", 3, 1, &error), HADA_OK);
    desc.vgg = run.vgg; /* two channels are no colours */
    assert_int_equal(hada_engine_bytes(device->context, &desc, &bytes, &error), HADA_ERROR_MODEL);
    run_free(&run);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradients_are_differences),
        cmocka_unit_test(fewer_samples_count_alone),
        cmocka_unit_test(pieces_and_recomputing),
        cmocka_unit_test(the_critic_alone),
        cmocka_unit_test(norms_and_updates),
        cmocka_unit_test(forward_is_the_enhancement),
        cmocka_unit_test(forward_is_the_reconstruction),
        cmocka_unit_test(nets_that_do_not_fit_are_refused),
    };
    return cmocka_run_group_tests(tests, train_open, train_close);
}
