#include "train/planes.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "filter/bank.h"
#include "filter/clip.h"
#include "filter/hadamard.h"
#include "image/statistics.h"
#include "refine/admm.h"
#include "refine/crosstalk.h"
#include "train/light.h"

struct hada_planes {
    hada_slot *slot;
    const hada_model *model;
    const hada_model_info *info;
    hada_hadamard *stage;
    hada_bank *bank;
    hada_refiner *refiner;     /* NULL: linear */
    hada_light light;          /* empty: nothing is composed */
    hada_buffer prior, planes; /* refined; linear */
    int others;                /* beside a plane stands what the others hold */
    double *levels;
    double noise_share; /* hada_model_noise_share() */
    float *room;        /* a channel of a frame, for its dark level */
};

static int is_refined(const hada_model_info *info)
{
    return info->has_otf && info->refine_steps > 0;
}

/* Depths that are explained together, at most. */
static int most_depths(const hada_model_info *info, int composes)
{
    return !composes ? 1 : info->depths < HADA_COMPOSED_DEPTHS ? info->depths : HADA_COMPOSED_DEPTHS;
}

static hada_refine_shape refine_shape(const hada_model_info *info, int composes)
{
    const int depths = most_depths(info, composes);
    hada_refine_shape shape =
        hada_refine_shape_of(info, depths, is_refined(info) ? hada_refine_most_steps(info->refine_steps, depths) : 1);
    shape.settle = shape.crosstalk = depths > 1;
    shape.tv = info->refine_tv > 0;
    shape.shrink = info->refine_shrink > 0;
    return shape;
}

static int bank_parts(const hada_model_info *info, int composes)
{
    const int refined = is_refined(info);
    return (refined ? 0 : HADA_BANK_FILTERS) | (refined || composes ? HADA_BANK_OTFS : 0);
}

static size_t plane_bytes(const hada_model_info *info)
{
    return (size_t)info->channels * (size_t)info->window_rows * (size_t)info->window_cols * sizeof(float);
}

hada_status hada_planes_bytes(const hada_context *context, const hada_model *model, int composes, size_t *bytes,
                              hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    const int refined = is_refined(info);
    hada_geometry geometry;
    *bytes = 0;
    hada_status status = hada_geometry_of(info, &geometry, err);
    if (status)
        return status;
    const hada_spectrum_layout layout = hada_hadamard_layout(context, info);
    const hada_refine_shape shape = refine_shape(info, composes);
    uint64_t all = hada_hadamard_bytes(context, info, 1) +
                   hada_bank_bytes(info, &layout, info->depths, bank_parts(info, composes), 0);
    if (composes)
        all += hada_light_bytes(context, info, &layout);
    if (refined && model->scene_power)
        all += (uint64_t)info->channels * layout.count * sizeof(float);
    all += refined ? hada_refiner_bytes(context, &shape) : plane_bytes(info);
    *bytes = (size_t)all;
    return HADA_OK;
}

/* Refinement takes depths from one buffer. */
static hada_status check_together(const hada_planes *planes, hada_error *err)
{
    size_t first;
    int left;
    hada_bank_otf(planes->bank, 0, &first, &left);
    return left == planes->info->depths
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_DEVICE_MEMORY,
                           "scenes of several depths need the transfer functions of %d depths in one buffer, and %s "
                           "takes %d: train without them (options.compose 0)",
                           planes->info->depths, planes->slot->context->info.name, left);
}

hada_status hada_planes_create(hada_planes **out, hada_slot *slot, const hada_model *model, int composes, int others,
                               hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    const int refined = is_refined(info);
    const hada_refine_shape shape = refine_shape(info, composes);
    hada_planes *planes = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(hada_allocated(planes = hada_alloc(1, sizeof *planes, "planes for training", err)));
    planes->slot = slot;
    planes->model = model;
    planes->info = info;
    planes->others = others;
    planes->noise_share = refined && info->refine_tv > 0 ? hada_model_noise_share(model) : 0.0;
    HADA_TRY_OR_DONE(
        hada_allocated(planes->levels = hada_alloc((size_t)info->channels, sizeof(double), "dark levels", err)));
    HADA_TRY_OR_DONE(hada_allocated(
        planes->room = hada_alloc((size_t)info->raw_rows * (size_t)info->raw_cols, sizeof(float), "dark levels", err)));
    HADA_TRY_OR_DONE(hada_hadamard_create(&planes->stage, slot, NULL, info, 1, err));
    HADA_TRY_OR_DONE(hada_bank_create(&planes->bank, slot, model, &planes->stage->layout, NULL, info->depths,
                                      bank_parts(info, composes), 0, err));
    if (composes) {
        HADA_TRY_OR_DONE(check_together(planes, err));
        HADA_TRY_OR_DONE(hada_light_create(&planes->light, slot, info, err));
    }
    if (refined) {
        HADA_TRY_OR_DONE(hada_bank_prior(&planes->prior, slot, model, &planes->stage->layout, err));
        HADA_TRY_OR_DONE(hada_refiner_create(&planes->refiner, slot, NULL, &shape, err));
    } else {
        HADA_TRY_OR_DONE(hada_buffer_create(&planes->planes, slot->context, plane_bytes(info), "a plane", err));
    }
done:
    if (status)
        hada_planes_destroy(&planes);
    *out = planes;
    return status;
}

