/* Cameras as JSON files. */
#include <errno.h>
#include <hadalens/camera.h>
#include <hadalens/limits.h>
#include <jansson.h>

#include "core/callers.h"
#include "core/input.h"
#include "core/outfile.h"
#include "optics/mask.h"

/* The fields of a camera that are plain numbers, with their names in the file. */
typedef struct field {
    const char *name;
    int is_integer;
    size_t offset;
} field;
#define INTEGER(name)                                                                                                  \
    {                                                                                                                  \
#name, 1, offsetof(hada_camera, name)                                                                          \
    }
#define REAL(name)                                                                                                     \
    {                                                                                                                  \
#name, 0, offsetof(hada_camera, name)                                                                          \
    }
static const field fields[] = {INTEGER(rows),
                               INTEGER(cols),
                               INTEGER(channels),
                               INTEGER(window_rows),
                               INTEGER(window_cols),
                               REAL(pixel_pitch_mm),
                               REAL(distance_mm),
                               INTEGER(lenses),
                               REAL(lens_diameter_mm),
                               REAL(focal_length_mm),
                               REAL(aperture_mm),
                               REAL(minimum_spacing_mm),
                               REAL(maximum_spacing_mm),
                               REAL(refractive_index),
                               REAL(abbe_number),
                               REAL(correlation_mm),
                               REAL(deflection_mrad),
                               REAL(cell_mm),
                               REAL(open_fraction),
                               REAL(blur_pixels)};
#undef INTEGER
#undef REAL
/* A camera with the most distances has some 30 KB. */
#define MOST_BYTES ((size_t)1 << 20)
/* As many budgets of a page (hadalens/limits.h) as a camera's frame may have numbers: a sensor of 11 million pixels. */
#define FRAMES_AS_LARGE 8
#define FIELDS          (sizeof fields / sizeof *fields)

static json_t *to_json(const hada_camera *camera)
{
    json_t *object = json_object();
    int bad = json_object_set_new(object, "format", json_string("hadalens camera"));
    bad |= json_object_set_new(object, "mask", json_string(hada_enum_name(HADA_ENUM_MASK, (int)camera->mask)));
    bad |= json_object_set_new(object, "optics", json_string(camera->optics == HADA_OPTICS_WAVE ? "wave" : "geometry"));
    bad |= json_object_set_new(object, "boundary",
                               json_string(camera->boundary == HADA_BOUNDARY_PADDED ? "padded" : "circular"));
    for (size_t i = 0; i < FIELDS; i++) {
        const char *at = (const char *)camera + fields[i].offset;
        bad |= json_object_set_new(object, fields[i].name,
                                   fields[i].is_integer ? json_integer(*(const int *)(const void *)at)
                                                        : json_real(*(const double *)(const void *)at));
    }
    /* as text: JSON readers commonly keep integers as doubles, which have 53 bits */
    char seed[32];
    snprintf(seed, sizeof seed, "%llu", (unsigned long long)camera->seed);
    bad |= json_object_set_new(object, "seed", json_string(seed));
    json_t *wavelengths = json_array(), *distances = json_array();
    for (int i = 0; i < 3; i++)
        bad |= json_array_append_new(wavelengths, json_real(camera->wavelengths_nm[i]));
    bad |= json_object_set_new(object, "wavelengths_nm", wavelengths);
    for (int i = 0; i < camera->depths; i++)
        bad |= json_array_append_new(distances, json_real(camera->distances_mm[i]));
    bad |= json_object_set_new(object, "distances_mm", distances);
    if (bad) {
        json_decref(object);
        return NULL;
    }
    return object;
}

hada_status hada_camera_save(const hada_camera *callers, const char *path, hada_error *err)
{
    HADA_NEED(callers && path, err);
    hada_camera camera;
    json_t *object = NULL;
    char *text = NULL;
    hada_outfile file = {.fd = -1};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_camera_take(&camera, callers, err));
    object = to_json(&camera);
    text = object ? json_dumps(object, JSON_INDENT(2) | JSON_REAL_PRECISION(15)) : NULL;
    if (!text)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory to write '%s'", path));
    HADA_TRY_OR_DONE(hada_outfile_open(&file, path, err));
    HADA_TRY_OR_DONE(hada_outfile_write(&file, text, strlen(text), err));
    HADA_TRY_OR_DONE(hada_outfile_write(&file, "\n", 1, err));
    HADA_TRY_OR_DONE(hada_outfile_commit(&file, err));
done:
    hada_outfile_abandon(&file);
    json_decref(object);
    free(text);
    return status;
}

static hada_status read_fields(hada_camera *camera, const json_t *object, const char *path, hada_error *err)
{
    for (size_t i = 0; i < FIELDS; i++) {
        const json_t *value = json_object_get(object, fields[i].name);
        char *at = (char *)camera + fields[i].offset;
        if (!value)
            continue;
        if (fields[i].is_integer ? !json_is_integer(value) : !json_is_number(value))
            return hada_fail(err, HADA_ERROR_FILE_FORMAT, "'%s': \"%s\" must be %s number", path, fields[i].name,
                             fields[i].is_integer ? "a whole" : "a");
        if (fields[i].is_integer) {
            const json_int_t number = json_integer_value(value);
            if (number < 0 || number > 1 << 30)
                return hada_fail(err, HADA_ERROR_FILE_FORMAT, "'%s': \"%s\" is out of range", path, fields[i].name);
            *(int *)(void *)at = (int)number;
        } else
            *(double *)(void *)at = json_number_value(value);
    }
    const json_t *seed = json_object_get(object, "seed");
    const char *text = json_string_value(seed);
    char *end = NULL;
    errno = 0;
    if (text && *text >= '0' && *text <= '9') /* strtoull() takes signs and blanks as well */
        camera->seed = strtoull(text, &end, 10);
    else if (!text && json_is_integer(seed) && json_integer_value(seed) >= 0)
        camera->seed = (uint64_t)json_integer_value(seed);
    else if (seed)
        errno = EINVAL;
    return errno || (end && *end) ? hada_fail(err, HADA_ERROR_FILE_FORMAT,
                                              "'%s': \"seed\" must be a whole number from 0 to 2^64 - 1", path)
                                  : HADA_OK;
}

