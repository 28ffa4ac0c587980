/* Frames as they come: taken from where they come from, reconstructed, written, shown. */
#include <errno.h>
#include <hadalens/task_live.h>
#include <poll.h>
#include <pthread.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "core/callers.h"
#include "core/clock.h"
#include "dispatch/plan.h"
#include "io/decode.h"
#include "io/folder.h"
#include "io/tiff_page.h"
#include "picture/tone.h"
#include "tasks/frames.h"

/* A thread reads all that comes, so that a camera never waits, and keeps the newest whole frame. */
typedef struct hada_live_pipe {
    int fd, is_file; /* an ordinary file has time: none of its frames is left out */
    hada_headerless frames;
    size_t bytes; /* of a frame */
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    int started, stop, ended, code; /* code: errno of a read that failed */
    unsigned char *reading, *ready, *taken;
    int is_ready;
    long come, passed_over; /* whole frames so far */
    size_t rest;            /* bytes of the frame that was begun when the pipe ended */
} hada_live_pipe;

/* What was taken from a pipe. */
typedef struct hada_live_taken {
    const unsigned char *data; /* of the newest frame, until the next call; NULL: none has come */
    long number, passed_over;  /* of the frame, from 1 on; frames that were left out so far */
    int ended;                 /* 1: no frame will come */
} hada_live_taken;

/* A file of the folder, as it was when it was last looked at. */
typedef struct hada_live_file {
    char *name;
    off_t bytes;
    struct timespec changed;
    double still_since; /* hada_seconds() at which it was first seen like this */
    int done;
} hada_live_file;

typedef struct hada_live_folder {
    const char *path;
    int newest_only; /* 1: files older than the one that is taken are left out */
    hada_live_file *files;
    int count;
    long passed_over;
    double next_look;
} hada_live_folder;

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

static hada_status live_pipe_begin(hada_live_pipe *pipe, int fd, const hada_headerless *frames, hada_error *err)
{
    struct stat info;
    *pipe = (hada_live_pipe){.fd = fd,
                             .is_file = !fstat(fd, &info) && S_ISREG(info.st_mode),
                             .frames = *frames,
                             .bytes = (size_t)hada_headerless_bytes(frames, 1),
                             .lock = PTHREAD_MUTEX_INITIALIZER};
    hada_condition_init(&pipe->changed);
    HADA_TRY(HADA_NEW_RAW(pipe->reading, pipe->bytes, "a frame", err));
    HADA_TRY(HADA_NEW_RAW(pipe->ready, pipe->bytes, "a frame", err));
    HADA_TRY(HADA_NEW_RAW(pipe->taken, pipe->bytes, "a frame", err));
    pipe->started = hada_thread_start(&pipe->thread, read_all, pipe);
    return pipe->started ? HADA_OK : hada_fail(err, HADA_ERROR_MEMORY, "no thread to read frames with");
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

/* Waits for a frame for some seconds. */
static hada_status live_pipe_take(hada_live_pipe *pipe, double seconds, hada_live_taken *taken, hada_error *err)
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

static void live_pipe_end(hada_live_pipe *pipe)
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

/* The folder is looked at this often, less often where a look takes long. */
#define LOOK_SECONDS 0.05
/* A file is whole when it has not changed for so long. */
#define STILL_SECONDS 0.2

static int is_later(struct timespec one, struct timespec other)
{
    return one.tv_sec > other.tv_sec || (one.tv_sec == other.tv_sec && one.tv_nsec > other.tv_nsec);
}

static int is_alike(const hada_live_file *file, const struct stat *info)
{
    return file->bytes == info->st_size && !is_later(info->st_mtim, file->changed) &&
           !is_later(file->changed, info->st_mtim);
}

/* Seconds since a file was changed, by the clock of files. */
static double age_of(const struct stat *info)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    return (double)(now.tv_sec - info->st_mtim.tv_sec) + 1e-9 * (double)(now.tv_nsec - info->st_mtim.tv_nsec);
}

/* Files and names are sorted: what was known of a name before. */
static const hada_live_file *known(const hada_live_folder *folder, const char *name)
{
    for (int low = 0, high = folder->count; low < high;) {
        const int middle = (low + high) / 2, order = strcmp(name, folder->files[middle].name);
        if (!order)
            return &folder->files[middle];
        low = order > 0 ? middle + 1 : low;
        high = order > 0 ? high : middle;
    }
    return NULL;
}

static void free_files(hada_live_file *files, int count)
{
    for (int i = 0; i < count; i++)
        free(files[i].name);
    free(files);
}

