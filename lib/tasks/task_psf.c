/* A camera from its point spread functions: finds and reads them, and says what is wrong with them. */
#include <hadalens/task_fit.h>
#include <hadalens/tiff.h>

#include "core/callers.h"
#include "core/input.h"
#include "filter/psf.h"
#include "fit/psf_depths.h"
#include "image/correct.h"
#include "image/pixels.h"
#include "image/statistics.h"
#include "io/folder.h"
#include "io/positions.h"
#include "io/text.h"
#include "io/tiff_page.h"
#include "model/model.h"
#include "tasks/fit_steps.h"
#include "tasks/frames.h"

/* Bytes of a list of distances. */
#define LIST_BYTES ((size_t)1 << 16)
/* Notes appear where more than this share of the light is cut off, and where a pixel at the border has more than this
 * share of a mean one's: where light ends at the border for good it has less than a hundredth. */
#define LOST   0.005
#define BORDER 0.1
/* And where more than this share is in pixels at white, which costs 0.1 to 0.6 dB (perf/psf_files.py). */
#define WHITE 0.02
/* More noise than this, of the brightest pixel, costs 0.05 to 0.34 dB (perf/psf_files.py). */
#define NOISY 0.001
/* And where its middle is farther from the axis than this part of the window: that of random lenses is a tenth. */
#define ASIDE 0.25
/* Captures of one depth: alike, and moved by so many pixels at most. */
#define ALIKE 0.8
#define MOVED 0.5
/* And where a stack of so many depths wanders by more pixels. */
enum { LEAST_STACK = 4 };
#define WANDERS 0.5

typedef struct capture {
    char *path;
    double distance; /* below 0: its name says none */
} capture;

typedef struct psfs {
    const hada_psf_task *task;
    const char *path;
    hada_psf_options options;
    int times;        /* by which pages are binned; 1: they are not */
    hada_image flat;  /* sensitivity of the camera's pixels; empty: all alike */
    int grey, colour; /* what a frame says of channels */
    int spread;       /* a grey one became one of three channels */
    int filled;       /* a mosaic became three channels */
    capture *capture;
    int captures, stack; /* stack: one file, whose pages are depths */
    int count, every;    /* every: of `all` depths, each so many-th is taken */
    int all;
    hada_image *image;
    double *distances_mm;
    double *list; /* of the file beside */
    int listed;
    hada_positions points; /* where they were taken in the field; images are [depth][position] then */
    int positions;
    double white, at_white; /* of the page with most pixels at white: what they hold, and their share */
    int worst, unlike;      /* its image; 1: captures of a depth are unlike one another, which was noted */
    double *rows, *cols;    /* of each image, from its middle */
} psfs;

static hada_status add_capture(psfs *of, double distance, const char *folder, const char *name, hada_error *err)
{
    HADA_TRY(HADA_GROW(of->capture, (size_t)of->captures, 1, "the names of point spread functions", err));
    capture *more = &of->capture[of->captures];
    *more = (capture){.distance = distance};
    HADA_TRY(hada_path_format(&more->path, err, folder ? "%s/%s" : "%s%s", folder ? folder : "", name));
    of->captures++;
    return HADA_OK;
}

/* The pictures of a folder; distance below 0: what their names say. */
static hada_status add_folder(psfs *of, double distance, const char *folder, hada_error *err)
{
    char **names;
    int count;
    const char *rest;
    hada_status status = HADA_OK;
    HADA_TRY(hada_folder_list_tiffs(folder, &names, &count, err));
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(
            add_capture(of, distance < 0.0 ? hada_name_distance(names[i], &rest) : distance, folder, names[i], err));
done:
    hada_names_free(&names, &count);
    return status;
}

static hada_status add_depth_folders(psfs *of, const char *folder, hada_error *err)
{
    char **names;
    int count;
    const char *rest;
    hada_status status = HADA_OK;
    HADA_TRY(hada_folder_list_depths(folder, "folder", &names, &count, err));
    for (int i = 0; i < count; i++) {
        hada_path path;
        HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/%s", folder, names[i]));
        HADA_TRY_OR_DONE(add_folder(of, hada_name_distance(names[i], &rest), path, err));
    }
done:
    hada_names_free(&names, &count);
    return status;
}

static int by_distance(const void *a, const void *b)
{
    const capture *one = a, *two = b;
    const int order = (one->distance > two->distance) - (one->distance < two->distance);
    return order ? order : strcmp(one->path, two->path);
}

