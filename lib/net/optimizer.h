/* Optimisers: one step from a gradient, on flat arrays of floats. Internal.
 *
 * Everything is enqueued on the slot and not waited for. The state is an array of the caller's,
 * hada_optimizer_state_floats() long, zero before the first step (hada_buffer_clear); saving it, the parameters and the
 * number of steps done is all that resuming needs: training then goes on with the same bits. Parameters may stand in
 * one array or many, each with a state of its own. The references are tests/ref/ref_optimizer.h. */
#ifndef HADA_NET_OPTIMIZER_H
#define HADA_NET_OPTIMIZER_H

#include "net/layers.h"

/* g is the gradient, t the step from 1 on, all operations elementwise.
 *   RMSPROP  v = decay v + (1 - decay) g^2, p -= rate g / sqrt(v + eps) (keras.optimizers.RMSprop)
 *   ADAM     m = beta1 m + (1 - beta1) g, v = beta2 v + (1 - beta2) g^2,
 *            p -= rate / (1 - beta1^t) m / (sqrt(v / (1 - beta2^t)) + eps) (Kingma and Ba 2015, torch.optim.Adam) */
typedef enum hada_optimizer { HADA_OPTIMIZER_RMSPROP = 0, HADA_OPTIMIZER_ADAM = 1 } hada_optimizer;

typedef struct hada_optimizer_desc {
    hada_optimizer optimizer;
    double eps;
    double scale; /* of the gradient, before all else; 1 */
} hada_optimizer_desc;

/* The defaults of the libraries named above; eps is 1e-7 and 1e-8. */
#define HADA_RMSPROP_DECAY 0.9
#define HADA_ADAM_BETA1    0.9
#define HADA_ADAM_BETA2    0.999
void hada_optimizer_desc_init(hada_optimizer_desc *desc, hada_optimizer optimizer);

/* Floats of state for `count` parameters: RMSprop v; Adam m, then v. */
size_t hada_optimizer_state_floats(const hada_optimizer_desc *desc, size_t count);

/* One step on `count` parameters; step counts from 1. */
hada_status hada_optimizer_step(hada_slot *slot, const hada_optimizer_desc *desc, uint64_t step, double rate,
                                hada_floats gradient, hada_floats parameters, hada_floats state, size_t count,
                                hada_error *err);

/* The sum of squares of all parts together, in a fixed order, to one float. `scratch` holds hada_squares_scratch()
 * bytes. */
typedef struct hada_gradient_part {
    hada_floats values;
    size_t count;
} hada_gradient_part;
size_t hada_squares_scratch(const hada_gradient_part *parts, int part_count);
hada_status hada_gradient_squares(hada_slot *slot, const hada_gradient_part *parts, int part_count, hada_floats out,
                                  cl_mem scratch, hada_error *err);

#endif
