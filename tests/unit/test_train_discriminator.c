/* Adversarial training does what it is for: discriminators of patches tell blurred images from sharp ones, and a net
 * that was trained with a squared error becomes sharper against one. */
#include "train_fixture.h"

#include "train/trainer.h"

enum { SIDE = 24, COUNT = 4 };
static const char *const name = "patch";

/* Scenes of blocks with a fine grain, and planes: the same through a box of 3 x 3 and with noise. */
typedef struct examples {
    hada_image plane[COUNT], scene[COUNT];
    hada_sample samples[COUNT];
} examples;

static float near_mean(const hada_image *image, int row, int col)
{
    float sum = 0.0f;
    for (int i = -1; i <= 1; i++)
        for (int j = -1; j <= 1; j++)
            sum += image->data[(row + i + SIDE) % SIDE * SIDE + (col + j + SIDE) % SIDE];
    return sum / 9.0f;
}

static void make(examples *all, uint64_t seed, double noise)
{
    hada_random random;
    hada_random_seed(&random, seed, 3);
    for (int n = 0; n < COUNT; n++) {
        hada_image *scene = &all->scene[n], *plane = &all->plane[n];
        ASSERT_OK(hada_image_create(scene, 1, SIDE, SIDE, err));
        ASSERT_OK(hada_image_create(plane, 1, SIDE, SIDE, err));
        float level[9];
        for (int i = 0; i < 9; i++)
            level[i] = (float)hada_random_range(&random, 0.2, 0.8);
        for (int i = 0; i < SIDE * SIDE; i++)
            scene->data[i] = level[i / SIDE / 8 * 3 + i % SIDE / 8] + (float)(0.08 * hada_random_normal(&random));
        for (int i = 0; i < SIDE * SIDE; i++)
            plane->data[i] = near_mean(scene, i / SIDE, i % SIDE) + (float)(noise * hada_random_normal(&random));
        all->samples[n] = (hada_sample){.input = plane, .scene = scene};
    }
}

static void examples_free(examples *all)
{
    destroy_images(all->plane, COUNT);
    destroy_images(all->scene, COUNT);
}

typedef struct player {
    hada_model *model;
    hada_net *net, *discriminator;
    hada_train_options options;
    hada_replica *replica;
    uint64_t step, net_steps, discriminator_steps;
} player;

/* `net` is taken over. */
static void begin(player *p, const net_device *device, hada_stage stage, const char *discriminator, hada_net *net)
{
    *p = (player){.model = train_model(1, SIDE, SIDE, SIDE, SIDE, 0, 0), .net = net};
    hada_train_options_init(&p->options, stage);
    p->options.adversarial = stage == HADA_STAGE_ADVERSARIAL ? 8e-3 : 0.0;
    if (discriminator) {
        ASSERT_OK(hada_discriminator_make(&p->discriminator, discriminator, 1, err));
        hada_net_init(p->discriminator, 1);
    }
    const hada_replica_desc desc = {
        .model = p->model, .options = &p->options, .net = p->net, .discriminator = p->discriminator, .at_once = COUNT};
    p->replica = train_replica(device, &desc);
}

static void end(player *p)
{
    hada_replica_destroy(&p->replica);
    hada_model_destroy(&p->model);
    hada_net_destroy(&p->net);
    hada_net_destroy(&p->discriminator);
}

static hada_net *new_net(void)
{
    hada_net *net;
    DEFAULTS(hada_unet_options, unet);
    unet.channels = unet.out_channels = 1;
    unet.down = "8|8";
    unet.up = "8";
    ASSERT_OK(hada_net_create_unet(&net, &unet, 4, err));
    assert_true(hada_net_start_as_identity(net));
    return net;
}

/* A step on examples that were never seen; the loss of the discriminator. */
static double play(player *p, int net, int discriminator, double noise)
{
    examples all;
    hada_terms terms;
    make(&all, 1000 + p->step, noise);
    hada_parameters_clear(hada_replica_parameters(p->replica));
    ASSERT_OK(hada_replica_backward(p->replica, all.samples, COUNT, 1.0 / COUNT, ++p->step, !net, &terms, NULL, err));
    if (net)
        ASSERT_OK(hada_parameters_update(hada_replica_parameters(p->replica), HADA_GROUP_NET, ++p->net_steps, 1e-3, 1.0,
                                         err));
    if (discriminator)
        ASSERT_OK(hada_parameters_update(hada_replica_parameters(p->replica), HADA_GROUP_DISCRIMINATOR,
                                         ++p->discriminator_steps, 1e-3, 1.0, err));
    examples_free(&all);
    return terms.discriminator;
}

TEST(blurred_differs_from_sharp)
{
    player p;
    double last = 0.0;
    begin(&p, *state, HADA_STAGE_ADVERSARIAL, name, new_net());
    const double first = play(&p, 0, 1, 0.0);
    for (int k = 0; k < 60; k++) {
        const double loss = play(&p, 0, 1, 0.0);
        last += k < 50 ? 0.0 : loss / 10.0;
    }
    print_message("%s: %.3f, then %.3f\n", name, first, last);
    assert_true(fabs(first - 2.0 * log(2.0)) < 0.2);
    assert_true(last < 1.0);
    end(&p);
}

/* Of what the net makes of new planes: sharpness as a share of the scenes'. */
static double sharpness(player *p, double noise)
{
    examples all;
    double ratio = 0.0;
    make(&all, 1, noise);
    for (int n = 0; n < COUNT; n++) {
        SCOPED(hada_image) after = {0};
        double own, truth;
        ASSERT_OK(hada_replica_forward(p->replica, &all.samples[n], NULL, &after, err));
        ASSERT_OK(hada_metric_sharpness(&after, NULL, &own, err));
        ASSERT_OK(hada_metric_sharpness(&all.scene[n], NULL, &truth, err));
        ratio += own / truth / COUNT;
    }
    examples_free(&all);
    return ratio;
}

TEST(results_become_sharper)
{
    const double noise = 0.05;
    player p;
    hada_net *net, *start;
    begin(&p, *state, HADA_STAGE_ENHANCE, NULL, new_net());
    for (int k = 0; k < 80; k++)
        play(&p, 1, 0, noise);
    const double smooth = sharpness(&p, noise);
    ASSERT_OK(hada_net_copy(&net, p.net, err));
    ASSERT_OK(hada_parameters_read(hada_replica_parameters(p.replica), HADA_GROUP_NET, HADA_CONTENT_VALUES, net->values,
                                   err));
    end(&p);
    ASSERT_OK(hada_net_copy(&start, net, err));
    begin(&p, *state, HADA_STAGE_ADVERSARIAL, name, start);
    for (int k = 0; k < 50; k++)
        play(&p, 0, 1, noise);
    for (int k = 0; k < 80; k++)
        play(&p, 1, 1, noise);
    const double sharp = sharpness(&p, noise);
    print_message("%s: %.3f of the scenes' sharpness, then %.3f\n", name, smooth, sharp);
    assert_true(smooth < 0.8);
    assert_true(sharp > smooth + 0.1 && sharp < 1.3);
    end(&p);
    hada_net_destroy(&net);
}

FIXTURE(net_device_open, net_device_close)