static hada_status find_captures(psfs *of, hada_error *err)
{
    const int folder = hada_path_is_folder(of->path);
    if (folder) {
        HADA_TRY(add_depth_folders(of, of->path, err));
        if (!of->captures)
            HADA_TRY(add_folder(of, -1.0, of->path, err));
        if (!of->captures)
            return hada_fail(err, HADA_ERROR_FILE_OPEN,
                             "%s holds no pictures; put point spread functions there, or into folders of it that are "
                             "named by their distance, such as %s/z100mm",
                             of->path, of->path);
    } else {
        HADA_TRY(add_capture(of, -1.0, NULL, of->path, err));
    }
    for (int i = 0; i < of->task->more_count; i++)
        HADA_TRY(add_capture(of, -1.0, NULL, of->task->more[i], err));
    for (int i = 0; i < of->captures && !folder; i++) {
        const char *rest;
        of->capture[i].distance = hada_name_distance(hada_name_of(of->capture[i].path), &rest);
    }
    of->stack = !folder && of->captures == 1;
    qsort(of->capture, (size_t)of->captures, sizeof *of->capture, by_distance);
    if (of->capture[0].distance < 0.0 && of->capture[of->captures - 1].distance >= 0.0)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%s does not say its distance, and %s does; name all of them so, or none", of->capture[0].path,
                         of->capture[of->captures - 1].path);
    return HADA_OK;
}

/* The list of distances beside, where there is one: numbers in millimetres, with blanks or commas between them. */
static hada_status read_list(psfs *of, hada_error *err)
{
    hada_path path;
    char *text = NULL;
    size_t bytes;
    int there, room = 0;
    hada_status status = HADA_OK;
    if (hada_path_is_folder(of->path))
        HADA_TRY(hada_path_write(path, err, "%s/distances.txt", of->path));
    else
        HADA_TRY(hada_path_write(path, err, "%.*s.txt", (int)hada_name_stem(of->path), of->path));
    HADA_TRY(hada_path_finds_file(path, &there, err));
    if (!there)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_named(hada_input_read(&text, &bytes, path, LIST_BYTES, NULL, err), path, err));
    room = (int)(bytes / 2 + 1);
    HADA_TRY_OR_DONE(HADA_NEW(of->list, (size_t)room, "distances", err));
    for (const char *at = text, *end;; at = end) {
        at += strspn(at, " \t\r\n,;");
        if (!*at)
            break;
        const double value = hada_text_number(at, &end);
        if (end == at || !(value > (of->listed ? of->list[of->listed - 1] : 0.0)) || !isfinite(value))
            HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_FORMAT,
                                       "%s: number %d is no distance; the file holds distances in mm, above 0, from "
                                       "near to far",
                                       path, of->listed + 1));
        end += strncmp(end, "mm", 2) ? 0 : 2;
        of->list[of->listed++] = value;
    }
done:
    free(text);
    return status;
}

/* The list of positions, where there is one: the file itself, or positions.csv in the folder. */
static hada_status find_positions(const psfs *of, hada_path list, int *found, hada_error *err)
{
    const char *dot = strrchr(of->path, '.');
    *found = 0;
    if (hada_path_is_folder(of->path)) {
        HADA_TRY(hada_path_write(list, err, "%s/positions.csv", of->path));
        return hada_path_finds_file(list, found, err);
    }
    *found = dot && (!strcmp(dot, ".csv") || !strcmp(dot, ".txt"));
    return *found ? hada_path_write(list, err, "%s", of->path) : HADA_OK;
}

/* Brings an image to the pixels and channels that the camera has. */
static hada_status set_channels(psfs *of, hada_image *image, hada_error *err)
{
    const int raw = image->channels == 1 && !of->colour && of->options.mosaic != HADA_MOSAIC_NONE;
    hada_image changed = {0};
    if (of->times > 1) {
        HADA_TRY(hada_image_bin(image, of->times, raw ? of->options.mosaic : HADA_MOSAIC_NONE, 1, err));
        of->filled |= raw;
    }
    const size_t area = (size_t)image->rows * (size_t)image->cols;
    if (image->channels == 1 && of->colour) {
        HADA_TRY(hada_image_repeat(&changed, image, 3, err));
        of->spread = 1;
    } else if (image->channels == 1 && raw) { /* of a camera with a mosaic, as it wrote it */
        HADA_TRY(hada_mosaic_colours(of->options.mosaic, image, &changed, err));
        of->filled = 1;
    } else if (image->channels == 3 && of->grey) {
        HADA_TRY(hada_image_create(&changed, 1, image->rows, image->cols, err));
        for (size_t i = 0; i < 3 * area; i++)
            changed.data[i % area] += image->data[i] / 3.0F;
    } else {
        return HADA_OK;
    }
    hada_image_destroy(image);
    *image = changed;
    return HADA_OK;
}

