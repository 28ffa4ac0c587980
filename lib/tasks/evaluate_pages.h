/* The pages of a result and of its truth: which belong together, and what of them counts. Internal. */
#ifndef HADA_TASKS_EVALUATE_PAGES_H
#define HADA_TASKS_EVALUATE_PAGES_H

#include <hadalens/tiff.h>

#include "tasks/evaluate_region.h"

typedef struct hada_compared {
    const char *result_path, *truth_path;
    hada_tiff_reader *result, *truth;
    int count;
    int *page;                                        /* of the result, for each page of the truth; -1: none */
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

/* Page t of the truth, cut to the region. */
hada_status hada_compared_read(hada_compared_page *one, const hada_compared *open, int t, const hada_region *region,
                               hada_error *err);
void hada_compared_page_free(hada_compared_page *one);

/* Whether a value of an image counts. */
int hada_compared_counts(const hada_compared_page *one, size_t i);

/* The length of a path without the ending of its file, and whether that much of it ends so. */
size_t hada_stem_of(const char *path);
int hada_stem_ends(const char *path, size_t length, const char *end);

#endif
