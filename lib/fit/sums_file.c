#include "fit/fit_sums.h"

#include <hadalens/response.h>
#include <sys/stat.h>

#include "filter/bank.h"

#define FORMAT   "hadalens-sums-1"
#define RESPONSE "scene_response"
#define PART     "part" /* of a fit that is under way; else not there */

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

static hada_status put_metadata(const hada_fit_grid *grid, hada_tensors_writer *writer, hada_error *err)
{
    const sizes_text sizes = sizes_of(&grid->info);
    char response[HADA_RESPONSE_NAME];
    hada_response_name(response, grid->info.scene_response);
    HADA_TRY(hada_tensors_put_meta(writer, "format", FORMAT, err));
    HADA_TRY(hada_tensors_put_meta(writer, "library", "hadalens " HADALENS_VERSION, err));
    HADA_TRY(hada_tensors_put_meta(writer, "sizes", sizes.text, err));
    HADA_TRY(hada_tensors_put_meta(writer, RESPONSE, response, err));
    HADA_TRY(hada_model_put_frames(writer, &grid->info, err));
    return hada_tensors_put_meta(
        writer, "axes",
        "sums: [depth, channel, sum, value/rest, ky, kx]; the sums are Re and Im of sum X conj(B), sum |B|^2, sum "
        "|X|^2, and, for the form split, sum Re(X) Re(B), sum Re(B)^2; a sum is value + rest",
        err);
}

/* The small tensors in their order: names, and where their values are. */
typedef struct small {
    const char *name;
    int dims;
    int64_t shape[2];
    double *values;
    size_t count;
} small;
enum { DISTANCES, PAIRS, DARK, RAW_ENERGY, SCENE_ENERGY, SMALL };

static hada_status list_small(const hada_fit_grid *grid, double **all, small list[SMALL], hada_error *err)
{
    const int64_t depths = grid->info.depths, channels = grid->info.channels;
    const size_t z = (size_t)depths, images = z * (size_t)channels;
    HADA_TRY(HADA_NEW(*all, 2 * z + 2 * images + 1, "sums", err));
    double *at = *all;
    list[DISTANCES] = (small){"distances_mm", 1, {depths, 0}, at, z};
    list[PAIRS] = (small){"pairs", 1, {depths, 0}, at + z, z};
    list[DARK] = (small){"dark", 1, {1, 0}, at + 2 * z, 1};
    list[RAW_ENERGY] = (small){"raw_energy", 2, {depths, channels}, at + 2 * z + 1, images};
    list[SCENE_ENERGY] = (small){"scene_energy", 2, {depths, channels}, at + 2 * z + 1 + images, images};
    return HADA_OK;
}

static void fill_small(const hada_fit_sums *sums, small list[SMALL])
{
    const hada_fit_grid *grid = sums->grid;
    const size_t channels = (size_t)grid->info.channels;
    list[DARK].values[0] = grid->info.dark;
    for (size_t z = 0; z < (size_t)grid->info.depths; z++) {
        list[DISTANCES].values[z] = grid->distances[z];
        list[PAIRS].values[z] = (double)sums->depth[z].pairs;
        for (size_t c = 0; c < channels; c++) {
            list[RAW_ENERGY].values[z * channels + c] = sums->depth[z].raw_energy[c];
            list[SCENE_ENERGY].values[z * channels + c] = sums->depth[z].scene_energy[c];
        }
    }
}

static hada_status write_sums(hada_fit_sums *sums, hada_tensors_writer *writer, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const size_t plane = hada_model_info_plane(&grid->info);
    float *blocks = NULL, *rows = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(blocks, grid->stride, "sums", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(rows, plane, "sums", err));
    for (int z = 0; z < grid->info.depths; z++) {
        HADA_TRY_OR_DONE(hada_fit_sums_select(sums, z, err));
        for (int i = 0; i < grid->info.channels * 2 * grid->sum_count; i++) {
            const int channel = i / (2 * grid->sum_count), part = i % (2 * grid->sum_count);
            HADA_TRY_OR_DONE(hada_buffer_read(&sums->sums[channel], grid->slot,
                                              (size_t)part * grid->stride * sizeof(float), blocks,
                                              grid->layout.count * sizeof(float), err));
            hada_layout_unpack_real(&grid->layout, blocks, rows);
            HADA_TRY_OR_DONE(hada_tensors_write(writer, rows, plane * sizeof *rows, err));
        }
    }
done:
    HADA_FREE(blocks, rows);
    return status;
}

