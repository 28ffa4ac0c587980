/* The defaults of every public struct that carries its size. Those that are not here are all zero. */
#include <hadalens/hadalens.h>

#include "core/callers.h"

static const hada_classic_options classic_options = {.size = sizeof(hada_classic_options),
                                                     .iterations = 100,
                                                     .weight = HADA_AUTO,
                                                     .lambda = 0.1,
                                                     .accelerate = 1,
                                                     .step = 1.0,
                                                     .inner = 5,
                                                     .levels = 3,
                                                     .mu1 = 1.0,
                                                     .mu2 = 3e-3,
                                                     .mu3 = 3e-4};
static const hada_communicator communicator = {.size = sizeof(hada_communicator), .count = 1};
static const hada_context_options context_options = {
    .size = sizeof(hada_context_options), .log_level = HADA_LOG_WARNING, .shape = HADA_AUTO};
static const hada_fit_options fit_options = {.size = sizeof(hada_fit_options),
                                             .downsample = 1,
                                             .find_dark = 1,
                                             .find_colours = 1,
                                             .frame_encoding = HADA_AUTO,
                                             .boundary = HADA_BOUNDARY_CIRCULAR,
                                             .form = HADA_FORM_COMPLEX,
                                             .alpha = HADA_AUTO,
                                             .lambda = HADA_AUTO,
                                             .outside = HADA_AUTO,
                                             .refine_steps = HADA_AUTO,
                                             .refine_tv = HADA_AUTO,
                                             .nonnegative = 1,
                                             .scene_response = HADA_AUTO,
                                             .crop_passes = HADA_AUTO,
                                             .refine_colour = HADA_AUTO,
                                             .refine_ridge = HADA_AUTO,
                                             .leave_one_out = 1};
static const hada_focus_options focus_options = {.size = sizeof(hada_focus_options),
                                                 .measure = HADA_FOCUS_CONTRAST,
                                                 .fuse = HADA_FOCUS_WEIGHTED,
                                                 .window_sigma = 2.5,
                                                 .false_alarm = 0.01};
static const hada_focus_options focus_shared = {.size = sizeof(hada_focus_options),
                                                .measure = HADA_FOCUS_COMBINED,
                                                .fuse = HADA_FOCUS_SUM,
                                                .window_sigma = 2.5,
                                                .false_alarm = 0.01};
static const hada_limits limits = {.size = sizeof(hada_limits),
                                   .pixels =
                                       HADA_LIMITS_PIXELS, /* 16 MiB of float; a fit from a PSF takes 18 times that */
                                   .pages = HADA_LIMITS_PAGES,           /* two hours of frames at 30 a second */
                                   .text = HADA_LIMITS_TEXT,             /* OME-XML of some 30,000 planes */
                                   .parameters = HADA_LIMITS_PARAMETERS, /* three times VGG-16's convolutions */
                                   .isolate = HADA_ISOLATE_SOME,
                                   .seconds = HADA_LIMITS_SECONDS}; /* a thousand times what a frame takes */
static const hada_psf_options psf_options = {.size = sizeof(hada_psf_options),
                                             .components = HADA_AUTO,
                                             .explained = 0.99,
                                             .downsample = 1,
                                             .refine_tv = HADA_AUTO,
                                             .form = HADA_FORM_WIENER,
                                             .boundary = HADA_BOUNDARY_PADDED,
                                             .lambda = HADA_AUTO,
                                             .psf_dark = HADA_AUTO,
                                             .psf_gate = HADA_AUTO,
                                             .refine_steps = HADA_AUTO};
static const hada_unet_options unet_options = {.size = sizeof(hada_unet_options),
                                               .channels = 3,
                                               .out_channels = 3,
                                               .down = "16,16|32,32|64,64|128,128|256,256",
                                               .up = "128,128|64,64|32,32|16,16",
                                               .last_kernel = 1};
static const hada_wave_options wave_options = {.size = sizeof(hada_wave_options), .stray = HADA_AUTO};
static const hada_pixels pixels = {.size = sizeof(hada_pixels), .full_scale = HADA_AUTO};
static const hada_preview preview = {.size = sizeof(hada_preview), .gamma = HADA_AUTO};
static const hada_plan_options plan_options = {.size = sizeof(hada_plan_options),
                                               .refine = HADA_AUTO,
                                               .refine_tv = HADA_AUTO,
                                               .refine_colour = HADA_AUTO,
                                               .refine_ridge = HADA_AUTO,
                                               .crosstalk = HADA_AUTO,
                                               .enhance = 1,
                                               .batch = HADA_AUTO,
                                               .queues = HADA_AUTO,
                                               .gamma = 1.0,
                                               .skip = HADA_SKIP_ALL,
                                               .band = 1.0,
                                               .mosaic = HADA_MOSAIC_AUTO,
                                               .downsample = HADA_AUTO};
