#include "fft/fft_cost.h"

#include <math.h>

typedef struct cost {
    double bytes, flops;
} cost;

static double points(double n)
{
    return n > 1 ? 5.0 * n * log2(n) : 0.0;
}

static double columns_of(const hada_fft_desc *desc, const hada_fft_filter *use)
{
    return (use ? use->band_cols : desc->band_cols) + 1.0;
}

/* Rows of the whole spectrum that are read or written. */
static double rows_of(const hada_fft_desc *desc, const hada_fft_filter *use)
{
    const int within = use ? 2 * use->band_rows + 1 : desc->rows;
    return within < desc->rows ? within : desc->rows;
}

/* Bytes of the half spectra between the passes. */
static double between(const hada_fft_desc *desc, int images, const hada_fft_filter *use)
{
    return 8.0 * images * desc->real_rows * columns_of(desc, use);
}

static cost cost_rows(const hada_fft_desc *desc, int images, const hada_fft_filter *use)
{
    const double rows = (double)images * desc->real_rows;
    return (cost){4.0 * rows * desc->real_cols + between(desc, images, use), 0.5 * rows * points(desc->cols)};
}

static cost cost_columns(const hada_fft_desc *desc, int images, const hada_fft_filter *use)
{
    const double image = columns_of(desc, use) * rows_of(desc, use);
    const int filtered = use && use->product != HADA_FFT_PLAIN;
    const int spectra = filtered && use->spectrum_count < images ? use->spectrum_count : images;
    cost c = {8.0 * spectra * image + between(desc, images, use), images * columns_of(desc, use) * points(desc->rows)};
    if (filtered) {
        c.bytes += (use->half ? 4.0 : 8.0) * images * image;
        c.flops += (use->product == HADA_FFT_SPLIT ? 2.0 : 6.0) * images * image;
    }
    return c;
}

void hada_fft_cost_rows(hada_slot *slot, const hada_fft_desc *desc, int images, const hada_fft_filter *use)
{
    const cost c = cost_rows(desc, images, use);
    hada_slot_cost(slot, c.bytes, c.flops);
}

void hada_fft_cost_columns(hada_slot *slot, const hada_fft_desc *desc, int images, const hada_fft_filter *use)
{
    const cost c = cost_columns(desc, images, use);
    hada_slot_cost(slot, c.bytes, c.flops);
}

void hada_fft_cost_image(hada_slot *slot, const hada_fft_desc *desc, int images, const hada_fft_filter *use)
{
    const cost rows = cost_rows(desc, images, use), columns = cost_columns(desc, images, use);
    hada_slot_cost(slot, rows.bytes + columns.bytes - 2.0 * between(desc, images, use), rows.flops + columns.flops);
}
