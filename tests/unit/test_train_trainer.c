/* The trainer: all stages learn, go on from checkpoints with the same bits, share steps between devices, and come back
 * from numbers that break down. */
#include "testing.h"

#include <hadalens/fit.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

#include "camera_small.h"
#include "core/error.h"
#include "train/identity.h"
#include "train/trainer.h"

enum { ROWS = 48, COLS = 64, WINDOW = 24, DEPTHS = 2, PAIRS = 5, HELD = 2 };
static const double distances[] = {100.0, 300.0};
static const int pair_counts[] = {PAIRS, PAIRS}, held_counts[] = {HELD, HELD};

typedef struct fixture {
    hada_context *whole, *part[2];
    hada_model *model, *blank;
    hada_net *net;
    hada_image raw[DEPTHS][PAIRS + HELD], scene[DEPTHS][PAIRS + HELD];
    char path[2][64];
    atomic_int reads, broken; /* so many of the next scenes are far too bright */
} fixture;
static fixture f;

static hada_status give(const hada_image *from, hada_image *to, hada_error *error)
{
    const hada_status status = hada_image_create(to, from->channels, from->rows, from->cols, error);
    if (!status)
        memcpy(to->data, from->data, hada_image_count(from) * sizeof(float));
    return status;
}

static hada_status read_from(int depth, int at, hada_image *raw, hada_image *scene, hada_error *error)
{
    hada_status status = give(&f.raw[depth][at], raw, error);
    return status ? status : give(&f.scene[depth][at], scene, error);
}

static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    (void)user;
    f.reads++;
    const hada_status status = read_from(depth, pair, raw, scene, error);
    if (f.broken > 0) {
        f.broken--;
        scene->data[0] = 1e30f;
    }
    return status;
}

static hada_status read_held(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    (void)user;
    return read_from(depth, PAIRS + pair, raw, scene, error);
}

static const hada_pairs pairs = {DEPTHS, pair_counts, read_pair, NULL};
static const hada_pairs held = {DEPTHS, held_counts, read_held, NULL};

static void open_devices(void)
{
    hada_context_options options;
    hada_context_options_init(&options);
    ASSERT_OK(hada_context_create(&f.whole, NULL, err));
    const hada_device_info *device = hada_context_device(f.whole);
    const int divisible = device->max_sub_devices >= 2 && device->compute_units >= 2;
    for (int i = 0; i < 2; i++) {
        options.part = divisible ? i + 1 : 0; /* else two contexts on the whole device */
        options.parts = divisible ? 2 : 0;
        ASSERT_OK(hada_context_create(&f.part[i], &options, err));
    }
}

/* Squares of light: scenes with edges and plains, which a net can learn to restore. */
static void paint(hada_image *scene, uint64_t seed)
{
    hada_random random;
    hada_random_seed(&random, seed, 5);
    for (int k = 0; k < 8; k++) {
        const int size = 3 + (int)hada_random_below(&random, WINDOW / 2);
        const int row = (int)hada_random_below(&random, (uint32_t)(WINDOW - size)),
                  col = (int)hada_random_below(&random, (uint32_t)(WINDOW - size));
        const float value = (float)hada_random_uniform(&random);
        for (int i = row; i < row + size; i++)
            for (int j = col; j < col + size; j++)
                scene->data[i * WINDOW + j] = value;
    }
}

static void make_model(void)
{
    hada_fit_options options;
    hada_fitter *fitter;
    hada_fit_options_init(&options);
    options.depths = DEPTHS;
    options.channels = 1;
    options.distances_mm = distances;
    options.raw_rows = ROWS;
    options.raw_cols = COLS;
    options.window_rows = options.window_cols = WINDOW;
    options.refine_steps = 2;
    options.alpha = 0.0;
    options.lambda = 1e-3;
    ASSERT_OK(hada_fitter_create(&fitter, f.whole, &options, err));
    for (int z = 0; z < DEPTHS; z++) {
        hada_image psf = small_psf(1, ROWS, COLS, 30, (uint64_t)z + 1);
        for (int i = 0; i < PAIRS + HELD; i++) {
            ASSERT_OK(hada_image_create(&f.scene[z][i], 1, WINDOW, WINDOW, err));
            paint(&f.scene[z][i], (uint64_t)(100 * z + i));
            f.raw[z][i] = small_frame(&psf, &f.scene[z][i], 0, 0.02, (uint64_t)(100 * z + i));
            if (i < PAIRS)
                ASSERT_OK(hada_fitter_add(fitter, z, &f.raw[z][i], &f.scene[z][i], err));
        }
        hada_image_destroy(&psf);
    }
    ASSERT_OK(hada_fitter_finish(fitter, &f.model, NULL, NULL, err));
    hada_fitter_destroy(&fitter);
    ASSERT_OK(hada_model_blank(&f.blank, &options, err));
}

