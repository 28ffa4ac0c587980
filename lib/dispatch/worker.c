/* The lanes' threads: each pulls the next frame, or helps with one in hand, and hands on what it cannot do. */
#include <signal.h>

#include "core/clock.h"
#include "dispatch/batches.h"
#include "dispatch/dispatcher.h"

static int is_of_the_device(hada_status status)
{
    return status == HADA_ERROR_DEVICE || status == HADA_ERROR_DEVICE_MEMORY || status == HADA_ERROR_BUILD ||
           status == HADA_ERROR_SELF_TEST;
}

/* The lane goes out of use. When it was the last one, all may try again: the next frame is not to blame. Returns how
 * many are left now. */
static int lose(hada_board *board, hada_lane *lane, const hada_error *error)
{
    const int left = --board->alive;
    lane->info.lost = 1;
    hada_log(lane->share->context, HADA_LOG_WARNING, "queue %d of device %d (%s) is out of use: %s%s", lane->number,
             lane->info.device, lane->share->context->info.name, error->message,
             left ? "; the others take over its work" : "");
    for (int i = 0; !left && i < board->lane_count; i++) {
        board->lanes[i]->info.lost = 0;
        board->alive++;
    }
    return left;
}

static void run_frame(hada_board *board, hada_lane *lane, hada_job *job)
{
    hada_error error = {0};
    hada_board_remove(&board->waiting, job);
    hada_board_add(&board->in_hand, job, 0);
    job->state = HADA_JOB_RUNNING;
    job->lane = lane;
    lane->info.frames++;
    pthread_mutex_unlock(&board->lock);
    const double start = hada_seconds();
    const hada_status status = hada_lane_run(lane, &job->task, &error);
    const double busy = hada_seconds() - start;
    pthread_mutex_lock(&board->lock);
    lane->info.busy_seconds += busy;
    job->lane = NULL;
    hada_board_remove(&board->in_hand, job);
    if (!is_of_the_device(status)) {
        hada_board_end(board, job,
                       !status                          ? HADA_JOB_DONE
                       : status == HADA_ERROR_CANCELLED ? HADA_JOB_CANCELLED
                                                        : HADA_JOB_FAILED,
                       status ? &error : NULL);
        return;
    }
    if (!job->error.status)
        job->error = error; /* the first failure is the one to tell */
    if (lose(board, lane, &error)) {
        hada_board_add(&board->waiting, job, 1);
        pthread_cond_broadcast(&board->changed);
    } else {
        error = job->error;
        hada_board_end(board, job, HADA_JOB_FAILED, &error);
    }
}

static hada_job *find_help(const hada_board *board, const hada_lane *lane)
{
    for (hada_job *job = board->in_hand; job; job = job->next)
        if (hada_lane_helps(lane, job->lane) && hada_batches_left(&job->task))
            return job;
    return NULL;
}

static void help(hada_board *board, hada_lane *lane, hada_job *job)
{
    hada_error error = {0};
    job->task.helpers++;
    pthread_mutex_unlock(&board->lock);
    const double start = hada_seconds();
    const hada_status status = hada_lane_help(lane, &job->task, &error);
    const double busy = hada_seconds() - start;
    pthread_mutex_lock(&board->lock);
    lane->info.busy_seconds += busy;
    job->task.helpers--;
    pthread_cond_broadcast(&board->changed);
    if (status && status != HADA_ERROR_CANCELLED)
        lose(board, lane, &error);
}

static void *work(void *argument)
{
    hada_lane *lane = argument;
    hada_board *board = lane->plan->board;
    pthread_mutex_lock(&board->lock);
    while (!board->closing) {
        const int able = !lane->info.lost && !board->occupied;
        hada_job *job;
        if (able && board->waiting) {
            run_frame(board, lane, board->waiting);
        } else if (able && (job = find_help(board, lane))) {
            help(board, lane, job);
        } else {
            lane->idle = able;
            pthread_cond_wait(&board->changed, &board->lock);
            lane->idle = 0;
        }
    }
    pthread_mutex_unlock(&board->lock);
    return NULL;
}

hada_status hada_board_start(hada_board *board, hada_error *err)
{
    sigset_t all, before;
    int failed = 0;
    /* signals are for the threads of the program */
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    for (int i = 0; !board->threads && !failed && i < board->lane_count; i++) {
        hada_lane *lane = board->lanes[i];
        if (!lane->has_thread)
            failed = pthread_create(&lane->thread, NULL, work, lane);
        lane->has_thread |= !failed;
    }
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (failed)
        return hada_fail(err, HADA_ERROR_MEMORY, "the system gives no more threads; use fewer queues");
    board->threads = 1;
    return HADA_OK;
}

void hada_board_stop(hada_board *board)
{
    const hada_error cancelled = {HADA_ERROR_CANCELLED, 0, "the job's plan was destroyed", ""};
    pthread_mutex_lock(&board->lock);
    while (board->waiting) {
        hada_job *job = board->waiting;
        hada_board_remove(&board->waiting, job);
        hada_board_end(board, job, HADA_JOB_CANCELLED, &cancelled);
    }
    for (hada_job *job = board->in_hand; job; job = job->next)
        atomic_store(&job->task.cancelled, 1);
    board->closing = 1;
    pthread_cond_broadcast(&board->changed);
    pthread_mutex_unlock(&board->lock);
    for (int i = 0; i < board->lane_count; i++)
        if (board->lanes[i]->has_thread)
            pthread_join(board->lanes[i]->thread, NULL);
}
