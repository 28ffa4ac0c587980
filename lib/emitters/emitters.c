/* Emitters of a frame. Candidates are the volume's maxima; those that stand out of what the others leave of the frame
 * are fitted to it together, by Levenberg and Marquardt's method (D. W. Marquardt, J. SIAM 11(2), 431 (1963)), until
 * no further candidate stands out and none that was taken falls below the limit. */
#include "emitters/emitters.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/callers.h"
#include "core/numbers.h"
#include "focus/focus.h"

static const char what[] = "the emitters of a frame";

enum { ROW = HADA_POINT_ROW, COL, DEPTH, LIGHT, UNKNOWNS };

/* Frames of noise alone in which one emitter is found, of all. */
#define FALSE_ALARM 0.05
/* An emitter beside others stays where it has so many standard deviations of the fit together with them. */
#define BESIDE_OTHERS 3.0
/* Candidates: maxima whose neighbourhood holds this share of the light that the limit asks for; the most of them. */
#define CANDIDATE 0.25
enum { MOST_CANDIDATES = 20000 };
/* What emitters may take of the host's memory. */
#define MOST_BYTES ((size_t)1 << 30)
/* One that stands out by so little of the limit is not looked at again. */
#define HOPELESS 0.5
/* So near to an emitter, in pixels and depths, a candidate is the same one. */
#define SAME 1.0
/* A second emitter is looked for so far from each, in pixels and depths, where this share of its light is its own. */
#define SECOND    1.2
#define LEAST_OWN 0.05
/* Standard deviations are those of an emitter together with its nearest neighbours, so many within so many pixels. */
enum { NEIGHBOURS = 5 };
#define NEIGHBOUR 8.0
/* Steps of the fit between two looks for candidates, and at the end; of conjugate gradients in each. */
enum { ROUNDS = 6, STEPS = 4, LAST_STEPS = 12, GRADIENTS = 8 };
#define GRADIENT_LEFT 0.05 /* of the first residual's norm */
/* The fit ends when no emitter moves by more pixels or depths. */
#define STILL 0.003
/* Damping, in units of the curvature: at first, and how it changes. */
#define DAMPING      1e-3
#define DAMPING_STEP 8.0

typedef struct candidate {
    hada_point at;
    double light;
    int taken;
} candidate;

typedef struct spot {
    hada_point at, drawn; /* the place, and that of its pixels' values */
    int is_drawn, single; /* single: no second one stood out beside it */
    double light, sd[UNKNOWNS], residual;
    double noise; /* of pixels that see it, in units of their weights; no less than that of all */
    size_t first; /* of its pixels among all; each spot has the same room */
    int count;
    double block[UNKNOWNS][UNKNOWNS]; /* of the normal equations */
} spot;

typedef struct search {
    const hada_emitters_job *job;
    const hada_point_optics *optics;
    hada_point_renderer *renderer;
    size_t pixels, used;         /* of the frame; with a weight */
    int most;                    /* pixels that see one point */
    double limit;                /* amplitude in standard deviations */
    double sigma;                /* of the frame, as it is guessed at first */
    double cost, offset, weight; /* sum of weighted squares; light that all pixels see; sum of weights */
    float *left;                 /* of the frame */
    candidate *candidates;
    int candidate_count;
    spot *spots, *before;
    int count, rooms; /* rooms: that have pixels among the touches */
    hada_touch *touches;
    float *plane;                                           /* of the frame: a change of the model */
    float (*dense)[UNKNOWNS];                               /* of the frame, zeros between uses */
    double *step, *gradient, *direction, *along, *whitened; /* vectors of the unknowns, the offset last */
    size_t vector_room;
} search;

/* Candidates. */

static float voxel(const search *s, int z, int y, int x)
{
    const hada_image *plane = &s->job->planes[z];
    return plane->data[(size_t)y * (size_t)plane->cols + (size_t)x];
}

static int inside(const search *s, int z, int y, int x)
{
    return z >= 0 && z < s->optics->depths && y >= 0 && y < s->optics->window_rows && x >= 0 &&
           x < s->optics->window_cols;
}

