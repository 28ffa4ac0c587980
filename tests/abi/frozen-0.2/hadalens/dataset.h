/* Hadalens: data sets as people keep them: a folder per depth named z<distance>mm, each with raw/NAME.tif (the frame)
 * and scene/NAME.tif (what was shown) of the same names; psf.tif (a page per depth) and camera.json beside them where
 * they are known.
 *
 * Threads: a data set does not change once it was scanned; any number of threads may read it. */
#ifndef HADALENS_DATASET_H
#define HADALENS_DATASET_H

#include <hadalens/image.h>
#include <hadalens/status.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_dataset hada_dataset;

typedef struct hada_dataset_options {
    size_t size;         /* sizeof(hada_dataset_options) */
    int skip_incomplete; /* 1: files without their partner are left out; 0 (default): they are an error */
} hada_dataset_options;
HADA_INIT(hada_dataset_options, HADA_STRUCT_DATASET_OPTIONS)

/* Owned by the data set. */
typedef struct hada_dataset_info {
    int depths;
    const double *distances_mm;  /* near to far, no two equal */
    const int *counts;           /* pairs of each depth */
    int pairs, least_pairs;      /* of all depths; of the depth with the fewest */
    int incomplete;              /* files that were left out */
    const char *incomplete_text; /* the first of them, in words; "" where there is none */
    const char *psf, *camera;    /* paths of psf.tif and camera.json, NULL where they are missing */
} hada_dataset_info;

/* Reads names, no pictures. `options` may be NULL. HADA_ERROR_DATASET for a folder without depths, a depth without a
 * pair, two folders of one distance, and (see options) files without their partner. */
HADA_API hada_status hada_dataset_scan(hada_dataset **out, const char *folder, const hada_dataset_options *options,
                                       hada_error *err);

/* How a pair of a data set without files is read: fills two empty images by hada_image_create(), raw frame and scene.
 * May be called from several threads, one at a time. */
typedef hada_status (*hada_dataset_read_pair)(void *user, int depth, int pair, hada_image *raw, hada_image *scene,
                                              hada_error *err);

/* A data set whose pairs come from the caller: as a folder's for all that takes data sets, but hada_register_write().
 * distances_mm: near to far, no two equal; counts: pairs of each depth, 1 or more; both are copied. `user` must be
 * usable as long as the data set and those that are split from it. Names of pairs (hada_dataset_raw_path()) are those
 * that files would have. */
HADA_API hada_status hada_dataset_create(hada_dataset **out, int depths, const double *distances_mm, const int *counts,
                                         hada_dataset_read_pair read, void *user, hada_error *err);
HADA_API void hada_dataset_destroy(hada_dataset **dataset);
HADA_API const hada_dataset_info *hada_dataset_get_info(const hada_dataset *dataset);

/* The folder of a depth; the files of a pair, 0 <= pair < counts[depth], sorted by name. Owned by the data set. */
HADA_API const char *hada_dataset_folder(const hada_dataset *dataset, int depth);
HADA_API const char *hada_dataset_raw_path(const hada_dataset *dataset, int depth, int pair);
HADA_API const char *hada_dataset_scene_path(const hada_dataset *dataset, int depth, int pair);

/* Reads both images of a pair, created by the call (channels x rows x cols as their files have them). */
HADA_API hada_status hada_dataset_read(const hada_dataset *dataset, int depth, int pair, hada_image *raw,
                                       hada_image *scene, hada_error *err);

/* Two data sets of one: the last pairs of each depth are held out, `hold_out` of them (1 or more, a whole number) or
 * that share (below 1; at least one where there are three and the share is above 0). A depth may have no pair held out,
 * but must keep one to learn from (HADA_ERROR_DATASET). */
HADA_API hada_status hada_dataset_split(const hada_dataset *dataset, double hold_out, hada_dataset **learn,
                                        hada_dataset **held_out, hada_error *err);

/* The mean over the pages of a file: what a dark frame is taken from. *image is created by the call; *level (may be
 * NULL) is its mean over all pixels and channels. */
HADA_API hada_status hada_dark_frame_load(hada_image *image, double *level, const char *path, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
