/* Jobs: frames handed in, asked for and waited for. */
#include <stdlib.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "dispatch/dispatcher.h"

static hada_status check_arguments(const void *plan, const hada_image *raw, const void *result, const char *name,
                                   hada_error *err)
{
    if (plan && raw && raw->data && result)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_ARGUMENT, "%s: a plan, a frame and a result are needed", name);
}

hada_status hada_job_submit(hada_job **out, hada_plan *plan, const hada_image *raw, hada_result *result,
                            hada_error *err)
{
    hada_job *job;
    if (!out)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_job_submit: out is needed");
    *out = NULL;
    hada_status status = check_arguments(plan, raw, result, "hada_job_submit", err);
    if (!status)
        status = hada_alloc((void **)&job, 1, sizeof *job, "a job", err);
    if (status)
        return status;
    status = hada_task_begin(&job->task, plan, raw, result, err);
    if (status) {
        free(job);
        return status;
    }
    status = hada_frames_enter(&plan->frames, &job->task, err);
    hada_board *board = job->board = plan->board;
    pthread_mutex_lock(&board->lock);
    if (!status)
        status = hada_board_start(board, err);
    if (!status) {
        board->references++;
        job->task.serial = ++board->serial;
        hada_board_add(&board->waiting, job, 0);
        pthread_cond_broadcast(&board->changed);
    }
    pthread_mutex_unlock(&board->lock);
    if (status) {
        hada_task_end(&job->task, status);
        free(job);
        return status;
    }
    *out = job;
    return HADA_OK;
}

static int ended(const hada_job *job)
{
    return job->state >= HADA_JOB_DONE;
}

hada_job_state hada_job_poll(const hada_job *job)
{
    pthread_mutex_lock(&job->board->lock);
    const hada_job_state state = job->state;
    pthread_mutex_unlock(&job->board->lock);
    return state;
}

double hada_job_progress(const hada_job *job)
{
    return (double)atomic_load(&job->task.progress) / HADA_PROGRESS;
}

hada_status hada_job_wait(hada_job *job, hada_error *err)
{
    if (!job)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_job_wait: a job is needed");
    pthread_mutex_lock(&job->board->lock);
    while (!ended(job))
        pthread_cond_wait(&job->board->changed, &job->board->lock);
    const hada_status status = job->state == HADA_JOB_DONE ? HADA_OK : job->error.status;
    if (status && err)
        *err = job->error;
    pthread_mutex_unlock(&job->board->lock);
    return status;
}

void hada_job_cancel(hada_job *job)
{
    if (!job)
        return;
    hada_board *board = job->board;
    pthread_mutex_lock(&board->lock);
    if (!ended(job))
        atomic_store(&job->task.cancelled, 1);
    if (!ended(job) && !job->lane) {
        hada_error error;
        hada_task_check(&job->task, &error);
        hada_board_remove(&board->waiting, job);
        hada_board_end(board, job, HADA_JOB_CANCELLED, &error);
    }
    pthread_mutex_unlock(&board->lock);
}

void hada_job_destroy(hada_job **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_job *job = *pointer;
    *pointer = NULL;
    hada_job_cancel(job);
    hada_job_wait(job, NULL);
    hada_board_release(job->board);
    free(job);
}

/* A plan of one lane whose thread was never needed works in the caller's. */
static int occupy(hada_board *board, uint64_t *serial)
{
    pthread_mutex_lock(&board->lock);
    const int here = board->lane_count == 1 && !board->threads && !board->occupied;
    if (here) {
        board->occupied = 1;
        board->lanes[0]->info.frames++;
        *serial = ++board->serial;
    }
    pthread_mutex_unlock(&board->lock);
    return here;
}

static void leave(hada_board *board, double busy)
{
    pthread_mutex_lock(&board->lock);
    board->occupied = 0;
    board->lanes[0]->info.busy_seconds += busy;
    pthread_cond_broadcast(&board->changed);
    pthread_mutex_unlock(&board->lock);
}

static hada_status run_here(hada_plan *plan, uint64_t serial, const hada_image *raw, hada_result *result,
                            hada_error *err)
{
    hada_task task;
    const double start = hada_seconds();
    hada_status status = hada_task_begin(&task, plan, raw, result, err);
    if (!status) {
        task.serial = serial;
        status = hada_frames_enter(&plan->frames, &task, err);
        if (!status)
            status = hada_lane_run(plan->lanes[0], &task, err);
        hada_task_end(&task, status);
    }
    leave(plan->board, hada_seconds() - start);
    return status;
}

hada_status hada_plan_run(hada_plan *plan, const hada_image *raw, hada_result *result, hada_error *err)
{
    hada_job *job;
    uint64_t serial;
    hada_status status = check_arguments(plan, raw, result, "hada_plan_run", err);
    if (status)
        return status;
    if (occupy(plan->board, &serial))
        return run_here(plan, serial, raw, result, err);
    status = hada_job_submit(&job, plan, raw, result, err);
    if (!status)
        status = hada_job_wait(job, err);
    hada_job_destroy(&job);
    return status;
}

int hada_plan_queues(const hada_plan *plan, hada_queue_info *info, int capacity)
{
    hada_board *board = plan->board;
    pthread_mutex_lock(&board->lock);
    for (int i = 0; i < board->lane_count && i < capacity; i++)
        info[i] = board->lanes[i]->info;
    pthread_mutex_unlock(&board->lock);
    return board->lane_count;
}
