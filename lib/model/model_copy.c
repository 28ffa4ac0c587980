/* Models made from other models: in half precision, with a fixed form of filter, with another net. */
#include <math.h>
#include <string.h>

#include "core/error.h"
#include "io/safetensors.h"
#include "model/model.h"
#include "netlist/net_list.h"

/* The transfer functions, and what the fit knew of scenes and noise. */
static void copy_knowledge(hada_model *copy, const hada_model *model)
{
    const hada_model_info *info = &model->info;
    const size_t plane = hada_model_plane(model), images = (size_t)info->depths * (size_t)info->channels;
    if (model->otf)
        memcpy(copy->otf, model->otf, images * plane * 2 * sizeof *copy->otf);
    if (model->scene_power) {
        memcpy(copy->scene_power, model->scene_power, plane * sizeof *copy->scene_power);
        memcpy(copy->noise_power, model->noise_power, images * sizeof *copy->noise_power);
        memcpy(copy->pairs, model->pairs, (size_t)info->depths * sizeof *copy->pairs);
    }
}

/* Gives `model` a copy of a net. */
static hada_status copy_enhance(hada_model *model, const hada_net *net, int rows, int cols, hada_error *err)
{
    hada_net *own = NULL;
    const hada_status status = hada_net_copy(&own, net, err);
    return status ? status : hada_model_own_enhance(model, own, rows, cols, err);
}

/* Half precision keeps 11 bits: a filter loses 2^-12 of its norm by rounding alone, and may lose twice that. */
#define HALF_USUAL_LOSS 0x1p-12
#define HALF_MOST_LOSS  0x1p-11

hada_status hada_filter_to_half(const float *filter, size_t values, uint16_t *half, hada_error *err)
{
    double size = 0.0, lost = 0.0;
    for (size_t i = 0; i < values; i++) {
        half[i] = hada_half_from_float(filter[i]);
        if ((half[i] & 0x7c00u) == 0x7c00u)
            return hada_fail(
                err, HADA_ERROR_NUMERIC,
                "a filter value of %g does not fit into half precision (65504 at most); keep this model in "
                "single precision",
                (double)filter[i]);
        const double off = (double)filter[i] - hada_float_from_half(half[i]);
        size += (double)filter[i] * filter[i];
        lost += off * off;
    }
    if (lost > HALF_MOST_LOSS * HALF_MOST_LOSS * size)
        return hada_fail(
            err, HADA_ERROR_NUMERIC,
            "the filters are too small for half precision (%.2g of them would be lost, %.2g is usual): keep "
            "this model in single precision, or fit it again with raw frames divided by their full scale",
            sqrt(lost / size), HALF_USUAL_LOSS);
    return HADA_OK;
}

hada_status hada_model_to_half(hada_model **out, const hada_model *model, hada_error *err)
{
    hada_status status = HADA_OK;
    if (!out || !model)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_model_to_half: out and model are needed");
    hada_model_info info = model->info;
    info.half = 1;
    HADA_TRY_OR_DONE(hada_model_create(out, &info, model->scene_power != NULL, err));
    uint16_t *half = (*out)->filter_half;
    const size_t plane = 2 * hada_model_plane(model), images = (size_t)info.depths * (size_t)info.channels;
    if (model->filter_half)
        memcpy(half, model->filter_half, images * plane * sizeof *half);
    for (size_t i = 0; model->filter && i < images; i++)
        HADA_TRY_OR_DONE(hada_filter_to_half(model->filter + i * plane, plane, half + i * plane, err));
    copy_knowledge(*out, model);
    if (model->enhance)
        HADA_TRY_OR_DONE(copy_enhance(*out, model->enhance, info.enhance_rows, info.enhance_cols, err));
done:
    if (status)
        hada_model_destroy(out);
    return status;
}

hada_status hada_model_with_enhance(hada_model **out, const hada_model *model, const hada_net *net, int rows, int cols,
                                    hada_error *err)
{
    hada_status status = HADA_OK;
    if (!out || !model)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_model_with_enhance: out and model are needed");
    HADA_TRY_OR_DONE(hada_model_create(out, &model->info, model->scene_power != NULL, err));
    const size_t images = (size_t)model->info.depths * (size_t)model->info.channels;
    const size_t values = images * hada_model_plane(model) * 2;
    if (model->filter)
        memcpy((*out)->filter, model->filter, values * sizeof *model->filter);
    if (model->filter_half)
        memcpy((*out)->filter_half, model->filter_half, values * sizeof *model->filter_half);
    copy_knowledge(*out, model);
    if (net)
        HADA_TRY_OR_DONE(copy_enhance(*out, net, rows, cols, err));
done:
    if (status)
        hada_model_destroy(out);
    return status;
}

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
    const hada_status status = hada_model_create(out, &info, model->scene_power != NULL, err);
    if (status)
        return status;
    hada_model *copy = *out;
    const size_t plane = hada_model_plane(model), images = (size_t)info.depths * (size_t)info.channels;
    copy_knowledge(copy, model);
    for (size_t i = 0; i < images; i++)
        make_filter(copy->otf + 2 * i * plane, &info, copy->filter + 2 * i * plane);
    return HADA_OK;
}
