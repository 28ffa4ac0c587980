/* What skipping saves and what it changes: frames through a dense plan (skip = 0) and through plans with skipping, in
 * turns. Prints a Markdown table: medians over all rounds and frames of the time and of the ratios to the dense run,
 * as a whole and up to the planes, the largest measured relative change of the stack, the largest bound, and how often
 * a frame was done again. perf_skip MODEL ROUNDS RAW.tif... -- [band=B] [E...] */
#include <hadalens/hadalens.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"

enum { MOST_PLANS = 32, MOST_FRAMES = 32, MOST_TIMES = 4096 };

typedef struct kind {
    char name[64];
    hada_plan *plan;
    hada_result result;
    double times[MOST_TIMES], ratios[MOST_TIMES];
    double linear[MOST_TIMES], linear_ratios[MOST_TIMES]; /* up to the planes */
    double change, bound, frequencies;
    int again, count;
    uint64_t bytes;
} kind;

static hada_error error;

static void must(hada_status status)
{
    if (!status)
        return;
    fprintf(stderr, "perf_skip: %s\n", error.message);
    exit(1);
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, by_value);
    return count % 2 ? values[count / 2] : 0.5 * (values[count / 2 - 1] + values[count / 2]);
}

static double change(const hada_result *result, const hada_result *dense)
{
    double off = 0.0, size = 0.0;
    for (int z = 0; z < result->depths; z++)
        for (size_t i = 0; i < hada_image_count(&result->planes[z]); i++) {
            const double a = result->planes[z].data[i], b = dense->planes[z].data[i];
            off += (a - b) * (a - b);
            size += b * b;
        }
    return off == 0.0 ? 0.0 : sqrt(off / size);
}

static void make(kind *plan, hada_context *context, const hada_model *model, const char *word, unsigned skip)
{
    hada_plan_options options;
    uint64_t host;
    hada_plan_options_init(&options);
    options.refine = 0;
    options.skip = skip;
    if (!strncmp(word, "band=", 5))
        options.band = atof(word + 5);
    else
        options.max_error = atof(word);
    snprintf(plan->name, sizeof plan->name, "%s", word);
    must(hada_plan_estimate(context, model, &options, &plan->bytes, &host, &error));
    must(hada_plan_create(&plan->plan, context, model, &options, &error));
}

static void run(kind *plan, const hada_image *raw, const kind *dense)
{
    const double start = hada_seconds();
    must(hada_plan_run(plan->plan, raw, &plan->result, &error));
    plan->times[plan->count] = hada_seconds() - start;
    const hada_report *report = plan->result.report;
    const hada_skip_report *skipped = report->skipped;
    plan->linear[plan->count] = report->seconds_upload + report->seconds_linear;
    if (dense) {
        plan->ratios[plan->count] = dense->times[dense->count - 1] / plan->times[plan->count];
        plan->linear_ratios[plan->count] = dense->linear[dense->count - 1] / plan->linear[plan->count];
        plan->change = fmax(plan->change, change(&plan->result, &dense->result));
    }
    plan->bound = fmax(plan->bound, skipped->bound);
    plan->frequencies += skipped->frequencies;
    plan->again += skipped->recomputed;
    plan->count++;
}

static void print(kind *plan, int planes)
{
    printf("| %s | %.2f | %.2f | %.2f | %.2f | %.1e | %.1e | %.2f | %d of %d | %.0f |\n", plan->name,
           1e3 * median(plan->times, plan->count) / planes, median(plan->ratios, plan->count),
           1e3 * median(plan->linear, plan->count) / planes, median(plan->linear_ratios, plan->count), plan->change,
           plan->bound, plan->frequencies / plan->count, plan->again, plan->count, (double)plan->bytes / 1048576.0);
}

int main(int count, char **words)
{
    static kind plans[MOST_PLANS];
    static hada_image frames[MOST_FRAMES];
    hada_context *context;
    hada_model *model;
    int plan_count = 3, frame_count = 0, i = 3;
    if (count < 4)
        return fprintf(stderr, "usage: perf_skip MODEL ROUNDS RAW.tif... -- [band=B] [E...]\n"), 2;
    must(hada_context_create(&context, NULL, &error));
    must(hada_model_load(&model, words[1], &error));
    for (; i < count && strcmp(words[i], "--") && frame_count < MOST_FRAMES; i++) {
        hada_tiff_reader *reader;
        must(hada_tiff_open(&reader, words[i], &error));
        must(hada_tiff_read(reader, 0, &frames[frame_count++], &error));
        hada_tiff_close(&reader);
    }
    make(&plans[0], context, model, "0", 0);
    const unsigned all = HADA_SKIP_ALL & ~(unsigned)HADA_SKIP_FRAMES;
    make(&plans[1], context, model, "0", all);
    make(&plans[2], context, model, "0", HADA_SKIP_ALL);
    snprintf(plans[0].name, sizeof plans[0].name, "dense");
    snprintf(plans[1].name, sizeof plans[1].name, "exact kinds");
    snprintf(plans[2].name, sizeof plans[2].name, "with frames"); /* what keeping them costs: none equals another */
    for (i++; i < count && plan_count < MOST_PLANS; i++)
        make(&plans[plan_count++], context, model, words[i], all);
    for (int round = 0; round < atoi(words[2]); round++)
        for (int f = 0; f < frame_count && plans[0].count < MOST_TIMES; f++)
            for (int p = 0; p < plan_count; p++)
                run(&plans[p], &frames[f], p ? &plans[0] : NULL);
    const hada_model_info *info = hada_model_get_info(model);
    for (int k = 0; k < plans[0].count; k++)
        plans[0].ratios[k] = plans[0].linear_ratios[k] = 1.0;
    printf("| max_error | ms a plane | times as fast | up to the planes | times as fast | change | bound | frequencies "
           "left "
           "out | again | MiB |\n|---|---|---|---|---|---|---|---|---|---|\n");
    for (int p = 0; p < plan_count; p++) {
        print(&plans[p], info->depths * info->channels);
        hada_result_destroy(&plans[p].result);
        hada_plan_destroy(&plans[p].plan);
    }
    for (int f = 0; f < frame_count; f++)
        hada_image_destroy(&frames[f]);
    hada_model_destroy(&model);
    hada_context_destroy(&context);
    return 0;
}
