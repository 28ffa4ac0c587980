/* The weight of a method's prior, found from the frame alone. */
#include <math.h>

#include "classic/classic_steps.h"
#include "planes/weight_search.h"

enum {
    PART = 6,    /* iterations with a weight: this part of those that the frame takes */
    LARGE = 100, /* but no more */
    FIRST = 2,   /* times as many with the first one, which begins from nothing */
    WEIGHTS = 14 /* all in all as if with so many weights, at most */
};
#define MOST_OF_OWN 2.5

/* Slow methods go on converging, whatever the weight: what is gained by less than this is not the weight's. */
#define LEAST 0.005

typedef struct search {
    hada_classic *classic;
    const hada_classic_job *job;
    cl_mem held;
    int each, most;
} search;

static hada_status solve(void *user, double weight, int *steps, double *left, hada_error *err)
{
    const search *s = user;
    const int wanted = *steps ? s->each : FIRST * s->each,
              number = wanted < s->most - *steps ? wanted : s->most - *steps;
    s->classic->weight = weight;
    HADA_TRY(hada_classic_step(s->classic, *steps, number, err));
    *steps += number;
    if (s->job->progress)
        s->job->progress(s->job->user, *steps);
    HADA_TRY(hada_classic_weigh(s->classic, s->held, err));
    HADA_TRY(hada_classic_energy(s->classic, left, err));
    return hada_classic_weigh(s->classic, s->job->data->weights, err);
}

/* With a weight. */
static int each_of(const hada_classic_shape *shape)
{
    const int part = shape->options.iterations / PART;
    return part < 1 ? 1 : part > LARGE ? LARGE : part;
}

int hada_classic_search_most(const hada_classic_shape *shape)
{
    return shape->choose ? (int)fmin(MOST_OF_OWN * shape->options.iterations, WEIGHTS * each_of(shape)) : 0;
}

hada_status hada_classic_choose(hada_classic *classic, const hada_classic_job *job, cl_mem held,
                                const hada_frame_exposure *exposure, hada_maker_choice *choice, hada_error *err)
{
    search s = {classic, job, held, each_of(&classic->shape), hada_classic_search_most(&classic->shape)};
    HADA_TRY(hada_classic_ready(classic, job, err));
    return hada_weight_find(
        &(hada_weight_search){.solve = solve, .user = &s, .most_steps = s.most, .least = LEAST, .factor = 1.0},
        exposure, choice, err);
}
