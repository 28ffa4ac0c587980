/* The library's own transforms, an image at a time: one launch takes a batch of small images through both passes, each
 * image in one work-item that keeps what lies between the passes in local memory. On CPUs that is the nearest caches,
 * and nothing is handed over from launch to launch. */
#include "fft/fft_image.h"

#include "runtime/kernel.h"

/* Shared out by whole images, units may idle in the last round: for a quarter of the time at most, which is what this
 * way gains. */
static int enough_images(const hada_context *context, int batch)
{
    const uint64_t units = context->info.compute_units ? context->info.compute_units : 1, images = (uint64_t)batch;
    const uint64_t rounds = (images + units - 1) / units;
    return 3 * rounds * units <= 4 * images;
}

size_t hada_own_image_bytes(const hada_context *context, const hada_fft_desc *desc, size_t between)
{
    const size_t rows = hada_own_pass_local(context, desc->cols, 0),
                 columns = hada_own_pass_local(context, desc->rows, 1);
    const uint64_t bytes = (rows > columns ? rows : columns) + (uint64_t)between * 2 * sizeof(float);
    if (context->shape == HADA_SHAPE_GROUPS || !rows || !columns || !enough_images(context, desc->batch))
        return 0;
    return bytes <= HADA_OWN_LOCAL_BYTES && bytes <= context->info.local_memory_bytes ? (size_t)bytes : 0;
}

static hada_status launch(hada_slot *slot, const char *file, const char *options, int images, const hada_arg *args,
                          size_t count, hada_error *err)
{
    const size_t global = (size_t)images, local = 1;
    cl_kernel kernel;
    const hada_status status = hada_slot_kernel(slot, file, file, options, &kernel, err);
    return status ? status : hada_slot_launch(slot, kernel, file, 1, &global, &local, args, count, err);
}

hada_status hada_own_image_forward(const hada_own_image *image, hada_slot *slot, const hada_fft_desc *desc,
                                   const hada_own_io *io, hada_error *err)
{
    const cl_ulong in_offset = io->in_offset, in_distance = desc->real_distance, in_pitch = desc->real_pitch,
                   out_offset = io->out_offset, out_distance = io->spectrum_distance;
    const cl_int col0 = desc->col0, cols_in = desc->real_cols, rows_in = desc->real_rows, row0 = desc->row0,
                 blocks = desc->band_cols / HADA_OWN_BLOCK + 1, images = io->images;
    const hada_arg args[] = {HADA_ARG(io->in),
                             HADA_ARG(in_offset),
                             HADA_ARG(in_distance),
                             HADA_ARG(in_pitch),
                             HADA_ARG(col0),
                             HADA_ARG(cols_in),
                             HADA_ARG(rows_in),
                             HADA_ARG(io->out),
                             HADA_ARG(out_offset),
                             HADA_ARG(out_distance),
                             HADA_ARG(row0),
                             HADA_ARG(blocks),
                             HADA_ARG(images),
                             HADA_ARG(image->rows->ints.mem),
                             HADA_ARG(image->rows->floats.mem),
                             HADA_ARG(image->columns->ints.mem),
                             HADA_ARG(image->columns->floats.mem),
                             HADA_ARG_LOCAL(image->local_bytes)};
    return launch(slot, "fft_image_forward", "", images, args, HADA_COUNT(args), err);
}

hada_status hada_own_image_inverse(const hada_own_image *image, hada_slot *slot, const hada_fft_desc *desc,
                                   const hada_own_io *io, hada_error *err)
{
    const cl_ulong in_offset = io->in_offset, in_distance = io->spectrum_distance, filter_offset = io->filter_offset,
                   filter_distance = io->spectrum_distance * (size_t)io->stride, out_offset = io->out_offset,
                   out_distance = desc->real_distance * (size_t)io->stride, out_pitch = desc->real_pitch;
    const cl_int in_count = io->in_count, row0 = desc->row0, rows_out = desc->real_rows, band_rows = io->band_rows,
                 band = io->band_cols, col0 = desc->col0, cols_out = desc->real_cols, images = io->images;
    const cl_float scale = hada_own_scale(desc);
    const hada_arg args[] = {HADA_ARG(io->in),
                             HADA_ARG(in_offset),
                             HADA_ARG(in_distance),
                             HADA_ARG(in_count),
                             HADA_ARG(io->filter),
                             HADA_ARG(filter_offset),
                             HADA_ARG(filter_distance),
                             HADA_ARG(row0),
                             HADA_ARG(rows_out),
                             HADA_ARG(band_rows),
                             HADA_ARG(band),
                             HADA_ARG(io->out),
                             HADA_ARG(out_offset),
                             HADA_ARG(out_distance),
                             HADA_ARG(out_pitch),
                             HADA_ARG(col0),
                             HADA_ARG(cols_out),
                             HADA_ARG(scale),
                             HADA_ARG(images),
                             HADA_ARG(image->rows->ints.mem),
                             HADA_ARG(image->rows->floats.mem),
                             HADA_ARG(image->columns->ints.mem),
                             HADA_ARG(image->columns->floats.mem),
                             HADA_ARG_LOCAL(image->local_bytes)};
    return launch(slot, "fft_image_inverse", io->options, images, args, HADA_COUNT(args), err);
}
