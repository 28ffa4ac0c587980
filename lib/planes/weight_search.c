#include "planes/weight_search.h"

#include <limits.h>
#include <math.h>

#include "core/random.h"

/* Weights are tried in half decades, from this many times 0.1 noise / rms, the usual weight, downwards. */
#define FIRST_OF_USUAL 2.0
#define USUAL          0.1
#define LARGEST        0.1
#define RATIO          3.1622776601683795
/* The sweep ends when predictions have become worse by this, or twice running. */
#define WORSE 1.01
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

/* The lowest point of the parabola through three trials that follow each other, over the logarithm of the weight. */
static void interpolate(const trial *near, hada_maker_choice *choice)
{
    const double a = near[0].left, b = near[1].left, c = near[2].left, bend = a + c - 2 * b;
    const double at = bend > 0.0 ? fmin(fmax((a - c) / (2.0 * bend), -0.5), 0.5) : 0.0;
    choice->tv = near[1].weight * pow(RATIO, -at);
    choice->factor = bend > 0.0 ? pow(RATIO, sqrt(2.0 * 0.01 * b / bend)) : 0.0;
}

hada_status hada_weight_find(const hada_weight_search *search, const hada_frame_exposure *exposure,
                             hada_maker_choice *choice, hada_error *err)
{
    const double usual = USUAL * hada_exposure_noise(exposure) / fmax(hada_exposure_light(exposure), 1e-150);
    const double most = fmin(fmax(FIRST_OF_USUAL * usual, 1e-3), LARGEST);
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
    }
    while (best == from && from > 0 && choice->steps < limit) {
        --from;
        HADA_TRY(search->solve(search->user, trials[from].weight, &choice->steps, &trials[from].left, err));
        if (trials[from].left < trials[best].left)
            best = from;
    }
    choice->tv = trials[best].weight;
    if (best > from && best < to)
        interpolate(trials + best - 1, choice);
    return HADA_OK;
}
