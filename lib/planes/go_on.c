/* Frames of a sequence go on from the one before, in fewer steps the less has changed (docs/explanation/refinement.md).
 * What was found by trial: perf/results/sequences.md. */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "planes/maker.h"

/* If the last planes leave more than this part of a new frame, and FEW times what they left of the last one, it is
 * another scene. */
#define CUT 0.07
#define FEW 4.0

/* What planes leave of a new frame of the same scene, in units of what they left of their own, at most: they fitted
 * noise of that one by as much as they are values of its. It was 1.13 where this is 1.27, and 1.33 for 1.46. */
static double of_still(const hada_model_info *info, int planes)
{
    static const double most = 0.5;
    const double window = (double)info->window_rows * info->window_cols, raw = (double)info->raw_rows * info->raw_cols;
    const double share = planes * window / raw < most ? planes * window / raw : most;
    return (1.0 + share) / (1.0 - share);
}

/* Where nothing moved, two steps with a larger rho are enough, and make the planes a mean over frames. One is for a
 * single depth; where a sensor crops the light beyond the frame lags then, which lost up to 5 dB when something moved,
 * and several depths lost 0.6 dB when brightness changed. Where something did, rho begins as from nothing, so that all
 * may move; several depths have parted before. `before` says so.
 */
enum { STILL_STEPS = 2, STILL_STEPS_ALONE = 1, HALVED_FROM = 3, SETTLED = 100, PARTED = 7 };
#define FIRM         2.0
#define FIRM_SEVERAL 8.0
#define FIRM_CROPPED 1.7

/* A scene that moved as a whole: steps from planes that moved as well, with the usual rho, or with that of still scenes
 * where there are several depths: with the usual one what they share out is lost. Motion by fewer pixels does not
 * count; it has to be found (MOST_DRIFT_REST; where a scene has no edges in a direction, each look finds a small part,
 * LEAST_DRIFT_PART), and to be the same at all depths (MOST_DRIFT_APART, refine/shift.h; 0.05 at most where it was, 0.1
 * and more where one depth moved otherwise). What is left has to be little (of several depths a third above the least:
 * fine detail that moves by parts of a pixel, which no shift makes, left more and lost 0.7 dB), and alike in all
 * places: noise left a spread of up to 1.13 over places and 2.3 times the mean at most, an object of a twentieth of the
 * contrast 6 and 11.
 */
enum { DRIFT_STEPS = 3, DRIFT_STEPS_SEVERAL = 2 };
#define LEAST_DRIFT       0.04
#define MOST_DRIFT_SPREAD 1.3
#define MOST_DRIFT_PLACE  3.0
#define MOST_DRIFT_REST   0.1
#define MOST_DRIFT_APART  0.08
#define LEAST_DRIFT_PART  0.3

/* Brightness that changes by less is not followed at once; a scene that moves as a whole changes it by what enters. */
#define LEAST_GAIN       0.002
#define LEAST_DRIFT_GAIN 0.008

/* Steps with the learned regulariser, after planes that are a mean over frames. */
enum { RIDGE_STILL = 1, RIDGE_DRIFT = 2 };

/* What does not move as a whole is not asked so in the next frame, the next three ones and so on, up to so many times.
 */
enum { MOST_VAIN = 4 };

/* A depth that appears is found within three frames. */
enum { FOLLOWED = 2 };

/* The least that planes left of their frame since something moved. */
static double least_of(const hada_maker_past *past)
{
    return past->least < 0.0 || past->left < past->least ? past->left : past->least;
}

/* What planes may leave of a frame in which nothing moved. */
static double few_of(const hada_plane_maker *maker, const hada_maker_past *past)
{
    return of_still(hada_model_get_info(maker->model), past->count) * least_of(past);
}

/* The same where all moved. */
static double few_if_moved(const hada_plane_maker *maker, const hada_maker_past *past)
{
    const double all = few_of(maker, past), least = least_of(past);
    return past->count > 1 ? least + (all - least) / 3.0 : all;
}

