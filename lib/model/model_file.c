/* Model files: safetensors with every convention in the metadata (docs/reference/files.md). */
#include <hadalens/limits.h>
#include <hadalens/response.h>
#include <limits.h>

#include "core/base.h"
#include "core/numbers.h"
#include "io/safetensors.h"
#include "io/text.h"
#include "model/model.h"
#include "netlist/net_list.h"

/* Numbers in the tensors of a model that no picture could come from. */

/* Far beyond what any camera and unit of light bring, and narrow enough that squares and quotients stay in single
 * precision: with transfer functions times 1e-15 to 1e18, and filters over that, pictures came out; with 1e-18 a
 * refined one was black. Filters are about the reciprocals of transfer functions, powers about the squares of frames.
 */
#define OTF_MOST    1e15
#define FILTER_MOST 1e18
#define POWER_MOST  1e30
#define NOISE_MOST  1e12 /* over the power of the frames' light */
#define FLAT_MOST   1e9  /* 1 in the mean */
#define DARK_MOST   1e9  /* full scale is 1 */

/* The largest magnitude; infinite where one of them is NaN or infinite. */
static double largest(const float *values, size_t count)
{
    float most;
    return hada_not_finite(values, count, &most) ? HUGE_VAL : (double)most;
}

/* Of half floats: 1 where some are not 0, infinite where one is NaN or infinite. */
static double largest_half(const uint16_t *values, size_t count)
{
    uint16_t most = 0;
    for (size_t i = 0; i < count; i++) {
        const uint16_t bits = values[i] & 0x7fff;
        most = bits > most ? bits : most;
    }
    return most >= 0x7c00 ? HUGE_VAL : most ? 1.0 : 0.0;
}

static int any_negative(const float *values, size_t count)
{
    int found = 0;
    for (size_t i = 0; i < count; i++)
        found |= values[i] < 0.0f;
    return found;
}

static hada_status wrong(const char *name, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_MODEL,
                     "the tensor %s holds numbers that are NaN, infinite or negative where that cannot be; fit again",
                     name);
}

/* Whether the largest of a depth (-1: of all) can be. */
static hada_status check_largest(const char *name, int depth, double most, double bound, hada_error *err)
{
    char where[32] = "";
    if (most == HUGE_VAL)
        return wrong(name, err);
    if (depth >= 0)
        snprintf(where, sizeof where, " of depth %d", depth);
    if (most == 0.0)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the tensor %s%s holds nothing but 0, from which pictures are black; fit again", name, where);
    if (!(most >= 1.0 / bound && most <= bound))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the largest number of the tensor %s%s is %g; from %g to %g can be: fit again", name, where,
                         most, 1.0 / bound, bound);
    return HADA_OK;
}

static hada_status check_doubles(const char *name, const double *values, size_t count, double most, hada_error *err)
{
    for (size_t i = 0; values && i < count; i++) {
        if (!isfinite(values[i]) || values[i] < 0.0)
            return wrong(name, err);
        if (values[i] > most)
            return hada_fail(err, HADA_ERROR_MODEL, "the tensor %s holds %g; at most %g can be: fit again", name,
                             values[i], most);
    }
    return HADA_OK;
}

