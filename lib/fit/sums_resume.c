/* A fitter from a file of sums alone: the file knows its camera. */
#include <stdio.h>
#include <string.h>

#include "core/options.h"
#include "fit/fitter.h"
#include "io/safetensors.h"

static hada_status damaged(const char *path, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s does not hold the sums of a fit, or is damaged", path);
}

/* Reads what the file says of its camera into `options`; the distances point into the file. */
static hada_status read_camera(const hada_tensors *file, const char *path, hada_fit_options *options, hada_error *err)
{
    int grid_rows, grid_cols;
    char boundary[16];
    const char *sizes = hada_tensors_meta(file, "sizes");
    const hada_stored_tensor *sums = hada_tensors_find(file, "sums"),
                             *distances = hada_tensors_find(file, "distances_mm"),
                             *dark = hada_tensors_find(file, "dark");
    if (!sizes || !sums || sums->dims != 6 || !distances || distances->type != HADA_F64 || distances->dims != 1 ||
        distances->shape[0] != sums->shape[0] || !dark || dark->type != HADA_F64 || dark->bytes != sizeof(double) ||
        sums->shape[0] < 1 || sums->shape[0] > 100000 || sums->shape[1] < 1 || sums->shape[1] > 100000)
        return damaged(path, err);
    if (sscanf(sizes, "raw %dx%d, window %dx%d, grid %dx%d, %15s", &options->raw_rows, &options->raw_cols,
               &options->window_rows, &options->window_cols, &grid_rows, &grid_cols, boundary) != 7)
        return damaged(path, err);
    options->depths = (int)sums->shape[0];
    options->channels = (int)sums->shape[1];
    options->distances_mm = distances->data;
    options->boundary = hada_boundary_from_name(boundary);
    memcpy(&options->dark, dark->data, sizeof options->dark);
    return options->boundary ? HADA_OK : damaged(path, err);
}

hada_status hada_fitter_create_from_sums(hada_fitter **out, hada_context *context, const char *path,
                                         const hada_fit_options *choices, hada_error *err)
{
    hada_fit_options options;
    hada_tensors *file;
    if (!out || !context || !path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_create_from_sums: out, context and path are needed");
    *out = NULL;
    hada_fit_options_init(&options);
    hada_status status = HADA_OPTIONS_TAKE(&options, choices, hada_fit_options, err);
    if (!status)
        status = hada_tensors_open(&file, path, err);
    if (status)
        return status;
    status = read_camera(file, path, &options, err);
    if (!status)
        status = hada_fitter_create(out, context, &options, err);
    hada_tensors_close(&file);
    if (!status)
        status = hada_fitter_load_sums(*out, path, err);
    if (status)
        hada_fitter_destroy(out);
    return status;
}
