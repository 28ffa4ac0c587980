#include "dispatch/dispatcher.h"

#include <stdlib.h>

#include "core/alloc.h"

hada_status hada_board_create(hada_board **out, hada_lane **lanes, int lane_count, hada_error *err)
{
    hada_board *board;
    *out = NULL;
    hada_status status = hada_alloc((void **)&board, 1, sizeof *board, "a plan", err);
    if (status)
        return status;
    pthread_mutex_init(&board->lock, NULL);
    pthread_cond_init(&board->changed, NULL);
    board->references = 1;
    board->lanes = lanes;
    board->lane_count = board->alive = lane_count;
    *out = board;
    return HADA_OK;
}

void hada_board_release(hada_board *board)
{
    pthread_mutex_lock(&board->lock);
    const int left = --board->references;
    pthread_mutex_unlock(&board->lock);
    if (left)
        return;
    pthread_cond_destroy(&board->changed);
    pthread_mutex_destroy(&board->lock);
    free(board);
}

void hada_board_add(hada_job **list, hada_job *job, int front)
{
    while (*list && !front)
        list = &(*list)->next;
    job->next = *list;
    *list = job;
}

void hada_board_remove(hada_job **list, hada_job *job)
{
    while (*list && *list != job)
        list = &(*list)->next;
    if (*list)
        *list = job->next;
    job->next = NULL;
}

void hada_board_end(hada_board *board, hada_job *job, hada_job_state state, const hada_error *error)
{
    hada_task_end(&job->task, error ? error->status : HADA_OK);
    if (error)
        job->error = *error;
    else
        hada_task_progress(&job->task, job->task.work);
    job->state = state;
    pthread_cond_broadcast(&board->changed);
}

int hada_board_idle(const hada_board *board, const hada_lane *lane)
{
    int idle = 0;
    for (int i = 0; i < board->lane_count; i++)
        idle += board->lanes[i]->idle && hada_lane_helps(board->lanes[i], lane);
    return idle;
}
