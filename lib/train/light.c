#include "train/light.h"

#include <stdlib.h>

#include "core/alloc.h"

static hada_fft_desc desc_of(const hada_model_info *info, hada_fft_direction direction, int row0, int col0, int rows,
                             int cols)
{
    return (hada_fft_desc){.direction = direction,
                           .rows = info->grid_rows,
                           .cols = info->grid_cols,
                           .batch = info->channels,
                           .row0 = row0,
                           .col0 = col0,
                           .real_rows = rows,
                           .real_cols = cols,
                           .real_pitch = (size_t)cols,
                           .real_distance = (size_t)rows * (size_t)cols};
}

static hada_fft_desc forward_desc(const hada_model_info *info, const hada_geometry *at)
{
    return desc_of(info, HADA_FFT_FORWARD, at->window_row, at->window_col, info->window_rows, info->window_cols);
}

static hada_fft_desc inverse_desc(const hada_model_info *info, const hada_geometry *at)
{
    return desc_of(info, HADA_FFT_INVERSE, at->raw_row, at->raw_col, info->raw_rows, info->raw_cols);
}

static size_t frame_floats(const hada_model_info *info)
{
    return (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols;
}

hada_status hada_light_create(hada_light *light, hada_slot *slot, const hada_model_info *info, hada_error *err)
{
    hada_geometry at;
    hada_status status = HADA_OK;
    *light = (hada_light){.slot = slot, .channels = info->channels, .frame = frame_floats(info)};
    light->window = (size_t)info->channels * (size_t)info->window_rows * (size_t)info->window_cols;
    HADA_TRY_OR_DONE(hada_geometry_of(info, &at, err));
    const hada_fft_desc forward = forward_desc(info, &at), inverse = inverse_desc(info, &at);
    HADA_TRY_OR_DONE(hada_fft_create(&light->forward, slot, &forward, err));
    HADA_TRY_OR_DONE(hada_fft_create(&light->inverse, slot, &inverse, err));
    HADA_TRY_OR_DONE(
        hada_buffer_create(&light->image, slot->context, light->frame * sizeof(float), "a composed frame", err));
    HADA_TRY_OR_DONE(
        hada_buffer_create(&light->spectrum, slot->context,
                           (size_t)info->channels * hada_fft_plan_layout(light->forward)->count * 2 * sizeof(float),
                           "a scene's spectrum", err));
    HADA_TRY_OR_DONE(hada_allocated(light->room = hada_alloc(light->frame, sizeof(float), "a composed frame", err)));
done:
    if (status)
        hada_light_destroy(light);
    return status;
}

void hada_light_destroy(hada_light *light)
{
    hada_fft_destroy(&light->forward);
    hada_fft_destroy(&light->inverse);
    hada_buffer_destroy(&light->image);
    hada_buffer_destroy(&light->spectrum);
    free(light->room);
    *light = (hada_light){0};
}

hada_status hada_light_add(hada_light *light, const hada_bank *bank, int depth, const hada_image *scene,
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
    for (size_t i = 0; i < light->frame; i++)
        frame->data[i] += light->room[i];
    return HADA_OK;
}
