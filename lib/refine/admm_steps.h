/* A refiner, and what a step of it is made of: kernels and transforms, each one call. Internal to lib/refine. */
#ifndef HADA_REFINE_ADMM_STEPS_H
#define HADA_REFINE_ADMM_STEPS_H

#include "fft/fft_fused.h"
#include "launch/refine.h"
#include "refine/admm.h"
#include "refine/proximal.h"

enum {
    HADA_REFINE_BATCH = 48,  /* images that one transform call takes */
    HADA_REFINE_PAD = 512,   /* floats: work-group of the proximal step times its vector */
    HADA_REFINE_PLACE = 64,  /* pixels of a place where something may have moved */
    HADA_REFINE_SLICE = 2048 /* frequencies or pixels of one work-group: fixes the order of sums on every device */
};

/* Sums on their way to the host: of what the planes of so many sets leave, in the first place, and in the second of
 * what the joint linear filter left, where a run told that. */
typedef struct hada_refine_arriving {
    int sets;
    size_t slices, linear_slices; /* of an image; 0: there is none */
    double factor;
} hada_refine_arriving;

/* What is kept of a run for the next frame: the depths of the planes (0: nothing), rho, and copies, those of the split
 * at the frame for mu = 1. */
typedef struct hada_refine_past {
    int depths, *list;
    double rho; /* of its last step */
    hada_buffer planes, now_w, dual, tv;
} hada_refine_past;

struct hada_refiner {
    hada_slot *slot;
    hada_refine_shape shape;
    hada_spectrum_layout layout;
    hada_fft_pair fft, frame_fft;              /* planes of the window; padded: of the frame */
    hada_fft_fused fused;                      /* empty where steps cannot be fused: see the end */
    hada_buffer now_u, now_w, planes, partial; /* U and W, padded: and behind them E and A */
    hada_buffer shown;                         /* what results have of the planes; empty: all */
    hada_buffer list;                          /* the depths of the sets, and behind them the table of fused columns */
    int table;                                 /* where that begins, in numbers; 0: steps cannot be fused */
    hada_buffer kept;                          /* settle: planes of a step before, behind them those set aside */
    hada_buffer dual;                          /* padded: that of the split at the frame */
    hada_buffer residual, residual_frame;      /* padded: what the planes do not explain */
    size_t partials;                           /* partial sums of one step, at most */
    size_t cells;                              /* where cells begin behind these, by which a motion is found */
    float *host_partial;
    int *host_list;              /* what stands in `list`, host_count depths */
    int host_count, list_busy;   /* 1: `list` may still be read from there */
    double *energy;              /* [step][set] */
    hada_buffer tv[2];           /* total variation: its duals, and where the next ones go */
    hada_program_refine program; /* in the shape that fits the device and the layout */
    hada_variation variation;
    hada_ridge ridge;
    hada_crosstalk crosstalk;
    size_t group; /* work-items of a group in the kernels with sums */
    size_t window_area, frame_area;
    size_t split; /* where E and A begin, in complex numbers */
    size_t transforms;
    hada_refine_arriving arriving;
    hada_refine_past past;
    double mu;       /* of the last run, which runs that continue it keep */
    double last_rho; /* of its last step */
    double last_tv;  /* of the last run's rule */
    int half_there;  /* 1: now_u holds the planes' spectra along rows */
};

/* One run's constants. */
typedef struct hada_refine_run {
    hada_refiner *refiner;
    const hada_refine_data *data;
    int sets, depths;
    int padded;
    int fused; /* 1: steps are */
} hada_refine_run;

/* Chooses the programs and makes them. */
hada_status hada_refine_prepare(hada_refiner *refiner, hada_error *err);

/* The rho of a step. */
double hada_refine_rho_at(const hada_refine_rule *rule, int step);

/* Sums over slices go to the place `place`, one for each step. */
hada_refine_sums hada_refine_sums_at(const hada_refine_run *run, int place);

/* What is refined; sums go to `place`. */
hada_refine_problem hada_refine_problem_of(const hada_refine_run *run, int place);

