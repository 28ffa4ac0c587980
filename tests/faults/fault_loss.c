/* Devices that fail from some command on. */
#include <pthread.h>

#include "fault.h"

enum { LOSSES = 4 };

static struct {
    pthread_mutex_t lock;
    fault_device_loss list[LOSSES];
    long seen[LOSSES];
    int count;
} losses = {.lock = PTHREAD_MUTEX_INITIALIZER};

void fault_lose(const fault_device_loss *loss)
{
    pthread_mutex_lock(&losses.lock);
    if (!loss)
        losses.count = 0;
    else if (losses.count < LOSSES) {
        losses.seen[losses.count] = 0;
        losses.list[losses.count++] = *loss;
    }
    pthread_mutex_unlock(&losses.lock);
}

int fault_lost(void *context)
{
    int code = 0;
    pthread_mutex_lock(&losses.lock);
    for (int i = 0; i < losses.count; i++) {
        const fault_device_loss *loss = &losses.list[i];
        if (loss->context != context || !loss->n)
            continue;
        const long now = ++losses.seen[i];
        if (now >= loss->n && (!loss->count || now < loss->n + loss->count))
            code = loss->code;
    }
    pthread_mutex_unlock(&losses.lock);
    return code;
}
