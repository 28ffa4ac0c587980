/* Files through a plan: whose turn it is, what is written, what failed. */
#include <hadalens/response.h>
#include <hadalens/task_reconstruct.h>

#include "core/callers.h"
#include "core/input.h"
#include "dispatch/plan.h"
#include "io/folder.h"
#include "io/tiff_page.h"
#include "model/model.h"
#include "tasks/frames.h"

/* Files of exposures of one scene. */

/* A pixel without light that reads less is as good as dark. */
#define DARK 0.002

typedef struct exposures {
    hada_image *image;
    int count;
} exposures;

/* All pages of a file. */
static hada_status add(exposures *all, const char *path, double encoding, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_tiff_open(&reader, path, err));
    const int pages = hada_tiff_get_info(reader)->frames;
    HADA_TRY_OR_DONE(hada_tiff_check_all(reader, err));
    HADA_TRY_OR_DONE(HADA_GROW(all->image, (size_t)all->count, (size_t)pages, "exposures", err));
    for (int page = 0; page < pages; page++) {
        HADA_TRY_OR_DONE(hada_tiff_read_light(reader, page, encoding, &all->image[all->count], err));
        all->count++;
    }
done:
    hada_tiff_close(&reader);
    return status;
}

hada_status hada_exposures_load(hada_image *frame, hada_image *weights, const char *const *paths, int count,
                                double encoding, hada_mosaic mosaic, const hada_monitor *monitor, hada_error *err)
{
    HADA_NEED(frame && weights && paths, err);
    exposures all = {0};
    double *scales = NULL, dark;
    hada_status status = HADA_OK;
    *frame = *weights = (hada_image){0};
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(add(&all, paths[i], encoding, err));
    HADA_TRY_OR_DONE(HADA_NEW(scales, (size_t)all.count + 1, "a bracket", err));
    HADA_TRY_OR_DONE(hada_image_merge_exposures(frame, weights, all.image, all.count, mosaic, scales, &dark, err));
    for (int k = 0; k < all.count; k++)
        hada_monitor_tell(monitor, HADA_MESSAGE_INFO, "exposure %d is %.4g times the shortest", k + 1, scales[k]);
    if (fabs(dark) > DARK)
        hada_monitor_tell(monitor, HADA_MESSAGE_INFO,
                          "without light the exposures read %.3g, which is the dark level to take off", dark);
done:
    for (int k = 0; k < all.count; k++)
        hada_image_destroy(&all.image[k]);
    HADA_FREE(all.image, scales);
    return status;
}

/* A run over all files, and the file whose results are being written. */
typedef struct run {
    hada_files_task task;
    hada_plan *plan;
    const hada_model *model;
    double gamma;        /* of the plan */
    uint64_t model_hash; /* of its file; 0: it was never one */
    const char *const *paths;
    int count;
    char **names;      /* of the results of each file */
    int *todo;         /* indices of the files that are to be done here */
    const char **here; /* and their paths */
    int here_count;
    hada_stream stream;
    hada_outputs out;
    hada_files_state state;
    int open;                /* a file's turn has begun */
    hada_emitters *emitters; /* of the frame at hand */
    int matched;             /* a frame was compared with the camera */
    hada_match match;
    int failed;
    hada_progress progress;
} run;

int hada_files_ahead(const hada_plan *plan)
{
    return plan ? hada_plan_queues(plan, NULL, 0) + 2 : 0;
}

static void tell(run *own, hada_files_event event, const hada_streamed *frame)
{
    hada_files_state *state = &own->state;
    state->event = event;
    if (frame) {
        state->file = own->todo[frame->file];
        state->path = own->here[frame->file];
        state->name = own->names[state->file];
        state->frames = frame->frames;
        state->frame = frame->frame;
        state->result = &frame->result;
    }
    if (own->task.tell)
        own->task.tell(own->task.user, state);
    state->result = NULL;
    state->match = NULL;
}

/* Two inputs must not write the same files. */
static hada_status make_names(run *own, hada_error *err)
{
    HADA_TRY(HADA_NEW(own->names, (size_t)own->count, "the names of files", err));
    for (int i = 0; i < own->count; i++) {
        HADA_TRY(hada_path_stem(&own->names[i], own->paths[i], err));
        for (int k = 0; k < i; k++)
            if (!strcmp(own->names[i], own->names[k]))
                HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                                   "%s and %s would both write %s_stack.tif; reconstruct them into different folders",
                                   own->paths[k], own->paths[i], own->names[i]));
    }
    return HADA_OK;
}

