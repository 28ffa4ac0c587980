/* References of the optimisers: one step, by the formulas of their sources, in double precision. Internal. */
#ifndef HADA_REF_OPTIMIZER_H
#define HADA_REF_OPTIMIZER_H

#include <stddef.h>

typedef struct hada_ref_rmsprop {
    double rate, decay, eps, momentum, weight_decay;
    int centered;
} hada_ref_rmsprop;

/* keras.optimizers.RMSprop (eps below the root) and torch.optim.RMSprop (eps beside it). v, a (centered) and b
 * (momentum) are the state, zero before the first step; those that are not used may be NULL. */
void hada_ref_rmsprop_keras(const hada_ref_rmsprop *rule, size_t count, const double *g, double *p, double *v,
                            double *a, double *b);
void hada_ref_rmsprop_torch(const hada_ref_rmsprop *rule, size_t count, const double *g, double *p, double *v,
                            double *a, double *b);

typedef struct hada_ref_adam {
    double rate, beta1, beta2, eps, weight_decay;
    int decoupled; /* AdamW */
} hada_ref_adam;

/* torch.optim.Adam and AdamW; t counts from 1. */
void hada_ref_adam_step(const hada_ref_adam *rule, int t, size_t count, const double *g, double *p, double *m,
                        double *v);

#endif
