/* A caller who wants to stop after so many questions. */
#ifndef HADA_TESTS_PATIENCE_H
#define HADA_TESTS_PATIENCE_H

#include <hadalens/monitor.h>

typedef struct patience {
    int asked, most; /* most < 0: never stops */
} patience;

static inline int patience_is_over(void *user)
{
    patience *of = user;
    return of->asked++ >= of->most && of->most >= 0;
}

static inline hada_monitor patience_monitor(patience *of)
{
    DEFAULTS(hada_monitor, monitor);
    monitor.user = of;
    monitor.cancelled = patience_is_over;
    return monitor;
}

#endif
