/* Hadalens: from a raw frame to a refocused stack, an all-in-focus image and a distance map.
 *
 * plan = model x device: knows its bytes before it allocates. run = one frame; hadalens/job.h has many in flight, on
 * several queues and devices. Frames may be run from any threads, but a plan is destroyed by one, when nobody waits in
 * hada_plan_run(); several plans may share a context and a model. A plan keeps what it needs of a model, which may be
 * destroyed; contexts must outlive their plans. Same input, device and build give the same bits. */
#ifndef HADALENS_RECONSTRUCT_H
#define HADALENS_RECONSTRUCT_H

#include <hadalens/classic.h>
#include <hadalens/device.h>
#include <hadalens/image.h>
#include <hadalens/model.h>
#include <hadalens/pixels.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Which depths a scene occupies. */
typedef enum hada_occupied {
    HADA_OCCUPIED_AUTO = 0, /* found by depth pursuit */
    HADA_OCCUPIED_ALL = 1,
    HADA_OCCUPIED_LIST = 2
} hada_occupied;

/* What a scene is taken for. */
typedef enum hada_scene {
    HADA_SCENE_AUTO = 0,   /* what explains the frame with the fewest unknowns */
    HADA_SCENE_PLANES = 1, /* objects at some of the depths */
    HADA_SCENE_SURFACE =
        2, /* one texture on one continuous surface, anywhere between the depths (docs/explanation/surfaces.md) */
    HADA_SCENE_VOLUME = 3 /* light at all depths, found by Richardson-Lucy (docs/explanation/surfaces.md#volumes) */
} hada_scene;

/* What is taken off a frame. */
typedef enum hada_dark {
    HADA_DARK_MODEL = 0, /* what the model says */
    HADA_DARK_NONE = 1,
    HADA_DARK_AUTO = 2,  /* each frame's and channel's own level, estimated */
    HADA_DARK_LEVEL = 3, /* dark_level */
    HADA_DARK_FRAME = 4  /* dark_frame, and no level */
} hada_dark;

/* Work that a scene does not need. Each kind has a switch; docs/explanation/speed-and-accuracy.md says what each saves
 * and why its error is what is said here. "Bounded" kinds act only under a max_error above 0. */
typedef enum hada_skip {
    HADA_SKIP_PRUNE = 1, /* rows and columns of the inverse transforms outside the window; exact but for rounding, since
                            a row shares its transform with another one than before */
    HADA_SKIP_DEPTHS = 2, /* the occupied depths are found on a small part of the spectrum instead of all of it, and
                             only their planes are computed; exact as long as both looks decide the same */
    HADA_SKIP_FREQUENCIES = 4, /* frequencies whose filtered light is negligible; bounded (Parseval) */
    HADA_SKIP_HALF = 8,        /* half of the filters' bits; bounded */
    HADA_SKIP_CHANNELS = 16,   /* channels that are black, or equal to one that was done (grey scenes); exact */
    HADA_SKIP_FRAMES = 32,     /* frames equal to the one before; exact */
    HADA_SKIP_TILES = 64,      /* tiles of the enhancement net without content, or unchanged; exact */
    HADA_SKIP_ALL = 127
} hada_skip;

/* The weight of total variation is found from each frame: the one with which the other pixels predict 5 % of them best
 * (docs/explanation/refinement.md). Models of point spread functions alone do so by themselves. */
#define HADA_REFINE_TV_FRAME (-2)