/* What the folder holds now. */
static hada_status look(hada_live_folder *folder, hada_error *err)
{
    const double now = hada_seconds();
    char **names = NULL;
    int count = 0, kept = 0;
    hada_live_file *files = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_folder_list_tiffs(folder->path, &names, &count, err));
    HADA_TRY_OR_DONE(HADA_NEW(files, (size_t)count + 1, "the files of a folder", err));
    for (int i = 0; i < count; i++) {
        struct stat info;
        hada_path path;
        HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/%s", folder->path, names[i]));
        if (stat(path, &info) || !S_ISREG(info.st_mode) || !info.st_size)
            continue; /* gone again, or nothing yet */
        const hada_live_file *before = known(folder, names[i]);
        const int same = before && is_alike(before, &info);
        files[kept++] = (hada_live_file){.name = names[i],
                                         .bytes = info.st_size,
                                         .changed = info.st_mtim,
                                         .still_since = same ? before->still_since : now - fmax(age_of(&info), 0.0),
                                         .done = same && before->done};
        names[i] = NULL;
    }
    free_files(folder->files, folder->count);
    folder->files = files;
    folder->count = kept;
    files = NULL;
    kept = 0;
    folder->next_look = hada_seconds() + fmax(LOOK_SECONDS, 10.0 * (hada_seconds() - now));
done:
    free_files(files, kept);
    hada_names_free(&names, &count);
    return status;
}

static hada_live_file *newest(const hada_live_folder *folder)
{
    const double now = hada_seconds();
    hada_live_file *best = NULL;
    for (int i = 0; i < folder->count; i++) {
        hada_live_file *file = &folder->files[i];
        if (!file->done && now - file->still_since >= STILL_SECONDS &&
            (!best || !is_later(best->changed, file->changed)))
            best = file;
    }
    return best;
}

static void pass_over(hada_live_folder *folder, const hada_live_file *than)
{
    for (int i = 0; i < folder->count; i++) {
        hada_live_file *file = &folder->files[i];
        if (file != than && !file->done && !is_later(file->changed, than->changed)) {
            file->done = 1;
            folder->passed_over++;
        }
    }
}

/* Waits for a file for some seconds. *name: the newest file that is whole and was not done as it is now; the folder's,
 * until the next call. NULL: there is none. */
static hada_status live_folder_take(hada_live_folder *folder, double seconds, const char **name, hada_error *err)
{
    const double until = hada_seconds() + seconds;
    *name = NULL;
    for (;;) {
        if (hada_seconds() >= folder->next_look)
            HADA_TRY(look(folder, err));
        hada_live_file *file = newest(folder);
        if (file) {
            file->done = 1;
            if (folder->newest_only)
                pass_over(folder, file);
            *name = file->name;
            return HADA_OK;
        }
        if (hada_seconds() >= until)
            return HADA_OK;
        usleep((useconds_t)(1e6 * LOOK_SECONDS / 2));
    }
}

/* The caller's wish to stop is asked for this often. */
#define STOP_SECONDS 0.05

typedef struct run {
    hada_live_task task;
    hada_files_task files;
    hada_plan *plan;
    const hada_model *model;
    hada_live_pipe pipe;
    hada_live_folder folder;
    hada_tiff_info kind; /* of the frames of a pipe */
    void *samples;       /* of one of them */
    hada_image light;    /* the same in linear light, where they are encoded */
    hada_display display;
    hada_outputs out; /* of the file at hand */
    hada_emitters *emitters;
    hada_result result;
    hada_live_state state;
    double since; /* when something came last */
} run;

static int stops(const run *own)
{
    return hada_monitor_check(own->task.monitor, NULL) != HADA_OK;
}

static void tell(run *own, hada_live_event event, const char *name, double began, const hada_error *error)
{
    own->state.event = event;
    own->state.name = name;
    own->state.seconds = hada_seconds() - began;
    own->state.result = event == HADA_LIVE_FRAME ? &own->result : NULL;
    own->state.error = error;
    if (own->task.tell)
        own->task.tell(own->task.user, &own->state);
    own->state.name = NULL; /* the caller's, like the others */
    own->state.result = NULL;
    own->state.error = NULL;
}

static hada_status compute(run *own, const hada_pixels *raw, hada_error *err)
{
    hada_job *job = NULL;
    HADA_TRY(hada_job_submit_pixels(&job, own->plan, raw, &own->result, err));
    while (hada_job_wait_for(job, STOP_SECONDS) < HADA_JOB_DONE && !stops(own))
        ;
    if (stops(own))
        hada_job_cancel(job);
    const hada_status status = hada_job_wait(job, err);
    hada_job_destroy(&job);
    return status;
}

