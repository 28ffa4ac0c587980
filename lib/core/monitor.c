#include "core/monitor.h"

#include <stdarg.h>
#include <stdio.h>

#include "core/options.h"

/* Whether a caller, perhaps an older one, gave that callback. */
#define HAS(monitor, callback)                                                                                         \
    ((monitor) && (monitor)->size >= offsetof(hada_monitor, callback) + sizeof((monitor)->callback) &&                 \
     (monitor)->callback)

void hada_monitor_defaults(hada_monitor *monitor, size_t size)
{
    const hada_monitor own = {.size = sizeof own};
    HADA_OPTIONS_GIVE(monitor, size, &own);
}

void hada_monitor_tell(const hada_monitor *monitor, hada_message kind, const char *format, ...)
{
    char text[1200];
    if (!HAS(monitor, message))
        return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    monitor->message(monitor->user, kind, text);
}

hada_status hada_monitor_check(const hada_monitor *monitor, hada_error *err)
{
    if (!HAS(monitor, cancelled) || !monitor->cancelled(monitor->user))
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_CANCELLED, "stopped; what was at hand was not written");
}

static void tell(const hada_progress *progress, const char *what, const char *note)
{
    const hada_monitor *monitor = progress->monitor;
    if (HAS(monitor, progress))
        monitor->progress(monitor->user, what, progress->done, progress->total, note);
}

hada_progress hada_progress_begin(const hada_monitor *monitor, const char *what, long total)
{
    const hada_progress progress = {.monitor = monitor, .what = what, .total = total};
    tell(&progress, what, NULL);
    return progress;
}

hada_status hada_progress_step(hada_progress *progress, const char *note, hada_error *err)
{
    progress->done++;
    tell(progress, progress->what, note);
    return hada_monitor_check(progress->monitor, err);
}

void hada_progress_end(hada_progress *progress)
{
    tell(progress, NULL, NULL);
    *progress = (hada_progress){0};
}
