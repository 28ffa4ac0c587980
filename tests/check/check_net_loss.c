/* Losses: the gradient as a tensor, and behind it the value; d0: the value alone, d1: the gradient, d2: both are made,
 * the value is compared. */
#include "check_net.h"
#include "net/layers.h"
#include "ref/ref_loss.h"

#define WEIGHT 1.5f

/* Losses are means over all images, which come in one. */
static hada_status run(check_state *state, check_net *own, int first, int count, hada_error *err)
{
    (void)count;
    if (first)
        return HADA_OK;
    const hada_loss_desc desc = {(hada_loss)own->mode, WEIGHT};
    const hada_floats value = {state->out.mem, check_net_behind(state, own)};
    return hada_loss_run(state->slot, &desc, &own->x[0], own->inputs > 1 ? &own->x[1] : NULL, value,
                         check_get(state, 'd', 1) ? &own->y : NULL, own->accumulate, own->scratch.mem, err);
}

static double expect(const check_net *own, const hada_ref_shape *shape, double *dx)
{
    const size_t count = hada_ref_values(shape);
    const double *x = own->plain[0], *t = own->plain[1];
    switch (own->mode) {
    case HADA_LOSS_MSE: return hada_ref_mse(count, WEIGHT, x, t, dx);
    case HADA_LOSS_L1: return hada_ref_l1(count, WEIGHT, x, t, dx);
    case HADA_LOSS_LOGITS: return hada_ref_logits(count, WEIGHT, x, t, dx);
    default: return hada_ref_variation(shape, own->mode == HADA_LOSS_TV_SQUARED, WEIGHT, x, dx);
    }
}

static hada_status prepare(check_state *state, hada_error *err)
{
    check_net *own;
    double *out = NULL;
    const hada_ref_shape shape = check_net_shape(state);
    const size_t count = hada_ref_values(&shape);
    own = check_net_own(state, run);
    const int alone = own->mode == HADA_LOSS_TV || own->mode == HADA_LOSS_TV_SQUARED;
    /* integers, so that neighbours and targets are equal now and then */
    const int largest = own->mode == HADA_LOSS_L1 || own->mode == HADA_LOSS_TV ? 2 : 0;
    HADA_TRY(check_net_input(state, own, &shape, largest, err));
    if (!alone)
        HADA_TRY(check_net_input(state, own, &shape, largest, err));
    HADA_TRY(check_net_output(state, own, &shape, 1, 0, &out, err));
    HADA_TRY(check_scratch(state, &own->scratch, hada_loss_scratch(&own->x[0]), err));
    if (!state->timing) {
        const int gradient = check_get(state, 'd', 1);
        if (gradient && !own->accumulate)
            memset(out, 0, count * sizeof *out);
        out[count] = expect(own, &shape, gradient ? out : NULL);
        check_net_expect(state, own, &shape, 1, out);
        const size_t tensor = state->out_count - 1;
        check_net_ignore(state, gradient == 1 ? tensor : 0, gradient == 1 ? 1 : tensor);
    }
    state->tolerance = 1e-6; /* single roundings */
    state->bytes = (alone ? 2.0 : 3.0) * (double)count * sizeof(float);
    return HADA_OK;
}

const check_op check_net_loss = {
    "net_loss",
    "n images, k channels, r rows, c columns, v block, p1 gaps between images, b 0 MSE, 1 L1, 2 logits, 3 TV, 4 squared "
    "TV, d0 the value alone, d1 its gradient compared, d2 the value with it, a1 gradient added to",
    prepare, check_net_launch, NULL};
