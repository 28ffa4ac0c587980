/* An iteration of Richardson-Lucy, with total variation and acceleration. */
#include <math.h>

#include "classic/classic_steps.h"

/* Predictions of a pixel below this share of the frame's brightness count as that much, and pixels whose light the
 * sensor sees to less than this share as if it saw that much. */
static const double least_made = 1e-5, least_seen = 1e-3;

/* So far at most goes the extrapolation (Biggs and Andrews: below 1). */
static const double most_momentum = 0.999;

static hada_status fill(hada_classic *classic, hada_classic_part part, double number, hada_error *err)
{
    const cl_float value = (float)number;
    const cl_int code = clEnqueueFillBuffer(classic->slot->queue, classic->part[part].mem, &value, sizeof value, 0,
                                            classic->bytes[part], 0, NULL, hada_slot_event(classic->slot));
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueFillBuffer");
    hada_slot_moved(classic->slot, "fill", (double)classic->bytes[part]);
    return HADA_OK;
}

/* Flat planes to start from, and the transpose of the sensor's frame. The first step takes the scale of the start away,
 * but the extrapolation sees it: it goes with the frame's brightness. */
hada_status hada_classic_rl_begin(hada_classic *classic, hada_error *err)
{
    const double flat = classic->job->brightness / sqrt(classic->job->camera->gain);
    hada_status status = fill(classic, HADA_CLASSIC_MADE, 1.0, err);
    if (!status)
        status = classic->fuses ? hada_classic_fused_frame(classic, 0, 1, 0, 0.0, err)
                                : hada_classic_frame_forward(classic, HADA_CLASSIC_SUM, err);
    if (!status)
        status = hada_classic_transpose(classic, HADA_CLASSIC_NORM, err);
    if (!status)
        status = fill(classic, HADA_CLASSIC_START, flat, err);
    if (!status)
        status = fill(classic, HADA_CLASSIC_BEFORE, flat, err);
    return status ? status : hada_classic_clear(classic, HADA_CLASSIC_MADE, err);
}

static hada_status multiply(hada_classic *classic, hada_error *err)
{
    const hada_classic_image *image = &classic->plane;
    const hada_classic_options *o = &classic->shape.options;
    const double all = (double)image->pixels * classic->planes;
    const int tv = o->prior == HADA_PRIOR_TV;
    cl_int rows = image->rows, cols = image->cols, pitch = image->pitch, band = image->band;
    cl_float weight = tv ? (float)o->weight : 0.0f, seen = (float)(least_seen * sqrt(classic->job->camera->gain));
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_START].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_X].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_NORM].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_BEFORE].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_TURN].mem),
                       HADA_ARG(rows),
                       HADA_ARG(cols),
                       HADA_ARG(pitch),
                       HADA_ARG(band),
                       HADA_ARG(weight),
                       HADA_ARG(seen),
                       HADA_ARG(classic->part[HADA_CLASSIC_PARTIAL].mem)};
    hada_slot_cost(classic->slot, 28.0 * all, (tv ? 50.0 : 12.0) * all);
    return hada_classic_rows(classic, "classic_lucy", "classic_lucy", args, HADA_COUNT(args), err);
}

static hada_status go_on(hada_classic *classic, double momentum, hada_error *err)
{
    cl_uint pixels = (cl_uint)classic->plane.pixels, slice = HADA_CLASSIC_SLICE;
    cl_float factor = (float)momentum;
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_X].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_BEFORE].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_START].mem),
                       HADA_ARG(factor),
                       HADA_ARG(pixels),
                       HADA_ARG(slice)};
    hada_slot_cost(classic->slot, 12.0 * (double)pixels * classic->planes, 3.0 * (double)pixels * classic->planes);
    return hada_classic_pixels(classic, "classic_step", "classic_forward", args, HADA_COUNT(args), err);
}

/* The correction is computed where the planes before the last ones stood, and becomes the new planes. */
hada_status hada_classic_rl_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err)
{
    const int accelerate = classic->shape.options.accelerate;
    const double least = fmax(least_made * classic->job->brightness, 1e-30);
    double all[4] = {0}, factor = 0.0;
    if (number)
        hada_classic_swap(classic, HADA_CLASSIC_X, HADA_CLASSIC_BEFORE);
    hada_status status = hada_classic_predict(classic, HADA_CLASSIC_START, err);
    if (!status)
        status = hada_classic_judge(classic, HADA_CLASSIC_RATIO, least, 1, err);
    if (!status)
        status = hada_classic_transpose(classic, HADA_CLASSIC_X, err);
    if (!status)
        status = multiply(classic, err);
    if (!status && (accelerate || wanted))
        status = hada_classic_sums(classic, hada_classic_bands(classic), 4, all, err);
    if (accelerate && all[1] > 0.0)
        factor = fmax(0.0, fmin(all[0] / all[1], most_momentum));
    if (wanted) {
        sums[0] = all[2];
        sums[1] = all[3];
    }
    return status ? status : go_on(classic, factor, err);
}
