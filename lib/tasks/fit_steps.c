/* The steps that a fit and a training begin with, and the trial that both end with. */
#include "tasks/fit_steps.h"

#include <hadalens/camera.h>
#include <hadalens/reconstruct.h>

#include "core/callers.h"
#include "core/numbers.h"
#include "fit/look.h"
#include "image/correct.h"
#include "io/tiff_page.h"
#include "tasks/frames.h"

static hada_boundary choose_boundary(int given, const hada_dataset *data, const hada_monitor *monitor)
{
    const char *path = hada_dataset_get_info(data)->camera;
    hada_camera camera = {.size = sizeof camera};
    hada_error err = {0};
    if (given)
        return (hada_boundary)given;
    if (!path)
        return HADA_BOUNDARY_PADDED;
    hada_camera_init(&camera);
    if (!hada_camera_load(&camera, path, &err))
        return camera.boundary;
    hada_monitor_tell(monitor, HADA_MESSAGE_NOTE, "%s is not used: %s", path, err.message);
    return HADA_BOUNDARY_PADDED;
}

hada_status hada_fit_prepare(hada_fit_options *fit, const hada_dataset *data, int boundary, const hada_monitor *monitor,
                             hada_error *err)
{
    if (!fit->monitor)
        fit->monitor = monitor;
    fit->boundary = choose_boundary(boundary, data, monitor);
    return hada_fit_sizes_from(fit, data, err);
}

static hada_status survey_once(hada_survey **out, hada_context *context, const hada_dataset *data,
                               const hada_fit_options *fit, hada_exposure exposure, hada_error *err)
{
    hada_dataset *pure = NULL;
    hada_status status = HADA_OK;
    hada_survey_destroy(out);
    HADA_TRY_OR_DONE(hada_dataset_unmix(&pure, data, fit->colour_matrix, err));
    HADA_TRY_OR_DONE(hada_survey_create(out, fit, pure, exposure, err));
    HADA_TRY_OR_DONE(hada_fit_confirm_survey(*out, fit, exposure, context, pure, err));
done:
    hada_dataset_destroy(&pure);
    return status;
}

/* A survey, and what the sensor sees of the scenes' colours, for `fit`, beginning with a response. Frames of mixed
 * colours look as if scenes had another response, or as if exposures differed, so either is found anew with what the
 * other has become. */
static hada_status survey_from(hada_survey **out, double response, hada_context *context, const hada_dataset *data,
                               hada_fit_options *fit, hada_exposure exposure, hada_error *err)
{
    enum { ROUNDS = 4 };
    hada_fit_options now = *fit; /* with the response that the last survey chose */
    hada_dataset *even = NULL;
    int found = fit->find_colours && !hada_colours_known(fit->colour_matrix), exposed = 0;
    hada_status status = HADA_OK;
    now.scene_response = response;
    for (int round = 0; round < ROUNDS; round++) {
        const double before = now.scene_response;
        HADA_TRY_OR_DONE(survey_once(out, context, data, round ? fit : &now, exposure, err));
        const int same = round && (*out)->response == before && !(*out)->exposed && !exposed;
        if (!found || same || round == ROUNDS - 1)
            break;
        now.scene_response = (*out)->response;
        exposed = (*out)->exposed;
        HADA_TRY_OR_DONE(hada_survey_apply(&even, *out, data, err));
        HADA_TRY_OR_DONE(hada_fit_find_colours(&now, context, even, exposed, fit->colour_matrix, &found, err));
        hada_dataset_destroy(&even);
        if (!found && !round)
            break;
    }
done:
    hada_dataset_destroy(&even);
    return status;
}

/* What is left of held-out frames as a survey with a colour matrix explains them. */
static hada_status left_with(const hada_survey *survey, hada_context *context, const hada_dataset *data,
                             const hada_fit_options *fit, double *left, hada_error *err)
{
    hada_fit_options known = *fit;
    hada_dataset *pure = NULL;
    hada_status status = HADA_OK;
    known.scene_response = survey->response;
    HADA_TRY_OR_DONE(hada_dataset_unmix(&pure, data, fit->colour_matrix, err));
    HADA_TRY_OR_DONE(hada_fit_left_share(&known, context, pure, left, err));
done:
    hada_dataset_destroy(&pure);
    return status;
}

