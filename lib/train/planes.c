#include "train/examples.h"

#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "planes/maker.h"
#include "refine/proximal.h"

/* The light that the sensor gets of a scene at one depth, by the learned transfer functions. */
typedef struct light_maker {
    hada_slot *slot;
    int channels;
    hada_fft *forward, *inverse; /* the window into a spectrum; a spectrum into the frame */
    hada_buffer image, spectrum; /* channels x the frame (the window before); channels x a spectrum */
    float *room;                 /* the frame, on the host */
    size_t frame, window;        /* floats */
    const double *colour_matrix; /* the model's */
} light_maker;

static void destroy_light(light_maker *light)
{
    hada_fft_destroy(&light->forward);
    hada_fft_destroy(&light->inverse);
    HADA_DESTROY_BUFFERS(&light->image, &light->spectrum);
    free(light->room);
    *light = (light_maker){0};
}

static hada_status create_light(light_maker *light, hada_slot *slot, const hada_model_info *info, hada_error *err)
{
    hada_geometry at;
    hada_status status = HADA_OK;
    *light = (light_maker){.slot = slot, .channels = info->channels, .colour_matrix = info->colour_matrix};
    light->frame = (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols;
    light->window = (size_t)info->channels * (size_t)info->window_rows * (size_t)info->window_cols;
    HADA_TRY_OR_DONE(hada_geometry_of(info, &at, err));
    const hada_fft_desc forward = hada_geometry_transform(info, &at, HADA_FFT_FORWARD, 1, 1);
    const hada_fft_desc inverse = hada_geometry_transform(info, &at, HADA_FFT_INVERSE, 0, 1);
    HADA_TRY_OR_DONE(hada_fft_create(&light->forward, slot, &forward, err));
    HADA_TRY_OR_DONE(hada_fft_create(&light->inverse, slot, &inverse, err));
    HADA_TRY_OR_DONE(
        hada_buffer_create(&light->image, slot->context, light->frame * sizeof(float), "a composed frame", err));
    HADA_TRY_OR_DONE(
        hada_buffer_create(&light->spectrum, slot->context,
                           (size_t)info->channels * hada_fft_plan_layout(light->forward)->count * 2 * sizeof(float),
                           "a scene's spectrum", err));
    HADA_TRY_OR_DONE(HADA_NEW(light->room, light->frame, "a composed frame", err));
done:
    if (status)
        destroy_light(light);
    return status;
}

/* frame += crop(PSF * scene); `scene` may be below zero. The bank holds transfer functions. */
static hada_status add_light(light_maker *light, const hada_bank *bank, int depth, const hada_image *scene,
                             hada_image *frame, hada_error *err)
{
    size_t first;
    int left;
    hada_fft_filter filter = {.product = HADA_FFT_COMPLEX, .spectrum_count = light->channels};
    filter.filter = hada_bank_otf(bank, depth, &first, &left);
    filter.filter_first = (int)first;
    HADA_TRY(hada_buffer_write(&light->image, light->slot, 0, scene->data, light->window * sizeof(float), err));
    HADA_TRY(hada_fft_forward(light->forward, light->channels, light->image.mem, 0, light->spectrum.mem, 0, err));
    HADA_TRY(
        hada_fft_inverse(light->inverse, light->channels, light->spectrum.mem, 0, light->image.mem, 0, &filter, err));
    HADA_TRY(hada_buffer_read(&light->image, light->slot, 0, light->room, light->frame * sizeof(float), err));
    if (hada_colours_known(light->colour_matrix)) /* as the sensor sees it */
        hada_colours_mix(light->room, light->frame / HADA_COLOURS, light->colour_matrix);
    for (size_t i = 0; i < light->frame; i++)
        frame->data[i] += light->room[i];
    return HADA_OK;
}

struct hada_planes {
    const hada_model_info *info;
    hada_hadamard *stage;
    hada_bank *bank;
    hada_refiner *refiner;     /* NULL: linear */
    hada_plane_maker maker;    /* of these */
    light_maker light;         /* empty: nothing is composed */
    hada_buffer prior, planes; /* refined; linear */
    int others;                /* 1: a plane comes with the sum of the others */
};

/* Depths that are explained together, at most. */
static int most_depths(const hada_model_info *info, int composes)
{
    return !composes ? 1 : info->depths < HADA_COMPOSED_DEPTHS ? info->depths : HADA_COMPOSED_DEPTHS;
}

static hada_refine_shape refine_shape(const hada_model_info *info, int composes)
{
    const hada_maker_way way = hada_maker_way_of(info, HADA_AUTO, HADA_MOSAIC_NONE);
    const int depths = most_depths(info, composes);
    hada_refine_shape shape =
        hada_refine_shape_of(info, depths, way.steps ? hada_refine_most_steps(way.steps, depths) : 1);
    shape.boundary = way.boundary;
    shape.settle = shape.crosstalk = depths > 1;
    shape.tv = way.choose || way.weights.tv > 0;
    shape.ridge = way.weights.ridge > 0;
    return shape;
}

static int bank_parts(const hada_model_info *info, int composes)
{
    const int refined = hada_maker_way_of(info, HADA_AUTO, HADA_MOSAIC_NONE).steps > 0;
    return (refined ? 0 : HADA_BANK_FILTERS) | (refined || composes ? HADA_BANK_OTFS : 0);
}

static size_t plane_bytes(const hada_model_info *info)
{
    return (size_t)info->channels * (size_t)info->window_rows * (size_t)info->window_cols * sizeof(float);
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
                           planes->info->depths, planes->maker.slot->context->info.name, left);
}

