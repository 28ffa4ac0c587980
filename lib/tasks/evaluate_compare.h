/* Comparing a result file with its truth. Internal. */
#ifndef HADA_TASKS_EVALUATE_COMPARE_H
#define HADA_TASKS_EVALUATE_COMPARE_H

#include "tasks/evaluate_region.h"

/* one->result and one->truth are given, the rest is filled in. */
hada_status hada_evaluate_compare(hada_evaluation *one, const hada_evaluate_task *by, const hada_region *region,
                                  hada_error *err);

#endif
