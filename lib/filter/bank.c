#include "filter/bank.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Copies `bytes` per frequency between the two orders. */
static void reorder(const hada_spectrum_layout *layout, size_t bytes, const char *rows_in, char *rows_out, char *blocks)
{
    const size_t cols = (size_t)layout->cols / 2 + 1, block = (size_t)layout->block, rows = (size_t)layout->rows;
    for (size_t b = 0; b < (size_t)layout->blocks; b++) {
        const size_t first = b * block, wide = cols - first < block ? cols - first : block;
        for (size_t row = 0; row < rows; row++) {
            char *there = blocks + (b * rows + row) * block * bytes;
            const size_t here = (row * cols + first) * bytes;
            if (rows_out) {
                memcpy(rows_out + here, there, wide * bytes);
            } else {
                memcpy(there, rows_in + here, wide * bytes);
                memset(there + wide * bytes, 0, (block - wide) * bytes);
            }
        }
    }
}

void hada_layout_pack(const hada_spectrum_layout *layout, const float *rows, float *blocks)
{
    reorder(layout, 2 * sizeof *rows, (const char *)rows, NULL, (char *)blocks);
}

void hada_layout_unpack(const hada_spectrum_layout *layout, const float *blocks, float *rows)
{
    reorder(layout, 2 * sizeof *rows, NULL, (char *)rows, (char *)(uintptr_t)blocks);
}

static void pack_half(const hada_spectrum_layout *layout, const uint16_t *rows, uint16_t *blocks)
{
    reorder(layout, 2 * sizeof *rows, (const char *)rows, NULL, (char *)blocks);
}

void hada_layout_pack_real(const hada_spectrum_layout *layout, const float *rows, float *blocks)
{
    reorder(layout, sizeof *rows, (const char *)rows, NULL, (char *)blocks);
}

void hada_layout_unpack_real(const hada_spectrum_layout *layout, const float *blocks, float *rows)
{
    reorder(layout, sizeof *rows, NULL, (char *)rows, (char *)(uintptr_t)blocks);
}

void hada_layout_weights(const hada_spectrum_layout *layout, float *weights)
{
    memset(weights, 0, layout->count * sizeof *weights);
    for (int kx = 0; kx <= layout->cols / 2; kx++)
        for (int ky = 0; ky < layout->rows; ky++)
            weights[hada_spectrum_index(layout, ky, kx)] = kx == 0 || 2 * kx == layout->cols ? 1.0f : 2.0f;
}

static uint64_t depth_bytes(const hada_spectrum_layout *layout, int channels, int half)
{
    return (uint64_t)layout->count * (uint64_t)channels * (half ? 4u : 8u);
}

/* How many depths go into one buffer, evenly spread over the fewest buffers. */
static hada_status split(const hada_context *context, uint64_t bytes, int depths, int *per_buffer, hada_error *err)
{
    const uint64_t most = context->info.max_allocation_bytes / bytes;
    if (!most)
        return hada_fail(err, HADA_ERROR_DEVICE_MEMORY,
                         "the filters of one depth need %.2f GiB in one piece; %s takes at most %.2f GiB: use half "
                         "filters, smaller frames or another device",
                         (double)bytes / 1073741824.0, context->info.name,
                         (double)context->info.max_allocation_bytes / 1073741824.0);
    const int fits = most < (uint64_t)depths ? (int)most : depths, buffers = (depths + fits - 1) / fits;
    *per_buffer = (depths + buffers - 1) / buffers;
    return HADA_OK;
}

static hada_status not_finite(const hada_model *model, int depth, const char *what, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_MODEL,
                     "%s: the %s of depth %d holds values that are not finite; the model is damaged, make it again",
                     *model->info.name ? model->info.name : "the model", what, depth);
}

static hada_status check_finite(const hada_model *model, int depth, const char *what, const float *values, size_t count,
                                hada_error *err)
{
    /* x - x is 0 for finite x alone, and a sum shows it without a branch in the loop */
    float sum = 0.0f;
    for (size_t i = 0; i < count; i++)
        sum += values[i] - values[i];
    return sum == 0.0f ? HADA_OK : not_finite(model, depth, what, err);
}

/* One depth and channel of the filters, in the device's layout and precision, into `out`. `rows` is room for a plane in
 * half. */