hada_status hada_model_check_numbers(const hada_model *model, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const size_t plane = hada_model_plane(model), channels = (size_t)info->channels, values = channels * plane * 2;
    double gain = 0.0, power = 0.0;
    for (size_t z = 0; z < (size_t)info->depths; z++) {
        const int depth = (int)z;
        if (model->otf) {
            const double most = largest(model->otf + z * values, values);
            HADA_TRY(check_largest("otf", depth, most, OTF_MOST, err));
            gain = fmax(gain, most * most);
        }
        const double most = model->filter ? largest(model->filter + z * values, values)
                                          : largest_half(model->filter_half + z * values, values);
        HADA_TRY(check_largest("filter", depth, most, FILTER_MOST, err));
    }
    if (info->components > 1) {
        const size_t maps = hada_model_component_weights(info);
        HADA_TRY(check_largest("component_otf", -1,
                               largest(model->component_otf, hada_model_component_images(info) * plane * 2), OTF_MOST,
                               err));
        HADA_TRY(check_largest("component_weights", -1, largest(model->component_weights, maps), OTF_MOST, err));
        HADA_TRY(check_doubles("singular_values", model->singular_values,
                               (size_t)info->depths * (size_t)info->positions, HUGE_VAL, err));
    }
    if (info->flat) {
        const size_t pixels = hada_image_count(info->flat);
        HADA_TRY(any_negative(info->flat->data, pixels) ? wrong("flat", err) : HADA_OK);
        HADA_TRY(check_largest("flat", -1, largest(info->flat->data, pixels), FLAT_MOST, err));
    }
    if (info->dark_frame && !(largest(info->dark_frame->data, hada_image_count(info->dark_frame)) <= DARK_MOST))
        return wrong("dark_frame", err);
    HADA_TRY(check_doubles("pairs", model->pairs, (size_t)info->depths, HUGE_VAL, err));
    if (model->scene_power) {
        power = largest(model->scene_power, plane);
        HADA_TRY(any_negative(model->scene_power, plane) ? wrong("scene_power", err) : HADA_OK);
        HADA_TRY(check_largest("scene_power", -1, power, POWER_MOST, err));
    }
    return check_doubles("noise_power", model->noise_power, (size_t)info->depths * channels,
                         gain > 0.0 && power > 0.0 ? NOISE_MOST * gain * power : POWER_MOST, err);
}

#define FORMAT          "hadalens-model"
#define FORMAT_VERSION  1 /* of what every library reads */
#define VARYING_VERSION 2 /* of models whose PSFs vary over the field: older libraries would take the mean for them */
#define COMPONENTS      "components" /* models whose PSFs are the same everywhere lack these */
#define POSITIONS       "component_positions"
#define LOST            "component_lost"
#define LOST_SINGLE     "component_lost_single"
#define RESPONSE        "scene_response"
#define FRAME_ENCODING  "frame_encoding" /* models of linear frames lack it */
#define COLOUR_MATRIX   "colour_matrix"  /* models whose sensor has the colours of the scenes lack it */
#define MOSAIC          "mosaic"         /* models of frames in full colour lack it */
#define SENSOR_MOSAIC   "sensor_mosaic"
#define DOWNSAMPLE      "downsample" /* models of frames that are not binned lack these */

/* What a reader must know and the numbers cannot say; the same in every file. */
static const char *const conventions[][2] = {
    {"axes", "filter, otf: [depth, channel, ky, kx, re/im], kx from 0 to grid_cols/2 (half spectrum); depths near to "
             "far; scene_power: [ky, kx]; noise_power: [depth, channel]; pairs, distances_mm: [depth]"},
    {"transform", "forward unnormalised, inverse divided by grid_rows*grid_cols"},
    {"geometry", "the frame stands on the grid at (grid - raw)/2, the window in the frame at (raw - window)/2, rounded "
                 "down; zero (frame) or dark (scene) elsewhere"},
    {"use", "scene = inverse(filter * forward(raw - dark)) in the window; form split: Re*re + i*Im*im"},
    {"psf_axis", "optical axis at pixel (rows/2, cols/2) rounded down; otf = forward(psf rolled so that the axis is at "
                 "(0, 0))"},
    {"intensity", "linear, divided by the full scale of integer files (255, 65535); float files as they are; scenes "
                  "brought to light by scene_response"},
};

static hada_status put_number(hada_tensors_writer *writer, const char *key, double value, hada_error *err)
{
    char text[40];
    hada_format_number(text, sizeof text, "%.17g", value);
    return hada_tensors_put_meta(writer, key, text, err);
}

static hada_status put_size(hada_tensors_writer *writer, const char *key, int rows, int cols, hada_error *err)
{
    char text[40];
    snprintf(text, sizeof text, "%dx%d", rows, cols);
    return hada_tensors_put_meta(writer, key, text, err);
}