static int setup(void **state)
{
    hada_unet_options unet;
    (void)state;
    open_devices();
    make_model();
    hada_unet_options_init(&unet);
    unet.channels = unet.out_channels = 1;
    unet.down = "8|8";
    unet.up = "8";
    ASSERT_OK(hada_net_create_unet(&f.net, &unet, 4, err));
    assert_true(hada_net_start_as_identity(f.net));
    for (int i = 0; i < 2; i++) {
        strcpy(f.path[i], "/tmp/hadalens-test-XXXXXX");
        const int file = mkstemp(f.path[i]);
        assert_true(file >= 0);
        close(file);
    }
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS + HELD; i++) {
            hada_image_destroy(&f.raw[z][i]);
            hada_image_destroy(&f.scene[z][i]);
        }
    hada_net_destroy(&f.net);
    hada_model_destroy(&f.model);
    hada_model_destroy(&f.blank);
    hada_context *contexts[] = {f.whole, f.part[0], f.part[1]};
    for (int i = 0; i < 3; i++) {
        assert_int_equal(hada_context_bytes(contexts[i]), 0);
        hada_context_destroy(&contexts[i]);
    }
    unlink(f.path[0]);
    unlink(f.path[1]);
    return 0;
}

static hada_train_options options_of(hada_stage stage)
{
    hada_train_options options;
    hada_train_options_init(&options, stage);
    options.net_given = f.net;
    options.batch = 4;
    options.steps = 40;
    options.warmup = 2;
    options.critic_steps = stage == HADA_STAGE_ADVERSARIAL ? 2 : 0;
    options.random_start = stage == HADA_STAGE_FILTERS;
    options.filter_rate = stage == HADA_STAGE_JOINT ? 1e-5 : 5e-2;
    options.rate = 5e-3;
    return options;
}

static const hada_model *model_of(hada_stage stage)
{
    return stage == HADA_STAGE_FILTERS || stage == HADA_STAGE_CONVENTIONAL ? f.blank : f.model;
}

static hada_trainer *make(const hada_train_options *options, int devices)
{
    hada_trainer *trainer;
    if (devices == 1)
        ASSERT_OK(hada_trainer_create(&trainer, f.whole, model_of(options->stage), &pairs, &held, options, err));
    else
        ASSERT_OK(
            hada_trainer_create_on(&trainer, f.part, devices, model_of(options->stage), &pairs, &held, options, err));
    return trainer;
}

static void steps(hada_trainer *trainer, int count)
{
    for (int i = 0; i < count; i++) {
        hada_step_report report;
        ASSERT_OK(hada_trainer_step(trainer, &report, err));
        assert_false(report.rolled_back);
        assert_true(isfinite(report.loss) && isfinite(report.norm) && report.rate > 0.0);
    }
}

/* What a trainer holds, byte by byte, is what its checkpoint holds. */
static void save(hada_trainer *trainer, int which)
{
    ASSERT_OK(hada_trainer_save(trainer, f.path[which], err));
}

static int same_files(void)
{
    FILE *a = fopen(f.path[0], "rb"), *b = fopen(f.path[1], "rb");
    int one, two;
    assert_true(a && b);
    do {
        one = getc(a);
        two = getc(b);
    } while (one == two && one != EOF);
    fclose(a);
    fclose(b);
    return one == two;
}

