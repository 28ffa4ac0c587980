/* Models: making, checking, freeing, and the copy with half-precision filters. */
#include "model/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/error.h"
#include "model/half_filter.h"
#include "io/safetensors.h"

static const char *const form_names[] = {"", "complex", "split", "matched", "wiener"};
static const char *const boundary_names[] = {"", "circular", "padded"};

const char *hada_form_name(hada_form form)
{
    return form >= HADA_FORM_COMPLEX && form <= HADA_FORM_WIENER ? form_names[form] : "";
}

const char *hada_boundary_name(hada_boundary boundary)
{
    return boundary == HADA_BOUNDARY_CIRCULAR || boundary == HADA_BOUNDARY_PADDED ? boundary_names[boundary] : "";
}

hada_form hada_form_from_name(const char *name)
{
    for (int form = HADA_FORM_COMPLEX; form <= HADA_FORM_WIENER; form++)
        if (!strcmp(name, form_names[form]))
            return (hada_form)form;
    return (hada_form)0;
}

hada_boundary hada_boundary_from_name(const char *name)
{
    for (int boundary = HADA_BOUNDARY_CIRCULAR; boundary <= HADA_BOUNDARY_PADDED; boundary++)
        if (!strcmp(name, boundary_names[boundary]))
            return (hada_boundary)boundary;
    return (hada_boundary)0;
}

size_t hada_model_info_plane(const hada_model_info *info)
{
    return (size_t)info->grid_rows * (size_t)(info->grid_cols / 2 + 1);
}

size_t hada_model_plane(const hada_model *model)
{
    return hada_model_info_plane(&model->info);
}

double hada_model_gain(const hada_model *model)
{
    const size_t plane = hada_model_plane(model);
    double gain = 0.0;
    for (int i = 0; model->otf && i < model->info.depths * model->info.channels; i++) {
        const float *first = model->otf + (size_t)i * plane * 2;
        gain = fmax(gain, (double)first[0] * first[0] + (double)first[1] * first[1]);
    }
    return gain > 0.0 ? gain : 1.0;
}

static int not_negative(double value)
{
    return isfinite(value) && value >= 0.0;
}

hada_status hada_model_info_check(const hada_model_info *info, hada_error *err)
{
    hada_geometry geometry;
    if (info->depths < 1 || info->depths > 4096 || info->channels < 1 || info->channels > 64)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the model says %d depths and %d channels; 1 to 4096 and 1 to 64 can be", info->depths,
                         info->channels);
    if (!*hada_form_name(info->form) || !*hada_boundary_name(info->boundary))
        return hada_fail(err, HADA_ERROR_MODEL, "the model's form or boundary is unknown");
    if (!not_negative(info->alpha) || !not_negative(info->lambda) || !not_negative(info->noise) ||
        !not_negative(info->refine_rho) || !not_negative(info->refine_tv) || !isfinite(info->dark) ||
        info->refine_steps < 0)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the model's alpha, lambda, noise, dark level or refinement settings are not usable numbers");
    if (info->distances_mm)
        for (int z = 0; z < info->depths; z++)
            if (!isfinite(info->distances_mm[z]) || (z && info->distances_mm[z] <= info->distances_mm[z - 1]))
                return hada_fail(err, HADA_ERROR_MODEL,
                                 "the model's distances must ascend, near to far; number %d is %g mm", z,
                                 info->distances_mm[z]);
    return hada_geometry_of(info, &geometry, err);
}

