/* A small camera with pairs in memory, for tests of the trainer. */
#ifndef HADA_TESTS_TRAINER_FIXTURE_H
#define HADA_TESTS_TRAINER_FIXTURE_H

#include <stdatomic.h>

#include "camera_small.h"
#include "fit/fitter.h"
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

static inline hada_status give(const hada_image *from, hada_image *to, hada_error *error)
{
    HADA_TRY(hada_image_create(to, from->channels, from->rows, from->cols, error));
    memcpy(to->data, from->data, hada_image_count(from) * sizeof(float));
    return HADA_OK;
}

static inline hada_status read_from(int depth, int at, hada_image *raw, hada_image *scene, hada_error *error)
{
    hada_status status = give(&f.raw[depth][at], raw, error);
    return status ? status : give(&f.scene[depth][at], scene, error);
}

static inline hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene,
                                    hada_error *error)
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

static inline hada_status read_held(void *user, int depth, int pair, hada_image *raw, hada_image *scene,
                                    hada_error *error)
{
    (void)user;
    return read_from(depth, PAIRS + pair, raw, scene, error);
}

static hada_dataset *pairs, *held;

static inline void open_devices(void)
{
    DEFAULTS(hada_context_options, options);
    ASSERT_OK(hada_context_create(&f.whole, NULL, err));
    open_parts(f.whole, &options, f.part);
}

/* Squares of light: scenes with edges and plains, which a net can learn to restore. */
static inline void paint(hada_image *scene, uint64_t seed)
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

static inline void make_model(void)
{
    hada_fitter *fitter;
    hada_fit_options options = helpers_fit(DEPTHS, 1, distances, ROWS, COLS, WINDOW);
    options.refine_steps = 2;
    options.alpha = 0.0;
    options.lambda = 1e-3;
    ASSERT_OK(hada_fitter_create(&fitter, f.whole, &options, err));
    for (int z = 0; z < DEPTHS; z++) {
        SCOPED(hada_image) psf = small_psf(1, ROWS, COLS, 30, (uint64_t)z + 1);
        for (int i = 0; i < PAIRS + HELD; i++) {
            ASSERT_OK(hada_image_create(&f.scene[z][i], 1, WINDOW, WINDOW, err));
            paint(&f.scene[z][i], (uint64_t)(100 * z + i));
            f.raw[z][i] = small_frame(&psf, &f.scene[z][i], 0, 0.02, (uint64_t)(100 * z + i));
            if (i < PAIRS)
                ASSERT_OK(hada_fitter_add_pair(fitter, z, &f.raw[z][i], &f.scene[z][i], err));
        }
    }
    ASSERT_OK(hada_fitter_finish(fitter, NULL, &f.model, err));
    hada_fitter_destroy(&fitter);
    ASSERT_OK(hada_model_from_filters(&f.blank, &options, NULL, NULL, err));
}

static inline int setup(void **state)
{
    (void)state;
    ASSERT_OK(hada_dataset_create(&pairs, DEPTHS, distances, pair_counts, read_pair, NULL, NULL, err));
    ASSERT_OK(hada_dataset_create(&held, DEPTHS, distances, held_counts, read_held, NULL, NULL, err));
    open_devices();
    make_model();
    DEFAULTS(hada_unet_options, unet);
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

static inline int teardown(void **state)
{
    (void)state;
    for (int z = 0; z < DEPTHS; z++)
        for (int i = 0; i < PAIRS + HELD; i++) {
            hada_image_destroy(&f.raw[z][i]);
            hada_image_destroy(&f.scene[z][i]);
        }
    hada_dataset_destroy(&pairs);
    hada_dataset_destroy(&held);
    hada_net_destroy(&f.net);
    hada_model_destroy(&f.model);
    hada_model_destroy(&f.blank);
    hada_context *contexts[] = {f.whole, f.part[0], f.part[1]};
    for (int i = 0; i < 3; i++) {
        close_context(&contexts[i]);
    }
    unlink(f.path[0]);
    unlink(f.path[1]);
    return 0;
}

static const hada_stage all_stages[] = {HADA_STAGE_FILTERS, HADA_STAGE_ENHANCE, HADA_STAGE_ADVERSARIAL,
                                        HADA_STAGE_CONVENTIONAL};

/* Of the options that were made last. */
static hada_augment augment;

static inline hada_train_options options_of(hada_stage stage)
{
    hada_train_options options;
    hada_train_options_init(&options, stage);
    hada_augment_init(&augment);
    options.augment = &augment;
    options.net_given = f.net;
    options.batch = 4;
    options.steps = 40;
    options.warmup = 2;
    options.discriminator_steps = stage == HADA_STAGE_ADVERSARIAL ? 2 : 0;
    options.random_start = stage == HADA_STAGE_FILTERS;
    options.filter_rate = 5e-2;
    options.rate = 5e-3;
    options.compose = 0.0;
    return options;
}

static const hada_model *model_of(hada_stage stage)
{
    return stage == HADA_STAGE_FILTERS || stage == HADA_STAGE_CONVENTIONAL ? f.blank : f.model;
}

static inline hada_trainer *make(const hada_train_options *options, int devices)
{
    hada_trainer *trainer;
    if (devices == 1)
        ASSERT_OK(hada_trainer_create(&trainer, &f.whole, 1, model_of(options->stage), pairs, held, options, err));
    else
        ASSERT_OK(hada_trainer_create(&trainer, f.part, devices, model_of(options->stage), pairs, held, options, err));
    return trainer;
}

static inline void steps(hada_trainer *trainer, int count)
{
    for (int i = 0; i < count; i++) {
        hada_step_report report = {.size = sizeof report};
        ASSERT_OK(hada_trainer_step(trainer, &report, err));
        assert_false(report.rolled_back);
        assert_true(isfinite(report.loss) && isfinite(report.norm) && report.rate > 0.0);
    }
}

/* What a trainer holds, byte by byte, is what its checkpoint holds. */
static inline void save(hada_trainer *trainer, int which)
{
    ASSERT_OK(hada_trainer_save(trainer, f.path[which], err));
}

static inline int same_files(void)
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

#endif
