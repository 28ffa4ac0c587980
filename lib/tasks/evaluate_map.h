/* Distance maps against the truth, and where on it images are hard. Internal. */
#ifndef HADA_TASKS_EVALUATE_MAP_H
#define HADA_TASKS_EVALUATE_MAP_H

#include "tasks/evaluate_pages.h"

/* Fills in all that an evaluation of a map has. */
hada_status hada_evaluate_maps(hada_evaluation *score, const hada_compared *open, const hada_evaluate_task *by,
                               const hada_region *region, hada_error *err);

/* Parts (hada_depth_part) of the pixels of page t of an all-in-focus image whose truth has a NAME_depth.tif beside it,
 * cut to the region; freed with free(). NULL where there is none of its size, or the depth steps are not known. */
hada_status hada_evaluate_parts_beside(unsigned char **parts, const hada_compared *open, int t,
                                       const hada_compared_page *one, const hada_evaluate_task *by,
                                       const hada_region *region, hada_error *err);

#endif
