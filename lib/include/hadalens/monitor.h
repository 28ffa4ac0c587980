/* Hadalens: what work that takes long tells its caller, and how the caller stops it.
 *
 * A task (hadalens/task_*.h) takes a pointer to a hada_monitor, or NULL where nobody listens; options of a fit and of a
 * registration do as well, which ask nothing but whether to stop. Every member may be NULL.
 * Threads: the callbacks come from the thread that called the task; they must not call back into the task's objects. */
#ifndef HADALENS_MONITOR_H
#define HADALENS_MONITOR_H

#include <hadalens/status.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_message {
    HADA_MESSAGE_NOTE = 1,  /* something that the caller should know: pairs left out, a result that is only rough */
    HADA_MESSAGE_INFO = 2,  /* what is done now, and why */
    HADA_MESSAGE_DETAIL = 3 /* for who looks closely */
} hada_message;

typedef struct hada_monitor {
    size_t size; /* sizeof(hada_monitor) */
    void *user;  /* handed to every callback */

    /* `done` of `total` `what` (a plural, such as "pairs") are done; total 0: how many is not known beforehand. done 0
     * begins a stretch of work, what NULL ends it. `note`: a few words beside, or NULL. */
    void (*progress)(void *user, const char *what, long done, long total, const char *note);

    /* A sentence for a person. Options are named as "options.NAME". */
    void (*message)(void *user, hada_message kind, const char *text);

    /* Not 0: stop. The task ends soon with HADA_ERROR_CANCELLED and leaves nothing half-written. */
    int (*cancelled)(void *user);
} hada_monitor;
HADA_INIT(hada_monitor, HADA_STRUCT_MONITOR)

#ifdef __cplusplus
}
#endif
#endif
