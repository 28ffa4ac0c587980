/* Run time against error: methods, precisions, steps of refinement, kinds of skipping, back ends of the transforms.
 *
 * Each setting is compared with the dense run of the same method and steps (float filters, nothing skipped, own
 * transforms), and with the truth where it is known. */
#include "bench.h"

#include <hadalens/tune.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 256, SETTINGS = 128 };
static const double wiener_lambda = 0.01; /* as reconstruct --lambda has it by default */

typedef struct sweep {
    hada_bench *bench;
    hada_bench_device *device;
    const hada_bench_workload *workload;
    hada_context *clfft; /* a second context, whose transforms clFFT does; NULL: none */
    hada_model *other;   /* with fixed filters, of the method in hand */
    hada_bench_method other_method;
    hada_result dense, now; /* of the first frame */
    int dense_method, dense_refine;
    hada_bench_setting list[SETTINGS];
    int count;
} sweep;

static const char *const method_names[] = {"hadamard", "matched", "wiener", "refined"};

/* Skipping without an error, and with a bound. */
typedef struct skipping {
    const char *name;
    unsigned kinds; /* never frames that are like the one before: every frame is measured */
    double max_error;
    int always; /* tried for every method; the others for the model's own alone */
} skipping;
enum { ALL = HADA_SKIP_ALL & ~HADA_SKIP_FRAMES };
static const skipping skippings[] = {
    {"dense", 0, 0, 1},
    {"exact", ALL, 0, 1},
    {"error 1e-4", ALL, 1e-4, 0},
    {"error 1e-3", ALL, 1e-3, 0},
    {"error 1e-2", ALL, 1e-2, 1},
    {"error 1e-1", ALL, 1e-1, 0},
    {"bands 1e-2", HADA_SKIP_PRUNE | HADA_SKIP_FREQUENCIES, 1e-2, 0},
};
enum { SKIPPINGS = sizeof skippings / sizeof *skippings };

static void name_of(const hada_bench_setting *s, char *name, size_t size)
{
    if (s->method == HADA_BENCH_REFINED)
        snprintf(name, size, "refined %d, %s%s", s->refine, s->skip_name, s->clfft ? ", clFFT" : "");
    else
        snprintf(name, size, "%s %s, %s%s", method_names[s->method], s->half ? "half" : "float", s->skip_name,
                 s->clfft ? ", clFFT" : "");
}

static void put(sweep *w, hada_bench_method method, int half, int refine, const skipping *skip, int clfft)
{
    if (w->count < SETTINGS)
        w->list[w->count++] =
            (hada_bench_setting){method, half, refine, skip->kinds, skip->max_error, skip->name, clfft};
}

static int large(const sweep *w)
{
    const hada_model_info *info = hada_model_get_info(w->workload->model);
    return (double)info->grid_rows * info->grid_cols * info->channels * info->depths > 40e6;
}

/* Everything of a small camera; of a large one, or in a quick run, enough to see where it goes, so that the whole stays
 * within minutes. `k` counts the skippings. */
static int wanted(const sweep *w, hada_bench_method method, int half, int refine, int k)
{
    const int big = large(w), few = big || w->bench->quick, always = skippings[k].always, exact = k == 1;
    if (method == HADA_BENCH_REFINED) {
        /* dense runs look for the depths in full and take many times as long: a few of them show it */
        if (k == 0)
            return !big && (refine == 4 || (refine == 8 && !few));
        return few ? exact && refine != 2 : always || (refine == 8 && k != 2 && k != SKIPPINGS - 1);
    }
    if (method == HADA_BENCH_OWN)
        return always || !few || (!half && !big);
    return few ? exact && !half : always;
}

static void put_skippings(sweep *w, hada_bench_method method, int half, int refine)
{
    for (int k = 0; k < SKIPPINGS; k++)
        if (wanted(w, method, half, refine, k))
            put(w, method, half, refine, &skippings[k], 0);
}

