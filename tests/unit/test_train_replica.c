/* Training of nets: every gradient against differences of the terms in double precision, alone, against a
 * discriminator, and together with filters; norms and updates. */
#include "train_run.h"

static train_case case_of(const replica_run *run, int count)
{
    const hada_model_info *info = hada_model_get_info(run->model);
    const size_t floats = 2 * hada_model_plane(run->model) * (size_t)info->channels;
    train_case c = {.info = info,
                    .options = &run->options,
                    .samples = run->pairs.samples,
                    .count = count,
                    .net = run->net,
                    .discriminator = run->discriminator,
                    .vgg = run->vgg};
    for (size_t z = 0; z < TRAIN_DEPTHS; z++)
        c.filters[z] = doubles(run->model->filter + z * floats, floats);
    c.values = doubles(run->net->values, run->net->floats);
    if (run->discriminator)
        c.discriminator_values = doubles(run->discriminator->values, run->discriminator->floats);
    return c;
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
    near(got->discriminator, expected->discriminator, "discriminator");
}

static void check_group(hada_replica *replica, const train_case *c, int group, double *values)
{
    const size_t count = hada_parameters_floats(hada_replica_parameters(replica), group, HADA_CONTENT_GRADIENT);
    SCOPED_MEMORY float *gradient = train_read(replica, group, HADA_CONTENT_GRADIENT);
    train_difference(c, values, gradient, count, group == HADA_GROUP_DISCRIMINATOR);
}

TEST(gradients_are_differences)
{
    for (size_t i = 0; i < HADA_COUNT(train_cases); i++) {
        replica_run run;
        hada_terms terms;
        unsigned char touched[TRAIN_DEPTHS] = {0};
        run_make(&run, &train_cases[i]);
        train_case c = case_of(&run, TRAIN_PAIRS);
        hada_replica *replica = train_replica(*state, &run.desc);
        print_message("%s\n", train_cases[i].name);
        hada_parameters_clear(hada_replica_parameters(replica));
        ASSERT_OK(hada_replica_backward(replica, run.pairs.samples, TRAIN_PAIRS, 1.0 / TRAIN_PAIRS, 1, 0, &terms,
                                        touched, err));
        const hada_terms expected = train_terms(&c);
        check_terms(&terms, &expected);
        check_group(replica, &c, HADA_GROUP_NET, c.values);
        if (run.discriminator)
            check_group(replica, &c, HADA_GROUP_DISCRIMINATOR, c.discriminator_values);
        for (int z = 0; z < TRAIN_DEPTHS; z++)
            assert_int_equal(touched[z], 0);
        hada_replica_destroy(&replica);
        train_case_free(&c);
        run_free(&run);
    }
}

/* Fewer samples than the replica was made for: those that are missing count nothing. */
TEST(fewer_samples_count_alone)
{
    static const int which[] = {2, 4, 5, 6, 7};
    for (size_t i = 0; i < HADA_COUNT(which); i++) {
        replica_case without_norm = train_cases[which[i]];
        replica_run run;
        hada_terms terms;
        without_norm.norm = 0;
        run_make(&run, &without_norm);
        train_case c = case_of(&run, 2);
        hada_replica *replica = train_replica(*state, &run.desc);
        hada_parameters_clear(hada_replica_parameters(replica));
        ASSERT_OK(hada_replica_backward(replica, run.pairs.samples, 2, 0.5, 1, 0, &terms, NULL, err));
        const hada_terms expected = train_terms(&c);
        check_terms(&terms, &expected);
        check_group(replica, &c, HADA_GROUP_NET, c.values);
        if (run.discriminator)
            check_group(replica, &c, HADA_GROUP_DISCRIMINATOR, c.discriminator_values);
        hada_replica_destroy(&replica);
        train_case_free(&c);
        run_free(&run);
    }
}

/* All at once twice, with less kept, and one by one. */
TEST(pieces_and_recomputing)
{
    replica_case without_norm = train_cases[1];
    float *gradients[4];
    size_t count = 0, bytes[4];
    without_norm.norm = 0;
    for (int way = 0; way < 4; way++) {
        replica_run run;
        hada_terms terms, sum = {0};
        run_make(&run, &without_norm);
        run.desc.at_once = way == 3 ? 1 : TRAIN_PAIRS;
        run.options.recompute = way == 2;
        ASSERT_OK(hada_replica_bytes(((net_device *)*state)->context, &run.desc, &bytes[way], err));
        hada_replica *replica = train_replica(*state, &run.desc);
        hada_parameters_clear(hada_replica_parameters(replica));
        for (int i = 0; i < TRAIN_PAIRS; i += run.desc.at_once) {
            ASSERT_OK(hada_replica_backward(replica, run.pairs.samples + i, run.desc.at_once, 1.0 / TRAIN_PAIRS, 1, 0,
                                            &terms, NULL, err));
            sum.mse += terms.mse;
        }
        train_case c = case_of(&run, TRAIN_PAIRS);
        near(sum.mse, train_terms(&c).mse, "mse of the pieces");
        gradients[way] = train_read(replica, HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
        count = hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
        train_case_free(&c);
        hada_replica_destroy(&replica);
        run_free(&run);
    }
    assert_true(bytes[3] < bytes[0]);
    assert_memory_equal(gradients[0], gradients[1], count * sizeof(float));
    assert_memory_equal(gradients[0], gradients[2], count * sizeof(float));
    assert_true(relative_change(gradients[3], gradients[0], count) < 1e-5);
    for (int way = 0; way < 4; way++)
        free(gradients[way]);
}

/* Steps of the discriminator alone leave the net's gradient as it is, and give its own as other steps do. */
TEST(the_discriminator_alone)
{
    replica_run run;
    hada_terms both, alone;
    run_make(&run, &train_cases[5]);
    hada_replica *replica = train_replica(*state, &run.desc);
    const size_t count =
        hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_DISCRIMINATOR, HADA_CONTENT_GRADIENT);
    hada_parameters_clear(hada_replica_parameters(replica));
    ASSERT_OK(hada_replica_backward(replica, run.pairs.samples, TRAIN_PAIRS, 1.0, 1, 0, &both, NULL, err));
    float *first = train_read(replica, HADA_GROUP_DISCRIMINATOR, HADA_CONTENT_GRADIENT);
    hada_parameters_clear(hada_replica_parameters(replica));
    ASSERT_OK(hada_replica_backward(replica, run.pairs.samples, TRAIN_PAIRS, 1.0, 1, 1, &alone, NULL, err));
    float *second = train_read(replica, HADA_GROUP_DISCRIMINATOR, HADA_CONTENT_GRADIENT);
    float *net = train_read(replica, HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
    assert_memory_equal(first, second, count * sizeof(float));
    assert_true(alone.discriminator == both.discriminator && alone.mse == 0.0 && alone.adversarial == 0.0);
    for (size_t i = 0;
         i < hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_NET, HADA_CONTENT_GRADIENT); i++)
        assert_true(net[i] == 0.0f);
    HADA_FREE(first, second, net);
    hada_replica_destroy(&replica);
    run_free(&run);
}

