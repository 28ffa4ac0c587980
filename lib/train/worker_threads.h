/* Threads that work together, one task after the other. Internal.
 *
 * Member 0 is the caller itself; each of the others has a thread, which sleeps between tasks. */
#ifndef HADA_TRAIN_WORKER_THREADS_H
#define HADA_TRAIN_WORKER_THREADS_H

#include <hadalens/status.h>

typedef struct hada_worker_threads hada_worker_threads;

/* Where the system gives no thread for a member, the caller does its work as well. */
hada_status hada_worker_threads_create(hada_worker_threads **out, int count, hada_error *err);
void hada_worker_threads_destroy(hada_worker_threads **threads);

/* A task: work(user, member) for every member, at the same time; returns when all are done. No member may wait for
 * another within it. One caller at a time. */
void hada_worker_threads_run(hada_worker_threads *threads, void (*work)(void *user, int member), void *user);

#endif
