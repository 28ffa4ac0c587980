#include "tasks/frames.h"

#include <hadalens/preview.h>
#include <hadalens/response.h>
#include <inttypes.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/input.h"
#include "dispatch/plan.h"
#include "io/folder.h"
#include "io/text.h"
#include "io/tiff_write.h"

/* Without an ending: that of the format. */
static const char *const names[HADA_OUTPUT_FILES] = {"stack",      "aif",     "depth",        "preview.png",
                                                     "confidence", "aif.png", "emitters.csv", "tracks.csv"};

static hada_status name_output(char **path, const hada_files_task *task, const char *name, int which, hada_error *err)
{
    const char *format = task->format == HADA_FILES_NUMPY ? ".npy" : ".tif";
    return hada_path_format(path, err, "%s/%s_%s%s", task->output, name, names[which],
                            strchr(names[which], '.') ? "" : format);
}

static const char table_words[] = "a table of emitters";
#define EMITTER_COLUMNS "frame,x,y,z,distance_mm,amplitude,sd_x,sd_y,sd_z,sd_amplitude,residual\n"

/* Drawn at once, with the first frame. */
static int is_drawn(int which)
{
    return which == HADA_OUTPUT_PREVIEW || which == HADA_OUTPUT_PICTURE;
}

static void choose_encoding(hada_outputs *out, const hada_files_task *task, double gamma)
{
    const double raised = 1.0 / gamma; /* light^gamma: light = value^(1 / gamma) */
    out->encoding = gamma != 1.0                  ? hada_response_is_known(raised) ? raised : 0.0
                    : task->encoding == HADA_AUTO ? out->scene_response
                                                  : task->encoding;
    out->convert = gamma == 1.0 && out->encoding != HADA_RESPONSE_LINEAR;
    out->shown = gamma == 1.0 ? HADA_AUTO : 1.0;
}

/* Only for the run that wants it. */
static int is_wanted(const hada_files_task *task, int which)
{
    const int draws = hada_pictures_available();
    return which == HADA_OUTPUT_PREVIEW    ? draws && task->preview
           : which == HADA_OUTPUT_PICTURE  ? draws && task->picture
           : which == HADA_OUTPUT_EMITTERS ? task->emitters
           : which == HADA_OUTPUT_TRACKS   ? task->emitters
                                           : 1;
}

/* The distance of a single depth says nothing of the scene. */
static int has_map(const hada_plan *plan)
{
    return plan->setup.config.depths > 1;
}

hada_status hada_outputs_check(const hada_files_task *task, hada_error *err)
{
    if ((int)task->format < HADA_FILES_TIFF || task->format > HADA_FILES_NUMPY)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no options.format %d", (int)task->format);
    if (task->bits != 8 && task->bits != 16 && task->bits != 32)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.bits is 8, 16 or 32, not %d", task->bits);
    if (task->format == HADA_FILES_NUMPY && task->resume)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.resume needs what TIFF files say of how they were made: leave options.format out");
    return HADA_OK;
}

hada_status hada_outputs_begin(hada_outputs *out, const hada_files_task *task, const hada_plan *plan, const char *name,
                               int frames, hada_error *err)
{
    const hada_model_info *model = hada_model_get_info(plan->setup.model);
    *out = (hada_outputs){.frames = frames,
                          .format = task->format,
                          .bits = task->bits,
                          .white = task->white,
                          .pixel_um = task->pixel_um,
                          .scene_response = model->scene_response,
                          .has_map = has_map(plan)};
    choose_encoding(out, task, plan->setup.options.gamma);
    for (int k = 0; k < HADA_OUTPUT_FILES; k++)
        if (is_wanted(task, k))
            HADA_TRY(name_output(&out->path[k], task, name, k, err));
    if (task->emitters && frames > 1)
        HADA_TRY(hada_tracker_create(&out->tracker, task->track_pixels, task->track_depths, task->track_gap, err));
    return hada_path_format(&out->title, err, "%s, %s", name, hada_name_of(model->name));
}

