/* Telling a caller's monitor. Internal. */
#ifndef HADA_CORE_MONITOR_H
#define HADA_CORE_MONITOR_H

#include <hadalens/monitor.h>

#include "core/error.h"

/* Passes a message on; `monitor` may be NULL. */
void hada_monitor_tell(const hada_monitor *monitor, hada_message kind, const char *format, ...) HADA_PRINTF(3, 4);

/* HADA_ERROR_CANCELLED where the caller wants to stop. */
hada_status hada_monitor_check(const hada_monitor *monitor, hada_error *err);

/* A stretch of work of `total` steps, 0: not known beforehand. It must be ended. */
typedef struct hada_progress {
    const hada_monitor *monitor;
    const char *what;
    long done, total;
} hada_progress;

hada_progress hada_progress_begin(const hada_monitor *monitor, const char *what, long total);
/* One step is done. HADA_ERROR_CANCELLED where the caller wants to stop. */
hada_status hada_progress_step(hada_progress *progress, const char *note, hada_error *err);
void hada_progress_end(hada_progress *progress);

#endif
