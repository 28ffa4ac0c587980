#include "planes/weight_search.h"

#include <limits.h>
#include <math.h>

#include "core/random.h"

/* Weights are tried in half decades, from this many times noise / rms downwards. */
#define FIRST   0.2
#define LARGEST 0.1
#define RATIO   3.1622776601683795
/* The sweep ends when predictions have become worse by this, or twice running. */
#define WORSE 1.01
/* Or when what is left is more than this part of what was left before, and the weight is well below the least one. */
#define SETTLED 0.9
/* Times the energy of the noise: what is an error of the optics beyond it; what counts for the usual weight at most. */
#define BESIDE     2.0
#define MOST_NOISE 4.0
/* No weight is less than this part of the usual one. */
#define LEAST (1.0 / 3.0)
/* Of the values. */
#define HELD_OUT 0.05

enum {
    MOST = 11, /* weights downwards, the first one among them */
    UP = 2     /* weights above the first one, if that is the best */
};

typedef struct trial {
    double weight, left;
} trial;

void hada_hold_out_blocks(unsigned char *blocks, size_t count)
{
    hada_random random;
    hada_random_seed(&random, 1, 1);
    for (size_t i = 0; i < count; i++)
        blocks[i] = hada_random_bits(&random) < HELD_OUT * 0x1p32;
}

/* The share of held-out values' energy that planes leave. */
static double share_left(const hada_frame_exposure *exposure, double left)
{
    return exposure->energy > 0.0 ? left / (HELD_OUT * exposure->energy) : 0.0;
}

/* The weight that is usual for what is left. */
static double usual_weight(const hada_weight_search *search, const hada_frame_exposure *exposure, double noise,
                           double left)
{
    return search->usual * pow(fmin(share_left(exposure, left), MOST_NOISE * noise), 2.0 / 3.0);
}

/* The largest weight that predicts as well as the best. What lies between trials is interpolated, over the logarithm of
 * the weight: by the parabola through the best one and those beside it, and linearly above. errors: the share of what
 * is left that the optics are to blame for. */
static void take(const hada_weight_search *search, double errors, const trial *trials, int from, int best, int to,
                 hada_maker_choice *choice)
{
    const trial *t = trials + best;
    double low = t->left, up = 0.0, bend = 0.0;
    if (best > from && best < to)
        bend = t[-1].left + t[1].left - 2.0 * low;
    if (bend > 0.0) {
        up = fmin(fmax((t[1].left - t[-1].left) / (2.0 * bend), -0.5), 0.5);
        low -= bend * up * up / 2.0;
        choice->factor = pow(RATIO, sqrt(2.0 * 0.01 * t->left / bend));
    }
    const double enough = (1.0 + search->doubt * errors) * low;
    int i = best;
    while (i > from && trials[i - 1].left <= enough)
        i--;
    if (bend > 0.0)
        up += sqrt(2.0 * (enough - low) / bend);
    if (i < best || !(bend > 0.0))
        up = best - i + (i > from ? (enough - trials[i].left) / (trials[i - 1].left - trials[i].left) : 0.0);
    choice->tv = search->factor * t->weight * pow(RATIO, up);
}

hada_status hada_weight_find(const hada_weight_search *search, const hada_frame_exposure *exposure,
                             hada_maker_choice *choice, hada_error *err)
{
    const double deviation = hada_exposure_noise(exposure) / fmax(hada_exposure_light(exposure), 1e-150),
                 noise = deviation * deviation; /* its share of the frame's energy */
    const double most = fmin(fmax(FIRST * deviation, 1e-3), LARGEST);
    /* on fixed places, so that frames of a sequence choose alike */
    const double first = pow(RATIO, ceil(log(most) / log(RATIO)));
    const int limit = search->most_steps > 0 ? search->most_steps : INT_MAX;
    trial trials[UP + MOST]; /* from large to small weights, the first one at UP */
    int best = UP, from = UP, to = UP;
    *choice = (hada_maker_choice){0};
    for (int i = 0; i < UP + MOST; i++)
        trials[i] = (trial){.weight = first * pow(RATIO, UP - i)};
    for (int at = UP; at < UP + MOST && choice->steps < limit; at++) {
        HADA_TRY(search->solve(search->user, trials[to = at].weight, &choice->steps, &trials[at].left, err));
        const double before = trials[best].left, left = trials[at].left;
        if (left < before)
            best = at;
        if (left < before ? left > (1.0 - search->least) * before : at > best + 1 || left > WORSE * before)
            break;
        if (at > UP && left > SETTLED * before &&
            trials[at].weight * sqrt(RATIO) < LEAST * usual_weight(search, exposure, noise, left))
            break;
    }
    while (best == from && from > 0 && choice->steps < limit) {
        --from;
        HADA_TRY(search->solve(search->user, trials[from].weight, &choice->steps, &trials[from].left, err));
        if (trials[from].left < trials[best].left)
            best = from;
    }
    const double left = trials[best].left, usual = usual_weight(search, exposure, noise, left),
                 errors = fmax(1.0 - BESIDE * noise / fmax(share_left(exposure, left), 1e-300), 0.0);
    take(search, errors, trials, from, best, to, choice);
    if (usual > 0.0) {
        const double trust = search->trust + (1.0 - search->trust) * errors;
        choice->tv = usual * pow(fmax(choice->tv / usual, LEAST), trust);
    }
    return HADA_OK;
}
