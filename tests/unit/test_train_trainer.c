/* The trainer: all stages learn, share steps between devices, follow one another, and come back from numbers that break
 * down. */
#include "testing.h"

#include "trainer_fixture.h"

TEST(every_stage_learns)
{
    /* dB on held-out pairs: filters and the conventional net against their start, the others against the planes before
     * the net, which the discriminator leads away from */
    static const double better[] = {0.0, 15.0, 1.0, -8.0, 1.0, 3.0};
    for (size_t s = 0; s < HADA_COUNT(all_stages); s++) {
        const hada_stage stage = all_stages[s];
        const int count = stage == HADA_STAGE_ADVERSARIAL ? 10 : 100;
        hada_train_options options = options_of(stage);
        options.steps = (uint64_t)count;
        options.discriminator_steps = stage == HADA_STAGE_ADVERSARIAL ? 5 : 0;
        SCOPED(hada_trainer) *trainer = make(&options, 1);
        hada_validation first = {.size = sizeof first}, last = {.size = sizeof last};
        hada_step_report report = {.size = sizeof report};
        double discriminator = NAN;
        ASSERT_OK(hada_trainer_validate(trainer, 0, &first, err));
        for (int i = 0; i < count; i++) {
            ASSERT_OK(hada_trainer_step(trainer, &report, err));
            assert_int_equal(report.step, i + 1);
            assert_int_equal(report.discriminator_only, (uint64_t)i < options.discriminator_steps);
            assert_true(isfinite(report.loss) && report.norm > 0.0 && report.rate > 0.0);
            discriminator = i ? discriminator : report.discriminator;
        }
        ASSERT_OK(hada_trainer_validate(trainer, 0, &last, err));
        assert_int_equal(last.pairs, DEPTHS * HELD);
        const int from_start = stage == HADA_STAGE_FILTERS || stage == HADA_STAGE_CONVENTIONAL;
        const double before = from_start ? first.psnr : last.psnr_before;
        printf("stage %d: %.2f dB, then %.2f dB; before the net %.2f dB\n", (int)stage, first.psnr, last.psnr,
               last.psnr_before);
        assert_true(last.psnr > before + better[stage]);
        assert_true(last.ssim > first.ssim || stage == HADA_STAGE_ADVERSARIAL);
        assert_true(last.sharpness_truth > 0.0 && last.mae > 0.0);
        assert_true(isnan(last.psnr_before) == (stage == HADA_STAGE_CONVENTIONAL));
        if (stage == HADA_STAGE_ADVERSARIAL)
            assert_true(isfinite(report.discriminator) && report.discriminator != discriminator &&
                        isfinite(report.adversarial));
        else
            assert_true(isnan(report.discriminator) && isnan(report.adversarial) && isnan(report.perceptual));
    }
}

TEST(new_nets_start_with_the_planes)
{
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    hada_validation result = {.size = sizeof result};
    options.net_given = NULL;
    hada_trainer *trainer = make(&options, 1);
    ASSERT_OK(hada_trainer_validate(trainer, 0, &result, err));
    assert_true(fabs(result.psnr - result.psnr_before) < 1e-3);
    hada_trainer_destroy(&trainer);
    SCOPED(hada_net) * paper;
    ASSERT_OK(hada_net_create_preset(&paper, "paper", 3, 1, err));
    const float first = paper->values[0];
    assert_false(hada_net_start_as_identity(paper)); /* its batch norm prevents it */
    assert_true(paper->values[0] == first);
}

/* Scenes of several depths are made of pairs, to learn from and to validate with, and have the same bits on any devices
 * and whatever is kept. */
