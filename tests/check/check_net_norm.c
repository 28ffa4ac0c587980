/* Batch normalisation: with given statistics, with the batch's, and the gradient. */
#include "check_net.h"

#define EPS      1e-3
#define MOMENTUM 0.25

enum { INFER = 0, TRAIN = 1, BACKWARD = 2 };
enum { X, WEIGHT, BIAS, MEAN, VARIANCE, DY }; /* inputs */

/* Images of a batch belong together, so they come in one. Training keeps the running values behind the output, so that
 * every run starts from the same ones: mean, variance, then the batch's. The gradients of weight and bias likewise. */
static hada_status run(check_state *state, check_net *own, int first, int count, hada_error *err)
{
    (void)count;
    if (first)
        return HADA_OK;
    const size_t channels = (size_t)own->x[X].channels, behind = check_net_behind(state, own);
    hada_batch_norm norm = {.weight = {own->memory[WEIGHT].mem, 0},
                            .bias = {own->memory[BIAS].mem, 0},
                            .mean = {own->memory[MEAN].mem, 0},
                            .variance = {own->memory[VARIANCE].mem, 0},
                            .eps = (float)EPS,
                            .momentum = (float)MOMENTUM};
    if (own->mode == INFER)
        return hada_batch_norm_infer(state->slot, &norm, &own->x[X], &own->y, err);
    cl_mem out = state->out.mem, scratch = own->scratch.mem;
    if (own->mode == TRAIN) {
        norm.mean = (hada_floats){out, behind};
        norm.variance = (hada_floats){out, behind + channels};
        return hada_batch_norm_train(state->slot, &norm, &own->x[X], &own->y, (hada_floats){out, behind + 2 * channels},
                                     scratch, err);
    }
    return hada_batch_norm_backward(state->slot, &norm, &own->x[X], (hada_floats){own->memory[MEAN].mem, 0},
                                    &own->x[DY], &own->y, (hada_floats){out, behind},
                                    (hada_floats){out, behind + channels}, own->accumulate, scratch, err);
}

/* Plain inputs: weight, bias, mean, variance; variances are not negative. What backward saw in the forward direction is
 * made here, from the reference. */
static hada_status inputs(check_state *state, check_net *own, const hada_ref_shape *shape, hada_error *err)
{
    const size_t channels = (size_t)shape->channels;
    HADA_TRY(check_net_input(state, own, shape, 0, err));
    for (int i = WEIGHT; i <= VARIANCE; i++)
        HADA_TRY(check_net_floats(state, own, i == MEAN ? 2 * channels : channels, 0, err));
    if (own->mode == BACKWARD)
        HADA_TRY(check_net_input(state, own, shape, 0, err));
    float *floats = check_room(state, 2 * channels * sizeof *floats);
    for (size_t c = 0; c < channels; c++) {
        own->plain[VARIANCE][c] = floats[c] = (float)fabs(own->plain[VARIANCE][c]);
        floats[channels + c] = 0.0f;
    }
    HADA_TRY(hada_buffer_write(&own->memory[VARIANCE], state->slot, 0, floats, channels * sizeof *floats, err));
    if (own->mode == BACKWARD) {
        hada_ref_batch_statistics(shape, own->plain[X], own->plain[MEAN], own->plain[MEAN] + channels);
        for (size_t c = 0; c < channels; c++) {
            floats[c] = (float)own->plain[MEAN][c];
            floats[channels + c] = (float)(1.0 / sqrt(own->plain[MEAN][channels + c] + EPS));
        }
        HADA_TRY(hada_buffer_write(&own->memory[MEAN], state->slot, 0, floats, 2 * channels * sizeof *floats, err));
    }
    return HADA_OK;
}

static hada_status expect(check_net *own, const hada_ref_shape *shape, double *out, hada_error *err)
{
    const size_t channels = (size_t)shape->channels, values = hada_ref_values(shape);
    double *plain[DY + 1], *behind = out + values;
    memcpy(plain, own->plain, sizeof plain);
    if (own->mode == INFER) {
        hada_ref_batch_norm(shape, plain[WEIGHT], plain[BIAS], plain[MEAN], plain[VARIANCE], EPS, plain[X], out);
        return HADA_OK;
    }
    if (own->mode == BACKWARD) {
        memset(out, 0, values * sizeof *out);
        if (!own->accumulate)
            memset(behind, 0, 2 * channels * sizeof *behind);
        return hada_ref_batch_norm_backward(shape, plain[WEIGHT], EPS, plain[X], plain[DY], out, behind,
                                            behind + channels, err);
    }
    double *mean = behind + 2 * channels, *second = mean + channels;
    const double count = (double)shape->images * shape->rows * shape->cols;
    hada_ref_batch_statistics(shape, plain[X], mean, second);
    hada_ref_batch_norm(shape, plain[WEIGHT], plain[BIAS], mean, second, EPS, plain[X], out);
    for (size_t c = 0; c < channels; c++) {
        behind[c] += MOMENTUM * (mean[c] - behind[c]);
        behind[channels + c] += MOMENTUM * (second[c] * count / (count - 1.0) - behind[channels + c]);
        second[c] = 1.0 / sqrt(second[c] + EPS);
    }
    return HADA_OK;
}

static hada_status prepare(check_state *state, hada_error *err)
{
    check_net *own;
    double *out = NULL;
    const hada_ref_shape shape = check_net_shape(state);
    own = check_net_own(state, run);
    const size_t floats = (size_t)shape.channels * (own->mode == TRAIN ? 4 : own->mode == BACKWARD ? 2 : 0);
    /* running values start as numbers, not as what must be gone */
    own->accumulate |= own->mode == TRAIN;
    HADA_TRY(inputs(state, own, &shape, err));
    HADA_TRY(check_net_output(state, own, &shape, floats, 0, &out, err));
    HADA_TRY(check_scratch(state, &own->scratch, hada_batch_norm_scratch(&own->x[X]), err));
    if (!state->timing)
        HADA_TRY(expect(own, &shape, out, err));
    if (!state->timing)
        check_net_expect(state, own, &shape, floats, out);
    /* sums of normal numbers by trees: some 1e-7 of the largest partial sum */
    state->tolerance = 2e-6;
    state->bytes = (own->mode == INFER   ? 2.0
                    : own->mode == TRAIN ? 3.0
                                         : 5.0) *
                   (double)hada_ref_values(&shape) * sizeof(float);
    return HADA_OK;
}

const check_op check_net_batch_norm = {"net_batch_norm",
                                       "n images, k channels, r rows, c columns, v block, p1 gaps between images, b 0 "
                                       "infer, 1 train, 2 backward, a1 weight "
                                       "and bias gradients added to",
                                       prepare, check_net_launch, NULL};
