/* Room for results. Internal. */
#ifndef HADA_ENGINE_RESULT_H
#define HADA_ENGINE_RESULT_H

#include <hadalens/opencl.h>

#include "core/error.h"

/* What a result holds besides its public members, which point here. */
typedef struct hada_result_memory {
    hada_report report;
    hada_skip_report skipped;
    unsigned char *occupied;
    float *stack;                          /* of all planes; NULL where the caller has an array for it */
    hada_image all_in_focus, distance_map; /* empty where the caller has arrays for them */
    hada_image confidence;                 /* empty until a frame is a surface */
    int has_confidence;                    /* of the frame in hand */
    hada_result_arrays arrays;             /* the caller's, on the host and on the device */
    hada_cl_arrays device;
} hada_result_memory;

/* Whether it is written into buffers on the device as well. */
int hada_result_on_device(const hada_result *result);

/* Makes the result fit a model and a number of depths; images that fit already are kept. Empty on failure. */
hada_status hada_result_fit(hada_result *result, const hada_model_info *info, int depths, hada_error *err);

/* An empty report, to be filled. */
hada_report *hada_result_renew(hada_result *result);

/* Room for the confidence of the frame in hand; hada_result_renew() takes it away. */
hada_status hada_result_make_confidence(hada_result *result, hada_error *err);

/* Empties a result; arrays of the caller's stay in use. */
void hada_result_clear(hada_result *result);

/* Makes `to` a copy of `from`, which is of the model, report included. Empty on failure. */
hada_status hada_result_copy(hada_result *to, const hada_result *from, const hada_model_info *info, hada_error *err);

/* The exponent on planes and all-in-focus image. */
void hada_result_apply_gamma(hada_result *result, double gamma);

#endif
