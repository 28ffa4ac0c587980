/* Inside depth pursuit: its grids, and the residuals of sets of depths on them. Internal to lib/refine. */
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
    double scale; /* of the frame: what it is brought to the grid times */
    int loaded, measured;
    double energy;
} hada_pursuit_level;

/* What it takes of the slot's scratch is not needed from one evaluation to the next; the camera stays. */
hada_status hada_level_create(hada_pursuit_level *level, hada_slot *slot, const hada_pursuit_options *options,
                              const hada_level_spec *spec, hada_error *err);
void hada_level_destroy(hada_pursuit_level *level); /* the slot's queue must be done with it */

/* As hada_pursuit_set_...(). */
hada_status hada_level_set_otf(hada_pursuit_level *level, cl_mem otf, size_t offset, hada_error *err);
hada_status hada_level_set_prior(hada_pursuit_level *level, cl_mem prior, hada_error *err);
hada_status hada_level_set_power(hada_pursuit_level *level, int depth, cl_mem power, hada_error *err);

/* The frame in hand from now on, by its spectrum, which must stay as it is meanwhile. It is brought to the grid when
 * something is asked about it. */
void hada_level_set_frame(hada_pursuit_level *level, cl_mem spectrum, double scale);

/* How closely a residual is evaluated: by which grid and by how many steps of refinement, from the quickest to the
 * dearest. */
typedef enum hada_fidelity {
    HADA_FIDELITY_RANKING = 0,   /* puts candidates in order */
    HADA_FIDELITY_COARSE = 1,    /* decides what is clear */
    HADA_FIDELITY_CONVERGED = 2, /* the same grid with more steps: larger sets converge later */
    HADA_FIDELITY_FINE = 3,      /* a finer grid */
    HADA_FIDELITIES = 4
} hada_fidelity;

typedef struct hada_effort {
    int level, steps;
    double growth; /* of rho, a step */
} hada_effort;

/* Depths in rising order. */
typedef struct hada_set {
    int count, depth[HADA_PURSUIT_MAX];
} hada_set;

/* A set that was refined, and the energy that it left. */
typedef struct hada_known_residual {
    hada_fidelity fidelity;
    hada_set set;
    double energy;
} hada_known_residual;

enum { HADA_RESIDUALS_AHEAD = 64 };

struct hada_pursuit {
    hada_slot *slot;
    hada_pursuit_options options; /* zeros replaced */
    hada_pursuit_level levels[HADA_PURSUIT_LEVELS];
    int level_count;
    hada_effort fidelity[HADA_FIDELITIES];
    int parts; /* 1: neighbours may be nearly alike, and are parted at the finer grid */

    /* of the frame in hand: what was refined once is kept */
    hada_known_residual *known;
    size_t known_count;
    /* sets that may be asked about next */
    hada_set ahead[HADA_RESIDUALS_AHEAD];
    hada_fidelity ahead_fidelity[HADA_RESIDUALS_AHEAD];
    int ahead_count;
    hada_set taken[HADA_PURSUIT_DEPTHS]; /* of them those that go along */

    /* of the search: the sets of one size that are to be compared, and what they leave */
    hada_pursuit_result *result;
    hada_set candidates[HADA_PURSUIT_DEPTHS];
    double energy[HADA_PURSUIT_DEPTHS];
    int count;
};

int hada_set_same(const hada_set *a, const hada_set *b);

void hada_residuals_forget(hada_pursuit *pursuit);

/* The energy of the frame itself. */
hada_status hada_residuals_frame(hada_pursuit *pursuit, hada_fidelity fidelity, double *energy, hada_error *err);

/* Sets of any size that may be asked about later, so closely. They are refined beside the next that are, where that
 * costs a device nothing, which is so on GPUs: a few small grids leave most of one idle, and each look at its energies
 * is waited for. */
void hada_residuals_ahead(hada_pursuit *pursuit, hada_fidelity fidelity, const hada_set *sets, int count);

/* The energies that each of `count` sets of one size leaves; those not yet known are refined side by side. */
hada_status hada_residuals_of(hada_pursuit *pursuit, hada_fidelity fidelity, const hada_set *sets, int count,
                              double *energy, hada_error *err);

/* What all depths of the camera together leave on the coarse grid. Not for the reference search (options.full). */
hada_status hada_residuals_of_all(hada_pursuit *pursuit, double *energy, hada_error *err);

#endif
