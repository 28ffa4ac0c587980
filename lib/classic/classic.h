/* The classic methods: planes that together explain a frame, by other people's iterations. Internal.
 *
 * hadalens/classic.h says what they minimise, docs/explanation/mathematics.md how each iteration goes. Images stand
 * with rows of a pitch that is a multiple of 8 floats. */
#ifndef HADA_CLASSIC_CLASSIC_H
#define HADA_CLASSIC_CLASSIC_H

#include <hadalens/classic.h>

#include "planes/maker.h"
#include "refine/admm.h"

typedef struct hada_classic_shape {
    hada_refine_shape place;      /* max_planes: the most depths of a run */
    hada_rectangle support;       /* where planes may be bright while the method works */
    int choose;                   /* 1: the prior's weight is found from each frame */
    hada_classic_options options; /* nothing in it is left open */
    int grid_rows, grid_cols;     /* of the method's transforms: the model's, or smaller ones */
    hada_rectangle reach; /* on a smaller grid: the lags at which point spread functions are not 0; else empty */
    int components;       /* of each depth; above 1 where its point spread function varies over the field */
    int sieve;            /* 1: Richardson-Lucy may take planes for sums of Gaussians; the support is the window */
    int haze;             /* 1: after the depths, one more transfer function describes a smooth background */
} hada_classic_shape;

/* The shape for a model. HADA_ERROR_ARGUMENT where the options make no sense, HADA_ERROR_MODEL where the model has no
 * transfer functions. */
hada_status hada_classic_shape_of(const hada_model_info *info, int depths, const hada_classic_options *options,
                                  hada_classic_shape *shape, hada_error *err);

/* Whether the method heeds weights of the frame's values: all that iterate on its pixels do. */
int hada_classic_weighs(const hada_classic_shape *shape);

/* What the methods must know of a camera and a set of its depths. */
typedef struct hada_classic_camera {
    double gain;        /* the largest |OTF(0)|^2 of the whole model */
    double mean_square; /* mean of |OTF|^2 over frequencies, channels and the set's depths */
    double *largest;    /* [channel]: the largest sum of |OTF|^2 over the set's depths */
} hada_classic_camera;

hada_status hada_classic_camera_of(hada_classic_camera *camera, const hada_model *model, const int *depths, int count,
                                   hada_error *err);
void hada_classic_camera_free(hada_classic_camera *camera);

/* Makes the grid of the transforms as small as the point spread functions of the given depths (indices into the model;
 * NULL: the first `count`) allow for the same planes up to rounding: classic_grid.c. Where nothing is to be gained the
 * shape stays as it is. */
hada_status hada_classic_fit_grid(hada_classic_shape *shape, hada_context *context, const hada_model *model,
                                  const int *depths, int count, hada_error *err);

/* Floats of a row of an image of planes. */
static inline size_t hada_classic_pitch(int cols)
{
    return ((size_t)cols + 7) / 8 * 8;
}

/* Whether a method takes transfer functions of its own, [depth][channel] on its grid: on a smaller one, or for
 * Richardson-Lucy, which wants point spread functions without negative values and without what is taken for noise (of
 * the same sum); or, with components, [depth][component][channel], and after them their weights as images of planes,
 * [depth][component], those beyond the window as at its border. They are complete when hada_classic_optics() returns.
 */
int hada_classic_has_optics(const hada_classic_shape *shape);
hada_status hada_classic_optics(hada_buffer *out, hada_context *context, const hada_classic_shape *shape,
                                const hada_model *model, const int *depths, int count, hada_error *err);

typedef struct hada_classic hada_classic;

/* The planes are a result of the slot's steps (runtime/memory.h). */
hada_status hada_classic_create(hada_classic **out, hada_slot *slot, const hada_classic_shape *shape, hada_error *err);
void hada_classic_destroy(hada_classic **classic);

typedef struct hada_classic_job {
    const hada_refine_data *data; /* prior and variance are not looked at; the frame is read by padded ADMM and by RL,
                                     weights where hada_classic_weighs() */
    const hada_classic_camera *camera;
    int depths; /* of this run */
    const int *list;
    double weight;     /* of the prior */
    double brightness; /* of the frame, root of the mean square over its pixels and channels */
    int iterations;    /* at most; 0: the options' */
    int before;        /* > 0: goes on from the planes of the last run, of the same job, which did so many of them */
    int anew;          /* 1, with that: weights of the frame's values have changed */
    double sieve;      /* standard deviation of the planes' Gaussians in pixels; 0: none */
    void (*progress)(void *user, int iterations); /* may be NULL */
    void *user;
} hada_classic_job;

typedef struct hada_classic_result {
    int iterations;
    double energy; /* of b - sum PSF * x within the frame, x the planes, of values whose weight is not 0 */
} hada_classic_result;

/* Finds the prior's weight with which the planes predict held-out values best (planes/weight_search.h): the job's data
 * have the weights of the others, `held` is 1 at held-out values. It takes hada_classic_search_most() iterations at
 * most, 2.5 times the method's own or fewer; 0 where no weight is searched. */
int hada_classic_search_most(const hada_classic_shape *shape);
hada_status hada_classic_choose(hada_classic *classic, const hada_classic_job *job, cl_mem held,
                                const hada_frame_exposure *exposure, hada_maker_choice *choice, hada_error *err);

/* Planes as sums of Gaussians. */
typedef struct hada_classic_sieved {
    double width; /* standard deviation of the Gaussians, or 0 */
    double left;  /* energy that they leave of held-out values */
    int iterations;
} hada_classic_sieved;

/* Finds the width with which the planes predict held-out values best, from wide to narrow; job and `held` are those of
 * hada_classic_choose(). A run goes on from there with the width and, `before`, the iterations. */
hada_status hada_classic_sieve(hada_classic *classic, const hada_classic_job *job, cl_mem held,
                               hada_classic_sieved *found, hada_error *err);

/* What planes leave of held-out values whose light is only where `start` is above 0, with the width that was found, or
 * a narrower one: [plane][row][hada_classic_pitch()] floats, to begin with. */
hada_status hada_classic_sieve_within(hada_classic *classic, const hada_classic_job *job, cl_mem held,
                                      const hada_classic_sieved *found, const float *start, double *left,
                                      hada_error *err);

/* Runs the method from nothing. The planes may still be on their way when it returns. */
hada_status hada_classic_run(hada_classic *classic, const hada_classic_job *job, hada_classic_result *result,
                             hada_error *err);

/* [place in the list][channel][window rows][window cols] floats. */
cl_mem hada_classic_planes(const hada_classic *classic);

#endif
