#include "tasks/fit_passes.h"

#include <stdlib.h>

#include "core/alloc.h"
#include "core/callers.h"
#include "core/clock.h"
#include "io/folder.h"

/* The fitter scores so many pairs in all, and two of each depth where there are many (hada_fitter_score()). */
enum { SCORED_IN_ALL = 8, SCORED_PER_DEPTH = 2 };

typedef hada_status (*take_pair)(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                                 hada_error *err);

static hada_status take(hada_fit_loan *loan, const hada_fit_source *from, int z, int i, hada_error *err)
{
    return hada_fit_loan_take(loan, from->store, from->data, from->survey, z, i, err);
}

static hada_status one_pair(hada_fitter *fitter, const hada_fit_source *from, int z, int i, take_pair use,
                            hada_error *err)
{
    const hada_dataset *data = from->data;
    hada_fit_loan loan;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(take(&loan, from, z, i, err));
    status = use(fitter, z, loan.raw, loan.scene, err);
    if (status)
        hada_error_prefix(err, "%s and %s: ", hada_dataset_raw_path(data, z, i), hada_dataset_scene_path(data, z, i));
done:
    hada_fit_loan_return(&loan);
    return status;
}

static int least(int a, int b)
{
    return a < b ? a : b;
}

/* Up to `most` pairs of each depth, evenly spread. */
static hada_status each_pair(hada_fitter *fitter, const hada_fit_source *from, int most, const char *what,
                             take_pair use, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(from->data);
    hada_status status = HADA_OK;
    long total = 0;
    for (int z = 0; z < info->depths; z++)
        total += least(info->counts[z], most);
    hada_progress progress = hada_progress_begin(from->monitor, what, total);
    for (int z = 0; z < info->depths; z++) {
        const int count = least(info->counts[z], most);
        for (int i = 0; i < count; i++) {
            HADA_TRY_OR_DONE(one_pair(fitter, from, z, (int)((long)i * info->counts[z] / count), use, err));
            HADA_TRY_OR_DONE(hada_progress_step(&progress, NULL, err));
        }
    }
done:
    hada_progress_end(&progress);
    return status;
}

/* Whole depths are dealt to ranks where none then has over so much of its fair share of pairs: sums of a depth that are
 * one rank's are handed on as they are. Else each depth's pairs are shared. */
#define FAIR 1.1

static int goes_by_depth(const hada_fit_source *from)
{
    const hada_dataset_info *info = hada_dataset_get_info(from->data);
    const int ranks = hada_ranks(from->communicator);
    long most = 0;
    for (int r = 0; r < ranks; r++) {
        long load = 0;
        for (int z = r; z < info->depths; z += ranks)
            load += info->counts[z];
        most = load > most ? load : most;
    }
    return (double)most * ranks <= FAIR * info->pairs;
}

/* This rank's pairs of a depth. */
typedef struct range {
    int begin, end;
} range;

static range share_of(const hada_fit_source *from, int z)
{
    const hada_communicator *ranks = from->communicator;
    const int count = hada_dataset_get_info(from->data)->counts[z];
    if (goes_by_depth(from))
        return (range){0, hada_is_mine(ranks, z) ? count : 0};
    return (range){(int)hada_share_begin(ranks, count, hada_rank(ranks)),
                   (int)hada_share_begin(ranks, count, hada_rank(ranks) + 1)};
}

/* A save may take a twentieth of the time. */
enum { SAVE_SHARE = 20 };

typedef struct saving {
    double last, took;
} saving;

static hada_status save_part(hada_fitter *fitter, const hada_fit_source *from, saving *at, hada_error *err)
{
    const double now = hada_seconds();
    if (!from->part || now - at->last < from->part_seconds || now - at->last < SAVE_SHARE * at->took)
        return HADA_OK;
    const hada_status status = hada_fitter_save_sums(fitter, from->part, err);
    at->last = hada_seconds();
    at->took = at->last - now;
    return status;
}