TEST(scenes_of_several_depths_are_learned)
{
    hada_validation first = {.size = sizeof first}, last = {.size = sizeof last}, other = {.size = sizeof other};
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    options.compose = 0.5;
    options.steps = 60;
    options.at_once = 1;
    hada_trainer *one = make(&options, 1), *again = make(&options, 1), *two = make(&options, 2);
    ASSERT_OK(hada_trainer_validate(one, 0, &first, err));
    assert_int_equal(first.pairs, 3 * DEPTHS * HELD);
    again->known.most = 0; /* nothing is kept */
    steps(one, 60);
    steps(again, 60);
    save(one, 0);
    save(again, 1);
    assert_true(same_files());
    ASSERT_OK(hada_trainer_validate(one, 0, &last, err));
    printf("composed: %.2f dB, then %.2f dB\n", last.psnr_before, last.psnr);
    assert_true(last.psnr > last.psnr_before + 0.5);
    assert_true(last.psnr_before == first.psnr_before);
    ASSERT_OK(hada_trainer_validate(two, 0, &other, err));
    assert_true(other.psnr_before == first.psnr_before);
    steps(two, 2);
    hada_trainer_destroy(&two);
    options.compose = 0.25; /* another training */
    hada_trainer *less = make(&options, 1);
    ASSERT_FAILS(hada_trainer_load(less, f.path[0], err), HADA_ERROR_MODEL, "scenes of several depths");
    hada_trainer_destroy(&less);
    hada_trainer_destroy(&one);
    hada_trainer_destroy(&again);
}

/* A new net sees what the other planes of a scene hold; it begins with the planes all the same, follows into the
 * adversarial stage, and reconstruction takes it. */
TEST(new_nets_see_the_other_planes)
{
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    hada_validation result = {.size = sizeof result};
    SCOPED(hada_model) * model;
    hada_trainer *trainer;
    options.net_given = NULL;
    options.compose = 0.5;
    trainer = make(&options, 1);
    const hada_net_info *info = hada_net_get_info(trainer->nets.net);
    assert_int_equal(info->channels, 2);
    assert_int_equal(info->out_channels, 1);
    ASSERT_OK(hada_trainer_validate(trainer, 0, &result, err));
    assert_true(fabs(result.psnr - result.psnr_before) < 1e-3);
    steps(trainer, 3);
    ASSERT_OK(hada_trainer_model(trainer, &model, err));
    hada_trainer_destroy(&trainer);
    options = options_of(HADA_STAGE_ADVERSARIAL);
    options.net_given = NULL;
    options.discriminator = "patch";
    for (int composed = 0; composed < 2; composed++) { /* the net has two inputs whether scenes are composed or not */
        options.compose = 0.5 * composed;
        ASSERT_OK(hada_trainer_create(&trainer, &f.whole, 1, model, pairs, held, &options, err));
        steps(trainer, 4);
        hada_trainer_destroy(&trainer);
    }
    SCOPED(hada_result) enhanced = {0};
    plan_once(f.whole, model, NULL, &f.raw[0][0], &enhanced);
    assert_true(enhanced.report->enhanced > 0);
}

/* As one that learns from scenes of several depths alone does: the model keeps that, and other stages refuse it. */
TEST(a_net_may_only_share_light_out)
{
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    hada_validation result = {.size = sizeof result};
    SCOPED(hada_model) * model;
    hada_trainer *trainer;
    options.net_given = NULL;
    for (int by_itself = 0; by_itself < 2; by_itself++) {
        f.model->info.refine_tv = by_itself ? 0.002 : 0.0;
        options.compose = by_itself ? HADA_AUTO : 1.0;
        trainer = make(&options, 1);
        f.model->info.refine_tv = 0.0;
        assert_true(trainer->options.compose == 1.0);
        assert_int_equal(trainer->nets.net->shares, 1);
        if (!by_itself)
            hada_trainer_destroy(&trainer);
    }
    ASSERT_OK(hada_trainer_validate(trainer, 0, &result, err));
    assert_int_equal(result.pairs, 2 * DEPTHS * HELD); /* none as it was captured */
    steps(trainer, 2);
    ASSERT_OK(hada_trainer_model(trainer, &model, err));
    hada_trainer_destroy(&trainer);
    assert_int_equal(hada_model_get_enhance(model)->shares, 1);
    options.compose = HADA_AUTO;
    ASSERT_OK(hada_trainer_create(&trainer, &f.whole, 1, model, pairs, held, &options, err));
    assert_true(trainer->options.compose == 1.0); /* as the net is */
    hada_trainer_destroy(&trainer);
    for (int adversarial = 0; adversarial < 2; adversarial++) {
        options = options_of(adversarial ? HADA_STAGE_ADVERSARIAL : HADA_STAGE_ENHANCE);
        options.net_given = NULL;
        options.compose = adversarial ? 1.0 : 0.5;
        ASSERT_FAILS(hada_trainer_create(&trainer, &f.whole, 1, model, pairs, held, &options, err), HADA_ERROR_MODEL,
                     "only shares light out");
    }
    for (int depths = 1; depths < 3; depths++) {
        static const int told[] = {0, 1};
        SCOPED(hada_result) planes = {0};
        DEFAULTS(hada_plan_options, how);
        how.occupied = HADA_OCCUPIED_LIST;
        how.occupied_list = told;
        how.occupied_count = depths;
        plan_once(f.whole, model, &how, &f.raw[0][0], &planes);
        assert_int_equal(planes.report->enhanced, depths > 1 ? depths : 0);
    }
}

