/* The names of enumerations. */
#include <hadalens/camera.h>
#include <hadalens/scene.h>
#include <hadalens/tune.h>
#include <string.h>

static const struct {
    hada_enum which;
    int value;
    const char *name;
} names[] = {{HADA_ENUM_DEVICE_KIND, HADA_DEVICE_CPU, "cpu"},
             {HADA_ENUM_DEVICE_KIND, HADA_DEVICE_GPU, "gpu"},
             {HADA_ENUM_DEVICE_KIND, HADA_DEVICE_ACCELERATOR, "accelerator"},
             {HADA_ENUM_DEVICE_KIND, HADA_DEVICE_OTHER, "other"},
             {HADA_ENUM_KERNEL_SHAPE, HADA_SHAPE_LANES, "lanes"},
             {HADA_ENUM_KERNEL_SHAPE, HADA_SHAPE_GROUPS, "groups"},
             {HADA_ENUM_TUNE_BACKEND, HADA_TUNE_OWN, "own"},
             {HADA_ENUM_TUNE_BACKEND, HADA_TUNE_CLFFT, "clfft"},
             {HADA_ENUM_MASK, HADA_MASK_MLA, "mla"},
             {HADA_ENUM_MASK, HADA_MASK_GRID, "grid"},
             {HADA_ENUM_MASK, HADA_MASK_DIFFUSER, "diffuser"},
             {HADA_ENUM_MASK, HADA_MASK_CONTOUR, "contour"},
             {HADA_ENUM_MASK, HADA_MASK_APERTURE, "aperture"},
             {HADA_ENUM_RELIEF, HADA_RELIEF_SLANT, "slant"},
             {HADA_ENUM_RELIEF, HADA_RELIEF_HALF, "half"},
             {HADA_ENUM_RELIEF, HADA_RELIEF_HILL, "hill"},
             {HADA_ENUM_RELIEF, HADA_RELIEF_BALL, "ball"},
             {HADA_ENUM_RELIEF, HADA_RELIEF_STEPS, "steps"},
             {HADA_ENUM_RELIEF, HADA_RELIEF_BARS, "bars"},
             {HADA_ENUM_OPTICS, HADA_OPTICS_GEOMETRY, "geometry"},
             {HADA_ENUM_OPTICS, HADA_OPTICS_WAVE, "wave"},
             {HADA_ENUM_BOUNDARY, HADA_BOUNDARY_CIRCULAR, "circular"},
             {HADA_ENUM_BOUNDARY, HADA_BOUNDARY_PADDED, "padded"},
             {HADA_ENUM_MOSAIC, HADA_MOSAIC_NONE, "none"},
             {HADA_ENUM_MOSAIC, HADA_MOSAIC_RGGB, "rggb"},
             {HADA_ENUM_MOSAIC, HADA_MOSAIC_BGGR, "bggr"},
             {HADA_ENUM_MOSAIC, HADA_MOSAIC_GRBG, "grbg"},
             {HADA_ENUM_MOSAIC, HADA_MOSAIC_GBRG, "gbrg"}};
#define NAMES (sizeof names / sizeof *names)

const char *hada_enum_name(hada_enum which, int value)
{
    for (size_t i = 0; i < NAMES; i++)
        if (names[i].which == which && names[i].value == value)
            return names[i].name;
    return NULL;
}

int hada_enum_value(hada_enum which, const char *name)
{
    for (size_t i = 0; name && i < NAMES; i++)
        if (names[i].which == which && !strcmp(names[i].name, name))
            return names[i].value;
    return -1;
}