static hada_status put_mosaic(hada_tensors_writer *writer, const char *key, hada_mosaic mosaic, hada_error *err)
{
    const char *name = hada_enum_name(HADA_ENUM_MOSAIC, (int)mosaic);
    return mosaic == HADA_MOSAIC_NONE ? HADA_OK : hada_tensors_put_meta(writer, key, name, err);
}

static int get_mosaic(const hada_tensors *file, const char *key, hada_mosaic *mosaic)
{
    const char *name = hada_tensors_meta(file, key);
    const int value = name ? hada_enum_value(HADA_ENUM_MOSAIC, name) : HADA_MOSAIC_NONE;
    *mosaic = (hada_mosaic)value;
    return value >= 0;
}

/* Nine numbers, row by row. */
static hada_status put_colours(hada_tensors_writer *writer, const double m[HADA_COLOUR_MATRIX], hada_error *err)
{
    char text[HADA_COLOUR_MATRIX * 40] = "";
    if (!hada_colours_known(m))
        return HADA_OK;
    for (int i = 0, at = 0; i < HADA_COLOUR_MATRIX; i++, at += (int)strlen(text + at)) {
        if (i)
            text[at++] = ' ';
        hada_format_number(text + at, sizeof text - (size_t)at, "%.17g", m[i]);
    }
    return hada_tensors_put_meta(writer, COLOUR_MATRIX, text, err);
}

static int get_colours(const hada_tensors *file, double m[HADA_COLOUR_MATRIX])
{
    const char *text = hada_tensors_meta(file, COLOUR_MATRIX), *end = text;
    memset(m, 0, HADA_COLOUR_MATRIX * sizeof *m);
    for (int i = 0; text && i < HADA_COLOUR_MATRIX; i++, text = end) {
        m[i] = hada_text_number(text, &end);
        if (end == text)
            return 0;
    }
    return !text || !*text;
}

/* 0 where it is not said. */
static int get_response(const hada_tensors *file, const char *key, double *response)
{
    const char *name = hada_tensors_meta(file, key);
    *response = 0.0;
    return !name || (!hada_response_from_name(response, name, NULL) && hada_response_is_known(*response));
}

hada_status hada_model_put_frames(hada_tensors_writer *writer, const hada_model_info *info, hada_error *err)
{
    char encoding[HADA_RESPONSE_NAME];
    hada_response_name(encoding, info->frame_encoding);
    if (info->frame_encoding != 0.0)
        HADA_TRY(hada_tensors_put_meta(writer, FRAME_ENCODING, encoding, err));
    HADA_TRY(put_colours(writer, info->colour_matrix, err));
    HADA_TRY(put_mosaic(writer, MOSAIC, info->mosaic, err));
    HADA_TRY(put_mosaic(writer, SENSOR_MOSAIC, info->sensor_mosaic, err));
    return info->downsample > 1 ? put_number(writer, DOWNSAMPLE, info->downsample, err) : HADA_OK;
}

const char *hada_model_get_frames(const hada_tensors *file, hada_model_info *info)
{
    const char *text = hada_tensors_meta(file, DOWNSAMPLE), *end = text;
    const double downsample = text ? hada_text_number(text, &end) : 1.0;
    if (!get_response(file, FRAME_ENCODING, &info->frame_encoding))
        return FRAME_ENCODING;
    if (!get_colours(file, info->colour_matrix))
        return COLOUR_MATRIX;
    if (!get_mosaic(file, MOSAIC, &info->mosaic))
        return MOSAIC;
    if (!get_mosaic(file, SENSOR_MOSAIC, &info->sensor_mosaic))
        return SENSOR_MOSAIC;
    if ((text && (end == text || *end)) || !(downsample >= 1 && downsample <= INT_MAX) ||
        downsample != floor(downsample))
        return DOWNSAMPLE;
    info->downsample = (int)downsample;
    return NULL;
}