/* Energies of the same scene tell its brightness; 1: the change is too small. */
static double light_of(const hada_plane_maker *maker, const hada_frame_exposure *exposure, const hada_maker_past *past,
                       double least)
{
    const double times = sqrt(exposure->energy / past->energy);
    return fabs(times - 1.0) > least && hada_refiner_knows_light(maker->refiner, &maker->data) ? times : 1.0;
}

/* If planes, of which the residual is there (*left), leave few of the frame's energy in its light, they and what is
 * remembered become so many times as bright. */
static hada_status follow_light(hada_plane_maker *maker, const hada_frame_exposure *exposure, hada_maker_past *past,
                                double times, double few, double *left, hada_error *err)
{
    double then = *left * exposure->energy;
    if (times == 1.0)
        return HADA_OK;
    HADA_TRY(hada_refiner_left_if(maker->refiner, &maker->data, past->count, exposure->energy, times, &then, err));
    then /= exposure->energy;
    if (!(then < few * fmax(1.0, 1.0 / (times * times)) && then < *left)) /* noise may be as it was */
        return HADA_OK;
    *left = then;
    past->gain = times;
    past->energy = exposure->energy;
    past->least = -1.0;
    past->left *= fmax(1.0, 1.0 / (times * times));
    return hada_refiner_brighten(maker->refiner, times, err);
}

/* Brings the last planes back: past->now. */
static hada_status look_back(hada_plane_maker *maker, const hada_frame_exposure *exposure, int count, const int *list,
                             hada_maker_past *past, hada_error *err)
{
    if (past->now >= 0.0)
        return HADA_OK;
    HADA_TRY(hada_maker_weigh(maker, exposure, err));
    HADA_TRY(hada_refiner_recall(maker->refiner, err));
    HADA_TRY(hada_refiner_residual(maker->refiner, &maker->data, 1, count, list, &past->now, err));
    past->now /= exposure->energy;
    HADA_TRY(follow_light(maker, exposure, past, light_of(maker, exposure, past, LEAST_GAIN), few_of(maker, past),
                          &past->now, err));
    return past->gain != 1.0 ? hada_refiner_recall(maker->refiner, err) : HADA_OK;
}

/* It did not move as a whole: the refiner has what is remembered as it was. */
static hada_status in_vain(hada_plane_maker *maker, hada_maker_past *past, hada_error *err)
{
    past->follows = past->drifts = 0;
    past->vain += past->vain < MOST_VAIN;
    past->wait = (1 << past->vain) - 1;
    return hada_refiner_recall(maker->refiner, err);
}

/* If the scene moved as a whole, what is remembered of it moves as well: past->follows, and past->now is what it leaves
 * there. Else the refiner has it as it was. */
static hada_status follow_drift(hada_plane_maker *maker, const hada_frame_exposure *exposure, int count,
                                const int *list, hada_maker_past *past, hada_error *err)
{
    const double times = light_of(maker, exposure, past, LEAST_DRIFT_GAIN);
    hada_refine_motion *motion = &past->motion;
    past->asked = 1;
    if (!past->drifts)
        *motion = (hada_refine_motion){0};
    HADA_TRY(hada_refiner_find_motion(maker->refiner, &maker->data, hada_model_gain(maker->model), count, list, motion,
                                      err));
    if (times != 1.0)
        HADA_TRY(hada_refiner_residual(maker->refiner, &maker->data, 1, count, list, &motion->left, err));
    motion->left /= exposure->energy;
    HADA_TRY(follow_light(maker, exposure, past, times, few_if_moved(maker, past), &motion->left, err));
    past->follows = past->drifts = hypot(motion->shift[0], motion->shift[1]) > LEAST_DRIFT &&
                                   motion->left < past->now && motion->left < few_if_moved(maker, past) &&
                                   motion->spread < MOST_DRIFT_SPREAD && motion->most < MOST_DRIFT_PLACE &&
                                   motion->rest < MOST_DRIFT_REST && motion->apart < MOST_DRIFT_APART &&
                                   fmin(motion->part[0], motion->part[1]) > LEAST_DRIFT_PART;
    if (!past->follows)
        return in_vain(maker, past, err);
    past->now = motion->left;
    return hada_refiner_move(maker->refiner, &maker->data, count, motion, err);
}