/* Whether no neighbour is brighter; of equal ones the first counts. Then the light of all, and its centre. */
static int is_maximum(const search *s, int z, int y, int x, candidate *out)
{
    const float middle = voxel(s, z, y, x);
    double light = 0.0, row = 0.0, col = 0.0, depth = 0.0;
    for (int k = -1; k <= 1; k++)
        for (int i = -1; i <= 1; i++)
            for (int j = -1; j <= 1; j++) {
                if (!inside(s, z + k, y + i, x + j))
                    continue;
                const float value = voxel(s, z + k, y + i, x + j);
                const int before = k < 0 || (k == 0 && (i < 0 || (i == 0 && j < 0)));
                if (value > middle || (before && value == middle))
                    return 0;
                light += value;
                depth += (double)value * k;
                row += (double)value * i;
                col += (double)value * j;
            }
    out->light = light;
    out->taken = 0;
    out->at = (hada_point){(s->optics->frame_rows - s->optics->window_rows) / 2 + y + row / light,
                           (s->optics->frame_cols - s->optics->window_cols) / 2 + x + col / light, z + depth / light};
    return 1;
}

static int by_light(const void *a, const void *b)
{
    const candidate *one = a, *other = b;
    return (one->light < other->light) - (one->light > other->light);
}

static double lone_deviation(const search *s, int depth)
{
    return s->sigma / fmax(s->optics->norm[depth], 1e-300);
}

static hada_status add_candidate(search *s, const candidate *one, hada_error *err)
{
    HADA_TRY(HADA_GROW(s->candidates, (size_t)s->candidate_count, 1, what, err));
    s->candidates[s->candidate_count++] = *one;
    return HADA_OK;
}

static hada_status find_candidates(search *s, hada_error *err)
{
    for (int z = 0; z < s->optics->depths; z++) {
        const double least = CANDIDATE * s->limit * lone_deviation(s, z);
        for (int y = 0; y < s->optics->window_rows; y++)
            for (int x = 0; x < s->optics->window_cols; x++) {
                candidate one;
                if (voxel(s, z, y, x) > least / 27.0F && is_maximum(s, z, y, x, &one) && one.light > least)
                    HADA_TRY(add_candidate(s, &one, err));
            }
    }
    if (s->candidate_count)
        qsort(s->candidates, (size_t)s->candidate_count, sizeof *s->candidates, by_light);
    if (s->candidate_count > MOST_CANDIDATES)
        s->candidate_count = MOST_CANDIDATES;
    return HADA_OK;
}

/* The fit. */

static double moved(const hada_point *a, const hada_point *b)
{
    return fmax(fmax(fabs(a->row - b->row), fabs(a->col - b->col)), fabs(a->depth - b->depth));
}

static hada_status ensure(search *s, hada_error *err)
{
    const size_t unknowns = (size_t)s->count * UNKNOWNS + 1;
    HADA_TRY(HADA_GROW(s->touches, 0, (size_t)s->rooms * (size_t)s->most, what, err));
    if (unknowns > s->vector_room) {
        double **vectors[] = {&s->step, &s->gradient, &s->direction, &s->along, &s->whitened};
        s->vector_room = 0;
        for (size_t i = 0; i < sizeof vectors / sizeof *vectors; i++) {
            free(*vectors[i]);
            *vectors[i] = NULL;
            HADA_TRY(HADA_NEW(*vectors[i], unknowns, what, err));
        }
        s->vector_room = unknowns;
    }
    return HADA_OK;
}

/* Those that moved. */
static void render_all(search *s, double still)
{
    for (int i = 0; i < s->count; i++) {
        spot *one = &s->spots[i];
        if (one->is_drawn && !(moved(&one->at, &one->drawn) > still))
            continue;
        one->count = hada_point_render(s->renderer, &one->at, s->job->weights, s->touches + one->first);
        one->drawn = one->at;
        one->is_drawn = 1;
    }
}

/* What is left of the frame, and its cost. */
static void compare(search *s)
{
    const float *weights = s->job->weights;
    for (size_t p = 0; p < s->pixels; p++)
        s->left[p] = (float)(s->job->values[p] - s->offset);
    for (int i = 0; i < s->count; i++) {
        const spot *one = &s->spots[i];
        const float light = (float)one->light;
        for (const hada_touch *t = s->touches + one->first, *end = t + one->count; t < end; t++)
            s->left[t->pixel] -= light * t->by[LIGHT];
    }
    s->cost = 0.0;
    for (size_t p = 0; p < s->pixels; p++)
        s->cost += (double)weights[p] * s->left[p] * s->left[p];
}

