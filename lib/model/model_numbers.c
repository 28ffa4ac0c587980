/* Numbers in the tensors of a model that no picture could come from. */

#include "core/base.h"
#include "core/finite.h"
#include "model/model.h"

/* Far beyond what any camera and unit of light bring, and narrow enough that squares and quotients stay in single
 * precision: with transfer functions times 1e-15 to 1e18, and filters over that, pictures came out; with 1e-18 a
 * refined one was black. Filters are about the reciprocals of transfer functions, powers about the squares of frames.
 */
#define OTF_MOST    1e15
#define FILTER_MOST 1e18
#define POWER_MOST  1e30
#define NOISE_MOST  1e12 /* over the power of the frames' light */
#define FLAT_MOST   1e9  /* 1 in the mean */

/* The largest magnitude; infinite where one of them is NaN or infinite. */
static double largest(const float *values, size_t count)
{
    float most;
    return hada_not_finite(values, count, &most) ? HUGE_VAL : (double)most;
}

/* Of half floats: 1 where some are not 0, infinite where one is NaN or infinite. */
static double largest_half(const uint16_t *values, size_t count)
{
    uint16_t most = 0;
    for (size_t i = 0; i < count; i++) {
        const uint16_t bits = values[i] & 0x7fff;
        most = bits > most ? bits : most;
    }
    return most >= 0x7c00 ? HUGE_VAL : most ? 1.0 : 0.0;
}

static int any_negative(const float *values, size_t count)
{
    int found = 0;
    for (size_t i = 0; i < count; i++)
        found |= values[i] < 0.0f;
    return found;
}

static hada_status wrong(const char *name, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_MODEL,
                     "the tensor %s holds numbers that are NaN, infinite or negative where that cannot be; fit again",
                     name);
}

/* Whether the largest of a depth (-1: of all) can be. */
static hada_status check_largest(const char *name, int depth, double most, double bound, hada_error *err)
{
    char where[32] = "";
    if (most == HUGE_VAL)
        return wrong(name, err);
    if (depth >= 0)
        snprintf(where, sizeof where, " of depth %d", depth);
    if (most == 0.0)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the tensor %s%s holds nothing but 0, from which pictures are black; fit again", name, where);
    if (!(most >= 1.0 / bound && most <= bound))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the largest number of the tensor %s%s is %g; from %g to %g can be: fit again", name, where,
                         most, 1.0 / bound, bound);
    return HADA_OK;
}

static hada_status check_doubles(const char *name, const double *values, size_t count, double most, hada_error *err)
{
    for (size_t i = 0; values && i < count; i++) {
        if (!isfinite(values[i]) || values[i] < 0.0)
            return wrong(name, err);
        if (values[i] > most)
            return hada_fail(err, HADA_ERROR_MODEL, "the tensor %s holds %g; at most %g can be: fit again", name,
                             values[i], most);
    }
    return HADA_OK;
}

hada_status hada_model_check_numbers(const hada_model *model, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const size_t plane = hada_model_plane(model), channels = (size_t)info->channels, values = channels * plane * 2;
    double gain = 0.0, power = 0.0;
    for (size_t z = 0; z < (size_t)info->depths; z++) {
        const int depth = (int)z;
        if (model->otf) {
            const double most = largest(model->otf + z * values, values);
            HADA_TRY(check_largest("otf", depth, most, OTF_MOST, err));
            gain = fmax(gain, most * most);
        }
        const double most = model->filter ? largest(model->filter + z * values, values)
                                          : largest_half(model->filter_half + z * values, values);
        HADA_TRY(check_largest("filter", depth, most, FILTER_MOST, err));
    }
    if (info->components > 1) {
        const size_t maps = hada_model_component_weights(info);
        HADA_TRY(check_largest("component_otf", -1,
                               largest(model->component_otf, hada_model_component_images(info) * plane * 2), OTF_MOST,
                               err));
        HADA_TRY(check_largest("component_weights", -1, largest(model->component_weights, maps), OTF_MOST, err));
        HADA_TRY(check_doubles("singular_values", model->singular_values,
                               (size_t)info->depths * (size_t)info->positions, HUGE_VAL, err));
    }
    if (info->flat) {
        const size_t pixels = hada_image_count(info->flat);
        HADA_TRY(any_negative(info->flat->data, pixels) ? wrong("flat", err) : HADA_OK);
        HADA_TRY(check_largest("flat", -1, largest(info->flat->data, pixels), FLAT_MOST, err));
    }
    HADA_TRY(check_doubles("pairs", model->pairs, (size_t)info->depths, HUGE_VAL, err));
    if (model->scene_power) {
        power = largest(model->scene_power, plane);
        HADA_TRY(any_negative(model->scene_power, plane) ? wrong("scene_power", err) : HADA_OK);
        HADA_TRY(check_largest("scene_power", -1, power, POWER_MOST, err));
    }
    return check_doubles("noise_power", model->noise_power, (size_t)info->depths * channels,
                         gain > 0.0 && power > 0.0 ? NOISE_MOST * gain * power : POWER_MOST, err);
}
