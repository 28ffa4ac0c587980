/* Models: making, checking, giving a net, freeing. */
#include "model/model.h"

#include <hadalens/response.h>

#include "core/callers.h"
#include "core/fft_factor.h"
#include "core/numbers.h"
#include "netlist/net_list.h"

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

size_t hada_model_component_images(const hada_model_info *info)
{
    return (size_t)info->depths * (size_t)info->components * (size_t)info->channels;
}

size_t hada_model_component_weights(const hada_model_info *info)
{
    return (size_t)info->depths * (size_t)info->components * (size_t)info->window_rows * (size_t)info->window_cols;
}

hada_status hada_model_check_single(const hada_model_info *info, const char *what, hada_error *err)
{
    if (info->components < 2)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_MODEL,
                     "the PSFs of the camera %s vary over the field (%d components), and %s would take them for the "
                     "same everywhere: reconstruct with options.method rl or fista, or options.scene volume; or make a "
                     "model of the mean PSF with fit options.components 1",
                     info->name ? info->name : "", info->components, what);
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

hada_noise_share hada_model_noise_share(const hada_model *model)
{
    const hada_model_info *info = &model->info;
    const size_t plane = hada_model_plane(model), half = (size_t)info->grid_cols / 2 + 1;
    const double grid = (double)info->grid_rows * info->grid_cols, frame = (double)info->raw_rows * info->raw_cols;
    const int middle = info->depths / 2;
    double energy = 0.0;
    if (info->refine_noise > 0.0)
        return (hada_noise_share){info->refine_noise, info->refine_noise_largest};
    if (!model->otf || !model->scene_power || !(info->noise > 0.0))
        return (hada_noise_share){0.0, 0.0};
    for (int c = 0; c < info->channels; c++) {
        const float *h = model->otf + ((size_t)middle * (size_t)info->channels + (size_t)c) * plane * 2;
        for (size_t i = 0; i < plane; i++) {
            const size_t kx = i % half;
            const double twice = kx == 0 || 2 * kx == (size_t)info->grid_cols ? 1.0 : 2.0;
            energy += twice * ((double)h[2 * i] * h[2 * i] + (double)h[2 * i + 1] * h[2 * i + 1]) *
                      model->scene_power[i] / info->channels;
        }
    }
    /* by Parseval; the frame holds nearly all light of the grid */
    const double mean_square = energy / (grid * frame);
    return (hada_noise_share){mean_square > 0.0 ? info->noise / sqrt(mean_square) : 0.0, 0.0};
}

/* Limits of a model file's claims: far above any camera, and small enough that sizes do not overflow. */
enum { MOST_DEPTHS = 4096, MOST_CHANNELS = 64, MOST_NET_SIDE = 1 << 20, MOST_DOWNSAMPLE = 256, MOST_POSITIONS = 65536 };

/* Refinement with a rho far above the gain leaves nothing but black; a dark level is one of the frames' own units,
 * whose widest are counts of 32 bits. */
