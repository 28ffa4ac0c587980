#include "fft/fft_cost.h"

#include <math.h>

typedef struct cost {
    double bytes, flops;
} cost;

static double points(double n)
{
    return n > 1 ? 5.0 * n * log2(n) : 0.0;
}

static double columns_of(const hada_fft_desc *desc)
{
    return (desc->direction == HADA_FFT_INVERSE ? desc->band_cols : desc->cols / 2) + 1.0;
}

static double rows_of(const hada_fft_desc *desc)
{
    const int within = 2 * desc->band_rows + 1;
    return desc->direction == HADA_FFT_INVERSE && within < desc->rows ? within : desc->rows;
}

/* Bytes of the half spectra between the passes. */
static double between(const hada_fft_desc *desc, int images)
{
    return 8.0 * images * desc->real_rows * columns_of(desc);
}

static cost cost_rows(const hada_fft_desc *desc, int images)
{
    const double rows = (double)images * desc->real_rows;
    return (cost){4.0 * rows * desc->real_cols + between(desc, images), 0.5 * rows * points(desc->cols)};
}

static cost cost_columns(const hada_fft_desc *desc, int images, const hada_fft_filter *filter)
{
    const double image = columns_of(desc) * rows_of(desc);
    const int spectra = filter && filter->spectrum_count < images ? filter->spectrum_count : images;
    cost c = {8.0 * spectra * image + between(desc, images), images * columns_of(desc) * points(desc->rows)};
    if (filter) {
        c.bytes += (filter->half ? 4.0 : 8.0) * images * image;
        c.flops += (filter->product == HADA_FFT_SPLIT ? 2.0 : 6.0) * images * image;
    }
    return c;
}

void hada_fft_cost_rows(hada_slot *slot, const hada_fft_desc *desc, int images)
{
    const cost c = cost_rows(desc, images);
    hada_slot_cost(slot, c.bytes, c.flops);
}

void hada_fft_cost_columns(hada_slot *slot, const hada_fft_desc *desc, int images, const hada_fft_filter *filter)
{
    const cost c = cost_columns(desc, images, filter);
    hada_slot_cost(slot, c.bytes, c.flops);
}

void hada_fft_cost_image(hada_slot *slot, const hada_fft_desc *desc, int images, const hada_fft_filter *filter)
{
    const cost rows = cost_rows(desc, images), columns = cost_columns(desc, images, filter);
    hada_slot_cost(slot, rows.bytes + columns.bytes - 2.0 * between(desc, images), rows.flops + columns.flops);
}
