/* Frames of a sequence go on from the one before, in fewer steps the less has changed (docs/explanation/refinement.md).
 * What was found by trial: perf/results/sequences.md. */
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

/* Where nothing moved, a few steps with a larger rho are enough, and make the planes a mean over frames. Where
 * something did, rho begins as from nothing, so that all may move; several depths have parted before. `before` says so.
 */
enum { STILL_STEPS = 2, HALVED_FROM = 3, SETTLED = 100, PARTED = 7 };
#define FIRM         2.0
#define FIRM_SEVERAL 8.0

/* A depth that appears is found within three frames. */
enum { FOLLOWED = 2 };

/* The least that planes left of their frame since something moved. */
static double least_of(const hada_maker_past *past)
{
    return past->least < 0.0 || past->left < past->least ? past->left : past->least;
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
    return HADA_OK;
}

hada_status hada_maker_expects(hada_plane_maker *maker, const hada_frame_exposure *exposure, const int *list,
                               hada_maker_past *past, int *same, hada_error *err)
{
    *same = past->left >= 0.0 && !past->moved && past->followed < FOLLOWED && exposure->energy > 0.0 &&
            hada_refiner_remembers(maker->refiner, past->count, list);
    if (*same) {
        HADA_TRY(look_back(maker, exposure, past->count, list, past, err));
        *same = past->now < of_still(hada_model_get_info(maker->model), past->count) * least_of(past);
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

static hada_status go_on(hada_plane_maker *maker, hada_maker_steps *own, double unit, int count, const int *list,
                         hada_maker_past *past, int *done, hada_error *err)
{
    const int doubt = past->moved;
    past->moved = 1;
    past->least = least_of(past);
    *done = 0;
    if (past->now < of_still(hada_model_get_info(maker->model), count) * past->least) {
        own->steps = past->steps < STILL_STEPS ? past->steps : STILL_STEPS;
        own->before = SETTLED;
        own->firm = count > 1 ? FIRM_SEVERAL : FIRM;
        own->hasten = 1.0;
        HADA_TRY(resume(maker, own, unit, count, list, done, err));
        HADA_TRY(hada_refiner_moved(maker->refiner, doubt, &past->moved, err));
        if (!past->moved)
            return HADA_OK;
        HADA_TRY(hada_refiner_recall(maker->refiner, err)); /* duals of what lags are of no use to a smaller rho */
    }
    past->least = -1.0;
    own->steps = past->steps < HALVED_FROM ? past->steps : past->steps / 2 + 1;
    own->before = count > 1 ? PARTED : 0;
    own->firm = 1.0;
    /* light beyond the frame settles while rho grows, which it does as far in fewer steps */
    own->hasten = maker->boundary == HADA_BOUNDARY_PADDED ? (double)past->steps / own->steps : 1.0;
    return resume(maker, own, unit, count, list, done, err);
}

hada_status hada_maker_go_on(hada_plane_maker *maker, const hada_frame_exposure *exposure,
                             const hada_maker_steps *steps, int count, const int *list, hada_maker_past *past,
                             hada_maker_choice *choice, int *done, int *warm, hada_error *err)
{
    const double unit = hada_exposure_noise_unit(exposure, maker->noise_share);
    hada_maker_steps own = *steps;
    past->kept = 1;
    past->count = count;
    *warm = past->left >= 0.0 && exposure->energy > 0.0 && (!maker->held.mem || choice->tv > 0.0) &&
            hada_refiner_remembers(maker->refiner, count, list);
    if (*warm) {
        HADA_TRY(look_back(maker, exposure, count, list, past, err));
        *warm = !(past->now > CUT && past->now > FEW * past->left);
    }
    if (*warm) {
        own.tv = choice->tv > 0.0 ? choice->tv : own.tv;
        HADA_TRY(go_on(maker, &own, unit, count, list, past, done, err));
    } else {
        HADA_TRY(hada_maker_refine_exposure(maker, exposure, &own, count, list, choice, done, err));
        past->steps = *done + (choice->steps < HADA_CHOICE_STEPS ? choice->steps : HADA_CHOICE_STEPS);
        /* where a sensor crops, the residual may stand still before planes do */
        if (maker->boundary == HADA_BOUNDARY_PADDED && steps->stop == 1 && !choice->steps)
            past->steps = steps->steps;
        past->least = -1.0;
        past->moved = 0;
    }
    return hada_refiner_keep(maker->refiner, count, list, err);
}