static hada_status put_components(hada_tensors_writer *writer, const hada_model_info *info, hada_error *err)
{
    if (info->components < 2)
        return HADA_OK;
    HADA_TRY(put_number(writer, COMPONENTS, info->components, err));
    HADA_TRY(put_number(writer, POSITIONS, info->positions, err));
    HADA_TRY(put_number(writer, LOST, info->lost, err));
    HADA_TRY(put_number(writer, LOST_SINGLE, info->lost_single, err));
    return hada_tensors_put_meta(
        writer, "component_axes",
        "component_otf: [depth, component, channel, ky, kx, re/im], component_weights: [depth, component, row, column] "
        "of the window, singular_values: [depth, position]; frame = crop(sum of h_k * (w_k scene)); filter and otf are "
        "of the mean PSF",
        err);
}

/* The numbers of an info that stand under keys of their own. */
typedef struct number {
    const char *key;
    double *value;
} number;
enum { NUMBERS = 12, NUMBERS_NEEDED = 6 }; /* older models lack the others */

static void list_numbers(hada_model_info *info, double *steps, number numbers[NUMBERS])
{
    const number all[NUMBERS] = {{"alpha", &info->alpha},
                                 {"lambda", &info->lambda},
                                 {"dark", &info->dark},
                                 {"noise", &info->noise},
                                 {"refine_rho", &info->refine_rho},
                                 {"refine_steps", steps},
                                 {"refine_tv", &info->refine_tv},
                                 {"refine_colour", &info->refine_colour},
                                 {"refine_ridge", &info->refine_ridge},
                                 {"refine_share", &info->refine_share},
                                 {"refine_noise", &info->refine_noise},
                                 {"refine_noise_largest", &info->refine_noise_largest}};
    memcpy(numbers, all, sizeof all);
}

static hada_status put_metadata(hada_tensors_writer *writer, const hada_model_info *info, hada_error *err)
{
    HADA_TRY(hada_tensors_put_meta(writer, "format", FORMAT, err));
    HADA_TRY(put_number(writer, "version", info->components > 1 ? VARYING_VERSION : FORMAT_VERSION, err));
    HADA_TRY(hada_tensors_put_meta(writer, "library", "hadalens " HADALENS_VERSION, err));
    HADA_TRY(hada_tensors_put_meta(writer, "form", hada_form_name(info->form), err));
    HADA_TRY(hada_tensors_put_meta(writer, "boundary", hada_boundary_name(info->boundary), err));
    HADA_TRY(put_size(writer, "raw", info->raw_rows, info->raw_cols, err));
    HADA_TRY(put_size(writer, "grid", info->grid_rows, info->grid_cols, err));
    HADA_TRY(put_size(writer, "window", info->window_rows, info->window_cols, err));
    hada_model_info own = *info;
    double steps = info->refine_steps;
    number numbers[NUMBERS];
    list_numbers(&own, &steps, numbers);
    for (int i = 0; i < NUMBERS; i++)
        HADA_TRY(put_number(writer, numbers[i].key, *numbers[i].value, err));
    char response[HADA_RESPONSE_NAME];
    hada_response_name(response, info->scene_response);
    HADA_TRY(hada_tensors_put_meta(writer, RESPONSE, response, err));
    HADA_TRY(hada_model_put_frames(writer, info, err));
    HADA_TRY(put_components(writer, info, err));
    for (size_t i = 0; i < sizeof conventions / sizeof *conventions; i++)
        HADA_TRY(hada_tensors_put_meta(writer, conventions[i][0], conventions[i][1], err));
    return HADA_OK;
}

/* The tensors of a file, in their order. */
typedef struct part {
    const char *name;
    hada_dtype type;
    int dims;
    int64_t shape[6];
    void *place; /* of the model's pointer to its values */
} part;
enum { PARTS = 11 };

static size_t bytes_of(const part *it)
{
    size_t bytes = hada_dtype_bytes(it->type);
    for (int d = 0; d < it->dims; d++)
        bytes *= (size_t)it->shape[d];
    return bytes;
}

static void *values_of(const part *it)
{
    void *values;
    memcpy(&values, it->place, sizeof values);
    return values;
}

