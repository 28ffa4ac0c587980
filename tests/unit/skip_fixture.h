/* Small cameras, and frames made to break what skipping promises. */
#ifndef HADA_TESTS_SKIP_FIXTURE_H
#define HADA_TESTS_SKIP_FIXTURE_H

#include "camera_small.h"
#include "model/model.h"

enum { SKIP_ROWS = 72, SKIP_COLS = 90, SKIP_HIGH = 24, SKIP_WIDE = 30, SKIP_DEPTHS = 4, SKIP_CHANNELS = 3 };
enum { SKIP_WIENER, SKIP_SMOOTH, SKIP_PADDED, SKIP_SPLIT, SKIP_MODELS };
enum {
    SKIP_FAINT,
    SKIP_TINY,
    SKIP_EDGE,
    SKIP_BETWEEN,
    SKIP_ONE_COLOUR,
    SKIP_GREY,
    SKIP_NOISE,
    SKIP_CONSTANT,
    SKIP_LIMITED,
    SKIP_SPIKE,
    SKIP_BLACK,
    SKIP_FRAMES
};

typedef struct skip_fixture {
    hada_context *context;
    hada_image psf[SKIP_DEPTHS];
    hada_model *model[SKIP_MODELS];
    hada_image frame[SKIP_FRAMES];
} skip_fixture;

static inline size_t skip_pixels(void)
{
    return (size_t)SKIP_ROWS * SKIP_COLS;
}

/* Blurs a channel by a 3 x 3 binomial, `times` times, round the edges. */
static inline void skip_blur(float *plane, int times)
{
    SCOPED_MEMORY float *room = malloc(skip_pixels() * sizeof *room);
    for (int t = 0; t < times; t++) {
        memcpy(room, plane, skip_pixels() * sizeof *room);
        for (int r = 0; r < SKIP_ROWS; r++)
            for (int c = 0; c < SKIP_COLS; c++) {
                float sum = 0.0f;
                for (int i = -1; i <= 1; i++)
                    for (int k = -1; k <= 1; k++)
                        sum += (i ? 1.0f : 2.0f) * (k ? 1.0f : 2.0f) *
                               room[(r + i + SKIP_ROWS) % SKIP_ROWS * SKIP_COLS + (c + k + SKIP_COLS) % SKIP_COLS];
                plane[r * SKIP_COLS + c] = sum / 16.0f;
            }
    }
}

static inline hada_image skip_scene(void)
{
    hada_image scene;
    ASSERT_OK(hada_image_create(&scene, SKIP_CHANNELS, SKIP_HIGH, SKIP_WIDE, err));
    return scene;
}

static inline void skip_light(hada_image *scene, int row, int col, int high, int wide, float value)
{
    for (int c = 0; c < SKIP_CHANNELS; c++)
        for (int r = row; r < row + high; r++)
            for (int k = col; k < col + wide; k++)
                scene->data[(c * SKIP_HIGH + r) * SKIP_WIDE + k] = value / (float)(1 + c);
}

/* Frame `which` is the scene through PSF z, and the scene is done with. */
static inline void skip_shoot(skip_fixture *f, int which, hada_image *scene, int z, double noise)
{
    f->frame[which] = small_frame(&f->psf[z], scene, 0, noise, (uint64_t)which + 1);
    hada_image_destroy(scene);
}

static inline void skip_make_frames(skip_fixture *f)
{
    hada_random random;
    hada_image scene = skip_scene();
    skip_light(&scene, 8, 9, 9, 12, 1e-6f);
    skip_shoot(f, SKIP_FAINT, &scene, 1, 0.0);
    scene = skip_scene();
    skip_light(&scene, 11, 14, 1, 1, 1.0f);
    skip_shoot(f, SKIP_TINY, &scene, 2, 1e-5);
    scene = skip_scene();
    skip_light(&scene, 0, 0, 2, SKIP_WIDE, 1.0f);
    skip_light(&scene, SKIP_HIGH - 1, SKIP_WIDE - 3, 1, 3, 1.0f);
    skip_shoot(f, SKIP_EDGE, &scene, 0, 1e-4);
    scene = skip_scene();
    skip_light(&scene, 3, 4, 17, 20, 0.7f);
    skip_shoot(f, SKIP_BETWEEN, &scene, 1, 1e-3);
    scene = skip_scene();
    skip_light(&scene, 3, 4, 17, 20, 0.7f);
    hada_image other = small_frame(&f->psf[2], &scene, 0, 1e-3, 77);
    for (size_t i = 0; i < hada_image_count(&other); i++)
        f->frame[SKIP_BETWEEN].data[i] = 0.5f * (f->frame[SKIP_BETWEEN].data[i] + other.data[i]);
    hada_image_destroy(&other);
    skip_shoot(f, SKIP_ONE_COLOUR, &scene, 3, 0.0);
    memset(f->frame[SKIP_ONE_COLOUR].data, 0, skip_pixels() * sizeof(float));
    memset(f->frame[SKIP_ONE_COLOUR].data + 2 * skip_pixels(), 0, skip_pixels() * sizeof(float));
    scene = skip_scene();
    skip_light(&scene, 5, 5, 6, 14, 0.9f);
    skip_shoot(f, SKIP_GREY, &scene, 0, 1e-3);
    for (size_t c = 1; c < SKIP_CHANNELS; c++)
        memcpy(f->frame[SKIP_GREY].data + c * skip_pixels(), f->frame[SKIP_GREY].data, skip_pixels() * sizeof(float));
    for (int which = SKIP_NOISE; which < SKIP_FRAMES; which++)
        ASSERT_OK(hada_image_create(&f->frame[which], SKIP_CHANNELS, SKIP_ROWS, SKIP_COLS, err));
    hada_random_seed(&random, 5, 5);
    for (size_t i = 0; i < SKIP_CHANNELS * skip_pixels(); i++) {
        f->frame[SKIP_NOISE].data[i] = (float)hada_random_normal(&random);
        f->frame[SKIP_CONSTANT].data[i] = 0.25f;
        f->frame[SKIP_LIMITED].data[i] = (float)hada_random_uniform(&random);
    }
    for (size_t c = 0; c < SKIP_CHANNELS; c++)
        skip_blur(f->frame[SKIP_LIMITED].data + c * skip_pixels(), 40);
    f->frame[SKIP_SPIKE].data[skip_pixels() + 1234] = 1000.0f;
}