#define LEAST_RHO 1e-30 /* of a model that is refined */
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
    if (!hada_model_weight_is_known(info->alpha) || !hada_model_weight_is_known(info->lambda) ||
        !not_negative(info->noise) ||
        !(info->refine_rho >= (info->refine_steps > 0 ? LEAST_RHO : 0.0) && info->refine_rho <= MOST_RHO) ||
        !(not_negative(info->refine_tv) || info->refine_tv == HADA_AUTO) || !(fabs(info->dark) <= MOST_DARK) ||
        info->refine_steps < 0 || info->refine_steps > HADA_MODEL_MOST_STEPS || !not_negative(info->refine_ridge) ||
        !not_negative(info->refine_noise) || !not_negative(info->refine_noise_largest) ||
        (info->refine_colour != 0.0 && !(info->refine_colour >= 1.0)) || !isfinite(info->refine_colour))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the model's alpha, lambda, noise, dark level or refinement settings are not usable numbers");
    if (!(info->refine_share >= 0.0 && info->refine_share <= 1.0)) /* 0: not set, 1 */
        return hada_fail(err, HADA_ERROR_MODEL, "the share of refined planes, %g, does not lie between 0 and 1",
                         info->refine_share);
    if (info->scene_response != 0.0 && !hada_response_is_known(info->scene_response)) /* 0: not set, linear */
        return hada_fail(err, HADA_ERROR_MODEL, "the response of the model's scenes, %g, is none (hadalens/response.h)",
                         info->scene_response);
    if (info->frame_encoding != 0.0 && !hada_response_is_known(info->frame_encoding))
        return hada_fail(err, HADA_ERROR_MODEL, "the encoding of the model's frames, %g, is none (hadalens/response.h)",
                         info->frame_encoding);
    if (hada_colours_known(info->colour_matrix) &&
        (info->channels != HADA_COLOURS || !hada_colours_usable(info->colour_matrix)))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "a colour matrix is for cameras of three channels, and its numbers and those of its inverse "
                         "are at most 10; this one begins with %g, and the camera has %d channel(s)",
                         info->colour_matrix[0], info->channels);
    if (info->mosaic != HADA_MOSAIC_NONE && !hada_enum_name(HADA_ENUM_MOSAIC, (int)info->mosaic))
        return hada_fail(err, HADA_ERROR_MODEL, "the model's colour filter mosaic, %d, is none", (int)info->mosaic);
    if (info->mosaic != HADA_MOSAIC_NONE && info->channels != 3)
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "a camera with a colour filter mosaic has three channels, red, green and blue; this one has %d",
            info->channels);
    if (info->downsample < 0 || info->downsample > MOST_DOWNSAMPLE || /* 0: not set, 1 */
        (info->downsample < 2 && info->sensor_mosaic != HADA_MOSAIC_NONE) ||
        (info->sensor_mosaic != HADA_MOSAIC_NONE &&
         (!hada_enum_name(HADA_ENUM_MOSAIC, (int)info->sensor_mosaic) || info->channels != 3 || info->downsample % 2)))
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "downsample %d is not possible: it is 1 to %d, and even for a colour filter mosaic, of a camera "
            "of three channels",
            info->downsample, MOST_DOWNSAMPLE);
    if (info->components < 0 || info->components > HADA_MOST_COMPONENTS || info->positions < 0 || /* 0: not set, 1 */
        info->positions > HADA_MOST_POSITIONS ||
        (info->components > 1 &&
         (!info->has_otf || info->boundary != HADA_BOUNDARY_PADDED || info->positions < info->components ||
          !not_negative(info->lost) || !not_negative(info->lost_single))))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "PSFs that vary over the field have 1 to %d components, from as many positions at least, and "
                         "the boundary padded; the model says %d of %d",
                         HADA_MOST_COMPONENTS, info->components, info->positions);
    hada_error wrong = {0};
    if (hada_distances_check(info->distances_mm, info->depths, &wrong))
        return hada_fail(err, HADA_ERROR_MODEL, "the model's distances must ascend: %s", wrong.message);
    return hada_geometry_of(info, &geometry, err);
}

hada_status hada_model_create_head(hada_model **out, const hada_model_info *info, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_model *model = NULL;
    *out = NULL;
    HADA_TRY_OR_DONE(hada_model_info_check(info, err));
    HADA_TRY_OR_DONE(HADA_NEW(model, 1, "a model", err));
    const size_t depths = (size_t)info->depths;
    model->info = *info;
    if (model->info.refine_share == 0.0)
        model->info.refine_share = 1.0;
    if (model->info.scene_response == 0.0)
        model->info.scene_response = HADA_RESPONSE_LINEAR;
    if (!(info->refine_colour > 0.0)) /* not said */
        model->info.refine_colour = 1.0;
    model->info.downsample += !info->downsample;
    model->info.components += !info->components;
    model->info.enhance = model->info.enhance_rows = model->info.enhance_cols = 0; /* until it has the net */
    HADA_TRY_OR_DONE(HADA_NEW(model->distances, depths, "the distances", err));
    if (!(model->name = hada_string_copy(info->name ? info->name : "")))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory for a model"));
    if (info->distances_mm)
        memcpy(model->distances, info->distances_mm, depths * sizeof *model->distances);
    model->info.distances_mm = model->distances;
    model->info.name = model->name;
    HADA_TRY_OR_DONE(hada_model_set_flat(model, info->flat, err));
    HADA_TRY_OR_DONE(hada_model_set_dark(model, info->dark_frame, err));
    const uint64_t values = (uint64_t)info->depths * (uint64_t)info->channels * hada_model_plane(model);
    model->info.bytes = values * (info->half ? 4u : 8u) + (info->has_otf ? values * 8u : 0u);
    if (info->components > 1)
        model->info.bytes +=
            hada_model_component_images(info) * hada_model_plane(model) * 8u + hada_model_component_weights(info) * 4u;
done:
    if (status)
        hada_model_destroy(&model);
    *out = model;
    return status;
}