hada_status hada_made_from(char text[HADA_MADE_FROM], const char *frame, uint64_t model, hada_error *err)
{
    uint64_t hash = 0;
    *text = '\0';
    if (model)
        HADA_TRY(hada_file_hash(&hash, frame, err));
    if (hash)
        snprintf(text, HADA_MADE_FROM, "%016" PRIx64 "-%016" PRIx64, hash, model);
    return HADA_OK;
}

/* Millimetres and NaN need floats. */
static int is_map(int which)
{
    return which == HADA_OUTPUT_DISTANCE_MAP || which == HADA_OUTPUT_CONFIDENCE;
}

static hada_status open_array(hada_outputs *out, int which, const hada_image *first, int depths, hada_error *err)
{
    const uint64_t shape[] = {(uint64_t)out->frames, (uint64_t)depths, (uint64_t)first->rows, (uint64_t)first->cols,
                              (uint64_t)first->channels};
    const uint64_t one[] = {shape[0], shape[2], shape[3], shape[4]};
    const hada_numpy_values values = {
        .bits = is_map(which) ? 32 : out->bits, .white = out->white, .encoding = out->encoding};
    return which == HADA_OUTPUT_STACK ? hada_numpy_begin(&out->array[which], out->path[which], shape, 5, &values, err)
                                      : hada_numpy_begin(&out->array[which], out->path[which], one, 4, &values, err);
}

static hada_status open_writer(hada_outputs *out, int which, const hada_image *first, const hada_result *result,
                               hada_error *err)
{
    hada_tiff_write_options options;
    char name[HADA_RESPONSE_NAME], lines[HADA_RESPONSE_NAME + HADA_MADE_FROM + 40], *at = lines;
    size_t room = sizeof lines;
    if (out->format == HADA_FILES_NUMPY)
        return open_array(out, which, first, result->depths, err);
    hada_tiff_write_options_init(&options);
    options.bits = is_map(which) ? 32 : out->bits;
    options.scale = out->white;
    options.pixel_um = out->pixel_um;
    options.slices = 1;
    options.times = out->frames;
    if (which == HADA_OUTPUT_STACK) {
        options.layout = HADA_TIFF_HYPERSTACK;
        options.slices = result->depths;
        options.distances_mm = result->distances_mm[0] > 0.0 ? result->distances_mm : NULL; /* 0: unknown */
    }
    if (which == HADA_OUTPUT_DISTANCE_MAP) {
        at += snprintf(at, room, "unit=millimetre\n");
    } else if (!is_map(which)) {
        options.encoding = out->encoding;
        hada_response_name(name, out->scene_response);
        at += snprintf(at, room, "scene_response=%s\n", name);
    }
    *at = '\0';
    room -= (size_t)(at - lines);
    if (*out->made_from)
        snprintf(at, room, "made_from=%s\n", out->made_from);
    options.description = lines;
    return hada_tiff_create(&out->writer[which], out->path[which], first->channels, first->rows, first->cols, &options,
                            err);
}

static hada_status save_preview(const hada_outputs *out, const hada_pixels *raw, const hada_result *result,
                                hada_error *err)
{
    hada_preview preview;
    hada_image frame;
    HADA_TRY(hada_pixels_to_image(raw, &frame, err));
    hada_preview_init(&preview);
    preview.title = out->title;
    preview.raw = &frame;
    if (result->depths > 1) { /* a single one is the all-in-focus image */
        preview.planes = result->planes;
        preview.distance_map = &result->distance_map;
    }
    preview.depths = result->depths;
    preview.distances_mm = result->distances_mm;
    preview.volume = result->report->scene == HADA_SCENE_VOLUME;
    preview.occupied = preview.volume ? NULL : result->report->occupied; /* all of them */
    preview.all_in_focus = &result->all_in_focus;
    preview.gamma = out->shown;
    const hada_status status = hada_preview_save(out->path[HADA_OUTPUT_PREVIEW], &preview, err);
    hada_image_destroy(&frame);
    return status;
}