/* What is this rank's to do: the files are dealt out before it is known which are done, so that ranks agree. */
static hada_status choose_files(run *own, hada_error *err)
{
    hada_communicator ranks;
    hada_communicator_init(&ranks);
    HADA_TRY(hada_communicator_check(own->task.communicator, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&ranks, own->task.communicator, hada_communicator, err));
    own->task.communicator = NULL;
    if (hada_rank(&ranks) && own->task.match == HADA_FILES_MATCH_FIRST)
        own->task.match = HADA_FILES_MATCH_NONE; /* one of them looks */
    HADA_TRY(HADA_NEW(own->todo, (size_t)own->count, "the files", err));
    HADA_TRY(HADA_NEW(own->here, (size_t)own->count, "the files", err));
    for (int i = 0; i < own->count; i++) {
        if (!hada_is_mine(&ranks, i))
            continue;
        own->todo[own->here_count] = i;
        own->here[own->here_count] = own->paths[i];
        HADA_TRY(hada_monitor_check(own->task.monitor, err));
        if (own->task.resume &&
            hada_outputs_are_there(&own->task, own->plan, own->names[i], own->paths[i], own->model_hash))
            tell(own, HADA_FILES_THERE, &(hada_streamed){.file = own->here_count});
        else
            own->here_count++;
    }
    return HADA_OK;
}

static hada_status begin_file(run *own, const hada_streamed *frame, hada_error *err)
{
    hada_status status = HADA_OK;
    own->open = 1;
    memset(own->state.outputs, 0, sizeof own->state.outputs);
    own->state.confidence = own->state.picture = own->state.emitters_table = own->state.tracks_table = NULL;
    if (frame->frames) {
        own->progress.total += frame->frames - 1;
        status = hada_outputs_begin(&own->out, &own->task, own->plan, own->names[own->todo[frame->file]], frame->frames,
                                    err);
        if (!own->task.frame && !status) /* one that is given may be made of several files */
            status = hada_made_from(own->out.made_from, own->here[frame->file], own->model_hash, err);
    }
    for (int k = 0; k < HADA_OUTPUTS; k++)
        own->state.outputs[k] = k != HADA_OUTPUT_DISTANCE_MAP || own->out.has_map ? own->out.path[k] : NULL;
    tell(own, HADA_FILES_BEGINS, frame);
    return status;
}

static void leave_file(run *own)
{
    hada_outputs_end(&own->out);
    own->open = 0;
}

static void fail_file(run *own, const hada_streamed *frame, hada_error *err)
{
    if (frame->frames > 1)
        hada_error_prefix(err, "frame %d of %d: ", frame->frame + 1, frame->frames);
    hada_error_prefix_path(err, own->here[frame->file]);
    own->failed++;
    own->state.error = err;
    tell(own, HADA_FILES_FAILED, frame);
    hada_stream_skip(&own->stream, frame->file);
    leave_file(own);
}

static void tell_match(const run *own, const char *name)
{
    static const char *const turns[] = {"", "mirrored left to right", "flipped top to bottom", "turned by 180 degrees"};
    static const char *const values[] = {"none", "mirror", "flip", "180"};
    const hada_monitor *monitor = own->task.monitor;
    const hada_match *match = &own->match;
    if (match->verdict == HADA_MATCH_TURNED && own->model->scene_power)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE,
                          "%s: the camera %s explains the frame %.2g times better; turn the frames as those of the "
                          "pairs were, or learn the camera from pairs that lie as the frames do",
                          name, turns[match->turn], match->factor);
    else if (match->verdict == HADA_MATCH_TURNED)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE,
                          "%s: the point spread function %s explains the frame %.2g times better; make the model again "
                          "with options.turn %s",
                          name, turns[match->turn], match->factor, values[match->turn]);
    else if (match->verdict == HADA_MATCH_MAGNIFIED)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE,
                          "%s: the point spread function magnified by %.2f explains the frame %.2g times better; check "
                          "whether it was taken at the distance of the scene, and not scaled",
                          name, match->magnification, match->factor);
    else if (match->verdict == HADA_MATCH_UNRELATED)
        hada_monitor_tell(
            monitor, HADA_MESSAGE_NOTE,
            "%s: the camera explains the frame no better than any other would; check that the model is of "
            "the camera, the mask and the size of pixels that took the frame",
            name);
}

/* Compares a frame with the camera, if it is one of those that are. A comparison that fails is no failure of the
 * frame. */
static void match_frame(run *own, const hada_streamed *frame)
{
    hada_error error = {0};
    if (frame->frame || own->task.match == HADA_FILES_MATCH_NONE ||
        (own->task.match == HADA_FILES_MATCH_FIRST && (own->matched || !own->plan->setup.config.joint)))
        return;
    own->matched = 1;
    own->match = (hada_match){.size = sizeof own->match};
    if (hada_plan_match(own->plan, &frame->raw, &own->match, &error)) {
        hada_monitor_tell(own->task.monitor, HADA_MESSAGE_DETAIL,
                          "whether the camera belongs to the frame is not known: %s", error.message);
        return;
    }
    own->state.match = &own->match;
    tell_match(own, own->names[own->todo[frame->file]]);
}

