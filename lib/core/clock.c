#include "core/clock.h"

#include <math.h>
#include <signal.h>
#include <time.h>

double hada_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int hada_thread_start(pthread_t *thread, void *(*run)(void *user), void *user)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    const int failed = pthread_create(thread, NULL, run, user);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return !failed;
}

/* Later than any program runs, and small enough for time_t. */
#define FAR_AWAY 1e9

void hada_condition_init(pthread_cond_t *condition)
{
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(condition, &monotonic);
    pthread_condattr_destroy(&monotonic);
}

int hada_condition_wait_until(pthread_cond_t *condition, pthread_mutex_t *lock, double deadline)
{
    const double moment = fmin(deadline, FAR_AWAY), whole = floor(moment);
    const struct timespec until = {.tv_sec = (time_t)whole, .tv_nsec = (long)((moment - whole) * 1e9)};
    return pthread_cond_timedwait(condition, lock, &until) == 0;
}
