#include <errno.h>
#include <poll.h>
#include <unistd.h>

#include "core/clock.h"
#include "tasks/live.h"

/* How often the thread looks whether it shall stop. */
enum { STOP_MILLISECONDS = 100 };

/* Reads a whole frame; 0 where the pipe has ended, or shall not be read any more. */
static int read_frame(hada_live_pipe *pipe)
{
    size_t have = 0;
    while (have < pipe->bytes) {
        struct pollfd ready = {.fd = pipe->fd, .events = POLLIN};
        pthread_mutex_lock(&pipe->lock);
        const int stop = pipe->stop;
        pthread_mutex_unlock(&pipe->lock);
        if (stop)
            return 0;
        if (poll(&ready, 1, STOP_MILLISECONDS) == 0)
            continue;
        const ssize_t got = read(pipe->fd, pipe->reading + have, pipe->bytes - have);
        if (got < 0 && (errno == EINTR || errno == EAGAIN))
            continue;
        if (got <= 0) {
            pthread_mutex_lock(&pipe->lock);
            pipe->code = got < 0 ? errno : 0;
            pipe->rest = have;
            pthread_mutex_unlock(&pipe->lock);
            return 0;
        }
        have += (size_t)got;
    }
    return 1;
}

/* The frame that was read becomes the newest. */
static void hand_over(hada_live_pipe *pipe)
{
    pthread_mutex_lock(&pipe->lock);
    while (pipe->is_file && pipe->is_ready && !pipe->stop)
        pthread_cond_wait(&pipe->changed, &pipe->lock);
    unsigned char *const free_one = pipe->ready;
    pipe->ready = pipe->reading;
    pipe->reading = free_one;
    pipe->passed_over += pipe->is_ready;
    pipe->is_ready = 1;
    pipe->come++;
    pthread_cond_broadcast(&pipe->changed);
    pthread_mutex_unlock(&pipe->lock);
}

static void *read_all(void *user)
{
    hada_live_pipe *pipe = user;
    while (read_frame(pipe))
        hand_over(pipe);
    pthread_mutex_lock(&pipe->lock);
    pipe->ended = 1;
    pthread_cond_broadcast(&pipe->changed);
    pthread_mutex_unlock(&pipe->lock);
    return NULL;
}

hada_status hada_live_pipe_begin(hada_live_pipe *pipe, int fd, const hada_headerless *frames, hada_error *err)
{
    struct stat info;
    *pipe = (hada_live_pipe){.fd = fd,
                             .is_file = !fstat(fd, &info) && S_ISREG(info.st_mode),
                             .frames = *frames,
                             .bytes = (size_t)hada_headerless_bytes(frames, 1),
                             .lock = PTHREAD_MUTEX_INITIALIZER};
    hada_condition_init(&pipe->changed);
    HADA_TRY(hada_allocated(pipe->reading = hada_alloc_raw(pipe->bytes, 1, "a frame", err)));
    HADA_TRY(hada_allocated(pipe->ready = hada_alloc_raw(pipe->bytes, 1, "a frame", err)));
    HADA_TRY(hada_allocated(pipe->taken = hada_alloc_raw(pipe->bytes, 1, "a frame", err)));
    if (pthread_create(&pipe->thread, NULL, read_all, pipe))
        return hada_fail(err, HADA_ERROR_MEMORY, "no thread to read frames with");
    pipe->started = 1;
    return HADA_OK;
}

static hada_status why_it_ended(const hada_live_pipe *pipe, hada_error *err)
{
    if (pipe->code)
        return hada_fail(err, HADA_ERROR_FILE_READ, "frames cannot be read: %s", strerror(pipe->code));
    if (!pipe->come)
        return hada_fail(err, HADA_ERROR_FILE_READ,
                         "the input ended after %zu bytes, before a whole frame of %zu; check the size in "
                         "options.headerless, and that the camera runs",
                         pipe->rest, pipe->bytes);
    return HADA_OK;
}

hada_status hada_live_pipe_take(hada_live_pipe *pipe, double seconds, hada_live_taken *taken, hada_error *err)
{
    const double until = hada_seconds() + seconds;
    hada_status status = HADA_OK;
    int waits = 1;
    pthread_mutex_lock(&pipe->lock);
    while (!pipe->is_ready && !pipe->ended && waits)
        waits = hada_condition_wait_until(&pipe->changed, &pipe->lock, until);
    *taken = (hada_live_taken){.number = pipe->come, .passed_over = pipe->passed_over};
    if (pipe->is_ready) {
        unsigned char *const free_one = pipe->taken;
        taken->data = pipe->taken = pipe->ready;
        pipe->ready = free_one;
        pipe->is_ready = 0;
        pthread_cond_broadcast(&pipe->changed);
    }
    taken->ended = !taken->data && pipe->ended;
    if (taken->ended)
        status = why_it_ended(pipe, err);
    pthread_mutex_unlock(&pipe->lock);
    return status;
}

void hada_live_pipe_end(hada_live_pipe *pipe)
{
    if (pipe->started) {
        pthread_mutex_lock(&pipe->lock);
        pipe->stop = 1;
        pthread_cond_broadcast(&pipe->changed);
        pthread_mutex_unlock(&pipe->lock);
        pthread_join(pipe->thread, NULL);
    }
    HADA_FREE(pipe->reading, pipe->ready, pipe->taken);
    *pipe = (hada_live_pipe){0};
}