static void every_stage_learns(void **state)
{
    (void)state;
    /* dB on held-out pairs: filters and the conventional net against their start, the others against the planes before
     * the net, which the discriminator leads away from */
    static const double better[] = {0.0, 15.0, 1.0, -8.0, 1.0, 3.0};
    for (hada_stage stage = HADA_STAGE_FILTERS; stage <= HADA_STAGE_CONVENTIONAL; stage++) {
        const int count = stage == HADA_STAGE_ADVERSARIAL ? 10 : 100;
        hada_train_options options = options_of(stage);
        options.steps = (uint64_t)count;
        options.critic_steps = stage == HADA_STAGE_ADVERSARIAL ? 5 : 0;
        hada_trainer *trainer = make(&options, 1);
        hada_validation first, last;
        hada_step_report report;
        double critic = NAN;
        ASSERT_OK(hada_trainer_validate(trainer, 0, &first, err));
        for (int i = 0; i < count; i++) {
            ASSERT_OK(hada_trainer_step(trainer, &report, err));
            assert_int_equal(report.step, i + 1);
            assert_int_equal(report.critic_only, (uint64_t)i < options.critic_steps);
            assert_true(isfinite(report.loss) && report.norm > 0.0 && report.rate > 0.0);
            critic = i ? critic : report.critic;
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
            assert_true(isfinite(report.critic) && report.critic != critic && isfinite(report.adversarial));
        else
            assert_true(isnan(report.critic) && isnan(report.adversarial) && isnan(report.perceptual));
        hada_trainer_destroy(&trainer);
    }
}

static void new_nets_start_with_the_planes(void **state)
{
    (void)state;
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    hada_validation result;
    options.net_given = NULL;
    hada_trainer *trainer = make(&options, 1);
    ASSERT_OK(hada_trainer_validate(trainer, 0, &result, err));
    assert_true(fabs(result.psnr - result.psnr_before) < 1e-3);
    hada_trainer_destroy(&trainer);
    hada_net *paper;
    ASSERT_OK(hada_net_create_preset(&paper, "paper", 3, 1, err));
    const float first = paper->values[0];
    assert_false(hada_net_start_as_identity(paper)); /* its batch norm stands in the way */
    assert_true(paper->values[0] == first);
    hada_net_destroy(&paper);
}

static void going_on_gives_the_same_bits(void **state)
{
    (void)state;
    for (int devices = 1; devices <= 2; devices++)
        for (hada_stage stage = HADA_STAGE_FILTERS; stage <= HADA_STAGE_CONVENTIONAL; stage++) {
            hada_train_options options = options_of(stage);
            options.augment.noise = 0.01;
            options.augment.exposure = 0.1;
            hada_trainer *trainer = make(&options, devices);
            steps(trainer, 6);
            save(trainer, 0);
            hada_trainer_destroy(&trainer);
            trainer = make(&options, devices);
            steps(trainer, 3);
            save(trainer, 1);
            assert_false(same_files());
            hada_trainer_destroy(&trainer);
            trainer = make(&options, devices);
            steps(trainer, 1); /* loading leaves nothing of it */
            ASSERT_OK(hada_trainer_load(trainer, f.path[1], err));
            assert_int_equal(hada_trainer_steps(trainer), 3);
            steps(trainer, 3);
            save(trainer, 1);
            assert_true(same_files());
            hada_trainer_destroy(&trainer);
        }
}

static void fewer_filters_at_once_give_the_same_bits(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        hada_train_options options = options_of(HADA_STAGE_FILTERS);
        options.at_once = i ? 1 : 4;
        hada_trainer *trainer = make(&options, 1);
        steps(trainer, 4);
        save(trainer, i);
        hada_trainer_destroy(&trainer);
    }
    assert_true(same_files());
}

/* The values of a group on a device. */
static float *values_of(const hada_trainer *trainer, int worker, int group, size_t *count)
{
    hada_engine *engine = trainer->workers[worker].engine;
    *count = hada_engine_count(engine, group, HADA_CONTENT_VALUES);
    float *values = malloc(*count * sizeof *values);
    assert_non_null(values);
    ASSERT_OK(hada_engine_read(engine, group, HADA_CONTENT_VALUES, values, err));
    return values;
}