/* A frame of the sensor, `what` in messages, that all channels share or each has, into *own. */
static hada_status keep_frame(const hada_model_info *info, hada_image *own, const hada_image *frame, const char *what,
                              hada_error *err)
{
    const size_t count = hada_image_count(frame);
    if ((frame->channels != info->channels && frame->channels != 1) || frame->rows != info->raw_rows ||
        frame->cols != info->raw_cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "the %s frame has %d channel(s) of %d x %d pixels; the model's frames have %d of %d x %d",
                         what, frame->channels, frame->rows, frame->cols, info->channels, info->raw_rows,
                         info->raw_cols);
    HADA_TRY(hada_image_create(own, info->channels, frame->rows, frame->cols, err));
    for (size_t i = 0; i < hada_image_count(own); i++)
        own->data[i] = frame->data[i % count];
    return HADA_OK;
}

static hada_status set_frame(const hada_model_info *info, hada_image *own, const hada_image **shown,
                             const hada_image *frame, const char *what, hada_error *err)
{
    hada_image binned = {0};
    hada_image_destroy(own);
    *shown = NULL;
    if (!frame)
        return HADA_OK;
    if (hada_is_of_sensor(info, info->downsample, frame->rows, frame->cols))
        HADA_TRY(hada_image_downsample(&binned, frame, info->downsample, HADA_MOSAIC_NONE, 0, err));
    const hada_status status = keep_frame(info, own, binned.data ? &binned : frame, what, err);
    *shown = status ? NULL : own;
    hada_image_destroy(&binned);
    return status;
}

hada_status hada_model_set_flat(hada_model *model, const hada_image *flat, hada_error *err)
{
    return set_frame(&model->info, &model->flat, &model->info.flat, flat, "flat", err);
}

hada_status hada_model_set_dark(hada_model *model, const hada_image *dark, hada_error *err)
{
    return set_frame(&model->info, &model->dark_frame, &model->info.dark_frame, dark, "dark", err);
}

/* Room for the arrays that hada_model_create_head leaves out. */
static hada_status model_create_arrays(hada_model *model, int with_statistics, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const size_t plane = hada_model_plane(model), images = (size_t)info->depths * (size_t)info->channels;
    const size_t pair = hada_size_product(images, hada_size_product(plane, 2));
    HADA_TRY(info->half ? hada_allocated(model->filter_half = hada_alloc(pair, 2, "the filters", err))
                        : hada_allocated(model->filter = hada_alloc(pair, 4, "the filters", err)));
    if (info->has_otf)
        HADA_TRY(hada_allocated(model->otf = hada_alloc(pair, 4, "the transfer functions", err)));
    if (info->components > 1) {
        const size_t values = hada_size_product(hada_model_component_images(info), hada_size_product(plane, 2));
        HADA_TRY(hada_allocated(model->component_otf = hada_alloc(values, 4, "the transfer functions", err)));
        HADA_TRY(hada_allocated(model->component_weights =
                                    hada_alloc(hada_model_component_weights(info), 4, "weights of components", err)));
        HADA_TRY(
            HADA_NEW(model->singular_values, (size_t)info->depths * (size_t)info->positions, "singular values", err));
    }
    if (with_statistics) {
        HADA_TRY(hada_allocated(model->scene_power = hada_alloc(plane, 4, "the scenes' power", err)));
        HADA_TRY(HADA_NEW(model->noise_power, images, "the noise power", err));
        HADA_TRY(HADA_NEW(model->pairs, (size_t)info->depths, "the numbers of pairs", err));
    }
    return HADA_OK;
}