static hada_status send_all(int to, const unsigned char *bytes, size_t count, hada_error *err)
{
    while (count) {
        const ssize_t done = write(to, bytes, count);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            return hada_fail(err, HADA_ERROR_FILE_WRITE, "the stream of pictures cannot be written: %s",
                             strerror(errno));
        bytes += done;
        count -= (size_t)done;
    }
    return HADA_OK;
}

static hada_status show(run *own, hada_error *err)
{
    const double gamma = own->plan->setup.options.gamma;
    const unsigned char *bytes;
    size_t count;
    if (own->task.stream == HADA_LIVE_STREAM_NONE)
        return HADA_OK;
    HADA_TRY(hada_display_draw(&own->display, &own->result.all_in_focus, gamma == 1.0 ? HADA_AUTO : 1.0, &bytes, &count,
                               err));
    return send_all(own->task.output, bytes, count, err);
}

/* Frame `index` of the `count` of an input. */
static hada_status do_frame(run *own, const char *name, const hada_pixels *raw, int index, int count, hada_error *err)
{
    HADA_TRY(compute(own, raw, err));
    if (own->task.files && !index)
        HADA_TRY(hada_outputs_begin(&own->out, &own->files, own->plan, name, count, err));
    if (own->task.files && own->files.emitters)
        HADA_TRY(hada_plan_emitters(&own->emitters, own->plan, raw, &own->result, own->task.monitor, err));
    if (own->task.files)
        HADA_TRY(hada_outputs_add(&own->out, raw, &own->result, own->emitters, err));
    if (own->task.files && index == count - 1)
        HADA_TRY(hada_outputs_finish(&own->out, err));
    own->state.frames++;
    return HADA_OK;
}

static void end_input(run *own)
{
    hada_outputs_end(&own->out);
    hada_memory_destroy(&own->emitters);
}

/* What of a frame's failure is that of the run: nobody reads the stream, or the caller wants to stop. */
static hada_status after(run *own, const char *name, hada_status status, double began, hada_error *error,
                         hada_error *err)
{
    if (status && !stops(own))
        tell(own, HADA_LIVE_FAILED, name, began, error);
    if (status)
        return HADA_OK;
    tell(own, HADA_LIVE_FRAME, name, began, NULL);
    return show(own, err);
}

static hada_status do_stored(run *own, hada_tiff_reader *reader, const char *name, int index, hada_error *err)
{
    hada_pixels raw = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tiff_read_stored(reader, index, own->task.frame_encoding, &raw, err));
    HADA_TRY_OR_DONE(do_frame(own, name, &raw, index, hada_tiff_get_info(reader)->frames, err));
done:
    free((void *)raw.data);
    return status;
}

static hada_status do_file(run *own, const char *path, const char *name, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_error error = {0};
    hada_status status = hada_frames_open(&reader, path, own->plan, own->model, &error), ends = HADA_OK;
    const int frames = status ? 1 : hada_tiff_get_info(reader)->frames;
    for (int i = 0; i < frames && !ends && !stops(own); i++) {
        const double began = hada_seconds();
        status = status ? status : do_stored(own, reader, name, i, &error);
        ends = after(own, name, hada_named(status, path, &error), began, &error, err);
        if (status)
            break;
    }
    end_input(own);
    hada_tiff_close(&reader);
    return ends;
}

static hada_status take_file(run *own, int *came, hada_error *err)
{
    const char *file;
    char *name = NULL;
    hada_path path;
    HADA_TRY(live_folder_take(&own->folder, STOP_SECONDS, &file, err));
    own->state.passed_over = own->folder.passed_over;
    *came = file != NULL;
    if (!file)
        return HADA_OK;
    HADA_TRY(hada_path_write(path, err, "%s/%s", own->task.folder, file));
    HADA_TRY(hada_path_stem(&name, path, err));
    const hada_status status = do_file(own, path, name, err);
    free(name);
    return status;
}

/* A frame of a pipe, which says nothing of its values, in linear light. */
static hada_status decode(run *own, hada_pixels *raw, hada_error *err)
{
    const double known = hada_model_get_info(own->model)->frame_encoding;
    const double encoding = own->task.frame_encoding == HADA_AUTO ? known : own->task.frame_encoding;
    if (encoding == 0.0 || encoding == HADA_RESPONSE_LINEAR)
        return HADA_OK;
    hada_image_destroy(&own->light);
    HADA_TRY(hada_pixels_copy(raw, &own->light, err));
    hada_response_convert(own->light.data, hada_image_count(&own->light), encoding, HADA_RESPONSE_LINEAR);
    hada_pixels_init(raw);
    hada_pixels_of_image(raw, &own->light);
    return HADA_OK;
}

