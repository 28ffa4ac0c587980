/* A simulated camera with a model learned from a few pairs, as the tests of reconstruction share it. */
#ifndef HADA_TESTS_LEARNED_CAMERA_H
#define HADA_TESTS_LEARNED_CAMERA_H

#include "fit/fitter.h"
#include "testing.h"

enum { LEARNED_PAIRS = 8, LEARNED_DEPTHS = 4 };
static const double learned_noise = 0.01;

typedef struct learned_camera {
    hada_context *context;
    hada_camera camera;
    hada_simulator *simulator;
    hada_model *model;
} learned_camera;

static inline hada_image learned_scene(const learned_camera *learned, uint64_t seed)
{
    hada_image scene;
    ASSERT_OK(hada_scene_procedural(&scene, seed, learned->camera.channels, learned->camera.window_rows,
                                    learned->camera.window_cols, err));
    return scene;
}

static inline hada_image learned_frame(const learned_camera *learned, const hada_plane *planes, int count,
                                       uint64_t seed)
{
    hada_image raw;
    ASSERT_OK(hada_simulator_render(learned->simulator, planes, count, learned_noise, seed, &raw, err));
    return raw;
}

static inline void learned_fit(learned_camera *learned)
{
    const hada_camera *camera = &learned->camera;
    SCOPED(hada_fitter) * fitter;
    DEFAULTS(hada_fit_options, options);
    options.depths = camera->depths;
    options.channels = camera->channels;
    options.distances_mm = camera->distances_mm;
    options.boundary = camera->boundary;
    options.raw_rows = camera->rows;
    options.raw_cols = camera->cols;
    options.window_rows = camera->window_rows;
    options.window_cols = camera->window_cols;
    ASSERT_OK(hada_fitter_create(&fitter, learned->context, &options, err));
    for (int pass = 0; pass < 2; pass++)
        for (int z = 0; z < camera->depths; z++)
            for (int i = 0; i < LEARNED_PAIRS; i++) {
                SCOPED(hada_image) scene = learned_scene(learned, (uint64_t)(100 * z + i));
                SCOPED(hada_image)
                raw = learned_frame(learned, &(hada_plane){z, &scene}, 1, (uint64_t)(7000 + 100 * z + i));
                if (pass == 0)
                    ASSERT_OK(hada_fitter_add_pair(fitter, z, &raw, &scene, err));
                else if (i < 2)
                    ASSERT_OK(hada_fit_score_pair(fitter, z, i, &raw, &scene, NULL, err));
            }
    ASSERT_OK(hada_fit_solve(fitter, &learned->model, err));
}

/* The camera of the quality figures, in grey to be quick. */
static inline int learned_setup(void **state)
{
    static learned_camera learned;
    ASSERT_OK(hada_context_create(&learned.context, NULL, err));
    learned.camera.size = sizeof learned.camera;
    ASSERT_OK(hada_camera_preset(&learned.camera, "sim300", err));
    learned.camera.channels = 1;
    ASSERT_OK(hada_simulator_create(&learned.simulator, learned.context, &learned.camera, NULL, err));
    learned_fit(&learned);
    *state = &learned;
    return 0;
}

static inline int learned_teardown(void **state)
{
    learned_camera *learned = *state;
    hada_model_destroy(&learned->model);
    hada_simulator_destroy(&learned->simulator);
    close_context(&learned->context);
    return 0;
}

/* A scene cut into parts at `count` depths; parts[] are the caller's to destroy. */
static inline void learned_split(const learned_camera *learned, const hada_image *scene, const int *depths, int count,
                                 uint64_t seed, hada_image *parts, hada_plane *planes)
{
    int *labels = malloc((size_t)scene->rows * (size_t)scene->cols * sizeof *labels);
    ASSERT_OK(hada_scene_regions(labels, seed, count, scene->rows, scene->cols, err));
    for (int i = 0; i < count; i++) {
        ASSERT_OK(hada_scene_part(&parts[i], scene, labels, i, err));
        planes[i] = (hada_plane){depths[i], &parts[i]};
    }
    free(labels);
    (void)learned;
}

static inline double learned_psnr(const hada_image *image, const hada_image *truth)
{
    const size_t count = hada_image_count(truth);
    double sum = 0;
    for (size_t i = 0; i < count; i++)
        sum += ((double)image->data[i] - truth->data[i]) * ((double)image->data[i] - truth->data[i]);
    return 10 * log10((double)count / sum);
}

#endif