hada_status hada_model_create(hada_model **out, const hada_model_info *info, int with_statistics, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_model_create_head(out, info, err));
    HADA_TRY_OR_DONE(model_create_arrays(*out, with_statistics, err));
done:
    if (status)
        hada_model_destroy(out);
    return status;
}

hada_model *hada_model_hold(const hada_model *model)
{
    hada_model *own = (hada_model *)model;
    atomic_fetch_add(&own->holders, 1);
    return own;
}

void hada_model_destroy(hada_model **pointer)
{
    hada_model *model = hada_taken(pointer);
    if (!model || atomic_fetch_sub(&model->holders, 1) > 0)
        return;
    if (model->file) {
        hada_tensors *tensors = model->file;
        hada_tensors_close(&tensors);
    } else {
        HADA_FREE(model->filter, model->filter_half, model->otf, model->scene_power, model->component_otf,
                  model->component_weights);
    }
    hada_net_destroy(&model->enhance);
    hada_image_destroy(&model->flat);
    hada_image_destroy(&model->dark_frame);
    HADA_FREE(model->noise_power, model->pairs, model->singular_values, model->distances, model->name, model);
}

const hada_model_info *hada_model_get_info(const hada_model *model)
{
    return model ? &model->info : NULL;
}

hada_status hada_model_own_enhance(hada_model *model, hada_net *net, int rows, int cols, hada_error *err)
{
    hada_net_destroy(&model->enhance);
    model->enhance = net;
    model->info.enhance = 1;
    model->info.enhance_rows = rows;
    model->info.enhance_cols = cols;
    const hada_net_info *info = hada_net_get_info(net);
    /* twice as many channels: it also gets the light of the other planes */
    const int fits = info->channels == model->info.channels || info->channels == 2 * model->info.channels;
    if (!fits || info->out_channels != model->info.channels)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the net takes images of %d channel(s) and gives %d; the model's planes have %d",
                         info->channels, info->out_channels, model->info.channels);
    if ((rows || cols) && (rows < 1 || cols < 1 || rows > MOST_NET_SIDE || cols > MOST_NET_SIDE))
        return hada_fail(err, HADA_ERROR_MODEL, "the net's size %d x %d is none", rows, cols);
    return HADA_OK;
}

hada_status hada_model_get_arrays(const hada_model *model, hada_model_arrays *arrays, hada_error *err)
{
    HADA_NEED(model && arrays, err);
    HADA_TRY(HADA_REPORT_CHECK(arrays, hada_model_arrays, err));
    const hada_model_arrays own = {.size = sizeof own,
                                   .filters = model->filter,
                                   .half_filters = model->filter_half,
                                   .otf = model->otf,
                                   .component_otf = model->component_otf,
                                   .component_weights = model->component_weights,
                                   .singular_values = model->singular_values};
    HADA_REPORT_GIVE(arrays, &own);
    return HADA_OK;
}

const hada_net *hada_model_get_enhance(const hada_model *model)
{
    return model ? model->enhance : NULL;
}

/* Sizes: frame and window on the grid. */

#define LARGEST_SIDE 65536

hada_status hada_geometry_of(const hada_model_info *info, hada_geometry *out, hada_error *err)
{
    if (info->window_rows < 1 || info->window_cols < 1 || info->window_rows > info->raw_rows ||
        info->window_cols > info->raw_cols || info->raw_rows > info->grid_rows || info->raw_cols > info->grid_cols ||
        info->grid_rows > 4 * LARGEST_SIDE || info->grid_cols > 4 * LARGEST_SIDE)
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "the model's sizes do not fit: window %d x %d, frame %d x %d, grid %d x %d (each must hold the "
            "one before)",
            info->window_rows, info->window_cols, info->raw_rows, info->raw_cols, info->grid_rows, info->grid_cols);
    if (info->boundary == HADA_BOUNDARY_CIRCULAR &&
        (info->grid_rows != info->raw_rows || info->grid_cols != info->raw_cols))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the model's boundary is circular, but its grid %d x %d is not the frame %d x %d",
                         info->grid_rows, info->grid_cols, info->raw_rows, info->raw_cols);
    out->raw_row = (info->grid_rows - info->raw_rows) / 2;
    out->raw_col = (info->grid_cols - info->raw_cols) / 2;
    out->window_row = out->raw_row + (info->raw_rows - info->window_rows) / 2;
    out->window_col = out->raw_col + (info->raw_cols - info->window_cols) / 2;
    return HADA_OK;
}

