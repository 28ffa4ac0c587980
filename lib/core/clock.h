/* Time; threads, and waiting for them with a deadline. Internal. */
#ifndef HADA_CORE_CLOCK_H
#define HADA_CORE_CLOCK_H

#include <pthread.h>

/* Seconds since some moment in the past; never goes back. */
double hada_seconds(void);

/* Starts a thread, to which no signal is delivered: those are for the program's own threads. 0: there is none. */
int hada_thread_start(pthread_t *thread, void *(*run)(void *user), void *user);

/* A condition whose deadlines use the clock of hada_seconds(). */
void hada_condition_init(pthread_cond_t *condition);

/* Waits as pthread_cond_wait() does, at most until `deadline` (hada_seconds()). 0: not any more. */
int hada_condition_wait_until(pthread_cond_t *condition, pthread_mutex_t *lock, double deadline);

#endif
