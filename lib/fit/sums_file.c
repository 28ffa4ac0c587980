/* Sums to and from files: to go on later, or to merge what several machines have added up (docs/model-file.md). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "filter/layout.h"
#include "fit/fitter.h"
#include "io/safetensors.h"

#define FORMAT "hadalens-sums-1"

/* What must agree, as text. */
typedef struct sizes_text {
    char text[120];
} sizes_text;

static sizes_text sizes_of(const hada_model_info *info)
{
    sizes_text sizes;
    snprintf(sizes.text, sizeof sizes.text, "raw %dx%d, window %dx%d, grid %dx%d, %s", info->raw_rows, info->raw_cols,
             info->window_rows, info->window_cols, info->grid_rows, info->grid_cols,
             hada_boundary_name(info->boundary));
    return sizes;
}

static hada_status put_metadata(const hada_fitter *fitter, hada_tensors_writer *writer, hada_error *err)
{
    const sizes_text sizes = sizes_of(&fitter->info);
    hada_status status = hada_tensors_put_meta(writer, "format", FORMAT, err);
    if (!status)
        status = hada_tensors_put_meta(writer, "library", "hadalens " HADALENS_VERSION, err);
    if (!status)
        status = hada_tensors_put_meta(writer, "sizes", sizes.text, err);
    if (!status)
        status = hada_tensors_put_meta(
            writer, "axes",
            "sums: [depth, channel, sum, value/rest, ky, kx]; the sums are Re and Im of sum X conj(B), sum |B|^2, sum "
            "|X|^2, and, for the form split, sum Re(X) Re(B), sum Re(B)^2; a sum is value + rest",
            err);
    return status;
}

/* The small tensors in their order: names, and where their values stand. */
typedef struct small {
    const char *name;
    int dims;
    int64_t shape[2];
    double *values;
    size_t count;
} small;
enum { SMALL = 5 };

static hada_status list_small(const hada_fitter *fitter, double **all, small list[SMALL], hada_error *err)
{
    const int64_t depths = fitter->info.depths, channels = fitter->info.channels;
    const size_t z = (size_t)depths, images = z * (size_t)channels;
    hada_status status = hada_alloc((void **)all, 2 * z + 2 * images + 1, sizeof(double), "sums", err);
    if (status)
        return status;
    double *at = *all;
    list[0] = (small){"distances_mm", 1, {depths, 0}, at, z};
    list[1] = (small){"pairs", 1, {depths, 0}, at + z, z};
    list[2] = (small){"dark", 1, {1, 0}, at + 2 * z, 1};
    list[3] = (small){"raw_energy", 2, {depths, channels}, at + 2 * z + 1, images};
    list[4] = (small){"scene_energy", 2, {depths, channels}, at + 2 * z + 1 + images, images};
    return HADA_OK;
}

static void fill_small(const hada_fitter *fitter, small list[SMALL])
{
    const size_t channels = (size_t)fitter->info.channels;
    list[2].values[0] = fitter->info.dark;
    for (size_t z = 0; z < (size_t)fitter->info.depths; z++) {
        list[0].values[z] = fitter->distances[z];
        list[1].values[z] = (double)fitter->depth[z].pairs;
        for (size_t c = 0; c < channels; c++) {
            list[3].values[z * channels + c] = fitter->depth[z].raw_energy[c];
            list[4].values[z * channels + c] = fitter->depth[z].scene_energy[c];
        }
    }
}

static hada_status write_sums(hada_fitter *fitter, hada_tensors_writer *writer, hada_error *err)
{
    const size_t plane = hada_model_info_plane(&fitter->info);
    float *blocks = NULL, *rows = NULL;
    hada_status status = hada_alloc_raw((void **)&blocks, fitter->stride, sizeof *blocks, "sums", err);
    if (!status)
        status = hada_alloc_raw((void **)&rows, plane, sizeof *rows, "sums", err);
    for (int z = 0; !status && z < fitter->info.depths; z++) {
        status = hada_fitter_select(fitter, z, err);
        for (int i = 0; !status && i < fitter->info.channels * 2 * fitter->sum_count; i++) {
            const int channel = i / (2 * fitter->sum_count), part = i % (2 * fitter->sum_count);
            status = hada_buffer_read(&fitter->sums[channel], fitter->slot, (size_t)part * fitter->stride * 4, blocks,
                                      fitter->layout.count * 4, err);
            hada_layout_unpack_real(&fitter->layout, blocks, rows);
            if (!status)
                status = hada_tensors_write(writer, rows, plane * sizeof *rows, err);
        }
    }
    free(blocks);
    free(rows);
    return status;
}