/* What a linear step is told, by its number. Its sums go to `place`. */
hada_refine_step hada_refine_step_of(const hada_refine_run *run, const hada_refine_rule *rule, int start, int step,
                                     int place);

/* The linear step number `step`. Its sums of |residual|^2 go to `place`, of which there is one for each step and one
 * more. */
hada_status hada_refine_solve(const hada_refine_run *run, const hada_refine_rule *rule, int start, int step, int place,
                              hada_error *err);

/* Sums of |residual|^2 of the planes, to the first place; with the residual itself where `has_residual`. */
hada_status hada_refine_explain(const hada_refine_run *run, int has_residual, hada_error *err);

/* The data's split where a sensor crops: dual = (dual - frame) w / (w + mu) with each pixel's weight w, or without the
 * frame the same of a residual; sums of |dual|^2 to `place`. */
hada_status hada_refine_frame_dual(const hada_refine_run *run, cl_mem dual, int use_frame, double mu, int place,
                                   hada_error *err);

/* Looks at the planes that are read together, at most. A device that shares the host's memory is waited for at little
 * cost; another idles meanwhile. */
static inline size_t hada_refine_looks(const hada_context *context)
{
    return context->info.unified_memory ? 1 : 2;
}

/* before = before - planes, with its energies in each place of HADA_REFINE_PLACE pixels, [depth][channel][place]. */
hada_status hada_refine_since(const hada_refine_run *run, cl_mem before, hada_error *err);

/* Planes to their spectra U and from W; padded: the frame's dual to its spectrum E, and from a spectrum, from number
 * `at` on, to the frame.
 */
hada_status hada_refine_planes_forward(const hada_refine_run *run, hada_error *err);
hada_status hada_refine_planes_inverse(const hada_refine_run *run, hada_error *err);
hada_status hada_refine_frame_forward(const hada_refine_run *run, hada_error *err);
hada_status hada_refine_frame_inverse(const hada_refine_run *run, const hada_buffer *spectrum, size_t at,
                                      const hada_buffer *frame, hada_error *err);

/* Slices of so many frequencies or pixels. */
static inline size_t hada_refine_slices(size_t count)
{
    return hada_divide_up(count, HADA_REFINE_SLICE);
}

/* Adds the sums of the first place up, those of `parts` images a set, in order and in double. */
hada_status hada_refine_energies(const hada_refine_run *run, int parts, size_t slices, double factor, double *energy,
                                 hada_error *err);

/* Parseval: from energies of spectra to energies of images. */
static inline double hada_refine_per_pixel(const hada_refiner *refiner)
{
    return 1.0 / ((double)refiner->layout.rows * refiner->layout.cols);
}

/* A step of the refinement in two launches: along columns both transforms with the linear step between them, along rows
 * both with the proximal step between them (kernels/refine_columns.cl, refine_rows.cl; by work-groups
 * refine_group_columns.cl, refine_group_rows.cl, or where the last stage is of radix 43 refine_odd_columns.cl,
 * refine_odd_rows.cl). Spectra of planes are never stored; between the launches half spectra of rows are in the place
 * of U. Where a sensor crops, half spectra of the frame's rows are in the place of E; lanes take a third launch for
 * them (refine_frame_rows.cl). Internal to lib/refine. */

/* Makes the list of depths, and the tables where a grid's transforms can be fused at all. */
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

/* Whether hada_refiner_score() takes half spectra of rows as well, and its work then: only by work-groups. `slices`
 * sums of each set go to the first place. */
int hada_refine_fused_scores(const hada_refiner *refiner, int depths);
hada_status hada_refine_fused_score(const hada_refine_run *run, const hada_refine_band *band, size_t *slices,
                                    hada_error *err);

/* A pass along the rows of the planes and of the frame, with the steps of hada_refine_pass; frame 0: no frame. On the
 * frame's pixels the data's step is done, with the weight mu. Its sums go to `place`, [set][channel][slice], so many
 * slices of an image. */
hada_status hada_refine_fused_rows(const hada_refine_run *run, int planes, int frame, double mu, int place,
                                   hada_error *err);
size_t hada_refine_fused_frame_slices(const hada_context *context, const hada_refine_shape *shape);

#endif
