#include "model/half_filter.h"

#include <math.h>

#include "io/safetensors.h"

hada_status hada_filter_to_half(const float *filter, size_t values, uint16_t *half, hada_error *err)
{
    double size = 0.0, lost = 0.0;
    for (size_t i = 0; i < values; i++) {
        half[i] = hada_half_from_float(filter[i]);
        if ((half[i] & 0x7c00u) == 0x7c00u)
            return hada_fail(
                err, HADA_ERROR_NUMERIC,
                "a filter value of %g does not fit into half precision (65504 at most); keep this model in "
                "single precision",
                (double)filter[i]);
        const double off = (double)filter[i] - hada_float_from_half(half[i]);
        size += (double)filter[i] * filter[i];
        lost += off * off;
    }
    if (lost > 0x1p-22 * size)
        return hada_fail(
            err, HADA_ERROR_NUMERIC,
            "the filters are too small for half precision (%.2g of them would be lost, %.2g is usual): keep "
            "this model in single precision, or fit it again with raw frames divided by their full scale",
            sqrt(lost / size), 0x1p-12);
    return HADA_OK;
}