/* The settings, dense ones first within each method and number of steps. */
static void fill_list(sweep *w)
{
    static const int steps[] = {1, 2, 4, 8, 16};
    const hada_model_info *info = hada_model_get_info(w->workload->model);
    for (int half = 0; half < 2; half++)
        put_skippings(w, HADA_BENCH_OWN, half, 0);
    if (w->clfft)
        put(w, HADA_BENCH_OWN, 0, 0, &skippings[1], 1);
    if (!info->has_otf)
        return;
    for (int half = 0; half < 2 && info->form != HADA_FORM_MATCHED; half++)
        put_skippings(w, HADA_BENCH_MATCHED, half, 0);
    for (int half = 0; half < 2 && info->form != HADA_FORM_WIENER; half++)
        put_skippings(w, HADA_BENCH_WIENER, half, 0);
    for (int i = 0; i < 5; i++) {
        put_skippings(w, HADA_BENCH_REFINED, 0, steps[i]);
        if (w->clfft && steps[i] == 8)
            put(w, HADA_BENCH_REFINED, 0, 8, &skippings[1], 1);
    }
}

/* sum (a - b)^2 and sum b^2 over the stack. */
static double relative_l2(const hada_result *a, const hada_result *b)
{
    double difference = 0, norm = 0;
    for (int z = 0; z < b->depths; z++)
        for (size_t i = 0; i < hada_image_count(&b->planes[z]); i++) {
            const double d = (double)a->planes[z].data[i] - b->planes[z].data[i], v = b->planes[z].data[i];
            difference += d * d;
            norm += v * v;
        }
    return norm > 0 ? sqrt(difference / norm) : difference > 0 ? INFINITY : 0;
}

/* Against the truth of the first frame: over the planes that are occupied in it, and of the all-in-focus image. */
static void judge(const sweep *w, hada_bench_row *row)
{
    const hada_image *truth = w->workload->truth;
    hada_bench_likeness planes = {0}, picture = {0};
    const size_t count = hada_image_count(&w->now.all_in_focus);
    if (!truth)
        return;
    float *whole = hada_cli_memory(count, sizeof *whole);
    for (int z = 0; z < w->now.depths; z++) {
        if (!truth[z].data)
            continue;
        hada_bench_likeness_add(&planes, w->now.planes[z].data, truth[z].data, hada_image_count(&w->now.planes[z]));
        for (size_t i = 0; i < count; i++)
            whole[i] += truth[z].data[i];
    }
    hada_bench_likeness_add(&picture, w->now.all_in_focus.data, whole, count);
    free(whole);
    row->psnr = hada_bench_psnr(&planes);
    row->psnr_in_focus = hada_bench_psnr(&picture);
}

typedef struct one {
    const sweep *w;
    hada_plan *plan;
    hada_result result;
} one;

static hada_status run_frame(void *user, int round, double *value, hada_error *err)
{
    one *work = user;
    const hada_bench_workload *workload = work->w->workload;
    /* frames take turns, so that none is like the one before */
    hada_status status = hada_plan_run(work->plan, &workload->raw[round % workload->frames], &work->result, err);
    *value = work->result.report->seconds_total;
    return status;
}

static void swap(hada_result *a, hada_result *b)
{
    const hada_result kept = *a;
    *a = *b;
    *b = kept;
}

/* The workload's model, or one of its copies with fixed filters; these are large, so one at a time. */
static hada_status model_of(sweep *w, hada_bench_method method, const hada_model **out, hada_error *err)
{
    *out = w->workload->model;
    if (method == HADA_BENCH_OWN || method == HADA_BENCH_REFINED)
        return HADA_OK;
    hada_status status = HADA_OK;
    if (!w->other || w->other_method != method) {
        hada_model_destroy(&w->other);
        status = hada_model_with_form(&w->other, w->workload->model,
                                      method == HADA_BENCH_MATCHED ? HADA_FORM_MATCHED : HADA_FORM_WIENER,
                                      wiener_lambda, err);
        w->other_method = method;
    }
    *out = w->other;
    return status;
}

