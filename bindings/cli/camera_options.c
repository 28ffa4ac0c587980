#include "camera_options.h"

#include <stddef.h>

#define AT(member) offsetof(hada_cli_camera_settings, member)
const hada_cli_option hada_cli_camera_options[] = {
    {HADA_OPTION_GROUP, NULL, 0, NULL, "The camera", NULL, 0},
    {HADA_OPTION_TEXT, "preset", 0, "NAME", "camera to begin with (default: sim512)",
     "sim300: 300x400, 4 depths; sim512: 512x512, 14 depths; paper2022: 1376x2064, 14 depths. All see colour and 100 "
     "to 600 mm.",
     AT(preset)},
    {HADA_OPTION_CHOICE, "mask", 0, "mla", "kind of mask: mla, microlenses at random places (default)", NULL, AT(mask)},
    {HADA_OPTION_COUNT, "lenses", 0, "N", "number of lenses", NULL, AT(lenses)},
    {HADA_OPTION_SIZE, "size", 0, "HxW", "pixels of the sensor, rows first",
     "The sensor keeps its length in millimetres, so the pixels change.", AT(size)},
    {HADA_OPTION_SIZE, "window", 0, "HxW", "field of view: pixels of the scene", NULL, AT(window)},
    {HADA_OPTION_CHOICE, "channels", 0, "1|2|3", "1 for grey, 3 for colour", NULL, AT(channels)},
    {HADA_OPTION_COUNT, "depths", 0, "N", "number of distances, equal steps in 1/distance", NULL, AT(depths)},
    {HADA_OPTION_REAL, "near", 0, "MM", "nearest distance", NULL, AT(near_mm)},
    {HADA_OPTION_REAL, "far", 0, "MM", "farthest distance", NULL, AT(far_mm)},
    {HADA_OPTION_CHOICE, "boundary", 0, "circular|padded", "light beyond the sensor comes back in, or is lost",
     "circular is the simplest model; padded is what a real sensor does. 'fit' reads the choice from camera.json.",
     AT(boundary)},
    {HADA_OPTION_SEED, "seed", 0, "N", "seed of all that is drawn at random; the same seed gives the same files", NULL,
     AT(seed)},
    {0},
};

void hada_cli_camera_defaults(hada_cli_camera_settings *set)
{
    set->preset = "sim512";
    set->depths = set->lenses = -1;
    set->near_mm = set->far_mm = -1;
    set->seed = UINT64_MAX;
}

hada_status hada_cli_make_camera(hada_camera *camera, const hada_cli_camera_settings *set, hada_error *err)
{
    hada_status status = hada_camera_preset(camera, set->preset, err);
    if (!status && set->size[0])
        status = hada_camera_resize(camera, set->size[0], set->size[1], set->window[0], set->window[1], err);
    if (!status && set->channels == 2)
        status = hada_cli_error(err, HADA_ERROR_ARGUMENT, "--channels takes 1 or 3");
    if (status)
        return status;
    if (set->window[0]) {
        camera->window_rows = set->window[0];
        camera->window_cols = set->window[1];
    }
    if (set->channels)
        camera->channels = set->channels;
    if (set->lenses >= 0)
        camera->lenses = set->lenses;
    if (set->seed != UINT64_MAX)
        camera->seed = set->seed;
    if (set->boundary)
        camera->boundary = set->boundary == 1 ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED;
    if (set->depths >= 0 || set->near_mm >= 0 || set->far_mm >= 0) {
        double near_mm = set->near_mm >= 0 ? set->near_mm : camera->distances_mm[0];
        double far_mm = set->far_mm >= 0 ? set->far_mm : camera->distances_mm[camera->depths - 1];
        int depths = set->depths >= 0 ? set->depths : camera->depths;
        status = hada_camera_set_depths(camera, near_mm, far_mm, depths, err);
    }
    status = status ? status : hada_camera_check(camera, err);
    /* Sizes that do not fit are the command line's here, not a file's. */
    return status == HADA_ERROR_SIZE ? (err->status = HADA_ERROR_ARGUMENT) : status;
}