/* Pairs of a depth that an interrupted fit has added already. */
static hada_status resume_part(hada_fitter *fitter, const hada_fit_source *from, hada_error *err)
{
    const int depths = hada_dataset_get_info(from->data)->depths;
    hada_status status = HADA_OK;
    if (!from->part || !from->resume || !hada_path_is_file(from->part))
        return HADA_OK;
    status = hada_fitter_load_sums(fitter, from->part, err);
    if (status)
        hada_error_prefix_path(err, from->part);
    HADA_TRY(status);
    for (int z = 0; z < depths; z++) {
        const range mine = share_of(from, z);
        if (hada_fitter_pairs(fitter, z) > mine.end - mine.begin)
            HADA_TRY(hada_fail(err, HADA_ERROR_STATE,
                               "%s holds more pairs than there are: it is of another data set; remove it, or leave out "
                               "options.resume",
                               from->part));
    }
    return status;
}

/* This rank's pairs that are not in the sums yet. */
static hada_status add_share(hada_fitter *fitter, const hada_fit_source *from, hada_progress *progress, hada_error *err)
{
    saving at = {.last = hada_seconds()};
    hada_status status = HADA_OK;
    for (int z = 0; z < hada_dataset_get_info(from->data)->depths; z++) {
        const range mine = share_of(from, z);
        const int there = from->part ? (int)hada_fitter_pairs(fitter, z) : 0;
        for (int i = mine.begin; i < mine.end; i++) {
            if (i - mine.begin >= there) {
                HADA_TRY_OR_DONE(one_pair(fitter, from, z, i, hada_fitter_add, err));
                HADA_TRY_OR_DONE(save_part(fitter, from, &at, err));
            }
            HADA_TRY_OR_DONE(hada_progress_step(progress, NULL, err));
        }
    }
done:
    if (status == HADA_ERROR_CANCELLED && from->part)
        hada_fitter_save_sums(fitter, from->part, NULL); /* the wish to stop is what is told */
    return status;
}

hada_status hada_fit_pass_add(hada_fitter *fitter, const hada_fit_source *from, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(from->data);
    long total = 0;
    hada_status status = HADA_OK;
    for (int z = 0; z < info->depths; z++)
        total += share_of(from, z).end - share_of(from, z).begin;
    hada_progress progress = hada_progress_begin(from->monitor, "pairs", total);
    HADA_TRY_OR_DONE(resume_part(fitter, from, err));
    HADA_TRY_OR_DONE(add_share(fitter, from, &progress, err));
    HADA_TRY_OR_DONE(hada_fitter_reduce(fitter, err));
done:
    hada_progress_end(&progress);
    return status;
}

hada_status hada_fit_pass_score(hada_fitter *fitter, const hada_fit_source *from, hada_error *err)
{
    const int depths = hada_dataset_get_info(from->data)->depths, share = (SCORED_IN_ALL + depths - 1) / depths;
    const int most = share < SCORED_PER_DEPTH ? SCORED_PER_DEPTH : share;
    return each_pair(fitter, from, most, "leave-one-out", hada_fitter_score, err);
}

/* The pair that is shown, until the next one is. */
typedef struct shown {
    const hada_fit_source *from;
    const char *why;
    hada_progress progress; /* once one is shown */
    hada_fit_loan loan;
    int depth, number; /* of it */
} shown;

static hada_status show(void *user, int depth, int64_t number, const hada_image **raw, const hada_image **scene,
                        hada_error *err)
{
    shown *at = user;
    if (!at->progress.what)
        at->progress = hada_progress_begin(at->from->monitor, at->why, 0);
    hada_fit_loan_return(&at->loan);
    at->depth = depth;
    at->number = (int)number;
    HADA_TRY(take(&at->loan, at->from, depth, (int)number, err));
    HADA_TRY(hada_progress_step(&at->progress, NULL, err));
    *raw = at->loan.raw;
    *scene = at->loan.scene;
    return HADA_OK;
}

static void show_end(shown *at)
{
    if (at->progress.what)
        hada_progress_end(&at->progress);
    hada_fit_loan_return(&at->loan);
}