/* Norms are those of the gradients; an update is the optimiser's, on the gradient times the scale. */
TEST(norms_and_updates)
{
    replica_run run;
    hada_terms terms;
    double norm, discriminator_norm, sums[2] = {0.0};
    const int groups[2] = {HADA_GROUP_NET, HADA_GROUP_DISCRIMINATOR};
    run_make(&run, &train_cases[7]);
    hada_replica *replica = train_replica(*state, &run.desc);
    hada_parameters_clear(hada_replica_parameters(replica));
    ASSERT_OK(hada_replica_backward(replica, run.pairs.samples, TRAIN_PAIRS, 1.0, 1, 0, &terms, NULL, err));
    ASSERT_OK(hada_parameters_norm(hada_replica_parameters(replica), NULL, &norm, &discriminator_norm, err));
    for (int g = 0; g < 2; g++) {
        const double rate = 1e-3, scale = 0.25, eps = 1e-7;
        const size_t count = hada_parameters_floats(hada_replica_parameters(replica), groups[g], HADA_CONTENT_GRADIENT);
        SCOPED_MEMORY float *gradient = train_read(replica, groups[g], HADA_CONTENT_GRADIENT);
        SCOPED_MEMORY float *before = train_read(replica, groups[g], HADA_CONTENT_VALUES);
        ASSERT_OK(hada_parameters_update(hada_replica_parameters(replica), groups[g], 1, rate, scale, err));
        SCOPED_MEMORY float *after = train_read(replica, groups[g], HADA_CONTENT_VALUES);
        SCOPED_MEMORY float *squares = train_read(replica, groups[g], HADA_CONTENT_STATE);
        for (size_t i = 0; i < count; i++) {
            const double v = 0.1 * scale * scale * gradient[i] * (double)gradient[i];
            const double step = gradient[i] != 0.0f ? rate * scale * gradient[i] / sqrt(v + eps) : 0.0;
            assert_true(fabs(after[i] - (before[i] - step)) < 1e-6 * (1.0 + fabs(before[i])));
            assert_true(fabs(squares[i] - v) < 1e-5 * v + 1e-30);
            sums[g] += (double)gradient[i] * gradient[i];
        }
    }
    near(norm, sqrt(sums[0]), "norm");
    near(discriminator_norm, sqrt(sums[1]), "norm of the discriminator");
    hada_replica_destroy(&replica);
    run_free(&run);
}

/* The gradient of one sample, or of the first two, by all terms. */
static float *gradient_of(hada_replica *replica, const hada_sample *samples, int count, hada_terms *terms)
{
    hada_parameters_clear(hada_replica_parameters(replica));
    ASSERT_OK(hada_replica_backward(replica, samples, count, 0.5, 1, 0, terms, NULL, err));
    return train_read(replica, HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
}

/* A sample's weight is that of its gradient; terms are shown without it. */
TEST(weights_are_of_the_gradient)
{
    static const int which[] = {2, 5};
    for (size_t i = 0; i < HADA_COUNT(which); i++) {
        replica_case without_norm = train_cases[which[i]];
        replica_run run;
        hada_terms plain, weighed;
        without_norm.norm = 0;
        run_make(&run, &without_norm);
        hada_replica *replica = train_replica(*state, &run.desc);
        const hada_sample *samples = run.pairs.samples;
        hada_sample both[2] = {samples[0], samples[1]};
        const size_t count =
            hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_NET, HADA_CONTENT_GRADIENT);
        float *first = gradient_of(replica, samples, 1, &plain), *second = gradient_of(replica, samples + 1, 1, &plain);
        free(gradient_of(replica, both, 2, &plain));
        both[0].weight = 2.5;
        both[1].weight = 0.25;
        float *sum = gradient_of(replica, both, 2, &weighed);
        double apart = 0.0, size = 0.0;
        for (size_t k = 0; k < count; k++) {
            const double expected = 2.5 * first[k] + 0.25 * second[k];
            apart += (sum[k] - expected) * (sum[k] - expected);
            size += expected * expected;
        }
        assert_true(size > 0.0 && sqrt(apart / size) < 1e-5);
        check_terms(&weighed, &plain);
        HADA_FREE(first, second, sum);
        hada_replica_destroy(&replica);
        run_free(&run);
    }
}

FIXTURE(net_device_open, net_device_close)
