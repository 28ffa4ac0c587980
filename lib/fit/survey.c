/* What pairs say before a fit: the response of the scenes, and exposures that differ. */
#include <hadalens/survey.h>

#include "core/callers.h"
#include "fit/look.h"
#include "fit/sample.h"
#include "image/statistics.h"

/* Of a depth, pairs from which exposures are found; further ones are held against these. */
enum { EXPOSED_TOGETHER = 32 };

/* From nothing to what displays and cameras use, and beyond; pairs showed exponents a tenth apart. */
static const double responses[] = {HADA_RESPONSE_LINEAR, 1.25, 1.5, 1.8, 2.0, HADA_RESPONSE_SRGB, 2.2, 2.6};
enum { RESPONSES = sizeof responses / sizeof *responses };
_Static_assert((int)RESPONSES <= (int)HADA_SAMPLE_RESPONSES, "room for responses");

/* Another response than linear must leave less unexplained by about this share (a difference of logarithms). */
#define BETTER_BY 0.1
/* The same where the pairs gave the dark level as well, which a power nearly makes up for: FlatCam, from three pairs,
 * leaves 1.6 times less with 1.5 than linear and is 4 dB worse. */
#define DARK_RESPONSE 0.7
/* Exposures are taken apart where that leaves less than this share of what is unexplained otherwise. On frames that
 * were exposed alike it takes off a few percent, on those exposed by a factor of two it left a fiftieth. */
#define APART_BELOW 0.5

/* A survey and what it points to. */
typedef struct owned_survey {
    hada_survey survey;
    hada_survey_row row[RESPONSES];
    const hada_survey_row *list[RESPONSES + 1];
    int depths;
    double **gain; /* of each depth; NULL: exposures are alike */
} owned_survey;

/* The response with the least share, exposures alike (0) or apart (1). */
static int least_response(const hada_sample *work, int apart)
{
    int best = 0;
    for (int r = 1; r < work->tried; r++)
        if (hada_sample_mean(work->unexplained[r][apart], work->count) <
            hada_sample_mean(work->unexplained[best][apart], work->count))
            best = r;
    return best;
}

/* That one, or the first, linear, unless there is evidence. */
static int best_response(const hada_sample *work, int apart)
{
    const int best = least_response(work, apart);
    const double *linear = work->unexplained[0][apart], *other = work->unexplained[best][apart];
    double less[HADA_SAMPLE_MOST];
    for (int k = 0; k < work->count; k++)
        less[k] = log(fmax(linear[k], HADA_LEAST_SHARE) / fmax(other[k], HADA_LEAST_SHARE));
    const int found_dark =
        work->options.find_dark && (work->options.dark > 0.0 || hada_dataset_get_info(work->pairs)->dark_frame);
    return hada_sample_is_better(less, work->count, found_dark ? DARK_RESPONSE : BETTER_BY) ? best : 0;
}

/* Fills the rows; returns whether exposures are to be taken apart. Where they explain what linear scenes, exposed
 * alike, do not, and another response does so as well, it is that one. */
static int choose(owned_survey *own, const hada_sample *work, hada_exposure exposure)
{
    const int apart = best_response(work, 1), least = least_response(work, 0);
    const double limit = hada_sample_mean(work->unexplained[apart][1], work->count) / APART_BELOW;
    const int linear_fails = limit < hada_sample_mean(work->unexplained[0][0], work->count);
    const int exposed =
        exposure == HADA_EXPOSURE_EACH ||
        (exposure == HADA_EXPOSURE_AUTO && limit < hada_sample_mean(work->unexplained[least][0], work->count));
    const int alike = exposure == HADA_EXPOSURE_AUTO && linear_fails ? least : best_response(work, 0);
    const int chosen = exposed ? apart : alike;
    own->survey.response = work->response[chosen];
    for (int r = 0; r < work->tried; r++) {
        own->row[r] = (hada_survey_row){.response = work->response[r],
                                        .unexplained = hada_sample_mean(work->unexplained[r][0], work->count),
                                        .unexplained_apart = hada_sample_mean(work->unexplained[r][1], work->count),
                                        .chosen = r == chosen};
        own->list[r] = &own->row[r];
    }
    return exposed;
}

