/* The cameras that are measured: simulated ones, made by the library itself, or a user's model. */
#include "bench.h"

#include <hadalens/fit.h>
#include <hadalens/scene.h>
#include <hadalens/simulate.h>
#include <hadalens/tiff.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PAIRS = 8, SCORED = 2, FRAMES = 2, OCCUPIED = 2, SEED = 20220719 };
static const double noise = 0.01;

const char hada_bench_workload_names[] = "sim300, sim512, paper2022";

int hada_bench_workload_known(const char *name)
{
    return !strcmp(name, "sim300") || !strcmp(name, "sim512") || !strcmp(name, "paper2022");
}

void hada_bench_workload_free(hada_bench_workload *workload)
{
    for (int i = 0; workload->raw && i < workload->frames; i++)
        hada_image_destroy(&workload->raw[i]);
    for (int i = 0; workload->truth && i < workload->frames * workload->depths; i++)
        hada_image_destroy(&workload->truth[i]);
    free(workload->raw);
    free(workload->truth);
    hada_model_destroy(&workload->model);
    *workload = (hada_bench_workload){0};
}

/* Simulates pairs as they are read. */
typedef struct drawing {
    hada_bench *bench;
    hada_simulator *simulator;
} drawing;

/* A pair of the fit: a drawn scene at a depth, and its frame. */
static hada_status draw_pair(void *user, int z, int i, hada_image *raw, hada_image *scene, hada_error *err)
{
    const drawing *of = user;
    const hada_camera *camera = hada_simulator_camera(of->simulator);
    const uint64_t number = (uint64_t)(z * PAIRS + i);
    HADA_TRY(
        hada_scene_procedural(scene, SEED + number, camera->channels, camera->window_rows, camera->window_cols, err));
    const hada_plane plane = {z, scene};
    HADA_TRY(hada_simulator_render(of->simulator, &plane, 1, noise, SEED + 1000 + number, raw, err));
    hada_cli_progress_step(of->bench->cli, NULL);
    return HADA_OK;
}

/* So many pairs of each depth. */
static hada_status draw_pairs(hada_dataset **out, drawing *of, int count, hada_error *err)
{
    const hada_camera *camera = hada_simulator_camera(of->simulator);
    int *counts = hada_cli_memory((size_t)camera->depths, sizeof *counts);
    for (int z = 0; z < camera->depths; z++)
        counts[z] = count;
    const hada_status status =
        hada_dataset_create(out, camera->depths, camera->distances_mm, counts, draw_pair, of, NULL, err);
    free(counts);
    return status;
}

static hada_status fit(hada_bench *bench, hada_simulator *simulator, hada_context *context, hada_model **model,
                       hada_error *err)
{
    const hada_camera *camera = hada_simulator_camera(simulator);
    drawing of = {bench, simulator};
    hada_monitor monitor = bench->cli->monitor;
    hada_fit_options options;
    hada_dataset *pairs = NULL, *scored = NULL;
    hada_fitter *fitter = NULL;
    hada_status status = HADA_OK;
    monitor.progress = NULL; /* the bench has its own */
    hada_fit_options_init(&options);
    options.depths = camera->depths;
    options.channels = camera->channels;
    options.distances_mm = camera->distances_mm;
    options.raw_rows = camera->rows;
    options.raw_cols = camera->cols;
    options.window_rows = camera->window_rows;
    options.window_cols = camera->window_cols;
    options.boundary = camera->boundary;
    options.monitor = &monitor;
    HADA_TRY_OR_DONE(draw_pairs(&pairs, &of, PAIRS, err));
    HADA_TRY_OR_DONE(draw_pairs(&scored, &of, SCORED, err));
    HADA_TRY_OR_DONE(hada_fitter_create(&fitter, context, &options, err));
    HADA_TRY_OR_DONE(hada_fitter_add(fitter, pairs, err));
    HADA_TRY_OR_DONE(hada_fitter_finish(fitter, scored, model, err));
done:
    hada_fitter_destroy(&fitter);
    hada_dataset_destroy(&pairs);
    hada_dataset_destroy(&scored);
    return status;
}

static hada_status from_psf(hada_simulator *simulator, hada_context *context, hada_model **model, hada_error *err)
{
    const hada_camera *camera = hada_simulator_camera(simulator);
    hada_psf_options options;
    hada_psf_options_init(&options);
    options.boundary = camera->boundary;
    options.window_rows = camera->window_rows;
    options.window_cols = camera->window_cols;
    hada_image one = {0}, *psf = hada_cli_memory((size_t)camera->depths, sizeof *psf);
    hada_status status = HADA_OK;
    for (int z = 0; z < camera->depths; z++) {
        HADA_TRY_OR_DONE(hada_camera_psf(camera, camera->distances_mm[z], 0, 0, &one, err));
        /* the pattern is the same for all channels */
        HADA_TRY_OR_DONE(hada_image_create(&psf[z], camera->channels, one.rows, one.cols, err));
        for (int c = 0; c < camera->channels; c++)
            memcpy(psf[z].data + (size_t)c * hada_image_count(&one), one.data, hada_image_count(&one) * sizeof(float));
        hada_image_destroy(&one);
        HADA_TRY_OR_DONE(hada_cli_check_signals(err));
    }
    HADA_TRY_OR_DONE(hada_model_from_psf(model, context, psf, camera->depths, camera->distances_mm, &options, err));
done:
    hada_image_destroy(&one);
    for (int z = 0; z < camera->depths; z++)
        hada_image_destroy(&psf[z]);
    free(psf);
    return status;
}

