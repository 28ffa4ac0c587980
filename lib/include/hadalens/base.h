/* Hadalens: what every header stands on: the version, the export macro, the word for "default", sized structs.
 *
 * Options. Structs of options begin with their size, as the caller's compiler knows it; hada_..._init() sets it, and
 * every option to its default. A library that is newer than the caller gives the options that the caller does not know
 * their defaults; one that is older takes a larger struct as long as what it does not know is as the init left it
 * (HADA_ERROR_UNSUPPORTED otherwise). So start from the init, set what differs, and do not copy members across by
 * hand. Where a call takes NULL for its options, that stands for the defaults.
 *
 * Reports. Structs that the library fills in the caller's memory begin with their size as well, which the caller sets
 * before the call (hada_step_report report = {.size = sizeof report}; in C++ report.size = sizeof report); as much is
 * filled as both sides know. Structs that the library hands out by a const pointer are its own: later versions may
 * append to them. Plain structs without a size (hada_image, hada_error, hada_result, hada_plane) and the rows
 * of arrays stay as they are.
 *
 * What the library makes is given back by a ..._destroy(), which clears the pointer; most of it is made by ..._create()
 * and read by ..._get(). Files are opened and closed. Nothing is given to free().
 *
 * Defaults. A number that the library is to choose is HADA_AUTO, in integers and in floating point alike, and each
 * option that can be left open says so; of an enumeration it is the member ..._AUTO. Pointers that are left open are
 * NULL, and a size of 0 x 0 is none of its own.
 *
 * Threads: these functions have no state. Source: Semantic Versioning 2.0.0 (semver.org); CONTRIBUTING.md says what
 * each part of the version and the soname mean here. */
#ifndef HADALENS_BASE_H
#define HADALENS_BASE_H

#include <stddef.h>
#include <stdint.h>

/* The version of these headers. */
#define HADALENS_VERSION_MAJOR 0
#define HADALENS_VERSION_MINOR 2
#define HADALENS_VERSION_PATCH 0
#define HADALENS_VERSION       "0.2.0"

/* For the preprocessor: #if HADALENS_VERSION_NUMBER >= HADALENS_VERSION_OF(0, 2, 0) */
#define HADALENS_VERSION_OF(major, minor, patch) ((major)*10000 + (minor)*100 + (patch))
#define HADALENS_VERSION_NUMBER                                                                                        \
    HADALENS_VERSION_OF(HADALENS_VERSION_MAJOR, HADALENS_VERSION_MINOR, HADALENS_VERSION_PATCH)

/* Exported. HADALENS_BUILDING is defined while the library is built, HADALENS_STATIC by users of a static one. */
#if defined(HADALENS_STATIC)
#define HADA_API
#elif defined(_WIN32) || defined(__CYGWIN__)
#if defined(HADALENS_BUILDING)
#define HADA_API __declspec(dllexport)
#else
#define HADA_API __declspec(dllimport)
#endif
#elif defined(__GNUC__)
#define HADA_API __attribute__((visibility("default")))
#else
#define HADA_API
#endif

/* "The library chooses", for every option that may be left open. */
#define HADA_AUTO (-1)

#ifdef __cplusplus
extern "C" {
#endif

/* The structs that hada_struct_init() sets up; their numbers stay. */
typedef enum hada_struct {
    HADA_STRUCT_CLASSIC_OPTIONS = 1,
    HADA_STRUCT_COMMUNICATOR = 2,
    HADA_STRUCT_DATASET_OPTIONS = 3,
    HADA_STRUCT_CONTEXT_OPTIONS = 4,
    HADA_STRUCT_FIT_OPTIONS = 5,
    HADA_STRUCT_FOCUS_OPTIONS = 6,
    HADA_STRUCT_LIMITS = 7,
    HADA_STRUCT_PSF_OPTIONS = 8,
    HADA_STRUCT_MONITOR = 9,
    HADA_STRUCT_UNET_OPTIONS = 10,
    HADA_STRUCT_CL_FRAME = 11,
    HADA_STRUCT_CL_ARRAYS = 12,
    HADA_STRUCT_WAVE_OPTIONS = 13,
    HADA_STRUCT_PIXELS = 14,
    HADA_STRUCT_PREVIEW = 15,
    HADA_STRUCT_PLAN_OPTIONS = 16,
    HADA_STRUCT_RESULT_ARRAYS = 17,
    HADA_STRUCT_REGISTRATION = 18,
    HADA_STRUCT_SENSOR = 20,
    HADA_STRUCT_SIMULATOR_OPTIONS = 21,
    HADA_STRUCT_EVALUATE_TASK = 22,
    HADA_STRUCT_FIT_TASK = 23,
    HADA_STRUCT_PSF_TASK = 24,
    HADA_STRUCT_OPTICS_TASK = 25,
    HADA_STRUCT_FILES_TASK = 26,
    HADA_STRUCT_REGISTER_TASK = 27,
    HADA_STRUCT_SIMULATE_TASK = 28,
    HADA_STRUCT_TRAIN_TASK = 29,
    HADA_STRUCT_TIFF_WRITE_OPTIONS = 30,
    HADA_STRUCT_AUGMENT = 32,
    HADA_STRUCT_FOCUS_SHARED = 33, /* hada_focus_options for planes that share out the light */
    HADA_STRUCT_LIVE_TASK = 35,
    HADA_STRUCT_TRAIN_OPTIONS = 40 /* and up to 45: with a hada_stage added */
} hada_struct;

/* Sets the first `size` bytes of a struct to its defaults. Call hada_..._init(), which exists for each of these structs
 * and names it and its size; NULL is fine. */
HADA_API void hada_struct_init(hada_struct which, void *options, size_t size);

/* Defines hada_..._init() for a struct. */
#define HADA_INIT(type, which)                                                                                         \
    static inline void type##_init(type *options) /* NOLINT(bugprone-macro-parentheses) */                             \
    {                                                                                                                  \
        hada_struct_init(which, options, sizeof *options);                                                             \
    }

/* The version of the library that runs, such as "0.2.0". Never NULL. */
HADA_API const char *hada_version(void);

/* The names of an enumeration's values, as files and commands have them. */
typedef enum hada_enum {
    HADA_ENUM_DEVICE_KIND = 1,  /* hada_device_kind: "cpu", "gpu", "accelerator", "other" */
    HADA_ENUM_KERNEL_SHAPE = 2, /* hada_kernel_shape: "lanes", "groups" */
    HADA_ENUM_TUNE_BACKEND = 3, /* hada_tune_backend: "own", "clfft" */
    HADA_ENUM_MASK = 4,         /* hada_mask: "mla", "grid", "diffuser", "contour", "aperture" */
    HADA_ENUM_RELIEF = 5,       /* hada_relief_kind: "slant", "half", "hill", "ball", "steps", "bars" */
    HADA_ENUM_OPTICS = 6,       /* hada_optics: "geometry", "wave" */
    HADA_ENUM_BOUNDARY = 7,     /* hada_boundary: "circular", "padded" */
    HADA_ENUM_MOSAIC = 8        /* hada_mosaic: "none", "rggb", "bggr", "grbg", "gbrg" */
} hada_enum;
/* NULL for a value without a name. */
HADA_API const char *hada_enum_name(hada_enum which, int value);
/* The value of a name, -1 for any other text. */
HADA_API int hada_enum_value(hada_enum which, const char *name);

/* Frees a text, an array of rows or a block that the library made, given the address of its pointer, and clears the
 * pointer. NULL is fine, and so is a NULL pointer. */
HADA_API void hada_memory_destroy(void *address_of_pointer);

#ifdef __cplusplus
}
#endif
#endif