typedef struct hada_plan_options {
    size_t size;       /* sizeof(hada_plan_options) */
    const int *depths; /* indices of the depths to compute, ascending; NULL: all */
    int depth_count;
    hada_occupied occupied;   /* HADA_OCCUPIED_AUTO by default: with a list, HADA_OCCUPIED_LIST */
    const int *occupied_list; /* indices of depths, ascending */
    int occupied_count;
    int refine;        /* steps; HADA_AUTO (default): the model's, and more until several depths have parted; 0: linear
                        * filters alone */
    double refine_tv;  /* weight of total variation in refinement; HADA_AUTO (default): the model's, or where it knows
                        * none found from a frame, and kept for those that are run after it until the noise of one
                        * differs by more than a tenth, or its light by a twentieth; 0: none; HADA_REFINE_TV_FRAME: found
                        * from each frame */
    hada_dark dark;    /* HADA_DARK_MODEL by default: with a level or a frame below, HADA_DARK_LEVEL or HADA_DARK_FRAME.
                        * Other kinds are refused beside them */
    double dark_level; /* in units of full scale, 0 or more; HADA_AUTO: HADA_DARK_AUTO */
    const hada_image *dark_frame; /* of the frame's size, with its channels or one for all; copied */
    int repair_not_finite;        /* 1: NaN and infinite pixels take the median of their neighbours, with a count in the
                                     report; 0 (default): such a frame is refused */
    int half;                     /* 1: filters on the device in half precision */
    int enhance;                  /* 1 (default): planes go through the model's net, where it has one; 0: not */
    int batch;                    /* depths at once; HADA_AUTO (default) or 0: chosen from the memory */
    double gamma;                 /* exponent on the finished images, at most 100; 1 (default): linear */
    int queues;                   /* frames or batches in flight on each device, each on a queue of its own with its
                                     own memory; HADA_AUTO (default) or 0: 1 */
    unsigned skip;                /* HADA_SKIP_... that may be used; HADA_SKIP_ALL by default, 0: none (a dense run) */
    double max_error; /* the largest relative L2 change of the stack (before gamma) against the dense run, below 1;
                         0 (default): only what is exact */
    double band;      /* linear filters: frequencies beyond this share of the sensor's Nyquist limits, in rows and in
                         columns, are left out, whatever max_error; 1 (default): none. The planes keep their size */
    const hada_classic_options *classic; /* another method in place of the model's filters and refinement; the depths
                                            are all that are computed, or those of the list, and no net follows; NULL
                                            (default): none. Copied */
    hada_scene scene; /* HADA_SCENE_AUTO by default. A surface needs three depths, their transfer functions, refinement
                         and HADA_OCCUPIED_AUTO. HADA_SCENE_VOLUME only needs transfer functions, and no other method in
                         `classic`. Surfaces, and volumes that HADA_SCENE_AUTO finds, take their memory on the device
                         when a frame first needs it, beyond a plan's estimate. Without enough memory, HADA_SCENE_AUTO
                         takes frames for planes, and with HADA_SCENE_SURFACE they fail */
    double refine_colour; /* in total variation, weight of differences of colour over those of brightness, 1 to 16;
                             HADA_AUTO (default): the model's */
    double refine_ridge;  /* with total variation: strength of the learned regulariser in the last steps, 0 to 100;
                             HADA_AUTO (default): the model's; 0: none */
    double crosstalk; /* where a refined plane is dark beside another one, its light goes to the brightest: the share of
                         that one's light at which a plane keeps half, at most 1; HADA_AUTO (default): 0.12; 0: planes
                         stay as refined. Their sum does either way (docs/explanation/refinement.md) */
    const hada_image *pixel_weights; /* how much each of the frame's values counts in refinement and in classic methods
                                        that iterate, 0 (not at all: bad
                                        pixels, dust) or more, in units of the largest; of the frame's size, with its
                                        channels or one for all; NULL (default): all alike. Copied */
    hada_mosaic mosaic;   /* frames of one channel are a colour filter mosaic of this pattern, whose planes have three
                             channels: refinement compares each pixel with the colour that it holds, and what needs all
                             colours of a pixel takes means of its neighbours. Then dark_frame and pixel_weights have one
                             channel, or three whose values at such pixels count. HADA_MOSAIC_AUTO (default): what the
                             model says */
    hada_support support; /* of refinement with the padded boundary: where light may come from. HADA_SUPPORT_AUTO
                             (default): the grid where the window is the whole frame, the model was made from point
                             spread functions and the scene cannot be a surface; else the window. With
                             HADA_SUPPORT_GRID the scene is never a surface. Results are of the window in any case */
    const hada_image *flat_frame; /* an evenly lit sensor, its dark level taken off, of the frame's size, with its
                                     channels or one for all: frames are divided by it above their dark level. Pixels
                                     that are not finite, or see less than a twentieth of the mean, count as if their
                                     weight were 0. NULL (default): the model's, where it has one. Copied */
    int downsample; /* frames of so many times the model's rows and columns are binned (hada_image_downsample()); then
                       `mosaic` is that of the sensor, and dark_frame, flat_frame and pixel_weights may have the
                       sensor's size as well. HADA_AUTO (default): as the model says; 1: none are */
    int warm_start; /* 1: frames are a sequence, in the order in which they are submitted: each one's refinement goes on
                       from the one before, unless too much changed, which takes fewer steps. One queue of the first
                       device does it. 0 (default): no frame's planes depend on others */
} hada_plan_options;
HADA_INIT(hada_plan_options, HADA_STRUCT_PLAN_OPTIONS)

