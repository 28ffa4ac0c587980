#include "fft/fft_fused.h"

#include "fft/fft_internal.h"

int hada_fft_fuses(const hada_context *context, int rows, int cols, int blocks)
{
    int points, odd;
    size_t ints, floats;
    hada_fft_pass_sizes(rows, 1, &points, &odd, &ints, &floats);
    const uint64_t bytes = (uint64_t)blocks * hada_own_pass_local(context, rows, 1);
    return context->shape != HADA_SHAPE_GROUPS && hada_fft_choose(context, rows, cols) == HADA_FFT_OWN &&
           points == rows && !odd && hada_own_pass_local(context, cols, 0) && bytes && bytes <= HADA_OWN_LOCAL_BYTES &&
           bytes <= context->info.local_memory_bytes;
}

hada_status hada_fft_fused_make(hada_fft_fused *fused, hada_slot *slot, int rows, int cols, hada_error *err)
{
    const hada_fft_pass_desc forward = {.kind = HADA_PASS_ROWS, .n = cols},
                             back = {.kind = HADA_PASS_ROWS_INVERSE, .n = cols, .inverse = 1},
                             columns = {.kind = HADA_PASS_COLUMNS, .n = rows};
    hada_status status = hada_own_pass_make(&fused->rows, slot, &forward, err);
    if (!status)
        status = hada_own_pass_make(&fused->rows_back, slot, &back, err);
    return status ? status : hada_own_pass_make(&fused->columns, slot, &columns, err);
}

void hada_fft_fused_free(hada_fft_fused *fused)
{
    hada_own_pass_free(&fused->rows);
    hada_own_pass_free(&fused->rows_back);
    hada_own_pass_free(&fused->columns);
}

size_t hada_fft_fused_bytes(const hada_context *context, int rows, int cols)
{
    return 2 * hada_own_pass_bytes(context, cols, 0) + hada_own_pass_bytes(context, rows, 1);
}
