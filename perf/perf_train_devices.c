/* Times training on a whole device against two halves of it, which share each step's pairs: steps in turns, so that
 * both meet the same weather; wall time and the processor time of the process.
 *
 *     perf_train_devices [--rounds N] [--profile] [--only 1|2] [CASE...]
 *
 * Cases: compact72 odd72 compact96 compact192 filters192. --profile: what each device's commands take; --only:
 * one device alone, or two alone, for a profiler of the system. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "core/clock.h"
#include "runtime/profile.h"
#include "train/trainer.h"
#include "train_model.h"

enum { MOST_ROUNDS = 1000, WARM = 4, PAIRS = 16, WAYS = 2 };

typedef struct perf_case {
    const char *name;
    hada_stage stage;
    int frame, window, batch;
} perf_case;
static const perf_case cases[] = {
    {"compact72", HADA_STAGE_ENHANCE, 72, 72, 4},    {"odd72", HADA_STAGE_ENHANCE, 72, 72, 5},
    {"compact96", HADA_STAGE_ENHANCE, 96, 96, 16},   {"compact192", HADA_STAGE_ENHANCE, 192, 192, 4},
    {"filters192", HADA_STAGE_FILTERS, 512, 192, 4},
};

static hada_error err;

static void must(hada_status status)
{
    if (status) {
        fprintf(stderr, "perf_train_devices: %s\n%s\n", err.message, err.detail);
        exit(1);
    }
}

static double processor_seconds(void)
{
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    return (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
           1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
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

static hada_status noise(hada_image *image, int side, unsigned state, hada_error *error)
{
    hada_status status = hada_image_create(image, 3, side, side, error);
    for (size_t i = 0; !status && i < hada_image_count(image); i++) {
        state = state * 1664525u + 1013904223u;
        image->data[i] = (float)(state >> 8) / 16777216.0f;
    }
    return status;
}

static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    const perf_case *c = user;
    hada_status status = noise(raw, c->frame, (unsigned)(2 * pair + depth + 1), error);
    return status ? status : noise(scene, c->window, (unsigned)(2 * pair + depth + 2), error);
}

/* A step: [0] its wall time, [1] its processor time. */
static void step(hada_trainer *trainer, double seconds[2])
{
    const double wall = hada_seconds(), processor = processor_seconds();
    must(hada_trainer_step(trainer, NULL, &err));
    seconds[0] = hada_seconds() - wall;
    seconds[1] = processor_seconds() - processor;
}

/* What the commands of a step took on a device: of each row the least of several steps. */
static void show_commands(hada_trainer *trainer, int worker, int steps)
{
    hada_slot *slot = trainer->workers.worker[worker].slot;
    hada_kernel_time *least = NULL;
    size_t count = 0;
    double unused[2], all = 0.0;
    for (int i = 0; i < steps; i++) {
        hada_kernel_time *rows = NULL;
        size_t now = 0;
        must(hada_slot_profile(slot, 1, &err));
        step(trainer, unused);
        must(hada_slot_times(slot, &rows, &now, &err));
        for (size_t k = 0; least && now == count && k < count; k++)
            if (rows[k].seconds > least[k].seconds)
                rows[k] = least[k];
        if (!least || now <= count) { /* those with a snapshot have a row more */
            free(least);
            least = rows;
            count = now;
        } else {
            free(rows);
        }
    }
    must(hada_slot_profile(slot, 0, &err));
    printf("    device %d of %d, commands of a step:\n", worker + 1, trainer->workers.count);
    for (size_t i = 0; i < count; i++) {
        all += least[i].seconds;
        printf("      %-8s %-28s %4d times %9.3f ms\n", least[i].stage, least[i].name, (int)least[i].launches,
               1e3 * least[i].seconds);
    }
    printf("      %-48s %8.3f ms\n", "together", 1e3 * all);
    free(least);
}