hada_status hada_maker_expects(hada_plane_maker *maker, const hada_frame_exposure *exposure, const int *list,
                               hada_maker_past *past, int *same, hada_error *err)
{
    *same = past->left >= 0.0 && !past->moved && past->followed < FOLLOWED && exposure->energy > 0.0 &&
            hada_refiner_remembers(maker->refiner, past->count, list);
    if (*same) {
        HADA_TRY(look_back(maker, exposure, past->count, list, past, err));
        if (past->drifts)
            HADA_TRY(follow_drift(maker, exposure, past->count, list, past, err));
        *same = past->follows || past->now < few_of(maker, past);
    }
    past->followed = *same ? past->followed + 1 : 0;
    past->now = *same ? past->now : -1.0; /* what follows needs the memory */
    return HADA_OK;
}

/* Goes on from what the refiner has, by so many steps. */
static hada_status resume(const hada_plane_maker *maker, hada_maker_steps *own, double unit, int count, const int *list,
                          int *done, hada_error *err)
{
    int made;
    own->resume = 1;
    HADA_TRY(hada_maker_refine(maker, own, unit, count, list, &made, err));
    *done += made;
    return HADA_OK;
}

/* A few steps, by which the planes become a mean over frames. */
static hada_status settle(hada_plane_maker *maker, hada_maker_steps *own, double unit, int count, const int *list,
                          const hada_maker_past *past, int steps, double firm, int *done, hada_error *err)
{
    own->steps = past->steps < steps ? past->steps : steps;
    own->before = SETTLED;
    own->firm = firm;
    own->hasten = 1.0;
    return resume(maker, own, unit, count, list, done, err);
}

static int still_steps(const hada_plane_maker *maker, int count)
{
    return maker->boundary == HADA_BOUNDARY_PADDED || count > 1 ? STILL_STEPS : STILL_STEPS_ALONE;
}

/* rho of still scenes and of those that move as a whole, in units of the usual one; alone: of a single depth where
 * light wraps around. Where the sensor crops, the usual one is that of a looser split, which they do not have. */
static double firm_of(const hada_plane_maker *maker, int count, double alone)
{
    return count > 1 ? FIRM_SEVERAL : maker->boundary == HADA_BOUNDARY_PADDED ? FIRM_CROPPED * alone : alone;
}

/* Where nothing seems to move; past->moved: something did. */
static hada_status stay(hada_plane_maker *maker, hada_maker_steps *own, double unit, int count, const int *list,
                        hada_maker_past *past, int doubt, int *done, hada_error *err)
{
    HADA_TRY(
        settle(maker, own, unit, count, list, past, still_steps(maker, count), firm_of(maker, count, FIRM), done, err));
    HADA_TRY(hada_refiner_moved(maker->refiner, NULL, doubt, &past->moved, err));
    /* slow motion that all share, which places do not tell */
    if (!past->moved && hada_refiner_knows_motion(maker->refiner, &maker->data)) {
        double creep[2];
        HADA_TRY(hada_refiner_creep(maker->refiner, count, creep, err));
        past->moved = hypot(creep[0], creep[1]) > LEAST_DRIFT;
    }
    if (past->moved) /* duals of what lags are of no use to a smaller rho */
        return hada_refiner_recall(maker->refiner, err);
    past->ridge = RIDGE_STILL;
    return HADA_OK;
}

