/* Depth pursuit: which depths a frame contains, found by explaining it with as few of them as possible. Internal.
 *
 * Starts with no depth; adds the depth whose joint refinement of a few steps leaves least unexplained; moves depths to
 * neighbours while that helps, drops those that the others explain as well; stops when an addition lowers what is left
 * by less than the part `threshold`. Scenes that need more than max_depths depths are said to fill all of them, so that
 * a slanted or continuous scene costs no more; most of them are known as such at the first pair, before any set is
 * moved.
 *
 * Residuals are evaluated on three grids: a very small one puts the candidates in order, a small one decides, both with
 * the channels averaged; where that decision is close, the sets in question are refined on a finer grid, channel by
 * channel. The reference search (`full`) does all of it on the whole grid, every channel and every candidate: the cheap
 * one is to decide as it does. For that both weigh the same evidence: what the channels have in common, at the
 * frequencies of the small grid. docs/explanation/refinement.md has the reasons and the figures.
 *
 * A pursuit belongs to one slot. Same input, same bits. */
#ifndef HADA_REFINE_PURSUIT_H
#define HADA_REFINE_PURSUIT_H

#include "refine/admm.h"

enum {
    HADA_PURSUIT_LEVELS = 3,  /* grids that residuals are evaluated on, at most */
    HADA_PURSUIT_MAX = 8,     /* most depths of a set */
    HADA_PURSUIT_DEPTHS = 256 /* most depths of a camera */
};

typedef struct hada_pursuit_options {
    hada_refine_shape shape; /* of the whole grid; its max_... are not used */
    int depths;              /* of the camera */
    double shrink;           /* grid over the small grid, > 1; 0: 2, more where the grid is large */
    double rho;              /* of the refinement, in units of |OTF|^2: 1e-2 of the largest |OTF(0)|^2 */
    double threshold;        /* smallest reduction of the residual that counts; 0: from the window's share */
    int full;                /* 1: the reference search, for comparison: many times dearer in time and memory */
    int max_depths;          /* a scene that needs more fills all depths; 0: 4, or all of up to 6 */
} hada_pursuit_options;

void hada_pursuit_options_init(hada_pursuit_options *options);

typedef struct hada_pursuit_result {
    int count;                              /* of occupied depths; 0: nothing in the frame */
    int list[HADA_PURSUIT_MAX];             /* ascending, meaningless where `all` is set */
    int all;                                /* 1: the scene fills too many depths to tell them apart: take all */
    int rounds;                             /* additions tried, the last one usually in vain */
    double reduction[2 * HADA_PURSUIT_MAX]; /* part of the residual that each addition explained */
    double more;                            /* the last of these, where it was in vain; else 0 */
    int hides;                              /* 1: depths may hide beside those found: hada_pursuit_part() tells */
    double residual;                        /* |unexplained| / |frame|, of the small images */
    int fine_comparisons;                   /* those that took the finer grid */
    size_t transforms;
    double seconds;
} hada_pursuit_result;

typedef struct hada_pursuit hada_pursuit;

/* Its grids are worked on one after the other: each takes one of the HADA_PURSUIT_LEVELS steps of the slot's scratch
 * from the first one on. */
hada_status hada_pursuit_create(hada_pursuit **out, hada_slot *slot, const hada_pursuit_options *options,
                                hada_error *err);
void hada_pursuit_destroy(hada_pursuit **pursuit);

/* The camera, all before the first run: OTFs of all depths ([depth][channel][count] complex), `offset` complex numbers
 * into the buffer; the prior of refinement ([channel][count] floats); and, where the OTFs are estimates, sum |X|^2 of
 * the pairs of each depth ([channel][count] floats), which says how good they are. The buffers are not needed
 * afterwards. */
hada_status hada_pursuit_set_otf(hada_pursuit *pursuit, cl_mem otf, size_t offset, hada_error *err);
hada_status hada_pursuit_set_prior(hada_pursuit *pursuit, cl_mem prior, hada_error *err);
hada_status hada_pursuit_set_power(hada_pursuit *pursuit, int depth, cl_mem power, hada_error *err);

/* Searches a frame: its spectrum, [channel][count] complex, dark level removed; `scale` times it is in the units of the
 * pairs. On failure *result says nothing. */
hada_status hada_pursuit_run(hada_pursuit *pursuit, cl_mem spectrum, double scale, hada_pursuit_result *result,
                             hada_error *err);

/* Where the last run said that depths may hide: looks for those that few steps do not tell from their neighbours, which
 * takes longer than the run did. The spectrum is still there; *result is that of the run, and goes on. */
hada_status hada_pursuit_part(hada_pursuit *pursuit, hada_pursuit_result *result, hada_error *err);

#endif
