/* Hadalens: pairs of a raw frame and its known scene, at several distances. A fit, a training, a registration and a
 * survey all read pairs from a data set.
 *
 * A data set is a folder (hada_dataset_scan), images in memory (hada_dataset_from_images), or a function that reads a
 * pair (hada_dataset_create). A folder has one folder per depth, named z<distance>mm, each with raw/NAME.tif (the
 * frame) and scene/NAME.tif (the scene) of the same names; psf.tif (a page per depth) and camera.json may be beside
 * them. A pair is identified by the index of its depth and its index within the depth.
 *
 * Pairs that are read several times are kept in memory up to options.cache_bytes; the parts of a data set share its
 * cache. While one pair is used, a thread reads the next one.
 *
 * Threads: any number of threads may use a data set. */
#ifndef HADALENS_DATASET_H
#define HADALENS_DATASET_H

#include <hadalens/image.h>
#include <hadalens/status.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_dataset hada_dataset;

typedef struct hada_dataset_options {
    size_t size;          /* sizeof(hada_dataset_options) */
    uint64_t cache_bytes; /* of host memory for pairs that were read; 256 MiB by default, 0: none are kept */
    int skip_incomplete;  /* of a folder: 1: files without their partner are left out; 0 (default): they are an error */
    double frame_encoding; /* how the values of raw frames in files stand for light (hadalens/response.h), which is made
                              linear; HADA_AUTO (default): as their files say (JPEG: sRGB), linear where they say
                              nothing */
    hada_mosaic mosaic;    /* the raw frames have one channel, a colour filter mosaic of this pattern, and are given out
                              with three: colours that a pixel does not hold are means of its neighbours.
                              HADA_MOSAIC_NONE: frames are given out as they are. HADA_MOSAIC_AUTO (default): what the
                              file of a folder's first frame states (DNG), where its scene is in colour, else none */
    const hada_image *flat_frame; /* an evenly lit sensor, its dark level taken off, of the raw frames' size, with their
                                     channels or one for all; or hada_model_info's flat. Raw frames are divided by it,
                                     above the dark level `flat_dark`; pixels that see less than a twentieth of the mean
                                     are filled from their neighbours. NULL (default): none. Copied */
    double flat_dark;             /* 0 by default; HADA_AUTO: each frame's and channel's own */
    int downsample; /* raw frames and scenes are binned by it (hada_image_downsample()), raw frames of a mosaic by
                       colour; scenes in their own encoding. The flat and dark frame may have either size. 1 (default):
                       they are not */
    const hada_image *dark_frame; /* what the raw frames hold without the scenes' light, as `flat_frame`, a mosaic of
                                     one channel, or hada_model_info's. Subtracted before anything else. NULL (default):
                                     none. Copied */
} hada_dataset_options;
HADA_INIT(hada_dataset_options, HADA_STRUCT_DATASET_OPTIONS)

/* The files of a pair; of other data sets, the names that they would have, for messages. */
typedef struct hada_pair_files {
    const char *raw, *scene;
} hada_pair_files;

/* Owned by the data set. */
typedef struct hada_dataset_info {
    int depths;
    const double *distances_mm;          /* ascending */
    const int *counts;                   /* pairs of each depth */
    int pairs, least_pairs;              /* of all depths; of the depth with the fewest */
    int has_files;                       /* 1: its pairs are files */
    const char *const *folders;          /* of each depth */
    const hada_pair_files *const *files; /* files[depth][pair], sorted by the raw frames' names */
    const char *psf, *camera;            /* paths of psf.tif and camera.json, NULL where they are missing */
    int incomplete;                      /* number of files that were left out */
    const char *incomplete_text;         /* names the first of them; "" where there is none */
    hada_mosaic mosaic;                  /* that the raw frames are; HADA_MOSAIC_NONE: they are not filled in */
    const hada_image *flat;       /* by which they are divided, 1 in the mean (hada_model_info); NULL: they are not */
    int downsample;               /* by which they and the scenes are binned; 1: they are not */
    hada_mosaic sensor_mosaic;    /* of raw frames that are binned */
    const hada_image *dark_frame; /* that is subtracted, of all channels; NULL: none */
} hada_dataset_info;
HADA_API const hada_dataset_info *hada_dataset_get_info(const hada_dataset *dataset);

/* Reads names, no pictures. `options` may be NULL. HADA_ERROR_DATASET for a folder without depths, a depth without a
 * pair, two folders of one distance, and (see options) files without their partner. */
HADA_API hada_status hada_dataset_scan(hada_dataset **out, const char *folder, const hada_dataset_options *options,
                                       hada_error *err);

/* Reads a pair: fills two empty images by hada_image_create(), raw frame and scene. It may be called from several
 * threads, but never by two at a time. */
typedef hada_status (*hada_dataset_read_pair)(void *user, int depth, int pair, hada_image *raw, hada_image *scene,
                                              hada_error *err);

/* A data set whose pairs a function of the caller's reads. distances_mm: ascending; counts: pairs of each depth, 0 or
 * more; both are copied. `user` must last as long as the data set and its parts. `options` may be NULL. */
HADA_API hada_status hada_dataset_create(hada_dataset **out, int depths, const double *distances_mm, const int *counts,
                                         hada_dataset_read_pair read, void *user, const hada_dataset_options *options,
                                         hada_error *err);

/* A data set of images in memory, the pairs of one depth after those of another. The images are not copied: their
 * pixels must stay as they are as long as the data set and its parts last. */
HADA_API hada_status hada_dataset_from_images(hada_dataset **out, int depths, const double *distances_mm,
                                              const int *counts, const hada_image *raws, const hada_image *scenes,
                                              hada_error *err);
HADA_API void hada_dataset_destroy(hada_dataset **dataset);

/* Copies of both images of a pair, created by the call (channels x rows x cols as their files have them). */
HADA_API hada_status hada_dataset_read(const hada_dataset *dataset, int depth, int pair, hada_image *raw,
                                       hada_image *scene, hada_error *err);

/* Two parts of a data set: the last pairs of each depth are held out, `hold_out` of them (1 or more, a whole number) or
 * that share (below 1; at least one where there are three and the share is above 0). A depth may have no pair held out,
 * but must keep one to learn from (HADA_ERROR_DATASET). The parts may outlive the data set. */
HADA_API hada_status hada_dataset_split(const hada_dataset *dataset, double hold_out, hada_dataset **learn,
                                        hada_dataset **held_out, hada_error *err);

/* The mean over the pages of a file: a dark frame. *image is created by the call; *level (may be NULL) is its mean over
 * all pixels and channels. */
HADA_API hada_status hada_dark_frame_load(hada_image *image, double *level, const char *path, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