/* Which of them a model has that not all have. */
typedef struct optional {
    int statistics, otf, flat, dark_frame;
} optional;

static int list_parts(hada_model *model, optional has, part parts[PARTS])
{
    const hada_model_info *info = &model->info;
    const int64_t z = info->depths, c = info->channels, rows = info->grid_rows, half = info->grid_cols / 2 + 1;
    const int64_t k = info->components, raw_rows = info->raw_rows, raw_cols = info->raw_cols;
    int n = 0;
    /* widest type first, so that every tensor is aligned */
    parts[n++] = (part){"distances_mm", HADA_F64, 1, {z}, &model->distances};
    if (has.statistics) {
        parts[n++] = (part){"noise_power", HADA_F64, 2, {z, c}, &model->noise_power};
        parts[n++] = (part){"pairs", HADA_F64, 1, {z}, &model->pairs};
    }
    if (k > 1) {
        const int64_t window_rows = info->window_rows, window_cols = info->window_cols;
        parts[n++] = (part){"singular_values", HADA_F64, 2, {z, info->positions}, &model->singular_values};
        parts[n++] = (part){"component_otf", HADA_F32, 6, {z, k, c, rows, half, 2}, &model->component_otf};
        parts[n++] =
            (part){"component_weights", HADA_F32, 4, {z, k, window_rows, window_cols}, &model->component_weights};
    }
    if (has.statistics)
        parts[n++] = (part){"scene_power", HADA_F32, 2, {rows, half}, &model->scene_power};
    if (has.otf)
        parts[n++] = (part){"otf", HADA_F32, 5, {z, c, rows, half, 2}, &model->otf};
    if (has.flat)
        parts[n++] = (part){"flat", HADA_F32, 3, {c, raw_rows, raw_cols}, &model->flat.data};
    if (has.dark_frame)
        parts[n++] = (part){"dark_frame", HADA_F32, 3, {c, raw_rows, raw_cols}, &model->dark_frame.data};
    parts[n++] = info->half ? (part){"filter", HADA_F16, 5, {z, c, rows, half, 2}, &model->filter_half}
                            : (part){"filter", HADA_F32, 5, {z, c, rows, half, 2}, &model->filter};
    return n;
}

/* The net of a model in its file: its description and size in the metadata, its tensors behind the model's own. */
#define NET_PREFIX "enhance."
#define NET_META   "enhance"
#define NET_SIZE   "enhance_size"

static hada_status declare_enhance(const hada_model *model, hada_tensors_writer *writer, hada_error *err)
{
    hada_status status = HADA_OK;
    char *description = NULL;
    if (!model->enhance)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_net_describe(model->enhance, &description, err));
    HADA_TRY_OR_DONE(hada_tensors_put_meta(writer, NET_META, description, err));
    if (model->info.enhance_rows)
        HADA_TRY_OR_DONE(put_size(writer, NET_SIZE, model->info.enhance_rows, model->info.enhance_cols, err));
    HADA_TRY_OR_DONE(hada_net_declare(model->enhance, writer, NET_PREFIX, err));
done:
    free(description);
    return status;
}

/* Everything of a model into a file that has been opened. */
static hada_status write_model(const hada_model *model, hada_tensors_writer *writer, hada_error *err)
{
    hada_model own = *model; /* of which parts are asked that may be filled */
    part parts[PARTS];
    const optional has = {model->scene_power != NULL, model->otf != NULL, model->flat.data != NULL,
                          model->dark_frame.data != NULL};
    const int count = list_parts(&own, has, parts);
    HADA_TRY(put_metadata(writer, &model->info, err));
    for (int i = 0; i < count; i++)
        HADA_TRY(hada_tensors_declare(writer, parts[i].name, parts[i].type, parts[i].dims, parts[i].shape, err));
    HADA_TRY(declare_enhance(model, writer, err));
    for (int i = 0; i < count; i++)
        HADA_TRY(hada_tensors_write(writer, values_of(&parts[i]), bytes_of(&parts[i]), err));
    return model->enhance ? hada_net_write(model->enhance, writer, err) : HADA_OK;
}