/* d model / d unknown = scale * by. */
static double scale_of(const spot *one, int unknown)
{
    return unknown == LIGHT ? 1.0 : one->light;
}

/* Its block of the normal equations and its gradient. */
static void linearise(const search *s, spot *one, double *gradient)
{
    double sums[UNKNOWNS][UNKNOWNS] = {{0}}, slopes[UNKNOWNS] = {0};
    for (const hada_touch *t = s->touches + one->first, *end = t + one->count; t < end; t++) {
        const double weight = s->job->weights[t->pixel], left = weight * s->left[t->pixel];
        for (int i = 0; i < UNKNOWNS; i++) {
            slopes[i] += left * t->by[i];
            for (int j = 0; j < UNKNOWNS; j++)
                sums[i][j] += weight * t->by[i] * t->by[j];
        }
    }
    for (int i = 0; i < UNKNOWNS; i++) {
        gradient[i] = slopes[i] * scale_of(one, i);
        for (int j = 0; j < UNKNOWNS; j++)
            one->block[i][j] = sums[i][j] * scale_of(one, i) * scale_of(one, j);
    }
}

/* A diagonal that keeps what the frame says nothing of where it is: the depth of a camera of one, say. */
static double stiffness(const spot *one, int unknown, double damping)
{
    const double own = one->block[unknown][unknown];
    return damping * own + (own > 0.0 ? 0.0 : 1.0);
}

/* out = (J^T W J + damping) in. */
static void apply(const search *s, const double *in, double damping, double *out)
{
    const double offset = in[(size_t)s->count * UNKNOWNS];
    double sum = 0.0;
    for (size_t p = 0; p < s->pixels; p++)
        s->plane[p] = (float)offset;
    for (int i = 0; i < s->count; i++) {
        const spot *one = &s->spots[i];
        const double *x = in + (size_t)i * UNKNOWNS;
        const float a = (float)(x[0] * one->light), b = (float)(x[1] * one->light), c = (float)(x[2] * one->light),
                    d = (float)x[3];
        for (const hada_touch *t = s->touches + one->first, *end = t + one->count; t < end; t++)
            s->plane[t->pixel] += a * t->by[0] + b * t->by[1] + c * t->by[2] + d * t->by[3];
    }
    for (size_t p = 0; p < s->pixels; p++) {
        s->plane[p] *= s->job->weights[p];
        sum += s->plane[p];
    }
    for (int i = 0; i < s->count; i++) {
        const spot *one = &s->spots[i];
        double sums[UNKNOWNS] = {0};
        for (const hada_touch *t = s->touches + one->first, *end = t + one->count; t < end; t++)
            for (int k = 0; k < UNKNOWNS; k++)
                sums[k] += (double)s->plane[t->pixel] * t->by[k];
        for (int k = 0; k < UNKNOWNS; k++)
            out[(size_t)i * UNKNOWNS + (size_t)k] =
                sums[k] * scale_of(one, k) + stiffness(one, k, damping) * in[(size_t)i * UNKNOWNS + (size_t)k];
    }
    out[(size_t)s->count * UNKNOWNS] = sum;
}

/* The inverses of the blocks. */
static void precondition(const search *s, const double *in, double damping, double *out)
{
    for (int i = 0; i < s->count; i++) {
        const spot *one = &s->spots[i];
        double m[UNKNOWNS * UNKNOWNS], *x = out + (size_t)i * UNKNOWNS;
        memcpy(m, one->block, sizeof m);
        for (int k = 0; k < UNKNOWNS; k++) {
            x[k] = in[(size_t)i * UNKNOWNS + (size_t)k];
            m[k * UNKNOWNS + k] += stiffness(one, k, damping) + 1e-9 * one->block[k][k];
        }
        if (hada_cholesky_factor(m, UNKNOWNS))
            hada_cholesky_solve(m, UNKNOWNS, x);
        else
            memset(x, 0, UNKNOWNS * sizeof *x);
    }
    out[(size_t)s->count * UNKNOWNS] = in[(size_t)s->count * UNKNOWNS] / s->weight;
}

static double product(const double *a, const double *b, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum;
}

