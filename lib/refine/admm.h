/* Refinement, and the rectangles of a grid that it works on. Internal. */
#ifndef HADA_REFINE_ADMM_H
#define HADA_REFINE_ADMM_H

#include <hadalens/model.h>

#include "fft/fft.h"
#include "kernels/shared_refine.h"

size_t hada_rect_area(const hada_rectangle *rect);

/* Whether it is not empty and lies within a grid of rows x cols. */
int hada_rect_inside(const hada_rectangle *rect, int rows, int cols);

/* The size of a coarser grid, `shrink` times smaller or a little more; 1: the size itself. */
int hada_rect_grid_size(int size, double shrink);

/* On a grid of small_rows x small_cols, the rectangle round (outward, wider by `margin` pixels on every side) or within
 * (narrower by it) one of a grid of rows x cols; it does not leave the small grid, but may be empty. */
hada_rectangle hada_rect_shrink(const hada_rectangle *rect, int rows, int cols, int small_rows, int small_cols,
                                int outward, int margin);

/* Refinement: the planes of a set of depths that together explain a frame. Internal.
 *
 * ADMM for  min 1/2 |b - M sum_z PSF_z * x_z|^2_w + 1/2 sum_f prior(f) sum_z |X_z(f)|^2 + tv sum_z TV(x_z),  x_z >= 0
 * in the window and 0 outside, M the sensor's frame (circular boundary: everything), TV the total variation in the
 * window with its channels coupled and differences of colour heavier than those of brightness.
 * docs/explanation/refinement.md derives the steps and says why no array of the whole grid is ever transformed: S. Boyd
 * et al., "Distributed optimization and statistical learning via ADMM" (2011), sections 3 and 3.4.3; M. Almeida and M.
 * Figueiredo, "Deconvolving images with unknown boundaries using ADMM", IEEE TIP 22(8), 2013, for the split at the
 * frame.
 *
 * Several sets of equally many depths can be refined side by side in one batch on the same frame (depth pursuit). A
 * refiner belongs to one slot. Results are the same bits at every run and for every number of sets. */

typedef struct hada_refine_shape {
    int grid_rows, grid_cols;
    hada_rectangle frame;  /* what the sensor sees; used with the padded boundary */
    hada_rectangle window; /* where the scene may be bright */
    hada_rectangle shown;  /* the part of the window that results have; 0 x 0: all of it */
    hada_boundary boundary;
    int channels;
    int max_sets;   /* sets in one run, at most */
    int max_planes; /* sets x depths in one run, at most */
    int max_steps;
    int tv;        /* 1: rules may ask for total variation */
    int ridge;     /* 1: and for the learned regulariser after it */
    int settle;    /* 1: and planes may be asked whether they have settled */
    int crosstalk; /* 1: and planes may fade where they are dark beside others */
    int past;      /* 1: what a run of one set leaves may be kept for the next frame */
} hada_refine_shape;

/* The shape for a model: one set of up to max_depths depths. */
hada_refine_shape hada_refine_shape_of(const hada_model_info *info, int max_depths, int max_steps);

/* What is refined. All spectra in the layout of hada_fft_layout(context, grid_rows, grid_cols, AUTO). */
typedef struct hada_refine_data {
    cl_mem spectrum;        /* of the frame (padded: zero outside it), [channel][count] complex */
    size_t spectrum_offset; /* in complex numbers */
    cl_mem frame;           /* padded boundary only: [channel][frame rows][frame cols] floats, dark level removed */
    size_t frame_offset;    /* in floats */
    cl_mem
        weights; /* padded boundary only: as the frame, offset 0, of its pixels' squared errors: 0 leaves a pixel out;
                    below zero it has the size |w|, and the true value may be larger (saturated); NULL: 1 each */
    double score_mu;   /* hada_refiner_residual(): an error counts by w / (w + score_mu); 0: whole where w is not 0 */
    int level;         /* the same: pixels a side of blocks of which the mean error is taken off; 0: of none */
    cl_mem otf;        /* [depth][channel][count] complex */
    size_t otf_offset; /* in complex numbers */
    int otf_depths;
    cl_mem prior; /* [channel][count] floats: noise power over scene power; NULL: none. Where a rule has total variation
                     that is the prior, and this one is not used */
    cl_mem variance; /* [depth][channel][count] floats, hada_refiner_score() only: variance of the OTF estimate over the
                     noise power (1 / sum |X|^2 of the pairs); NULL: the OTF is exact */
} hada_refine_data;

