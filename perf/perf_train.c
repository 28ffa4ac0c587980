/* Times a step of training against its net alone (weights, forward, squared error, backward, update), in turns, and
 * shows which stage takes what; and a step of filters against its transforms.
 *
 *     perf_train [--rounds N] [--at-once N] [CASE...]      cases: compact192 compact512 paper256 adversarial192
 *                                                             filters512
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"
#include "net/graph.h"
#include "net/layers.h"
#include "net/optimizer.h"
#include "netlist/net_list.h"
#include "runtime/profile.h"
#include "train/replica.h"
#include "train_model.h"

#define MOST_ROUNDS 200

typedef struct perf_case {
    const char *name, *net;
    hada_stage stage;
    int frame, window;
} perf_case;
static const perf_case cases[] = {
    {"compact192", "compact", HADA_STAGE_ENHANCE, 192, 192},
    {"compact512", "compact", HADA_STAGE_ENHANCE, 512, 512},
    {"paper256", "paper", HADA_STAGE_ENHANCE, 256, 256},
    {"adversarial192", "compact", HADA_STAGE_ADVERSARIAL, 192, 192},
    {"filters512", NULL, HADA_STAGE_FILTERS, 512, 192},
};

static hada_error err;
static hada_context *context;
static hada_slot *slot;

static void must(hada_status status)
{
    if (status) {
        fprintf(stderr, "perf_train: %s\n%s\n", err.message, err.detail);
        exit(1);
    }
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, compare);
    return values[count / 2];
}

static hada_image noise(int channels, int rows, int cols, unsigned state)
{
    hada_image image;
    must(hada_image_create(&image, channels, rows, cols, &err));
    for (size_t i = 0; i < hada_image_count(&image); i++) {
        state = state * 1664525u + 1013904223u;
        image.data[i] = (float)(state >> 8) / 16777216.0f;
    }
    return image;
}

/* The net alone: what no step can go without. */
typedef struct alone {
    hada_graph *graph;
    hada_buffer values, gradients, state, image, target, loss, scratch;
    hada_tensor goal;
    hada_planar planar;
    hada_optimizer_desc rule;
} alone;

static const hada_loss_desc mse = {HADA_LOSS_MSE, 1.0f};

static alone make_alone(const hada_net *net, int at_once, int side)
{
    alone a = {0};
    const size_t plane = (size_t)side * (size_t)side, channels = (size_t)net->layers[0].channels;
    const hada_graph_options options = {
        .images = at_once, .rows = side, .cols = side, .training = 1, .weight_gradients = 1};
    must(hada_graph_create(&a.graph, slot, net, &options, &err));
    const hada_tensor *out = hada_graph_output(a.graph);
    const size_t floats = out->image_stride * (size_t)out->images, trained = net->trained * sizeof(float);
    hada_image image = noise(3 * at_once, side, side, 1);
    must(hada_buffer_create_from(&a.image, slot, image.data, hada_image_count(&image) * sizeof(float), "image", &err));
    must(hada_buffer_create_from(&a.values, slot, net->values, net->floats * sizeof(float), "values", &err));
    must(hada_buffer_create(&a.gradients, context, trained, "gradients", &err));
    must(hada_buffer_create(&a.state, context, trained, "state", &err));
    must(hada_buffer_clear(&a.state, slot, 0, trained, &err));
    must(hada_buffer_create(&a.target, context, floats * sizeof(float), "target", &err));
    must(hada_buffer_create(&a.loss, context, sizeof(float), "loss", &err));
    must(hada_buffer_create(&a.scratch, context, hada_loss_scratch(out), "scratch", &err));
    a.goal = hada_tensor_at(context, a.target.mem, 0, out->images, out->channels, out->rows, out->cols);
    a.planar = (hada_planar){a.image.mem, 0, plane * channels, plane, (size_t)side};
    must(hada_tensor_load(slot, &a.planar, &a.goal, &err));
    hada_optimizer_desc_init(&a.rule, HADA_OPTIMIZER_RMSPROP);
    hada_image_destroy(&image);
    return a;
}

static void step_alone(alone *a, const hada_net *net, uint64_t step)
{
    const hada_tensor *x = hada_graph_input(a->graph);
    must(hada_graph_set_weights(a->graph, (hada_floats){a->values.mem, 0}, &err));
    must(hada_tensor_load(slot, &a->planar, x, &err));
    must(hada_graph_forward(a->graph, &err));
    must(hada_loss_run(slot, &mse, hada_graph_output(a->graph), &a->goal, (hada_floats){a->loss.mem, 0},
                       hada_graph_output_gradient(a->graph), 0, a->scratch.mem, &err));
    must(hada_graph_backward(a->graph, (hada_floats){a->gradients.mem, 0}, 0, &err));
    must(hada_optimizer_step(slot, &a->rule, step, 1e-6, (hada_floats){a->gradients.mem, 0},
                             (hada_floats){a->values.mem, 0}, (hada_floats){a->state.mem, 0}, net->trained, &err));
    must(hada_slot_finish(slot, &err));
}

static void free_alone(alone *a)
{
    hada_graph_destroy(&a->graph);
    hada_buffer *buffers[] = {&a->values, &a->gradients, &a->state, &a->image, &a->target, &a->loss, &a->scratch};
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
}

