/* Times the U-nets against PyTorch on the CPU (perf/peers/unet_torch.py, two threads; NCHW and channels_last, the
 * better counts): forward and a whole training step (forward, loss, backward, optimiser). Both take turns, so that a
 * busy machine slows them alike. Printed are medians in milliseconds and, as what counts, the median of the ratios
 * round by round.
 *
 *     perf_unet [--rounds N] [--peer COMMAND] [CASE...]     cases: compact paper compact-train paper-train
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/clock.h"
#include "net/graph.h"
#include "net/layers.h"
#include "net/optimizer.h"
#include "netlist/net_list.h"

#define MOST_ROUNDS 200

static hada_error err;
static hada_context *context;
static hada_slot *slot;

static void must(hada_status status)
{
    if (status) {
        fprintf(stderr, "perf_unet: %s\n%s\n", err.message, err.detail);
        exit(1);
    }
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(const double *values, int count)
{
    double sorted[MOST_ROUNDS];
    memcpy(sorted, values, (size_t)count * sizeof *values);
    qsort(sorted, (size_t)count, sizeof *sorted, compare);
    return sorted[count / 2];
}

/* A peer is a program that answers a line with a line. */
typedef struct peer {
    pid_t process;
    FILE *to, *from;
} peer;

static int start_peer(peer *p, const char *command)
{
    int to[2], from[2];
    if (pipe(to) || pipe(from))
        return 0;
    p->process = fork();
    if (!p->process) {
        dup2(to[0], 0);
        dup2(from[1], 1);
        close(to[1]);
        close(from[0]);
        execl("/bin/sh", "sh", "-c", command, (char *)NULL);
        _exit(127);
    }
    close(to[0]);
    close(from[1]);
    p->to = fdopen(to[1], "w");
    p->from = fdopen(from[0], "r");
    return p->process > 0 && p->to && p->from;
}

static int ask(const peer *p, const char *line, double *first, double *second)
{
    char answer[200];
    fprintf(p->to, "%s\n", line);
    fflush(p->to);
    return fgets(answer, sizeof answer, p->from) && sscanf(answer, "%lf %lf", first, second) == 2;
}

/* A net with everything that a forward run or a training step needs. */
typedef struct side {
    hada_net *net;
    hada_graph *graph;
    hada_buffer values, gradients, state, image, target_values, target_memory, loss, scratch;
    hada_planar planar;
    hada_tensor target;
    hada_optimizer_desc optimizer;
    uint64_t step;
} side;

static float *noise(size_t count)
{
    float *values = malloc(count * sizeof *values);
    unsigned state = 1;
    for (size_t i = 0; values && i < count; i++) {
        state = state * 1664525u + 1013904223u;
        values[i] = (float)(state >> 8) / 16777216.0f;
    }
    return values;
}

static const hada_loss_desc mse = {HADA_LOSS_MSE, 1.0f};

static void make_training(side *s, const float *pixels, int channels, int rows, int cols)
{
    const hada_tensor *out = hada_graph_output(s->graph);
    const size_t floats = out->image_stride * (size_t)out->images;
    const size_t bytes = (size_t)channels * (size_t)rows * (size_t)cols * sizeof(float);
    must(hada_buffer_create_from(&s->target_values, slot, pixels, bytes, "target", &err));
    must(hada_buffer_create(&s->target_memory, context, floats * sizeof(float), "target", &err));
    s->target = hada_tensor_at(context, s->target_memory.mem, 0, out->images, out->channels, out->rows, out->cols);
    hada_planar from = s->planar;
    from.mem = s->target_values.mem;
    if (s->net->colours > 1)
        from.image_stride = from.channel_stride;
    must(hada_tensor_load(slot, &from, &s->target, &err));
    hada_optimizer_desc_init(&s->optimizer, HADA_OPTIMIZER_ADAM);
    const size_t state = hada_optimizer_state_floats(&s->optimizer, s->net->trained) * sizeof(float);
    must(hada_buffer_create(&s->state, context, state, "state", &err));
    must(hada_buffer_clear(&s->state, slot, 0, state, &err));
    must(hada_buffer_create(&s->gradients, context, s->net->trained * sizeof(float), "gradients", &err));
    must(hada_buffer_create(&s->loss, context, sizeof(float), "loss", &err));
    must(hada_buffer_create(&s->scratch, context, hada_loss_scratch(out), "scratch", &err));
}

static side make_side(const char *preset, int training, hada_conv_method method, int channels, int rows, int cols)
{
    side s = {0};
    const size_t plane = (size_t)rows * (size_t)cols, count = (size_t)channels * plane;
    const hada_graph_options options = {
        .images = 1, .rows = rows, .cols = cols, .training = training, .weight_gradients = training, .method = method};
    float *pixels = noise(count);
    must(hada_net_create_preset(&s.net, preset, channels, 1, &err));
    must(hada_graph_create(&s.graph, slot, s.net, &options, &err));
    must(hada_buffer_create_from(&s.values, slot, s.net->values, s.net->floats * sizeof(float), "values", &err));
    must(hada_buffer_create_from(&s.image, slot, pixels, count * sizeof(float), "image", &err));
    must(hada_graph_set_weights(s.graph, (hada_floats){s.values.mem, 0}, &err));
    s.planar = (hada_planar){s.image.mem, 0, count, plane, (size_t)cols};
    if (training)
        make_training(&s, pixels, channels, rows, cols);
    free(pixels);
    return s;
}