static void two_devices_share_a_step(void **state)
{
    (void)state;
    hada_unet_options unet;
    hada_net *normed;
    hada_unet_options_init(&unet);
    unet.channels = unet.out_channels = 1;
    unet.down = "4|8";
    unet.up = "4";
    unet.last_norm = 1; /* with running statistics */
    ASSERT_OK(hada_net_create_unet(&normed, &unet, 4, err));
    for (int batch = 4; batch <= 5; batch++) {
        hada_train_options options = options_of(HADA_STAGE_JOINT);
        options.batch = batch;
        options.net_given = batch == 5 ? normed : f.net;
        hada_trainer *one = make(&options, 1), *two = make(&options, 2), *again = make(&options, 2);
        steps(one, 4);
        steps(two, 4);
        steps(again, 4);
        save(two, 0);
        save(again, 1);
        assert_true(same_files());
        for (int group = 0; group < one->groups; group++) {
            size_t count, other;
            if (!hada_trainer_has(one, group))
                continue;
            float *alone = values_of(one, 0, group, &count), *first = values_of(two, 0, group, &other),
                  *second = values_of(two, 1, group, &other);
            double apart = 0.0, norm = 0.0;
            assert_memory_equal(first, second, count * sizeof *first);
            for (size_t i = 0; i < count; i++) {
                apart += ((double)alone[i] - first[i]) * ((double)alone[i] - first[i]);
                norm += (double)alone[i] * alone[i];
            }
            /* batch norms see half as many pairs on each device */
            assert_true(sqrt(apart / norm) < (batch == 5 ? 0.1 : 1e-4));
            free(alone);
            free(first);
            free(second);
        }
        hada_trainer_destroy(&one);
        hada_trainer_destroy(&two);
        hada_trainer_destroy(&again);
    }
    hada_net_destroy(&normed);
}

static void broken_numbers_are_rolled_back(void **state)
{
    (void)state;
    for (int devices = 1; devices <= 2; devices++) {
        hada_train_options options = options_of(HADA_STAGE_JOINT);
        hada_step_report report;
        options.augment.noise = 0.01; /* nothing is kept: each pair is read every time */
        options.at_once = 1;
        options.batch = devices;
        options.schedule = HADA_RATE_CONSTANT;
        options.warmup = 0;
        hada_trainer *trainer = make(&options, devices);
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
                assert_int_equal(hada_trainer_steps(trainer), 0);
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
        float *values = values_of(trainer, devices - 1, HADA_GROUP_NET, &count);
        assert_true(isfinite(values[0]));
        free(values);
        hada_trainer_destroy(&trainer);
    }
}

static void a_rate_that_is_too_high_is_halved(void **state)
{
    (void)state;
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    hada_step_report report;
    options.rule = HADA_RULE_ADAM;
    options.rate = 1e12;
    options.clip = 0.0;
    options.warmup = 0;
    hada_trainer *trainer = make(&options, 1);
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
    hada_trainer_destroy(&trainer);
}

static void pairs_are_read_once_where_nothing_changes_them(void **state)
{
    (void)state;
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    f.reads = 0;
    hada_trainer *trainer = make(&options, 1);
    steps(trainer, 20);
    assert_in_range(f.reads, DEPTHS * PAIRS, DEPTHS * PAIRS + 8); /* and some that were on their way */
    hada_trainer_destroy(&trainer);
}