/* A frame whose scene stands at two depths, and its truth. */
static hada_status draw_frame(hada_bench_workload *workload, hada_simulator *simulator, int frame, hada_error *err)
{
    const hada_camera *camera = hada_simulator_camera(simulator);
    const int occupied = camera->depths < OCCUPIED ? camera->depths : OCCUPIED;
    const uint64_t seed = SEED + 5000 + (uint64_t)frame;
    hada_image whole = {0}, *truth = workload->truth + (size_t)frame * (size_t)camera->depths;
    hada_plane planes[OCCUPIED];
    int *labels = hada_cli_memory((size_t)camera->window_rows * (size_t)camera->window_cols, sizeof *labels);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(
        hada_scene_procedural(&whole, seed, camera->channels, camera->window_rows, camera->window_cols, err));
    HADA_TRY_OR_DONE(hada_scene_regions(labels, seed, occupied, camera->window_rows, camera->window_cols, err));
    for (int k = 0; k < occupied; k++) {
        /* a third and two thirds of the way, another depth in the next frame */
        const int z = ((k + 1) * camera->depths / (occupied + 1) + frame) % camera->depths;
        HADA_TRY_OR_DONE(hada_scene_part(&truth[z], &whole, labels, k, err));
        planes[k] = (hada_plane){z, &truth[z]};
    }
    HADA_TRY_OR_DONE(hada_simulator_render(simulator, planes, occupied, noise, seed, &workload->raw[frame], err));
done:
    hada_image_destroy(&whole);
    free(labels);
    return status;
}

static void make_room(hada_bench_workload *workload, int frames, int depths, int truth)
{
    workload->frames = frames;
    workload->depths = depths;
    workload->raw = hada_cli_memory((size_t)frames, sizeof *workload->raw);
    workload->truth = truth ? hada_cli_memory((size_t)frames * (size_t)depths, sizeof *workload->truth) : NULL;
}

hada_status hada_bench_workload_make(hada_bench *bench, hada_bench_workload *workload, hada_context *context,
                                     const char *name, hada_error *err)
{
    hada_camera camera = {.size = sizeof camera};
    hada_simulator *simulator = NULL;
    hada_cli_progress progress;
    *workload = (hada_bench_workload){0};
    snprintf(workload->name, sizeof workload->name, "%s", name);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_camera_preset(&camera, name, err));
    make_room(workload, FRAMES, camera.depths, 1);
    HADA_TRY_OR_DONE(hada_simulator_create(&simulator, context, &camera, NULL, err));
    const int learned = strcmp(name, "paper2022") != 0;
    hada_cli_progress_begin(bench->cli, &progress, name, learned ? (long)camera.depths * (PAIRS + SCORED) : 1);
    HADA_TRY_OR_DONE(learned ? fit(bench, simulator, context, &workload->model, err)
                             : from_psf(simulator, context, &workload->model, err));
    for (int frame = 0; frame < FRAMES; frame++)
        HADA_TRY_OR_DONE(draw_frame(workload, simulator, frame, err));
done:
    hada_cli_progress_end(bench->cli);
    hada_simulator_destroy(&simulator);
    if (status)
        hada_bench_workload_free(workload);
    return status;
}

hada_status hada_bench_workload_load(hada_bench_workload *workload, const char *model, const char *const *files,
                                     int count, hada_error *err)
{
    *workload = (hada_bench_workload){0};
    const char *slash = strrchr(model, '/');
    snprintf(workload->name, sizeof workload->name, "%s", slash ? slash + 1 : model);
    hada_status status = HADA_OK;
    const char *path = model; /* that a message is about */
    HADA_TRY_OR_DONE(hada_model_load(&workload->model, model, err));
    path = NULL;
    const hada_model_info *info = hada_model_get_info(workload->model);
    make_room(workload, count, info->depths, 0);
    for (int i = 0; i < count; i++) {
        hada_image *raw = &workload->raw[i];
        path = files[i];
        HADA_TRY_OR_DONE(hada_tiff_load(path, 0, raw, err));
        if (raw->channels != info->channels || raw->rows != info->raw_rows || raw->cols != info->raw_cols)
            HADA_TRY_OR_DONE(hada_cli_error(
                err, HADA_ERROR_MODEL,
                "this frame has %dx%d pixels of %d channel(s), the model is of a camera with %dx%d of %d; take a frame "
                "of that camera",
                raw->rows, raw->cols, raw->channels, info->raw_rows, info->raw_cols, info->channels));
    }
done:
    if (status && path)
        hada_cli_prefix(err, "%s: ", path);
    if (status)
        hada_bench_workload_free(workload);
    return status;
}

hada_status hada_bench_workload_enhance(hada_bench_workload *workload, const char *preset, int rows, int cols,
                                        hada_error *err)
{
    const size_t used = strlen(workload->name);
    hada_model *model = NULL;
    hada_net *net = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_net_create_preset(&net, preset, hada_model_get_info(workload->model)->channels, SEED, err));
    HADA_TRY_OR_DONE(hada_model_with_enhance(&model, workload->model, net, rows, cols, err));
    hada_model_destroy(&workload->model);
    workload->model = model;
    snprintf(workload->name + used, sizeof workload->name - used, "+%s", preset);
done:
    hada_net_destroy(&net);
    return status;
}
