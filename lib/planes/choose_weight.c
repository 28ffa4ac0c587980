/* The weight of total variation, found from the frame alone: a part of its pixels is left out of the data, planes are
 * refined with one weight after the other, from large to small, each going on from those before, and the weight whose
 * planes predict the pixels that were left out best is taken (cross-validation: G. Golub, M. Heath, G. Wahba,
 * Technometrics 21(2), 1979; of pixels). docs/explanation/refinement.md has the figures. */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "core/random.h"
#include "image/statistics.h"
#include "planes/maker.h"

/* Weights are tried in half decades, from this many times 0.1 noise / rms, the usual weight, downwards. */
#define FIRST_OF_USUAL 2.0
#define USUAL          0.1
#define LARGEST        0.1
#define RATIO          3.1622776601683795
/* The sweep ends when predictions have become worse by this, or twice running. */
#define WORSE 1.01
/* Of the values. */
#define HELD_OUT 0.05
/* rho of the sweep: hada_refine_rule_follow() */
#define RHO_PER_WEIGHT 30.0
#define MOST_RHO       1e-2

enum {
    STEPS = 6, /* with each weight after the first, which takes HADA_CHOICE_STEPS from nothing */
    MOST = 11, /* weights downwards, the first one among them */
    UP = 2     /* weights above the first one, if that is the best */
};

typedef struct trial {
    double tv, left; /* energy at held-out pixels */
} trial;

typedef struct sweep {
    hada_plane_maker *maker;
    int count;
    const int *list;
    double unit;
    int steps; /* done */
    double first;
    trial trials[UP + MOST]; /* from large to small weights, the first one at UP */
} sweep;

static hada_status try_weight(sweep *s, int at, hada_error *err)
{
    const double tv = s->first * pow(RATIO, UP - at);
    const hada_plane_maker *maker = s->maker;
    const hada_model_info *info = hada_model_get_info(maker->model);
    const hada_refine_weights weights = {tv, maker->weights.colour, 0.0};
    const double gain = hada_model_gain(maker->model);
    hada_refine_data held = maker->data;
    hada_refine_rule rule;
    int done;
    hada_refine_rule_init(&rule);
    hada_refine_rule_weigh(&rule, info, &weights, 1, gain, s->unit);
    hada_refine_rule_follow(&rule, tv, gain, RHO_PER_WEIGHT, MOST_RHO);
    rule.growth = 1.0;
    rule.first_rho = 0.0;
    rule.steps = s->steps ? STEPS : HADA_CHOICE_STEPS;
    rule.before = s->steps;
    rule.start = s->steps ? HADA_REFINE_CONTINUE : HADA_REFINE_COLD;
    rule.quiet = 1;
    held.weights = maker->held.mem;
    s->trials[at] = (trial){.tv = tv};
    HADA_TRY(hada_refiner_run(maker->refiner, &maker->data, &rule, 1, s->count, s->list, &done, err));
    s->steps += done;
    return hada_refiner_residual(maker->refiner, &held, 1, s->count, s->list, &s->trials[at].left, err);
}

/* Leaves some of the values out, the same ones of every frame. */
static hada_status hold_out(hada_plane_maker *maker, const hada_frame_exposure *exposure, hada_error *err)
{
    const size_t count = hada_exposure_count(exposure), bytes = count * sizeof(float);
    float *weights = NULL, *held = NULL;
    hada_random random;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(weights, count, "the weights of pixels", err));
    HADA_TRY_OR_DONE(HADA_NEW(held, count, "held-out pixels", err));
    hada_exposure_weigh(exposure, weights);
    hada_random_seed(&random, 1, 1);
    for (size_t i = 0; i < count; i++)
        if (hada_random_bits(&random) < HELD_OUT * 0x1p32 && weights[i] > 0.0f) {
            held[i] = 1.0f;
            weights[i] = 0.0f;
        }
    HADA_TRY_OR_DONE(hada_buffer_write(&maker->held, maker->slot, 0, held, bytes, err));
    HADA_TRY_OR_DONE(hada_buffer_write(&maker->pixels, maker->slot, 0, weights, bytes, err));
    maker->data.weights = maker->pixels.mem;
done:
    free(weights);
    free(held);
    return status;
}

/* The lowest point of the parabola through three trials that follow each other, over the logarithm of the weight. */
static void interpolate(const trial *near, hada_maker_choice *choice)
{
    const double a = near[0].left, b = near[1].left, c = near[2].left, bend = a + c - 2 * b;
    const double at = bend > 0.0 ? fmin(fmax((a - c) / (2.0 * bend), -0.5), 0.5) : 0.0;
    choice->tv = near[1].tv * pow(RATIO, -at);
    choice->factor = bend > 0.0 ? pow(RATIO, sqrt(2.0 * 0.01 * b / bend)) : 0.0;
}

hada_status hada_maker_choose(hada_plane_maker *maker, const hada_frame_exposure *exposure, int count, const int *list,
                              hada_maker_choice *choice, hada_error *err)
{
    const double mean_square = exposure->energy / (double)hada_exposure_count(exposure);
    const double usual = USUAL * hada_noise_estimate(&exposure->pixels) / sqrt(fmax(mean_square, 1e-300));
    const double most = fmin(fmax(FIRST_OF_USUAL * usual, 1e-3), LARGEST);
    sweep s = {.maker = maker, .count = count, .list = list, .unit = mean_square};
    int best = UP, from = UP, to = UP;
    *choice = (hada_maker_choice){0};
    HADA_TRY(hold_out(maker, exposure, err));
    /* on fixed places, so that frames of a sequence choose alike */
    s.first = pow(RATIO, ceil(log(most) / log(RATIO)));
    for (int at = UP; at < UP + MOST; at++) {
        HADA_TRY(try_weight(&s, to = at, err));
        if (s.trials[at].left < s.trials[best].left)
            best = at;
        else if (at > best + 1 || s.trials[at].left > WORSE * s.trials[best].left)
            break;
    }
    while (best == from && from > 0) {
        HADA_TRY(try_weight(&s, --from, err));
        if (s.trials[from].left < s.trials[best].left)
            best = from;
    }
    choice->tv = s.trials[best].tv;
    choice->steps = s.steps;
    if (best > from && best < to)
        interpolate(s.trials + best - 1, choice);
    return hada_maker_weigh(maker, exposure, err);
}

hada_status hada_maker_refine_exposure(hada_plane_maker *maker, const hada_frame_exposure *exposure,
                                       const hada_maker_steps *steps, int count, const int *list,
                                       hada_maker_choice *choice, int *done, hada_error *err)
{
    hada_maker_steps own = *steps;
    HADA_TRY(hada_maker_weigh(maker, exposure, err));
    if (maker->held.mem && !(choice->tv > 0.0))
        HADA_TRY(hada_maker_choose(maker, exposure, count, list, choice, err));
    if (choice->tv > 0.0)
        own.tv = choice->tv;
    return hada_maker_refine(maker, &own, hada_exposure_noise_unit(exposure, maker->noise_share), count, list, done,
                             err);
}