/* s->step, by conjugate gradients from s->gradient, which becomes what is left of it. */
static void solve(search *s, double damping)
{
    const size_t n = (size_t)s->count * UNKNOWNS + 1;
    memset(s->step, 0, n * sizeof *s->step);
    precondition(s, s->gradient, damping, s->whitened);
    memcpy(s->direction, s->whitened, n * sizeof *s->direction);
    double now = product(s->gradient, s->whitened, n);
    const double first = now;
    for (int i = 0; i < GRADIENTS && now > GRADIENT_LEFT * GRADIENT_LEFT * first; i++) {
        apply(s, s->direction, damping, s->along);
        const double curvature = product(s->direction, s->along, n);
        if (!(curvature > 0.0))
            return;
        for (size_t k = 0; k < n; k++) {
            s->step[k] += now / curvature * s->direction[k];
            s->gradient[k] -= now / curvature * s->along[k];
        }
        precondition(s, s->gradient, damping, s->whitened);
        const double next = product(s->gradient, s->whitened, n);
        for (size_t k = 0; k < n; k++)
            s->direction[k] = s->whitened[k] + next / now * s->direction[k];
        now = next;
    }
}

static double within(double value, double low, double high)
{
    return fmin(high, fmax(low, value));
}

/* Goes there, by a pixel and a depth at most, within the window and the depths. Returns the longest way. */
static double move(search *s)
{
    const hada_point_optics *o = s->optics;
    const double top = (o->frame_rows - o->window_rows) / 2 - 0.5, left = (o->frame_cols - o->window_cols) / 2 - 0.5;
    const double near = o->depths > 1 ? -0.5 * hada_magnification_beyond(&o->law, 0) : 0.0;
    const double far = o->depths > 1 ? o->depths - 1 + 0.5 * hada_magnification_beyond(&o->law, 1) : 0.0;
    double longest = 0.0;
    for (int i = 0; i < s->count; i++) {
        spot *one = &s->spots[i];
        const double *by = s->step + (size_t)i * UNKNOWNS;
        const hada_point old = one->at;
        one->at.row = within(old.row + within(by[ROW], -1.0, 1.0), top, top + o->window_rows);
        one->at.col = within(old.col + within(by[COL], -1.0, 1.0), left, left + o->window_cols);
        one->at.depth = within(old.depth + within(by[DEPTH], -1.0, 1.0), near, far);
        one->light = fmax(one->light + by[LIGHT], 1e-3 * one->light);
        longest = fmax(longest, moved(&one->at, &old));
    }
    s->offset += s->step[(size_t)s->count * UNKNOWNS];
    return longest;
}

static void linearise_all(search *s)
{
    double sum = 0.0;
    for (int i = 0; i < s->count; i++)
        linearise(s, &s->spots[i], s->gradient + (size_t)i * UNKNOWNS);
    for (size_t p = 0; p < s->pixels; p++)
        sum += (double)s->job->weights[p] * s->left[p];
    s->gradient[(size_t)s->count * UNKNOWNS] = sum;
}

static hada_status settle(search *s, int steps, hada_error *err)
{
    double damping = DAMPING, longest = INFINITY;
    HADA_TRY(ensure(s, err));
    render_all(s, STILL);
    compare(s);
    for (int i = 0; i < steps && longest > STILL; i++) {
        const double cost = s->cost, offset = s->offset;
        HADA_TRY(hada_monitor_check(s->job->monitor, err));
        linearise_all(s);
        solve(s, damping);
        for (int k = 0; k < s->count; k++)
            s->before[k] = s->spots[k];
        longest = move(s);
        render_all(s, STILL);
        compare(s);
        damping /= DAMPING_STEP;
        if (s->cost <= cost)
            continue;
        for (int k = 0; k < s->count; k++) {
            s->spots[k].at = s->before[k].at;
            s->spots[k].light = s->before[k].light;
        }
        s->offset = offset;
        render_all(s, 0.0);
        compare(s);
        damping *= DAMPING_STEP * DAMPING_STEP;
    }
    return HADA_OK;
}

/* Standard deviations. */

/* Of a pixel of weight 1. */
static double sigma_of(const search *s)
{
    return sqrt(s->cost / fmax((double)s->used - UNKNOWNS * (double)s->count - 1.0, 1.0));
}