typedef struct hada_refine_rule {
    int steps;         /* linear steps, 1 to max_steps; the first is the joint linear filter */
    int whole;         /* steps of the whole refinement, among which rho grows where a single depth is weighed */
    double rho;        /* > 0, in units of |OTF|^2 */
    double first_rho;  /* of the first step; it grows by the factor `growth` a step up to rho; 0: rho throughout */
    int before;        /* where a run continues others: the steps that they did, for rho */
    int resumes;       /* 1: they had another rho, and may be those of another frame */
    double growth;     /* >= 1 */
    double relaxation; /* 0 < relaxation < 2; 1.6 is usual, 1 none */
    double first_relaxation; /* of the first first_steps steps, as relaxation */
    int first_steps;
    double mu;        /* > 0: weight of the split at the frame (padded), in units of the data's weight; 1 without tv. A
                         run that continues another keeps its mu */
    double tv;        /* weight of total variation, in units of OTF x frame; 0: none. See hada_refine_rule_weigh() */
    double tv_colour; /* >= 1: how much heavier differences of colour are than those of brightness */
    int ridge;        /* 1: steps with the learned regulariser follow the run */
    double noise; /* above 0: the proximal step is that of the learned regulariser (refine/proximal.h) for noise of this
                     standard deviation, without duals, instead of total variation's */
    double stop;  /* stop when the residual changes by less than this part of itself, twice running; 0: never */
    int least;    /* steps before `stop` may end the run */
    double settle; /* of one set: stop when four steps change the planes by less than this part of them; 0: never */
    int quiet;     /* 1, without `stop`: nobody asks for the energies on the way, and the run waits for nothing */
    int scored; /* 1: hada_refiner_score() follows, with the planes as they are: a step may leave what it begins with */
    hada_refine_start start;
} hada_refine_rule;

void hada_refine_rule_init(hada_refine_rule *rule);

/* Weights of refinement: of total variation (0: none) and, in it, of differences of colour over those of brightness;
 * the strength of the learned regulariser after it (0: none). */
typedef struct hada_refine_weights {
    double tv, colour, ridge;
} hada_refine_weights;

/* The weight of colour that photographs favour, where nothing was measured (docs/explanation/refinement.md). */
#define HADA_REFINE_COLOUR 1.5
/* Beyond this the proximal step would not be exact; a grey scene is as grey with less. */
#define HADA_REFINE_MOST_COLOUR 16.0

/* The strength of the learned regulariser that photographs favour, and the largest one that is possible. */
#define HADA_REFINE_RIDGE      1.0
#define HADA_REFINE_MOST_RIDGE 100.0

static inline int hada_refine_ridge_known(double ridge)
{
    return ridge >= 0.0 && ridge <= HADA_REFINE_MOST_RIDGE;
}

static inline int hada_refine_colour_known(double colour)
{
    return colour >= 1.0 && colour <= HADA_REFINE_MOST_COLOUR;
}

/* rho with total variation of weight tv or without, in units of the largest |OTF(0)|^2
 * (docs/explanation/refinement.md). */
static inline double hada_refine_rho(hada_boundary boundary, double tv)
{
    return !(tv > 0.0) ? 1e-3 : boundary == HADA_BOUNDARY_PADDED ? 3e-3 : 3.5e-3;
}

/* Several depths take up to so many times the steps that leave-one-out chose, mostly on scenes of one. */
enum { HADA_REFINE_PARTING = 6 };

/* Stops a rule that has been weighed where nobody said how many steps to take: where the residual has settled, with
 * several depths and total variation where the planes have, for depths part long after. depths 1: by the residual,
 * however many there are. */
void hada_refine_rule_stop(hada_refine_rule *rule, hada_boundary boundary, int depths);

/* Stops it where the planes have settled, of one depth too. */
void hada_refine_rule_settle(hada_refine_rule *rule);

/* The most steps that such a rule makes of `steps` with up to so many depths. */
static inline int hada_refine_most_steps(int steps, int depths)
{
    return depths > 1 ? HADA_REFINE_PARTING * steps : steps;
}

