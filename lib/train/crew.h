/* Threads that work together, turn by turn. Internal.
 *
 * Member 0 is the caller itself; each of the others has a thread, which sleeps between turns. */
#ifndef HADA_TRAIN_CREW_H
#define HADA_TRAIN_CREW_H

#include <hadalens/status.h>

typedef struct hada_crew hada_crew;

/* Where the system gives no thread for a member, the caller does its work as well. */
hada_status hada_crew_create(hada_crew **out, int count, hada_error *err);
void hada_crew_destroy(hada_crew **crew);

/* A turn: work(user, member) for every member, at the same time; returns when all are done. No member may wait for
 * another within it. One caller at a time. */
void hada_crew_run(hada_crew *crew, void (*work)(void *user, int member), void *user);

#endif
