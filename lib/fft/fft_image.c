/* The library's own transforms, an image at a time: one launch takes a batch of small images through both passes, each
 * image in one work-item that keeps what lies between the passes in local memory. On CPUs that is the nearest caches,
 * and nothing is handed over from launch to launch. */
#include "fft/fft_image.h"

#include "launch/fft_image_forward.h"
#include "launch/fft_image_inverse.h"

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

hada_status hada_own_image_forward(const hada_own_image *image, hada_slot *slot, cl_mem in, const hada_fft_real *real,
                                   cl_mem out, const hada_fft_spectra *spectra, hada_error *err)
{
    const hada_range range = hada_range_of((size_t)real->images, 1, 1, 1);
    const hada_local local_memory = {image->local_bytes};
    return hada_launch_fft_image_forward(slot, HADA_PROGRAM_FFT_IMAGE_FORWARD_DEFAULT, &range, err, .in = in,
                                         .real = *real, .out = out, .spectra = *spectra,
                                         .row_table = image->rows->table.ints,
                                         .column_table = image->columns->table.ints, .local_memory = local_memory);
}

hada_status hada_own_image_inverse(const hada_own_image *image, hada_slot *slot, cl_mem in,
                                   const hada_fft_columns_in *from, const hada_fft_filter *use, cl_mem out,
                                   const hada_fft_real *real, hada_error *err)
{
    const hada_range range = hada_range_of((size_t)real->images, 1, 1, 1);
    const hada_local local_memory = {image->local_bytes};
    return hada_launch_fft_image_inverse(
        slot, hada_find_fft_image_inverse(.fft_product = (int)use->product, .fft_half = use->half), &range, err,
        .in = in, .from = *from, .filter = use->filter, .out = out, .real = *real, .row_table = image->rows->table.ints,
        .column_table = image->columns->table.ints, .local_memory = local_memory);
}