/* Divides a page by the flat frame of the camera, where it is a frame of that. */
static hada_status flatten(const psfs *of, hada_image *image, const char *path, hada_error *err)
{
    const hada_image *flat = &of->flat;
    const hada_mosaic mosaic = image->channels == 1 && !of->colour ? of->options.mosaic : HADA_MOSAIC_NONE;
    if (!flat->data)
        return HADA_OK;
    const int channels = mosaic == HADA_MOSAIC_NONE ? image->channels : HADA_MOSAIC_COLOURS;
    if (image->rows == flat->rows && image->cols == flat->cols && (flat->channels == 1 || flat->channels == channels))
        return hada_named(hada_flat_correct(image, mosaic, flat, HADA_AUTO, err), path, err);
    hada_monitor_tell(of->task->monitor, HADA_MESSAGE_NOTE,
                      "%s has %d channel(s) of %d x %d pixels, the flat frame %d of %d x %d: it is not divided by that",
                      path, image->channels, image->rows, image->cols, flat->channels, flat->rows, flat->cols);
    return HADA_OK;
}

static hada_status take_flat(psfs *of, hada_error *err)
{
    const hada_image *flat = of->task->flat_frame;
    const int channels = of->options.mosaic ? HADA_MOSAIC_COLOURS : flat ? flat->channels : 1;
    return flat ? hada_flat_sensitivity(&of->flat, flat, channels, of->options.mosaic, err) : HADA_OK;
}

/* Pixels at white: their share, before anything changes them. */
static void count_white(psfs *of, const hada_image *image, int depth)
{
    const size_t count = hada_image_count(image);
    const float white = hada_cut_off_value(image->data, count);
    double share = 0.0;
    for (size_t i = 0; i < count; i++)
        share += image->data[i] >= white ? 1.0 / (double)count : 0.0;
    if (share > of->at_white) {
        of->at_white = share;
        of->white = white;
        of->worst = depth;
    }
}

/* Captures that are averaged are of one depth, by a camera that stood still. */
static hada_status compare_captures(psfs *of, const hada_image *before, const hada_image *now, const char *path,
                                    hada_error *err)
{
    hada_image clean[2] = {{0}};
    double alike, moved;
    hada_status status = HADA_OK;
    for (int k = 0; k < 2; k++) {
        HADA_TRY_OR_DONE(hada_image_copy(&clean[k], k ? now : before, err));
        if (hada_psf_clean(&clean[k], &of->options, NULL, NULL))
            goto done; /* the mean of all may be better */
    }
    HADA_TRY_OR_DONE(hada_psf_alike(&alike, &moved, &clean[0], &clean[1], err));
    of->unlike = alike < ALIKE || moved > MOVED;
    if (of->unlike)
        hada_monitor_tell(
            of->task->monitor, HADA_MESSAGE_NOTE,
            "%s is %.0f %% like the captures before it, moved by %.1f pixels, and is averaged with them: put "
            "several depths into folders z<distance>mm, or name a distance for each with options.distances; "
            "leave it out if the camera moved",
            path, 100.0 * alike, moved);
done:
    hada_image_destroy(&clean[0]);
    hada_image_destroy(&clean[1]);
    return status;
}

/* A page, into a depth of its own or added to one: *pages of it so far. */
static hada_status add_page(psfs *of, hada_tiff_reader *reader, int page, const char *path, hada_image *depth,
                            int *pages, hada_error *err)
{
    hada_image image = {0};
    hada_pixels pixels;
    hada_status status = HADA_OK;
    hada_pixels_init(&pixels);
    HADA_TRY(hada_tiff_read_light(reader, page, of->task->frame_encoding, &image, err));
    hada_pixels_of_image(&pixels, &image);
    if (!of->image->data)
        hada_tell_values(of->task->monitor, path, reader, of->task->frame_encoding, &pixels);
    count_white(of, &image, (int)(depth - of->image));
    HADA_TRY_OR_DONE(flatten(of, &image, path, err));
    HADA_TRY_OR_DONE(set_channels(of, &image, err));
    if (of->options.turn & HADA_TURN_TRANSPOSE)
        HADA_TRY_OR_DONE(hada_psf_transpose(&image, err));
    if (hada_image_count_not_finite(&image))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_NOT_FINITE, "%s: page %d holds %zu NaN or infinite pixels", path,
                                   page + 1, hada_image_count_not_finite(&image)));
    if (of->image->data &&
        (of->image->channels != image.channels || of->image->rows != image.rows || of->image->cols != image.cols))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_SIZE,
                      "%s: page %d has %d channels, %d x %d; the point spread functions before it have %d, "
                      "%d x %d, and all must be alike",
                      path, page + 1, image.channels, image.rows, image.cols, of->image->channels, of->image->rows,
                      of->image->cols));
    if ((*pages)++) {
        if (!of->unlike)
            HADA_TRY_OR_DONE(compare_captures(of, depth, &image, path, err));
        for (size_t i = 0; i < hada_image_count(depth); i++)
            depth->data[i] += (image.data[i] - depth->data[i]) / (float)*pages;
    } else {
        *depth = image;
        return HADA_OK;
    }