static const hada_registration registration = {.size = sizeof(hada_registration), .magnification = 1.0};
static const hada_register_task register_task = {.size = sizeof(hada_register_task),
                                                 .least_magnification = HADA_AUTO,
                                                 .most_magnification = HADA_AUTO,
                                                 .most_rotation_deg = 15.0};
/* a cache for some hundred pairs of a small camera */
static const hada_dataset_options dataset_options = {.size = sizeof(hada_dataset_options),
                                                     .mosaic = HADA_MOSAIC_AUTO,
                                                     .cache_bytes = (uint64_t)256 << 20,
                                                     .frame_encoding = HADA_AUTO,
                                                     .downsample = 1};
static const hada_sensor sensor = {.size = sizeof(hada_sensor), .exposure = 1.0, .saturate = 1};
static const hada_evaluate_task evaluate_task = {.size = sizeof(hada_evaluate_task),
                                                 .peak = 1.0,
                                                 .tolerance = 0.5,
                                                 .window_row = HADA_AUTO,
                                                 .window_col = HADA_AUTO,
                                                 .truth_encoding = HADA_AUTO,
                                                 .encoding = HADA_AUTO,
                                                 .gate_pixels = 2.0,
                                                 .gate_depths = 2.5};
static const hada_psf_task psf_task = {.size = sizeof(hada_psf_task), .frame_encoding = HADA_AUTO, .every = 1};
static const hada_fit_task fit_task = {.size = sizeof(hada_fit_task), .save_seconds = 60.0};
static const hada_optics_task optics_task = {.size = sizeof(hada_optics_task), .threshold = HADA_AUTO};
static const hada_files_task files_task = {.size = sizeof(hada_files_task),
                                           .preview = 1,
                                           .bits = 32,
                                           .white = 1.0,
                                           .encoding = HADA_AUTO,
                                           .frame_encoding = HADA_AUTO,
                                           .match = HADA_FILES_MATCH_FIRST,
                                           .track_pixels = 2.0,
                                           .track_depths = 2.5,
                                           .track_gap = 2};
static const hada_live_task live_task = {
    .size = sizeof(hada_live_task), .input = -1, .output = -1, .frame_encoding = HADA_AUTO};
static const hada_simulate_task simulate_task = {.size = sizeof(hada_simulate_task),
                                                 .pairs = 8,
                                                 .test_depths = 2,
                                                 .field_psfs = 5,
                                                 .bits = 32,
                                                 .noise = 0.01,
                                                 .scene_response = HADA_RESPONSE_LINEAR};
static const hada_train_task train_task = {.size = sizeof(hada_train_task),
                                           .hold_out = HADA_AUTO,
                                           .validate_every = HADA_AUTO,
                                           .show_every = HADA_AUTO,
                                           .save_every = HADA_AUTO,
                                           .validate_pairs = 24};
static const hada_tiff_write_options tiff_write_options = {
    .size = sizeof(hada_tiff_write_options), .bits = 32, .scale = 1};
static const hada_augment augment = {.size = sizeof(hada_augment), .plane_flips = HADA_AUTO};

/* What differs from stage to stage: the adversarial one begins with a trained net. */
#define TRAIN(stage_, rate_, steps_, discriminator_steps_, clip_, adversarial_)                                        \
    {                                                                                                                  \
        .size = sizeof(hada_train_options), .stage = (stage_), .seed = 1, .net = "compact", .discriminator = "patch",  \
        .steps = (steps_), .batch = 4, .at_once = HADA_AUTO, .rule = HADA_RULE_ADAM, .rate = (rate_),                  \
        .filter_rate = HADA_AUTO, .discriminator_rate = HADA_AUTO, .schedule = HADA_RATE_COSINE, .last_rate = 0.02,    \
        .warmup = 20, .clip = (clip_), .mse = 1.5, .perceptual = 0.1, .adversarial = (adversarial_),                   \
        .variation = 5e-7, .discriminator_steps = (discriminator_steps_), .compose = HADA_AUTO                         \
    }
static const hada_train_options train_options[] = {
    [HADA_STAGE_FILTERS] = TRAIN(HADA_STAGE_FILTERS, 1e-3, 1000, 0, 0.0, 0.0),
    [HADA_STAGE_ENHANCE] = TRAIN(HADA_STAGE_ENHANCE, 1e-3, 1000, 0, 0.1, 0.0),
    [HADA_STAGE_ADVERSARIAL] = TRAIN(HADA_STAGE_ADVERSARIAL, 2e-4, 300, 60, 0.1, HADA_AUTO),
    [HADA_STAGE_CONVENTIONAL] = TRAIN(HADA_STAGE_CONVENTIONAL, 1e-3, 1000, 0, 0.1, 0.0)};