hada_status hada_fitter_save_sums(hada_fitter *fitter, const char *path, hada_error *err)
{
    hada_tensors_writer *writer;
    small list[SMALL];
    double *values = NULL;
    if (!fitter || !path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_save_sums: a fitter and a path are needed");
    const hada_model_info *info = &fitter->info;
    const int64_t shape[] = {info->depths,    info->channels,         fitter->sum_count, 2,
                             info->grid_rows, info->grid_cols / 2 + 1};
    hada_status status = hada_tensors_create(&writer, path, err);
    if (status)
        return status;
    status = put_metadata(fitter, writer, err);
    if (!status)
        status = list_small(fitter, &values, list, err);
    for (int i = 0; !status && i < SMALL; i++)
        status = hada_tensors_declare(writer, list[i].name, HADA_F64, list[i].dims, list[i].shape, err);
    if (!status)
        status = hada_tensors_declare(writer, "sums", HADA_F32, 6, shape, err);
    if (!status)
        fill_small(fitter, list);
    for (int i = 0; !status && i < SMALL; i++)
        status = hada_tensors_write(writer, list[i].values, list[i].count * sizeof(double), err);
    if (!status)
        status = write_sums(fitter, writer, err);
    free(values);
    if (!status)
        return hada_tensors_finish(&writer, err);
    hada_tensors_abandon(&writer);
    return status;
}

static hada_status foreign(const char *path, const char *what, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_SIZE,
                     "%s: these sums cannot be added to this fit: %s; sums merge when sizes, boundary, distances, dark "
                     "level and form agree",
                     path, what);
}

/* Copies the small tensors and holds them against the fitter; finds the sums. */
static hada_status check_file(const hada_fitter *fitter, const hada_tensors *file, const char *path, small list[SMALL],
                              const hada_stored_tensor **sums, hada_error *err)
{
    const hada_model_info *info = &fitter->info;
    const char *format = hada_tensors_meta(file, "format");
    if (!format || strcmp(format, FORMAT))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s does not hold the sums of a fit (format %s)", path, FORMAT);
    for (int i = 0; i < SMALL; i++) {
        const hada_stored_tensor *tensor = hada_tensors_find(file, list[i].name);
        if (!tensor || tensor->type != HADA_F64 || tensor->dims != list[i].dims)
            return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s: the tensor %s is missing or damaged", path,
                             list[i].name);
        if (tensor->bytes != list[i].count * sizeof(double))
            return foreign(path, "the number of depths or channels differs", err);
        memcpy(list[i].values, tensor->data, tensor->bytes);
        for (size_t k = 0; k < list[i].count; k++)
            if (!isfinite(list[i].values[k]) || (i != 2 && list[i].values[k] < 0.0))
                return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s: the tensor %s is damaged", path, list[i].name);
    }
    for (int z = 0; z < info->depths; z++) {
        if (fabs(list[0].values[z] - fitter->distances[z]) > 1e-9 * fabs(fitter->distances[z]))
            return foreign(path, "the distances differ", err);
        if (list[1].values[z] > 9e15 || list[1].values[z] != floor(list[1].values[z]))
            return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s: the tensor pairs is damaged", path);
    }
    if (list[2].values[0] != info->dark)
        return foreign(path, "the dark level differs", err);
    const hada_stored_tensor *tensor = *sums = hada_tensors_find(file, "sums");
    if (!tensor || tensor->type != HADA_F32 || tensor->dims != 6 || tensor->shape[3] != 2 ||
        (uintptr_t)tensor->data % sizeof(float))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s: the tensor sums is missing or damaged", path);
    const char *sizes = hada_tensors_meta(file, "sizes");
    const sizes_text expected = sizes_of(info);
    if (!sizes || strcmp(sizes, expected.text) || tensor->shape[0] != info->depths ||
        tensor->shape[1] != info->channels || tensor->shape[4] != info->grid_rows ||
        tensor->shape[5] != info->grid_cols / 2 + 1)
        return foreign(path, "the sizes differ", err);
    if (tensor->shape[2] < fitter->sum_count || tensor->shape[2] > HADA_FIT_SUMS_SPLIT)
        return foreign(path, "they were made for the form complex and lack what split needs", err);
    const float *values = tensor->data;
    float sum = 0.0f; /* x - x is 0 for finite x alone */
    for (size_t i = 0; i < tensor->bytes / sizeof *values; i++)
        sum += values[i] - values[i];
    return sum == 0.0f
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_NOT_FINITE, "%s: the sums are not finite; the file is damaged", path);
}