done:
    hada_image_destroy(&image);
    return status;
}

/* Of those of all depths. */
static void take_distances(psfs *of, const double *all)
{
    for (int k = 0; k < of->count; k++)
        of->distances_mm[k] = all[k * of->every];
}

/* The pages of a file, each a depth. */
static hada_status read_stack(psfs *of, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_tiff_open(&reader, of->path, err));
    HADA_TRY_OR_DONE(hada_tiff_check_all(reader, err));
    const hada_tiff_info *info = hada_tiff_get_info(reader);
    of->all = info->frames;
    HADA_TRY_OR_DONE(HADA_NEW(of->image, (size_t)info->frames, "point spread functions", err));
    HADA_TRY_OR_DONE(HADA_NEW(of->distances_mm, (size_t)info->frames, "distances", err));
    for (int page = 0; page < info->frames; page += of->every, of->count++) {
        int pages = 0;
        HADA_TRY_OR_DONE(add_page(of, reader, page, of->path, &of->image[of->count], &pages, err));
    }
    if (info->distances == of->all)
        take_distances(of, info->distances_mm);
    else if (of->all == 1)
        of->distances_mm[0] = fmax(of->capture[0].distance, 0.0);
done:
    hada_tiff_close(&reader);
    return status;
}

/* Files, each the captures of one depth; `apart`: each of another. */
static hada_status read_captures(psfs *of, int apart, hada_error *err)
{
    int pages = 0, files = 0;
    HADA_TRY(HADA_NEW(of->image, (size_t)of->captures, "point spread functions", err));
    HADA_TRY(HADA_NEW(of->distances_mm, (size_t)of->captures, "distances", err));
    for (int i = 0; i < of->captures; i++) {
        const capture *now = &of->capture[i];
        hada_tiff_reader *reader = NULL;
        if (!i || apart || now->distance > now[-1].distance) {
            pages = files = 0;
            of->distances_mm[of->count++] = fmax(now->distance, 0.0);
        }
        HADA_TRY(hada_tiff_open(&reader, now->path, err));
        const int frames = hada_tiff_get_info(reader)->frames;
        hada_status status = HADA_OK;
        for (int page = 0; page < frames && !status; page++)
            status = add_page(of, reader, page, now->path, &of->image[of->count - 1], &pages, err);
        hada_tiff_close(&reader);
        HADA_TRY(status);
        files++;
        of->all = of->count;
        if (pages > 1 && (i + 1 == of->captures || apart || now[1].distance > now->distance))
            hada_monitor_tell(of->task->monitor, HADA_MESSAGE_INFO, "%s: %d captures of %d %s averaged", now->path,
                              pages, files, files == 1 ? "file" : "files");
    }
    return HADA_OK;
}

/* Where a point stood, from the middle of its image as that is now: binned and transposed. */
static void place_point(psfs *of, int image, const hada_position *at)
{
    const int across = (of->options.turn & HADA_TURN_TRANSPOSE) != 0;
    const int rows = across ? of->image->cols : of->image->rows, cols = across ? of->image->rows : of->image->cols;
    const double row = (at->y + 0.5) / of->times - 0.5 - rows / 2, col = (at->x + 0.5) / of->times - 0.5 - cols / 2;
    of->rows[image] = across ? col : row;
    of->cols[image] = across ? row : col;
}

static hada_status room_for_points(psfs *of, hada_error *err)
{
    const size_t images = (size_t)of->all * (size_t)of->positions;
    of->count = (int)images;
    HADA_TRY(HADA_NEW(of->image, images, "point spread functions", err));
    HADA_TRY(HADA_NEW(of->rows, images, "positions", err));
    HADA_TRY(HADA_NEW(of->cols, images, "positions", err));
    return HADA_NEW(of->distances_mm, (size_t)of->all, "distances", err);
}