/* What is left where an emitter's light falls: more than noise where the optics are not quite these, or others are
 * missing. Then less stands out. */
static void find_residuals(search *s)
{
    const double sigma = sigma_of(s);
    for (int i = 0; i < s->count; i++) {
        spot *one = &s->spots[i];
        double sum = 0.0, weighted = 0.0, squares = 0.0;
        for (const hada_touch *t = s->touches + one->first, *end = t + one->count; t < end; t++) {
            const double weight = s->job->weights[t->pixel], share = weight * t->by[LIGHT] * t->by[LIGHT];
            const double left = (double)s->left[t->pixel] * s->left[t->pixel];
            sum += share * left;
            weighted += share * weight * left;
            squares += share;
        }
        one->residual = squares > 0.0 ? sqrt(sum / squares) : 0.0;
        one->noise = squares > 0.0 ? fmax(sigma, sqrt(weighted / squares)) : sigma;
    }
}

/* The same of a point that would take so much light. */
static double noise_without(const search *s, const hada_touch *touches, int count, double light)
{
    double sum = 0.0, squares = 0.0;
    for (const hada_touch *t = touches; t < touches + count; t++) {
        const double weight = s->job->weights[t->pixel], share = weight * t->by[LIGHT] * t->by[LIGHT];
        const double left = s->left[t->pixel] - light * t->by[LIGHT];
        sum += share * weight * left * left;
        squares += share;
    }
    return squares > 0.0 ? fmax(sigma_of(s), sqrt(sum / squares)) : sigma_of(s);
}

static void spread(const search *s, const spot *one, int clear)
{
    for (const hada_touch *t = s->touches + one->first, *end = t + one->count; t < end; t++)
        for (int k = 0; k < UNKNOWNS; k++)
            s->dense[t->pixel][k] = clear ? 0.0F : s->job->weights[t->pixel] * t->by[k];
}

/* The nearest emitters, itself first; how many. */
static int find_neighbours(const search *s, int which, int list[NEIGHBOURS + 1])
{
    double distances[NEIGHBOURS + 1] = {0};
    int count = 1;
    list[0] = which;
    for (int i = 0; i < s->count; i++) {
        const hada_point *a = &s->spots[which].at, *b = &s->spots[i].at;
        const double distance = hypot(a->row - b->row, a->col - b->col);
        if (i == which || distance > NEIGHBOUR || (count > NEIGHBOURS && distance >= distances[NEIGHBOURS]))
            continue;
        int at = count > NEIGHBOURS ? NEIGHBOURS : count++;
        for (; at > 1 && distances[at - 1] > distance; at--) {
            distances[at] = distances[at - 1];
            list[at] = list[at - 1];
        }
        distances[at] = distance;
        list[at] = i;
    }
    return count;
}

/* From the inverse of the normal equations of an emitter and its neighbours. */
static void deviate(const search *s, int which)
{
    enum { MOST = (NEIGHBOURS + 1) * UNKNOWNS };
    int list[NEIGHBOURS + 1];
    const int number = find_neighbours(s, which, list), n = number * UNKNOWNS;
    double m[MOST * MOST] = {0};
    spot *own = &s->spots[which];
    for (int a = 0; a < number; a++) {
        const spot *one = &s->spots[list[a]];
        spread(s, one, 0);
        for (int b = a; b < number; b++) {
            const spot *other = &s->spots[list[b]];
            double sums[UNKNOWNS][UNKNOWNS] = {{0}};
            for (const hada_touch *t = s->touches + other->first, *end = t + other->count; t < end; t++)
                for (int i = 0; i < UNKNOWNS; i++)
                    for (int j = 0; j < UNKNOWNS; j++)
                        sums[i][j] += (double)s->dense[t->pixel][i] * t->by[j];
            for (int i = 0; i < UNKNOWNS; i++)
                for (int j = 0; j < UNKNOWNS; j++) {
                    const double value = sums[i][j] * scale_of(one, i) * scale_of(other, j);
                    m[(a * UNKNOWNS + i) * n + b * UNKNOWNS + j] = m[(b * UNKNOWNS + j) * n + a * UNKNOWNS + i] = value;
                }
        }
        spread(s, one, 1);
    }
    for (int i = 0; i < n; i++)
        m[i * n + i] = m[i * n + i] > 0.0 ? (1.0 + 1e-9) * m[i * n + i] : 1.0;
    const int known = hada_cholesky_factor(m, n);
    for (int k = 0; k < UNKNOWNS; k++) {
        double unit[MOST] = {0};
        unit[k] = 1.0;
        if (known)
            hada_cholesky_solve(m, n, unit);
        own->sd[k] = known ? own->noise * sqrt(fmax(unit[k], 0.0)) : INFINITY;
    }
    if (s->optics->depths == 1)
        own->sd[DEPTH] = 0.0;
}

