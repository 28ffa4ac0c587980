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
 *   RMSPROP        v = decay v + (1 - decay) g^2, increment = rate g / sqrt(v + eps) (keras.optimizers.RMSprop)
 *   RMSPROP_TORCH  the same, increment = rate g / (sqrt(v) + eps) (torch.optim.RMSprop)
 *                  both with `centered`: a = decay a + (1 - decay) g, and v - a^2 in the place of v below the root;
 *                  with momentum > 0 the steps add up: Keras b = momentum b + increment, p -= b; PyTorch the same
 *                  without the rate in b, p -= rate b; otherwise p -= increment
 *   ADAM           m = beta1 m + (1 - beta1) g, v = beta2 v + (1 - beta2) g^2,
 *                  p -= rate / (1 - beta1^t) m / (sqrt(v / (1 - beta2^t)) + eps) (Kingma and Ba 2015, torch.optim.Adam)
 *   ADAMW          the same (Loshchilov and Hutter 2019, torch.optim.AdamW)
 * Weight decay w: RMSPROP and ADAMW shrink the parameters first, p -= rate w p; RMSPROP_TORCH and ADAM add w p to the
 * gradient first, as their libraries have it. */
typedef enum hada_optimizer {
    HADA_OPTIMIZER_RMSPROP = 0,
    HADA_OPTIMIZER_RMSPROP_TORCH = 1,
    HADA_OPTIMIZER_ADAM = 2,
    HADA_OPTIMIZER_ADAMW = 3
} hada_optimizer;

typedef struct hada_optimizer_desc {
    hada_optimizer optimizer;
    double decay;        /* RMSprop */
    double momentum;     /* RMSprop; 0: none */
    int centered;        /* RMSprop */
    double beta1, beta2; /* Adam */
    double eps, weight_decay;
    double scale; /* of the gradient, before all else; 1 */
} hada_optimizer_desc;

/* The values that the libraries named above start from: decay 0.9, eps 1e-7 (Keras); decay 0.99, eps 1e-8 (PyTorch);
 * betas 0.9 and 0.999, eps 1e-8, weight decay 0.01 for ADAMW and 0 for the others. */
void hada_optimizer_desc_init(hada_optimizer_desc *desc, hada_optimizer optimizer);

/* Floats of state for `count` parameters: 1 to 3 arrays as long, one after the other: v; then a where centered; then b
 * where there is momentum. Adam: m, v. */
size_t hada_optimizer_state_floats(const hada_optimizer_desc *desc, size_t count);

/* One step on `count` parameters; step counts from 1. Nothing is written where an argument is refused. */
hada_status hada_optimizer_step(hada_slot *slot, const hada_optimizer_desc *desc, uint64_t step, double rate,
                                hada_floats gradient, hada_floats parameters, hada_floats state, size_t count,
                                hada_error *err);

/* Scales gradients so that the norm of all parts together is at most max_norm (torch.nn.utils.clip_grad_norm_: times
 * min(1, max_norm / (norm + 1e-6))). norm[0] takes the norm before, by fixed-order sums, norm[1] the factor. max_norm
 * 0: measures only (the factor is 1). `scratch` holds hada_clip_scratch() bytes. */
typedef struct hada_gradient_part {
    hada_floats values;
    size_t count;
} hada_gradient_part;
size_t hada_clip_scratch(const hada_gradient_part *parts, int part_count);
hada_status hada_clip_gradients(hada_slot *slot, const hada_gradient_part *parts, int part_count, float max_norm,
                                hada_floats norm, cl_mem scratch, hada_error *err);

/* Learning rates: the rate of a step, counted from 0, by a pure function on the host.
 *   CONSTANT  rate
 *   STEP      rate * factor^(step / period)
 *   COSINE    last + (rate - last) (1 + cos(pi step / period)) / 2, and `last` from step = period on
 * Before them, during `warmup` steps, rate * (warmup_from + (1 - warmup_from) step / warmup); the steps of the schedule
 * then count from the end of that (PyTorch's LinearLR in a SequentialLR with StepLR or CosineAnnealingLR). */
typedef enum hada_schedule_kind {
    HADA_SCHEDULE_CONSTANT = 0,
    HADA_SCHEDULE_STEP = 1,
    HADA_SCHEDULE_COSINE = 2
} hada_schedule_kind;
typedef struct hada_schedule {
    hada_schedule_kind kind;
    double rate, factor, last;
    uint64_t period, warmup;
    double warmup_from; /* 0 ... 1 */
} hada_schedule;
/* Refuses what makes no sense: rates that are not finite or below 0, a period of 0 where one is needed. */
hada_status hada_schedule_validate(const hada_schedule *schedule, hada_error *err);
double hada_schedule_rate(const hada_schedule *schedule, uint64_t step);

#endif