void hada_planes_destroy(hada_planes **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_planes *planes = *pointer;
    *pointer = NULL;
    hada_slot_finish(planes->slot, NULL);
    hada_refiner_destroy(&planes->refiner);
    hada_bank_destroy(&planes->bank);
    hada_hadamard_destroy(&planes->stage);
    hada_light_destroy(&planes->light);
    hada_buffer_destroy(&planes->prior);
    hada_buffer_destroy(&planes->planes);
    free(planes->levels);
    free(planes->room);
    free(planes);
}

static hada_status check_frame(const hada_model_info *info, const hada_image *raw, hada_error *err)
{
    if (raw->channels != info->channels || raw->rows != info->raw_rows || raw->cols != info->raw_cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "the frame has %d channel(s) of %d x %d pixels; the model is for %d of %d x %d", raw->channels,
                         raw->rows, raw->cols, info->channels, info->raw_rows, info->raw_cols);
    if (hada_image_count_not_finite(raw))
        return hada_fail(err, HADA_ERROR_NOT_FINITE, "%zu pixel(s) of the frame are NaN or infinite",
                         hada_image_count_not_finite(raw));
    return HADA_OK;
}

/* The model's dark level, or that of each channel of the frame. */
static hada_status expose(hada_planes *planes, const hada_image *raw, hada_error *err)
{
    const hada_model_info *info = planes->info;
    const size_t pixels = (size_t)info->raw_rows * (size_t)info->raw_cols;
    for (int c = 0; c < info->channels; c++)
        planes->levels[c] =
            info->dark < 0 ? hada_dark_estimate(raw->data + (size_t)c * pixels, pixels, planes->room) : info->dark;
    return hada_hadamard_frame(planes->stage, raw->data, planes->levels, err);
}

/* Of the frame above its dark levels. */
static double mean_square(const hada_planes *planes, const hada_image *raw)
{
    const size_t pixels = (size_t)raw->rows * (size_t)raw->cols, count = (size_t)raw->channels * pixels;
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double light = raw->data[i] - planes->levels[i / pixels];
        sum += light * light;
    }
    return sum / (double)count;
}

static hada_status refine(hada_planes *planes, int depth, const hada_image *raw, const hada_composed *composed,
                          hada_error *err)
{
    const hada_model_info *info = planes->info;
    hada_refine_data data = {
        .spectrum = planes->stage->spectrum.mem, .frame = planes->stage->raw.mem, .prior = planes->prior.mem};
    hada_refine_rule rule;
    size_t image;
    const int one[1] = {0}, several = composed->count;
    /* all depths from the first one on, or from the pair's */
    data.otf = hada_bank_otf(planes->bank, several ? 0 : depth, &image, &data.otf_depths);
    data.otf_offset = image * planes->stage->layout.count;
    hada_refine_rule_init(&rule);
    rule.steps = info->refine_steps;
    const hada_refine_weights weights = {info->refine_tv, info->refine_colour, info->refine_shrink};
    const int depths = several ? several : 1;
    hada_refine_rule_weigh(
        &rule, info, &weights, depths, hada_model_gain(planes->model),
        hada_noise_unit(raw->data, raw->channels, raw->rows, raw->cols, planes->noise_share, mean_square(planes, raw)));
    hada_refine_rule_stop(&rule, info->boundary, depths);
    HADA_TRY(hada_refiner_run(planes->refiner, &data, &rule, 1, depths, several ? composed->depth : one, NULL, err));
    if (depths > 1)
        HADA_TRY(hada_refiner_fade(planes->refiner, depths, HADA_CROSSTALK, err));
    return HADA_OK;
}