/* In units of what an emitter must have: alone, and beside its neighbours. */
static double significance(const search *s, const spot *one)
{
    const double alone = one->light * sqrt(one->block[LIGHT][LIGHT]) / one->noise;
    const double beside = one->sd[LIGHT] > 0.0 ? one->light / one->sd[LIGHT] : INFINITY;
    return fmin(alone / s->limit, beside / BESIDE_OTHERS);
}

static int is_near(const hada_point *a, const hada_point *b, double pixels, double depths)
{
    return hypot(a->row - b->row, a->col - b->col) < pixels && fabs(a->depth - b->depth) < depths;
}

/* Drops those below the limit, the weakest of a neighbourhood at a time: the others gain by it. Returns how many. */
static int prune(search *s)
{
    int kept = 0, dropped = 0;
    find_residuals(s);
    for (int i = 0; i < s->count; i++)
        deviate(s, i);
    for (int i = 0; i < s->count; i++) {
        const spot *one = &s->spots[i];
        int drops = significance(s, one) < 1.0;
        for (int k = 0; k < s->count && drops; k++)
            if (k != i && is_near(&one->at, &s->spots[k].at, NEIGHBOUR, INFINITY) &&
                (significance(s, &s->spots[k]) < significance(s, one) ||
                 (k < i && significance(s, &s->spots[k]) == significance(s, one))))
                drops = 0;
        if (drops)
            s->before[dropped++] = *one;
        else
            s->before[s->count - 1 - kept++] = *one;
    }
    /* the rooms of the dropped ones come last */
    for (int i = 0; i < s->count; i++)
        s->spots[i] = s->before[s->count - 1 - i];
    s->count = kept;
    return dropped;
}

/* A candidate becomes an emitter if it is none yet, by the light that the frame has left for it. */
static hada_status take(search *s, candidate *one, const hada_point *at, double light, hada_error *err)
{
    /* dropped emitters stay behind the others, for their rooms: there are as many as rooms */
    HADA_TRY(HADA_GROW(s->spots, (size_t)s->rooms, 1, what, err));
    HADA_TRY(HADA_GROW(s->before, (size_t)s->rooms, 1, what, err));
    if ((size_t)(s->rooms + 1) * (size_t)s->most * sizeof *s->touches > MOST_BYTES)
        return hada_fail(err, HADA_ERROR_MEMORY,
                         "%d emitters and more, whose light falls on up to %d pixels each, take more than %zu MiB of "
                         "memory: is this a scene of points?",
                         s->count, s->most, MOST_BYTES >> 20);
    if (one)
        one->taken = 1;
    for (int i = 0; i < s->count; i++)
        if (is_near(at, &s->spots[i].at, NEIGHBOUR, INFINITY))
            s->spots[i].single = 0;
    const size_t first = s->count < s->rooms ? s->spots[s->count].first : (size_t)s->rooms++ * (size_t)s->most;
    s->spots[s->count++] = (spot){.at = *at, .light = light, .first = first};
    return HADA_OK;
}

static int is_known(const search *s, const hada_point *at)
{
    for (int i = 0; i < s->count; i++)
        if (is_near(at, &s->spots[i].at, SAME, SAME))
            return 1;
    return 0;
}

/* The first ones: as bright as the limit asks for. */
static hada_status take_bright(search *s, hada_error *err)
{
    for (int i = 0; i < s->candidate_count; i++) {
        candidate *one = &s->candidates[i];
        const int depth = (int)(one->at.depth + 0.5);
        if (one->light > s->limit * lone_deviation(s, depth) && !is_known(s, &one->at))
            HADA_TRY(take(s, one, &one->at, one->light, err));
    }
    return HADA_OK;
}