hada_status hada_model_set_sizes(hada_model_info *info, int raw_rows, int raw_cols, int window_rows, int window_cols,
                                 hada_error *err)
{
    if (raw_rows < 1 || raw_cols < 1 || raw_rows > LARGEST_SIDE || raw_cols > LARGEST_SIDE)
        return hada_fail(err, HADA_ERROR_SIZE, "a frame of %d x %d is not possible (1 to %d pixels a side)", raw_rows,
                         raw_cols, LARGEST_SIDE);
    if (!window_rows && !window_cols) {
        window_rows = raw_rows;
        window_cols = raw_cols;
    }
    if (window_rows < 1 || window_cols < 1 || window_rows > raw_rows || window_cols > raw_cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "a window of %d x %d does not fit into frames of %d x %d; scenes must not be larger than raw "
                         "frames ('hadalens register' brings pictures that a display showed to their size)",
                         window_rows, window_cols, raw_rows, raw_cols);
    info->raw_rows = info->grid_rows = raw_rows;
    info->raw_cols = info->grid_cols = raw_cols;
    info->window_rows = window_rows;
    info->window_cols = window_cols;
    if (info->boundary == HADA_BOUNDARY_PADDED) {
        info->grid_rows = hada_fft_good_size(raw_rows + window_rows - 1);
        info->grid_cols = hada_fft_good_size(raw_cols + window_cols - 1);
    }
    return HADA_OK;
}

/* Models made from other models: in half precision, with a fixed form of filter, with another net. */

hada_status hada_model_create_like(hada_model **out, const hada_model *model, const hada_model_info *info,
                                   hada_error *err)
{
    const size_t plane = hada_model_plane(model), images = (size_t)info->depths * (size_t)info->channels;
    HADA_TRY(hada_model_create(out, info, model->scene_power != NULL, err));
    hada_model *copy = *out;
    if (model->otf)
        memcpy(copy->otf, model->otf, images * plane * 2 * sizeof *copy->otf);
    if (info->components > 1) {
        memcpy(copy->component_otf, model->component_otf,
               hada_model_component_images(info) * plane * 2 * sizeof *copy->component_otf);
        memcpy(copy->component_weights, model->component_weights,
               hada_model_component_weights(info) * sizeof *copy->component_weights);
        memcpy(copy->singular_values, model->singular_values,
               (size_t)info->depths * (size_t)info->positions * sizeof *copy->singular_values);
    }
    if (model->scene_power) {
        memcpy(copy->scene_power, model->scene_power, plane * sizeof *copy->scene_power);
        memcpy(copy->noise_power, model->noise_power, images * sizeof *copy->noise_power);
        memcpy(copy->pairs, model->pairs, (size_t)info->depths * sizeof *copy->pairs);
    }
    return HADA_OK;
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
    HADA_NEED(out && model, err);
    hada_model_info info = model->info;
    info.half = 1;
    HADA_TRY_OR_DONE(hada_model_create_like(out, model, &info, err));
    uint16_t *half = (*out)->filter_half;
    const size_t plane = 2 * hada_model_plane(model), images = (size_t)info.depths * (size_t)info.channels;
    if (model->filter_half)
        memcpy(half, model->filter_half, images * plane * sizeof *half);
    for (size_t i = 0; model->filter && i < images; i++)
        HADA_TRY_OR_DONE(hada_filter_to_half(model->filter + i * plane, plane, half + i * plane, err));
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
    HADA_NEED(out && model, err);
    HADA_TRY_OR_DONE(hada_model_create_like(out, model, &model->info, err));
    const size_t images = (size_t)model->info.depths * (size_t)model->info.channels;
    const size_t values = images * hada_model_plane(model) * 2;
    if (model->filter)
        memcpy((*out)->filter, model->filter, values * sizeof *model->filter);
    if (model->filter_half)
        memcpy((*out)->filter_half, model->filter_half, values * sizeof *model->filter_half);
    if (net)
        HADA_TRY_OR_DONE(copy_enhance(*out, net, rows, cols, err));
done:
    if (status)
        hada_model_destroy(out);
    return status;
}

