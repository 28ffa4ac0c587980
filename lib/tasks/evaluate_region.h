/* The part of an image that counts in an evaluation: a window, a mask, or both. Internal. */
#ifndef HADA_TASKS_EVALUATE_REGION_H
#define HADA_TASKS_EVALUATE_REGION_H

#include <hadalens/image.h>
#include <hadalens/task_evaluate.h>

#include "core/error.h"

typedef struct hada_region {
    int rows, cols;  /* of the window; 0: the whole image */
    int row, col;    /* its top left; negative: the window stands at the centre */
    hada_image mask; /* of the whole image; empty: none */
} hada_region;

/* Reads the mask. */
hada_status hada_region_read(hada_region *region, const hada_evaluate_task *task, hada_error *err);
void hada_region_free(hada_region *region);

/* Cuts an image to the window, in place. */
hada_status hada_region_cut(const hada_region *region, hada_image *image, hada_error *err);

/* The mask for an image of this size, cut to the window as well: a value per pixel, freed with free(); NULL where there
 * is no mask. */
hada_status hada_region_mask(const hada_region *region, int rows, int cols, unsigned char **mask, hada_error *err);

#endif