static hada_status write_file(hada_fit_sums *sums, hada_tensors_writer *writer, small list[SMALL], int part,
                              hada_error *err)
{
    const hada_model_info *info = &sums->grid->info;
    const int64_t shape[] = {info->depths,    info->channels,         sums->grid->sum_count, 2,
                             info->grid_rows, info->grid_cols / 2 + 1};
    HADA_TRY(put_metadata(sums->grid, writer, err));
    if (part)
        HADA_TRY(hada_tensors_put_meta(writer, PART, "1", err));
    for (int i = 0; i < SMALL; i++)
        HADA_TRY(hada_tensors_declare(writer, list[i].name, HADA_F64, list[i].dims, list[i].shape, err));
    HADA_TRY(hada_tensors_declare(writer, "sums", HADA_F32, 6, shape, err));
    fill_small(sums, list);
    for (int i = 0; i < SMALL; i++)
        HADA_TRY(hada_tensors_write(writer, list[i].values, list[i].count * sizeof(double), err));
    return write_sums(sums, writer, err);
}

hada_status hada_fit_sums_save(hada_fit_sums *sums, const char *path, int part, hada_error *err)
{
    hada_tensors_writer *writer = NULL;
    small list[SMALL];
    double *values = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tensors_create(&writer, path, err));
    HADA_TRY_OR_DONE(list_small(sums->grid, &values, list, err));
    HADA_TRY_OR_DONE(write_file(sums, writer, list, part, err));
    HADA_TRY_OR_DONE(hada_tensors_finish(&writer, err));
done:
    hada_tensors_abandon(&writer);
    free(values);
    return status;
}

static hada_status foreign(const char *path, const char *what, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_SIZE,
                     "%s: these sums cannot be added to this fit: %s; sums merge when sizes, boundary, distances, dark "
                     "level and form agree",
                     path, what);
}

/* A file is damaged where a number cannot be: counts are whole and exact in double precision. */
#define MOST_PAIRS 9e15

/* Distances of one depth may differ by rounding alone. */
#define SAME_DISTANCE 1e-9

static hada_status damaged_tensor(const char *path, const char *name, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s: the tensor %s is missing or damaged", path, name);
}

/* Copies the small tensors. */
static hada_status read_small(const hada_tensors *file, const char *path, small list[SMALL], hada_error *err)
{
    for (int i = 0; i < SMALL; i++) {
        const hada_stored_tensor *tensor = hada_tensors_find(file, list[i].name);
        if (!tensor || tensor->type != HADA_F64 || tensor->dims != list[i].dims)
            return damaged_tensor(path, list[i].name, err);
        if (tensor->bytes != list[i].count * sizeof(double))
            return foreign(path, "the number of depths or channels differs", err);
        memcpy(list[i].values, tensor->data, tensor->bytes);
        for (size_t k = 0; k < list[i].count; k++)
            if (!isfinite(list[i].values[k]) || (i != DARK && list[i].values[k] < 0.0))
                return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s: the tensor %s is damaged", path, list[i].name);
    }
    return HADA_OK;
}

/* Holds the small tensors against the fit. */
static hada_status check_small(const hada_fit_grid *grid, const char *path, const small list[SMALL], hada_error *err)
{
    for (int z = 0; z < grid->info.depths; z++) {
        const double distance = list[DISTANCES].values[z], pairs = list[PAIRS].values[z];
        if (fabs(distance - grid->distances[z]) > SAME_DISTANCE * fabs(grid->distances[z]))
            return foreign(path, "the distances differ", err);
        if (pairs > MOST_PAIRS || pairs != floor(pairs))
            return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s: the tensor pairs is damaged", path);
    }
    return list[DARK].values[0] == grid->info.dark ? HADA_OK : foreign(path, "the dark level differs", err);
}

/* Holds the sums themselves against the fit. */
static hada_status check_sums(const hada_fit_grid *grid, const hada_tensors *file, const char *path, hada_error *err)
{
    const hada_model_info *info = &grid->info;
    const hada_stored_tensor *tensor = hada_tensors_find(file, "sums");
    if (!tensor || tensor->type != HADA_F32 || tensor->dims != 6 || tensor->shape[3] != 2 ||
        (uintptr_t)tensor->data % sizeof(float))
        return damaged_tensor(path, "sums", err);
    const char *sizes = hada_tensors_meta(file, "sizes");
    const sizes_text expected = sizes_of(info);
    if (!sizes || strcmp(sizes, expected.text) || tensor->shape[0] != info->depths ||
        tensor->shape[1] != info->channels || tensor->shape[4] != info->grid_rows ||
        tensor->shape[5] != info->grid_cols / 2 + 1)
        return foreign(path, "the sizes differ", err);
    if (tensor->shape[2] < grid->sum_count || tensor->shape[2] > HADA_FIT_SUMS_SPLIT)
        return foreign(path, "they were made for the form complex and lack what split needs", err);
    const float *values = tensor->data;
    float sum = 0.0f; /* x - x is 0 for finite x alone */
    for (size_t i = 0; i < tensor->bytes / sizeof *values; i++)
        sum += values[i] - values[i];
    return sum == 0.0f
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_NOT_FINITE, "%s: the sums are not finite; the file is damaged", path);
}