static void run(perf_case c, int rounds, int profile, int only, hada_context *const contexts[3])
{
    static double seconds[WAYS][2][MOST_ROUNDS], ratios[2][MOST_ROUNDS];
    static const int count = PAIRS;
    static const double distance = 100.0;
    hada_dataset *pairs;
    hada_model *model;
    hada_trainer *trainers[WAYS];
    hada_train_options options;
    uint64_t bytes[WAYS];
    must(hada_dataset_create(&pairs, 1, &distance, &count, read_pair, &c, NULL, &err));
    must(perf_train_model(&model, c.frame, c.window, &err));
    hada_train_options_init(&options, c.stage);
    options.batch = c.batch;
    options.steps = 1000000;
    for (int way = 0; way < WAYS; way++) {
        const uint64_t before = hada_context_bytes(contexts[way]) + (way ? hada_context_bytes(contexts[2]) : 0);
        must(hada_trainer_create(&trainers[way], contexts + way, way + 1, model, pairs, NULL, &options, &err));
        bytes[way] = hada_context_bytes(contexts[way]) + (way ? hada_context_bytes(contexts[2]) : 0) - before;
    }
    for (int i = -WARM; i < rounds; i++) {
        double now[WAYS][2] = {{0.0}};
        for (int k = 0; k < WAYS; k++) { /* who is first changes */
            const int way = only ? only - 1 : (i + WARM + k) % WAYS;
            step(trainers[way], now[way]);
        }
        for (int what = 0; i >= 0 && what < 2; what++) {
            for (int way = 0; way < WAYS; way++)
                seconds[way][what][i] = now[way][what];
            ratios[what][i] = now[0][what] / now[1][what];
        }
    }
    double sums[WAYS] = {0.0};
    for (int way = 0; way < WAYS; way++)
        for (int i = 0; i < rounds; i++)
            sums[way] += seconds[way][1][i];
    printf("%-12s %2d pairs: one %8.2f ms (processor %8.2f), %4.0f MB; two %8.2f ms (%8.2f), %4.0f MB; two make %.3f "
           "times the steps, take %.3f times the processor\n",
           c.name, c.batch, 1e3 * median(seconds[0][0], rounds), 1e3 * sums[0] / rounds, (double)bytes[0] / 1e6,
           1e3 * median(seconds[1][0], rounds), 1e3 * sums[1] / rounds, (double)bytes[1] / 1e6,
           median(ratios[0], rounds), sums[1] / sums[0]);
    fflush(stdout);
    for (int way = 0; way < WAYS; way++) {
        for (int w = 0; profile && w <= way; w++)
            show_commands(trainers[way], w, rounds);
        hada_trainer_destroy(&trainers[way]);
    }
    hada_dataset_destroy(&pairs);
    hada_model_destroy(&model);
}

int main(int count, char **words)
{
    int rounds = 41, profile = 0, only = 0, named = 0;
    hada_context *contexts[3];
    hada_context_options options;
    for (int i = 1; i < count; i++) {
        if (!strcmp(words[i], "--rounds") && i + 1 < count)
            rounds = atoi(words[++i]);
        else if (!strcmp(words[i], "--only") && i + 1 < count)
            only = atoi(words[++i]);
        else if (!strcmp(words[i], "--profile"))
            profile = 1;
        else
            named = 1;
    }
    if (rounds < 1 || rounds > MOST_ROUNDS || only < 0 || only > WAYS) {
        fprintf(stderr, "perf_train_devices: 1 to %d rounds; --only 1 or 2\n", MOST_ROUNDS);
        return 2;
    }
    hada_context_options_init(&options);
    for (int i = 0; i < 3; i++) { /* the whole, and its two halves */
        options.part = i;
        options.parts = i ? 2 : 0;
        must(hada_context_create(&contexts[i], &options, &err));
    }
    for (size_t c = 0; c < HADA_COUNT(cases); c++) {
        int wanted = !named;
        for (int i = 1; i < count; i++)
            wanted |= !strcmp(words[i], cases[c].name);
        if (wanted)
            run(cases[c], rounds, profile, only, contexts);
    }
    for (int i = 0; i < 3; i++)
        hada_context_destroy(&contexts[i]);
    return 0;
}