static hada_status open_all(hada_outputs *out, const hada_pixels *raw, const hada_result *result, hada_error *err)
{
    HADA_TRY(open_writer(out, HADA_OUTPUT_STACK, &result->planes[0], result, err));
    HADA_TRY(open_writer(out, HADA_OUTPUT_ALL_IN_FOCUS, &result->all_in_focus, result, err));
    if (out->has_map)
        HADA_TRY(open_writer(out, HADA_OUTPUT_DISTANCE_MAP, &result->distance_map, result, err));
    if (hada_result_confidence(result))
        HADA_TRY(open_writer(out, HADA_OUTPUT_CONFIDENCE, &result->distance_map, result, err));
    out->has_confidence = hada_result_confidence(result) != NULL;
    if (out->path[HADA_OUTPUT_PREVIEW])
        HADA_TRY(save_preview(out, raw, result, err));
    return out->path[HADA_OUTPUT_PICTURE]
               ? hada_png_save(out->path[HADA_OUTPUT_PICTURE], &result->all_in_focus, HADA_AUTO, out->shown, err)
               : HADA_OK;
}

static hada_status write_image(hada_outputs *out, int which, const hada_image *image, int is_light, hada_error *err)
{
    if (out->format == HADA_FILES_NUMPY)
        return hada_numpy_add(&out->array[which], image, is_light, err);
    return is_light ? hada_tiff_write_light(out->writer[which], image, err)
                    : hada_tiff_write(out->writer[which], image, err);
}

/* NaN for a frame that is no surface. */
static hada_status write_confidence(hada_outputs *out, const hada_result *result, hada_error *err)
{
    const hada_image *confidence = hada_result_confidence(result), *map = &result->distance_map;
    if (!confidence && !out->unknown.data) {
        HADA_TRY(hada_image_create(&out->unknown, 1, map->rows, map->cols, err));
        for (size_t i = 0; i < hada_image_count(map); i++)
            out->unknown.data[i] = NAN;
    }
    return write_image(out, HADA_OUTPUT_CONFIDENCE, confidence ? confidence : &out->unknown, 0, err);
}

static void add_emitter(hada_text *text, int frame, const hada_emitter *one)
{
    const double values[] = {one->x,    one->y,    one->z,    one->distance_mm,  one->amplitude,
                             one->sd_x, one->sd_y, one->sd_z, one->sd_amplitude, one->residual};
    hada_text_add(text, "%d", frame);
    for (size_t k = 0; k < HADA_COUNT(values); k++) {
        char number[32];
        hada_format_number(number, sizeof number, "%.7g", values[k]);
        hada_text_add(text, ",%s", number);
    }
    hada_text_add(text, "\n");
}

/* Empties the text. */
static hada_status write_text(hada_outfile *table, hada_text *text, hada_error *err)
{
    hada_status status = HADA_OK;
    if (text->failed)
        status = hada_fail(err, HADA_ERROR_MEMORY, "no memory for %s", table_words);
    else if (text->length)
        status = hada_outfile_write(table, text->data, text->length, err);
    free(text->data);
    *text = (hada_text){0};
    return status;
}

/* A line for each emitter; those of all frames follow each other. */
static hada_status write_emitters(hada_outputs *out, const hada_emitters *emitters, hada_error *err)
{
    hada_text text = {0};
    if (!out->has_table) {
        HADA_TRY(hada_outfile_open(&out->table, out->path[HADA_OUTPUT_EMITTERS], err));
        out->has_table = 1;
        hada_text_add(&text, EMITTER_COLUMNS);
    }
    for (int i = 0; i < emitters->count; i++)
        add_emitter(&text, out->written - 1, emitters->list[i]);
    return write_text(&out->table, &text, err);
}