static hada_status pack_filter(const hada_bank *bank, const hada_model *model, int depth, int channel, uint16_t *rows,
                               void *out, hada_error *err)
{
    const size_t plane = hada_model_plane(model);
    const size_t first = ((size_t)depth * (size_t)bank->channels + (size_t)channel) * plane * 2;
    if (!bank->half) {
        hada_layout_pack(&bank->layout, model->filter + first, out);
        return check_finite(model, depth, "filter", model->filter + first, plane * 2, err);
    }
    if (!model->filter_half) {
        HADA_TRY(check_finite(model, depth, "filter", model->filter + first, plane * 2, err));
        HADA_TRY(hada_filter_to_half(model->filter + first, plane * 2, rows, err));
        pack_half(&bank->layout, rows, out);
        return HADA_OK;
    }
    const uint16_t *half = model->filter_half + first;
    for (size_t i = 0; i < plane * 2; i++)
        if ((half[i] & 0x7c00u) == 0x7c00u)
            HADA_TRY(not_finite(model, depth, "half-precision filter", err));
    pack_half(&bank->layout, half, out);
    return HADA_OK;
}

static hada_status upload(hada_bank *bank, hada_slot *slot, const hada_model *model, const int *depths, int otf,
                          hada_error *err)
{
    const int per_buffer = otf ? bank->otf_depths : bank->filter_depths;
    const int half = bank->half && !otf, buffers = (bank->depths + per_buffer - 1) / per_buffer;
    const size_t plane = hada_model_plane(model), image_bytes = bank->layout.count * (half ? 4 : 8);
    hada_status status = HADA_OK;
    hada_buffer *list;
    void *image = NULL, *rows = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(list, (size_t)buffers, "a filter bank", err));
    *(otf ? &bank->otfs : &bank->filters) = list;
    HADA_TRY_OR_DONE(hada_allocated(image = hada_alloc_raw(1, image_bytes, "a filter on its way to the device", err)));
    if (half)
        HADA_TRY_OR_DONE(hada_allocated(rows = hada_alloc_raw(plane, 4, "a filter in half precision", err)));
    for (int b = 0; b < buffers; b++) {
        const int left = bank->depths - b * per_buffer, here = left < per_buffer ? left : per_buffer;
        HADA_TRY_OR_DONE(hada_buffer_create(&list[b], slot->context,
                                            (size_t)here * (size_t)bank->channels * image_bytes,
                                            otf ? "the transfer functions" : "the filters", err));
    }
    for (int i = 0; i < bank->depths * bank->channels && !slot->context->dry; i++) {
        const int z = i / bank->channels, c = i % bank->channels, depth = depths ? depths[z] : z;
        if (otf) {
            const float *from = model->otf + ((size_t)depth * (size_t)bank->channels + (size_t)c) * plane * 2;
            hada_layout_pack(&bank->layout, from, image);
            HADA_TRY_OR_DONE(check_finite(model, depth, "transfer function", from, plane * 2, err));
        } else {
            HADA_TRY_OR_DONE(pack_filter(bank, model, depth, c, rows, image, err));
        }
        const size_t at = (size_t)((z % per_buffer) * bank->channels + c) * image_bytes;
        HADA_TRY_OR_DONE(hada_buffer_write(&list[z / per_buffer], slot, at, image, image_bytes, err));
    }
done:
    HADA_FREE(image, rows);
    return status;
}

