/* A refiner on a small camera, and scenes at two of its depths. */
#ifndef HADA_REFINE_FIXTURE_H
#define HADA_REFINE_FIXTURE_H

#include "refine/admm_steps.h"
#include "tiny_camera.h"

typedef struct fixture {
    tiny_camera camera;
    tiny_device device;
    hada_refiner *refiner;
    double *scenes, *image;
} fixture;

static void set_up(fixture *f, int frame_rows, int frame_cols, int window_rows, int window_cols, int depths,
                   int channels, int padded)
{
    f->camera = tiny_make(frame_rows, frame_cols, window_rows, window_cols, depths, channels, padded);
    tiny_upload(&f->device, &f->camera);
    f->device.shape.tv = 1;
    f->device.shape.settle = 1;
    ASSERT_OK(hada_refiner_create(&f->refiner, f->device.slot, &f->device.shape, err));
    f->scenes = tiny_zeros((size_t)depths * f->camera.window_area);
    f->image = tiny_zeros(f->camera.pixels);
}

static void tear_down(fixture *f)
{
    hada_refiner_destroy(&f->refiner);
    tiny_release(&f->device);
    tiny_free(&f->camera);
    HADA_FREE(f->scenes, f->image);
}

/* The left half of one scene at depth a, the right half of another at depth b. */
static void two_depths(fixture *f, int a, int b)
{
    const size_t area = f->camera.window_area, cols = (size_t)f->camera.window.cols;
    double *left = f->scenes + (size_t)a * area, *right = f->scenes + (size_t)b * area;
    memset(f->scenes, 0, (size_t)f->camera.depths * area * sizeof *left);
    tiny_scene(&f->camera, 11, left);
    tiny_scene(&f->camera, 12, right);
    for (size_t i = 0; i < area; i++)
        (i % cols < cols / 2 ? right : left)[i] = 0.0;
}

static void expose(fixture *f, double noise, double gain)
{
    tiny_shoot(&f->camera, f->scenes, noise, 3, f->image);
    tiny_expose(&f->device, &f->camera, f->image, gain);
}

static float *read_planes(const fixture *f, int planes)
{
    const size_t count = (size_t)(planes * f->camera.channels) * f->camera.window_area;
    float *values = calloc(count, sizeof *values);
    const cl_int code = clEnqueueReadBuffer(f->device.slot->queue, hada_refiner_planes(f->refiner), CL_TRUE, 0,
                                            count * sizeof *values, values, 0, NULL, NULL);
    assert_int_equal(code, CL_SUCCESS);
    return values;
}

static inline void assert_near(double got, double expected, double relative)
{
    if (!(fabs(got - expected) <= relative * fabs(expected)))
        fail_msg("%.9g, expected %.9g within %g", got, expected, relative);
}

#endif