typedef struct hada_plan hada_plan;
/* A plan on one or more devices, a context each (a context named twice is an error). */
HADA_API hada_status hada_plan_create_on(hada_plan **out, hada_context *const *contexts, int count,
                                         const hada_model *model, const hada_plan_options *options, hada_error *err);
/* On one device. */
static inline hada_status hada_plan_create(hada_plan **out, hada_context *context, const hada_model *model,
                                           const hada_plan_options *options, hada_error *err)
{
    return hada_plan_create_on(out, &context, 1, model, options, err);
}
HADA_API void hada_plan_destroy(hada_plan **plan);

/* Device bytes that a plan on one device needs, the most at any time, and host bytes that a run adds; no device memory
 * is needed to say it. Surfaces are not in it: what they take goes by optics that are measured when a frame first may
 * be one. It is planned before it is taken, for all queues, within three quarters of the device's memory; where it does
 * not fit, planes have to do, or with HADA_SCENE_SURFACE the frame fails with HADA_ERROR_DEVICE_MEMORY. */
HADA_API hada_status hada_plan_estimate(hada_context *context, const hada_model *model,
                                        const hada_plan_options *options, uint64_t *device_bytes, uint64_t *host_bytes,
                                        hada_error *err);

/* Device bytes that a plan holds on all its devices and queues, and that it would hold if buffers which are never
 * needed at the same time did not share room (docs/explanation/architecture.md), with the surfaces that frames made it
 * take so far. Either may be NULL. */
HADA_API void hada_plan_memory(const hada_plan *plan, uint64_t *held, uint64_t *apart);

/* What was not computed, and what that may have changed. The library's own: later versions may append to it. */
typedef struct hada_skip_report {
    unsigned kinds;       /* HADA_SKIP_... that saved something in this frame */
    double bound;         /* of the relative L2 change of the stack, by a chosen band as well; 0: none */
    int depths, channels; /* not computed */
    int frame;            /* 1: the result is that of the frame before */
    double frequencies;   /* share of the spectrum that was not used, 0 to 1 */
    double tiles;         /* share of the tiles of the enhancement net that was not computed */
    int recomputed;       /* 1: a bound did not hold when the result was known; the frame was done again in full */
} hada_skip_report;

/* What happened, with the seconds of each stage: on a device with memory of its own, stages run into each other, and
 * these are the host's; what each takes of the device, hadalens/profile.h says. The library's own: later versions may
 * append to it. */