/* Then those that stand out of what is left: by the matched filter. */
static hada_status take_left(search *s, int *taken, hada_error *err)
{
    const double sigma = sigma_of(s);
    hada_touch *room = NULL;
    hada_status status = HADA_OK;
    *taken = 0;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(room, (size_t)s->most, what, err));
    for (int i = 0; i < s->candidate_count; i++) {
        candidate *one = &s->candidates[i];
        double light = 0.0, squares = 0.0;
        if (one->taken || is_known(s, &one->at))
            continue;
        const int count = hada_point_render(s->renderer, &one->at, s->job->weights, room);
        for (const hada_touch *t = room; t < room + count; t++) {
            const double weighted = (double)s->job->weights[t->pixel] * t->by[LIGHT];
            light += weighted * s->left[t->pixel];
            squares += weighted * t->by[LIGHT];
        }
        if (light > s->limit * sigma * sqrt(squares) &&
            light > s->limit * noise_without(s, room, count, light / squares) * sqrt(squares)) {
            HADA_TRY_OR_DONE(take(s, one, &one->at, light / squares, err));
            ++*taken;
        } else if (light < HOPELESS * s->limit * sigma * sqrt(squares)) {
            one->taken = 1;
        }
    }
done:
    free(room);
    return status;
}

/* How far a point at `at` stands out of what is left, in standard deviations, beside an emitter whose unknowns may take
 * its part (spread); *light: what it would have. */
static double stands_out(const search *s, const spot *beside, const hada_point *at, hada_touch *room, double *light)
{
    double sum = 0.0, squares = 0.0, shared[UNKNOWNS] = {0}, explained[UNKNOWNS], m[UNKNOWNS * UNKNOWNS];
    const int count = hada_point_render(s->renderer, at, s->job->weights, room);
    for (const hada_touch *t = room; t < room + count; t++) {
        const double weighted = (double)s->job->weights[t->pixel] * t->by[LIGHT];
        sum += weighted * s->left[t->pixel];
        squares += weighted * t->by[LIGHT];
        for (int k = 0; k < UNKNOWNS; k++)
            shared[k] += (double)s->dense[t->pixel][k] * t->by[LIGHT];
    }
    for (int k = 0; k < UNKNOWNS; k++)
        explained[k] = shared[k] *= scale_of(beside, k);
    memcpy(m, beside->block, sizeof m);
    for (int k = 0; k < UNKNOWNS; k++)
        m[k * UNKNOWNS + k] += stiffness(beside, k, 1e-6);
    if (!hada_cholesky_factor(m, UNKNOWNS))
        return 0.0;
    hada_cholesky_solve(m, UNKNOWNS, explained);
    const double own = squares - product(shared, explained, UNKNOWNS);
    if (!(own > LEAST_OWN * squares))
        return 0.0;
    *light = sum / own;
    return sum / (sigma_of(s) * sqrt(own)); /* where two were taken for one, more than noise is left */
}

/* What was taken for one emitter may be two. */
static hada_status take_second(search *s, int *taken, hada_error *err)
{
    static const double offsets[][3] = {{-1, 0, 0}, {1, 0, 0}, {0, -1, 0}, {0, 1, 0}, {0, 0, -1}, {0, 0, 1}};
    const int count = s->count;
    hada_touch *room = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(room, (size_t)s->most, what, err));
    for (int i = 0; i < count; i++) {
        const spot one = s->spots[i];
        if (one.single)
            continue;
        hada_point best = one.at;
        double most = s->limit, best_light = 0.0, light = 0.0;
        spread(s, &one, 0);
        for (size_t k = 0; k < HADA_COUNT(offsets); k++) {
            const hada_point at = {one.at.row + SECOND * offsets[k][0], one.at.col + SECOND * offsets[k][1],
                                   one.at.depth + SECOND * offsets[k][2]};
            if (at.depth < 0.0 || at.depth > s->optics->depths - 1)
                continue;
            const double score = stands_out(s, &one, &at, room, &light);
            if (score > most) {
                most = score;
                best = at;
                best_light = light;
            }
        }
        spread(s, &one, 1);
        if (best_light > 0.0 && !is_known(s, &best)) {
            HADA_TRY_OR_DONE(take(s, NULL, &best, fmin(best_light, 0.5 * one.light), err));
            ++*taken;
        } else {
            s->spots[i].single = 1;
        }
    }
