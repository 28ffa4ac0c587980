/* Frames through a plan of one queue, of two queues on the device, and of two halves of the device, in turns: time per
 * frame of a sequence, latency of a frame alone, memory. Prints Markdown tables; medians over the rounds.
 *    perf_queues MODEL ROUNDS RAW.tif...      the tables; sequences of all frames, refined ones of 8
 *    perf_queues --alone MODEL RAW.tif...     seconds that one queue needs for all frames, as one number each for
 *                                             --refine 0 and auto */
#include <hadalens/hadalens.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"

enum { MOST_FRAMES = 64, MOST_ROUNDS = 100, WAYS = 3, MOST_AHEAD = 8, REFINED_FRAMES = 8 };

typedef struct way {
    const char *name;
    hada_plan *plan;
    hada_result results[MOST_AHEAD];
    double sequence[MOST_ROUNDS], alone[MOST_ROUNDS];
} way;

static hada_error error;
static hada_image frames[MOST_FRAMES];
static int frame_count, count_in_use;

static void must(hada_status status)
{
    if (!status)
        return;
    fprintf(stderr, "perf_queues: %s\n", error.message);
    exit(1);
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(const double *values, int count)
{
    double sorted[MOST_ROUNDS];
    memcpy(sorted, values, (size_t)count * sizeof *values);
    qsort(sorted, (size_t)count, sizeof *sorted, by_value);
    return count % 2 ? sorted[count / 2] : 0.5 * (sorted[count / 2 - 1] + sorted[count / 2]);
}

static hada_context *open_part(int part, int parts)
{
    hada_context *context;
    hada_context_options options;
    hada_context_options_init(&options);
    options.part = part;
    options.parts = parts;
    must(hada_context_create(&context, &options, &error));
    return context;
}

static hada_plan *make(hada_context *const *contexts, int count, const hada_model *model, int refine, int queues)
{
    hada_plan *plan;
    hada_plan_options options;
    hada_plan_options_init(&options);
    options.refine = refine;
    options.queues = queues;
    options.skip &= ~(unsigned)HADA_SKIP_FRAMES; /* each frame is computed */
    must(hada_plan_create_on(&plan, contexts, count, model, &options, &error));
    return plan;
}

/* All frames, so many in flight as the plan has queues, and two. */
static double run_sequence(way *w)
{
    hada_job *jobs[MOST_AHEAD] = {NULL};
    const int ahead = hada_plan_queues(w->plan, NULL, 0) + 2;
    const double start = hada_seconds();
    for (int i = 0; i < count_in_use + ahead; i++) {
        hada_job **job = &jobs[i % ahead];
        if (*job)
            must(hada_job_wait(*job, &error));
        hada_job_destroy(job);
        if (i < count_in_use)
            must(hada_job_submit(job, w->plan, &frames[i], &w->results[i % ahead], &error));
    }
    return (hada_seconds() - start) / count_in_use;
}

static double run_alone(way *w, int frame)
{
    const double start = hada_seconds();
    must(hada_plan_run(w->plan, &frames[frame % count_in_use], &w->results[0], &error));
    return hada_seconds() - start;
}

static void print_table(const char *title, way *ways, int rounds)
{
    double of_sequence[MOST_ROUNDS], of_alone[MOST_ROUNDS];
    printf("\n%s\n\n| | frame of a sequence, ms | throughput against one queue | frame alone, ms | latency against one "
           "queue | memory, MiB | without sharing, MiB |\n|---|---|---|---|---|---|---|\n",
           title);
    for (int k = 0; k < WAYS; k++) {
        uint64_t held, apart;
        hada_plan_memory(ways[k].plan, &held, &apart);
        for (int i = 0; i < rounds; i++) {
            of_sequence[i] = ways[0].sequence[i] / ways[k].sequence[i];
            of_alone[i] = ways[k].alone[i] / ways[0].alone[i];
        }
        printf("| %s | %.1f | %.2f | %.1f | %.2f | %.1f | %.1f |\n", ways[k].name,
               1e3 * median(ways[k].sequence, rounds), median(of_sequence, rounds), 1e3 * median(ways[k].alone, rounds),
               median(of_alone, rounds), (double)held / 1048576.0, (double)apart / 1048576.0);
    }
    fflush(stdout);
}

static void compare(hada_context *const *contexts, const hada_model *model, int refine, int rounds, const char *title)
{
    way ways[WAYS] = {{.name = "one queue", .plan = make(contexts, 1, model, refine, 1)},
                      {.name = "two queues", .plan = make(contexts, 1, model, refine, 2)},
                      {.name = "two halves of the device", .plan = make(contexts + 1, 2, model, refine, 1)}};
    for (int i = -1; i < rounds; i++) /* the first round warms up */
        for (int k = 0; k < WAYS; k++) {
            const double sequence = run_sequence(&ways[k]);
            double alone = 0;
            for (int n = 0; n < 4; n++)
                alone += run_alone(&ways[k], n) / 4;
            if (i >= 0) {
                ways[k].sequence[i] = sequence;
                ways[k].alone[i] = alone;
            }
        }
    print_table(title, ways, rounds);
    for (int k = 0; k < WAYS; k++) {
        for (int i = 0; i < MOST_AHEAD; i++)
            hada_result_destroy(&ways[k].results[i]);
        hada_plan_destroy(&ways[k].plan);
    }
}

static void alone(hada_context *context, const hada_model *model)
{
    for (int refine = 0; refine >= -1; refine--) {
        way one = {.plan = make(&context, 1, model, refine, 1)};
        run_alone(&one, 0);
        const double start = hada_seconds();
        for (int i = 0; i < count_in_use; i++)
            run_alone(&one, i);
        printf("%.3f\n", hada_seconds() - start);
        hada_result_destroy(&one.results[0]);
        hada_plan_destroy(&one.plan);
    }
}

int main(int argc, char **argv)
{
    hada_model *model;
    const int only = argc > 1 && !strcmp(argv[1], "--alone"), first = 3;
    if (argc < 4) {
        fprintf(stderr, "perf_queues MODEL ROUNDS RAW.tif... | --alone MODEL RAW.tif...\n");
        return 2;
    }
    const int rounds = only ? 0 : atoi(argv[2]);
    must(hada_model_load(&model, argv[only ? 2 : 1], &error));
    for (int i = first; i < argc && frame_count < MOST_FRAMES; i++)
        must(hada_tiff_load(argv[i], 0, &frames[frame_count++], &error));
    count_in_use = frame_count;
    hada_context *contexts[WAYS] = {open_part(0, 0), NULL, NULL};
    if (only) {
        alone(contexts[0], model);
    } else {
        contexts[1] = open_part(1, 2);
        contexts[2] = open_part(2, 2);
        if (rounds < 1 || rounds > MOST_ROUNDS)
            return 2;
        compare(contexts, model, 0, rounds, "Linear filters alone:");
        count_in_use = frame_count < REFINED_FRAMES ? frame_count : REFINED_FRAMES;
        compare(contexts, model, -1, rounds, "Depths found and refined:");
    }
    for (int i = 0; i < WAYS; i++)
        hada_context_destroy(&contexts[i]);
    for (int i = 0; i < frame_count; i++)
        hada_image_destroy(&frames[i]);
    hada_model_destroy(&model);
    return 0;
}
