/* Times the convolutions of nets: forward, gradient of the input, gradients of weights and biases.
 *
 *     perf_conv [--rounds N] [METHOD...]        METHOD: auto direct winograd4 (all: auto direct)
 *     perf_conv --serve                         for perf/peers/conv_torch.py, which takes turns with PyTorch
 *
 * Served lines are "WHAT METHOD IN OUT SIZE KERNEL STRIDE PAD TRANSPOSED", WHAT one of forward, data, weights; each is
 * run once and answered with the milliseconds that passed and that processors worked. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "net/conv.h"

enum { MOST_ROUNDS = 1000, WORDS = 16 };

static hada_error err;
static hada_context *context;
static hada_slot *slot;

static void must(hada_status status)
{
    if (status) {
        fprintf(stderr, "perf_conv: %s\n%s\n", err.message, err.detail);
        exit(1);
    }
}

static double milliseconds(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return 1e3 * (double)t.tv_sec + 1e-6 * (double)t.tv_nsec;
}

static const char *const methods[] = {"auto", "direct", "", "winograd4", "plain"};
static const char *const whats[] = {"forward", "data", "weights"};

static int number_of(const char *word, const char *const *names, int count)
{
    for (int i = 0; i < count; i++)
        if (!strcmp(word, names[i]))
            return i;
    fprintf(stderr, "perf_conv: what is '%s'?\n", word);
    exit(2);
}

typedef struct layer {
    int in, out, size, kernel, stride, pad, transposed;
} layer;

typedef struct job {
    hada_conv *conv;
    hada_buffer x, y, dx, dy, w, b, dw, db;
    hada_tensor tx, ty, tdx, tdy;
} job;

static hada_tensor random_tensor(hada_buffer *buffer, int channels, int rows, int cols)
{
    hada_tensor tensor = hada_tensor_at(context, NULL, 0, 1, channels, rows, cols);
    hada_buffer planes;
    const size_t count = (size_t)channels * (size_t)rows * (size_t)cols;
    float *values = malloc(count * sizeof *values);
    unsigned state = (unsigned)count;
    if (!values)
        exit(1);
    for (size_t i = 0; i < count; i++) {
        state = state * 1664525u + 1013904223u;
        values[i] = (float)(state >> 8) / 8388608.0f - 1.0f;
    }
    must(hada_buffer_create(buffer, context, tensor.image_stride * sizeof(float), "a tensor", &err));
    must(hada_buffer_create_from(&planes, slot, values, count * sizeof *values, "planes", &err));
    tensor.mem = buffer->mem;
    must(hada_tensor_load(slot, &(hada_planar){planes.mem, 0, count, (size_t)rows * (size_t)cols, (size_t)cols},
                          &tensor, &err));
    must(hada_slot_finish(slot, &err));
    hada_buffer_destroy(&planes);
    free(values);
    return tensor;
}

static void make(job *work, const layer *l, int method)
{
    const hada_conv_desc desc = {.images = 1,
                                 .in_channels = l->in,
                                 .out_channels = l->out,
                                 .in_rows = l->size,
                                 .in_cols = l->size,
                                 .kernel_rows = l->kernel,
                                 .kernel_cols = l->kernel,
                                 .stride = l->stride,
                                 .pad_rows = l->pad,
                                 .pad_cols = l->pad,
                                 .transposed = l->transposed,
                                 .activation = HADA_ACTIVATION_RELU,
                                 .method = (hada_conv_method)method,
                                 .training = 1};
    int rows, cols;
    hada_conv_output_size(&desc, &rows, &cols);
    work->tx = random_tensor(&work->x, l->in, l->size, l->size);
    work->ty = random_tensor(&work->y, l->out, rows, cols);
    work->tdx = random_tensor(&work->dx, l->in, l->size, l->size);
    work->tdy = random_tensor(&work->dy, l->out, rows, cols);
    const size_t weights = (size_t)l->in * (size_t)l->out * (size_t)l->kernel * (size_t)l->kernel;
    float *values = calloc(weights, sizeof *values);
    if (!values)
        exit(1);
    for (size_t i = 0; i < weights; i++)
        values[i] = (float)(i % 17) / 170.0f - 0.05f;
    must(hada_buffer_create_from(&work->w, slot, values, weights * sizeof *values, "weights", &err));
    must(hada_buffer_create_from(&work->dw, slot, values, weights * sizeof *values, "weights", &err));
    must(hada_buffer_create_from(&work->b, slot, values, (size_t)l->out * sizeof *values, "biases", &err));
    must(hada_buffer_create_from(&work->db, slot, values, (size_t)l->out * sizeof *values, "biases", &err));
    free(values);
    must(hada_conv_create(&work->conv, slot, &desc, &err));
    must(hada_conv_set_weights(work->conv, (hada_floats){work->w.mem, 0}, &err));
}

static void unmake(job *work)
{
    hada_buffer *const buffers[] = {&work->x, &work->y, &work->dx, &work->dy, &work->w, &work->b, &work->dw, &work->db};
    hada_conv_destroy(&work->conv);
    for (size_t i = 0; i < HADA_COUNT(buffers); i++)
        hada_buffer_destroy(buffers[i]);
}

static void run(const job *work, int what)
{
    if (what == 0)
        must(hada_conv_forward(work->conv, &work->tx, (hada_floats){work->b.mem, 0}, &work->ty, NULL, &err));
    else if (what == 1)
        must(hada_conv_backward_data(work->conv, &work->tdy, NULL, &work->tdx, 0, &err));
    else
        must(hada_conv_backward_weights(work->conv, &work->tx, &work->tdy, (hada_floats){work->dw.mem, 0},
                                        (hada_floats){work->db.mem, 0}, 0, &err));
    must(hada_slot_finish(slot, &err));
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void time_layer(const layer *l, int method, int rounds)
{
    job work = {0};
    make(&work, l, method);
    const double flops = 2.0 * l->in * l->out * l->kernel * l->kernel *
                         (l->transposed ? (double)l->size * l->size : (double)(work.ty.rows * work.ty.cols));
    printf("%3d -> %3d at %3d %dx%d%s%s %-9s", l->in, l->out, l->size, l->kernel, l->kernel,
           l->stride > 1 ? " stride 2" : "", l->transposed ? " transposed" : "", methods[method]);
    for (int what = 0; what < 3; what++) {
        double wall[MOST_ROUNDS], processor[MOST_ROUNDS];
        run(&work, what);
        for (int i = 0; i < rounds; i++) {
            const double start = milliseconds(CLOCK_MONOTONIC), used = milliseconds(CLOCK_PROCESS_CPUTIME_ID);
            run(&work, what);
            processor[i] = milliseconds(CLOCK_PROCESS_CPUTIME_ID) - used;
            wall[i] = milliseconds(CLOCK_MONOTONIC) - start;
        }
        qsort(wall, (size_t)rounds, sizeof *wall, compare);
        qsort(processor, (size_t)rounds, sizeof *processor, compare);
        printf("  %s %7.3f (%7.3f, processors %7.3f) ms %5.0f GFLOP/s", whats[what], wall[rounds / 2], wall[0],
               processor[rounds / 2], flops / wall[0] * 1e-6);
    }
    printf("\n");
    fflush(stdout);
    unmake(&work);
}

static void serve(void)
{
    char line[256], last[256] = "", what[WORDS], method[WORDS];
    job work = {0};
    while (fgets(line, sizeof line, stdin)) {
        layer l;
        if (sscanf(line, "%15s %15s %d %d %d %d %d %d %d", what, method, &l.in, &l.out, &l.size, &l.kernel, &l.stride,
                   &l.pad, &l.transposed) != 9) {
            fprintf(stderr, "perf_conv: what is '%s'?\n", line);
            exit(2);
        }
        const char *shape = strchr(line, ' ');
        const int number = number_of(what, whats, 3);
        if (strcmp(shape, last)) {
            unmake(&work);
            make(&work, &l, number_of(method, methods, 5));
            strcpy(last, shape);
        }
        const double start = milliseconds(CLOCK_MONOTONIC), used = milliseconds(CLOCK_PROCESS_CPUTIME_ID);
        run(&work, number);
        printf("%.6f %.6f\n", milliseconds(CLOCK_MONOTONIC) - start, milliseconds(CLOCK_PROCESS_CPUTIME_ID) - used);
        fflush(stdout);
    }
    unmake(&work);
}

int main(int count, char **words)
{
    static const layer layers[] = {
        {16, 16, 512, 3, 1, 1, 0},  {32, 32, 256, 3, 1, 1, 0}, {64, 64, 128, 3, 1, 1, 0},  {128, 128, 64, 3, 1, 1, 0},
        {256, 256, 32, 3, 1, 1, 0}, {3, 16, 512, 3, 1, 1, 0},  {1, 32, 256, 3, 1, 1, 0},   {32, 64, 128, 3, 1, 1, 0},
        {64, 64, 64, 3, 1, 1, 0},   {64, 128, 32, 3, 1, 1, 0}, {128, 256, 16, 3, 1, 1, 0}, {256, 512, 8, 3, 1, 1, 0},
        {512, 256, 8, 3, 1, 1, 0},  {16, 3, 512, 1, 1, 0, 0},  {32, 16, 256, 2, 2, 0, 1},  {256, 128, 32, 2, 2, 0, 1},
        {32, 64, 128, 3, 2, 1, 0},
    };
    int rounds = 15, chosen = 0, serving = 0, tried[WORDS] = {0, 1};
    for (int i = 1; i < count; i++) {
        if (!strcmp(words[i], "--serve"))
            serving = 1;
        else if (!strcmp(words[i], "--rounds") && i + 1 < count)
            rounds = atoi(words[++i]);
        else if (chosen < WORDS)
            tried[chosen++] = number_of(words[i], methods, 5);
    }
    rounds = rounds < 1 ? 1 : rounds > MOST_ROUNDS ? MOST_ROUNDS : rounds;
    must(hada_context_create(&context, NULL, &err));
    must(hada_slot_create(&slot, context, &err));
    if (serving)
        serve();
    else
        printf("%s, blocks of %d; median (fastest, median of the processors' time) of %d rounds\n", context->info.name,
               hada_net_block(context), rounds);
    for (size_t i = 0; !serving && i < HADA_COUNT(layers); i++)
        for (int m = 0; m < (chosen ? chosen : 2); m++)
            time_layer(&layers[i], tried[m], rounds);
    hada_slot_destroy(&slot);
    hada_context_destroy(&context);
    return 0;
}