/* Where something moved: half the steps. */
static hada_status move_on(hada_plane_maker *maker, hada_maker_steps *own, double unit, int count, const int *list,
                           hada_maker_past *past, int *done, hada_error *err)
{
    const int padded = maker->boundary == HADA_BOUNDARY_PADDED;
    past->least = -1.0;
    own->steps = past->steps < HALVED_FROM ? past->steps : past->steps / 2 + 1;
    own->before = count > 1 ? PARTED : 0;
    own->firm = 1.0;
    /* light beyond the frame settles while rho grows, which it does as far in fewer steps */
    own->hasten = padded ? (double)past->steps / own->steps : 1.0;
    if (padded && count == 1) /* what duals keep beyond the frame would grow from frame to frame, to 1 dB in ten */
        HADA_TRY(hada_refiner_begin_from_planes(maker->refiner, &maker->data, count, err));
    return resume(maker, own, unit, count, list, done, err);
}

static hada_status go_on(hada_plane_maker *maker, const hada_frame_exposure *exposure, hada_maker_steps *own,
                         double unit, int count, const int *list, hada_maker_past *past, int *done, hada_error *err)
{
    const int doubt = past->moved, waits = past->wait > 0;
    past->wait -= waits;
    past->moved = 1;
    past->least = least_of(past);
    *done = 0;
    if (past->drifts && !past->asked && hada_refiner_knows_motion(maker->refiner, &maker->data))
        HADA_TRY(follow_drift(maker, exposure, count, list, past, err));
    if (!past->follows && past->now < few_of(maker, past)) {
        HADA_TRY(stay(maker, own, unit, count, list, past, doubt, done, err));
        if (!past->moved)
            return HADA_OK;
    }
    if (!past->asked && !waits && hada_refiner_knows_motion(maker->refiner, &maker->data))
        HADA_TRY(follow_drift(maker, exposure, count, list, past, err));
    if (past->follows) {
        HADA_TRY(settle(maker, own, unit, count, list, past, count > 1 ? DRIFT_STEPS_SEVERAL : DRIFT_STEPS,
                        firm_of(maker, count, 1.0), done, err));
        past->moved = 0;
        if (count > 1)
            HADA_TRY(hada_refiner_moved(maker->refiner, &past->motion, 0, &past->moved, err));
        past->ridge = RIDGE_DRIFT;
        if (!past->moved) {
            past->vain = 0;
            return HADA_OK;
        }
        past->ridge = INT_MAX;
        HADA_TRY(in_vain(maker, past, err));
    }
    return move_on(maker, own, unit, count, list, past, done, err);
}

hada_status hada_maker_go_on(hada_plane_maker *maker, const hada_frame_exposure *exposure,
                             const hada_maker_steps *steps, int count, const int *list, hada_maker_past *past,
                             hada_maker_choice *choice, int *done, int *warm, hada_error *err)
{
    const double unit = hada_exposure_noise_unit(exposure, &maker->noise_share);
    hada_maker_steps own = *steps;
    past->kept = 1;
    past->ridge = INT_MAX;
    *warm = past->left >= 0.0 && exposure->energy > 0.0 && (!maker->held.mem || choice->tv > 0.0) &&
            hada_refiner_remembers(maker->refiner, count, list);
    if (*warm) {
        HADA_TRY(look_back(maker, exposure, count, list, past, err));
        *warm = !(past->now > CUT && past->now > FEW * past->left);
    }
    past->count = count;
    if (*warm) {
        own.tv = choice->tv > 0.0 ? choice->tv : own.tv;
        HADA_TRY(go_on(maker, exposure, &own, unit, count, list, past, done, err));
    } else {
        HADA_TRY(hada_maker_refine_exposure(maker, exposure, &own, count, list, choice, done, err));
        past->steps = *done + (choice->steps < HADA_CHOICE_STEPS ? choice->steps : HADA_CHOICE_STEPS);
        /* where a sensor crops, the residual may stand still before planes do */
        if (maker->boundary == HADA_BOUNDARY_PADDED && steps->stop == 1 && !choice->steps)
            past->steps = steps->steps;
        past->least = -1.0;
        past->moved = past->drifts = past->vain = past->wait = 0;
    }
    if (!*warm || past->moved || past->follows)
        past->energy = exposure->energy;
    return hada_refiner_keep(maker->refiner, count, list, err);
}
