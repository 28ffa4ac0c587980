/* Engines of every stage on small nets. */
#ifndef HADA_TESTS_TRAIN_RUN_H
#define HADA_TESTS_TRAIN_RUN_H

#include "train_fixture.h"

/* discriminator: 1 gives one logit an image, 2 one a patch. */
typedef struct replica_case {
    const char *name;
    hada_stage stage;
    int channels, shared, norm, net_rows, net_cols, vgg, discriminator, squared;
} replica_case;

static const replica_case train_cases[] = {
    {"plain", HADA_STAGE_ENHANCE, 2, 0, 0, 0, 0, 0, 0, 0},
    {"shared, batch norm, squared variation", HADA_STAGE_ENHANCE, 3, 1, 1, 0, 0, 0, 0, 1},
    {"another size, perceptual", HADA_STAGE_ENHANCE, 3, 1, 0, 10, 8, 1, 0, 0},
    {"grey, perceptual", HADA_STAGE_ENHANCE, 1, 0, 0, 0, 0, 1, 0, 0},
    {"adversarial", HADA_STAGE_ADVERSARIAL, 3, 0, 1, 0, 0, 0, 1, 0},
    {"patches, shared, perceptual", HADA_STAGE_ADVERSARIAL, 3, 1, 0, 16, 12, 1, 2, 0},
    {"conventional", HADA_STAGE_CONVENTIONAL, 3, 0, 0, 0, 0, 0, 0, 0},
    {"patches, grey, perceptual, squared variation", HADA_STAGE_ADVERSARIAL, 1, 0, 0, 0, 0, 1, 2, 1},
};
enum { ROWS = 15, COLS = 18, WINDOW_ROWS = 12, WINDOW_COLS = 14 };

/* A case made ready; the replica looks at all pairs at once. */
typedef struct replica_run {
    hada_model *model;
    hada_net *net, *discriminator, *vgg;
    hada_train_options options;
    train_pairs pairs;
    hada_replica_desc desc;
} replica_run;

static inline hada_net *net_from(const char *description, uint64_t seed)
{
    hada_net *net;
    ASSERT_OK(hada_net_create(&net, description, seed, err));
    return net;
}

/* Batch norms that do something, biases that are not zero. */
static inline void shake(hada_net *net, uint64_t stream)
{
    hada_random random;
    hada_random_seed(&random, 21, stream);
    for (size_t i = 0; i < net->trained; i++)
        net->values[i] += (float)(0.05 * hada_random_normal(&random));
}

static inline void run_make(replica_run *run, const replica_case *c)
{
    static const char discriminator[] =
        "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": %d},"
        "{\"layer\": \"conv\", \"name\": \"a\", \"channels\": 5, \"stride\": 2, \"activation\": \"leaky_relu\","
        " \"slope\": 0.2}, {%s, \"name\": \"b\", \"channels\": 1}]}";
    static const char *const ends[] = {"\"layer\": \"linear\", \"in\": 210", "\"layer\": \"conv\""};
    static const char vgg[] =
        "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 3},"
        "{\"layer\": \"conv\", \"name\": \"a\", \"channels\": 6, \"activation\": \"relu\"}, {\"layer\": \"pool\"},"
        "{\"layer\": \"conv\", \"name\": \"b\", \"channels\": 9, \"activation\": \"relu\"}]}";
    char text[512];
    memset(run, 0, sizeof *run);
    run->model = train_model(c->channels, ROWS, COLS, WINDOW_ROWS, WINDOW_COLS, 0, 0);
    DEFAULTS(hada_unet_options, unet);
    unet.channels = unet.out_channels = c->channels;
    unet.down = "5|6";
    unet.up = "4";
    unet.shared = c->shared;
    unet.last_norm = c->norm;
    ASSERT_OK(hada_net_create_unet(&run->net, &unet, 3, err));
    shake(run->net, 1);
    if (c->discriminator) {
        snprintf(text, sizeof text, discriminator, c->channels, ends[c->discriminator > 1]);
        run->discriminator = net_from(text, 4);
    }
    if (c->vgg) {
        run->vgg = net_from(vgg, 5);
        shake(run->vgg, 2);
    }
    run->options = train_options(c->stage);
    run->options.net_rows = c->net_rows;
    run->options.net_cols = c->net_cols;
    run->options.variation_squared = c->squared;
    train_pairs_make(&run->pairs, hada_model_get_info(run->model), 0);
    run->desc = (hada_replica_desc){.model = run->model,
                                    .options = &run->options,
                                    .net = run->net,
                                    .discriminator = run->discriminator,
                                    .vgg = run->vgg,
                                    .at_once = TRAIN_PAIRS};
}

static inline void run_free(replica_run *run)
{
    train_pairs_free(&run->pairs);
    hada_model_destroy(&run->model);
    hada_net_destroy(&run->net);
    hada_net_destroy(&run->discriminator);
    hada_net_destroy(&run->vgg);
}

#endif