/* Where the pairs gave a dark level as well, linear scenes are preferred, and mixed colours may be found by these that
 * are none: then scenes encoded for displays must leave less by this factor (0.36 to 0.49 where they were, 1 to 4 where
 * they were linear). */
#define ENCODED_BETTER 0.7

/* A survey and colours, as survey_from() finds them. */
static hada_status survey_colours(hada_survey **out, hada_context *context, const hada_dataset *data,
                                  hada_fit_options *fit, hada_exposure exposure, hada_error *err)
{
    hada_fit_options other = *fit;
    hada_survey *encoded = NULL;
    double left, left_encoded;
    const int looks = fit->scene_response == HADA_AUTO && fit->find_dark && fit->find_colours &&
                      fit->channels == HADA_COLOURS && !hada_colours_known(fit->colour_matrix);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(survey_from(out, fit->scene_response, context, data, fit, exposure, err));
    if (!looks || (*out)->response != HADA_RESPONSE_LINEAR)
        goto done;
    HADA_TRY_OR_DONE(survey_from(&encoded, HADA_RESPONSE_SRGB, context, data, &other, exposure, err));
    if (!hada_colours_known(other.colour_matrix))
        goto done;
    HADA_TRY_OR_DONE(left_with(*out, context, data, fit, &left, err));
    HADA_TRY_OR_DONE(left_with(encoded, context, data, &other, &left_encoded, err));
    if (left_encoded < ENCODED_BETTER * left) {
        hada_survey *const linear = *out;
        *out = encoded;
        encoded = linear;
        memcpy(fit->colour_matrix, other.colour_matrix, sizeof other.colour_matrix);
    }
done:
    hada_survey_destroy(&encoded);
    return status;
}

static void tell_colours(const hada_fit_options *fit, const hada_monitor *monitor)
{
    const double *m = fit->colour_matrix;
    if (hada_colours_known(m))
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE,
                          "the sensor mixes the colours of the scenes: its red, green and blue hold %.2f %.2f %.2f, "
                          "%.2f %.2f %.2f and %.2f %.2f %.2f of theirs. Results have the scenes' colours",
                          m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]);
}

/* Light of each frame's own, found anew in the colours that are known now; where it is none, it stays. */
static hada_status find_own_again(hada_mended *mended, const hada_fit_options *fit, hada_error *err)
{
    enum { EACH = HADA_COLOURS * HADA_SMOOTH_TERMS };
    const size_t pairs = (size_t)mended->lit->store->pairs;
    double *light = NULL;
    hada_dataset *pure = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_dataset_unmix(&pure, mended->lit, fit->colour_matrix, err));
    HADA_TRY_OR_DONE(hada_fit_find_own_light(fit, pure, mended->apart, &light, err));
    for (size_t i = 0; light && i < pairs * EACH; i++) { /* as the sensor sees it */
        const size_t first = i / EACH * EACH + i % HADA_SMOOTH_TERMS, channel = i % EACH / HADA_SMOOTH_TERMS;
        mended->light[i] = 0.0;
        for (size_t c = 0; c < HADA_COLOURS; c++)
            mended->light[i] += fit->colour_matrix[channel * HADA_COLOURS + c] * light[first + c * HADA_SMOOTH_TERMS];
    }
done:
    free(light);
    hada_dataset_destroy(&pure);
    return status;
}

/* A dark level that mixed colours hid, once these are known. */
static hada_status find_level_again(const hada_survey *survey, const hada_dataset *data, hada_fit_options *fit,
                                    hada_error *err)
{
    hada_fit_options known = *fit;
    hada_dataset *even = NULL, *pure = NULL;
    hada_status status = HADA_OK;
    known.find_dark = 1;
    known.scene_response = survey->response;
    HADA_TRY_OR_DONE(hada_survey_apply(&even, survey, data, err));
    HADA_TRY_OR_DONE(hada_dataset_unmix(&pure, even, fit->colour_matrix, err));
    HADA_TRY_OR_DONE(hada_fit_find_dark(&known, pure, NULL, NULL, err));
    fit->dark = known.dark;
    fit->find_dark = known.find_dark;
done:
    hada_dataset_destroy(&pure);
    hada_dataset_destroy(&even);
    return status;
}

