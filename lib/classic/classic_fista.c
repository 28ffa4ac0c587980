/* An iteration of FISTA: a gradient step, the prior's proximal step, non-negativity, momentum. */
#include <math.h>

#include "classic/classic_steps.h"

/* Nesterov's sequence; returns the factor of the momentum. */
static double advance(double *t)
{
    const double next = (1.0 + sqrt(1.0 + 4.0 * *t * *t)) / 2.0, beta = (*t - 1.0) / next;
    *t = next;
    return beta;
}

/* The first start is 0, and so are its half spectra. */
hada_status hada_classic_fista_begin(hada_classic *classic, hada_error *err)
{
    hada_status status = hada_classic_clear(classic, HADA_CLASSIC_SPECTRA, err);
    if (status)
        return status;
    for (int c = 0; c < classic->shape.place.channels; c++)
        classic->table[c] = (float)(classic->shape.options.step / classic->job->camera->largest[c]);
    return hada_buffer_write(&classic->part[HADA_CLASSIC_TABLE], classic->slot, 0, classic->table,
                             classic->bytes[HADA_CLASSIC_TABLE], err);
}

/* The prior's weight in the images' own units; the steps of the channels multiply it. */
static double weight(const hada_classic *classic)
{
    return classic->shape.options.weight * sqrt(classic->job->camera->gain) * classic->job->brightness;
}

/* HADA_CLASSIC_GRADIENT = transpose of what START leaves of the frame. */
static hada_status gradient(hada_classic *classic, hada_error *err)
{
    hada_status status;
    if (classic->met) {
        status = hada_classic_predict(classic, HADA_CLASSIC_START, err);
        if (!status)
            status = hada_classic_judge(classic, HADA_CLASSIC_REST, 0.0, 1, err);
    } else {
        status = hada_classic_forward(classic, HADA_CLASSIC_START, err);
        if (!status)
            status = hada_classic_project(classic, 1, err);
    }
    return status ? status : hada_classic_transpose(classic, HADA_CLASSIC_GRADIENT, err);
}

static hada_status descend(hada_classic *classic, hada_error *err)
{
    cl_uint channels = (cl_uint)classic->shape.place.channels, pixels = (cl_uint)classic->plane.pixels;
    cl_uint slice = HADA_CLASSIC_SLICE;
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_START].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_GRADIENT].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_TABLE].mem),
                       HADA_ARG(channels),
                       HADA_ARG(pixels),
                       HADA_ARG(slice)};
    hada_slot_cost(classic->slot, 12.0 * (double)pixels * classic->planes, 2.0 * (double)pixels * classic->planes);
    return hada_classic_pixels(classic, "classic_step", "classic_descend", args, HADA_COUNT(args), err);
}

static hada_status momentum(hada_classic *classic, hada_classic_part from, int direct, double factor, hada_error *err)
{
    cl_uint channels = (cl_uint)classic->shape.place.channels, pixels = (cl_uint)classic->plane.pixels;
    cl_uint slice = HADA_CLASSIC_SLICE;
    cl_int plain = direct;
    cl_float beta = (float)factor;
    const double all = (double)pixels * classic->planes;
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_X].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_START].mem),
                       HADA_ARG(classic->part[from].mem),
                       HADA_ARG(plain),
                       HADA_ARG(classic->part[HADA_CLASSIC_TABLE].mem),
                       HADA_ARG(beta),
                       HADA_ARG(channels),
                       HADA_ARG(pixels),
                       HADA_ARG(slice),
                       HADA_ARG(classic->part[HADA_CLASSIC_PARTIAL].mem)};
    hada_slot_cost(classic->slot, (direct ? 20.0 : 16.0) * all, 10.0 * all);
    return hada_classic_pixels(classic, "classic_step", "classic_momentum", args, HADA_COUNT(args), err);
}