static hada_status track_emitters(hada_outputs *out, const hada_emitters *emitters, hada_error *err)
{
    const int count = emitters->count;
    int *tracks = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(HADA_GROW(out->tracked, out->tracked_count, (size_t)count, table_words, err));
    HADA_TRY(HADA_NEW(tracks, (size_t)count + 1, table_words, err));
    HADA_TRY_OR_DONE(hada_tracker_add(out->tracker, emitters->list, count, tracks, err));
    for (int i = 0; i < count; i++) {
        out->tracked[out->tracked_count++] = (hada_tracked){tracks[i], out->written - 1, *emitters->list[i]};
        out->tracks = tracks[i] < out->tracks ? out->tracks : tracks[i] + 1;
    }
done:
    free(tracks);
    return status;
}

static int by_track(const void *a, const void *b)
{
    const hada_tracked *one = a, *other = b;
    const int order = (one->track > other->track) - (one->track < other->track);
    return order ? order : (one->frame > other->frame) - (one->frame < other->frame);
}

/* A line for each emitter, track by track. */
static hada_status write_tracks(hada_outputs *out, hada_error *err)
{
    enum { AT_ONCE = 1 << 16 };
    hada_outfile table;
    hada_text text = {0};
    hada_status status = HADA_OK;
    if (out->tracked_count)
        qsort(out->tracked, out->tracked_count, sizeof *out->tracked, by_track);
    HADA_TRY(hada_outfile_open(&table, out->path[HADA_OUTPUT_TRACKS], err));
    hada_text_add(&text, "track," EMITTER_COLUMNS);
    for (size_t i = 0; i < out->tracked_count; i++) {
        hada_text_add(&text, "%d,", out->tracked[i].track);
        add_emitter(&text, out->tracked[i].frame, &out->tracked[i].emitter);
        if (text.length > AT_ONCE)
            HADA_TRY_OR_DONE(write_text(&table, &text, err));
    }
    HADA_TRY_OR_DONE(write_text(&table, &text, err));
    return hada_outfile_commit(&table, err);
done:
    hada_outfile_abandon(&table);
    return status;
}

hada_status hada_outputs_add(hada_outputs *out, const hada_pixels *raw, const hada_result *result,
                             const hada_emitters *emitters, hada_error *err)
{
    if (!out->written++)
        HADA_TRY(open_all(out, raw, result, err));
    for (int z = 0; z < result->depths; z++)
        HADA_TRY(write_image(out, HADA_OUTPUT_STACK, &result->planes[z], out->convert, err));
    HADA_TRY(write_image(out, HADA_OUTPUT_ALL_IN_FOCUS, &result->all_in_focus, out->convert, err));
    if (out->has_map)
        HADA_TRY(write_image(out, HADA_OUTPUT_DISTANCE_MAP, &result->distance_map, 0, err));
    if (out->has_confidence)
        HADA_TRY(write_confidence(out, result, err));
    if (emitters)
        HADA_TRY(write_emitters(out, emitters, err));
    return emitters && out->tracker ? track_emitters(out, emitters, err) : HADA_OK;
}

hada_status hada_outputs_finish(hada_outputs *out, hada_error *err)
{
    hada_status status = HADA_OK;
    int next = HADA_OUTPUT_FILES - 1;
    for (; next >= 0; next--) {
        HADA_TRY_OR_DONE(hada_numpy_finish(&out->array[next], err));
        if (out->writer[next])
            HADA_TRY_OR_DONE(hada_tiff_finish(&out->writer[next], err));
    }
    if (out->has_table) {
        out->has_table = 0; /* the record is emptied either way */
        HADA_TRY_OR_DONE(hada_outfile_commit(&out->table, err));
    }
    if (out->tracker)
        HADA_TRY_OR_DONE(write_tracks(out, err));
    out->finished = 1;
    if (!out->has_confidence)
        hada_outfile_remove(out->path[HADA_OUTPUT_CONFIDENCE]); /* of a run before */
    if (!out->has_map)
        hada_outfile_remove(out->path[HADA_OUTPUT_DISTANCE_MAP]);
    if (!out->tracker && out->path[HADA_OUTPUT_TRACKS])
        hada_outfile_remove(out->path[HADA_OUTPUT_TRACKS]);
done:
    for (int k = next + 1; status && k < HADA_OUTPUT_FILES; k++)
        if (!is_drawn(k) && out->path[k])
            hada_outfile_remove(out->path[k]);
    return status;
}

