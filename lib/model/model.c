/* Models: making, checking, giving a net, freeing. */
#include "model/model.h"

#include <hadalens/response.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/error.h"
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

double hada_model_noise_share(const hada_model *model)
{
    const hada_model_info *info = &model->info;
    const size_t plane = hada_model_plane(model), half = (size_t)info->grid_cols / 2 + 1;
    const double grid = (double)info->grid_rows * info->grid_cols, frame = (double)info->raw_rows * info->raw_cols;
    const int middle = info->depths / 2;
    double energy = 0.0;
    if (!model->otf || !model->scene_power || !(info->noise > 0.0))
        return 0.0;
    for (int c = 0; c < info->channels; c++) {
        const float *h = model->otf + ((size_t)middle * (size_t)info->channels + (size_t)c) * plane * 2;
        for (size_t i = 0; i < plane; i++) {
            const size_t kx = i % half;
            const double twice = kx == 0 || 2 * kx == (size_t)info->grid_cols ? 1.0 : 2.0;
            energy += twice * ((double)h[2 * i] * h[2 * i] + (double)h[2 * i + 1] * h[2 * i + 1]) *
                      model->scene_power[i] / info->channels;
        }
    }
    /* Parseval; a frame holds nearly all of what the grid does */
    const double mean_square = energy / (grid * frame);
    return mean_square > 0.0 ? info->noise / sqrt(mean_square) : 0.0;
}

/* Of what a model file may claim: far above any camera, and small enough that sizes do not overflow. */
enum { MOST_DEPTHS = 4096, MOST_CHANNELS = 64, MOST_NET_SIDE = 1 << 20 };

/* Refinement with a rho far above the gain leaves nothing but black; a dark level is one of the frames' own units,
 * whose widest are counts of 32 bits. */
#define MOST_RHO  1e3
#define MOST_DARK 4294967296.0

static int not_negative(double value)
{
    return isfinite(value) && value >= 0.0;
}

hada_status hada_model_info_check(const hada_model_info *info, hada_error *err)
{
    hada_geometry geometry;
    if (info->depths < 1 || info->depths > MOST_DEPTHS || info->channels < 1 || info->channels > MOST_CHANNELS)
        return hada_fail(err, HADA_ERROR_MODEL, "the model says %d depths and %d channels; 1 to %d and 1 to %d can be",
                         info->depths, info->channels, MOST_DEPTHS, MOST_CHANNELS);
    if (!*hada_form_name(info->form) || !*hada_boundary_name(info->boundary))
        return hada_fail(err, HADA_ERROR_MODEL, "the model's form or boundary is unknown");
    if (!not_negative(info->alpha) || !not_negative(info->lambda) || !not_negative(info->noise) ||
        !(info->refine_rho >= 0.0 && info->refine_rho <= MOST_RHO) || !not_negative(info->refine_tv) ||
        !(fabs(info->dark) <= MOST_DARK) || info->refine_steps < 0 || !not_negative(info->refine_shrink) ||
        (info->refine_colour != 0.0 && !(info->refine_colour >= 1.0)) || !isfinite(info->refine_colour))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the model's alpha, lambda, noise, dark level or refinement settings are not usable numbers");
    if (!(info->refine_share >= 0.0 && info->refine_share <= 1.0)) /* 0: not set, 1 */
        return hada_fail(err, HADA_ERROR_MODEL, "the share of refined planes, %g, does not lie between 0 and 1",
                         info->refine_share);
    if (info->scene_response != 0.0 && !hada_response_is_known(info->scene_response)) /* 0: not set, linear */
        return hada_fail(err, HADA_ERROR_MODEL, "the response of the model's scenes, %g, is none (hadalens/response.h)",
                         info->scene_response);
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
    hada_status status = HADA_OK;
    hada_model *model = NULL;
    *out = NULL;
    HADA_TRY_OR_DONE(hada_model_info_check(info, err));
    HADA_TRY_OR_DONE(hada_allocated(model = hada_alloc(1, sizeof *model, "a model", err)));
    const size_t depths = (size_t)info->depths;
    model->info = *info;
    if (model->info.refine_share == 0.0)
        model->info.refine_share = 1.0;
    if (model->info.scene_response == 0.0)
        model->info.scene_response = HADA_RESPONSE_LINEAR;
    if (!(info->refine_colour > 0.0)) /* not said */
        model->info.refine_colour = 1.0;
    model->info.enhance = model->info.enhance_rows = model->info.enhance_cols = 0; /* until it has the net */
    HADA_TRY_OR_DONE(
        hada_allocated(model->distances = hada_alloc(depths, sizeof *model->distances, "the distances", err)));
    if (!(model->name = hada_string_copy(info->name ? info->name : "")))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory for a model"));
    if (info->distances_mm)
        memcpy(model->distances, info->distances_mm, depths * sizeof *model->distances);
    model->info.distances_mm = model->distances;
    model->info.name = model->name;
    const uint64_t values = (uint64_t)info->depths * (uint64_t)info->channels * hada_model_plane(model);
    model->info.bytes = values * (info->half ? 4u : 8u) + (info->has_otf ? values * 8u : 0u);
done:
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
    HADA_TRY(info->half ? hada_allocated(model->filter_half = hada_alloc(pair, 2, "the filters", err))
                        : hada_allocated(model->filter = hada_alloc(pair, 4, "the filters", err)));
    if (info->has_otf)
        HADA_TRY(hada_allocated(model->otf = hada_alloc(pair, 4, "the transfer functions", err)));
    if (with_statistics) {
        HADA_TRY(hada_allocated(model->scene_power = hada_alloc(plane, 4, "the scenes' power", err)));
        HADA_TRY(hada_allocated(model->noise_power = hada_alloc(images, sizeof(double), "the noise power", err)));
        HADA_TRY(hada_allocated(model->pairs =
                                    hada_alloc((size_t)info->depths, sizeof(double), "the numbers of pairs", err)));
    }
    return HADA_OK;
}

hada_status hada_model_create(hada_model **out, const hada_model_info *info, int with_statistics, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_model_create_head(out, info, err));
    HADA_TRY_OR_DONE(hada_model_create_arrays(*out, with_statistics, err));
done:
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
    if (model->file) {
        hada_tensors *tensors = model->file;
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

hada_status hada_model_own_enhance(hada_model *model, hada_net *net, int rows, int cols, hada_error *err)
{
    hada_net_destroy(&model->enhance);
    model->enhance = net;
    model->info.enhance = 1;
    model->info.enhance_rows = rows;
    model->info.enhance_cols = cols;
    const hada_net_info *info = hada_net_get_info(net);
    /* twice as many: it sees what the other planes hold beside its own */
    const int fits = info->channels == model->info.channels || info->channels == 2 * model->info.channels;
    if (!fits || info->out_channels != model->info.channels)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the net takes images of %d channel(s) and gives %d; the model's planes have %d",
                         info->channels, info->out_channels, model->info.channels);
    if ((rows || cols) && (rows < 1 || cols < 1 || rows > MOST_NET_SIDE || cols > MOST_NET_SIDE))
        return hada_fail(err, HADA_ERROR_MODEL, "the net's size %d x %d is none", rows, cols);
    return HADA_OK;
}

const float *hada_model_get_filters(const hada_model *model)
{
    return model->filter;
}

const uint16_t *hada_model_get_half_filters(const hada_model *model)
{
    return model->filter_half;
}

const float *hada_model_get_otf(const hada_model *model)
{
    return model->otf;
}

const hada_net *hada_model_get_enhance(const hada_model *model)
{
    return model->enhance;
}
