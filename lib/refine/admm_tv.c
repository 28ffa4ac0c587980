/* Refinement's total variation: the kernels of a proximal step, one after the other. */
#include "refine/admm_steps.h"

/* Rows of a work-group: enough groups for a few cores or many, few enough that a launch is cheap. */
enum { LANES_BAND = 16, GROUPS_BAND = 2 };

hada_status hada_refine_tv_prepare(hada_refiner *refiner, hada_error *err)
{
    refiner->tv_program = refiner->slot->context->shape == HADA_SHAPE_GROUPS ? HADA_PROGRAM_REFINE_TV_GROUPS
                          : refiner->shape.window.cols < 8 /* a vector */    ? HADA_PROGRAM_REFINE_TV_SCALAR
                                                                             : HADA_PROGRAM_REFINE_TV_DEFAULT;
    return hada_prepare_refine_tv(refiner->slot, refiner->tv_program, err);
}

static hada_refine_window window_of(const hada_refiner *refiner)
{
    return (hada_refine_window){.channels = refiner->shape.channels,
                                .rows = refiner->shape.window.rows,
                                .cols = refiner->shape.window.cols,
                                .band = refiner->group > 1 ? GROUPS_BAND : LANES_BAND};
}

static hada_range bands_of(const hada_refiner *refiner, const hada_refine_window *window, int planes)
{
    const size_t bands = hada_divide_up((size_t)window->rows, (size_t)window->band);
    return hada_range_groups(bands, refiner->group, (size_t)planes, 1);
}

/* A projected gradient step on the dual. */
static hada_status dual_step(hada_refiner *refiner, int planes, double theta, int from, int fresh, hada_error *err)
{
    const hada_refine_window window = window_of(refiner);
    const hada_range range = bands_of(refiner, &window, planes);
    const double all = (double)planes * window.channels * (double)refiner->window_area;
    hada_slot_cost(refiner->slot, (fresh ? 12.0 : 20.0) * all, 20.0 * all);
    return hada_launch_refine_tv_duals(refiner->slot, refiner->tv_program, &range, err, .given = refiner->planes.mem,
                                       .old = refiner->tv[from].mem, .next = refiner->tv[!from].mem, .fresh = fresh,
                                       .window = window, .theta = (float)theta,
                                       .step = (float)(HADA_REFINE_TV_LENGTH / theta));
}

/* The planes that the dual stands for. */
static hada_status primal_step(hada_refiner *refiner, int planes, double theta, int from, hada_error *err)
{
    const hada_refine_window window = window_of(refiner);
    const hada_range range = bands_of(refiner, &window, planes);
    const double all = (double)planes * window.channels * (double)refiner->window_area;
    hada_slot_cost(refiner->slot, 16.0 * all, 5.0 * all);
    return hada_launch_refine_tv_planes(refiner->slot, refiner->tv_program, &range, err, .planes = refiner->planes.mem,
                                        .duals = refiner->tv[from].mem, .window = window, .theta = (float)theta);
}

hada_status hada_refine_tv_step(hada_refiner *refiner, int planes, double theta, int fresh, hada_error *err)
{
    hada_status status = HADA_OK;
    /* an even number of steps: the duals end where they began */
    for (int k = 0; k < HADA_REFINE_TV_STEPS; k++)
        HADA_TRY(dual_step(refiner, planes, theta, k % 2, fresh && !k, err));
    HADA_TRY(primal_step(refiner, planes, theta, 0, err));
done:
    return status;
}