typedef struct hada_report {
    int occupied_count;
    const unsigned char *occupied; /* per computed depth */
    hada_method method;
    int refine_steps;       /* refinement steps, or iterations of a classic method, that were done */
    double residual_linear; /* |frame - what the linear result explains| / |frame|; NaN where not computed */
    double residual;        /* after refinement */
    double dark;            /* level taken off */
    size_t repaired_pixels;
    const hada_skip_report *skipped;
    int enhanced; /* planes that went through the model's net */
    double seconds_total, seconds_upload, seconds_linear, seconds_pursuit, seconds_refine, seconds_enhance,
        seconds_focus, seconds_download;
    hada_scene scene;        /* what the frame was taken for: planes, a surface or a volume */
    size_t saturated_pixels; /* values at the frame's upper end, taken for "at least this" */
    double refine_tv;        /* weight of total variation in refinement, or in a classic method; 0: none */
    double refine_tv_factor; /* where it was found from the frame: so many times more or less predicts held-out pixels
                                1 % worse; 0: not known */
    int refine_tv_kept; /* 1: it was found from an earlier frame of the plan, and noise and light are still the same */
    int warm_started;   /* 1: refinement went on from the frame before */
    double gain;        /* then: the scene is so many times as bright as before; 1: no change was followed; else 0 */
    double stray_light; /* light of a lamp, or through a gap in the housing: the mean of the smooth surface that was
                           taken off; 0: none */
    size_t bad_pixels;  /* values far beyond those around them, which were left out */
} hada_report;

/* What comes of a frame. Begin with an empty one, hada_result result = {0}; its members are the result's until it is
 * destroyed or filled again. This struct stays as it is: what later versions add is read by functions. */
typedef struct hada_result {
    int depths;                 /* computed */
    const double *distances_mm; /* per computed depth */
    hada_image *planes;         /* one for each computed depth, channels x window; negative light is set to 0. They
                                   share an array: planes[0].data is the stack, [depth][channel][row][col] */
    hada_image all_in_focus;    /* channels x window */
    hada_image distance_map;    /* 1 x window, millimetres, NaN where nothing is in focus or light is noise */
    const hada_report *report;  /* NULL while the result is empty */
    struct hada_result_memory *memory; /* the library's */
} hada_result;

/* Reconstructs one frame (the model's channels and raw size). The result is the caller's: hada_result_destroy. A result
 * used again for the next frame keeps its memory; after a failure in the work itself it is empty. */
HADA_API hada_status hada_plan_run(hada_plan *plan, const hada_image *raw, hada_result *result, hada_error *err);
/* As hada_plan_run(), of pixels in any form: the same bits as of the image that they are. */
HADA_API hada_status hada_plan_run_pixels(hada_plan *plan, const hada_pixels *raw, hada_result *result,
                                          hada_error *err);
HADA_API void hada_result_destroy(hada_result *result);

/* How sure the distance map is, 1 x window, 0 to 1: 1 / (1 + (s / 0.5)^2) where the distance has a standard deviation
 * of s depths of the camera, by the texture that stands there; a distance without texture is interpolated from its
 * surroundings. The result's, like its members. NULL where the frame was not taken for a surface. */
HADA_API const hada_image *hada_result_confidence(const hada_result *result);

/* Arrays of the caller's that a result is written into, instead of memory of the library's: dense float32, in the order
 * [depth][channel][row][col], [channel][row][col] and [row][col]. NULL (default): the library's own. */
typedef struct hada_result_arrays {
    size_t size; /* sizeof(hada_result_arrays) */
    float *stack;
    size_t stack_count; /* values that the array holds: depths x channels x window, exactly */
    float *all_in_focus;
    size_t all_in_focus_count;
    float *distance_map;
    size_t distance_map_count;
} hada_result_arrays;
HADA_INIT(hada_result_arrays, HADA_STRUCT_RESULT_ARRAYS)

/* From now on, until hada_result_destroy(), this result is written into these arrays, which must live as long. The
 * result loses what it held. A run whose results have other sizes fails with HADA_ERROR_SIZE; after a failure the
 * contents of the arrays are undefined. They must not overlap each other or the frame (HADA_ERROR_ARGUMENT). */
HADA_API hada_status hada_result_use(hada_result *result, const hada_result_arrays *arrays, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
