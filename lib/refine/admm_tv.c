/* Refinement's total variation: the kernels of a proximal step, one after the other. */
#include "runtime/kernel.h"
#include "refine/admm_steps.h"

/* Rows of a work-group: enough groups for a few cores or many, few enough that a launch is cheap. */
enum { LANES_BAND = 16, GROUPS_BAND = 2 };

hada_status hada_refine_tv_kernels(hada_refiner *refiner, hada_error *err)
{
    hada_slot *slot = refiner->slot;
    const char *options = slot->context->shape == HADA_SHAPE_GROUPS ? "-DREFINE_WIDTH=1 -DREFINE_GROUP=64"
                          : refiner->shape.window.cols < 8          ? "-DREFINE_WIDTH=1"
                                                                    : "";
    hada_status status = hada_slot_kernel(slot, "refine_tv", "refine_tv_duals", options, &refiner->tv_duals, err);
    if (!status)
        status = hada_slot_kernel(slot, "refine_tv", "refine_tv_planes", options, &refiner->tv_planes, err);
    return status;
}

typedef struct bands {
    cl_int band;
    size_t global[2], local[2];
} bands;

static bands bands_of(const hada_refiner *refiner, int planes)
{
    const int band = refiner->group > 1 ? GROUPS_BAND : LANES_BAND, rows = refiner->shape.window.rows;
    const size_t group = (size_t)refiner->group;
    return (bands){band, {(size_t)((rows + band - 1) / band) * group, (size_t)planes}, {group, 1}};
}

static hada_status climb(hada_refiner *refiner, int planes, double theta, int from, int first, hada_error *err)
{
    const bands b = bands_of(refiner, planes);
    cl_int fresh = first, channels = refiner->shape.channels, rows = refiner->shape.window.rows;
    cl_int cols = refiner->shape.window.cols, band = b.band;
    cl_float weight = (float)theta, step = (float)(HADA_REFINE_TV_LENGTH / theta);
    hada_arg args[] = {HADA_ARG(refiner->planes.mem),
                       HADA_ARG(refiner->tv[from].mem),
                       HADA_ARG(refiner->tv[!from].mem),
                       HADA_ARG(fresh),
                       HADA_ARG(channels),
                       HADA_ARG(rows),
                       HADA_ARG(cols),
                       HADA_ARG(band),
                       HADA_ARG(weight),
                       HADA_ARG(step)};
    const double all = (double)planes * channels * (double)refiner->window_area;
    hada_slot_cost(refiner->slot, (first ? 12.0 : 20.0) * all, 20.0 * all);
    return hada_slot_launch(refiner->slot, refiner->tv_duals, "refine_tv_duals", 2, b.global, b.local, args,
                            HADA_COUNT(args), err);
}

static hada_status land(hada_refiner *refiner, int planes, double theta, int from, hada_error *err)
{
    const bands b = bands_of(refiner, planes);
    cl_int channels = refiner->shape.channels, rows = refiner->shape.window.rows, cols = refiner->shape.window.cols;
    cl_int band = b.band;
    cl_float weight = (float)theta;
    hada_arg args[] = {HADA_ARG(refiner->planes.mem),
                       HADA_ARG(refiner->tv[from].mem),
                       HADA_ARG(channels),
                       HADA_ARG(rows),
                       HADA_ARG(cols),
                       HADA_ARG(band),
                       HADA_ARG(weight)};
    const double all = (double)planes * channels * (double)refiner->window_area;
    hada_slot_cost(refiner->slot, 16.0 * all, 5.0 * all);
    return hada_slot_launch(refiner->slot, refiner->tv_planes, "refine_tv_planes", 2, b.global, b.local, args,
                            HADA_COUNT(args), err);
}

hada_status hada_refine_tv_step(hada_refiner *refiner, int planes, double theta, int fresh, hada_error *err)
{
    hada_status status = HADA_OK;
    /* an even number of steps: the duals end where they began */
    for (int k = 0; !status && k < HADA_REFINE_TV_STEPS; k++)
        status = climb(refiner, planes, theta, k % 2, fresh && !k, err);
    return status ? status : land(refiner, planes, theta, 0, err);
}