static hada_status take_from_pipe(run *own, int *came, int *ended, hada_error *err)
{
    const hada_headerless *frames = &own->pipe.frames;
    hada_live_taken taken;
    hada_error error = {0};
    hada_pixels raw;
    char name[32];
    HADA_TRY(live_pipe_take(&own->pipe, STOP_SECONDS, &taken, err));
    own->state.passed_over = taken.passed_over;
    *came = taken.data != NULL;
    *ended = taken.ended;
    if (!taken.data)
        return HADA_OK;
    const double began = hada_seconds();
    snprintf(name, sizeof name, "frame%06ld", taken.number);
    hada_headerless_unpack(frames, taken.data, own->samples);
    hada_pixels_init(&raw);
    hada_pixels_interleaved(&raw, own->samples, frames->bits > 8 ? HADA_PIXEL_U16 : HADA_PIXEL_U8, frames->channels,
                            frames->rows, frames->cols);
    raw.full_scale = ldexp(1.0, frames->bits) - 1.0;
    hada_status status = decode(own, &raw, &error);
    status = status ? status : do_frame(own, name, &raw, 0, 1, &error);
    end_input(own);
    return after(own, name, status, began, &error, err);
}

static hada_status take_all(run *own, hada_error *err)
{
    int ended = 0;
    own->since = hada_seconds();
    while (!ended && !stops(own)) {
        int came = 0;
        HADA_TRY(own->task.folder ? take_file(own, &came, err) : take_from_pipe(own, &came, &ended, err));
        if (came)
            own->since = hada_seconds();
        if (own->task.idle_seconds > 0.0 && hada_seconds() - own->since >= own->task.idle_seconds)
            break;
    }
    return HADA_OK;
}

static hada_status begin_pipe(run *own, hada_error *err)
{
    hada_headerless frames;
    if (!hada_headerless_get(&frames))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "frames from a pipe say nothing of themselves; say how they lie with options.headerless, such "
                         "as 1520x2028:csi12");
    own->kind = (hada_tiff_info){.rows = frames.rows, .cols = frames.cols, .channels = frames.channels};
    HADA_TRY(hada_frames_check(own->plan, own->model, &own->kind, err));
    HADA_TRY(hada_allocated(own->samples = hada_alloc_raw(hada_size_product((size_t)frames.rows, (size_t)frames.cols),
                                                          2 * (size_t)frames.channels, "a frame", err)));
    return live_pipe_begin(&own->pipe, own->task.input, &frames, err);
}

static hada_status begin(run *own, const hada_live_task *task, hada_error *err)
{
    HADA_TRY(HADA_OPTIONS_TAKE(&own->task, task, hada_live_task, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&own->files, own->task.files, hada_files_task, err));
    const hada_live_task *t = &own->task;
    if (!own->plan || !own->model || (!t->folder && t->input < 0) || (t->files && !own->files.output))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_reconstruct_live: a plan, its model, a folder or a pipe are needed, and a folder for "
                         "files");
    if ((int)t->stream < HADA_LIVE_STREAM_NONE || t->stream > HADA_LIVE_STREAM_RGB24 || (t->stream && t->output < 0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.stream %d needs a file descriptor, or is none",
                         (int)t->stream);
    if (!t->files && !t->stream)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "nothing would come of the frames; name a folder with options.output, or a stream with "
                         "options.stream");
    if (t->files && t->folder && hada_path_is_same(t->folder, own->files.output))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.output is the folder of the frames, where results would be taken for frames");
    own->display.jpeg = t->stream == HADA_LIVE_STREAM_MJPEG;
    if (t->files) {
        HADA_TRY(hada_outputs_check(&own->files, err));
        HADA_TRY(hada_folder_ensure(own->files.output, err));
    }
    own->folder = (hada_live_folder){.path = t->folder, .newest_only = !t->files};
    return t->folder ? HADA_OK : begin_pipe(own, err);
}

hada_status hada_reconstruct_live(hada_plan *plan, const hada_model *model, const hada_live_task *task, hada_error *err)
{
    run own = {.plan = plan, .model = model};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(begin(&own, task, err));
    HADA_TRY_OR_DONE(take_all(&own, err));
done:
    live_pipe_end(&own.pipe);
    free_files(own.folder.files, own.folder.count);
    hada_display_end(&own.display);
    hada_result_destroy(&own.result);
    end_input(&own);
    free(own.samples);
    hada_image_destroy(&own.light);
    return status;
}