/* The file of a line: an image, or one for each depth. */
static hada_status read_point_file(psfs *of, int number, hada_error *err)
{
    const hada_position *now = &of->points.list[number];
    const int stacks = now->distance < 0.0;
    int averaged = 0;
    hada_tiff_reader *reader = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_tiff_open(&reader, now->path, err));
    HADA_TRY_OR_DONE(hada_tiff_check_all(reader, err));
    const hada_tiff_info *info = hada_tiff_get_info(reader);
    if (!of->image) {
        of->all = stacks ? info->frames : of->all;
        HADA_TRY_OR_DONE(room_for_points(of, err));
        if (stacks && info->distances == of->all)
            memcpy(of->distances_mm, info->distances_mm, (size_t)of->all * sizeof(double));
    }
    if (stacks && info->frames != of->all)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_FORMAT,
                                   "%s has %d pages and the file before it %d: each is a depth, or say the distance of "
                                   "each file in the list",
                                   now->path, info->frames, of->all));
    for (int page = 0; page < info->frames; page++) {
        const int image = stacks ? page * of->positions + number : number;
        averaged = stacks ? 0 : averaged;
        HADA_TRY_OR_DONE(add_page(of, reader, page, now->path, &of->image[image], &averaged, err));
        place_point(of, image, now);
    }
    if (!stacks)
        of->distances_mm[number / of->positions] = now->distance;
done:
    hada_tiff_close(&reader);
    return status;
}

/* Point spread functions at positions of the field. */
static hada_status read_points(psfs *of, const char *list, hada_error *err)
{
    const hada_psf_task *task = of->task;
    if (task->more_count || task->every > 1 || task->recentre || task->mask_distance_mm > 0.0 || task->psf_distances_mm)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%s lists PSFs that vary over the field: options.every, options.recentre, "
                         "options.mask_distance, options.psf_distance and more files do not go with them",
                         list);
    HADA_TRY(hada_positions_read(&of->points, list, err));
    of->all = of->points.depths;
    of->positions = of->all ? of->points.count / of->all : of->points.count;
    if (of->positions > HADA_MOST_POSITIONS)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "%s: %d positions; %d of a depth are possible", list,
                         of->positions, HADA_MOST_POSITIONS);
    for (int i = 0; i < of->points.count; i++)
        HADA_TRY(read_point_file(of, i, err));
    if (task->distances_mm && task->distances != of->all)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.distances names %d, but %s has %d depths", task->distances,
                         list, of->all);
    if (task->distances_mm)
        memcpy(of->distances_mm, task->distances_mm, (size_t)of->all * sizeof(double));
    if (of->all > 1 && of->distances_mm[0] <= 0.0)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%s does not say at which distances its %d depths were taken; say them in the list, or add "
                         "options.distances with them in mm",
                         list, of->all);
    for (int z = 0; z < of->all; z++)
        HADA_TRY(hada_named(
            hada_psf_positions_check(of->rows + z * of->positions, of->cols + z * of->positions, of->positions, err),
            list, err));
    of->options.positions = of->positions;
    of->options.position_rows = of->rows;
    of->options.position_cols = of->cols;
    return HADA_OK;
}

/* What a frame of the camera says. */
static hada_status ask_frame(psfs *of, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    of->colour = of->task->colour;
    if (!of->task->frame)
        return HADA_OK;
    HADA_TRY(hada_tiff_open(&reader, of->task->frame, err));
    const hada_tiff_info *info = hada_tiff_get_info(reader);
    of->options.frame_rows = info->rows / of->times;
    of->options.frame_cols = info->cols / of->times;
    if (info->mosaic && !of->options.mosaic)
        of->options.mosaic = info->mosaic;
    of->colour |= info->channels == 3;
    of->grey = info->channels == 1 && !of->options.mosaic && !of->colour;
    hada_tiff_close(&reader);
    return HADA_OK;
}

static hada_status read_all(psfs *of, hada_error *err)
{
    const hada_psf_task *task = of->task;
    hada_path list;
    int varies;
    const int law = task->mask_distance_mm > 0.0 || task->psf_distances_mm;
    const double *given = law ? task->psf_distances_mm : task->distances_mm;
    int number = law ? task->psf_distances : task->distances;
    if (!(task->mask_distance_mm >= 0.0 && isfinite(task->mask_distance_mm)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "options.mask_distance is in mm and above 0, not %g",
                         task->mask_distance_mm);
    HADA_TRY(ask_frame(of, err));
    HADA_TRY(find_positions(of, list, &varies, err));
    if (varies)
        return read_points(of, list, err);
    if (task->psf && task->psf->components > 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.components are of PSFs at several positions of the field: give a list of them, or a "
                         "folder with positions.csv");
    HADA_TRY(find_captures(of, err));
    of->every = task->every;
    if (task->every < 1 || (task->every > 1 && !of->stack))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.every takes pages of one file, each one or each 2nd, 3rd..., and is 1 or more");
    if (!given && of->capture[0].distance < 0.0) {
        HADA_TRY(read_list(of, err));
        given = of->list;
        number = of->listed;
    }
    number = given ? number : 0;
    HADA_TRY(of->stack ? read_stack(of, err) : read_captures(of, number > 1 && of->capture[0].distance < 0.0, err));
    if (of->filled)
        hada_monitor_tell(task->monitor, HADA_MESSAGE_NOTE,
                          "%s has one channel and is taken for a raw capture of the mosaic; if it is grey, add "
                          "options.colour",
                          of->path);
    if (of->spread && !task->colour)
        hada_monitor_tell(task->monitor, HADA_MESSAGE_NOTE,
                          "%s: a grey one serves red, green and blue alike; where the optics place them differently, "
                          "edges get coloured",
                          of->path);
    if (given && number != of->all)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%s names %d distance%s, but %s has %d %s%s",
                         of->list ? "the list beside it"
                         : law    ? "options.psf_distance"
                                  : "options.distances",
                         number, number == 1 ? "" : "s", of->path, of->all, of->stack ? "page" : "depth",
                         of->all == 1 ? "" : "s");
    if (given)
        take_distances(of, given);
    if (of->count > 1 && of->distances_mm[0] <= 0.0)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%s does not say at which distances its %d %s were taken; add options.distances with them in "
                         "mm",
                         of->path, of->count, of->stack ? "pages" : "depths");
    return HADA_OK;
}