/* Takes off what light all frames have still, once a response, exposures and colours are known. */
static hada_status correct_light(hada_mended *mended, const hada_survey *survey, const hada_dataset *data,
                                 const hada_fit_options *callers, hada_error *err)
{
    hada_fit_options fit = *callers;
    hada_dataset *even = NULL, *pure = NULL;
    hada_image left = {0};
    hada_status status = HADA_OK;
    fit.scene_response = survey->response;
    HADA_TRY_OR_DONE(hada_survey_apply(&even, survey, data, err));
    HADA_TRY_OR_DONE(hada_dataset_unmix(&pure, even, fit.colour_matrix, err));
    HADA_TRY_OR_DONE(hada_fit_find_common_light(&fit, pure, &left, err));
    if (hada_colours_known(fit.colour_matrix) && fit.channels == HADA_COLOURS)
        hada_colours_mix(left.data, hada_image_count(&left) / HADA_COLOURS, fit.colour_matrix);
    for (size_t i = 0; i < hada_image_count(&left); i++)
        mended->dark.data[i] += left.data[i];
done:
    hada_image_destroy(&left);
    hada_dataset_destroy(&pure);
    hada_dataset_destroy(&even);
    return status;
}

/* Brings frames whose channels differ in exposure to one white balance. *data: the pairs that are; *found: whether any
 * differed. */
static hada_status balance(hada_mended *mended, const hada_dataset **data, hada_context *context,
                           const hada_survey *survey, const hada_fit_options *callers, const hada_communicator *ranks,
                           int *found, hada_error *err)
{
    const size_t count = (size_t)(*data)->store->pairs * (size_t)callers->channels;
    hada_fit_options fit = *callers;
    hada_dataset *even = NULL;
    hada_status status = HADA_OK;
    fit.scene_response = survey->response;
    HADA_TRY_OR_DONE(hada_survey_apply(&even, survey, *data, err));
    HADA_TRY_OR_DONE(hada_fit_find_balance(&fit, context, even, &mended->balance, err));
    *found = mended->balance != NULL;
    HADA_TRY_OR_DONE(hada_broadcast(ranks, 0, found, sizeof *found, err));
    if (!*found)
        goto done;
    if (!mended->balance)
        HADA_TRY_OR_DONE(HADA_NEW(mended->balance, count, "the white balance of frames", err));
    HADA_TRY_OR_DONE(hada_broadcast(ranks, 0, mended->balance, count * sizeof *mended->balance, err));
    HADA_TRY_OR_DONE(hada_dataset_balance(&mended->balanced, *data, mended->balance, fit.channels, err));
    *data = mended->balanced;
done:
    hada_dataset_destroy(&even);
    return status;
}

hada_status hada_fit_survey(hada_survey **out, hada_dataset **even, hada_mended *mended, hada_context *context,
                            const hada_dataset *data, hada_fit_options *fit, hada_exposure exposure,
                            const hada_communicator *ranks, const hada_monitor *monitor, hada_error *err)
{
    const int given = hada_colours_known(fit->colour_matrix);
    const int common = hada_look_is_lit(fit, data);
    const double before = fit->dark;
    int balanced = 0;
    HADA_TRY(survey_colours(out, context, data, fit, exposure, err));
    const int mixed = !given && hada_colours_known(fit->colour_matrix);
    if (mixed && mended->no_level)
        HADA_TRY(find_level_again(*out, data, fit, err));
    if (mixed && (mended->unlit || fit->dark > before)) {
        if (mended->unlit)
            HADA_TRY(find_own_again(mended, fit, err));
        memset(fit->colour_matrix, 0, sizeof fit->colour_matrix);
        HADA_TRY(survey_colours(out, context, data, fit, exposure, err));
    }
    /* cameras balance frames that they encode; others look unbalanced where pairs say little of low frequencies */
    if (exposure != HADA_EXPOSURE_SAME && fit->frame_encoding == HADA_RESPONSE_SRGB &&
        !hada_colours_known(fit->colour_matrix))
        HADA_TRY(balance(mended, &data, context, *out, fit, ranks, &balanced, err));
    if (balanced) {
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE,
                          "frames differ in white balance: they are brought to one. New frames keep theirs, so fix the "
                          "camera's white balance");
        HADA_TRY(survey_colours(out, context, data, fit, exposure, err));
    }
    if (common) { /* the first rank's, as devices round differently */
        HADA_TRY(correct_light(mended, *out, data, fit, err));
        HADA_TRY(hada_broadcast(ranks, 0, mended->dark.data, hada_image_count(&mended->dark) * sizeof(float), err));
    }
    HADA_TRY(hada_survey_agree(*out, ranks, data, err));
    if ((*out)->exposed)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE,
                          "frames of one depth differ in exposure: each scene is learned as bright as its frame was "
                          "exposed");
    fit->scene_response = (*out)->response;
    if (!given)
        tell_colours(fit, monitor);
    return hada_survey_apply(even, *out, data, err);
}

