/* An iteration of ADMM: splits of planes, gradients and data, then the joint least-squares step. */
#include <math.h>

#include "classic/classic_steps.h"

/* The numbers of the run: TV's weight is in units of the image's own brightness (docs/rivals.md). */
static double weight(const hada_classic *classic)
{
    return classic->shape.options.weight * sqrt(classic->job->camera->gain) * classic->job->brightness;
}

static int has_tv(const hada_classic *classic)
{
    return classic->bytes[HADA_CLASSIC_DUAL] != 0;
}

/* Of the data: 1 where nothing crops it, since it needs no split. */
static double mu1(const hada_classic *classic)
{
    return classic->bytes[HADA_CLASSIC_SPLIT] ? classic->shape.options.mu1 : 1.0;
}

static double mu2(const hada_classic *classic)
{
    return has_tv(classic) ? classic->shape.options.mu2 * mu1(classic) * classic->job->camera->gain : 0.0;
}

static double mu3(const hada_classic *classic)
{
    return classic->shape.options.mu3 * mu1(classic) * classic->job->camera->gain;
}

hada_status hada_classic_admm_begin(hada_classic *classic, hada_error *err)
{
    hada_classic_wave(classic, !has_tv(classic));
    return hada_buffer_write(&classic->part[HADA_CLASSIC_TABLE], classic->slot, 0, classic->table,
                             classic->bytes[HADA_CLASSIC_TABLE], err);
}

static hada_status split(hada_classic *classic, hada_error *err)
{
    const hada_classic_image *image = &classic->plane;
    const hada_refine_rect *support = &classic->shape.support;
    const double all = (double)image->pixels * classic->planes;
    cl_mem unused = classic->part[HADA_CLASSIC_X].mem; /* without TV */
    cl_mem dual = has_tv(classic) ? classic->part[HADA_CLASSIC_DUAL].mem : unused;
    cl_mem next = has_tv(classic) ? classic->part[HADA_CLASSIC_DUAL2].mem : classic->part[HADA_CLASSIC_SHADOW].mem;
    cl_int rows = image->rows, cols = image->cols, pitch = image->pitch, band = image->band, tv = has_tv(classic);
    cl_int row0 = support->row0, col0 = support->col0, row1 = row0 + support->rows, col1 = col0 + support->cols;
    cl_float slopes = (float)mu2(classic), planes = (float)mu3(classic);
    cl_float theta = tv ? (float)(weight(classic) / mu2(classic)) : 0.0f;
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_X].mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_BEFORE].mem),
                       HADA_ARG(dual),
                       HADA_ARG(next),
                       HADA_ARG(classic->part[HADA_CLASSIC_SHADOW].mem),
                       HADA_ARG(rows),
                       HADA_ARG(cols),
                       HADA_ARG(pitch),
                       HADA_ARG(band),
                       HADA_ARG(row0),
                       HADA_ARG(col0),
                       HADA_ARG(row1),
                       HADA_ARG(col1),
                       HADA_ARG(tv),
                       HADA_ARG(slopes),
                       HADA_ARG(planes),
                       HADA_ARG(theta),
                       HADA_ARG(classic->part[HADA_CLASSIC_PARTIAL].mem)};
    hada_slot_cost(classic->slot, (tv ? 36.0 : 20.0) * all, (tv ? 40.0 : 12.0) * all);
    hada_status status = hada_classic_rows(classic, "classic_split", "classic_split", args, HADA_COUNT(args), err);
    if (tv)
        hada_classic_swap(classic, HADA_CLASSIC_DUAL, HADA_CLASSIC_DUAL2);
    return status;
}

hada_status hada_classic_admm_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err)
{
    const int cropped = classic->bytes[HADA_CLASSIC_SPLIT] != 0;
    hada_status status = split(classic, err);
    if (!status && wanted && number)
        status = hada_classic_sums(classic, hada_classic_bands(classic), 2, sums, err);
    if (!status && cropped && number) /* at first SUM is 0, and so is what it makes of the frame */
        status = hada_classic_frame_inverse(classic, err);
    if (!status && cropped)
        status = hada_classic_meet(classic, HADA_CLASSIC_ADMM, 1.0 / (1.0 + mu1(classic)), err);
    if (!status && cropped)
        status = hada_classic_frame_forward(classic, HADA_CLASSIC_SPLIT, err);
    if (!status && number)
        status = hada_classic_forward(classic, HADA_CLASSIC_BEFORE, err);
    if (!status)
        status = hada_classic_solve(classic, number == 0, mu1(classic), mu2(classic), mu3(classic), err);
    if (!status)
        status = hada_classic_inverse(classic, HADA_CLASSIC_BEFORE, err);
    hada_classic_swap(classic, HADA_CLASSIC_X, HADA_CLASSIC_BEFORE);
    return status;
}