static void checkpoints_of_others_are_refused(void **state)
{
    (void)state;
    hada_train_options options = options_of(HADA_STAGE_ENHANCE), other;
    hada_trainer *trainer = make(&options, 1);
    hada_error error = {0};
    steps(trainer, 1);
    save(trainer, 0);
    hada_trainer_destroy(&trainer);
    for (int kind = 0; kind < 6; kind++) {
        static const char *const words[] = {"the stage is enhance there and conventional here",
                                            "the seed is 1 there and 2 here",
                                            "the batch is 4 there and 3 here",
                                            "the rule is adam there and rmsprop here",
                                            "the net differs",
                                            "depths, channels and sizes"};
        other = options_of(kind == 0 ? HADA_STAGE_CONVENTIONAL : HADA_STAGE_ENHANCE);
        other.seed += kind == 1;
        other.batch -= kind == 2;
        other.rule = kind == 3 ? HADA_RULE_RMSPROP : HADA_RULE_ADAM;
        other.net_given = kind == 4 ? NULL : f.net;
        if (kind == 5) {
            other = options_of(HADA_STAGE_FILTERS);
            other.form = HADA_FORM_SPLIT;
            trainer = make(&other, 1);
            save(trainer, 1);
            hada_trainer_destroy(&trainer);
            other.form = HADA_FORM_COMPLEX;
        }
        trainer = make(&other, 1);
        assert_int_equal(hada_trainer_load(trainer, f.path[kind == 5], &error), HADA_ERROR_MODEL);
        assert_non_null(strstr(error.message, words[kind]));
        assert_non_null(strstr(error.message, f.path[kind == 5]));
        assert_int_equal(hada_trainer_steps(trainer), 0);
        steps(trainer, 1);
        hada_trainer_destroy(&trainer);
    }
    /* the same sizes, but another camera */
    hada_model *flat;
    hada_train_options joint = options_of(HADA_STAGE_JOINT);
    trainer = make(&joint, 1);
    save(trainer, 0);
    ASSERT_OK(hada_trainer_model(trainer, &flat, err));
    steps(trainer, 1);
    hada_model_destroy(&flat);
    ASSERT_OK(hada_trainer_model(trainer, &flat, err));
    hada_trainer_destroy(&trainer);
    ASSERT_OK(hada_trainer_create(&trainer, f.whole, flat, &pairs, NULL, &joint, err));
    assert_int_equal(hada_trainer_load(trainer, f.path[0], &error), HADA_ERROR_MODEL);
    assert_non_null(strstr(error.message, "filters differs"));
    hada_trainer_destroy(&trainer);
    hada_model_destroy(&flat);
}

static void damaged_checkpoints_are_refused(void **state)
{
    (void)state;
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    hada_trainer *trainer = make(&options, 1);
    hada_error error = {0};
    steps(trainer, 1);
    save(trainer, 0);
    FILE *file = fopen(f.path[0], "r+b");
    assert_non_null(file);
    assert_int_equal(ftruncate(fileno(file), 2000), 0);
    fclose(file);
    assert_int_not_equal(hada_trainer_load(trainer, f.path[0], &error), HADA_OK);
    ASSERT_OK(hada_net_save(f.net, f.path[0], err));
    assert_int_equal(hada_trainer_load(trainer, f.path[0], &error), HADA_ERROR_FILE_FORMAT);
    assert_int_equal(hada_trainer_load(trainer, "/nowhere/at/all", &error), HADA_ERROR_FILE_OPEN);
    assert_int_equal(hada_trainer_save(trainer, "/nowhere/at/all", &error), HADA_ERROR_FILE_WRITE);
    assert_int_equal(hada_trainer_steps(trainer), 1);
    steps(trainer, 1);
    hada_trainer_destroy(&trainer);
}

static void stages_follow_one_another(void **state)
{
    (void)state;
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    hada_trainer *trainer = make(&options, 1);
    hada_model *enhanced, *joint;
    hada_net *net;
    hada_error error = {0};
    steps(trainer, 5);
    ASSERT_OK(hada_trainer_model(trainer, &enhanced, err));
    ASSERT_OK(hada_trainer_net(trainer, &net, err));
    hada_trainer_destroy(&trainer);
    const hada_net *own = hada_model_get_enhance(enhanced);
    assert_memory_equal(own->values, net->values, net->floats * sizeof(float));
    assert_memory_not_equal(own->values, f.net->values, net->floats * sizeof(float));
    assert_int_equal(hada_model_get_info(enhanced)->refine_steps, hada_model_get_info(f.model)->refine_steps);
    options = options_of(HADA_STAGE_JOINT);
    options.net_given = NULL; /* the model's */
    ASSERT_OK(hada_trainer_create(&trainer, f.whole, enhanced, &pairs, &held, &options, err));
    assert_memory_equal(hada_trainer_get_net(trainer)->values, net->values, net->floats * sizeof(float));
    steps(trainer, 2);
    ASSERT_OK(hada_trainer_model(trainer, &joint, err));
    assert_int_equal(hada_model_get_info(joint)->refine_steps, 0); /* the net sees linear planes */
    assert_true(hada_model_get_info(joint)->has_otf && hada_model_get_info(joint)->enhance);
    hada_image raw, before, after, truth;
    ASSERT_OK(hada_trainer_show(trainer, 3, &raw, &before, &after, &truth, err));
    assert_int_equal(raw.cols, COLS);
    assert_int_equal(before.cols, WINDOW);
    assert_memory_equal(truth.data, f.scene[1][PAIRS + 1].data, hada_image_count(&truth) * sizeof(float));
    assert_memory_not_equal(before.data, after.data, hada_image_count(&truth) * sizeof(float));
    assert_int_equal(hada_trainer_show(trainer, 4, NULL, NULL, NULL, NULL, &error), HADA_ERROR_ARGUMENT);
    hada_image *all[] = {&raw, &before, &after, &truth};
    for (int i = 0; i < 4; i++)
        hada_image_destroy(all[i]);
    hada_trainer_destroy(&trainer);
    options = options_of(HADA_STAGE_CONVENTIONAL);
    trainer = make(&options, 1);
    hada_model *none;
    assert_int_equal(hada_trainer_model(trainer, &none, &error), HADA_ERROR_STATE);
    hada_trainer_destroy(&trainer);
    hada_model_destroy(&enhanced);
    hada_model_destroy(&joint);
    hada_net_destroy(&net);
}