void hada_mended_free(hada_mended *mended)
{
    hada_dataset_destroy(&mended->above);
    hada_dataset_destroy(&mended->sound);
    hada_dataset_destroy(&mended->linear);
    hada_dataset_destroy(&mended->balanced);
    hada_dataset_destroy(&mended->unlit);
    HADA_FREE(mended->balance, mended->light);
    hada_image_destroy(&mended->flat);
    hada_image_destroy(&mended->dark);
}

/* What the first rank found in the frames of pairs: devices and processors round differently. */
static hada_status agree_on_light(hada_mended *mended, hada_fit_options *fit, hada_own_light *own,
                                  const hada_communicator *ranks, hada_error *err)
{
    double found[] = {fit->dark, *own, mended->dark.data != NULL, fit->find_dark};
    HADA_TRY(hada_broadcast(ranks, 0, found, sizeof found, err));
    fit->dark = found[0];
    *own = (hada_own_light)found[1];
    fit->find_dark = found[3] != 0.0;
    if (found[2] == 0.0)
        hada_image_destroy(&mended->dark);
    else if (!mended->dark.data)
        HADA_TRY(hada_image_create(&mended->dark, fit->channels, fit->raw_rows, fit->raw_cols, err));
    return found[2] == 0.0 ? HADA_OK
                           : hada_broadcast(ranks, 0, mended->dark.data,
                                            hada_image_count(&mended->dark) * sizeof *mended->dark.data, err);
}

/* Takes light off that is in all frames. */
static hada_status darken(hada_mended *mended, const hada_dataset **data, const hada_fit_options *fit, hada_error *err)
{
    double mean = 0.0;
    HADA_TRY(hada_dataset_mend(&mended->above, *data, NULL, &mended->dark, err));
    *data = mended->above;
    for (size_t i = 0; i < hada_image_count(&mended->dark); i++)
        mean += mended->dark.data[i] / (double)hada_image_count(&mended->dark);
    hada_monitor_tell(fit->monitor, HADA_MESSAGE_NOTE,
                      "all frames hold light that comes from no scene, %.2g %% of full scale in the mean: the model "
                      "subtracts it. Frames of other light, such as of another room, need a --dark of their own",
                      100.0 * mean);
    return HADA_OK;
}

/* Takes light off that differs from frame to frame. */
static hada_status darken_each(hada_mended *mended, const hada_dataset **data, const hada_fit_options *fit, int apart,
                               hada_error *err)
{
    mended->lit = *data;
    mended->apart = apart;
    HADA_TRY(hada_fit_find_own_light(fit, mended->lit, apart, &mended->light, err));
    if (!mended->light)
        return HADA_OK;
    HADA_TRY(hada_dataset_unlit(&mended->unlit, mended->lit, mended->light, fit->channels, err));
    *data = mended->unlit;
    hada_monitor_tell(fit->monitor, HADA_MESSAGE_NOTE,
                      "frames hold light that comes from no scene and differs from frame to frame: it is subtracted "
                      "from each. Where the pairs are taken in the dark, models are better");
    return HADA_OK;
}

/* Finds whether raw frames are encoded for displays, for `fit`. *encoded: they seem to be, and stay so, for something
 * was given for them as they are. */
static hada_status find_encoding(const hada_dataset *data, hada_context *context, hada_fit_options *fit,
                                 const hada_communicator *ranks, int *encoded, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(data);
    HADA_TRY(hada_fit_seem_encoded(fit, context, data, HADA_RESPONSE_SRGB, encoded, err));
    HADA_TRY(hada_broadcast(ranks, 0, encoded, sizeof *encoded, err));
    if (!*encoded)
        return HADA_OK;
    if (info->flat || info->dark_frame || info->downsample > 1 || fit->dark > 0.0) {
        hada_monitor_tell(fit->monitor, HADA_MESSAGE_NOTE,
                          "raw frames seem to be encoded for displays: taken for sRGB, they are explained far better; "
                          "say so (options.frame_encoding), with a dark level, dark and flat frames in linear light");
        return HADA_OK;
    }
    hada_monitor_tell(fit->monitor, HADA_MESSAGE_NOTE,
                      "raw frames are encoded for displays: taken for sRGB, they are explained far better. They are "
                      "decoded, as new frames will be whose files say nothing else (options.frame_encoding)");
    fit->frame_encoding = HADA_RESPONSE_SRGB;
    *encoded = 0;
    return HADA_OK;
}