/* A setting that the model or the device cannot do gets no row. */
static hada_status measure(sweep *w, const hada_bench_setting *s, hada_error *err)
{
    hada_plan_options options;
    one work = {.w = w};
    double values[MOST], first;
    int count = 0;
    char name[128];
    hada_plan_options_init(&options);
    options.refine = s->refine;
    options.half = s->half;
    options.skip = s->skip;
    options.max_error = s->max_error;
    hada_context *context = s->clfft ? w->clfft : w->device->context;
    const hada_model *model = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(model_of(w, s->method, &model, err));
    HADA_TRY_OR_DONE(hada_plan_create(&work.plan, context, model, &options, err));
    /* first as it comes, also for the comparisons */
    HADA_TRY_OR_DONE(run_frame(&work, 0, &first, err));
    const double bound = work.result.report->skipped->bound;
    swap(&work.result, &w->now);
    HADA_TRY_OR_DONE(hada_bench_repeat(w->bench, run_frame, &work, w->bench->rounds, values, &count, err));
    name_of(s, name, sizeof name);
    hada_bench_row *row = hada_bench_add(w->bench, w->device->info.name, w->workload->name, HADA_BENCH_SWEEP, "ms", -1,
                                         hada_bench_scaled(hada_bench_figure_of(values, count), 1e3), "%s", name);
    row->setting = *s;
    row->bound = bound;
    const int is_dense = !s->skip && !s->half && !s->clfft;
    if (is_dense) {
        row->error = 0;
    } else if (w->dense_method == (int)s->method && w->dense_refine == s->refine) {
        row->error = relative_l2(&w->now, &w->dense);
        /* a bound is of what skipping does: rounding and filters in half precision by choice come on top */
        if (s->max_error > 0 && !s->half && row->error > s->max_error + 1e-6)
            hada_cli_warn(w->bench->cli, "%s: the stack changed by %.3g, more than the bound of %g that was asked for",
                          name, row->error, s->max_error);
    }
    judge(w, row);
    if (is_dense) {
        swap(&w->now, &w->dense);
        w->dense_method = (int)s->method;
        w->dense_refine = s->refine;
    }
done:
    hada_plan_destroy(&work.plan);
    hada_result_destroy(&work.result);
    name_of(s, name, sizeof name);
    return hada_bench_left_out(w->bench, status, name, err) ? HADA_OK : status;
}

/* A context in which clFFT transforms the workload's size, where there is time for it and it could serve at all. */
static hada_status open_clfft(sweep *w, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(w->workload->model);
    const hada_tune_row row = {.rows = info->grid_rows, .cols = info->grid_cols, .chosen = HADA_TUNE_CLFFT};
    hada_context_options options;
    if (w->bench->quick || large(w) || !w->device->info.has_compiler || w->device->common.binaries)
        return HADA_OK;
    char *file = hada_cli_text("%s/tuning-%s.txt", w->bench->scratch, w->device->index);
    hada_context_options_init(&options);
    options.device = w->device->index;
    options.tuning = file;
    options.shape = (int)hada_cli_context_info(w->device->context).shape;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tune_save(w->device->context, file, &row, 1, err));
    HADA_TRY_OR_DONE(hada_context_create(&w->clfft, &options, err));
done:
    free(file);
    return status;
}

/* The front among the settings of this device and workload: quality where the truth is known, else the error. */
static void mark_front(sweep *w, int first)
{
    hada_bench *bench = w->bench;
    double cost[SETTINGS] = {0}, loss[SETTINGS] = {0};
    int front[SETTINGS];
    const int count = bench->count - first;
    for (int i = 0; i < count; i++) {
        const hada_bench_row *row = &bench->rows[first + i];
        cost[i] = row->value.median;
        loss[i] = w->workload->truth ? -row->psnr : row->error;
    }
    hada_bench_pareto(cost, loss, count, front);
    for (int i = 0; i < count; i++)
        bench->rows[first + i].front = front[i];
}

hada_status hada_bench_sweep(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload,
                             hada_error *err)
{
    sweep *w = hada_cli_memory(1, sizeof *w);
    hada_cli_progress progress;
    w->bench = bench;
    w->device = device;
    w->workload = workload;
    w->dense_method = -1;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(open_clfft(w, err));
    fill_list(w);
    const int first = bench->count;
    hada_cli_progress_begin(bench->cli, &progress, "settings", w->count);
    for (int i = 0; i < w->count; i++) {
        HADA_TRY_OR_DONE(measure(w, &w->list[i], err));
        hada_cli_progress_step(bench->cli, NULL);
    }
    mark_front(w, first);
done:
    hada_cli_progress_end(bench->cli);
    hada_model_destroy(&w->other);
    hada_result_destroy(&w->dense);
    hada_result_destroy(&w->now);
    hada_context_destroy(&w->clfft);
    free(w);
    return status;
}
