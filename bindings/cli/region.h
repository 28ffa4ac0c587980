/* The part of an image that counts: a window, a mask, or both. */
#ifndef HADA_CLI_REGION_H
#define HADA_CLI_REGION_H

#include "cli.h"

#include <hadalens/image.h>

typedef struct hada_cli_region {
    int rows, cols;  /* of the window; 0: the whole image */
    int row, col;    /* its top left; -1: the window stands at the centre */
    hada_image mask; /* of the whole image; empty: none */
} hada_cli_region;

/* "HxW" or "HxW+ROW+COL", and the path of a mask image: pixels that are not 0 in some channel count. NULL: none. */
hada_status hada_cli_region_read(hada_cli_region *region, const char *window, const char *mask, hada_error *err);
void hada_cli_region_free(hada_cli_region *region);

/* Cuts an image to the window, in place. */
hada_status hada_cli_region_cut(const hada_cli_region *region, hada_image *image, hada_error *err);

/* The mask for an image of this size, cut to the window as well: a value per pixel, freed with free(); NULL where there
 * is no mask. */
hada_status hada_cli_region_mask(const hada_cli_region *region, int rows, int cols, unsigned char **mask,
                                 hada_error *err);

#endif