hada_status hada_fit_decode(hada_mended *mended, const hada_dataset **data, hada_context *context,
                            hada_fit_options *fit, const hada_communicator *ranks, int *encoded, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(*data);
    const double encoding = (*data)->store->frame_encoding;
    hada_tiff_reader *reader = NULL;
    hada_pixels frame = {0};
    int z = 0;
    hada_status status = HADA_OK;
    *encoded = 0;
    if (fit->frame_encoding == HADA_AUTO)
        fit->frame_encoding = encoding;
    while (z < info->depths && !info->counts[z])
        z++;
    if (!info->has_files || z == info->depths || (fit->frame_encoding == HADA_AUTO && !fit->leave_one_out))
        return HADA_OK;
    const char *path = info->files[z][0].raw;
    HADA_TRY_OR_DONE(hada_tiff_open(&reader, path, err));
    HADA_TRY_OR_DONE(hada_tiff_read_stored(reader, 0, encoding, &frame, err));
    hada_tell_values(fit->monitor, path, reader, encoding, &frame);
    const hada_tiff_info *file = hada_tiff_get_info(reader);
    if (encoding != HADA_AUTO || file->encoding != 0.0 || file->is_float)
        goto done;
    /* cameras write linear frames in 10 to 16 bits, and bright ones of wide PSFs are explained as well if decoded */
    if (fit->frame_encoding == HADA_AUTO && file->bits == 8)
        HADA_TRY_OR_DONE(find_encoding(*data, context, fit, ranks, encoded, err));
    if (fit->frame_encoding != HADA_AUTO && fit->frame_encoding != HADA_RESPONSE_LINEAR) {
        HADA_TRY_OR_DONE(hada_dataset_decode(&mended->linear, *data, fit->frame_encoding, err));
        *data = mended->linear;
    }
done:
    free((void *)frame.data);
    hada_tiff_close(&reader);
    return status;
}

hada_status hada_fit_mend(hada_mended *mended, const hada_dataset **data, hada_context *context, hada_fit_options *fit,
                          const hada_communicator *ranks, int surfaces, hada_error *err)
{
    size_t found = 0;
    int encoded;
    HADA_TRY(hada_fit_decode(mended, data, context, fit, ranks, &encoded, err));
    HADA_TRY(hada_fit_find_bad_pixels(fit, *data, &mended->flat, &found, err));
    if (found) {
        hada_monitor_tell(fit->monitor, HADA_MESSAGE_NOTE,
                          "%zu value(s) of each frame are those of bad pixels, hot or dead: the model knows which, and "
                          "leaves them out",
                          found);
        HADA_TRY(hada_dataset_mend(&mended->sound, *data, &mended->flat, NULL, err));
        *data = mended->sound;
    }
    const int looks = surfaces && !encoded;
    hada_own_light own = HADA_OWN_LIGHT_NONE;
    const int open = fit->find_dark && fit->dark == 0.0 && !hada_dataset_get_info(*data)->dark_frame;
    HADA_TRY(hada_fit_find_dark(fit, *data, looks ? &mended->dark : NULL, looks ? &own : NULL, err));
    HADA_TRY(agree_on_light(mended, fit, &own, ranks, err));
    mended->no_level = open && !own && !fit->find_dark;
    if (mended->dark.data)
        HADA_TRY(darken(mended, data, fit, err));
    return own ? darken_each(mended, data, fit, own == HADA_OWN_LIGHT_APART, err) : HADA_OK;
}

