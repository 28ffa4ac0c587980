/* What the files of an evaluation share: the region that counts, pages, maps, comparisons. Internal. */
#ifndef HADA_TASKS_EVALUATE_H
#define HADA_TASKS_EVALUATE_H

#include <hadalens/image.h>
#include <hadalens/task_evaluate.h>
#include <hadalens/tiff.h>

typedef struct hada_region {
    int rows, cols;  /* of the window; 0: the whole image */
    int row, col;    /* its top left; negative: the window stands at the centre */
    hada_image mask; /* of the whole image; empty: none */
} hada_region;

/* Reads the mask. */
hada_status hada_region_read(hada_region *region, const hada_evaluate_task *task, hada_error *err);
void hada_region_free(hada_region *region);

/* The pages of a result and of its truth: which belong together, and what of them counts. Internal. */

typedef struct hada_compared {
    const char *result_path, *truth_path;
    const hada_monitor *monitor;
    hada_tiff_reader *result, *truth;
    int count;
    int *page; /* of the result, for each page of the truth; -1: none */
    int times; /* as many rows and columns has the truth, which is binned: the result is of binned frames */
    double result_encoding, truth_encoding, encoding; /* of the files, and in which they are compared; 0: not known, as
                                                         they are */
} hada_compared;

hada_status hada_compared_open(hada_compared *open, const char *result, const char *truth, hada_error *err);
/* How values stand for light; truth, both: as in hada_evaluate_task. */
hada_status hada_compared_encode(hada_compared *open, double truth, double both, hada_error *err);
void hada_compared_close(hada_compared *open);

/* A page of the truth, what belongs to it, and which pixels count. */
typedef struct hada_compared_page {
    hada_image result, truth; /* result: empty where there is none */
    unsigned char *mask;      /* NULL: all */
} hada_compared_page;

/* Page t of the truth, cut to the region. map: its values are distances, of which a bin takes the middle one. */
hada_status hada_compared_read(hada_compared_page *one, const hada_compared *open, int t, int map,
                               const hada_region *region, hada_error *err);

void hada_compared_page_free(hada_compared_page *one);

/* Whether a value of an image counts. */
int hada_compared_counts(const hada_compared_page *one, size_t i);

/* The length of a path without the ending of its file, and whether that much of it ends so. */
size_t hada_stem_of(const char *path);
int hada_stem_ends(const char *path, size_t length, const char *end);

/* Distance maps against the truth, and where on it images are hard. Internal. */

/* Fills in all that an evaluation of a map has. */
hada_status hada_evaluate_maps(hada_evaluation *score, const hada_compared *open, const hada_evaluate_task *by,
                               const hada_region *region, hada_error *err);

/* Parts (hada_depth_part) of the pixels of page t of an all-in-focus image whose truth has a NAME_depth.tif beside it,
 * cut to the region; freed with free(). NULL where there is none of its size, or the depth steps are not known. */
hada_status hada_evaluate_parts_beside(unsigned char **parts, const hada_compared *open, int t,
                                       const hada_compared_page *one, const hada_evaluate_task *by,
                                       const hada_region *region, hada_error *err);

/* Tables of emitters: fills in all that an evaluation of them has. Internal. */
hada_status hada_evaluate_emitters(hada_evaluation *one, const hada_evaluate_task *by, hada_error *err);

#endif
