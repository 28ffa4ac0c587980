/* Light that is in all frames, more precisely than light.c finds it on small copies: with the crop in the model, from
 * pairs less the mean pair of their depth. In these it is not, so transfer functions are learned without it; what they
 * leave of the mean pair is the light. */
#include "fit/look.h"
#include "image/correct.h"

/* Depths that are looked at at most, and pairs that each needs. */
enum { DEPTHS = 3, LEAST_PAIRS = 3 };

/* Adds to the light the surface of a channel that the pairs of a depth have, as one of `parts` of a mean: what transfer
 * functions leave of the mean pair. */
static hada_status add_channel(hada_look *at, const hada_dataset *pairs, int parts, hada_image *light, hada_error *err)
{
    const size_t area = (size_t)light->rows * (size_t)light->cols;
    double surface[HADA_SMOOTH_TERMS], left;
    hada_image channel = {1, light->rows, light->cols, light->data + (size_t)(at->channel - 1) * area};
    float *rest = NULL;
    int rows, cols;
    hada_status status = HADA_OK;
    hada_look_whole(at->options, &rows, &cols);
    HADA_TRY_OR_DONE(HADA_NEW_RAW(rest, area, "frames", err));
    HADA_TRY_OR_DONE(hada_look_take(at, pairs, err));
    HADA_TRY_OR_DONE(hada_look_explain(at, rows, cols, at->mean, &left, NULL, rest, err));
    hada_smooth_nearest(rest, at->known.data, light->rows, light->cols, surface);
    hada_smooth_add(surface, -1.0 / parts, &channel);
done:
    free(rest);
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
    for (int k = 0; k < looked; k++) {
        const int z = hada_spread(k, looked, fit->depths);
        if (info->counts[z] >= LEAST_PAIRS)
            depth[parts++] = z;
    }
    for (int k = 0; k < parts; k++)
        for (int c = 0; c < fit->channels; c++) {
            hada_look at = {.context = context, .options = &options, .depth = depth[k], .channel = c + 1, .centred = 1};
            at.group = hada_least(info->counts[depth[k]], HADA_LOOK_MOST);
            HADA_TRY_OR_DONE(add_channel(&at, pairs, parts, light, err));
        }
done:
    if (status)
        hada_image_destroy(light);
    return status;
}
