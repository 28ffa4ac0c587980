/* References of the optimisers: one step, by the formulas of their sources, in double precision. Internal. */
#ifndef HADA_REF_OPTIMIZER_H
#define HADA_REF_OPTIMIZER_H

#include <stddef.h>

typedef struct hada_ref_rmsprop {
    double rate, decay, eps;
} hada_ref_rmsprop;

/* keras.optimizers.RMSprop (eps below the root). v is the state, zero before the first step. */
void hada_ref_rmsprop_step(const hada_ref_rmsprop *rule, size_t count, const double *g, double *p, double *v);

typedef struct hada_ref_adam {
    double rate, beta1, beta2, eps;
} hada_ref_adam;

/* torch.optim.Adam; t counts from 1. */
void hada_ref_adam_step(const hada_ref_adam *rule, int t, size_t count, const double *g, double *p, double *m,
                        double *v);

#endif
