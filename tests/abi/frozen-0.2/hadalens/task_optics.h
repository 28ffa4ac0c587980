/* Hadalens: what a camera resolves, as the command 'optics' finds and writes it.
 *
 * Threads: a run uses the calling thread; several may run at once on contexts of their own. Source:
 * docs/explanation/simulation.md. */
#ifndef HADALENS_TASK_OPTICS_H
#define HADALENS_TASK_OPTICS_H

#include <hadalens/monitor.h>
#include <hadalens/optics.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_optics_task {
    size_t size;      /* sizeof(hada_optics_task) */
    const char *psf;  /* a TIFF file of PSFs, a page per depth, of the sensor's size; NULL: by the camera's design */
    int coherent;     /* by wave optics, all lenses together (hada_wave_options) */
    double threshold; /* of the MTF, below 1; HADA_AUTO (default): 0.05 */
    const hada_monitor *monitor;
} hada_optics_task;
HADA_INIT(hada_optics_task, HADA_STRUCT_OPTICS_TASK)

/* Makes or reads the PSFs of all depths, reports on them, and writes a folder that is not there yet, or empty, and that
 * appears whole or not at all: camera.json, psf.tif, depths.csv, mtf.csv, self_correlation.csv, correlation.csv,
 * lenses.csv (masks of lenses or holes) and, where this build draws pictures, the tables as .svg, mask.png and
 * psf_z<distance>mm.png. *report is given back by
 * hada_optics_report_destroy(); NULL after a failure. `report` may be left out (NULL), and so may `task`. */
HADA_API hada_status hada_optics_run(hada_optics_report **report, hada_context *context, const hada_camera *camera,
                                     const char *folder, const hada_optics_task *task, hada_error *err);

/* The columns of depths.csv: the name of column 0, 1, ..., NULL behind the last. *value (may be NULL) becomes its value
 * in a row (may be NULL: NaN). */
HADA_API const char *hada_optics_column(int column, const hada_optics_row *row, double *value);

#ifdef __cplusplus
}
#endif
#endif
