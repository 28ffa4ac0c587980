/* Frames as they come: taken from where they come from, reconstructed, written, shown. */
#include <errno.h>
#include <hadalens/task_live.h>
#include <unistd.h>

#include "core/callers.h"
#include "core/clock.h"
#include "dispatch/plan.h"
#include "io/folder.h"
#include "io/tiff_page.h"
#include "picture/tone.h"
#include "tasks/frames.h"
#include "tasks/live.h"

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

static hada_status open_file(const run *own, const char *path, hada_tiff_reader **reader, hada_error *err)
{
    HADA_TRY(hada_tiff_open(reader, path, err));
    return hada_frames_check(own->plan, own->model, hada_tiff_get_info(*reader), err);
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
    hada_status status = open_file(own, path, &reader, &error), ends = HADA_OK;
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
    HADA_TRY(hada_live_folder_take(&own->folder, STOP_SECONDS, &file, err));
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

static hada_status take_from_pipe(run *own, int *came, int *ended, hada_error *err)
{
    const hada_headerless *frames = &own->pipe.frames;
    hada_live_taken taken;
    hada_error error = {0};
    hada_pixels raw;
    char name[32];
    HADA_TRY(hada_live_pipe_take(&own->pipe, STOP_SECONDS, &taken, err));
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
    const hada_status status = do_frame(own, name, &raw, 0, 1, &error);
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
    return hada_live_pipe_begin(&own->pipe, own->task.input, &frames, err);
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
    hada_live_pipe_end(&own.pipe);
    hada_live_folder_end(&own.folder);
    hada_display_end(&own.display);
    hada_result_destroy(&own.result);
    end_input(&own);
    free(own.samples);
    return status;
}
