/* Registration of the pairs of one depth; registered scenes. */
#include "core/callers.h"
#include "register/register_inside.h"

/* Shifts between depths, from their PSFs. */

hada_status hada_register_psf(hada_image *psf, double *pitch, const hada_image *raws, const hada_image *scenes,
                              int count, const hada_registration *registration, hada_error *err)
{
    hada_register_set set = {0};
    hada_register_level level = {0};
    hada_status status = HADA_OK;
    if (!(registration->magnification > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a magnification of %g is not possible",
                         registration->magnification);
    *psf = (hada_image){0};
    HADA_TRY_OR_DONE(hada_register_set_create(&set, raws, scenes, count, err));
    int size = HADA_REGISTER_COARSE;
    while (size < HADA_REGISTER_FINEST && 2 * size <= 1.2 * set.frame_side)
        size *= 2;
    HADA_TRY_OR_DONE(hada_register_level_create(&level, &set, size, err));
    HADA_TRY_OR_DONE(hada_register_level_take(&level, registration, err));
    HADA_TRY_OR_DONE(hada_image_create(psf, 1, size - 1, size - 1, err));
    hada_register_level_psf(&level, psf->data);
    *pitch = level.pitch;
done:
    hada_register_level_destroy(&level);
    hada_register_set_destroy(&set);
    return status;
}

/* Two PSFs on a grid that holds both without wrapping half of them. */
typedef struct match {
    hada_small_fft fft;
    hada_register_plane plane; /* the one that is scaled */
    float *work, *other;       /* complex: the transform of the other one */
    int side;
    double other_energy;
} match;

typedef struct peak {
    double log_scale, row, col, likeness;
} peak;

static double energy_of(const float *x, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += (double)x[2 * i] * x[2 * i];
    return sum;
}

/* The largest correlation coefficient over all shifts, at one scale. */
static hada_status correlate(match *m, peak *at, hada_error *err)
{
    const int n = m->fft.size;
    const size_t area = (size_t)n * (size_t)n;
    const double per = exp(-at->log_scale);
    const hada_register_map map = {.inverse = {{per, 0}, {0, per}}};
    hada_register_view view;
    HADA_TRY(hada_register_view_create(&view, &m->plane, per, err));
    memset(m->work, 0, 2 * area * sizeof(float));
    hada_register_sample(&view, &map, 1.0, m->side, m->side, m->work, 2 * n, 2);
    hada_register_view_destroy(&view);
    const double energy = energy_of(m->work, area) * m->other_energy;
    hada_small_fft_run(&m->fft, m->work);
    const double most = hada_small_fft_match(&m->fft, m->work, m->other, &at->row, &at->col);
    at->likeness = energy > 0.0 ? most / sqrt(energy) : 0.0;
    return HADA_OK;
}

/* Every scale from 0.4 to 2.5, then the best one by golden section. */
static hada_status find(match *m, peak *best, hada_error *err)
{
    enum { SCALES = 46, SECTIONS = 12 };
    const double widest = log(2.5), step = 2.0 * widest / SCALES, golden = 0.5 * (sqrt(5.0) - 1.0);
    best->likeness = -1.0;
    for (int i = 0; i <= SCALES; i++) {
        peak at = {.log_scale = step * i - widest};
        HADA_TRY(correlate(m, &at, err));
        if (at.likeness > best->likeness)
            *best = at;
    }
    double low = best->log_scale - step, high = best->log_scale + step;
    peak a = {.log_scale = high - golden * (high - low)}, b = {.log_scale = low + golden * (high - low)};
    HADA_TRY(correlate(m, &a, err));
    HADA_TRY(correlate(m, &b, err));
    for (int i = 0; i < SECTIONS; i++) {
        if (a.likeness > b.likeness) {
            high = b.log_scale;
            b = a;
            a.log_scale = high - golden * (high - low);
            HADA_TRY(correlate(m, &a, err));
        } else {
            low = a.log_scale;
            a = b;
            b.log_scale = low + golden * (high - low);
            HADA_TRY(correlate(m, &b, err));
        }
    }
    const peak *finest = a.likeness > b.likeness ? &a : &b;
    if (finest->likeness > best->likeness)
        *best = *finest;
    return HADA_OK;
}

hada_status hada_register_offset(const hada_image *psf, const hada_image *other, double pitch, double *scale,
                                 double *row, double *col, double *likeness, hada_error *err)
{
    if (!psf || !other || !psf->data || !other->data || psf->channels != 1 || other->channels != 1 ||
        psf->rows != psf->cols || psf->rows != other->rows || psf->cols != other->cols || !scale || !row || !col ||
        !likeness)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_register_offset: two PSFs of one size from hada_register_psf() are needed");
    match m = {.side = psf->rows};
    peak best = {0};
    int n = 2;
    while (n < 2 * psf->rows)
        n *= 2;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_small_fft_create(&m.fft, n, err));
    HADA_TRY_OR_DONE(hada_register_plane_create(&m.plane, psf->data, psf->rows, psf->cols, err));
    HADA_TRY_OR_DONE(HADA_NEW(m.work, 2 * (size_t)n * (size_t)n, "a transform", err));
    HADA_TRY_OR_DONE(HADA_NEW(m.other, 2 * (size_t)n * (size_t)n, "a transform", err));
    m.other_energy = hada_small_fft_put(&m.fft, other, m.other);
    HADA_TRY_OR_DONE(find(&m, &best, err));
    *scale = exp(best.log_scale);
    *row = best.row * pitch;
    *col = best.col * pitch;
    *likeness = best.likeness > 0.0 ? best.likeness : 0.0;
done:
    HADA_FREE(m.work, m.other);
    hada_register_plane_destroy(&m.plane);
    hada_small_fft_destroy(&m.fft);
    return status;
}