static hada_status read_word(const char **word, const json_t *object, const char *name, const char *path,
                             hada_error *err)
{
    const json_t *value = json_object_get(object, name);
    *word = json_string_value(value);
    return !value || *word ? HADA_OK
                           : hada_fail(err, HADA_ERROR_FILE_FORMAT, "'%s': \"%s\" must be a word", path, name);
}

static hada_status read_kinds(hada_camera *camera, const json_t *object, const char *path, hada_error *err)
{
    const char *mask, *boundary, *optics;
    HADA_TRY(read_word(&mask, object, "mask", path, err));
    HADA_TRY(read_word(&boundary, object, "boundary", path, err));
    HADA_TRY(read_word(&optics, object, "optics", path, err));
    if (mask && hada_enum_value(HADA_ENUM_MASK, mask) < 0)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "'%s': mask kind '%s' is not known; use \"mla\", \"grid\", \"diffuser\", \"contour\" or "
                         "\"aperture\"",
                         path, mask);
    if (optics && hada_enum_value(HADA_ENUM_OPTICS, optics) < 0)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "'%s': \"optics\" must be \"geometry\" or \"wave\"", path);
    if (boundary && hada_enum_value(HADA_ENUM_BOUNDARY, boundary) < 0)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "'%s': \"boundary\" must be \"circular\" or \"padded\"", path);
    if (mask)
        camera->mask = (hada_mask)hada_enum_value(HADA_ENUM_MASK, mask);
    if (optics)
        camera->optics = (hada_optics)hada_enum_value(HADA_ENUM_OPTICS, optics);
    if (boundary)
        camera->boundary = (hada_boundary)hada_enum_value(HADA_ENUM_BOUNDARY, boundary);
    const json_t *wavelengths = json_object_get(object, "wavelengths_nm");
    if (wavelengths && json_array_size(wavelengths) != 3)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "'%s': \"wavelengths_nm\" must be a list of 3 numbers", path);
    for (size_t i = 0; wavelengths && i < 3; i++)
        camera->wavelengths_nm[i] = json_number_value(json_array_get(wavelengths, i));
    const json_t *distances = json_object_get(object, "distances_mm");
    if (!distances)
        return HADA_OK;
    const size_t count = json_array_size(distances);
    if (!json_is_array(distances) || count < 1 || count > HADA_CAMERA_DEPTHS)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "'%s': \"distances_mm\" must be a list of 1 to %d distances",
                         path, HADA_CAMERA_DEPTHS);
    camera->depths = (int)count;
    for (size_t i = 0; i < count; i++)
        camera->distances_mm[i] = json_number_value(json_array_get(distances, i));
    return HADA_OK;
}

/* Work with a camera takes some 70 bytes for each pixel of its sensor, and a file of any size can claim them. */
static hada_status check_budget(const hada_camera *camera, hada_error *err)
{
    hada_limits limits = {.size = sizeof limits};
    const uint64_t values = (uint64_t)camera->rows * (uint64_t)camera->cols * (uint64_t)camera->channels;
    const hada_status status = hada_limits_get(&limits, err);
    if (status || values / FRAMES_AS_LARGE <= limits.pixels)
        return status;
    return hada_fail(
        err, HADA_ERROR_FILE_FORMAT,
        "a camera of %d x %d pixels in %d channel(s) is beyond the limits; where it is to be trusted, allow "
        "it (options.limits pixels=%llu)",
        camera->rows, camera->cols, camera->channels, (unsigned long long)(values / FRAMES_AS_LARGE + 1));
}

hada_status hada_camera_load(hada_camera *callers, const char *path, hada_error *err)
{
    json_error_t where;
    hada_camera own, *camera = &own;
    char *text = NULL;
    size_t bytes;
    HADA_NEED(callers && path, err);
    HADA_TRY(HADA_REPORT_CHECK(callers, hada_camera, err));
    hada_camera_init(camera);
    hada_status status = hada_input_read(&text, &bytes, path, MOST_BYTES, NULL, err);
    if (status) {
        hada_error_prefix(err, "'%s' ", path);
        return status;
    }
    json_t *object = json_loadb(text, bytes, JSON_REJECT_DUPLICATES, &where);
    free(text);
    if (!json_is_object(object)) {
        json_decref(object);
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "'%s' is not a camera in JSON (line %d: %s)", path, where.line,
                         object ? "an object is expected" : where.text);
    }
    HADA_TRY_OR_DONE(read_fields(camera, object, path, err));
    HADA_TRY_OR_DONE(read_kinds(camera, object, path, err));
    status = hada_error_of_file(hada_camera_check(camera, err), err);
    status = status ? status : check_budget(camera, err);
    if (status)
        hada_error_prefix(err, "'%s': ", path);
    else
        HADA_REPORT_GIVE(callers, camera);
done:
    json_decref(object);
    return status;
}