TEST(composing_that_makes_no_sense_is_refused)
{
    SCOPED(hada_trainer) * trainer;
    hada_train_options options = options_of(HADA_STAGE_CONVENTIONAL);
    options.compose = 0.5;
    ASSERT_FAILS(hada_trainer_create(&trainer, &f.whole, 1, f.model, pairs, held, &options, err), HADA_ERROR_ARGUMENT,
                 "enhance and adversarial");
    options = options_of(HADA_STAGE_ENHANCE);
    options.compose = 1.5;
    ASSERT_FAILS(hada_trainer_create(&trainer, &f.whole, 1, f.model, pairs, held, &options, err), HADA_ERROR_ARGUMENT,
                 "");
    options = options_of(HADA_STAGE_CONVENTIONAL);
    options.compose = HADA_AUTO; /* the caller leaves it open */
    trainer = make(&options, 1);
    assert_true(trainer->options.compose == 0.0);
}

/* The values of a group on a device. */
static float *values_of(const hada_trainer *trainer, int worker, int group, size_t *count)
{
    hada_replica *replica = trainer->workers.worker[worker].replica;
    *count = hada_parameters_floats(hada_replica_parameters(replica), group, HADA_CONTENT_VALUES);
    float *values = malloc(*count * sizeof *values);
    ASSERT_OK(hada_parameters_read(hada_replica_parameters(replica), group, HADA_CONTENT_VALUES, values, err));
    return values;
}

TEST(two_devices_share_a_step)
{
    SCOPED(hada_net) * normed;
    DEFAULTS(hada_unet_options, unet);
    unet.channels = unet.out_channels = 1;
    unet.down = "4|8";
    unet.up = "4";
    unet.last_norm = 1; /* with running statistics */
    ASSERT_OK(hada_net_create_unet(&normed, &unet, 4, err));
    for (int batch = 4; batch <= 5; batch++) {
        hada_train_options options = options_of(HADA_STAGE_ENHANCE);
        options.batch = batch;
        options.net_given = batch == 5 ? normed : f.net;
        hada_trainer *one = make(&options, 1), *two = make(&options, 2), *again = make(&options, 2);
        steps(one, 4);
        steps(two, 4);
        steps(again, 4);
        save(two, 0);
        save(again, 1);
        assert_true(same_files());
        for (int group = 0; group < one->workers.groups; group++) {
            size_t count, other;
            if (!hada_workers_have(&one->workers, group))
                continue;
            SCOPED_MEMORY float *alone = values_of(one, 0, group, &count), *first = values_of(two, 0, group, &other),
                                *second = values_of(two, 1, group, &other);
            double apart = 0.0, norm = 0.0;
            assert_memory_equal(first, second, count * sizeof *first);
            for (size_t i = 0; i < count; i++) {
                apart += ((double)alone[i] - first[i]) * ((double)alone[i] - first[i]);
                norm += (double)alone[i] * alone[i];
            }
            /* batch norms see half as many pairs on each device */
            assert_true(sqrt(apart / norm) < (batch == 5 ? 0.1 : 1e-4));
        }
        hada_trainer_destroy(&one);
        hada_trainer_destroy(&two);
        hada_trainer_destroy(&again);
    }
}