hada_status hada_bank_create(hada_bank **out, hada_slot *slot, const hada_model *model,
                             const hada_spectrum_layout *layout, const int *depths, int count, int parts, int half,
                             hada_error *err)
{
    const hada_model_info *info = &model->info;
    hada_status status = HADA_OK;
    hada_bank *bank;
    *out = NULL;
    if (!depths)
        count = info->depths;
    if (count < 1 || layout->rows != info->grid_rows || layout->cols != info->grid_cols)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a filter bank needs at least one depth and the model's grid");
    for (int i = 0; depths && i < count; i++)
        if (depths[i] < 0 || depths[i] >= info->depths)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "depth %d is not in the model, which has %d (from 0)", depths[i],
                             info->depths);
    if ((parts & HADA_BANK_OTFS) && !model->otf)
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "the model holds no transfer functions, which refinement needs; fit again, or use options.refine 0");
    HADA_TRY_OR_DONE(HADA_NEW(bank, 1, "a filter bank", err));
    bank->layout = *layout;
    bank->depths = count;
    bank->channels = info->channels;
    bank->parts = parts;
    bank->half = half || info->half;
    bank->product = info->form == HADA_FORM_SPLIT ? HADA_FFT_SPLIT : HADA_FFT_COMPLEX;
    HADA_TRY_OR_DONE(
        split(slot->context, depth_bytes(layout, info->channels, bank->half), count, &bank->filter_depths, err));
    HADA_TRY_OR_DONE(split(slot->context, depth_bytes(layout, info->channels, 0), count, &bank->otf_depths, err));
    if (parts & HADA_BANK_FILTERS)
        HADA_TRY_OR_DONE(upload(bank, slot, model, depths, 0, err));
    if (parts & HADA_BANK_OTFS)
        HADA_TRY_OR_DONE(upload(bank, slot, model, depths, 1, err));
done:
    if (status)
        hada_bank_destroy(&bank);
    *out = bank;
    return status;
}

static void free_list(hada_buffer *list, int depths, int per_buffer)
{
    for (int i = 0; list && i * per_buffer < depths; i++)
        hada_buffer_destroy(&list[i]);
    free(list);
}

void hada_bank_destroy(hada_bank **pointer)
{
    hada_bank *bank = hada_taken(pointer);
    if (!bank)
        return;
    free_list(bank->filters, bank->depths, bank->filter_depths);
    free_list(bank->otfs, bank->depths, bank->otf_depths);
    free(bank);
}

static cl_mem find(const hada_bank *bank, const hada_buffer *list, int per_buffer, int depth, size_t *first_image,
                   int *left)
{
    const int buffer = depth / per_buffer, end = (buffer + 1) * per_buffer;
    *first_image = (size_t)(depth % per_buffer) * (size_t)bank->channels;
    *left = (end < bank->depths ? end : bank->depths) - depth;
    return list[buffer].mem;
}

cl_mem hada_bank_filter(const hada_bank *bank, int depth, size_t *first_image, int *left)
{
    return find(bank, bank->filters, bank->filter_depths, depth, first_image, left);
}

cl_mem hada_bank_otf(const hada_bank *bank, int depth, size_t *first_image, int *left)
{
    return find(bank, bank->otfs, bank->otf_depths, depth, first_image, left);
}

hada_status hada_bank_prior(hada_buffer *out, hada_slot *slot, const hada_model *model,
                            const hada_spectrum_layout *layout, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const size_t plane = hada_model_plane(model), channels = (size_t)info->channels;
    hada_status status = HADA_OK;
    float *rows = NULL, *blocks = NULL;
    double noise = 0.0;
    /* noise fills the grid, scenes the window alone: their ratio within the window is what the prior means */
    const double share = (double)info->window_rows * info->window_cols / ((double)info->grid_rows * info->grid_cols);
    const double most = 1e6 * hada_model_gain(model);
    *out = (hada_buffer){0};
    for (size_t i = 0; model->noise_power && i < channels * (size_t)info->depths; i++)
        noise += model->noise_power[i];
    if (!model->scene_power || !model->noise_power || !(noise > 0.0))
        return HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(rows, plane, "the prior", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(blocks, channels * layout->count, "the prior", err));
    for (size_t c = 0; c < channels && !slot->context->dry; c++) {
        double mean = 0.0;
        for (int z = 0; z < info->depths; z++)
            mean += share * model->noise_power[(size_t)z * channels + c] / info->depths;
        /* where no scene had light the prior is as strong as float arithmetic can use beside |H|^2 */
        for (size_t i = 0; i < plane; i++)
            rows[i] = mean > 0.0 ? (float)fmin(mean / model->scene_power[i], most) : 0.0f;
        hada_layout_pack_real(layout, rows, blocks + c * layout->count);
    }
    HADA_TRY_OR_DONE(
        hada_buffer_create_from(out, slot, blocks, channels * layout->count * sizeof *blocks, "the prior", err));
done:
    HADA_FREE(rows, blocks);
    return status;
}