static int is_older(const char *path, const char *than)
{
    struct stat one, other;
    if (stat(than, &other))
        return 0; /* a model that was never a file, say */
    return stat(path, &one) || one.st_mtim.tv_sec < other.st_mtim.tv_sec ||
           (one.st_mtim.tv_sec == other.st_mtim.tv_sec && one.st_mtim.tv_nsec < other.st_mtim.tv_nsec);
}

/* Results of versions that did not say it may be of anything. */
static int is_made_from(const char *description, const char *made_from)
{
    const char *said = hada_text_line(description, "made_from");
    return !said || !*made_from || !strncmp(said, made_from, strlen(made_from));
}

/* Opens a result and reads the last of its images; *images: how many. */
static int is_whole(const char *path, const char *made_from, int channels, int rows, int cols, int *images)
{
    hada_tiff_reader *reader = NULL;
    hada_image last = {0};
    int whole = 0;
    if (!hada_tiff_open(&reader, path, NULL)) {
        const hada_tiff_info *info = hada_tiff_get_info(reader);
        *images = info->frames;
        whole = is_made_from(info->description, made_from) && !hada_tiff_read(reader, info->frames - 1, &last, NULL) &&
                last.channels == channels && last.rows == rows && last.cols == cols;
    }
    hada_image_destroy(&last);
    hada_tiff_close(&reader);
    return whole;
}

int hada_outputs_are_there(const hada_files_task *task, const hada_plan *plan, const char *name, const char *path,
                           uint64_t model)
{
    static const hada_output needed[] = {HADA_OUTPUT_STACK, HADA_OUTPUT_ALL_IN_FOCUS, HADA_OUTPUT_DISTANCE_MAP};
    const hada_model_info *info = hada_model_get_info(plan->setup.model);
    const size_t count = HADA_COUNT(needed) - !has_map(plan);
    int there = 1, images[HADA_COUNT(needed)] = {0};
    char made_from[HADA_MADE_FROM];
    if (hada_made_from(made_from, path, model, NULL))
        return 0;
    for (size_t k = 0; there && k < count; k++) {
        char *result = NULL;
        there = !name_output(&result, task, name, (int)needed[k], NULL) && hada_path_is_file(result) &&
                !is_older(result, path) && !is_older(result, info->name) &&
                is_whole(result, made_from, needed[k] == HADA_OUTPUT_DISTANCE_MAP ? 1 : info->channels,
                         info->window_rows, info->window_cols, &images[k]) &&
                images[k] == (k ? images[0] / plan->setup.config.depths : images[0]) &&
                images[0] % plan->setup.config.depths == 0;
        free(result);
    }
    for (int k = HADA_OUTPUT_EMITTERS; there && task->emitters && k <= HADA_OUTPUT_TRACKS; k++) {
        char *table = NULL;
        there = !name_output(&table, task, name, k, NULL) && hada_path_is_file(table) && !is_older(table, path) &&
                !is_older(table, info->name);
        free(table);
        if (images[0] == plan->setup.config.depths) /* a single frame has no tracks */
            break;
    }
    return there;
}

void hada_outputs_end(hada_outputs *out)
{
    for (int k = 0; k < HADA_OUTPUT_FILES; k++) {
        hada_numpy_abandon(&out->array[k]);
        if (out->writer[k])
            hada_tiff_abandon(&out->writer[k]);
    }
    if (out->has_table)
        hada_outfile_abandon(&out->table);
    for (int k = 0; k < HADA_OUTPUT_FILES; k++) {
        if (is_drawn(k) && out->path[k] && out->written && !out->finished)
            hada_outfile_remove(out->path[k]);
        free(out->path[k]);
    }
    HADA_FREE(out->title, out->tracked);
    hada_tracker_destroy(&out->tracker);
    hada_image_destroy(&out->unknown);
    *out = (hada_outputs){0};
}