/* How often the power at a place of a half spectrum counts: between its first and its Nyquist column twice. */
static double power_at(const float *otf, const hada_model_info *info, size_t row, size_t col)
{
    const float *value = otf + 2 * (row * ((size_t)info->grid_cols / 2 + 1) + col);
    const int alone = col == 0 || 2 * col == (size_t)info->grid_cols;
    return (alone ? 1.0 : 2.0) * ((double)value[0] * value[0] + (double)value[1] * value[1]);
}

double hada_model_mean_square(const float *otf, const hada_model_info *info)
{
    double sum = 0.0;
    for (size_t row = 0; row < (size_t)info->grid_rows; row++)
        for (size_t col = 0; col <= (size_t)info->grid_cols / 2; col++)
            sum += power_at(otf, info, row, col);
    return sum / ((double)info->grid_rows * info->grid_cols);
}

double hada_model_sharpness(const float *otf, const hada_model_info *info)
{
    const double turn = 6.283185307179586, first = cos(turn / info->grid_cols);
    double own = 0.0, near = 0.0;
    for (size_t row = 0; row < (size_t)info->grid_rows; row++) {
        /* sums over three neighbours of exp(2 pi i k / count) are 1 + 2 cos(2 pi k / count); along a row by recurrence
         */
        const double down = 1.0 + 2.0 * cos(turn * (double)row / info->grid_rows);
        double across = 1.0, before = first;
        for (size_t col = 0; col <= (size_t)info->grid_cols / 2; col++) {
            const double power = power_at(otf, info, row, col), next = 2.0 * first * across - before;
            own += power;
            near += power * (down * (1.0 + 2.0 * across) - 1.0);
            before = across;
            across = next;
        }
    }
    return near > 0.0 ? own / near : INFINITY;
}

void hada_model_make_filter(const float *otf, size_t plane, hada_form form, double floor, float *filter)
{
    const double centre = (double)otf[0] * otf[0] + (double)otf[1] * otf[1];
    for (size_t i = 0; i < plane; i++) {
        const double re = otf[2 * i], im = otf[2 * i + 1];
        const double under = form == HADA_FORM_MATCHED ? centre : re * re + im * im + floor;
        const double gain = under > 0.0 ? 1.0 / under : 0.0;
        filter[2 * i] = (float)(re * gain);
        filter[2 * i + 1] = (float)(-im * gain);
    }
}

hada_status hada_model_with_form(hada_model **out, const hada_model *model, hada_form form, double lambda,
                                 hada_error *err)
{
    HADA_NEED(out && model, err);
    *out = NULL;
    if (form != HADA_FORM_MATCHED && form != HADA_FORM_WIENER)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "only the forms matched and wiener can be made from a model");
    if (form == HADA_FORM_WIENER && !(lambda > 0.0 && hada_model_weight_is_known(lambda)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the lambda of a Wiener filter is %g; it is above 0 and at most %g",
                         lambda, HADA_MODEL_MOST_WEIGHT);
    if (!model->otf)
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "the model holds no transfer functions, from which the matched and the Wiener filter are made");
    hada_model_info info = model->info;
    info.form = form;
    info.half = 0;
    info.alpha = 0.0;
    info.lambda = form == HADA_FORM_WIENER ? lambda : 0.0;
    HADA_TRY(hada_model_create_like(out, model, &info, err));
    const hada_model *copy = *out;
    const size_t plane = hada_model_plane(model), images = (size_t)info.depths * (size_t)info.channels;
    for (size_t i = 0; i < images; i++) {
        const float *otf = copy->otf + 2 * i * plane;
        const double floor = form == HADA_FORM_MATCHED ? 0.0 : info.lambda * hada_model_mean_square(otf, &info);
        hada_model_make_filter(otf, plane, info.form, floor, copy->filter + 2 * i * plane);
    }
    return HADA_OK;
}
