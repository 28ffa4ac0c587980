#include "frame_stream.h"
#include "folder.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

hada_status hada_cli_stream_begin(hada_cli_stream *stream, hada_plan *plan, const char **paths, int count, int ahead,
                                  hada_cli_frame_check check, void *user, hada_error *err)
{
    *stream =
        (hada_cli_stream){.plan = plan, .paths = paths, .count = count, .ahead = ahead, .check = check, .user = user};
    stream->ring = calloc((size_t)ahead, sizeof *stream->ring);
    return stream->ring ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
}

static hada_cli_frame *at(const hada_cli_stream *stream, int place)
{
    return &stream->ring[(stream->first + place) % stream->ahead];
}

static void next_file(hada_cli_stream *stream)
{
    hada_tiff_close(&stream->reader);
    stream->file++;
    stream->frame = 0;
}

static hada_status open_file(hada_cli_stream *stream, hada_error *err)
{
    const char *path = stream->paths[stream->file];
    if (hada_path_is_folder(path))
        return hada_cli_error(err, HADA_ERROR_FILE_OPEN, "a folder; name the files in it, such as %s/*.tif", path);
    hada_status status = hada_tiff_open(&stream->reader, path, err);
    return status ? status : stream->check(stream->user, hada_tiff_get_info(stream->reader), err);
}

/* Reads a frame and hands it in. What fails is kept for its turn. */
static void read_one(hada_cli_stream *stream)
{
    hada_cli_frame *frame = at(stream, stream->used++);
    frame->file = stream->file;
    frame->frame = stream->frame;
    frame->frames = 0;
    frame->status = stream->reader ? HADA_OK : open_file(stream, &frame->error);
    if (!frame->status) {
        frame->frames = hada_tiff_get_info(stream->reader)->frames;
        frame->status = hada_tiff_read(stream->reader, stream->frame, &frame->raw, &frame->error);
    }
    if (!frame->status)
        frame->status = hada_job_submit(&frame->job, stream->plan, &frame->raw, &frame->result, &frame->error);
    if (frame->status || ++stream->frame == frame->frames)
        next_file(stream);
}

static void fill(hada_cli_stream *stream)
{
    while (stream->used < stream->ahead && stream->file < stream->count && !hada_cli_interrupted()) {
        if (stream->reader && stream->file < stream->skipped)
            next_file(stream);
        else
            read_one(stream);
    }
}

static void cancel_all(hada_cli_stream *stream)
{
    for (int i = 0; i < stream->used; i++)
        if (at(stream, i)->job)
            hada_job_cancel(at(stream, i)->job);
}

/* Looks now and then, since a signal must be noticed; the queues have other frames to do meanwhile. */
static void wait_for(hada_cli_stream *stream, hada_cli_frame *frame)
{
    const struct timespec while_ = {.tv_nsec = 300000};
    while (hada_job_poll(frame->job) < HADA_JOB_DONE && !hada_cli_interrupted())
        nanosleep(&while_, NULL);
    if (hada_cli_interrupted())
        cancel_all(stream);
    frame->status = hada_job_wait(frame->job, &frame->error);
    hada_job_destroy(&frame->job);
}

static void release(hada_cli_stream *stream)
{
    hada_image_destroy(&at(stream, 0)->raw); /* the result keeps its memory for another frame */
    stream->first = (stream->first + 1) % stream->ahead;
    stream->used--;
    stream->handed_out = 0;
}

hada_cli_frame *hada_cli_stream_next(hada_cli_stream *stream)
{
    if (stream->handed_out)
        release(stream);
    fill(stream);
    if (!stream->used || hada_cli_interrupted())
        return NULL;
    hada_cli_frame *frame = at(stream, 0);
    if (frame->job)
        wait_for(stream, frame);
    stream->handed_out = 1;
    return hada_cli_interrupted() ? NULL : frame;
}

void hada_cli_stream_skip(hada_cli_stream *stream, int file)
{
    if (stream->skipped < file + 1)
        stream->skipped = file + 1;
}

void hada_cli_stream_end(hada_cli_stream *stream)
{
    cancel_all(stream);
    for (int i = 0; i < stream->used; i++) {
        hada_job_destroy(&at(stream, i)->job);
        hada_image_destroy(&at(stream, i)->raw);
    }
    for (int i = 0; stream->ring && i < stream->ahead; i++)
        hada_result_destroy(&stream->ring[i].result);
    hada_tiff_close(&stream->reader);
    free(stream->ring);
    *stream = (hada_cli_stream){0};
}