/* Writes a frame, the file's last one with all that ends a file. */
static hada_status take_frame(run *own, hada_streamed *frame, hada_error *err)
{
    if (!own->open)
        HADA_TRY(begin_file(own, frame, err));
    *err = frame->error;
    HADA_TRY(frame->status);
    if (own->task.emitters)
        HADA_TRY(hada_plan_emitters(&own->emitters, own->plan, &frame->raw, &frame->result, own->task.monitor, err));
    HADA_TRY(hada_outputs_add(&own->out, &frame->raw, &frame->result, own->emitters, err));
    own->state.emitters = own->emitters;
    match_frame(own, frame);
    tell(own, HADA_FILES_FRAME, frame);
    if (frame->frame == frame->frames - 1) {
        HADA_TRY(hada_outputs_finish(&own->out, err));
        own->state.confidence = own->out.has_confidence ? own->out.path[HADA_OUTPUT_CONFIDENCE] : NULL;
        own->state.picture = own->out.path[HADA_OUTPUT_PICTURE];
        own->state.emitters_table = own->out.path[HADA_OUTPUT_EMITTERS];
        own->state.tracks_table = own->out.tracker ? own->out.path[HADA_OUTPUT_TRACKS] : NULL;
        own->state.tracks = own->out.tracks;
        tell(own, HADA_FILES_DONE, frame);
        leave_file(own);
    }
    return HADA_OK;
}

static void take_all(run *own)
{
    int bad = -1; /* the file that failed last: its other frames in flight are passed over */
    for (hada_streamed *frame; (frame = hada_stream_next(&own->stream));) {
        hada_error error = {0};
        if (frame->file == bad)
            continue;
        const hada_status status = take_frame(own, frame, &error);
        hada_memory_destroy(&own->emitters);
        own->state.emitters = NULL;
        (void)hada_progress_step(&own->progress, NULL, NULL); /* the stream itself heeds the wish to stop */
        if (status) {
            fail_file(own, frame, &error);
            bad = frame->file;
        }
    }
}

/* The caller's wish to stop came in the midst of a sequence. */
static void break_off(run *own)
{
    hada_error error = {0};
    hada_monitor_check(own->task.monitor, &error);
    own->state.error = &error;
    tell(own, HADA_FILES_FAILED, NULL);
    leave_file(own);
}

static hada_status check_encoding(const run *own, hada_error *err)
{
    const double encoding = own->task.encoding;
    if (encoding == HADA_AUTO)
        return HADA_OK;
    if (!hada_response_is_known(encoding))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.encoding: %g is no response (hadalens/response.h)",
                         encoding);
    if (own->gamma != 1.0)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.encoding: the plan's gamma %g is an encoding already; leave one of the two out",
                         own->gamma);
    return HADA_OK;
}

hada_status hada_reconstruct_files(hada_plan *plan, const hada_model *model, const char *const *paths, int count,
                                   const hada_files_task *task, int *failed, hada_error *err)
{
    run own = {.plan = plan, .model = model, .paths = paths, .count = count};
    hada_inputs *inputs = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&own.task, task, hada_files_task, err));
    if ((int)own.task.match < HADA_FILES_MATCH_NONE || own.task.match > HADA_FILES_MATCH_EACH)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT, "there is no options.match %d", (int)own.task.match));
    if (!plan || !model || !paths || !own.task.output)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT,
                                   "hada_reconstruct_files: a plan, its model, files and a folder are needed"));
    if (!(own.task.pixel_um >= 0.0 && own.task.pixel_um < INFINITY))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT,
                                   "options.pixel_um: a pixel is 0 micrometres or more, not %g", own.task.pixel_um));
    if (own.task.frame && count != 1)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT, "options.frame goes with one path, not with %d", count));
    HADA_TRY_OR_DONE(hada_outputs_check(&own.task, err));
    own.gamma = plan->setup.options.gamma;
    HADA_TRY_OR_DONE(check_encoding(&own, err));
    HADA_TRY_OR_DONE(make_names(&own, err));
    HADA_TRY_OR_DONE(hada_inputs_protect(&inputs, paths, (size_t)count, err));
    HADA_TRY_OR_DONE(hada_folder_ensure(own.task.output, err));
    const char *name = hada_model_get_info(model)->name;
    HADA_TRY_OR_DONE(hada_named(hada_file_hash(&own.model_hash, name, err), name, err));
    HADA_TRY_OR_DONE(choose_files(&own, err));
    HADA_TRY_OR_DONE(hada_stream_begin(&own.stream, plan, model, own.here, own.here_count, own.task.frame_encoding,
                                       hada_files_ahead(plan), own.task.monitor, err));
    own.stream.given = own.task.frame;
    own.progress = hada_progress_begin(own.task.monitor, "frames", own.here_count);
    take_all(&own);
    if (own.open)
        break_off(&own);
    hada_progress_end(&own.progress);
    HADA_TRY_OR_DONE(hada_monitor_check(own.task.monitor, err));
done:
    if (failed)
        *failed = own.failed;
    hada_stream_end(&own.stream);
    hada_inputs_release(&inputs);
    for (int i = 0; own.names && i < count; i++)
        free(own.names[i]);
    HADA_FREE(own.names, own.todo, own.here);
    return status;
}