/* HADA_CLASSIC_SMOOTH = max(0, GRADIENT - gradient^T dual) */
static hada_status tv_planes(hada_classic *classic, hada_classic_part dual, hada_error *err)
{
    const hada_classic_image *image = &classic->plane;
    const double all = (double)image->pixels * classic->planes;
    cl_int rows = image->rows, cols = image->cols, pitch = image->pitch, band = image->band;
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_GRADIENT].mem),
                       HADA_ARG(classic->part[dual].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_SMOOTH].mem),
                       HADA_ARG(rows),
                       HADA_ARG(cols),
                       HADA_ARG(pitch),
                       HADA_ARG(band)};
    hada_slot_cost(classic->slot, 16.0 * all, 5.0 * all);
    return hada_classic_rows(classic, "classic_tv", "classic_tv_planes", args, HADA_COUNT(args), err);
}

static hada_status tv_duals(hada_classic *classic, double factor, hada_error *err)
{
    const hada_classic_image *image = &classic->plane;
    const double all = (double)image->pixels * classic->planes;
    cl_int rows = image->rows, cols = image->cols, pitch = image->pitch, band = image->band;
    cl_uint channels = (cl_uint)classic->shape.place.channels;
    cl_float strength = (float)weight(classic), beta = (float)factor;
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_SMOOTH].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_DUAL].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_DUAL2].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_TABLE].mem),
                       HADA_ARG(strength),
                       HADA_ARG(beta),
                       HADA_ARG(channels),
                       HADA_ARG(rows),
                       HADA_ARG(cols),
                       HADA_ARG(pitch),
                       HADA_ARG(band)};
    hada_slot_cost(classic->slot, 36.0 * all, 14.0 * all);
    return hada_classic_rows(classic, "classic_tv", "classic_tv_duals", args, HADA_COUNT(args), err);
}

/* The duals go on from where the last iteration left them, without its momentum. */
static hada_status total_variation(hada_classic *classic, hada_error *err)
{
    double t = 1.0;
    const cl_int code = clEnqueueCopyBuffer(classic->slot->queue, classic->part[HADA_CLASSIC_DUAL].mem,
                                            classic->part[HADA_CLASSIC_DUAL2].mem, 0, 0,
                                            classic->bytes[HADA_CLASSIC_DUAL], 0, NULL, hada_slot_event(classic->slot));
    hada_status status = code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    if (!status)
        hada_slot_moved(classic->slot, "copy", (double)classic->bytes[HADA_CLASSIC_DUAL]);
    for (int k = 0; !status && k < classic->shape.options.inner; k++) {
        status = tv_planes(classic, HADA_CLASSIC_DUAL2, err);
        if (!status)
            status = tv_duals(classic, advance(&t), err);
    }
    return status ? status : tv_planes(classic, HADA_CLASSIC_DUAL, err);
}

/* Where level `number` of the pyramid stands: 0 is the image itself. */
static cl_mem level_of(const hada_classic *classic, int number, cl_ulong *offset)
{
    const size_t each = classic->bytes[HADA_CLASSIC_PYRAMID] / (size_t)classic->shape.options.levels / sizeof(float);
    *offset = number ? (cl_ulong)(number - 1) * each : 0;
    return classic->part[number ? HADA_CLASSIC_PYRAMID : HADA_CLASSIC_GRADIENT].mem;
}

static hada_status haar_down(hada_classic *classic, int level, hada_error *err)
{
    const hada_classic_image *image = &classic->plane;
    cl_ulong fine_offset, coarse_offset;
    cl_mem fine = level_of(classic, level, &fine_offset), coarse = level_of(classic, level + 1, &coarse_offset);
    cl_int spacing = 1 << level, plain = classic->shape.options.prior == HADA_PRIOR_HAAR;
    cl_int rows = image->rows, cols = image->cols, pitch = image->pitch, band = image->band;
    hada_arg args[] = {HADA_ARG(fine),    HADA_ARG(fine_offset), HADA_ARG(coarse), HADA_ARG(coarse_offset),
                       HADA_ARG(spacing), HADA_ARG(plain),       HADA_ARG(rows),   HADA_ARG(cols),
                       HADA_ARG(pitch),   HADA_ARG(band)};
    const double all = (double)image->pixels * classic->planes;
    hada_slot_cost(classic->slot, 8.0 * all, 4.0 * all);
    return hada_classic_rows(classic, "classic_haar", "classic_haar_down", args, HADA_COUNT(args), err);
}

