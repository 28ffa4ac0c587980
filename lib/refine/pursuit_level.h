/* The grids of depth pursuit, and the residual that a set of depths leaves of a frame on each of them. Internal to
 * lib/refine. */
#ifndef HADA_REFINE_PURSUIT_LEVEL_H
#define HADA_REFINE_PURSUIT_LEVEL_H

#include "refine/pursuit.h"

/* What a grid is like. */
typedef struct hada_level_spec {
    double shrink;   /* whole grid over this one, >= 1 */
    double evidence; /* whole grid over the one whose frequencies count as evidence, >= shrink or the same grid's */
    int separate;    /* 1: every channel for itself; 0: their mean */
    int max_steps;   /* of a refinement */
    int max_sets;    /* side by side */
    int all_depths;  /* 1: a set of all depths of the camera is refined as well */
} hada_level_spec;

typedef struct hada_pursuit_level {
    hada_slot *slot;
    const hada_pursuit_options *options; /* the pursuit's */
    hada_level_spec spec;
    hada_spectrum_layout full, layout, evidence_layout;
    hada_refine_shape shape;
    hada_refiner *refiner;
    hada_buffer otf, prior, variance, spectrum;
    /* padded: the frame's pixels; what is left of them at the frequencies of the evidence, [set][pixels] */
    hada_buffer frame, evidence, evidence_frame;
    hada_fft *frame_inverse, *evidence_inverse;
    /* its energies are added up on the host, or (levels with room) on the device: slices of each set, then of the frame
     */
    hada_buffer evidence_sums;
    float *host_evidence; /* the pixels, or those sums */
    size_t evidence_area, evidence_slices;
    int has_prior, has_variance;
    /* the frame in hand: its spectrum, whether it was brought to this grid, its energy there where it was measured */
    cl_mem whole;
    size_t whole_offset;
    int loaded, measured;
    double energy;
} hada_pursuit_level;

/* What it takes of the slot's scratch is not needed from one evaluation to the next; the camera stays. */
hada_status hada_level_create(hada_pursuit_level *level, hada_slot *slot, const hada_pursuit_options *options,
                              const hada_level_spec *spec, hada_error *err);
void hada_level_destroy(hada_pursuit_level *level); /* the slot's queue must be done with it */

/* As hada_pursuit_set_...(); the depths are checked. */
hada_status hada_level_set_otf(hada_pursuit_level *level, int first, int count, cl_mem otf, size_t offset,
                               hada_error *err);
hada_status hada_level_set_prior(hada_pursuit_level *level, cl_mem prior, hada_error *err);
hada_status hada_level_set_power(hada_pursuit_level *level, int first, int count, cl_mem power, size_t offset,
                                 hada_error *err);

/* The frame in hand from now on, by its spectrum, which must stay as it is meanwhile. It is brought to the grid when
 * something is asked about it. */
void hada_level_set_frame(hada_pursuit_level *level, cl_mem spectrum, size_t offset);

/* The frame's own energy, as hada_level_residuals() measures it. */
hada_status hada_level_frame_energy(hada_pursuit_level *level, double *energy, hada_error *err);

/* A place of a set that has none. Only for levels with room. */
enum { HADA_LEVEL_NO_DEPTH = -1 };

/* Sets that a run may hold at no more time than one, 0: each costs its own. */
int hada_level_room(const hada_pursuit_level *level);

/* residual[k]: the energy that set k of list[sets][depths], refined from nothing by `steps` steps, in which rho grows
 * by the factor `growth` each, leaves unexplained of the mean over channels, at the frequencies of the evidence. */
hada_status hada_level_residuals(hada_pursuit_level *level, int steps, double growth, int sets, int depths,
                                 const int *list, double *residual, hada_error *err);

#endif