done:
    free(room);
    return status;
}

static int by_amplitude(const void *a, const void *b)
{
    const hada_emitter *one = a, *other = b;
    return (one->amplitude < other->amplitude) - (one->amplitude > other->amplitude);
}

static double distance_of(const hada_point_optics *o, double depth)
{
    if (!o->known_distances)
        return NAN;
    if (o->depths == 1)
        return 1.0 / o->law.inverse[0];
    const int low = (int)within(floor(depth), 0.0, o->depths - 2);
    return 1.0 / (o->law.inverse[low] + (depth - low) * (o->law.inverse[low + 1] - o->law.inverse[low]));
}

static hada_status give(const search *s, hada_emitters **out, hada_error *err)
{
    const hada_point_optics *o = s->optics;
    const size_t count = (size_t)s->count;
    hada_emitters *all = hada_alloc(1, sizeof *all + count * (sizeof(hada_emitter) + sizeof *all->list), what, err);
    HADA_TRY(hada_allocated(all));
    hada_emitter *rows = (hada_emitter *)(all + 1); /* behind it in its block, and their places behind them */
    const hada_emitter **list = (const hada_emitter **)(rows + count);
    for (size_t i = 0; i < count; i++) {
        const spot *one = &s->spots[i];
        rows[i] = (hada_emitter){.x = one->at.col - (o->frame_cols - o->window_cols) / 2,
                                 .y = one->at.row - (o->frame_rows - o->window_rows) / 2,
                                 .z = one->at.depth,
                                 .distance_mm = distance_of(o, one->at.depth),
                                 .amplitude = one->light,
                                 .sd_x = one->sd[COL],
                                 .sd_y = one->sd[ROW],
                                 .sd_z = one->sd[DEPTH],
                                 .sd_amplitude = one->sd[LIGHT],
                                 .residual = one->residual};
        list[i] = &rows[i];
    }
    if (count)
        qsort(rows, count, sizeof *rows, by_amplitude);
    all->count = s->count;
    all->list = list;
    *out = all;
    return HADA_OK;
}

static hada_status begin(search *s, hada_error *err)
{
    const size_t voxels = (size_t)s->optics->window_rows * (size_t)s->optics->window_cols * (size_t)s->optics->depths;
    s->pixels = (size_t)s->optics->frame_rows * (size_t)s->optics->frame_cols;
    s->most = hada_point_most(s->optics);
    s->limit = hada_focus_normal_quantile(FALSE_ALARM / (double)voxels);
    for (size_t p = 0; p < s->pixels; p++) {
        s->used += s->job->weights[p] > 0.0F;
        s->weight += s->job->weights[p];
    }
    HADA_TRY(hada_point_renderer_create(&s->renderer, s->optics, err));
    HADA_TRY(HADA_NEW(s->left, s->pixels, what, err));
    HADA_TRY(HADA_NEW(s->plane, s->pixels, what, err));
    return HADA_NEW(s->dense, s->pixels, what, err);
}

static void end(search *s)
{
    hada_point_renderer_destroy(&s->renderer);
    HADA_FREE(s->left, s->plane, s->dense, s->candidates, s->spots, s->before, s->touches, s->step, s->gradient,
              s->direction, s->along, s->whitened);
}

static hada_status search_all(search *s, hada_error *err)
{
    int taken;
    s->sigma = s->job->noise;
    HADA_TRY(find_candidates(s, err));
    HADA_TRY(take_bright(s, err));
    for (int round = 0; round < ROUNDS; round++) {
        HADA_TRY(settle(s, STEPS, err));
        if (prune(s))
            HADA_TRY(settle(s, 1, err));
        HADA_TRY(take_left(s, &taken, err));
        HADA_TRY(take_second(s, &taken, err));
        if (!taken)
            break;
    }
    do
        HADA_TRY(settle(s, LAST_STEPS, err));
    while (prune(s));
    return HADA_OK;
}

hada_status hada_emitters_find(hada_emitters **out, const hada_emitters_job *job, hada_error *err)
{
    search s = {.job = job, .optics = job->optics};
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(begin(&s, err));
    if (s.used)
        HADA_TRY_OR_DONE(search_all(&s, err));
    HADA_TRY_OR_DONE(give(&s, out, err));
done:
    end(&s);
    return status;
}