static hada_status filter(hada_planes *planes, int depth, hada_error *err)
{
    const cl_mem out = planes->planes.mem;
    hada_status status = hada_hadamard_run(planes->stage, planes->bank, depth, 1, out, 0, err);
    return status ? status : hada_image_clip(planes->slot, out, planes->planes.bytes / sizeof(float), err);
}

/* The plane that stands at a place among those that were made. */
static hada_status read_plane(hada_planes *planes, int place, float *out, hada_error *err)
{
    const size_t bytes = plane_bytes(planes->info);
    const cl_mem from = planes->refiner ? hada_refiner_planes(planes->refiner) : planes->planes.mem;
    const cl_int code = clEnqueueReadBuffer(planes->slot->queue, from, CL_TRUE, (size_t)place * bytes, bytes, out, 0,
                                            NULL, hada_slot_event(planes->slot));
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueReadBuffer");
    hada_slot_moved(planes->slot, "read", (double)bytes);
    return HADA_OK;
}

static hada_status make_room(const hada_planes *planes, hada_image *out, hada_error *err)
{
    const hada_model_info *info = planes->info;
    const int channels = info->channels << planes->others;
    if (hada_image_count(out) * sizeof(float) == plane_bytes(info) << planes->others)
        return HADA_OK;
    hada_image_destroy(out);
    return hada_image_create(out, channels, info->window_rows, info->window_cols, err);
}

/* All planes of a composed scene added up in their order, in the first half of `out`: a linear filter makes one by
 * one. */
static hada_status add_up(hada_planes *planes, const hada_composed *composed, float *out, hada_error *err)
{
    const size_t values = plane_bytes(planes->info) / sizeof(float);
    float *one = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(one = hada_alloc(values, sizeof *one, "a sum of planes", err)));
    memset(out, 0, values * sizeof *out);
    for (int i = 0; i < composed->count; i++) {
        if (!planes->refiner)
            HADA_TRY_OR_DONE(filter(planes, composed->depth[i], err));
        HADA_TRY_OR_DONE(read_plane(planes, planes->refiner ? i : 0, one, err));
        for (size_t k = 0; k < values; k++)
            out[k] += one[k];
    }
done:
    free(one);
    return status;
}

/* The sum of all planes becomes what the others hold. */
static void take_off(const float *own, float *sum, size_t values)
{
    for (size_t k = 0; k < values; k++)
        sum[k] -= own[k];
}

static hada_status make_plane(hada_planes *planes, int depth, const hada_composed *composed, hada_image *out,
                              hada_error *err)
{
    const size_t values = plane_bytes(planes->info) / sizeof(float);
    int place = 0;
    for (int i = 0; planes->refiner && i < composed->count; i++)
        place = composed->depth[i] == depth ? i : place;
    if (!planes->refiner)
        HADA_TRY(filter(planes, depth, err));
    HADA_TRY(read_plane(planes, place, out->data, err));
    if (!planes->others)
        return HADA_OK;
    memset(out->data + values, 0, values * sizeof(float));
    if (planes->refiner && composed->count) {
        HADA_TRY(add_up(planes, composed, out->data + values, err));
        take_off(out->data, out->data + values, values);
    }
    return HADA_OK;
}

/* The sum of all planes, beside which there is nothing. */
static hada_status make_sum(hada_planes *planes, const hada_composed *composed, hada_image *out, hada_error *err)
{
    const size_t values = plane_bytes(planes->info) / sizeof(float);
    if (planes->others)
        memset(out->data + values, 0, values * sizeof(float));
    return add_up(planes, composed, out->data, err);
}

hada_status hada_planes_make(hada_planes *planes, int depth, hada_image *raw, const hada_composed *composed,
                             hada_image *out, hada_error *err)
{
    const hada_model_info *info = planes->info;
    if (depth < 0 || depth >= info->depths)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a plane of depth %d of %d", depth, info->depths);
    HADA_TRY(check_frame(info, raw, err));
    for (int i = 0; i < composed->count; i++)
        if (composed->light[i].data)
            HADA_TRY(hada_light_add(&planes->light, planes->bank, composed->depth[i], &composed->light[i], raw, err));
    HADA_TRY(expose(planes, raw, err));
    if (planes->refiner)
        HADA_TRY(refine(planes, depth, raw, composed, err));
    HADA_TRY(make_room(planes, out, err));
    return composed->whole ? make_sum(planes, composed, out, err) : make_plane(planes, depth, composed, out, err);
}