/* Adds the file's sums of one depth to those on the device. */
static hada_status merge_depth(hada_fitter *fitter, int z, const hada_stored_tensor *sums, hada_buffer *more,
                               float *blocks, hada_error *err)
{
    const size_t plane = hada_model_info_plane(&fitter->info), in_file = (size_t)sums->shape[2];
    const size_t parts = 2 * (size_t)fitter->sum_count;
    const cl_ulong stride = fitter->stride, vectors = fitter->vectors;
    const cl_int count = fitter->sum_count;
    hada_status status = hada_fitter_select(fitter, z, err);
    for (size_t c = 0; !status && c < (size_t)fitter->info.channels; c++) {
        const float *from =
            (const float *)sums->data + ((size_t)z * (size_t)fitter->info.channels + c) * 2 * in_file * plane;
        for (size_t part = 0; part < parts; part++)
            hada_layout_pack_real(&fitter->layout, from + part * plane, blocks + part * fitter->stride);
        status = hada_buffer_write(more, fitter->slot, 0, blocks, parts * fitter->stride * sizeof *blocks, err);
        hada_arg args[] = {HADA_ARG(more->mem), HADA_ARG(fitter->sums[c].mem), HADA_ARG(stride), HADA_ARG(count),
                           HADA_ARG(vectors)};
        fitter->changed = 1;
        hada_slot_cost(fitter->slot, 192.0 * count * (double)vectors, 112.0 * count * (double)vectors);
        if (!status)
            status = hada_fitter_launch(fitter, "fit_sums", "fit_merge", args, HADA_COUNT(args), err);
    }
    return status;
}

hada_status hada_fitter_load_sums(hada_fitter *fitter, const char *path, hada_error *err)
{
    hada_tensors *file;
    const hada_stored_tensor *sums = NULL;
    small list[SMALL];
    double *values = NULL;
    float *blocks = NULL;
    hada_buffer more = {0};
    if (!fitter || !path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_load_sums: a fitter and a path are needed");
    hada_status status = hada_tensors_open(&file, path, err);
    if (status)
        return status;
    const size_t channels = (size_t)fitter->info.channels, floats = 2 * (size_t)fitter->sum_count * fitter->stride;
    status = list_small(fitter, &values, list, err);
    if (!status)
        status = check_file(fitter, file, path, list, &sums, err);
    if (!status)
        status = hada_alloc((void **)&blocks, floats, sizeof *blocks, "sums from a file", err);
    if (!status)
        status = hada_buffer_create(&more, fitter->context, floats * sizeof *blocks, "sums from a file", err);
    if (!status)
        hada_fitter_forget_scores(fitter);
    for (int z = 0; !status && z < fitter->info.depths; z++) {
        if (list[1].values[z] == 0.0)
            continue;
        status = merge_depth(fitter, z, sums, &more, blocks, err);
        for (size_t c = 0; !status && c < channels; c++) {
            fitter->depth[z].raw_energy[c] += list[3].values[(size_t)z * channels + c];
            fitter->depth[z].scene_energy[c] += list[4].values[(size_t)z * channels + c];
        }
        if (!status)
            fitter->depth[z].pairs += (int64_t)list[1].values[z];
    }
    hada_slot_finish(fitter->slot, NULL);
    hada_buffer_destroy(&more);
    free(blocks);
    free(values);
    hada_tensors_close(&file);
    return status;
}
