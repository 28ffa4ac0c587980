/* What a model holds. Internal. */
#ifndef HADA_FILTER_MODEL_H
#define HADA_FILTER_MODEL_H

#include <hadalens/model.h>

/* Filters and transfer functions stand on the host as row-major half spectra: complex numbers
 * [depth][channel][grid_rows][grid_cols / 2 + 1], re and im interleaved. One of `filter` and `filter_half` is NULL. */
struct hada_model {
    hada_model_info info;
    double *distances;
    char *name;
    float *filter;
    uint16_t *filter_half;
    float *otf;   /* NULL where has_otf is 0 */
    void *mapped; /* non-NULL: the arrays stand in this opened file (hada_tensors) and are not freed one by one */
};

/* Number of complex values of one depth and channel. */
size_t hada_model_plane(const hada_model *model);

/* A model with room for everything its info says, zeroed; distances are copied. */
hada_status hada_model_create(hada_model **out, const hada_model_info *info, hada_error *err);

#endif