/* From coarse to fine: every orientation, magnification and rotation on a small grid, then the best ones refined. */

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

/* Improves magnification and rotation, about `step` (of log magnification, and in radians) around, within the options'
 * range and one coarse step beyond. slantwise: the perspective as well. */
static hada_status register_refine(hada_register_level *level, const hada_register_options *options, int slantwise,
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

/* The best magnification and rotation of each of the eight orientations (4 * mirrored + quarter turns) and its score.
 */
static hada_status register_scan(hada_register_level *level, const hada_register_options *options,
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

/* The best orientation must explain this many times as much (in log residual) as the second best, and this much. */
#define CLEARLY 1.5
#define LEAST   0.01
/* Perspective is taken where it explains this many times as much (in log residual). Without any, up to 1.02,
 * and more where scenes are small, which it does not move by a pixel then. */
#define SLANTWISE 1.03

static hada_status check_options(hada_register_options *options, const hada_image *raws, const hada_image *scenes,
                                 hada_error *err)
{
    const double frame = raws->rows > raws->cols ? raws->rows : raws->cols;
    const double scene = scenes->rows > scenes->cols ? scenes->rows : scenes->cols;
    if (options->least_magnification == HADA_AUTO)
        options->least_magnification = 0.15 * frame / scene;
    if (options->most_magnification == HADA_AUTO)
        options->most_magnification = 2.5 * frame / scene;
    if (!(options->least_magnification > 0.0) || !(options->most_magnification >= options->least_magnification) ||
        !(options->most_magnification <= 1000.0 * options->least_magnification))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "magnifications from %g to %g cannot be searched",
                         options->least_magnification, options->most_magnification);
    if (!(options->most_rotation_deg >= 0.0 && options->most_rotation_deg <= 45.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.rotation takes 0 to 45 degrees, to either side of every quarter turn, not %g",
                         options->most_rotation_deg);
    return HADA_OK;
}

static void keep_best(hada_registration *best, double *scores, int count)
{
    for (int i = 1; i < count; i++)
        for (int k = i; k && scores[k] < scores[k - 1]; k--) {
            const hada_registration one = best[k];
            const double score = scores[k];
            best[k] = best[k - 1];
            scores[k] = scores[k - 1];
            best[k - 1] = one;
            scores[k - 1] = score;
        }
}

/* Whether there is a grid of this size for the frames. */
static int is_fine(const hada_register_set *set, int size)
{
    return size <= HADA_REGISTER_FINEST && size <= 1.2 * set->frame_side;
}

/* All orientations on the coarse grid; the best three refined there. */
static hada_status search_all(const hada_register_set *set, const hada_register_options *options,
                              hada_registration *out, double *score, hada_error *err)
{
    enum { REFINED = 3 };
    hada_register_level level = {0};
    hada_registration best[8];
    double scores[8];
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_register_level_create(&level, set, HADA_REGISTER_COARSE, err));
    HADA_TRY_OR_DONE(register_scan(&level, options, best, scores, err));
    keep_best(best, scores, 8);
    for (int o = 0; o < REFINED; o++)
        HADA_TRY_OR_DONE(register_refine(&level, options, 0, 0.5 * HADA_REGISTER_STEP, &best[o], &scores[o], err));
    keep_best(best, scores, REFINED);
    *out = best[0];
    *score = scores[0];
    out->size = sizeof *out;
    out->explained = 1.0 - exp(scores[0]);
    out->explained_otherwise = 1.0 - exp(scores[1]);
    if (-scores[0] < LEAST || -scores[0] < CLEARLY * -scores[1])
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_DATASET,
                      "the pairs do not show where the scenes lie: the best transform explains %.1f %% of the "
                      "frames' structure, another orientation %.1f %%. More pairs help, and scenes with more "
                      "detail and without symmetry; scenes may also belong to other frames, or lie outside the "
                      "range searched (magnification %.3g to %.3g)",
                      100.0 * out->explained, 100.0 * out->explained_otherwise, options->least_magnification,
                      options->most_magnification));
