#include "tasks/frames.h"

#include "core/callers.h"
#include "dispatch/plan.h"
#include "image/statistics.h"
#include "io/folder.h"
#include "io/tiff_page.h"
#include "planes/maker.h"

/* A job is waited for; the caller's wish to stop, which only a call can find out, is asked for this often. */
#define STOP_SECONDS 0.05

hada_status hada_stream_begin(hada_stream *stream, hada_plan *plan, const hada_model *model, const char *const *paths,
                              int count, double encoding, int ahead, const hada_monitor *monitor, hada_error *err)
{
    *stream = (hada_stream){.plan = plan,
                            .model = model,
                            .paths = paths,
                            .count = count,
                            .encoding = encoding,
                            .ahead = ahead,
                            .monitor = monitor};
    return HADA_NEW(stream->ring, (size_t)ahead, "frames in flight", err);
}

static hada_streamed *at(const hada_stream *stream, int place)
{
    return &stream->ring[(stream->first + place) % stream->ahead];
}

static void free_raw(hada_streamed *frame)
{
    free((void *)frame->raw.data);
    frame->raw.data = NULL;
}

static int stops(const hada_stream *stream)
{
    return hada_monitor_check(stream->monitor, NULL) != HADA_OK;
}

static void next_file(hada_stream *stream)
{
    hada_tiff_close(&stream->reader);
    stream->file++;
    stream->frame = 0;
}

hada_status hada_frames_check(const hada_plan *plan, const hada_model *model, const hada_tiff_info *info,
                              hada_error *err)
{
    const hada_config *config = &plan->setup.config;
    const hada_model_info *known = hada_model_get_info(model);
    const int binned = hada_is_of_sensor(known, config->kind.downsample, info->rows, info->cols);
    const hada_mosaic taken = binned ? config->kind.sensor_mosaic : config->mosaic;
    if (info->mosaic != HADA_MOSAIC_NONE && info->mosaic != taken && known->channels > 1)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the colour filter mosaic of the file is %s, and %s is expected: name it with options.mosaic",
                         hada_enum_name(HADA_ENUM_MOSAIC, (int)info->mosaic),
                         hada_enum_name(HADA_ENUM_MOSAIC, (int)taken));
    return hada_frame_check_size(known, &config->kind, info->channels, info->rows, info->cols, err);
}

hada_status hada_frames_open(hada_tiff_reader **reader, const char *path, const hada_plan *plan,
                             const hada_model *model, hada_error *err)
{
    HADA_TRY(hada_tiff_open(reader, path, err));
    hada_tiff_presume(*reader, hada_model_get_info(model)->frame_encoding);
    return hada_frames_check(plan, model, hada_tiff_get_info(*reader), err);
}

static hada_status open_file(hada_stream *stream, hada_error *err)
{
    const char *path = stream->paths[stream->file];
    if (hada_path_is_folder(path))
        return hada_fail(err, HADA_ERROR_FILE_OPEN, "a folder; name the files in it, such as %s/*.tif", path);
    return hada_frames_open(&stream->reader, path, stream->plan, stream->model, err);
}

void hada_tell_values(const hada_monitor *monitor, const char *path, const hada_tiff_reader *reader, double encoding,
                      const hada_pixels *frame)
{
    const hada_tiff_info *info = hada_tiff_get_info(reader);
    const double way = encoding == HADA_AUTO ? info->encoding : encoding;
    if (way != 0.0 && way != HADA_RESPONSE_LINEAR)
        hada_monitor_tell(monitor, HADA_MESSAGE_INFO,
                          "%s: values are encoded for displays, and made linear (options.frame_encoding)", path);
    else if (info->bits == 8 && hada_noise_estimate(frame, info->mosaic) < 1.0 / 255.0)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE,
                          "%s: steps of 8 bits are coarser than the noise; let the camera write 10 bits or more", path);
}

static hada_status read_frame(hada_stream *stream, hada_streamed *frame)
{
    hada_error *err = &frame->error;
    if (stream->given) {
        hada_image copy;
        frame->frames = 1;
        HADA_TRY(hada_image_copy(&copy, stream->given, err));
        hada_pixels_init(&frame->raw);
        hada_pixels_of_image(&frame->raw, &copy);
        return hada_job_submit_pixels(&frame->job, stream->plan, &frame->raw, &frame->result, err);
    }
    if (!stream->reader)
        HADA_TRY(open_file(stream, err));
    frame->frames = hada_tiff_get_info(stream->reader)->frames;
    HADA_TRY(hada_tiff_read_stored(stream->reader, stream->frame, stream->encoding, &frame->raw, err));
    if (!stream->file && !stream->frame)
        hada_tell_values(stream->monitor, stream->paths[0], stream->reader, stream->encoding, &frame->raw);
    return hada_job_submit_pixels(&frame->job, stream->plan, &frame->raw, &frame->result, err);
}

/* Reads a frame and hands it in. What fails is kept for its turn. */
static void read_one(hada_stream *stream)
{
    hada_streamed *frame = at(stream, stream->used++);
    frame->file = stream->file;
    frame->frame = stream->frame;
    frame->frames = 0;
    frame->status = read_frame(stream, frame);
    if (frame->status || ++stream->frame == frame->frames)
        next_file(stream);
}

static void fill(hada_stream *stream)
{
    while (stream->used < stream->ahead && stream->file < stream->count && !stops(stream)) {
        if (stream->reader && stream->file < stream->skipped)
            next_file(stream);
        else
            read_one(stream);
    }
}

static void cancel_all(hada_stream *stream)
{
    for (int i = 0; i < stream->used; i++)
        if (at(stream, i)->job)
            hada_job_cancel(at(stream, i)->job);
}

static void wait_for(hada_stream *stream, hada_streamed *frame)
{
    while (hada_job_wait_for(frame->job, STOP_SECONDS) < HADA_JOB_DONE && !stops(stream))
        ;
    if (stops(stream))
        cancel_all(stream);
    frame->status = hada_job_wait(frame->job, &frame->error);
    hada_job_destroy(&frame->job);
}

static void release(hada_stream *stream)
{
    free_raw(at(stream, 0)); /* the result keeps its memory for another frame */
    stream->first = (stream->first + 1) % stream->ahead;
    stream->used--;
    stream->handed_out = 0;
}

hada_streamed *hada_stream_next(hada_stream *stream)
{
    if (stream->handed_out)
        release(stream);
    fill(stream);
    if (!stream->used || stops(stream))
        return NULL;
    hada_streamed *frame = at(stream, 0);
    if (frame->job)
        wait_for(stream, frame);
    stream->handed_out = 1;
    return stops(stream) ? NULL : frame;
}

void hada_stream_skip(hada_stream *stream, int file)
{
    if (stream->skipped < file + 1)
        stream->skipped = file + 1;
}

void hada_stream_end(hada_stream *stream)
{
    cancel_all(stream);
    for (int i = 0; i < stream->used; i++) {
        hada_job_destroy(&at(stream, i)->job);
        free_raw(at(stream, i));
    }
    for (int i = 0; stream->ring && i < stream->ahead; i++)
        hada_result_destroy(&stream->ring[i].result);
    hada_tiff_close(&stream->reader);
    free(stream->ring);
    *stream = (hada_stream){0};
}