static inline hada_model *skip_from_psf(skip_fixture *f, hada_form form, hada_boundary boundary)
{
    double distances[SKIP_DEPTHS];
    hada_model *model;
    DEFAULTS(hada_psf_options, options);
    options.form = form;
    options.boundary = boundary;
    options.window_rows = SKIP_HIGH;
    options.window_cols = SKIP_WIDE;
    for (int z = 0; z < SKIP_DEPTHS; z++)
        distances[z] = 100.0 * (z + 1);
    ASSERT_OK(hada_model_from_psf(&model, f->context, f->psf, SKIP_DEPTHS, distances, &options, err));
    return model;
}

/* As one that was fitted with the split form: real and imaginary gains that differ, falling off with frequency. The
 * channels 0 and 1 have the same filters. */
static inline hada_model *skip_split(skip_fixture *f)
{
    hada_model *model;
    hada_model_info info = *hada_model_get_info(f->model[SKIP_WIENER]);
    hada_random random;
    info.form = HADA_FORM_SPLIT;
    ASSERT_OK(hada_model_create(&model, &info, 0, err));
    hada_random_seed(&random, 3, 3);
    const size_t plane = 2 * hada_model_plane(model), cols = (size_t)info.grid_cols / 2 + 1;
    for (size_t z = 0; z < SKIP_DEPTHS; z++)
        for (size_t c = 0; c < SKIP_CHANNELS; c++) {
            float *filter = model->filter + (z * SKIP_CHANNELS + c) * plane;
            for (size_t i = 0; i < plane; i++) {
                const double x = (double)(i / 2 % cols) / (double)cols;
                filter[i] = (float)(hada_random_normal(&random) * pow(10.0, -3.0 * x));
            }
            if (c == 1)
                memcpy(filter, filter - plane, plane * sizeof *filter);
        }
    memcpy(model->otf, f->model[SKIP_WIENER]->otf, plane * SKIP_DEPTHS * SKIP_CHANNELS * sizeof *model->otf);
    return model;
}

static inline int skip_setup(void **state)
{
    static skip_fixture f;
    memset(&f, 0, sizeof f);
    ASSERT_OK(hada_context_create(&f.context, NULL, err));
    for (int z = 0; z < SKIP_DEPTHS; z++)
        f.psf[z] = small_psf(SKIP_CHANNELS, SKIP_ROWS, SKIP_COLS, 12, (uint64_t)z + 1);
    skip_make_frames(&f);
    f.model[SKIP_WIENER] = skip_from_psf(&f, HADA_FORM_WIENER, HADA_BOUNDARY_CIRCULAR);
    f.model[SKIP_PADDED] = skip_from_psf(&f, HADA_FORM_WIENER, HADA_BOUNDARY_PADDED);
    f.model[SKIP_SPLIT] = skip_split(&f);
    for (int z = 0; z < SKIP_DEPTHS; z++)
        for (size_t c = 0; c < SKIP_CHANNELS; c++)
            skip_blur(f.psf[z].data + c * skip_pixels(), 4 + 2 * z);
    f.model[SKIP_SMOOTH] = skip_from_psf(&f, HADA_FORM_MATCHED, HADA_BOUNDARY_CIRCULAR);
    *state = &f;
    return 0;
}

static inline int skip_teardown(void **state)
{
    skip_fixture *f = *state;
    destroy_images(f->psf, SKIP_DEPTHS);
    for (int m = 0; m < SKIP_MODELS; m++)
        hada_model_destroy(&f->model[m]);
    destroy_images(f->frame, SKIP_FRAMES);
    close_context(&f->context);
    return 0;
}

static inline hada_plan_options skip_options(unsigned skip, double max_error)
{
    DEFAULTS(hada_plan_options, options);
    options.refine = 0;
    options.skip = skip;
    options.max_error = max_error;
    return options;
}

static inline hada_plan *skip_plan(const skip_fixture *f, int model, const hada_plan_options *options)
{
    hada_plan *plan;
    ASSERT_OK(hada_plan_create(&plan, f->context, f->model[model], options, err));
    return plan;
}

/* Relative L2 change of the stack. */
static inline double skip_change(const hada_result *result, const hada_result *dense)
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

#endif