static hada_status tell_cleaned(const psfs *of, int z, const hada_psf_seen *seen, hada_error *err)
{
    hada_psf_shape shape;
    char where[64] = "", like[64] = "", hot[64] = "", uneven[64] = "";
    HADA_TRY(hada_psf_measure(&shape, &of->image[z], z ? &of->image[z - 1] : NULL, err));
    if (of->count > 1)
        snprintf(where, sizeof where, ", depth %d", z + 1);
    if (seen->hot)
        snprintf(hot, sizeof hot, "; %zu hot pixel%s replaced", seen->hot, seen->hot == 1 ? "" : "s");
    if (seen->uneven > 0.0)
        snprintf(uneven, sizeof uneven, " to %.4g", seen->background + seen->uneven);
    if (z)
        snprintf(like, sizeof like, "; %.0f %% like the depth before", 100.0 * shape.alike);
    hada_monitor_tell(of->task->monitor, z ? HADA_MESSAGE_DETAIL : HADA_MESSAGE_INFO,
                      "%s%s: background %.4g%s taken off; noise is %.2g %% of the brightest pixel, and %.1f %% of the "
                      "pixels, which are no brighter, are 0%s%s",
                      of->path, where, seen->background, uneven, 100.0 * seen->noise / seen->peak, 100.0 * seen->dark,
                      hot, seen->noise > NOISY * seen->peak ? "; the mean of several captures has less noise" : "");
    hada_monitor_tell(
        of->task->monitor, HADA_MESSAGE_DETAIL,
        "%s%s: 99 %% of the light within %d x %d pixels; details of %.1f pixels, by its autocorrelation; a "
        "pixel at the border has %.2g %% of a mean one's light%s",
        of->path, where, shape.rows, shape.cols, shape.detail, 100.0 * seen->border, like);
    if (!z && !of->positions &&
        (fabs(shape.row) > ASIDE * of->options.window_rows || fabs(shape.col) > ASIDE * of->options.window_cols) &&
        of->options.window_rows)
        hada_monitor_tell(
            of->task->monitor, HADA_MESSAGE_NOTE,
            "%s: the middle of its light is %.0f rows and %.0f columns from the optical axis, its pixel "
            "(rows / 2, columns / 2); if the source stood before the middle of the window, shift it there, "
            "for else the window cuts the scene off",
            of->path, shape.row, shape.col);
    return HADA_OK;
}

static hada_status clean(psfs *of, hada_error *err)
{
    double border = 0.0, white = 0.0;
    for (int z = 0; z < of->count; z++) {
        hada_psf_seen seen;
        HADA_TRY(hada_named(hada_psf_clean(&of->image[z], &of->options, &seen, err), of->path, err));
        HADA_TRY(tell_cleaned(of, z, &seen, err));
        border = fmax(border, seen.border);
        if (z == of->worst && of->options.psf_dark != 0.0) /* hot pixels are no part of it */
            white = (of->at_white * (double)hada_image_count(&of->image[z]) - (double)seen.hot) *
                    (of->white - seen.background) / hada_psf_light(&of->image[z]);
    }
    if (border > BORDER && !of->options.psf_taper && !of->positions) /* others see what one of these misses */
        hada_monitor_tell(
            of->task->monitor, HADA_MESSAGE_NOTE,
            "%s: light reaches the borders, where a pixel has %.0f %% of a mean one's: what lies beyond is "
            "missing, and the picture may have a bright cross or stripes. Take a picture that is larger "
            "than a frame, or let it fade out with options.psf_taper",
            of->path, 100.0 * border);
    if (white > WHITE)
        hada_monitor_tell(
            of->task->monitor, HADA_MESSAGE_NOTE,
            "%s: %.0f %% of the light is in pixels at white, where the sensor was saturated: take it again "
            "with a shorter exposure (a computed one: options.psf_dark 0)",
            of->path, 100.0 * white);
    of->options.psf_dark = 0.0;
    of->options.psf_taper = 0;
    return HADA_OK;
}