hada_status hada_planes_create(hada_planes **out, hada_slot *slot, const hada_model *model, int composes, int others,
                               hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    const hada_maker_way way = hada_maker_way_of(info, HADA_AUTO, HADA_MOSAIC_NONE);
    const int refined = way.steps > 0;
    const hada_refine_shape shape = refine_shape(info, composes);
    hada_planes *planes = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(planes, 1, "planes for training", err));
    planes->info = info;
    planes->others = others;
    planes->maker.slot = slot;
    HADA_TRY_OR_DONE(hada_hadamard_create(&planes->stage, slot, info, 1, err));
    HADA_TRY_OR_DONE(hada_bank_create(&planes->bank, slot, model, &planes->stage->layout, NULL, info->depths,
                                      bank_parts(info, composes), 0, err));
    if (composes) {
        HADA_TRY_OR_DONE(check_together(planes, err));
        HADA_TRY_OR_DONE(create_light(&planes->light, slot, info, err));
    }
    if (refined) {
        HADA_TRY_OR_DONE(hada_bank_prior(&planes->prior, slot, model, &planes->stage->layout, err));
        HADA_TRY_OR_DONE(hada_refiner_create(&planes->refiner, slot, &shape, err));
    } else {
        HADA_TRY_OR_DONE(hada_buffer_create(&planes->planes, slot->context, plane_bytes(info), "a plane", err));
    }
    planes->maker = (hada_plane_maker){.slot = slot,
                                       .boundary = way.boundary,
                                       .model = model,
                                       .stage = planes->stage,
                                       .bank = planes->bank,
                                       .refiner = planes->refiner,
                                       .weights = way.weights};
    if (refined && way.boundary == HADA_BOUNDARY_PADDED)
        HADA_TRY_OR_DONE(hada_maker_make_weights(&planes->maker, way.choose, err));
    if (refined && info->refine_tv > 0 && !slot->context->dry)
        planes->maker.noise_share = hada_model_noise_share(model);
done:
    if (status)
        hada_planes_destroy(&planes);
    *out = planes;
    return status;
}

void hada_planes_destroy(hada_planes **pointer)
{
    hada_planes *planes = hada_taken(pointer);
    if (!planes)
        return;
    hada_slot_finish(planes->maker.slot, NULL);
    hada_maker_free_weights(&planes->maker);
    hada_refiner_destroy(&planes->refiner);
    hada_bank_destroy(&planes->bank);
    hada_hadamard_destroy(&planes->stage);
    destroy_light(&planes->light);
    HADA_DESTROY_BUFFERS(&planes->prior, &planes->planes);
    free(planes);
}

hada_status hada_planes_bytes(const hada_context *context, const hada_model *model, int composes, size_t *bytes,
                              hada_error *err)
{
    hada_dry dry;
    hada_planes *planes;
    hada_dry_begin(&dry, context);
    const hada_status status = hada_planes_create(&planes, &dry.slot, model, composes, 0, err);
    *bytes = (size_t)hada_context_bytes(&dry.context);
    hada_planes_destroy(&planes);
    hada_dry_end(&dry);
    return status;
}

/* Depths that are refined together: all of a composed frame's, counted from the first one of the camera, or the pair's
 * alone. */
