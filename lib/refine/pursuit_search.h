/* The pursuit's parts. Internal to lib/refine. */
#ifndef HADA_REFINE_PURSUIT_SEARCH_H
#define HADA_REFINE_PURSUIT_SEARCH_H

#include "refine/pursuit.h"
#include "refine/state.h"

struct hada_pursuit {
    hada_slot *slot;
    hada_pursuit_options options; /* zeros replaced */
    hada_spectrum_layout full;
    hada_refine_shape shape; /* coarse, one channel */
    hada_spectrum_layout coarse;
    hada_refiner *refiner;
    hada_fft *frame_inverse; /* padded: the coarse frame from its spectrum */
    hada_buffer otf, prior, doubt, spectrum, frame;
    int has_prior, has_doubt;
    cl_kernel crop;
    hada_refine_state now, next, best; /* of the chosen set, of the one looked at, of the best variation of it */
};

/* Searches the coarse frame that lies in `spectrum` (and `frame`). */
hada_status hada_pursuit_search(hada_pursuit *pursuit, hada_pursuit_result *result, hada_error *err);

#endif