/* What is wrong with a pair that could be read is said without its name. */
static hada_status name_pair(const shown *at, hada_status status, hada_error *err)
{
    if (status == HADA_ERROR_NOT_FINITE || status == HADA_ERROR_SIZE || status == HADA_ERROR_NUMERIC)
        hada_error_prefix(err, "%s and %s: ", hada_dataset_raw_path(at->from->data, at->depth, at->number),
                          hada_dataset_scene_path(at->from->data, at->depth, at->number));
    return status;
}

hada_status hada_fit_pass_boundary(hada_fit_options *fit, hada_context *context, const hada_fit_source *from,
                                   hada_error *err)
{
    shown at = {.from = from, .why = "looks at pairs, for the boundary"};
    const hada_status status =
        hada_fit_find_boundary(fit, context, hada_dataset_get_info(from->data)->counts, show, &at, err);
    show_end(&at);
    if (status)
        return name_pair(&at, status, err);
    if (fit->boundary == HADA_BOUNDARY_CIRCULAR)
        hada_monitor_tell(from->monitor, HADA_MESSAGE_DETAIL, "no light leaves the sensor: boundary circular");
    else
        hada_monitor_tell(from->monitor, HADA_MESSAGE_DETAIL, "light leaves the sensor: boundary padded");
    return HADA_OK;
}

hada_status hada_fit_pass_agree(hada_fit_options *fit, const hada_communicator *ranks, hada_error *err)
{
    double found[] = {fit->scene_response, fit->boundary, fit->grid_rows, fit->grid_cols};
    const hada_status status = hada_broadcast(ranks, 0, found, sizeof found, err);
    fit->scene_response = found[0];
    fit->boundary = (hada_boundary)found[1];
    fit->grid_rows = (int)found[2];
    fit->grid_cols = (int)found[3];
    return status;
}

hada_status hada_fit_pass_learn_cropped(hada_fitter *fitter, const hada_fit_source *from, hada_error *err)
{
    shown at = {.from = from, .why = "looks at pairs, for the light beyond the sensor"};
    const hada_status status = hada_fitter_learn_cropped(fitter, show, &at, err);
    show_end(&at);
    return status;
}

hada_status hada_fit_pass_learn_and_finish(hada_fitter *fitter, const hada_fit_source *from, hada_model **out,
                                           hada_fit_scores **scores, hada_error *err)
{
    shown at = {.from = from, .why = "looks at pairs, to judge in the window"};
    const hada_status status = hada_fitter_learn_and_finish(fitter, show, &at, out, scores, err);
    show_end(&at);
    return status;
}

hada_status hada_fit_pass_survey(hada_survey **out, const hada_fit_source *from, const hada_fit_options *fit,
                                 hada_exposure exposure, hada_error *err)
{
    shown at = {.from = from, .why = "looks at pairs, for the response of their scenes"};
    const hada_status status =
        hada_survey_create(out, fit, hada_dataset_get_info(from->data)->counts, exposure, show, &at, err);
    show_end(&at);
    if (!status && hada_survey_exposed(*out))
        hada_monitor_tell(from->monitor, HADA_MESSAGE_NOTE,
                          "frames of one depth differ in exposure: each scene is learned as bright as its frame was "
                          "exposed");
    return status;
}

hada_status hada_fit_exact(hada_model **out, hada_context *context, const hada_fit_options *fit,
                           const hada_fit_source *from, hada_error *err)
{
    hada_fitter *fitter = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_fitter_create(&fitter, context, fit, err));
    HADA_TRY_OR_DONE(hada_fit_pass_add(fitter, from, err));
    if (hada_dataset_get_info(from->data)->least_pairs > 1)
        HADA_TRY_OR_DONE(hada_fit_pass_score(fitter, from, err));
    HADA_TRY_OR_DONE(hada_fit_pass_learn_cropped(fitter, from, err));
    HADA_TRY_OR_DONE(hada_fitter_finish(fitter, out, NULL, err));
done:
    hada_fitter_destroy(&fitter);
    return status;
}

hada_status hada_model_make_half(hada_model **model, hada_error *err)
{
    hada_model *half = NULL;
    const hada_status status = hada_model_to_half(&half, *model, err);
    if (status)
        return status;
    hada_model_destroy(model);
    *model = half;
    return HADA_OK;
}