static void options_that_make_no_sense_are_refused(void **state)
{
    (void)state;
    static const char *const words[] = {"at least one step", "1 to 4096",      "rates are above 0",   "not below 0",
                                        "no stage",          "a random start", "half pixels|0 to 23", "all losses",
                                        "no pair to learn",  "too small",      "model knows 2",       "1 channel"};
    for (int kind = 0; kind < 12; kind++) {
        hada_train_options options = options_of(HADA_STAGE_ENHANCE);
        static const int none[] = {0, 0};
        hada_pairs list = pairs;
        hada_trainer *trainer = NULL;
        hada_error error = {0};
        options.steps -= kind == 0 ? options.steps : 0;
        options.batch = kind == 1 ? 0 : kind == 9 ? 1 : 4;
        options.rate = kind == 2 ? 0.0 : 1e-3;
        options.mse = kind == 3 ? NAN : kind == 7 ? 0.0 : 1.5;
        options.variation = kind == 7 ? 0.0 : 5e-7;
        options.stage = kind == 4 ? (hada_stage)9 : options.stage;
        options.random_start = kind == 5;
        options.augment.shift = kind == 6 ? WINDOW : 0;
        list.counts = kind == 8 ? none : pair_counts;
        list.depths = kind == 10 ? 1 : DEPTHS;
        options.perceptual = kind == 11 ? 0.1 : 0.0;
        options.vgg = kind == 11 ? f.path[0] : NULL;
        assert_int_not_equal(hada_trainer_create_on(&trainer, f.part, 2, f.model, &list, &held, &options, &error),
                             HADA_OK);
        assert_null(trainer);
        if (kind != 6 && !strstr(error.message, words[kind]))
            fail_msg("%d: %s", kind, error.message);
    }
    uint64_t bytes = 0;
    const hada_train_options good = options_of(HADA_STAGE_ENHANCE);
    ASSERT_OK(hada_trainer_bytes(f.whole, f.model, &good, &bytes, err));
    hada_trainer *trainer = make(&good, 1);
    assert_true(bytes > 0 && hada_context_bytes(f.whole) <= bytes);
    hada_trainer_destroy(&trainer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_stage_learns),
        cmocka_unit_test(new_nets_start_with_the_planes),
        cmocka_unit_test(going_on_gives_the_same_bits),
        cmocka_unit_test(fewer_filters_at_once_give_the_same_bits),
        cmocka_unit_test(two_devices_share_a_step),
        cmocka_unit_test(broken_numbers_are_rolled_back),
        cmocka_unit_test(a_rate_that_is_too_high_is_halved),
        cmocka_unit_test(pairs_are_read_once_where_nothing_changes_them),
        cmocka_unit_test(checkpoints_of_others_are_refused),
        cmocka_unit_test(damaged_checkpoints_are_refused),
        cmocka_unit_test(stages_follow_one_another),
        cmocka_unit_test(options_that_make_no_sense_are_refused),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
