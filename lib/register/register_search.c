/* From coarse to fine: every orientation, magnification and rotation on a small grid, then the best ones refined. */
#include "register/register_inside.h"

#include "core/callers.h"

#define RADIANS (3.14159265358979323846 / 180.0) /* a degree */

enum { MOST_DIMENSIONS = 4 };

/* Log of the magnification, turn in radians, perspective by TILT. */
typedef struct corner {
    double at[MOST_DIMENSIONS], score;
} corner;

typedef struct search {
    hada_register_level *level;
    hada_registration orientation;
    int dimensions;                /* 2: without perspective */
    double least, most, most_turn; /* of log magnification; radians */
    double tilt; /* perspective per unit: a step moves the frame's edge as one of magnification does */
    const hada_monitor *monitor;
} search;

/* Of tilts beyond this, what is at one edge of the frame is a third as large as at the other. */
#define MOST_TILT 0.5

static hada_registration registration_at(const search *where, const corner *at)
{
    hada_registration one = where->orientation;
    one.magnification = exp(at->at[0]);
    one.rotation_deg = at->at[1] / RADIANS;
    if (where->dimensions == 2)
        return one;
    one.perspective_row = where->tilt * at->at[2];
    one.perspective_col = where->tilt * at->at[3];
    return one;
}

static hada_status evaluate(const search *where, corner *at, hada_error *err)
{
    hada_register_level *level = where->level;
    if (at->at[0] < where->least || at->at[0] > where->most || fabs(at->at[1]) > where->most_turn ||
        hypot(at->at[2], at->at[3]) > MOST_TILT) {
        at->score = 1.0; /* worse than all within */
        return HADA_OK;
    }
    const hada_registration one = registration_at(where, at);
    HADA_TRY(hada_monitor_check(where->monitor, err));
    HADA_TRY(hada_register_level_take(level, &one, err));
    at->score = hada_register_level_score(level, 0, 0);
    return HADA_OK;
}

static void order(corner *c, int n)
{
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n - i; k++)
            if (c[k + 1].score < c[k].score) {
                const corner swap = c[k];
                c[k] = c[k + 1];
                c[k + 1] = swap;
            }
}

/* The point `by` times the way from the worst corner through the middle of the others. */
static corner beyond(const corner *c, int n, double by)
{
    corner out = {0};
    for (int d = 0; d < n; d++) {
        double middle = 0.0;
        for (int i = 0; i < n; i++)
            middle += c[i].at[d];
        middle /= n;
        out.at[d] = middle + by * (middle - c[n].at[d]);
    }
    return out;
}

/* A step of the downhill simplex (J. A. Nelder, R. Mead, Computer Journal 7, 308, 1965): of n + 1 corners, the first is
 * the best, the last the worst. */
static hada_status move(const search *where, corner *c, hada_error *err)
{
    const int n = where->dimensions;
    corner reflected = beyond(c, n, 1.0), other;
    HADA_TRY(evaluate(where, &reflected, err));
    if (reflected.score < c[0].score) {
        other = beyond(c, n, 2.0); /* expansion */
        HADA_TRY(evaluate(where, &other, err));
        c[n] = other.score < reflected.score ? other : reflected;
    } else if (reflected.score < c[n - 1].score) {
        c[n] = reflected;
    } else {
        other = beyond(c, n, reflected.score < c[n].score ? 0.5 : -0.5); /* contraction, outside or inside */
        HADA_TRY(evaluate(where, &other, err));
        if (other.score < fmin(reflected.score, c[n].score)) {
            c[n] = other;
        } else {
            for (int i = 1; i <= n; i++) { /* shrinking towards the best */
                for (int d = 0; d < n; d++)
                    c[i].at[d] = 0.5 * (c[i].at[d] + c[0].at[d]);
                HADA_TRY(evaluate(where, &c[i], err));
            }
        }
    }
    return HADA_OK;
}

/* How far the corners are from the best. */
static double extent(const corner *c, int n)
{
    double sum = 0.0;
    for (int i = n; i; i--)
        for (int d = 0; d < n; d++)
            sum += fabs(c[i].at[d] - c[0].at[d]);
    return sum;
}

hada_status hada_register_refine(hada_register_level *level, const hada_register_options *options, int slantwise,
                                 double step, hada_registration *at, double *score, hada_error *err)
{
    static const double others = 0.3; /* so much of the step along the other directions */
    const int n = slantwise ? MOST_DIMENSIONS : 2, most_steps = 30 * n;
    const search where = {.level = level,
                          .orientation = *at,
                          .dimensions = n,
                          .least = log(options->least_magnification) - HADA_REGISTER_STEP,
                          .most = log(options->most_magnification) + HADA_REGISTER_STEP,
                          .most_turn = (options->most_rotation_deg + HADA_REGISTER_TURN_DEG) * RADIANS,
                          .tilt = 2.0 / level->set->frame_side,
                          .monitor = options->monitor};
    const corner from = {.at = {log(at->magnification), at->rotation_deg * RADIANS, at->perspective_row / where.tilt,
                                at->perspective_col / where.tilt}};
    corner c[MOST_DIMENSIONS + 1];
    for (int i = 0; i <= n; i++) {
        c[i] = from;
        for (int d = 0; i && d < n; d++)
            c[i].at[d] += d == i - 1 ? step : d > i - 1 ? others * step : -others * step;
        HADA_TRY(evaluate(&where, &c[i], err));
    }
    for (int k = 0; k < most_steps; k++) {
        order(c, n);
        if (extent(c, n) < 0.01 * n * step)
            break;
        HADA_TRY(move(&where, c, err));
    }
    order(c, n);
    *at = registration_at(&where, c);
    *score = c[0].score;
    return HADA_OK;
}

hada_status hada_register_scan(hada_register_level *level, const hada_register_options *options,
                               hada_registration best[8], double scores[8], hada_error *err)
{
    const double from = log(options->least_magnification), to = log(options->most_magnification);
    const int scales = 1 + (int)ceil((to - from) / HADA_REGISTER_STEP);
    const int turns = (int)ceil(options->most_rotation_deg / HADA_REGISTER_TURN_DEG);
    for (int o = 0; o < 8; o++) {
        best[o] = (hada_registration){.mirrored = o / 4, .quarter_turns = o % 4, .magnification = exp(from)};
        scores[o] = 1.0;
    }
    for (int i = 0; i < scales; i++)
        for (int k = -turns; k <= turns; k++) {
            const hada_registration at = {.magnification =
                                              exp(from + (scales > 1 ? (to - from) * i / (scales - 1) : 0.0)),
                                          .rotation_deg = turns ? options->most_rotation_deg * k / turns : 0.0};
            HADA_TRY(hada_monitor_check(options->monitor, err));
            HADA_TRY(hada_register_level_take(level, &at, err));
            for (int o = 0; o < 8; o++) {
                const double score = hada_register_level_score(level, o % 4, o / 4);
                if (score >= scores[o])
                    continue;
                scores[o] = score;
                best[o].magnification = at.magnification;
                best[o].rotation_deg = o / 4 ? -at.rotation_deg : at.rotation_deg;
            }
        }
    return HADA_OK;
}
