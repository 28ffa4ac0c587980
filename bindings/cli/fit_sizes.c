#include "fit_sizes.h"
#include "pairs.h"

#include <hadalens/camera.h>
#include <hadalens/tiff.h>

static hada_status measure(const char *path, hada_tiff_info *info, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_status status = hada_tiff_open(&reader, path, err);
    if (status) {
        hada_cli_prefix(err, "%s: ", path);
        return status;
    }
    *info = *hada_tiff_get_info(reader);
    hada_tiff_close(&reader);
    return HADA_OK;
}

hada_status hada_cli_fit_sizes(hada_fit_options *fit, const hada_cli_dataset *data, const int window[2],
                               hada_error *err)
{
    const hada_cli_pair *pair = &data->depth[0].pair[0];
    hada_tiff_info raw, scene;
    hada_status status = measure(pair->raw, &raw, err);
    if (!status)
        status = measure(pair->scene, &scene, err);
    if (status)
        return status;
    fit->depths = data->depths;
    fit->distances_mm = data->distances_mm;
    fit->channels = raw.channels;
    fit->raw_rows = raw.rows;
    fit->raw_cols = raw.cols;
    fit->window_rows = scene.rows;
    fit->window_cols = scene.cols;
    if (!window[0] || (window[0] == scene.rows && window[1] == scene.cols))
        return HADA_OK;
    if (scene.rows != raw.rows || scene.cols != raw.cols)
        return hada_cli_error(
            err, HADA_ERROR_ARGUMENT,
            "--window %dx%d: the scenes have %dx%d pixels, which is the window then; a smaller one can "
            "be cut only from scenes as large as the frame (%dx%d)",
            window[0], window[1], scene.rows, scene.cols, raw.rows, raw.cols);
    fit->window_rows = window[0];
    fit->window_cols = window[1];
    return HADA_OK;
}

hada_boundary hada_cli_fit_boundary(hada_cli *cli, int choice, const hada_cli_dataset *data)
{
    hada_camera camera;
    hada_error err = {0};
    if (choice)
        return choice == 1 ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED;
    if (!data->camera)
        return HADA_BOUNDARY_PADDED;
    hada_camera_init(&camera);
    if (!hada_camera_load(&camera, data->camera, &err))
        return camera.boundary;
    hada_cli_warn(cli, "%s is not used: %s", data->camera, err.message);
    return HADA_BOUNDARY_PADDED;
}

hada_status hada_cli_fit_dark(const char *text, double *level, hada_error *err)
{
    hada_cli_dark dark;
    hada_status status = hada_cli_dark_read(&dark, text, err);
    if (status)
        return status;
    *level = dark.level;
    if (dark.kind == HADA_CLI_DARK_AUTO)
        *level = -1; /* each frame's own, here and in the model */
    hada_cli_dark_free(&dark);
    return status;
}