/* Exposures of all pairs of a depth, which are 1 to begin with: some together, each further one against these. */
static hada_status expose_depth(hada_sample *work, int z, double *exposure, hada_error *err)
{
    enum { PLACES = EXPOSED_TOGETHER + 1 };
    double gain[PLACES] = {0.0}, unexplained[PLACES], room[PLACES];
    int pair_at[PLACES], together = 0;
    hada_status status = HADA_OK;
    work->level.count = 0;
    for (int i = 0; i < work->counts[z]; i++) {
        if (i == EXPOSED_TOGETHER)
            hada_pair_level_expose(&work->level, gain, unexplained, room);
        hada_sample_forget(work);
        HADA_TRY_OR_DONE(hada_sample_take_pair(work, z, i, err));
        if (!work->count)
            continue;
        hada_pair_level_put(&work->level, together, z, &work->frame[0], &work->scene[0][0]);
        if (i < EXPOSED_TOGETHER) {
            pair_at[together++] = i;
        } else {
            gain[together] = 0.0;
            hada_pair_level_judge(&work->level, gain, 0, unexplained, room);
            exposure[i] = room[together] > 0.0 ? room[together] : 1.0;
        }
    }
    if (together < 2)
        goto done;
    if (work->counts[z] <= EXPOSED_TOGETHER)
        hada_pair_level_expose(&work->level, gain, unexplained, room);
    for (int k = 0; k < together; k++)
        exposure[pair_at[k]] = gain[k];
done:
    hada_sample_forget(work);
    return status;
}

/* Exposures of all pairs, 1. */
static hada_status make_gains(owned_survey *own, const int *counts, hada_error *err)
{
    HADA_TRY(HADA_NEW(own->gain, (size_t)own->depths, "exposures", err));
    for (int z = 0; z < own->depths; z++) {
        HADA_TRY(HADA_NEW(own->gain[z], (size_t)counts[z], "exposures", err));
        for (int i = 0; i < counts[z]; i++)
            own->gain[z][i] = 1.0;
    }
    return HADA_OK;
}

static hada_status expose_all(owned_survey *own, hada_sample *work, hada_error *err)
{
    work->response = &own->survey.response;
    work->tried = 1;
    hada_pair_level_destroy(&work->level);
    HADA_TRY(
        hada_pair_level_create(&work->level, work->reducer.grid, work->options.channels, EXPOSED_TOGETHER + 1, err));
    work->level.sharp = hada_look_is_lit(&work->options, work->pairs);
    HADA_TRY(make_gains(own, work->counts, err));
    for (int z = 0; z < own->depths; z++)
        HADA_TRY(expose_depth(work, z, own->gain[z], err));
    own->survey.gains = (const double *const *)own->gain;
    return HADA_OK;
}

static hada_status make(owned_survey *own, hada_sample *work, hada_exposure exposure, hada_error *err)
{
    const hada_fit_options *options = &work->options;
    hada_survey *survey = &own->survey;
    own->depths = options->depths;
    survey->rows = own->list;
    survey->response = options->scene_response == HADA_AUTO ? HADA_RESPONSE_LINEAR : options->scene_response;
    work->tried = options->scene_response == HADA_AUTO ? RESPONSES : 1;
    work->response = work->tried == 1 ? &options->scene_response : responses;
    HADA_TRY(hada_sample_begin(work, err));
    survey->exposed = exposure == HADA_EXPOSURE_EACH;
    if (work->count >= HADA_SAMPLE_LEAST) {
        hada_sample_compare(work);
        survey->exposed = choose(own, work, exposure);
    }
    hada_sample_forget(work);
    return survey->exposed ? expose_all(own, work, err) : HADA_OK;
}