/* Of a stack: how far the bead wanders, which is taken off where that is wanted. */
static hada_status recentre(psfs *of, hada_error *err)
{
    const hada_psfs known = {of->image, of->distances_mm, of->count};
    const hada_psf_task *task = of->task;
    double(*drift)[2] = NULL, most = 0.0;
    hada_image moved = {0};
    hada_status status = HADA_OK;
    if (of->count < LEAST_STACK)
        return task->recentre ? hada_fail(err, HADA_ERROR_ARGUMENT,
                                          "options.recentre: a drift is seen in %d depths or more, and %s has %d",
                                          LEAST_STACK, of->path, of->count)
                              : HADA_OK;
    for (int k = 1; k < of->count; k++)
        if (!(of->distances_mm[k] > of->distances_mm[k - 1]))
            return HADA_OK; /* which is refused later */
    HADA_TRY_OR_DONE(HADA_NEW(drift, (size_t)of->count, "the drift of point spread functions", err));
    HADA_TRY_OR_DONE(hada_psf_drift(drift, &known, err));
    for (int k = 0; k < of->count; k++)
        most = fmax(most, hypot(drift[k][0], drift[k][1]));
    hada_monitor_tell(task->monitor, !task->recentre && most > WANDERS ? HADA_MESSAGE_NOTE : HADA_MESSAGE_DETAIL,
                      task->recentre ? "%s: the bead wanders by up to %.1f pixels, which were taken off"
                                     : "%s: the bead wanders by up to %.1f pixels beside what its distances explain: "
                                       "kept as it is; options.recentre takes it off",
                      of->path, most);
    for (int k = 0; k < of->count && task->recentre; k++) {
        hada_image *image = &of->image[k];
        HADA_TRY_OR_DONE(
            hada_image_magnify(&moved, image, 1.0, -drift[k][0], -drift[k][1], image->rows, image->cols, err));
        for (size_t i = 0; i < hada_image_count(&moved); i++)
            image->data[i] = fmaxf(moved.data[i], 0.0F);
        hada_image_destroy(&moved);
    }
done:
    hada_image_destroy(&moved);
    free(drift);
    return status;
}

/* Makes those of the wanted depths from those that were read. */
static hada_status change_depths(psfs *of, hada_context *context, hada_error *err)
{
    const hada_psf_task *task = of->task;
    const hada_psfs known = {of->image, of->distances_mm, of->count};
    double mask = task->mask_distance_mm, left = 0.0;
    char words[64] = "";
    hada_image *image = NULL;
    double *distances = NULL;
    hada_status status = HADA_OK;
    if (!(of->distances_mm[0] > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%s does not say at which distance it was taken; add options.psf_distance with it in mm",
                         of->path);
    if (!task->distances_mm)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "say with options.distances which depths shall be made from %s by the law of magnification",
                         of->path);
    if (!(mask > 0.0) && of->count == 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "one point spread function gives others with the mask's distance from the sensor; add "
                         "options.mask_distance with it in mm, or a point spread function of another distance");
    HADA_TRY_OR_DONE(HADA_NEW(image, (size_t)task->distances, "point spread functions", err));
    HADA_TRY_OR_DONE(HADA_NEW(distances, (size_t)task->distances, "distances", err));
    memcpy(distances, task->distances_mm, (size_t)task->distances * sizeof *distances);
    for (int z = 0; z < task->distances; z++)
        if (!(distances[z] > (z ? distances[z - 1] : 0.0)))
            HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT, "options.distances are above 0, from near to far"));
    HADA_TRY_OR_DONE(hada_psf_depths(image, distances, task->distances, &known, &mask, &left, context, err));
    if (left > 0.0)
        snprintf(words, sizeof words, ", which leaves %.0f %% of a PSF unexplained by the others", 100.0 * left);
    hada_monitor_tell(task->monitor, HADA_MESSAGE_INFO,
                      "%d depths by the law of magnification, 1 + %.4g mm / distance%s", task->distances, mask, words);