hada_status hada_fit_choose_boundary(hada_fit_options *fit, hada_context *context, const hada_dataset *pairs, int given,
                                     hada_error *err)
{
    const double *const distances_mm = fit->distances_mm;
    hada_dataset *pure = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_dataset_unmix(&pure, pairs, fit->colour_matrix, err));
    if (fit->boundary != HADA_BOUNDARY_CIRCULAR && !given) {
        HADA_TRY_OR_DONE(hada_fit_find_boundary(fit, context, pure, err));
        hada_monitor_tell(fit->monitor, HADA_MESSAGE_DETAIL,
                          fit->boundary == HADA_BOUNDARY_CIRCULAR ? "no light leaves the sensor: boundary circular"
                                                                  : "light leaves the sensor: boundary padded");
    }
    if (fit->find_dark && fit->dark > 0.0)
        HADA_TRY_OR_DONE(hada_fit_refine_dark(fit, pure, err));
done:
    fit->distances_mm = distances_mm; /* not those of `pure` */
    hada_dataset_destroy(&pure);
    return status;
}

hada_status hada_fit_agree(hada_fit_options *fit, const hada_communicator *ranks, hada_error *err)
{
    double found[] = {fit->scene_response, fit->boundary, fit->grid_rows, fit->grid_cols, fit->dark};
    HADA_TRY(hada_broadcast(ranks, 0, found, sizeof found, err));
    fit->scene_response = found[0];
    fit->boundary = (hada_boundary)found[1];
    fit->grid_rows = (int)found[2];
    fit->grid_cols = (int)found[3];
    fit->dark = found[4];
    return hada_broadcast(ranks, 0, fit->colour_matrix, sizeof fit->colour_matrix, err);
}

/* The frame that a model is tried on. */
static hada_status take_trial(hada_image *frame, const hada_model_info *info, const hada_dataset *pairs,
                              hada_error *err)
{
    hada_pair pair = {0};
    hada_status status = HADA_OK;
    if (!pairs) {
        const size_t plane = (size_t)info->raw_rows * (size_t)info->raw_cols;
        HADA_TRY(hada_image_create(frame, info->channels, info->raw_rows, info->raw_cols, err));
        for (size_t c = 0; c < (size_t)info->channels; c++)
            frame->data[c * plane + plane / 2 + (size_t)info->raw_cols / 2] = 1.0f;
        return HADA_OK;
    }
    HADA_TRY(hada_pair_take(&pair, pairs, info->depths / 2, 0, err));
    status = hada_image_copy(frame, pair.raw, err);
    hada_pair_return(&pair);
    return status;
}

static int is_black(const hada_result *result)
{
    float most = 0.0f;
    for (int z = 0; most == 0.0f && z < result->depths; z++)
        hada_not_finite(result->planes[z].data, hada_image_count(&result->planes[z]), &most);
    return most == 0.0f;
}

static hada_status try_model(const hada_model *model, hada_context *context, const hada_dataset *pairs, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    hada_plan_options options;
    hada_plan *plan = NULL;
    hada_image frame = {0};
    hada_result result = {0};
    hada_error why = {0};
    hada_status status = HADA_OK;
    hada_plan_options_init(&options);
    options.scene = HADA_SCENE_PLANES;
    options.repair_not_finite = 1;
    if (!pairs) {
        options.refine = 0;
        options.dark = HADA_DARK_NONE;
        options.mosaic = HADA_MOSAIC_NONE;
    }
    HADA_TRY_OR_DONE(take_trial(&frame, info, pairs, &why));
    HADA_TRY_OR_DONE(hada_plan_create(&plan, context, model, &options, &why));
    HADA_TRY_OR_DONE(hada_plan_run(plan, &frame, &result, &why));
    if (!pairs && is_black(&result))
        status = hada_fail(&why, HADA_ERROR_NUMERIC, "its filters make nothing but black of a point of light");
done:
    hada_result_destroy(&result);
    hada_plan_destroy(&plan);
    hada_image_destroy(&frame);
    if (status == HADA_ERROR_DEVICE_MEMORY) /* which says nothing of the model */
        return HADA_OK;
    return status ? hada_fail(err, status, "what was learned is no model of a camera: %s", why.message) : HADA_OK;
}

hada_status hada_model_complete(hada_model **model, int half, hada_context *context, const hada_dataset *pairs,
                                hada_error *err)
{
    hada_model *halved = NULL;
    if (half) {
        HADA_TRY(hada_model_to_half(&halved, *model, err));
        hada_model_destroy(model);
        *model = halved;
    }
    HADA_TRY(hada_model_check_numbers(*model, err));
    return context ? try_model(*model, context, pairs, err) : HADA_OK;
}
