/* The board of a plan: the frames that wait, those in hand, and the lanes that look for work. Internal.
 *
 * One lock guards all of it; one condition tells of every change. Jobs may outlive their plan, so the board goes with
 * the last of them. */
#ifndef HADA_DISPATCH_DISPATCHER_H
#define HADA_DISPATCH_DISPATCHER_H

#include <hadalens/job.h>
#include <pthread.h>

#include "engine/pipeline.h"

struct hada_job {
    hada_board *board;
    hada_job *next; /* in one of the board's lists */
    hada_task task;
    hada_job_state state;
    hada_error error;
    hada_lane *lane; /* that has the frame; NULL while it waits */
};

struct hada_board {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    int references;    /* the plan and its jobs */
    hada_job *waiting; /* in the order of submission */
    hada_job *in_hand; /* oldest first */
    uint64_t serial;   /* of the last task */
    hada_lane **lanes;
    int lane_count, alive; /* lanes that are not lost */
    int threads;           /* lanes have threads */
    int occupied;          /* the plan's one lane works in a caller's thread */
    int closing;           /* the plan goes */
};

hada_status hada_board_create(hada_board **out, hada_lane **lanes, int lane_count, hada_error *err);
void hada_board_release(hada_board *board);

/* The rest is called with the lock held. */

void hada_board_add(hada_job **list, hada_job *job, int front);
void hada_board_remove(hada_job **list, hada_job *job);

/* Ends a job: its task is freed, those who wait for it learn it. */
void hada_board_end(hada_board *board, hada_job *job, hada_job_state state, const hada_error *error);

/* Lanes without work that could help a frame of `lane`. */
int hada_board_idle(const hada_board *board, const hada_lane *lane);

/* Makes a thread for each lane, once. */
hada_status hada_board_start(hada_board *board, hada_error *err);
/* Cancels all jobs and waits for the threads. Takes the lock itself. */
void hada_board_stop(hada_board *board);

#endif
