/* Films: how many frames a second, and how good, from nothing and from the frame before. */
#include "bench.h"

#include <hadalens/scene.h>
#include <hadalens/simulate.h>
#include <stdlib.h>

enum { FRAMES = 10, FIRST = 2, OCCUPIED = 2, MOST = 256, SEED = 20240107 }; /* the first ones are not counted */
static const double noise = 0.01;

typedef struct film {
    hada_image raw[FRAMES], truth[FRAMES][OCCUPIED];
    int list[OCCUPIED], count; /* depths that are occupied */
    hada_plan *plan;
    hada_result result;
    hada_bench_likeness likeness; /* of the planes */
} film;

static void clear(film *f)
{
    for (int t = 0; t < FRAMES; t++) {
        hada_image_destroy(&f->raw[t]);
        for (int k = 0; k < OCCUPIED; k++)
            hada_image_destroy(&f->truth[t][k]);
    }
    *f = (film){.result = f->result};
}

/* A scene at two depths that moves by so many pixels a frame, with its edges. */
static hada_status draw(film *f, hada_simulator *simulator, int drift, hada_error *err)
{
    const hada_camera *camera = hada_simulator_camera(simulator);
    const int rows = camera->window_rows, cols = camera->window_cols, wide = cols + FRAMES;
    hada_image whole = {0}, parts[OCCUPIED] = {{0}};
    hada_plane planes[OCCUPIED];
    hada_status status = HADA_OK;
    int *labels = hada_cli_memory((size_t)rows * (size_t)wide, sizeof *labels);
    f->count = camera->depths < OCCUPIED ? camera->depths : OCCUPIED;
    HADA_TRY_OR_DONE(hada_scene_procedural(&whole, SEED, camera->channels, rows, wide, err));
    HADA_TRY_OR_DONE(hada_scene_regions(labels, SEED, f->count, rows, wide, err));
    for (int k = 0; k < f->count; k++)
        HADA_TRY_OR_DONE(hada_scene_part(&parts[k], &whole, labels, k, err));
    for (int t = 0; t < FRAMES; t++) {
        for (int k = 0; k < f->count; k++) {
            f->list[k] = (k + 1) * camera->depths / (f->count + 1);
            HADA_TRY_OR_DONE(hada_image_crop(&f->truth[t][k], &parts[k], 0, drift * t, rows, cols, err));
            planes[k] = (hada_plane){f->list[k], &f->truth[t][k]};
        }
        HADA_TRY_OR_DONE(
            hada_simulator_render(simulator, planes, f->count, noise, SEED + (uint64_t)t, &f->raw[t], err));
    }
done:
    hada_image_destroy(&whole);
    for (int k = 0; k < OCCUPIED; k++)
        hada_image_destroy(&parts[k]);
    free(labels);
    return status;
}

static hada_status run_film(void *user, int round, double *value, hada_error *err)
{
    film *f = user;
    double seconds = 0.0;
    for (int t = 0; t < FRAMES; t++) {
        const double start = hada_cli_seconds();
        HADA_TRY(hada_plan_run(f->plan, &f->raw[t], &f->result, err));
        if (t < FIRST)
            continue;
        seconds += hada_cli_seconds() - start;
        for (int k = 0; !round && k < f->count; k++)
            hada_bench_likeness_add(&f->likeness, f->result.planes[f->list[k]].data, f->truth[t][k].data,
                                    hada_image_count(&f->truth[t][k]));
    }
    *value = seconds / (FRAMES - FIRST);
    return HADA_OK;
}

static hada_status measure(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload, film *f,
                           const char *name, int warm, hada_error *err)
{
    double values[MOST];
    int count = 0;
    hada_plan_options options;
    hada_status status = HADA_OK;
    hada_bench_mode_options(1, &options);
    options.scene = HADA_SCENE_PLANES;
    options.warm_start = warm;
    f->likeness = (hada_bench_likeness){0};
    HADA_TRY_OR_DONE(hada_plan_create(&f->plan, device->context, workload->model, &options, err));
    HADA_TRY_OR_DONE(hada_bench_repeat(bench, run_film, f, bench->rounds, values, &count, err));
    for (int i = 0; i < count; i++)
        values[i] = 1.0 / values[i];
    hada_bench_row *row = hada_bench_add(bench, device->info.name, workload->name, HADA_BENCH_SEQUENCE, "frames/s", 1,
                                         hada_bench_figure_of(values, count), "%s, %s", name,
                                         warm ? "from the frame before" : "from nothing");
    row->psnr = hada_bench_psnr(&f->likeness);
done:
    hada_plan_destroy(&f->plan);
    return status;
}

hada_status hada_bench_sequence(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload,
                                hada_error *err)
{
    static const char *const names[] = {"still", "a pixel a frame"};
    hada_camera camera = {.size = sizeof camera};
    hada_simulator *simulator = NULL;
    hada_status status = HADA_OK;
    film *f = hada_cli_memory(1, sizeof *f);
    HADA_TRY_OR_DONE(hada_camera_preset(&camera, workload->name, err));
    HADA_TRY_OR_DONE(hada_simulator_create(&simulator, device->context, &camera, NULL, err));
    for (int drift = 0; drift < 2; drift++) {
        clear(f);
        HADA_TRY_OR_DONE(draw(f, simulator, drift, err));
        for (int warm = 0; warm < 2; warm++)
            HADA_TRY_OR_DONE(measure(bench, device, workload, f, names[drift], warm, err));
    }
done:
    hada_simulator_destroy(&simulator);
    clear(f);
    hada_result_destroy(&f->result);
    free(f);
    return status;
}
