/* A step of the refinement in two launches: along columns both transforms with the linear step between them, along rows
 * both with the proximal step between them (kernels/refine_columns.cl, refine_rows.cl; by work-groups
 * refine_group_columns.cl, refine_group_rows.cl, or where the last stage is of radix 43 refine_odd_columns.cl,
 * refine_odd_rows.cl). Spectra of planes stand nowhere; what stands between the launches are
 * half spectra of rows, in the place of U. A cropped frame goes along, half spectra of its rows in the place of E;
 * lanes take a third launch for these (refine_frame_rows.cl). Internal to lib/refine. */
#ifndef HADA_REFINE_ADMM_FUSED_H
#define HADA_REFINE_ADMM_FUSED_H

#include "refine/admm_steps.h"

/* Whether a grid's transforms can be fused at all; and making the tables, which does nothing where they cannot. */
int hada_refine_fused_grid(const hada_context *context, const hada_refine_shape *shape);
hada_status hada_refine_fused_make(hada_refiner *refiner, hada_error *err);

/* Whether the sets of a run can be: a block of columns of each depth, or a part of one, fits in local memory. */
int hada_refine_fused_takes(const hada_refiner *refiner, int depths);

/* Sums of an image in a linear step, and the most for any number of depths. */
size_t hada_refine_fused_slices(const hada_refine_run *run);
int hada_refine_fused_most_slices(const hada_context *context, const hada_spectrum_layout *layout);

/* The linear step number `step`, from half spectra of rows to half spectra of rows. Its sums go to `place`,
 * [set][channel][slice]. */
hada_status hada_refine_fused_columns(const hada_refine_run *run, const hada_refine_rule *rule, int start, int step,
                                      int place, hada_error *err);

/* Whether hada_refiner_score() takes half spectra of rows as well, and what it is made of then: by work-groups alone.
 * `slices` sums of each set go to the first place. */
int hada_refine_fused_scores(const hada_refiner *refiner, int depths);
hada_status hada_refine_fused_score(const hada_refine_run *run, const hada_refine_band *band, size_t *slices,
                                    hada_error *err);

/* Along rows: half spectra to pixels, what is done to these, and their half spectra; any of the three. Of planes that
 * is their non-negative part where `clip` says so, of a cropped frame the data's step. */
typedef struct hada_refine_fused_part {
    int inverse, clip, forward;
} hada_refine_fused_part;

/* The pass along the rows of planes and, unless it is NULL, of the frame, its data's step with the weight mu. The
 * frame's sums go to `place`, [set][channel][slice], so many slices of an image. */
hada_status hada_refine_fused_rows(const hada_refine_run *run, const hada_refine_fused_part *planes,
                                   const hada_refine_fused_part *frame, double mu, int place, hada_error *err);
size_t hada_refine_fused_frame_slices(const hada_context *context, const hada_refine_shape *shape);

#endif