static hada_status damaged(const char *path, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s does not hold the sums of a fit, or is damaged", path);
}

/* How the scenes behind the sums were brought to light; files of before knew no other way than linear. */
static hada_status response_of(const hada_tensors *file, const char *path, double *response, hada_error *err)
{
    const char *name = hada_tensors_meta(file, RESPONSE);
    *response = HADA_RESPONSE_LINEAR;
    if (name && (hada_response_from_name(response, name, NULL) || !hada_response_is_known(*response)))
        return damaged(path, err);
    return HADA_OK;
}

hada_status hada_fit_sums_check_part(const char *path, hada_error *err)
{
    hada_tensors *file = NULL;
    struct stat what;
    if (lstat(path, &what))
        return HADA_OK;
    const int part = !hada_tensors_open(&file, path, NULL) && hada_tensors_meta(file, PART);
    hada_tensors_close(&file);
    return part ? HADA_OK
                : hada_fail(err, HADA_ERROR_FILE_WRITE,
                            "%s, where sums are kept until all pairs are added, is there already and not what an "
                            "interrupted fit left; move it away, or choose another options.sums",
                            path);
}

static hada_status check_response(const hada_fit_grid *grid, const hada_tensors *file, const char *path,
                                  hada_error *err)
{
    char of_file[HADA_RESPONSE_NAME], of_fit[HADA_RESPONSE_NAME];
    double response;
    const hada_status status = response_of(file, path, &response, err);
    if (status || response == grid->info.scene_response)
        return status;
    hada_response_name(of_file, response);
    hada_response_name(of_fit, grid->info.scene_response);
    return hada_fail(err, HADA_ERROR_SIZE,
                     "%s: these sums cannot be added to this fit: their scenes were brought to light as '%s', those of "
                     "this fit as '%s' (options.scene_response); sums cannot be brought from one to the other",
                     path, of_file, of_fit);
}

static hada_status check_file(const hada_fit_grid *grid, const hada_tensors *file, const char *path, small list[SMALL],
                              hada_error *err)
{
    const char *format = hada_tensors_meta(file, "format");
    if (!format || strcmp(format, FORMAT))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s does not hold the sums of a fit (format %s)", path, FORMAT);
    HADA_TRY(read_small(file, path, list, err));
    HADA_TRY(check_small(grid, path, list, err));
    HADA_TRY(check_sums(grid, file, path, err));
    hada_model_info of;
    if (hada_model_get_frames(file, &of))
        return damaged(path, err);
    if (of.mosaic != grid->info.mosaic || of.sensor_mosaic != grid->info.sensor_mosaic)
        return foreign(path, "the colour filter mosaic differs", err);
    if (memcmp(of.colour_matrix, grid->info.colour_matrix, sizeof of.colour_matrix) != 0)
        return foreign(path, "the sensor's colours differ from the scenes' by another matrix (colour_matrix)", err);
    if (of.downsample != grid->info.downsample)
        return foreign(path, "frames are binned by another number (downsample)", err);
    return check_response(grid, file, path, err);
}

/* Adds the file's sums of one depth to those on the device; `more` and `blocks`: room for a channel's. */
static hada_status merge_depth(hada_fit_sums *sums, int z, const hada_stored_tensor *stored, hada_buffer *more,
                               float *blocks, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const size_t plane = hada_model_info_plane(&grid->info), in_file = (size_t)stored->shape[2];
    const size_t parts = 2 * (size_t)grid->sum_count, channels = (size_t)grid->info.channels;
    HADA_TRY(hada_fit_sums_select(sums, z, err));
    for (size_t c = 0; c < channels; c++) {
        const float *from = (const float *)stored->data + ((size_t)z * channels + c) * 2 * in_file * plane;
        for (size_t part = 0; part < parts; part++)
            hada_layout_pack_real(&grid->layout, from + part * plane, blocks + part * grid->stride);
        HADA_TRY(hada_buffer_write(more, grid->slot, 0, blocks, parts * grid->stride * sizeof *blocks, err));
        HADA_TRY(hada_fit_sums_merge(sums, (int)c, more, err));
    }
    return HADA_OK;
}

