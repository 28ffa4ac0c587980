/* The camera of the programs that time training: one depth in three colours, filters that pass a frame on. */
#ifndef HADA_PERF_TRAIN_MODEL_H
#define HADA_PERF_TRAIN_MODEL_H

#include "model/model.h"

/* Frames and window are squares. */
static inline hada_status perf_train_model(hada_model **out, int frame, int window, hada_error *err)
{
    static const double distance = 100.0;
    hada_model_info info = {.depths = 1,
                            .channels = 3,
                            .form = HADA_FORM_COMPLEX,
                            .boundary = HADA_BOUNDARY_CIRCULAR,
                            .distances_mm = &distance};
    hada_status status = hada_model_set_sizes(&info, frame, frame, window, window, err);
    if (!status)
        status = hada_model_create(out, &info, 0, err);
    for (size_t i = 0; !status && i < 6 * hada_model_plane(*out); i++)
        (*out)->filter[i] = i % 2 ? 0.0f : 1.0f;
    return status;
}

#endif