static hada_status refine(hada_planes *planes, int depth, const hada_frame_exposure *exposure,
                          const hada_composed *composed, hada_error *err)
{
    hada_plane_maker *maker = &planes->maker;
    const int one[1] = {0}, several = composed->count, count = several ? several : 1;
    const int all = hada_maker_way_of(planes->info, HADA_AUTO, HADA_MOSAIC_NONE).steps;
    const int last = hada_maker_ridge_steps(maker, all);
    const hada_maker_steps steps = {.steps = all - last, .stop = count};
    hada_maker_choice choice = {0};
    size_t image;
    int depths, done;
    const cl_mem otf = hada_bank_otf(planes->bank, several ? 0 : depth, &image, &depths);
    hada_maker_use_otf(maker, otf, image * planes->stage->layout.count, depths, planes->prior.mem);
    HADA_TRY(hada_maker_refine_exposure(maker, exposure, &steps, count, several ? composed->depth : one, &choice, &done,
                                        err));
    HADA_TRY(hada_maker_regularise(maker, last, choice.tv, count, several ? composed->depth : one, &done, err));
    return hada_maker_fade(maker, count, HADA_CROSSTALK, err);
}

/* The planes of a frame, which may be changed afterwards: linear ones are filtered when they are read. */
static hada_status expose(hada_planes *planes, int depth, const hada_image *raw, const hada_composed *composed,
                          hada_error *err)
{
    const hada_model_info *info = planes->info;
    const hada_exposure_rule rule = {.dark_varies = info->dark == HADA_AUTO,
                                     .dark = info->dark,
                                     .energy = planes->refiner != NULL,
                                     .weights = planes->refiner != NULL};
    hada_frame_exposure exposure;
    hada_pixels pixels;
    hada_status status = HADA_OK;
    hada_pixels_of_image(&pixels, raw);
    HADA_TRY(hada_exposure_begin(&exposure, info, &hada_frame_plain, &pixels, err));
    HADA_TRY_OR_DONE(hada_exposure_examine(&exposure, &rule, err));
    HADA_TRY_OR_DONE(hada_hadamard_frame(planes->stage, &exposure.pixels, exposure.levels, err));
    if (planes->refiner)
        HADA_TRY_OR_DONE(refine(planes, depth, &exposure, composed, err));
done:
    if (status)
        hada_slot_finish(planes->maker.slot, NULL); /* the frame may still be read */
    hada_exposure_end(&exposure);
    return status;
}

/* The plane at a place among those that were refined, or that of a depth, filtered. */
static hada_status read_plane(hada_planes *planes, int depth, int place, float *out, hada_error *err)
{
    const hada_plane_maker *maker = &planes->maker;
    if (planes->refiner)
        return hada_maker_read(maker, hada_refiner_planes(planes->refiner), place, 1, out, err);
    HADA_TRY(hada_maker_filter(maker, depth, 1, planes->planes.mem, err));
    return hada_maker_read(maker, planes->planes.mem, 0, 1, out, err);
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
    HADA_TRY_OR_DONE(HADA_NEW(one, values, "a sum of planes", err));
    memset(out, 0, values * sizeof *out);
    for (int i = 0; i < composed->count; i++) {
        HADA_TRY_OR_DONE(read_plane(planes, composed->depth[i], i, one, err));
        for (size_t k = 0; k < values; k++)
            out[k] += one[k];
    }
done:
    free(one);
    return status;
}

static hada_status make_plane(hada_planes *planes, int depth, const hada_composed *composed, hada_image *out,
                              hada_error *err)
{
    const size_t values = plane_bytes(planes->info) / sizeof(float);
    int place = 0;
    for (int i = 0; planes->refiner && i < composed->count; i++)
        place = composed->depth[i] == depth ? i : place;
    HADA_TRY(read_plane(planes, depth, place, out->data, err));
    if (!planes->others)
        return HADA_OK;
    memset(out->data + values, 0, values * sizeof(float));
    if (planes->refiner && composed->count) {
        HADA_TRY(add_up(planes, composed, out->data + values, err));
        for (size_t k = 0; k < values; k++) /* of the sum of all planes, what the others hold */
            out->data[values + k] -= out->data[k];
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
    for (int i = 0; i < composed->count; i++)
        if (composed->light[i].data)
            HADA_TRY(add_light(&planes->light, planes->bank, composed->depth[i], &composed->light[i], raw, err));
    HADA_TRY(expose(planes, depth, raw, composed, err));
    HADA_TRY(make_room(planes, out, err));
    return composed->whole ? make_sum(planes, composed, out, err) : make_plane(planes, depth, composed, out, err);
}