done:
    hada_register_level_destroy(&level);
    return status;
}

double hada_register_perspective(const hada_registration *at, int rows, int cols)
{
    const double far = 0.5 * at->magnification * hypot(rows, cols);
    return far * far * hypot(at->perspective_row, at->perspective_col);
}

hada_status hada_register_pairs(hada_registration *out, const hada_image *raws, const hada_image *scenes, int count,
                                const hada_register_options *given, hada_error *err)
{
    hada_register_options options = *given;
    hada_register_set set = {0};
    hada_register_level level = {0};
    hada_status status = HADA_OK;
    hada_registration slantwise;
    double score, slant_score = 0.0;
    hada_registration_init(out);
    HADA_TRY_OR_DONE(hada_register_set_create(&set, raws, scenes, count, err));
    HADA_TRY_OR_DONE(check_options(&options, raws, scenes, err));
    HADA_TRY_OR_DONE(search_all(&set, &options, out, &score, err));
    slantwise = *out;
    for (int size = HADA_REGISTER_COARSE; size == HADA_REGISTER_COARSE || is_fine(&set, size); size *= 2) {
        const double step = HADA_REGISTER_STEP * HADA_REGISTER_COARSE / size;
        HADA_TRY_OR_DONE(hada_register_level_create(&level, &set, size, err));
        if (size > HADA_REGISTER_COARSE)
            HADA_TRY_OR_DONE(register_refine(&level, &options, 0, 0.25 * step, out, &score, err));
        HADA_TRY_OR_DONE(register_refine(&level, &options, 1, step, &slantwise, &slant_score, err));
        if (size == HADA_REGISTER_COARSE) /* the grid on which orientations are compared */
            slantwise.explained = 1.0 - exp(slant_score);
        hada_register_level_destroy(&level);
    }
    if (slant_score < SLANTWISE * score && hada_register_perspective(&slantwise, scenes->rows, scenes->cols) >= 1.0)
        *out = slantwise;
done:
    hada_register_level_destroy(&level);
    hada_register_set_destroy(&set);
    return status;
}

void hada_register_size(const hada_registration *registration, int scene_rows, int scene_cols, int *rows, int *cols)
{
    if (!registration || !rows || !cols)
        return;
    const int turned = registration->quarter_turns & 1;
    const double height = registration->magnification * (turned ? scene_cols : scene_rows);
    const double width = registration->magnification * (turned ? scene_rows : scene_cols);
    *rows = height < 1.0 ? 1 : (int)floor(height + 0.5);
    *cols = width < 1.0 ? 1 : (int)floor(width + 0.5);
}

hada_status hada_register_apply(hada_image *out, const hada_image *scene, const hada_registration *callers, int rows,
                                int cols, hada_error *err)
{
    hada_registration own, *registration = &own;
    hada_register_plane plane = {0};
    hada_register_view view = {0};
    hada_status status = HADA_OK;
    hada_registration_init(registration);
    HADA_TRY(HADA_OPTIONS_TAKE(registration, callers, hada_registration, err));
    HADA_NEED(out && callers, err);
    HADA_NEED_IMAGE(scene, out, err);
    if (!(registration->magnification > 0.0 && isfinite(registration->magnification)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "registration.magnification is %g; it is above 0",
                         registration->magnification);
    if (!rows && !cols)
        hada_register_size(registration, scene->rows, scene->cols, &rows, &cols);
    HADA_TRY_OR_DONE(hada_image_create(out, scene->channels, rows, cols, err));
    const hada_register_map map = hada_register_map_of(registration);
    for (int c = 0; c < scene->channels; c++) {
        HADA_TRY_OR_DONE(hada_register_plane_create(&plane,
                                                    scene->data + (size_t)c * (size_t)scene->rows * (size_t)scene->cols,
                                                    scene->rows, scene->cols, err));
        HADA_TRY_OR_DONE(hada_register_view_create(&view, &plane, 1.0 / registration->magnification, err));
        hada_register_sample(&view, &map, 1.0, rows, cols, out->data + (size_t)c * (size_t)rows * (size_t)cols, cols,
                             1);
        hada_register_view_destroy(&view);
        hada_register_plane_destroy(&plane);
    }
done:
    hada_register_view_destroy(&view);
    hada_register_plane_destroy(&plane);
    if (status)
        hada_image_destroy(out);
    return status;
}