hada_status hada_model_create_head(hada_model **out, const hada_model_info *info, hada_error *err)
{
    hada_model *model;
    *out = NULL;
    hada_status status = hada_model_info_check(info, err);
    if (!status)
        status = hada_alloc((void **)&model, 1, sizeof *model, "a model", err);
    if (status)
        return status;
    const size_t depths = (size_t)info->depths;
    model->info = *info;
    model->info.enhance = model->info.enhance_rows = model->info.enhance_cols = 0; /* until it has the net */
    status = hada_alloc((void **)&model->distances, depths, sizeof *model->distances, "the distances", err);
    if (!status && !(model->name = hada_string_copy(info->name ? info->name : "")))
        status = hada_fail(err, HADA_ERROR_MEMORY, "no memory for a model");
    if (!status && info->distances_mm)
        memcpy(model->distances, info->distances_mm, depths * sizeof *model->distances);
    model->info.distances_mm = model->distances;
    model->info.name = model->name;
    const uint64_t values = (uint64_t)info->depths * (uint64_t)info->channels * hada_model_plane(model);
    model->info.bytes = values * (info->half ? 4u : 8u) + (info->has_otf ? values * 8u : 0u);
    if (status)
        hada_model_destroy(&model);
    *out = model;
    return status;
}

hada_status hada_model_create_arrays(hada_model *model, int with_statistics, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const size_t plane = hada_model_plane(model), images = (size_t)info->depths * (size_t)info->channels;
    const size_t pair = hada_size_product(images, hada_size_product(plane, 2));
    hada_status status = info->half ? hada_alloc((void **)&model->filter_half, pair, 2, "the filters", err)
                                    : hada_alloc((void **)&model->filter, pair, 4, "the filters", err);
    if (!status && info->has_otf)
        status = hada_alloc((void **)&model->otf, pair, 4, "the transfer functions", err);
    if (!status && with_statistics)
        status = hada_alloc((void **)&model->scene_power, plane, 4, "the scenes' power", err);
    if (!status && with_statistics)
        status = hada_alloc((void **)&model->noise_power, images, sizeof(double), "the noise power", err);
    if (!status && with_statistics)
        status = hada_alloc((void **)&model->pairs, (size_t)info->depths, sizeof(double), "the numbers of pairs", err);
    return status;
}

hada_status hada_model_create(hada_model **out, const hada_model_info *info, int with_statistics, hada_error *err)
{
    hada_status status = hada_model_create_head(out, info, err);
    if (!status)
        status = hada_model_create_arrays(*out, with_statistics, err);
    if (status)
        hada_model_destroy(out);
    return status;
}

void hada_model_destroy(hada_model **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_model *model = *pointer;
    *pointer = NULL;
    if (model->mapped) {
        hada_tensors *tensors = model->mapped;
        hada_tensors_close(&tensors);
    } else {
        free(model->filter);
        free(model->filter_half);
        free(model->otf);
        free(model->scene_power);
    }
    hada_net_destroy(&model->enhance);
    free(model->noise_power);
    free(model->pairs);
    free(model->distances);
    free(model->name);
    free(model);
}

const hada_model_info *hada_model_get_info(const hada_model *model)
{
    return &model->info;
}

hada_status hada_model_to_half(hada_model **out, const hada_model *model, hada_error *err)
{
    if (!out || !model)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_model_to_half: out and model are needed");
    hada_model_info info = model->info;
    info.half = 1;
    hada_status status = hada_model_create(out, &info, model->scene_power != NULL, err);
    if (status)
        return status;
    hada_model *copy = *out;
    const size_t plane = hada_model_plane(model), images = (size_t)info.depths * (size_t)info.channels;
    const size_t values = images * plane * 2;
    if (model->filter_half)
        memcpy(copy->filter_half, model->filter_half, values * sizeof *copy->filter_half);
    for (size_t i = 0; !status && model->filter && i < images; i++)
        status = hada_filter_to_half(model->filter + 2 * i * plane, 2 * plane, copy->filter_half + 2 * i * plane, err);
    if (status) {
        hada_model_destroy(out);
        return status;
    }
    if (model->otf)
        memcpy(copy->otf, model->otf, values * sizeof *copy->otf);
    if (model->scene_power) {
        memcpy(copy->scene_power, model->scene_power, plane * sizeof *copy->scene_power);
        memcpy(copy->noise_power, model->noise_power, images * sizeof *copy->noise_power);
        memcpy(copy->pairs, model->pairs, (size_t)info.depths * sizeof *copy->pairs);
    }
    status = hada_model_copy_enhance(copy, model, err);
    if (status)
        hada_model_destroy(out);
    return status;
}
