#include "refine/variation.h"

/* Rows of a work-group: enough groups for a few cores or many, few enough that a launch is cheap. */
enum { LANES_BAND = 16, GROUPS_BAND = 2 };

hada_status hada_variation_prepare(hada_variation *variation, hada_slot *slot, int channels, int rows, int cols,
                                   hada_error *err)
{
    *variation = (hada_variation){.channels = channels, .rows = rows, .cols = cols};
    variation->program = HADA_PROGRAM_VARIANT(REFINE_TV, slot->context, cols >= 8);
    variation->group = (size_t)hada_macros_of_refine_tv(variation->program)->refine_group;
    return hada_prepare_refine_tv(slot, variation->program, err);
}

size_t hada_variation_floats(int channels, int rows, int cols, int planes)
{
    return 2 * (size_t)planes * (size_t)channels * (size_t)rows * (size_t)cols + HADA_VARIATION_ROOM;
}

static hada_refine_window window_of(const hada_variation *v)
{
    return (hada_refine_window){
        .channels = v->channels, .rows = v->rows, .cols = v->cols, .band = v->group > 1 ? GROUPS_BAND : LANES_BAND};
}

static hada_range bands_of(const hada_variation *v, const hada_refine_window *window, int count)
{
    const size_t bands = hada_divide_up((size_t)window->rows, (size_t)window->band);
    return hada_range_groups(bands, v->group, (size_t)count, 1);
}

static double values_of(const hada_variation *v, int count)
{
    return (double)count * v->channels * v->rows * v->cols;
}

/* A projected gradient step on the dual. */
static hada_status dual_step(const hada_variation *v, hada_slot *slot, cl_mem planes, cl_mem old, cl_mem next,
                             int count, double theta, double colour, int fresh, hada_error *err)
{
    /* one channel has no colour */
    const double per_colour = v->channels > 1 ? 1.0 / (colour * colour) : 1.0;
    const hada_refine_window window = window_of(v);
    const hada_range range = bands_of(v, &window, count);
    hada_slot_cost(slot, (fresh ? 12.0 : 20.0) * values_of(v, count), 20.0 * values_of(v, count));
    return hada_launch_refine_tv_duals(slot, v->program, &range, err, .given = planes, .old = old, .next = next,
                                       .fresh = fresh, .window = window, .theta = (float)theta,
                                       .step = (float)(HADA_REFINE_TV_LENGTH / theta), .per_colour = (float)per_colour);
}

/* The planes that the dual stands for. */
static hada_status primal_step(const hada_variation *v, hada_slot *slot, cl_mem planes, cl_mem duals, int count,
                               double theta, hada_error *err)
{
    const hada_refine_window window = window_of(v);
    const hada_range range = bands_of(v, &window, count);
    hada_slot_cost(slot, 16.0 * values_of(v, count), 5.0 * values_of(v, count));
    return hada_launch_refine_tv_planes(slot, v->program, &range, err, .planes = planes, .duals = duals,
                                        .window = window, .theta = (float)theta);
}

hada_status hada_variation_step(const hada_variation *variation, hada_slot *slot, cl_mem planes, const cl_mem duals[2],
                                int count, double theta, double colour, int fresh, hada_error *err)
{
    hada_status status = HADA_OK;
    /* an even number of steps: the duals end where they began */
    for (int k = 0; k < HADA_REFINE_TV_STEPS; k++)
        HADA_TRY(
            dual_step(variation, slot, planes, duals[k % 2], duals[!(k % 2)], count, theta, colour, fresh && !k, err));
    HADA_TRY(primal_step(variation, slot, planes, duals[0], count, theta, err));
done:
    return status;
}