TEST(broken_numbers_are_rolled_back)
{
    for (int devices = 1; devices <= 2; devices++) {
        hada_train_options options = options_of(HADA_STAGE_ENHANCE);
        hada_step_report report = {.size = sizeof report};
        augment.noise = 0.01; /* nothing is kept: each pair is read every time */
        options.at_once = 1;
        options.batch = devices;
        options.schedule = HADA_RATE_CONSTANT;
        options.warmup = 0;
        SCOPED(hada_trainer) *trainer = make(&options, devices);
        steps(trainer, 3);
        ASSERT_OK(hada_trainer_step(trainer, &report, err));
        const double rate = report.rate;
        f.broken = 2 * devices;
        int rolled = 0;
        for (int i = 0; i < 20; i++) {
            ASSERT_OK(hada_trainer_step(trainer, &report, err));
            if (report.rolled_back) {
                assert_true(!isfinite(report.loss) || !isfinite(report.norm));
                assert_int_equal(report.step, 0); /* the snapshot of the start */
                assert_int_equal(trainer->progress.step, 0);
                rolled++;
            }
        }
        assert_in_range(rolled, 1, 2 * devices);
        assert_true(fabs(report.rate / rate * (1 << rolled) - 1.0) < 1e-12);
        assert_true(isfinite(report.loss));
        hada_error error = {0};
        f.broken = 1000;
        hada_status status = HADA_OK;
        for (int i = 0; !status && i < 40; i++)
            status = hada_trainer_step(trainer, &report, &error);
        f.broken = 0;
        assert_int_equal(status, HADA_ERROR_NUMERIC);
        assert_non_null(strstr(error.message, "a rate a tenth as large"));
        size_t count;
        SCOPED_MEMORY float *values = values_of(trainer, devices - 1, HADA_GROUP_NET, &count);
        assert_true(isfinite(values[0]));
    }
}

TEST(a_rate_that_is_too_high_is_halved)
{
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    hada_step_report report = {.size = sizeof report};
    options.rule = HADA_RULE_ADAM;
    options.rate = 1e12;
    options.clip = 0.0;
    options.warmup = 0;
    SCOPED(hada_trainer) *trainer = make(&options, 1);
    hada_error error = {0};
    hada_status status = HADA_OK;
    int rolled = 0;
    for (int i = 0; !status && i < 30; i++) {
        status = hada_trainer_step(trainer, &report, &error);
        rolled += report.rolled_back;
    }
    assert_true(rolled > 0);
    assert_true(report.rate < 1e12 / 2.0 * 1.01);
    save(trainer, 0); /* what is saved is finite */
    ASSERT_OK(hada_trainer_load(trainer, f.path[0], err));
}

TEST(pairs_are_read_once_where_nothing_changes_them)
{
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    f.reads = 0;
    SCOPED(hada_trainer) * trainer;
    SCOPED(hada_model) * model; /* which the trainer outlives */
    ASSERT_OK(hada_model_with_enhance(&model, f.model, NULL, 0, 0, err));
    ASSERT_OK(hada_trainer_create(&trainer, &f.whole, 1, model, pairs, held, &options, err));
    hada_model_destroy(&model);
    steps(trainer, 20);
    assert_in_range(f.reads, DEPTHS * PAIRS, DEPTHS * PAIRS + 8); /* and some that were on their way */
}

/* The store of features needs that: a number identifies one scene, flipped in one way. */
TEST(scenes_have_numbers)
{
    enum { MOST = DEPTHS * PAIRS * HADA_FLIPPED_WAYS };
    hada_image known[MOST + 1] = {{0}};
    for (int changing = 0; changing < 2; changing++) {
        hada_train_options options = options_of(HADA_STAGE_ENHANCE);
        int numbers = 0;
        augment.noise = changing ? 0.01 : 0.0;
        SCOPED(hada_trainer) *trainer = make(&options, 2);
        for (int i = 0; i < 40; i++) {
            steps(trainer, 1);
            for (int k = 0; k < options.batch; k++) {
                const hada_worker *worker = &trainer->workers.worker[k % 2];
                const hada_sample *sample = &worker->samples[k / 2];
                hada_image *own = &known[sample->scene_number];
                assert_true(sample->scene_number <= MOST && (sample->scene_number == 0) == changing);
                if (changing)
                    continue;
                numbers += !own->data;
                if (!own->data)
                    ASSERT_OK(give(sample->scene, own, err));
                assert_memory_equal(own->data, sample->scene->data, hada_image_count(own) * sizeof(float));
            }
        }
        assert_true(changing ? !numbers : numbers > MOST * 3 / 4);
    }
    for (int i = 0; i <= MOST; i++)
        hada_image_destroy(&known[i]);
}

