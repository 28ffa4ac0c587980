/* Sets of depths, and the residual that each of them leaves of the frame in hand; what was refined once is kept.
 * Internal to lib/refine. */
#ifndef HADA_REFINE_PURSUIT_SETS_H
#define HADA_REFINE_PURSUIT_SETS_H

#include "refine/pursuit_level.h"

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

int hada_set_same(const hada_set *a, const hada_set *b);
int hada_set_has(const hada_set *set, int depth);
hada_set hada_set_with(const hada_set *set, int depth);
hada_set hada_set_without(const hada_set *set, int place);

typedef struct hada_known_residual hada_known_residual;

enum { HADA_RESIDUALS_AHEAD = 64 };

/* What is known of the frame in hand; all zero but for the pursuit at first. */
typedef struct hada_residuals {
    hada_pursuit *pursuit;
    hada_known_residual *known;
    size_t count, room;
    /* sets that may be asked about next */
    hada_set ahead[HADA_RESIDUALS_AHEAD];
    hada_fidelity ahead_fidelity[HADA_RESIDUALS_AHEAD];
    int ahead_count;
    hada_set taken[HADA_PURSUIT_DEPTHS]; /* of them those that go along */
} hada_residuals;

struct hada_pursuit {
    hada_slot *slot;
    hada_pursuit_options options; /* zeros replaced */
    hada_pursuit_level levels[HADA_PURSUIT_LEVELS];
    int count; /* of levels */
    hada_effort fidelity[HADA_FIDELITIES];
    int parts; /* 1: neighbours may be nearly alike, and are parted at the finer grid */
    hada_residuals residuals;
};

void hada_residuals_free(hada_residuals *residuals);

/* The energy of the frame itself. */
hada_status hada_residuals_frame(const hada_residuals *residuals, hada_fidelity fidelity, double *energy,
                                 hada_error *err);

/* Sets of any size that may be asked about later, so closely. They are refined beside the next that are, where that
 * costs a device nothing, which is so on GPUs: a few small grids leave most of one idle, and each look at its energies
 * is waited for. */
void hada_residuals_ahead(hada_residuals *residuals, hada_fidelity fidelity, const hada_set *sets, int count);

/* The energies that each of `count` sets of one size leaves; those not yet known are refined side by side. */
hada_status hada_residuals_of(hada_residuals *residuals, hada_fidelity fidelity, const hada_set *sets, int count,
                              double *energy, hada_error *err);

/* What all depths of the camera together leave on the coarse grid. Not for the reference search (options.full). */
hada_status hada_residuals_of_all(const hada_residuals *residuals, double *energy, hada_error *err);

#endif