/* rho, relaxation and total variation for so many depths and a frame of this mean square (over pixels and channels).
 * weights->tv is in units of sqrt(channels gain mean square), so that a brighter frame gives the same planes, brighter,
 * and a grey scene the same ones in one channel or three; gain: hada_model_gain(). Where tv is 0 on one side only, rho
 * is not the model's. */
void hada_refine_rule_weigh(hada_refine_rule *rule, const hada_model_info *info, const hada_refine_weights *weights,
                            int depths, double gain, double mean_square);

/* Turns a rule with the tv of the run before (hada_refiner_tv()) into that of steps with the learned regulariser, which
 * go on from there. */
void hada_refine_rule_ridge(hada_refine_rule *rule, int steps, const hada_model_info *info,
                            const hada_refine_weights *weights, int depths, double gain);

/* rho, in a rule that has been weighed, in proportion to a weight of total variation that may be far from the usual: a
 * small weight with a large rho changes planes so little a step that they stay hazy. per: rho of weight 1, most: the
 * largest rho, both in units of gain. */
void hada_refine_rule_follow(hada_refine_rule *rule, double tv, double gain, double per, double most);

typedef struct hada_refiner hada_refiner;

/* The planes are a result of the slot's steps (runtime/memory.h). */
hada_status hada_refiner_create(hada_refiner **out, hada_slot *slot, const hada_refine_shape *shape, hada_error *err);
void hada_refiner_destroy(hada_refiner **refiner);

/* Refines `sets` sets of `depths` depths each; list[sets][depths] are depth indices of the OTF buffer. *steps (may be
 * NULL) takes the number of steps done. Returns when the residuals are known (quiet: at once); the planes may still be
 * on their way. */
hada_status hada_refiner_run(hada_refiner *refiner, const hada_refine_data *data, const hada_refine_rule *rule,
                             int sets, int depths, const int *list, int *steps, hada_error *err);

/* Fades planes of the last run, of so many depths, where they are dark beside others (refine/proximal.h); what is
 * asked of them afterwards is asked of the faded ones. */
hada_status hada_refiner_fade(hada_refiner *refiner, int depths, double share, hada_error *err);

/* Where results have a part of the window: brings that of the first `depths` planes to hada_refiner_planes(). */
hada_status hada_refiner_crop(hada_refiner *refiner, int depths, hada_error *err);

/* The planes: [set][place in the set][channel][rows][cols] floats of the window, to be read or (for a warm start)
 * written on the slot's compute queue; or of what is shown of it. */
cl_mem hada_refiner_planes(const hada_refiner *refiner);

/* Energies that the last run met on its way, sum of squares over pixels and channels. Circular: of
 * b - sum PSF * u after `step` steps, 0 <= step < steps done. Padded: of b - v within the frame, v the split variable
 * that converges to sum PSF * u, 1 <= step <= steps done; step 0: of b itself. */
double hada_refiner_energy(const hada_refiner *refiner, int set, int step);

/* The energy of b - sum PSF * u (within the frame) for the planes as they are now, one value per set. */
hada_status hada_refiner_residual(hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                                  const int *list, double *energy, hada_error *err);

/* The same after a quiet run, without waiting: once the slot was waited for, the second call has the energies, of the
 * planes as they were, and circular and after two steps or more of the run, what the joint linear filter left (that is
 * hada_refiner_energy(refiner, set, 1)). Nothing else is asked of the refiner in between. */
hada_status hada_refiner_residual_later(hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                                        const int *list, hada_error *err);
void hada_refiner_residual_arrived(hada_refiner *refiner, double *energy);

/* How badly a set explains what the channels of the frame have in common, one value per set: the energy of the mean
 * over channels of b - sum PSF * u plus the prior's term, each frequency divided by 1 + sum |U|^2 variance, the growth
 * of its noise through the OTF's own error; of the frequencies with 2 |ky| < band_rows and 2 |kx| < band_cols. Whole
 * grid, also where the boundary is padded. depths 0: of the frame itself (one set, no list); *frame (may be NULL): the
 * same beside that of sets, in one look. */
hada_status hada_refiner_score(hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                               const int *list, int band_rows, int band_cols, double *energy, double *frame,
                               hada_error *err);

