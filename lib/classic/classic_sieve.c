/* Richardson-Lucy whose planes are sums of Gaussians with non-negative weights, the method of sieves (D. Snyder and M.
 * Miller, IEEE Trans. Nuclear Science 32(5), 1985): what is narrower than the Gaussian is noise. The iteration is that
 * of a camera whose point spread functions are blurred. From wide to narrow Gaussians the planes go on as they are, for
 * a wide Gaussian is a narrower one of a third. */
#include <math.h>

#include "classic/classic_steps.h"
#include "launch/classic_frame.h"

enum { EACH = 70 };
#define WIDEST    2.8284271247461903 /* pixels; each next one has half of its square, and after the narrowest comes 0 */
#define NARROWEST 0.8

/* The search ends where this much more is left of held-out values. */
#define WORSE 1.01

/* PRIMAL, to or from where the result will be: the support is the window. */
static hada_status keep(hada_classic *classic, int back, hada_error *err)
{
    const hada_classic_image *plane = &classic->plane;
    const hada_range range = hada_range_of((size_t)plane->pitch, 8, (size_t)plane->rows, (size_t)classic->planes);
    const cl_mem window = classic->part[HADA_CLASSIC_WINDOW].mem, planes = classic->part[HADA_CLASSIC_PRIMAL].mem;
    hada_slot_cost(classic->slot, 8.0 * (double)plane->pixels * classic->planes, 0.0);
    if (back)
        return hada_launch_classic_pad(classic->slot, hada_program_classic_frame_of(classic->slot), &range, err,
                                       .frame = window, .offset = 0, .images = planes, .cols = plane->cols);
    return hada_launch_classic_crop(classic->slot, hada_program_classic_frame_of(classic->slot), &range, err,
                                    .planes = planes, .window = window, .pitch = plane->pitch, .row0 = 0, .col0 = 0,
                                    .rows = plane->rows, .cols = plane->cols);
}

/* Iterations with one width, and what they leave of held-out values. */
static hada_status try_width(hada_classic *classic, const hada_classic_job *job, cl_mem held, int *iterations,
                             double *left, hada_error *err)
{
    double sums[2];
    for (int k = 0; k < EACH; k++, ++*iterations) {
        HADA_TRY(hada_classic_rl_step(classic, k, 0, sums, err));
        if (job->progress && k % 8 == 7)
            job->progress(job->user, *iterations + 1);
    }
    HADA_TRY(hada_classic_weigh(classic, held, err));
    HADA_TRY(hada_classic_energy(classic, left, err));
    return hada_classic_weigh(classic, job->data->weights, err);
}

/* 0 after the last one. */
static double narrower(double width)
{
    return width > NARROWEST ? width * sqrt(0.5) : 0.0;
}

hada_status hada_classic_sieve(hada_classic *classic, const hada_classic_job *job, cl_mem held,
                               hada_classic_sieved *found, hada_error *err)
{
    double now = WIDEST, left = 0.0;
    int last = 0;
    *found = (hada_classic_sieved){.left = INFINITY};
    HADA_TRY(hada_classic_ready(classic, job, err));
    classic->sieve = now;
    HADA_TRY(hada_classic_rl_begin(classic, err));
    for (;;) {
        HADA_TRY(try_width(classic, job, held, &found->iterations, &left, err));
        last = left < found->left;
        if (last) {
            found->left = left;
            found->width = now;
            HADA_TRY(keep(classic, 0, err));
        }
        if (!(now > 0.0) || left > WORSE * found->left)
            break;
        now = narrower(now);
        HADA_TRY(hada_classic_rl_anew(classic, now, err));
    }
    classic->sieve = found->width;
    return last ? HADA_OK : keep(classic, 1, err);
}

hada_status hada_classic_sieve_within(hada_classic *classic, const hada_classic_job *job, cl_mem held,
                                      const hada_classic_sieved *found, const float *start, double *left,
                                      hada_error *err)
{
    double other;
    int iterations = found->iterations;
    classic->job = job;
    HADA_TRY(hada_buffer_write(&classic->part[HADA_CLASSIC_PRIMAL], classic->slot, 0, start,
                               (size_t)classic->planes * classic->plane.pixels * sizeof *start, err));
    HADA_TRY(hada_classic_rl_anew(classic, classic->sieve, err));
    HADA_TRY(try_width(classic, job, held, &iterations, left, err));
    if (found->width > 0.0) {
        HADA_TRY(hada_classic_rl_anew(classic, narrower(found->width), err));
        HADA_TRY(try_width(classic, job, held, &iterations, &other, err));
        *left = fmin(*left, other);
    }
    classic->sieve = found->width;
    return keep(classic, 1, err);
}
