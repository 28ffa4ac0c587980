/* From coarse to fine: every orientation, magnification and rotation on a small grid, then the best ones refined. */
#include "register/register_inside.h"

#include "core/callers.h"

#define RADIANS (3.14159265358979323846 / 180.0) /* a degree */

/* A minimum in two dimensions by Nelder and Mead (1965). */
typedef struct corner {
    double log_scale, turn, score; /* turn: radians */
} corner;

typedef struct search {
    hada_register_level *level;
    hada_registration orientation;
    double least, most, most_turn; /* of log magnification; radians */
    const hada_monitor *monitor;
} search;

static hada_status evaluate(const search *where, corner *at, hada_error *err)
{
    hada_register_level *level = where->level;
    hada_registration one = where->orientation;
    if (at->log_scale < where->least || at->log_scale > where->most || fabs(at->turn) > where->most_turn) {
        at->score = 1.0; /* worse than all within */
        return HADA_OK;
    }
    one.magnification = exp(at->log_scale);
    one.rotation_deg = at->turn / RADIANS;
    HADA_TRY(hada_monitor_check(where->monitor, err));
    HADA_TRY(hada_register_level_take(level, &one, err));
    at->score = hada_register_level_score(level, 0, 0);
    return HADA_OK;
}

static void order(corner c[3])
{
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 2 - i; k++)
            if (c[k + 1].score < c[k].score) {
                const corner swap = c[k];
                c[k] = c[k + 1];
                c[k + 1] = swap;
            }
}

/* The point `by` times the way from the worst corner through the middle of the others. */
static corner beyond(const corner c[3], double by)
{
    const double s = 0.5 * (c[0].log_scale + c[1].log_scale), t = 0.5 * (c[0].turn + c[1].turn);
    return (corner){s + by * (s - c[2].log_scale), t + by * (t - c[2].turn), 0.0};
}

/* A step of the downhill simplex (J. A. Nelder, R. Mead, Computer Journal 7, 308, 1965): c[0] is the best corner, c[2]
 * the worst. */
static hada_status move(const search *where, corner c[3], hada_error *err)
{
    corner reflected = beyond(c, 1.0), other;
    HADA_TRY(evaluate(where, &reflected, err));
    if (reflected.score < c[0].score) {
        other = beyond(c, 2.0); /* expansion */
        HADA_TRY(evaluate(where, &other, err));
        c[2] = other.score < reflected.score ? other : reflected;
    } else if (reflected.score < c[1].score) {
        c[2] = reflected;
    } else {
        other = beyond(c, reflected.score < c[2].score ? 0.5 : -0.5); /* contraction, outside or inside */
        HADA_TRY(evaluate(where, &other, err));
        if (other.score < fmin(reflected.score, c[2].score)) {
            c[2] = other;
        } else {
            for (int i = 1; i < 3; i++) { /* shrinking towards the best */
                c[i].log_scale = 0.5 * (c[i].log_scale + c[0].log_scale);
                c[i].turn = 0.5 * (c[i].turn + c[0].turn);
                HADA_TRY(evaluate(where, &c[i], err));
            }
        }
    }
    return HADA_OK;
}

hada_status hada_register_refine(hada_register_level *level, const hada_register_options *options, double step,
                                 hada_registration *at, double *score, hada_error *err)
{
    enum { MOST_STEPS = 60 };
    const search where = {.level = level,
                          .orientation = *at,
                          .least = log(options->least_magnification) - HADA_REGISTER_STEP,
                          .most = log(options->most_magnification) + HADA_REGISTER_STEP,
                          .most_turn = (options->most_rotation_deg + HADA_REGISTER_TURN_DEG) * RADIANS,
                          .monitor = options->monitor};
    const double scale = log(at->magnification), turn = at->rotation_deg * RADIANS;
    corner c[3] = {{scale, turn, 0}, {scale + step, turn + 0.3 * step, 0}, {scale - 0.3 * step, turn + step, 0}};
    for (int i = 0; i < 3; i++)
        HADA_TRY(evaluate(&where, &c[i], err));
    for (int k = 0; k < MOST_STEPS; k++) {
        order(c);
        if (fabs(c[2].log_scale - c[0].log_scale) + fabs(c[2].turn - c[0].turn) +
                fabs(c[1].log_scale - c[0].log_scale) + fabs(c[1].turn - c[0].turn) <
            0.02 * step)
            break;
        HADA_TRY(move(&where, c, err));
    }
    order(c);
    at->magnification = exp(c[0].log_scale);
    at->rotation_deg = c[0].turn / RADIANS;
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