static hada_status check(const hada_fit_options *options, const hada_dataset_info *pairs, hada_error *err)
{
    hada_model_info sizes = {.boundary = HADA_BOUNDARY_CIRCULAR};
    if (options->depths != pairs->depths || options->channels < 1 || options->window_rows < 1 ||
        options->window_cols < 1)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "hada_survey_create: the depths of the data set and the sizes of frames and windows are needed");
    HADA_TRY(hada_model_set_sizes(&sizes, options->raw_rows, options->raw_cols, options->window_rows,
                                  options->window_cols, err));
    if (options->scene_response != HADA_AUTO && !hada_response_is_known(options->scene_response))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the response of the scenes, %g, is none (hadalens/response.h)",
                         options->scene_response);
    return HADA_OK;
}

hada_status hada_survey_create(hada_survey **out, const hada_fit_options *callers, const hada_dataset *pairs,
                               hada_exposure exposure, hada_error *err)
{
    hada_sample work = {.pairs = pairs};
    owned_survey *own = NULL;
    hada_status status = HADA_OK;
    HADA_NEED(out && callers && pairs, err);
    *out = NULL;
    hada_fit_options_init(&work.options);
    HADA_TRY(HADA_OPTIONS_TAKE(&work.options, callers, hada_fit_options, err));
    HADA_TRY(check(&work.options, hada_dataset_get_info(pairs), err));
    work.counts = hada_dataset_get_info(pairs)->counts;
    HADA_TRY(HADA_NEW(own, 1, "a survey of pairs", err));
    *out = &own->survey;
    HADA_TRY_OR_DONE(make(own, &work, exposure, err));
done:
    hada_sample_end(&work);
    if (status)
        hada_survey_destroy(out);
    return status;
}

void hada_survey_choose(hada_survey *survey, const hada_survey_row *row, hada_survey *exposures)
{
    owned_survey *own = (owned_survey *)survey, *other = (owned_survey *)exposures; /* their first members */
    for (int r = 0; own->list[r]; r++)
        own->row[r].chosen = own->list[r] == row;
    survey->response = row->response;
    survey->exposed = other != NULL;
    if (other) {
        double **gain = own->gain;
        own->gain = other->gain;
        other->gain = gain;
    }
    survey->gains = other ? (const double *const *)own->gain : NULL;
}

hada_status hada_survey_agree(hada_survey *survey, const hada_communicator *ranks, const hada_dataset *pairs,
                              hada_error *err)
{
    owned_survey *own = (owned_survey *)survey; /* its first member */
    const int *counts = hada_dataset_get_info(pairs)->counts;
    double found[] = {survey->response, survey->exposed};
    HADA_TRY(hada_broadcast(ranks, 0, found, sizeof found, err));
    survey->response = found[0];
    survey->exposed = found[1] != 0.0;
    survey->gains = NULL;
    for (int r = 0; own->list[r]; r++)
        own->row[r].chosen = own->row[r].response == found[0];
    if (!survey->exposed)
        return HADA_OK;
    if (!own->gain)
        HADA_TRY(make_gains(own, counts, err));
    for (int z = 0; z < own->depths; z++)
        HADA_TRY(hada_broadcast(ranks, 0, own->gain[z], (size_t)counts[z] * sizeof *own->gain[z], err));
    survey->gains = (const double *const *)own->gain;
    return HADA_OK;
}

void hada_survey_destroy(hada_survey **pointer)
{
    owned_survey *own = pointer ? (owned_survey *)*pointer : NULL; /* its first member */
    if (!own)
        return;
    *pointer = NULL;
    for (int z = 0; own->gain && z < own->depths; z++)
        free(own->gain[z]);
    HADA_FREE(own->gain, own);
}

hada_status hada_survey_apply(hada_dataset **out, const hada_survey *survey, const hada_dataset *pairs, hada_error *err)
{
    HADA_NEED(out && survey && pairs, err);
    return hada_dataset_brighten(out, pairs, survey->gains, survey->response, err);
}
