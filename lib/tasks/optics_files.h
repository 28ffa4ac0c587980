/* What the task on optics writes into its folder. Internal. */
#ifndef HADA_TASKS_OPTICS_FILES_H
#define HADA_TASKS_OPTICS_FILES_H

#include <hadalens/task_optics.h>

#include "core/base.h"

/* depths.csv, mtf.csv, self_correlation.csv, correlation.csv. */
hada_status hada_optics_tables(const hada_optics_report *report, const char *folder, hada_error *err);

/* mtf.svg, self_correlation.svg, correlation.svg, depths.svg. */
hada_status hada_optics_plots(const hada_optics_report *report, const char *folder, hada_error *err);

/* lenses.csv: where the lenses or holes are; for masks that have them. */
hada_status hada_optics_lenses(const hada_camera *camera, const char *folder, hada_error *err);

/* mask.png: the mask's thickness where it is open, or its openings. */
hada_status hada_optics_mask(const hada_camera *camera, const char *folder, const hada_monitor *monitor,
                             hada_error *err);

#endif