hada_status hada_model_save(const hada_model *model, const char *path, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_tensors_writer *writer = NULL;
    HADA_NEED(model && path, err);
    HADA_TRY(hada_model_check_numbers(model, err));
    HADA_TRY_OR_DONE(hada_tensors_create(&writer, path, err));
    HADA_TRY_OR_DONE(write_model(model, writer, err));
    HADA_TRY_OR_DONE(hada_tensors_finish(&writer, err));
done:
    hada_tensors_abandon(&writer);
    return status;
}

static hada_status missing(const char *path, const char *what, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                     "%s: %s is missing or not usable; this is not a complete hadalens model (make one with 'hadalens "
                     "fit')",
                     path, what);
}

static hada_status get_number(const hada_tensors *file, const char *path, const char *key, double *out, hada_error *err)
{
    const char *text = hada_tensors_meta(file, key);
    const char *end = NULL;
    if (!text || !*text)
        return missing(path, key, err);
    *out = hada_text_number(text, &end);
    return end == text || *end || !isfinite(*out) ? missing(path, key, err) : HADA_OK;
}

static hada_status get_size(const hada_tensors *file, const char *path, const char *key, int *rows, int *cols,
                            hada_error *err)
{
    const char *text = hada_tensors_meta(file, key);
    char extra;
    if (!text || strlen(text) > 15 || sscanf(text, "%dx%d%c", rows, cols, &extra) != 2)
        return missing(path, key, err);
    return HADA_OK;
}

static hada_status get_components(const hada_tensors *file, const char *path, hada_model_info *info, hada_error *err)
{
    double components, positions;
    HADA_TRY(get_number(file, path, COMPONENTS, &components, err));
    HADA_TRY(get_number(file, path, POSITIONS, &positions, err));
    HADA_TRY(get_number(file, path, LOST, &info->lost, err));
    HADA_TRY(get_number(file, path, LOST_SINGLE, &info->lost_single, err));
    if (!(components >= 2 && components <= INT_MAX) || components != floor(components))
        return missing(path, COMPONENTS, err);
    if (!(positions >= components && positions <= INT_MAX) || positions != floor(positions))
        return missing(path, POSITIONS, err);
    info->components = (int)components;
    info->positions = (int)positions;
    return HADA_OK;
}

static hada_status get_metadata(const hada_tensors *file, const char *path, hada_model_info *info, hada_error *err)
{
    double version = 0, steps = 0;
    number numbers[NUMBERS];
    const char *format = hada_tensors_meta(file, "format");
    const char *form = hada_tensors_meta(file, "form"), *boundary = hada_tensors_meta(file, "boundary");
    if (!format || strcmp(format, FORMAT))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s is a safetensors file, but not a hadalens model", path);
    HADA_TRY(get_number(file, path, "version", &version, err));
    if (version != FORMAT_VERSION && version != VARYING_VERSION)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "%s is a model of version %g; this library reads versions up to %d: update the library or fit "
                         "again",
                         path, version, VARYING_VERSION);
    if (!form || !(info->form = hada_form_from_name(form)))
        HADA_TRY(missing(path, "form", err));
    if (!boundary || !(info->boundary = hada_boundary_from_name(boundary)))
        HADA_TRY(missing(path, "boundary", err));
    HADA_TRY(get_size(file, path, "raw", &info->raw_rows, &info->raw_cols, err));
    HADA_TRY(get_size(file, path, "grid", &info->grid_rows, &info->grid_cols, err));
    HADA_TRY(get_size(file, path, "window", &info->window_rows, &info->window_cols, err));
    list_numbers(info, &steps, numbers);
    for (int i = 0; i < NUMBERS; i++)
        if (i < NUMBERS_NEEDED || hada_tensors_meta(file, numbers[i].key))
            HADA_TRY(get_number(file, path, numbers[i].key, numbers[i].value, err));
    if (!hada_tensors_meta(file, "refine_ridge") && hada_tensors_meta(file, "refine_shrink")) {
        double shrink = 0.0; /* what older models had in its place */
        HADA_TRY(get_number(file, path, "refine_shrink", &shrink, err));
        info->refine_ridge = shrink > 0.0 ? 1.0 : 0.0;
    }
    if (!get_response(file, RESPONSE, &info->scene_response)) /* older models lack it: linear */
        HADA_TRY(missing(path, RESPONSE, err));
    const char *wrong = hada_model_get_frames(file, info);
    if (wrong)
        HADA_TRY(missing(path, wrong, err));
    if (steps < 0 || steps > HADA_MODEL_MOST_STEPS || steps != floor(steps))
        HADA_TRY(missing(path, "refine_steps", err));
    info->refine_steps = (int)steps;
    return version == VARYING_VERSION ? get_components(file, path, info, err) : HADA_OK;
}