TEST(stages_follow_one_another)
{
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    SCOPED(hada_trainer) *trainer = make(&options, 1);
    SCOPED(hada_model) * enhanced, *sharp;
    SCOPED(hada_net) * net;
    steps(trainer, 5);
    ASSERT_OK(hada_trainer_model(trainer, &enhanced, err));
    ASSERT_OK(hada_trainer_net(trainer, &net, err));
    hada_trainer_destroy(&trainer);
    const hada_net *own = hada_model_get_enhance(enhanced);
    assert_memory_equal(own->values, net->values, net->floats * sizeof(float));
    assert_memory_not_equal(own->values, f.net->values, net->floats * sizeof(float));
    assert_int_equal(hada_model_get_info(enhanced)->refine_steps, hada_model_get_info(f.model)->refine_steps);
    options = options_of(HADA_STAGE_ADVERSARIAL);
    options.net_given = NULL; /* the model's */
    ASSERT_OK(hada_trainer_create(&trainer, &f.whole, 1, enhanced, pairs, held, &options, err));
    assert_memory_equal(trainer->nets.net->values, net->values, net->floats * sizeof(float));
    steps(trainer, 2);
    ASSERT_OK(hada_trainer_model(trainer, &sharp, err));
    assert_true(hada_model_get_info(sharp)->has_otf && hada_model_get_info(sharp)->enhance);
    hada_image raw, before, after, truth;
    ASSERT_OK(hada_trainer_show(trainer, 3, &raw, &before, &after, &truth, err));
    assert_int_equal(raw.cols, COLS);
    assert_int_equal(before.cols, WINDOW);
    assert_memory_equal(truth.data, f.scene[1][PAIRS + 1].data, hada_image_count(&truth) * sizeof(float));
    assert_memory_not_equal(before.data, after.data, hada_image_count(&truth) * sizeof(float));
    ASSERT_FAILS(hada_trainer_show(trainer, 4, NULL, NULL, NULL, NULL, err), HADA_ERROR_ARGUMENT, "");
    hada_image *all[] = {&raw, &before, &after, &truth};
    for (int i = 0; i < 4; i++)
        hada_image_destroy(all[i]);
    hada_trainer_destroy(&trainer);
    options = options_of(HADA_STAGE_CONVENTIONAL);
    trainer = make(&options, 1);
    hada_model *none;
    ASSERT_FAILS(hada_trainer_model(trainer, &none, err), HADA_ERROR_STATE, "");
}

TEST(options_that_make_no_sense_are_refused)
{
    static const char *const words[] = {"at least one step",   "1 to 4096",       "rates are above 0",
                                        "not below 0",         "no stage",        "a random start",
                                        "half pixels|0 to 23", "all losses",      "no pair to learn",
                                        "too small",           "the model has 2", "no tensor features.0"};
    for (int kind = 0; kind < 12; kind++) {
        hada_train_options options = options_of(HADA_STAGE_ENHANCE);
        static const int none[] = {0, 0};
        hada_dataset *list;
        hada_trainer *trainer = NULL;
        hada_error error = {0};
        options.steps -= kind == 0 ? options.steps : 0;
        options.batch = kind == 1 ? 0 : kind == 9 ? 1 : 4;
        options.rate = kind == 2 ? 0.0 : 1e-3;
        options.mse = kind == 3 ? NAN : kind == 7 ? 0.0 : 1.5;
        options.variation = kind == 7 ? 0.0 : 5e-7;
        options.stage = kind == 4 ? (hada_stage)9 : options.stage;
        options.random_start = kind == 5;
        augment.shift = kind == 6 ? WINDOW : 0;
        ASSERT_OK(hada_dataset_create(&list, kind == 10 ? 1 : DEPTHS, distances, kind == 8 ? none : pair_counts,
                                      read_pair, NULL, NULL, err));
        options.perceptual = kind == 11 ? 0.1 : 0.0;
        options.vgg = kind == 11 ? f.path[0] : NULL;
        assert_int_not_equal(hada_trainer_create(&trainer, f.part, 2, f.model, list, held, &options, &error), HADA_OK);
        hada_dataset_destroy(&list);
        assert_null(trainer);
        if (kind != 6 && !strstr(error.message, words[kind]))
            fail_msg("%d: %s", kind, error.message);
    }
    uint64_t bytes = 0;
    const hada_train_options good = options_of(HADA_STAGE_ENHANCE);
    ASSERT_OK(hada_trainer_bytes(f.whole, f.model, &good, &bytes, err));
    SCOPED(hada_trainer) *trainer = make(&good, 1);
    assert_non_null(trainer);
    assert_true(bytes > 0 && hada_context_bytes(f.whole) <= bytes);
}

FIXTURE(setup, teardown)
