/* The fixed filters of a model that has transfer functions. */
#include <math.h>
#include <string.h>

#include "core/error.h"
#include "model/model.h"

/* Mean of |H|^2 over the whole plane: the half spectrum's columns between the first and the Nyquist one count twice. */
static double mean_square(const float *otf, const hada_model_info *info)
{
    const size_t cols = (size_t)info->grid_cols / 2 + 1;
    double sum = 0.0;
    for (size_t row = 0; row < (size_t)info->grid_rows; row++)
        for (size_t col = 0; col < cols; col++) {
            const float *value = otf + 2 * (row * cols + col);
            const int alone = col == 0 || 2 * col == (size_t)info->grid_cols;
            sum += (alone ? 1.0 : 2.0) * ((double)value[0] * value[0] + (double)value[1] * value[1]);
        }
    return sum / ((double)info->grid_rows * info->grid_cols);
}

static void make_filter(const float *otf, const hada_model_info *info, float *filter)
{
    const size_t plane = hada_model_info_plane(info);
    const int matched = info->form == HADA_FORM_MATCHED;
    const double centre = (double)otf[0] * otf[0] + (double)otf[1] * otf[1];
    const double floor = matched ? 0.0 : info->lambda * mean_square(otf, info);
    for (size_t i = 0; i < plane; i++) {
        const double re = otf[2 * i], im = otf[2 * i + 1];
        const double under = matched ? centre : re * re + im * im + floor;
        const double gain = under > 0.0 ? 1.0 / under : 0.0;
        filter[2 * i] = (float)(re * gain);
        filter[2 * i + 1] = (float)(-im * gain);
    }
}

hada_status hada_model_with_form(hada_model **out, const hada_model *model, hada_form form, double lambda,
                                 hada_error *err)
{
    if (!out || !model)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_model_with_form: out and model are needed");
    *out = NULL;
    if (form != HADA_FORM_MATCHED && form != HADA_FORM_WIENER)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "only the forms matched and wiener can be made from a model");
    if (form == HADA_FORM_WIENER && !(isfinite(lambda) && lambda > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the lambda of a Wiener filter must be greater than zero");
    if (!model->otf)
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "the model holds no transfer functions, from which the matched and the Wiener filter are made");
    hada_model_info info = model->info;
    info.form = form;
    info.half = 0;
    info.alpha = 0.0;
    info.lambda = form == HADA_FORM_WIENER ? lambda : 0.0;
    hada_status status = hada_model_create(out, &info, model->scene_power != NULL, err);
    if (status)
        return status;
    hada_model *copy = *out;
    const size_t plane = hada_model_plane(model), images = (size_t)info.depths * (size_t)info.channels;
    memcpy(copy->otf, model->otf, images * plane * 2 * sizeof *copy->otf);
    if (model->scene_power) {
        memcpy(copy->scene_power, model->scene_power, plane * sizeof *copy->scene_power);
        memcpy(copy->noise_power, model->noise_power, images * sizeof *copy->noise_power);
        memcpy(copy->pairs, model->pairs, (size_t)info.depths * sizeof *copy->pairs);
    }
    for (size_t i = 0; i < images; i++)
        make_filter(copy->otf + 2 * i * plane, &info, copy->filter + 2 * i * plane);
    return HADA_OK;
}