/* A tensor of the wanted shape and type whose data can be used in place. */
static hada_status check_part(const hada_tensors *file, const char *path, const part *want, const void **data,
                              hada_error *err)
{
    const hada_stored_tensor *tensor = hada_tensors_find(file, want->name);
    if (!tensor)
        return missing(path, want->name, err);
    int same = tensor->type == want->type && tensor->dims == want->dims;
    for (int d = 0; same && d < want->dims; d++)
        same = tensor->shape[d] == want->shape[d];
    if (!same)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "%s: the tensor %s has not the shape or type that the metadata say; the file is damaged", path,
                         want->name);
    if ((uintptr_t)tensor->data % 4)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "%s: the tensor %s is not aligned; write the file again with the safetensors library", path,
                         want->name);
    *data = tensor->data;
    return HADA_OK;
}

/* Points the model's arrays into the file; small ones were allocated and are copied. */
static hada_status take_parts(hada_model *model, const hada_tensors *file, const char *path, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const optional has = {model->noise_power != NULL, info->has_otf, hada_tensors_find(file, "flat") != NULL,
                          hada_tensors_find(file, "dark_frame") != NULL};
    part parts[PARTS];
    const int count = list_parts(model, has, parts);
    for (int i = 0; i < count; i++) {
        const void *data = NULL;
        HADA_TRY(check_part(file, path, &parts[i], &data, err));
        const hada_image frame = {info->channels, info->raw_rows, info->raw_cols, (float *)(uintptr_t)data};
        if (parts[i].type == HADA_F64)
            memcpy(values_of(&parts[i]), data, bytes_of(&parts[i]));
        else if (parts[i].place == &model->flat.data)
            HADA_TRY(hada_model_set_flat(model, &frame, err));
        else if (parts[i].place == &model->dark_frame.data)
            HADA_TRY(hada_model_set_dark(model, &frame, err));
        else
            memcpy(parts[i].place, &data, sizeof data);
    }
    return HADA_OK;
}

/* A net's layers times the pixels of the size at which it runs: two small numbers of a file, whose product is memory
 * and time. Many times the window's values, which the file's own tensors hold, are always allowed: nets come to some
 * hundred; else the budget for pixels, several times. */
enum { NET_TIMES_WINDOW = 1 << 14, NET_TIMES_PIXELS = 8 };

static hada_status check_net_budget(const hada_model *model, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const hada_net *net = model->enhance;
    const double window = (double)info->channels * info->window_rows * info->window_cols;
    const int rows = info->enhance_rows ? info->enhance_rows : info->window_rows,
              cols = info->enhance_cols ? info->enhance_cols : info->window_cols;
    hada_limits limits = {.size = sizeof limits};
    hada_size *sizes = NULL;
    double values = 0.0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_limits_get(&limits, err));
    HADA_TRY_OR_DONE(HADA_NEW(sizes, (size_t)net->count, "a net", err));
    HADA_TRY_OR_DONE(hada_net_sizes(net, rows, cols, sizes, err));
    for (int i = 0; i < net->count; i++)
        values += (double)net->layers[i].channels * sizes[i].rows * sizes[i].cols;
    if (values > NET_TIMES_WINDOW * window && values / NET_TIMES_PIXELS > (double)limits.pixels)
        status = hada_fail(err, HADA_ERROR_FILE_FORMAT,
                           "the net's %d layers hold %.3g numbers at %d x %d pixels, beyond the limits; where it is to "
                           "be trusted, allow it (options.limits pixels=%.0f)",
                           net->count, values, rows, cols, ceil(values / NET_TIMES_PIXELS));