/* Padded boundary: the spectra [set][channel][count] of what the sets do not explain of the whole grid, in *spectra; no
 * energy is measured, and nothing waited for. */
hada_status hada_refiner_residual_spectra(hada_refiner *refiner, const hada_refine_data *data, int sets, int depths,
                                          const int *list, cl_mem *spectra, hada_error *err);

/* Padded boundary: what one set leaves of data->spectrum within the frame, [channel][frame] floats, to the host; waits
 * for it. */
hada_status hada_refiner_residual_values(hada_refiner *refiner, const hada_refine_data *data, int depths,
                                         const int *list, float *values, hada_error *err);

/* One frame goes on from another (refine/past.c): the state of a run of one set is kept, whatever the refiner does
 * meanwhile. Nothing without shape.past. */
hada_status hada_refiner_keep(hada_refiner *refiner, int depths, const int *list, hada_error *err);

/* Whether there is a state of these depths; bringing it back, for a run that resumes it. */
int hada_refiner_remembers(const hada_refiner *refiner, int depths, const int *list);
hada_status hada_refiner_recall(hada_refiner *refiner, hada_error *err);

/* Where a frame of this energy and the one that is remembered differ in brightness (refine/past.c): whether that can be
 * found, without weights of values; after hada_refiner_residual() of remembered planes, which is *left, what they leave
 * if they are so many times as bright; and all that is remembered, and the planes, become so. */
int hada_refiner_knows_light(const hada_refiner *refiner, const hada_refine_data *data);
hada_status hada_refiner_left_if(hada_refiner *refiner, const hada_refine_data *data, int depths, double frame,
                                 double times, double *left, hada_error *err);
hada_status hada_refiner_brighten(hada_refiner *refiner, double times, hada_error *err);

/* A scene that moved as a whole (refine/past.c): by how many pixels down and across; stays: where depths begin and
 * end did not move; what is left of the frame (energy) if planes did so too; how unevenly over places, mean square over
 * squared mean, and the most over the mean; by how much a depth differs; how far the last look still went, in pixels;
 * and the part of a shift that a look finds, 0: not known. */
typedef struct hada_refine_motion {
    double shift[2], left, spread, most, apart, rest, part[2];
    int stays;
} hada_refine_motion;

/* Whether motion can be found: with total variation, without weights of values, in windows that are not tiny. */
int hada_refiner_knows_motion(const hada_refiner *refiner, const hada_refine_data *data);

/* The motion of the scene since the frame that is remembered: after hada_refiner_residual() of the remembered planes.
 * The planes are those that moved then, and nothing else of a run is left. gain: hada_model_gain(). *motion is the one
 * before, which it is likely to be, or zeros. */
hada_status hada_refiner_find_motion(hada_refiner *refiner, const hada_refine_data *data, double gain, int depths,
                                     const int *list, hada_refine_motion *motion, hada_error *err);

/* The motion that steps since hada_refiner_recall() made, which is too small for them to say so. */
hada_status hada_refiner_creep(hada_refiner *refiner, int depths, double shift[2], hada_error *err);

/* The planes are where a run goes on, without duals, as if they explained what is beyond the frame. */
hada_status hada_refiner_begin_from_planes(hada_refiner *refiner, const hada_refine_data *data, int depths,
                                           hada_error *err);

/* Prepares a run that goes on from the planes which hada_refiner_find_motion() moved. Total variation's duals move as
 * the planes did; the duals of the planes are those that total variation would have left. */
hada_status hada_refiner_move(hada_refiner *refiner, const hada_refine_data *data, int depths,
                              const hada_refine_motion *motion, hada_error *err);

/* Whether the planes changed since they were recalled, or moved so (motion not NULL), in places, as they do where
 * something moves by itself and noise does not. Before they are kept. strict: in doubt they do. */
hada_status hada_refiner_moved(hada_refiner *refiner, const hada_refine_motion *motion, int strict, int *moved,
                               hada_error *err);

/* Tells that the slot was waited for since, so that nothing of the host's is read any more. */
void hada_refiner_waited(hada_refiner *refiner);

/* The rule's weight of total variation in the last run. */
double hada_refiner_tv(const hada_refiner *refiner);

/* Two-dimensional transforms of real images that the refiner has enqueued since its creation. */
size_t hada_refiner_transforms(const hada_refiner *refiner);

#endif
