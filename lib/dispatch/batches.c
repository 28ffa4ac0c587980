#include "dispatch/batches.h"

#include <string.h>

#include "dispatch/dispatcher.h"

void hada_batches_open(hada_task *task, const unsigned char *wanted)
{
    hada_board *board = task->plan->board;
    pthread_mutex_lock(&board->lock);
    for (int z = 0; z < task->plan->shape.depths; z++)
        task->depths[z] = wanted[z] ? HADA_DEPTH_FREE : HADA_DEPTH_EMPTY;
    task->open = 1;
    pthread_cond_broadcast(&board->changed);
    pthread_mutex_unlock(&board->lock);
}

void hada_batches_close(hada_task *task)
{
    hada_board *board = task->plan->board;
    pthread_mutex_lock(&board->lock);
    task->open = 0;
    while (task->helpers)
        pthread_cond_wait(&board->changed, &board->lock);
    pthread_mutex_unlock(&board->lock);
}

static int count_free(const hada_task *task)
{
    int count = 0;
    for (int z = 0; z < task->plan->shape.depths; z++)
        count += task->depths[z] == HADA_DEPTH_FREE;
    return count;
}

/* The nearest or the farthest free depths that stand together; returns how many. */
static int find_run(const hada_task *task, int farthest, int *first)
{
    const int depths = task->plan->shape.depths, step = farthest ? -1 : 1;
    int z = farthest ? depths - 1 : 0;
    while (z >= 0 && z < depths && task->depths[z] != HADA_DEPTH_FREE)
        z += step;
    const int begin = z;
    while (z >= 0 && z < depths && task->depths[z] == HADA_DEPTH_FREE)
        z += step;
    *first = farthest ? z + 1 : begin;
    return farthest ? begin - z : z - begin;
}

int hada_batches_left(const hada_task *task)
{
    return task->open && count_free(task);
}

/* Part of what is free, so that lanes of different speed end together. */
static int share_out(int free, int lanes)
{
    return (free + 2 * lanes - 1) / (2 * lanes);
}

int hada_batches_take(hada_task *task, const hada_lane *lane, int helps, int *first)
{
    hada_board *board = task->plan->board;
    pthread_mutex_lock(&board->lock);
    int count = 0;
    const int free = task->open ? count_free(task) : 0;
    if (free) {
        const int run = find_run(task, helps, first), idle = hada_board_idle(board, lane);
        count = idle || helps ? share_out(free, idle + 1 + task->helpers) : free;
        count = count < lane->batch ? count : lane->batch;
        count = count < run ? count : run;
        if (helps)
            *first += run - count;
        memset(task->depths + *first, HADA_DEPTH_TAKEN, (size_t)count);
    }
    pthread_mutex_unlock(&board->lock);
    return count;
}

void hada_batches_put(hada_task *task, hada_lane *lane, int first, int count, int state)
{
    hada_board *board = task->plan->board;
    pthread_mutex_lock(&board->lock);
    memset(task->depths + first, state, (size_t)count);
    lane->info.batches += state == HADA_DEPTH_HOME;
    int home = 0;
    for (int z = 0; z < task->plan->shape.depths; z++)
        home += task->depths[z] >= HADA_DEPTH_HOME;
    hada_task_progress(task, 1 + home);
    pthread_cond_broadcast(&board->changed);
    pthread_mutex_unlock(&board->lock);
}

int hada_batches_home(hada_task *task, int first, int wait)
{
    hada_board *board = task->plan->board;
    int count = 0;
    pthread_mutex_lock(&board->lock);
    while (wait && task->depths[first] == HADA_DEPTH_TAKEN)
        pthread_cond_wait(&board->changed, &board->lock);
    while (first + count < task->plan->shape.depths && task->depths[first + count] == HADA_DEPTH_HOME)
        count++;
    pthread_mutex_unlock(&board->lock);
    return count;
}