done:
    free(sizes);
    return status;
}

/* Takes the net of a file, if it has one. */
static hada_status read_enhance(hada_model *model, const hada_tensors *file, hada_error *err)
{
    const char *description = hada_tensors_meta(file, NET_META), *size = hada_tensors_meta(file, NET_SIZE);
    int rows = 0, cols = 0;
    hada_net *net = NULL;
    char extra;
    if (!description)
        return HADA_OK;
    if (size && (strlen(size) > 15 || sscanf(size, "%dx%d%c", &rows, &cols, &extra) != 2))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "the metadata " NET_SIZE " are not usable");
    const hada_status status = hada_net_from_file(&net, description, file, NET_PREFIX, err);
    HADA_TRY(status ? status : hada_model_own_enhance(model, net, rows, cols, err));
    return check_net_budget(model, err);
}

/* What the metadata and the tensors' shapes say. */
static hada_status get_info(const hada_tensors *file, const char *path, hada_model_info *info, hada_error *err)
{
    HADA_TRY(get_metadata(file, path, info, err));
    const hada_stored_tensor *filter = hada_tensors_find(file, "filter");
    if (!filter || filter->dims != 5 || (filter->type != HADA_F32 && filter->type != HADA_F16))
        return missing(path, "the tensor filter (float32 or float16, five dimensions)", err);
    if (filter->shape[0] > 4096 || filter->shape[1] > 64)
        return missing(path, "the tensor filter (at most 4096 depths, 64 channels)", err);
    info->depths = (int)filter->shape[0];
    info->channels = (int)filter->shape[1];
    info->half = filter->type == HADA_F16;
    info->has_otf = hada_tensors_find(file, "otf") != NULL;
    info->name = path;
    return HADA_OK;
}

/* Checks the tensors, and takes the net. */
static hada_status complete(hada_model *model, const hada_tensors *file, hada_error *err)
{
    HADA_TRY(hada_model_info_check(&model->info, err));
    HADA_TRY(hada_model_check_numbers(model, err));
    return read_enhance(model, file, err);
}

/* Room for the small arrays, which are copied. */
static hada_status make_small(hada_model *model, hada_error *err)
{
    const hada_model_info *info = &model->info;
    const size_t depths = (size_t)info->depths;
    if (hada_tensors_find(model->file, "scene_power")) {
        HADA_TRY(HADA_NEW(model->noise_power, depths * (size_t)info->channels, "the noise power", err));
        HADA_TRY(HADA_NEW(model->pairs, depths, "the pairs", err));
    }
    if (info->components > 1)
        HADA_TRY(HADA_NEW(model->singular_values, depths * (size_t)info->positions, "singular values", err));
    return HADA_OK;
}

hada_status hada_model_load(hada_model **out, const char *path, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_model_info info = {0};
    hada_tensors *file = NULL;
    HADA_NEED(out && path, err);
    *out = NULL;
    HADA_TRY_OR_DONE(hada_tensors_open(&file, path, err));
    HADA_TRY_OR_DONE(get_info(file, path, &info, err));
    if ((status = hada_model_create_head(out, &info, err)) != HADA_OK) {
        hada_error_prefix(err, "%s: ", path);
        goto done;
    }
    (*out)->file = file;
    HADA_TRY_OR_DONE(make_small(*out, err));
    HADA_TRY_OR_DONE(take_parts(*out, file, path, err));
    if ((status = complete(*out, file, err)) != HADA_OK)
        hada_error_prefix(err, "%s: ", path);
done:
    if (status && *out)
        hada_model_destroy(out); /* closes the file */
    else if (status)
        hada_tensors_close(&file);
    return status;
}