static const struct {
    const void *values;
    size_t size;
} defaults[] = {
    [HADA_STRUCT_CLASSIC_OPTIONS] = {&classic_options, sizeof classic_options},
    [HADA_STRUCT_COMMUNICATOR] = {&communicator, sizeof communicator},
    [HADA_STRUCT_CONTEXT_OPTIONS] = {&context_options, sizeof context_options},
    [HADA_STRUCT_FIT_OPTIONS] = {&fit_options, sizeof fit_options},
    [HADA_STRUCT_FOCUS_OPTIONS] = {&focus_options, sizeof focus_options},
    [HADA_STRUCT_LIMITS] = {&limits, sizeof limits},
    [HADA_STRUCT_PSF_OPTIONS] = {&psf_options, sizeof psf_options},
    [HADA_STRUCT_UNET_OPTIONS] = {&unet_options, sizeof unet_options},
    [HADA_STRUCT_WAVE_OPTIONS] = {&wave_options, sizeof wave_options},
    [HADA_STRUCT_PIXELS] = {&pixels, sizeof pixels},
    [HADA_STRUCT_PREVIEW] = {&preview, sizeof preview},
    [HADA_STRUCT_PLAN_OPTIONS] = {&plan_options, sizeof plan_options},
    [HADA_STRUCT_REGISTRATION] = {&registration, sizeof registration},
    [HADA_STRUCT_REGISTER_TASK] = {&register_task, sizeof register_task},
    [HADA_STRUCT_DATASET_OPTIONS] = {&dataset_options, sizeof dataset_options},
    [HADA_STRUCT_SENSOR] = {&sensor, sizeof sensor},
    [HADA_STRUCT_EVALUATE_TASK] = {&evaluate_task, sizeof evaluate_task},
    [HADA_STRUCT_PSF_TASK] = {&psf_task, sizeof psf_task},
    [HADA_STRUCT_FIT_TASK] = {&fit_task, sizeof fit_task},
    [HADA_STRUCT_OPTICS_TASK] = {&optics_task, sizeof optics_task},
    [HADA_STRUCT_FILES_TASK] = {&files_task, sizeof files_task},
    [HADA_STRUCT_LIVE_TASK] = {&live_task, sizeof live_task},
    [HADA_STRUCT_SIMULATE_TASK] = {&simulate_task, sizeof simulate_task},
    [HADA_STRUCT_TRAIN_TASK] = {&train_task, sizeof train_task},
    [HADA_STRUCT_TIFF_WRITE_OPTIONS] = {&tiff_write_options, sizeof tiff_write_options},
    [HADA_STRUCT_AUGMENT] = {&augment, sizeof augment},
    [HADA_STRUCT_FOCUS_SHARED] = {&focus_shared, sizeof focus_shared},
    [(int)HADA_STRUCT_TRAIN_OPTIONS + (int) HADA_STAGE_FILTERS] = {&train_options[HADA_STAGE_FILTERS],
                                                                   sizeof *train_options},
    [(int)HADA_STRUCT_TRAIN_OPTIONS + (int) HADA_STAGE_ENHANCE] = {&train_options[HADA_STAGE_ENHANCE],
                                                                   sizeof *train_options},
    [(int)HADA_STRUCT_TRAIN_OPTIONS + (int) HADA_STAGE_ADVERSARIAL] = {&train_options[HADA_STAGE_ADVERSARIAL],
                                                                       sizeof *train_options},
    [(int)HADA_STRUCT_TRAIN_OPTIONS + (int) HADA_STAGE_CONVENTIONAL] = {&train_options[HADA_STAGE_CONVENTIONAL],
                                                                        sizeof *train_options},
};

void hada_sized_give(void *callers, size_t size, const void *own, size_t own_size)
{
    const size_t known = size < own_size ? size : own_size;
    if (known < sizeof size)
        return;
    memcpy(callers, own, known);
    memset((unsigned char *)callers + known, 0, size - known);
    memcpy(callers, &size, sizeof size);
}

void hada_struct_init(hada_struct which, void *options, size_t size)
{
    const int known = (int)which >= 0 && (size_t)which < sizeof defaults / sizeof *defaults && defaults[which].values;
    if (options)
        hada_sized_give(options, size, known ? defaults[which].values : &size,
                        known ? defaults[which].size : sizeof size);
}