static hada_status merge_all(hada_fit_sums *sums, const hada_tensors *file, const small list[SMALL], hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const size_t channels = (size_t)grid->info.channels, floats = 2 * (size_t)grid->sum_count * grid->stride;
    const hada_stored_tensor *stored = hada_tensors_find(file, "sums");
    float *blocks = NULL;
    hada_buffer more = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(blocks, floats, "sums from a file", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&more, grid->slot->context, floats * sizeof *blocks, "sums from a file", err));
    for (int z = 0; z < grid->info.depths; z++) {
        hada_fit_depth *to = &sums->depth[z];
        if (list[PAIRS].values[z] == 0.0)
            continue;
        HADA_TRY_OR_DONE(merge_depth(sums, z, stored, &more, blocks, err));
        for (size_t c = 0; c < channels; c++) {
            to->raw_energy[c] += list[RAW_ENERGY].values[(size_t)z * channels + c];
            to->scene_energy[c] += list[SCENE_ENERGY].values[(size_t)z * channels + c];
        }
        to->pairs += (int64_t)list[PAIRS].values[z];
    }
done:
    hada_slot_finish(grid->slot, NULL);
    hada_buffer_destroy(&more);
    free(blocks);
    return status;
}

hada_status hada_fit_sums_load(hada_fit_sums *sums, const char *path, hada_error *err)
{
    hada_tensors *file = NULL;
    small list[SMALL];
    double *values = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tensors_open(&file, path, err));
    HADA_TRY_OR_DONE(list_small(sums->grid, &values, list, err));
    HADA_TRY_OR_DONE(check_file(sums->grid, file, path, list, err));
    HADA_TRY_OR_DONE(merge_all(sums, file, list, err));
done:
    free(values);
    hada_tensors_close(&file);
    return status;
}

/* Depths or channels of which a damaged file speaks are refused before anything is allocated for them. */
enum { MOST_IMAGES = 100000 };

hada_status hada_fit_sums_camera(const hada_tensors *file, const char *path, hada_fit_options *options, hada_error *err)
{
    char boundary[16];
    hada_model_info of;
    const char *sizes = hada_tensors_meta(file, "sizes");
    const hada_stored_tensor *sums = hada_tensors_find(file, "sums"),
                             *distances = hada_tensors_find(file, "distances_mm"),
                             *dark = hada_tensors_find(file, "dark");
    if (!sizes || !sums || sums->dims != 6 || !distances || distances->type != HADA_F64 || distances->dims != 1 ||
        distances->shape[0] != sums->shape[0] || !dark || dark->type != HADA_F64 || dark->bytes != sizeof(double) ||
        sums->shape[0] < 1 || sums->shape[0] > MOST_IMAGES || sums->shape[1] < 1 || sums->shape[1] > MOST_IMAGES)
        return damaged(path, err);
    if (sscanf(sizes, "raw %dx%d, window %dx%d, grid %dx%d, %15s", &options->raw_rows, &options->raw_cols,
               &options->window_rows, &options->window_cols, &options->grid_rows, &options->grid_cols, boundary) != 7)
        return damaged(path, err);
    options->depths = (int)sums->shape[0];
    options->channels = (int)sums->shape[1];
    options->distances_mm = distances->data;
    options->boundary = hada_boundary_from_name(boundary);
    memcpy(&options->dark, dark->data, sizeof options->dark);
    if (!options->boundary || hada_model_get_frames(file, &of))
        return damaged(path, err);
    if (!hada_colours_known(options->colour_matrix))
        memcpy(options->colour_matrix, of.colour_matrix, sizeof of.colour_matrix);
    if (options->frame_encoding == HADA_AUTO)
        options->frame_encoding = of.frame_encoding == 0.0 ? HADA_RESPONSE_LINEAR : of.frame_encoding;
    options->mosaic = of.mosaic;
    options->sensor_mosaic = of.sensor_mosaic;
    options->downsample = of.downsample;
    return options->scene_response == HADA_AUTO ? response_of(file, path, &options->scene_response, err) : HADA_OK;
}

hada_status hada_fit_sums_options(const char *path, hada_fit_options *options, hada_error *err)
{
    hada_tensors *file = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tensors_open(&file, path, err));
    HADA_TRY_OR_DONE(hada_fit_sums_camera(file, path, options, err));
    options->distances_mm = NULL;
done:
    hada_tensors_close(&file);
    return status;
}
