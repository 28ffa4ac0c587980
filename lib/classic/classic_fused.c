/* An iteration in fused passes: along columns both transforms with the product between them, along rows both with the
 * step on the pixels between them (kernels/classic_columns.cl, classic_rows.cl). Whole spectra stand nowhere. */
#include <math.h>

#include "classic/classic_steps.h"
#include "runtime/kernel.h"

/* The usual count of a transform of n points, in operations. */
static double transform(double n)
{
    return 5.0 * n * log2(n > 2.0 ? n : 2.0);
}

static hada_status launch(hada_classic *classic, const char *name, size_t tasks, const hada_arg *args, size_t count,
                          hada_error *err)
{
    const size_t local = 1;
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(classic->slot, name, name, "", &kernel, err);
    return status ? status : hada_slot_launch(classic->slot, kernel, name, 1, &tasks, &local, args, count, err);
}

hada_status hada_classic_fused_columns(hada_classic *classic, int back, hada_error *err)
{
    const hada_refine_data *data = classic->job->data;
    const hada_spectrum_layout *layout = &classic->layout;
    const hada_own_pass *pass = &classic->fused.columns;
    const hada_refine_rect plane = hada_classic_plane_rect(&classic->shape);
    const hada_refine_rect frame = hada_classic_frame_rect(&classic->shape);
    const size_t scratch = pass->local_bytes * (classic->job->depths > 1 ? 2 : 1);
    cl_ulong otf_offset = data->otf_offset;
    cl_int depths = classic->job->depths, channels = classic->shape.place.channels, blocks = layout->blocks;
    cl_int to_planes = back, plane_row0 = plane.row0, plane_rows = plane.rows, frame_row0 = frame.row0,
           frame_rows = frame.rows;
    hada_arg args[] = {HADA_ARG(classic->part[HADA_CLASSIC_SPECTRA].mem),
                       HADA_ARG(plane_row0),
                       HADA_ARG(plane_rows),
                       HADA_ARG(classic->part[HADA_CLASSIC_SUM].mem),
                       HADA_ARG(frame_row0),
                       HADA_ARG(frame_rows),
                       HADA_ARG(data->otf),
                       HADA_ARG(otf_offset),
                       HADA_ARG(classic->part[HADA_CLASSIC_LIST].mem),
                       HADA_ARG(depths),
                       HADA_ARG(channels),
                       HADA_ARG(blocks),
                       HADA_ARG(to_planes),
                       HADA_ARG(pass->ints.mem),
                       HADA_ARG(pass->floats.mem),
                       HADA_ARG_LOCAL(scratch)};
    const double columns = (layout->cols / 2 + 1.0) * channels, rows = layout->rows;
    hada_slot_cost(classic->slot, 8.0 * columns * (depths * (rows + plane_rows) + frame_rows),
                   columns * ((depths + 1.0) * transform(rows) + 8.0 * depths * rows));
    return launch(classic, "classic_columns", (size_t)(blocks * channels), args, HADA_COUNT(args), err);
}

typedef struct rows_job {
    hada_classic_part spectra, images, first, work;
    const hada_classic_image *image;
    hada_refine_rect rect;
    int count, inverse, forward, step;
    double number, traffic; /* bytes of a pixel */
} rows_job;

static hada_status run_rows(hada_classic *classic, const rows_job *job, hada_error *err)
{
    const hada_spectrum_layout *layout = &classic->layout;
    const hada_fft_fused *fused = &classic->fused;
    const size_t tasks = (size_t)job->count * (((size_t)job->image->rows + HADA_CLASSIC_ROWS - 1) / HADA_CLASSIC_ROWS);
    cl_int blocks = layout->blocks, inverse = job->inverse, forward = job->forward, step = job->step;
    cl_int channels = classic->shape.place.channels, rows = job->image->rows, pitch = job->image->pitch;
    cl_int col0 = job->rect.col0, cols = job->rect.cols;
    cl_float number = (float)job->number, scale = (float)(1.0 / ((double)layout->rows * layout->cols));
    cl_mem alpha = classic->part[classic->bytes[HADA_CLASSIC_TABLE] ? HADA_CLASSIC_TABLE : HADA_CLASSIC_PARTIAL].mem;
    hada_arg args[] = {HADA_ARG(classic->part[job->spectra].mem),
                       HADA_ARG(blocks),
                       HADA_ARG(inverse),
                       HADA_ARG(forward),
                       HADA_ARG(classic->part[job->images].mem),
                       HADA_ARG(classic->part[job->first].mem),
                       HADA_ARG(classic->part[job->work].mem),
                       HADA_ARG(step),
                       HADA_ARG(number),
                       HADA_ARG(alpha),
                       HADA_ARG(channels),
                       HADA_ARG(rows),
                       HADA_ARG(pitch),
                       HADA_ARG(col0),
                       HADA_ARG(cols),
                       HADA_ARG(scale),
                       HADA_ARG(fused->rows_back.ints.mem),
                       HADA_ARG(fused->rows_back.floats.mem),
                       HADA_ARG(fused->rows.ints.mem),
                       HADA_ARG(fused->rows.floats.mem),
                       HADA_ARG(classic->part[HADA_CLASSIC_PARTIAL].mem),
                       HADA_ARG_LOCAL(fused->rows.local_bytes)};
    const double all = (double)job->count * rows, times = inverse + forward;
    hada_slot_cost(classic->slot, all * (8.0 * times * (layout->cols / 2 + 1.0) + job->traffic * cols),
                   all * (0.5 * times * transform(layout->cols) + (step ? 8.0 : 0.0) * cols));
    return launch(classic, "classic_rows", tasks, args, HADA_COUNT(args), err);
}

hada_status hada_classic_fused_frame(hada_classic *classic, int inverse, int forward, int step, double number,
                                     hada_error *err)
{
    const rows_job job = {.spectra = HADA_CLASSIC_SUM,
                          .images = HADA_CLASSIC_MADE,
                          .first = HADA_CLASSIC_SEEN,
                          .work = HADA_CLASSIC_MADE,
                          .image = &classic->frame,
                          .rect = hada_classic_frame_rect(&classic->shape),
                          .count = classic->shape.place.channels,
                          .inverse = inverse,
                          .forward = forward,
                          .step = step,
                          .number = number,
                          .traffic = step ? 8.0 : 4.0};
    return run_rows(classic, &job, err);
}

static rows_job of_planes(const hada_classic *classic, hada_classic_part planes)
{
    return (rows_job){.spectra = HADA_CLASSIC_SPECTRA,
                      .images = planes,
                      .first = planes,
                      .work = planes,
                      .image = &classic->plane,
                      .rect = hada_classic_plane_rect(&classic->shape),
                      .count = classic->planes,
                      .traffic = 4.0};
}

hada_status hada_classic_fused_planes(hada_classic *classic, hada_classic_part planes, int forward, hada_error *err)
{
    rows_job job = of_planes(classic, planes);
    job.forward = forward;
    job.inverse = !forward;
    return run_rows(classic, &job, err);
}

hada_status hada_classic_fused_momentum(hada_classic *classic, double beta, hada_error *err)
{
    rows_job job = of_planes(classic, HADA_CLASSIC_START);
    job.first = HADA_CLASSIC_X;
    job.work = HADA_CLASSIC_GRADIENT;
    job.inverse = job.forward = 1;
    job.step = 4;
    job.number = beta;
    job.traffic = 16.0;
    return run_rows(classic, &job, err);
}