static void step_engine(hada_replica *replica, const hada_sample *samples, int at_once, uint64_t step)
{
    hada_terms terms;
    double norm, discriminator_norm;
    unsigned char touched[1] = {0};
    hada_parameters_clear(hada_replica_parameters(replica));
    must(hada_replica_backward(replica, samples, at_once, 1.0 / at_once, step, 0, &terms, touched, &err));
    must(hada_parameters_norm(hada_replica_parameters(replica), touched, &norm, &discriminator_norm, &err));
    for (int group = 0; group < hada_replica_parameters(replica)->count; group++)
        if (hada_parameters_floats(hada_replica_parameters(replica), group, HADA_CONTENT_GRADIENT))
            must(hada_parameters_update(hada_replica_parameters(replica), group, step, 1e-6, 1.0, &err));
    must(hada_slot_finish(slot, &err));
}

static void show_stages(hada_replica *replica, const hada_sample *samples, int at_once, uint64_t step)
{
    hada_kernel_time *rows = NULL;
    size_t count = 0;
    double all = 0.0;
    must(hada_slot_profile(slot, 1, &err));
    step_engine(replica, samples, at_once, step);
    must(hada_slot_times(slot, &rows, &count, &err));
    must(hada_slot_profile(slot, 0, &err));
    for (size_t i = 0; i < count; i++)
        all += rows[i].seconds;
    for (size_t i = 0; i < count; i++) {
        double stage = 0.0;
        int seen = 0;
        for (size_t k = 0; k < count; k++) {
            if (strcmp(rows[i].stage, rows[k].stage))
                continue;
            seen |= k < i;
            stage += rows[k].seconds;
        }
        if (!seen)
            printf("    %-10s %8.2f ms  %5.1f %%\n", rows[i].stage, 1e3 * stage, 100.0 * stage / all);
    }
    free(rows);
}

static void run(const perf_case *c, int rounds, int at_once)
{
    hada_model *model;
    hada_net *net = NULL, *discriminator = NULL, *vgg = NULL;
    hada_replica *replica;
    alone net_alone = {0};
    hada_image input = noise(3, c->frame, c->frame, 3), scene = noise(3, c->window, c->window, 4);
    hada_sample *samples = calloc((size_t)at_once, sizeof *samples);
    double step[MOST_ROUNDS], ratio[MOST_ROUNDS];
    const hada_train_options options = {.size = sizeof options,
                                        .stage = c->stage,
                                        .mse = 1.5,
                                        .perceptual = 0.1,
                                        .adversarial = 8e-3,
                                        .variation = 5e-7};
    must(perf_train_model(&model, c->frame, c->window, &err));
    for (int i = 0; samples && i < at_once; i++)
        samples[i] = (hada_sample){0, &input, &scene, 0, 0.0};
    if (c->net)
        must(hada_net_create_preset(&net, c->net, 3, 1, &err));
    if (c->stage == HADA_STAGE_ADVERSARIAL) {
        must(hada_discriminator_make(&discriminator, "patch", 3, &err));
        must(hada_vgg16_make(&vgg, &err));
        must(hada_net_init(discriminator, 1, &err));
        must(hada_net_init(vgg, 1, &err));
    }
    const hada_replica_desc desc = {.model = model,
                                    .options = &options,
                                    .net = net,
                                    .discriminator = discriminator,
                                    .vgg = vgg,
                                    .at_once = at_once};
    size_t bytes;
    must(hada_replica_bytes(context, &desc, &bytes, &err));
    must(hada_replica_create(&replica, slot, &desc, &err));
    if (net)
        net_alone = make_alone(net, at_once, c->window);
    for (int i = 0; samples && i <= rounds; i++) { /* the first is not counted */
        const double start = hada_seconds();
        step_engine(replica, samples, at_once, (uint64_t)i + 1);
        const double middle = hada_seconds();
        if (net)
            step_alone(&net_alone, net, (uint64_t)i + 1);
        if (i) {
            step[i - 1] = middle - start;
            ratio[i - 1] = (middle - start) / (hada_seconds() - middle);
        }
    }
    printf("%-14s a step of %d: %8.2f ms, %.0f MB", c->name, at_once, 1e3 * median(step, rounds), (double)bytes / 1e6);
    if (net)
        printf(", %.3f times its net alone", median(ratio, rounds));
    printf("\n");
    show_stages(replica, samples, at_once, (uint64_t)rounds + 2);
    hada_replica_destroy(&replica);
    if (net)
        free_alone(&net_alone);
    hada_net_destroy(&net);
    hada_net_destroy(&discriminator);
    hada_net_destroy(&vgg);
    hada_model_destroy(&model);
    hada_image_destroy(&input);
    hada_image_destroy(&scene);
    free(samples);
}

int main(int count, char **words)
{
    int rounds = 9, at_once = 1, named = 0;
    for (int i = 1; i < count; i++) {
        if (!strcmp(words[i], "--rounds") && i + 1 < count)
            rounds = atoi(words[++i]);
        else if (!strcmp(words[i], "--at-once") && i + 1 < count)
            at_once = atoi(words[++i]);
        else
            named = 1;
    }
    if (rounds < 1 || rounds > MOST_ROUNDS || at_once < 1) {
        fprintf(stderr, "perf_train: 1 to %d rounds, at least 1 at once\n", MOST_ROUNDS);
        return 2;
    }
    must(hada_context_create(&context, NULL, &err));
    must(hada_slot_create(&slot, context, &err));
    for (size_t c = 0; c < HADA_COUNT(cases); c++) {
        int wanted = !named;
        for (int i = 1; i < count; i++)
            wanted |= !strcmp(words[i], cases[c].name);
        if (wanted)
            run(&cases[c], rounds, at_once);
    }
    hada_slot_destroy(&slot);
    hada_context_destroy(&context);
    return 0;
}