done:
    if (status) {
        for (int z = 0; image && z < task->distances; z++)
            hada_image_destroy(&image[z]);
        HADA_FREE(image, distances);
        return status;
    }
    if (!of->options.frame_rows) { /* magnified ones are larger than frames */
        of->options.frame_rows = known.image->rows;
        of->options.frame_cols = known.image->cols;
    }
    for (int z = 0; z < of->count; z++)
        hada_image_destroy(&of->image[z]);
    HADA_FREE(of->image, of->distances_mm);
    of->image = image;
    of->distances_mm = distances;
    of->count = task->distances;
    return HADA_OK;
}

/* Light that frames of the model's size never see. */
static void tell_lost(const psfs *of, const hada_model_info *info)
{
    double light = 0.0, kept = 0.0;
    for (int z = 0; z < of->count; z++) {
        hada_image reach;
        if (hada_psf_reach(&reach, &of->image[z], info, NULL))
            return;
        light += hada_psf_light(&of->image[z]);
        kept += hada_psf_light(&reach);
        hada_image_destroy(&reach);
    }
    if (kept < (1.0 - LOST) * light)
        hada_monitor_tell(
            of->task->monitor, HADA_MESSAGE_NOTE,
            "%s: %d x %d pixels are more than frames of %d x %d with this window can see; they were cropped "
            "about the middle, where the optical axis is, and %.1f %% of the light with them",
            of->path, of->image->rows, of->image->cols, info->raw_rows, info->raw_cols, 100.0 * (1.0 - kept / light));
}

static void tell_components(const psfs *of, const hada_model *model)
{
    const hada_model_info *info = &model->info;
    char values[256] = "";
    for (int k = 0; model->singular_values && k < info->positions && k < 8; k++)
        snprintf(values + strlen(values), sizeof values - strlen(values), "%s%.3g",
                 k ? ", " : "; singular values over the first one, first depth: ",
                 model->singular_values[k] / model->singular_values[0]);
    hada_monitor_tell(of->task->monitor, HADA_MESSAGE_INFO,
                      "%s: PSFs of %d positions; %d component%s leave%s %.2g %% of their energy, the mean PSF alone "
                      "%.3g %%%s",
                      of->path, info->positions, info->components, info->components == 1 ? "" : "s",
                      info->components == 1 ? "s" : "", 100.0 * info->lost, 100.0 * info->lost_single, values);
}

hada_status hada_psf_run(hada_model **out, hada_context *context, const char *path, const hada_psf_task *callers,
                         hada_error *err)
{
    HADA_NEED(out && context && path, err);
    hada_psf_task own, *task = &own;
    psfs of = {.task = task, .path = path};
    hada_image dark = {0};
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(task, callers, hada_psf_task, err));
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&of.options, task->psf, hada_psf_options, err));
    of.times = of.options.downsample > 1 ? of.options.downsample : 1;
    HADA_TRY_OR_DONE(take_flat(&of, err));
    HADA_TRY_OR_DONE(read_all(&of, err));
    if ((int)of.options.turn > 0 && of.options.turn <= HADA_TURN_270)
        of.options.turn = (hada_turn)(of.options.turn & HADA_TURN_180); /* pages are transposed by now */
    HADA_TRY_OR_DONE(clean(&of, err));
    if (!of.positions)
        HADA_TRY_OR_DONE(recentre(&of, err));
    if (task->mask_distance_mm > 0.0 || task->psf_distances_mm)
        HADA_TRY_OR_DONE(change_depths(&of, context, err));
    HADA_TRY_OR_DONE(hada_named(hada_model_from_psf(out, context, of.image, of.positions ? of.all : of.count,
                                                    of.distances_mm, &of.options, err),
                                path, err));
    if (of.positions)
        tell_components(&of, *out);
    HADA_TRY_OR_DONE(hada_model_set_flat(*out, of.flat.data ? &of.flat : NULL, err));
    if (task->dark_frame) {
        HADA_TRY_OR_DONE(hada_dark_of_sensor(&dark, task->dark_frame, 0, of.options.mosaic, err));
        HADA_TRY_OR_DONE(hada_model_set_dark(*out, &dark, err));
    }
    if (!of.positions)
        tell_lost(&of, hada_model_get_info(*out));
    HADA_TRY_OR_DONE(hada_model_complete(out, task->half, NULL, NULL, err));
done:
    for (int z = 0; of.image && z < of.count; z++)
        hada_image_destroy(&of.image[z]);
    for (int i = 0; i < of.captures; i++)
        free(of.capture[i].path);
    hada_positions_free(&of.points);
    hada_image_destroy(&of.flat);
    hada_image_destroy(&dark);
    HADA_FREE(of.image, of.distances_mm, of.capture, of.list, of.rows, of.cols);
    if (status)
        hada_model_destroy(out);
    return status;
}