/* The changes of a level stand where the means of the next one stood. */
static hada_status haar_up(hada_classic *classic, int level, hada_error *err)
{
    const hada_classic_image *image = &classic->plane;
    cl_ulong fine_offset, coarse_offset, out_offset;
    cl_int more = level + 1 < classic->shape.options.levels, first = level == 0;
    cl_mem fine = level_of(classic, level, &fine_offset), out = level_of(classic, level + 1, &out_offset);
    cl_mem coarse = level_of(classic, level + 1 + more, &coarse_offset);
    cl_int spacing = 1 << level, plain = classic->shape.options.prior == HADA_PRIOR_HAAR;
    cl_int rows = image->rows, cols = image->cols, pitch = image->pitch, band = image->band;
    cl_uint channels = (cl_uint)classic->shape.place.channels;
    cl_float strength = (float)weight(classic);
    hada_arg args[] = {HADA_ARG(fine),
                       HADA_ARG(fine_offset),
                       HADA_ARG(coarse),
                       HADA_ARG(coarse_offset),
                       HADA_ARG(out),
                       HADA_ARG(out_offset),
                       HADA_ARG(more),
                       HADA_ARG(first),
                       HADA_ARG(spacing),
                       HADA_ARG(plain),
                       HADA_ARG(classic->part[HADA_CLASSIC_TABLE].mem),
                       HADA_ARG(strength),
                       HADA_ARG(channels),
                       HADA_ARG(rows),
                       HADA_ARG(cols),
                       HADA_ARG(pitch),
                       HADA_ARG(band)};
    const double all = (double)image->pixels * classic->planes;
    hada_slot_cost(classic->slot, (more ? 12.0 : 8.0) * all, 60.0 * all);
    return hada_classic_rows(classic, "classic_haar", "classic_haar_up", args, HADA_COUNT(args), err);
}

/* The result stands in level 1 of the pyramid. */
static hada_status wavelets(hada_classic *classic, hada_error *err)
{
    const int levels = classic->shape.options.levels;
    hada_status status = HADA_OK;
    for (int level = 0; !status && level + 1 < levels; level++)
        status = haar_down(classic, level, err);
    for (int level = levels - 1; !status && level >= 0; level--)
        status = haar_up(classic, level, err);
    return status;
}

/* Without a prior every part of a step is fused, and leaves the half spectra of the next start. */
static hada_status whole_step(hada_classic *classic, double beta, int wanted, double sums[2], hada_error *err)
{
    hada_status status = hada_classic_fused_columns(classic, 0, err);
    if (!status)
        status = hada_classic_judge(classic, HADA_CLASSIC_REST, 0.0, 1, err);
    if (!status)
        status = hada_classic_fused_columns(classic, 1, err);
    if (!status)
        status = hada_classic_fused_momentum(classic, beta, err);
    return !status && wanted ? hada_classic_sums(classic, hada_classic_tasks(classic), 2, sums, err) : status;
}

hada_status hada_classic_fista_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err)
{
    const hada_prior prior = classic->shape.options.prior;
    const hada_classic_part from = prior == HADA_PRIOR_NONE ? HADA_CLASSIC_GRADIENT
                                   : prior == HADA_PRIOR_TV ? HADA_CLASSIC_SMOOTH
                                                            : HADA_CLASSIC_PYRAMID;
    const double beta = advance(&classic->momentum);
    if (classic->fuses && prior == HADA_PRIOR_NONE)
        return whole_step(classic, beta, wanted, sums, err);
    (void)number;
    hada_status status = gradient(classic, err);
    if (!status && prior != HADA_PRIOR_NONE)
        status = descend(classic, err);
    if (!status && prior == HADA_PRIOR_TV)
        status = total_variation(classic, err);
    else if (!status && prior != HADA_PRIOR_NONE)
        status = wavelets(classic, err);
    if (!status)
        status = momentum(classic, from, prior == HADA_PRIOR_NONE, beta, err);
    return !status && wanted ? hada_classic_sums(classic, hada_classic_slices(classic), 2, sums, err) : status;
}