static void free_side(side *s)
{
    hada_graph_destroy(&s->graph);
    hada_net_destroy(&s->net);
    hada_buffer *all[] = {&s->values, &s->gradients,     &s->state,   &s->image,
                          &s->loss,   &s->target_values, &s->scratch, &s->target_memory};
    for (size_t i = 0; i < HADA_COUNT(all); i++)
        hada_buffer_destroy(all[i]);
}

static double run_side(side *s)
{
    const double start = hada_seconds();
    must(hada_graph_load(s->graph, &s->planar, &err));
    must(hada_graph_forward(s->graph, &err));
    if (s->state.mem) {
        const hada_floats values = {s->values.mem, 0}, gradients = {s->gradients.mem, 0}, state = {s->state.mem, 0};
        must(hada_loss_run(slot, &mse, hada_graph_output(s->graph), &s->target, (hada_floats){s->loss.mem, 0},
                           hada_graph_output_gradient(s->graph), 0, s->scratch.mem, &err));
        must(hada_graph_backward(s->graph, gradients, 0, &err));
        must(hada_optimizer_step(slot, &s->optimizer, ++s->step, 1e-4f, gradients, values, state, s->net->trained,
                                 &err));
        must(hada_graph_set_weights(s->graph, values, &err));
    }
    must(hada_slot_finish(slot, &err));
    return 1e3 * (hada_seconds() - start);
}

static const struct test_case {
    const char *name, *preset;
    int training, rows, cols;
} cases[] = {{"compact", "compact", 0, 512, 512},
             {"paper", "paper", 0, 256, 256},
             {"compact-train", "compact", 1, 512, 512},
             {"paper-train", "paper", 1, 256, 256}};

static void run_case(const struct test_case *c, const peer *p, int rounds)
{
    static const hada_conv_method methods[] = {HADA_CONV_AUTO, HADA_CONV_DIRECT};
    static const char *const names[] = {"auto", "direct"};
    double ours[2][MOST_ROUNDS], ratio[2][MOST_ROUNDS], planar[MOST_ROUNDS], last[MOST_ROUNDS];
    char line[200];
    side sides[2];
    snprintf(line, sizeof line, "%s %s 3 %d %d", c->preset, c->training ? "train" : "forward", c->rows, c->cols);
    for (int m = 0; m < 2; m++) {
        sides[m] = make_side(c->preset, c->training, methods[m], 3, c->rows, c->cols);
        run_side(&sides[m]);
        run_side(&sides[m]);
    }
    int has_peer = p != NULL;
    for (int r = 0; r < rounds; r++) {
        planar[r] = last[r] = 0;
        has_peer = has_peer && ask(p, line, &planar[r], &last[r]);
        const double best = planar[r] < last[r] ? planar[r] : last[r];
        for (int m = 0; m < 2; m++) {
            ours[m][r] = run_side(&sides[m]);
            ratio[m][r] = has_peer ? ours[m][r] / best : 0;
        }
    }
    if (has_peer)
        printf("%-14s PyTorch NCHW %8.1f ms, channels_last %8.1f ms\n", c->name, median(planar, rounds),
               median(last, rounds));
    for (int m = 0; m < 2; m++) {
        printf("%-14s %-8s %8.1f ms", c->name, names[m], median(ours[m], rounds));
        if (has_peer)
            printf("  ratio %.2f", median(ratio[m], rounds));
        printf("\n");
        free_side(&sides[m]);
    }
    fflush(stdout);
}

int main(int argc, char **argv)
{
    const char *command = NULL;
    int rounds = 15, first = 1;
    peer p = {0};
    for (; first < argc && !strncmp(argv[first], "--", 2); first += 2) {
        if (first + 1 < argc && !strcmp(argv[first], "--rounds"))
            rounds = atoi(argv[first + 1]);
        else if (first + 1 < argc && !strcmp(argv[first], "--peer"))
            command = argv[first + 1];
        else
            return fprintf(stderr, "perf_unet [--rounds N] [--peer COMMAND] [CASE...]\n"), 2;
    }
    if (rounds < 1 || rounds > MOST_ROUNDS)
        return fprintf(stderr, "perf_unet: 1 to %d rounds\n", MOST_ROUNDS), 2;
    signal(SIGPIPE, SIG_IGN);
    if (command && !start_peer(&p, command))
        return fprintf(stderr, "perf_unet: %s does not start\n", command), 1;
    must(hada_context_create(&context, NULL, &err));
    must(hada_slot_create(&slot, context, &err));
    for (size_t i = 0; i < HADA_COUNT(cases); i++) {
        int wanted = first == argc;
        for (int k = first; k < argc; k++)
            wanted |= !strcmp(argv[k], cases[i].name);
        if (wanted)
            run_case(&cases[i], command ? &p : NULL, rounds);
    }
    hada_slot_destroy(&slot);
    hada_context_destroy(&context);
    if (command) {
        fclose(p.to);
        fclose(p.from);
        waitpid(p.process, NULL, 0);
    }
    return 0;
}
