/* Light that is in all frames, more precisely than light.c finds it on small copies: with the crop in the model, from
 * pairs less the mean pair of their depth. In these it is not, so transfer functions are learned without it; what they
 * leave of the mean pair is the light. */
#include <hadalens/response.h>

#include "fit/look.h"
#include "image/correct.h"

/* Depths that are looked at at most, and pairs that each needs. */
enum { DEPTHS = 3, LEAST_PAIRS = 3 };

/* Copies of the pairs that were taken, with linear scenes, as they are and less their mean; known: where all pairs are
 * known, and so their mean, empty: everywhere. */
typedef struct centred_pairs {
    hada_image scene[HADA_LOOK_MOST], raw_less[HADA_LOOK_MOST], scene_less[HADA_LOOK_MOST];
    hada_image known;
} centred_pairs;

static void destroy(centred_pairs *of)
{
    for (int i = 0; i < HADA_LOOK_MOST; i++) {
        hada_image_destroy(&of->scene[i]);
        hada_image_destroy(&of->raw_less[i]);
        hada_image_destroy(&of->scene_less[i]);
    }
    hada_image_destroy(&of->known);
}

static void subtract_mean(hada_image *images, int count)
{
    for (size_t k = 0; k < hada_image_count(&images[0]); k++) {
        double mean = 0.0;
        for (int i = 0; i < count; i++)
            mean += (double)images[i].data[k] / count;
        for (int i = 0; i < count; i++)
            images[i].data[k] -= (float)mean;
    }
}

static hada_status find_known(hada_image *known, const hada_look *at, hada_error *err)
{
    for (int i = 0; i < at->count; i++) {
        const hada_image *weights = &at->weights[i];
        if (weights->data && !known->data) {
            HADA_TRY(hada_image_create(known, 1, weights->rows, weights->cols, err));
            for (size_t k = 0; k < hada_image_count(known); k++)
                known->data[k] = 1.0f;
        }
        for (size_t k = 0; weights->data && k < hada_image_count(known); k++)
            known->data[k] = weights->data[k] == 1.0f ? known->data[k] : 0.0f;
    }
    return HADA_OK;
}

static hada_status centre(centred_pairs *of, const hada_look *at, double response, hada_error *err)
{
    for (int i = 0; i < at->count; i++) {
        HADA_TRY(hada_image_copy(&of->scene[i], &at->scene[i], err));
        hada_response_convert(of->scene[i].data, hada_image_count(&of->scene[i]), response, HADA_RESPONSE_LINEAR);
        HADA_TRY(hada_image_copy(&of->scene_less[i], &of->scene[i], err));
        HADA_TRY(hada_image_copy(&of->raw_less[i], &at->raw[i], err));
    }
    subtract_mean(of->scene_less, at->count);
    subtract_mean(of->raw_less, at->count);
    return find_known(&of->known, at, err);
}

/* The surface of a channel that pairs of one depth leave: frames less predictions, in the mean, of pixels that all
 * know. */
static hada_status find_surface(const hada_look *at, const hada_dataset *pairs, const hada_image *known, float *rest,
                                double *surface, hada_error *err)
{
    const hada_fit_options *options = at->options;
    const size_t area = (size_t)options->raw_rows * (size_t)options->raw_cols;
    double left[HADA_LOOK_MOST];
    int rows, cols;
    hada_look_whole(options, &rows, &cols);
    HADA_TRY(hada_look_explain(at, rows, cols, pairs, left, NULL, rest, err));
    for (size_t k = 0; k < area; k++) {
        double sum = 0.0;
        for (int i = 0; i < at->count; i++)
            sum -= (double)rest[(size_t)i * area + k] / at->count;
        rest[k] = (float)sum;
    }
    hada_smooth_nearest(rest, known->data, options->raw_rows, options->raw_cols, surface);
    return HADA_OK;
}

/* Adds to the light the surface of a channel that the pairs of a depth have, as one of `parts` of a mean. */
static hada_status add_channel(hada_look *at, const hada_dataset *pairs, double response, int parts, hada_image *light,
                               hada_error *err)
{
    const size_t area = (size_t)light->rows * (size_t)light->cols;
    const double *distance = &at->options->distances_mm[at->depth];
    double surface[HADA_SMOOTH_TERMS];
    hada_image channel = {1, light->rows, light->cols, light->data + (size_t)(at->channel - 1) * area};
    hada_dataset *shown = NULL, *less = NULL;
    centred_pairs centred = {0};
    hada_look own;
    float *rest = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_look_take(at, pairs, err));
    HADA_TRY_OR_DONE(centre(&centred, at, response, err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(rest, (size_t)at->count * area, "frames", err));
    own = *at;
    memcpy(own.raw, centred.raw_less, sizeof own.raw);
    memcpy(own.scene, centred.scene_less, sizeof own.scene);
    for (int i = 0; i < at->count; i++)
        own.weights[i] = centred.known;
    HADA_TRY_OR_DONE(
        hada_dataset_from_weighted(&shown, 1, distance, &at->count, at->raw, centred.scene, at->weights, err));
    HADA_TRY_OR_DONE(hada_dataset_from_weighted(&less, 1, distance, &at->count, own.raw, own.scene, own.weights, err));
    own.learned = less;
    HADA_TRY_OR_DONE(find_surface(&own, shown, &centred.known, rest, surface, err));
    hada_smooth_add(surface, 1.0 / parts, &channel);
done:
    free(rest);
    destroy(&centred);
    hada_dataset_destroy(&shown);
    hada_dataset_destroy(&less);
    hada_look_return(at);
    return status;
}

hada_status hada_fit_find_common_light(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs,
                                       hada_image *light, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(pairs);
    hada_fit_options options = *fit;
    const int looked = hada_least(fit->depths, DEPTHS);
    int depth[DEPTHS], parts = 0;
    hada_status status = HADA_OK;
    HADA_TRY(hada_image_create(light, fit->channels, fit->raw_rows, fit->raw_cols, err));
    options.dark = 0.0;
    options.scene_response = HADA_RESPONSE_LINEAR;
    for (int k = 0; k < looked; k++) {
        const int z = hada_spread(k, looked, fit->depths);
        if (info->counts[z] >= LEAST_PAIRS)
            depth[parts++] = z;
    }
    for (int k = 0; k < parts; k++)
        for (int c = 0; c < fit->channels; c++) {
            hada_look at = {.context = context, .options = &options, .depth = depth[k], .channel = c + 1};
            at.group = hada_least(info->counts[depth[k]], HADA_LOOK_MOST);
            HADA_TRY_OR_DONE(add_channel(&at, pairs, fit->scene_response, parts, light, err));
        }
done:
    if (status)
        hada_image_destroy(light);
    return status;
}
