#include "command.h"
#include "folder.h"
#include "pairs.h"
#include "register_apply.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* PSFs of neighbouring depths that are less alike than this say nothing about a shift. */
static const double least_likeness = 0.3;

typedef struct settings {
    hada_cli_common common;
    const char *output, *magnification;
    double rotation;
    int window[2];
    int no_offset, skip_incomplete;
} settings;

#define AT(member) offsetof(settings, member)
static const hada_cli_option options[] = {
    {HADA_OPTION_GROUP, NULL, 0, NULL, "Result", NULL, 0},
    {HADA_OPTION_TEXT, "output", 'o', "DATASET", "write a data set with registered scenes; without it, only report",
     "Raw frames are taken over as they are, as hard links where that goes. Transforms that would move no pixel of a "
     "scene by more than the precision reached are not applied.",
     AT(output)},
    {HADA_OPTION_SIZE, "window", 0, "HxW", "size of the registered scenes (default: what they fill, within the frame)",
     NULL, AT(window)},
    {HADA_OPTION_GROUP, NULL, 0, NULL, "Search", NULL, 0},
    {HADA_OPTION_TEXT, "magnification", 0, "MIN,MAX", "pixels of the frame per pixel of a scene file",
     "Default: such that the scene's longer side has 0.15 to 2.5 times that of the frame.", AT(magnification)},
    {HADA_OPTION_REAL, "rotation", 0, "DEGREES", "rotation beside quarter turns, to either side (default: 15)", NULL,
     AT(rotation)},
    {HADA_OPTION_FLAG, "no-offset", 0, NULL, "leave the shifts between depths as they are", NULL, AT(no_offset)},
    {HADA_OPTION_FLAG, "skip-incomplete", 0, NULL, "leave out files without their partner", NULL, AT(skip_incomplete)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    set->rotation = 15;
}

/* What was found for a depth, and what of it is applied. */
typedef struct depth {
    hada_registration found, applied;
    int scene_rows, scene_cols;
    int pairs;           /* looked at */
    double likeness;     /* of the PSF to that of the depth before; NaN: not compared */
    double displacement; /* pixels of the frame that the farthest pixel of a scene moves by, turns and flips aside */
} depth;

/* A depth's pairs in memory, as many as are looked at, evenly spread. */
typedef struct pictures {
    hada_image raws[HADA_REGISTER_PAIRS], scenes[HADA_REGISTER_PAIRS];
    int count;
} pictures;

static void pictures_free(pictures *all)
{
    for (int i = 0; i < all->count; i++) {
        hada_image_destroy(&all->raws[i]);
        hada_image_destroy(&all->scenes[i]);
    }
    all->count = 0;
}

static hada_status pictures_load(pictures *all, const hada_cli_depth *from, hada_error *err)
{
    const int count = from->pairs < HADA_REGISTER_PAIRS ? from->pairs : HADA_REGISTER_PAIRS;
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < count; i++) {
        status = hada_cli_pair_load(&from->pair[(long)i * from->pairs / count], &all->raws[i], &all->scenes[i], err);
        all->count += !status;
    }
    return status;
}

/* The farthest that the transform moves a pixel of the scene, against one with flips and quarter turns alone. */
static double displacement_of(const depth *one)
{
    const hada_registration *r = &one->found;
    const double radius = 0.5 * hypot(one->scene_rows, one->scene_cols), angle = r->rotation_deg * acos(-1.0) / 180.0;
    const double dy = r->magnification * cos(angle) - 1.0, dx = r->magnification * sin(angle);
    return radius * hypot(dy, dx) + hypot(r->offset_row, r->offset_col);
}

/* What can't be told from nothing is not applied: a pixel, or half a percent of the way to a corner. */
static void choose_applied(depth *one)
{
    const double precision = fmax(1.0, 0.005 * 0.5 * hypot(one->scene_rows, one->scene_cols));
    one->displacement = displacement_of(one);
    one->applied = one->found;
    if (one->displacement < precision) {
        one->applied.magnification = 1.0;
        one->applied.rotation_deg = one->applied.offset_row = one->applied.offset_col = 0.0;
    }
}

static int stands_right(const depth *one)
{
    const hada_registration *r = &one->applied;
    return !r->mirrored && !r->quarter_turns && r->magnification == 1.0 && r->rotation_deg == 0.0 &&
           r->offset_row == 0.0 && r->offset_col == 0.0;
}

/* The offset of a depth from the one before, whose own offset is known: its PSF is that depth's, scaled and moved. */
static hada_status find_offset(depth *one, const depth *before, const hada_image *psf, const hada_image *last,
                               double pitch, hada_error *err)
{
    double scale, row, col;
    hada_status status = hada_register_offset(last, psf, pitch, &scale, &row, &col, &one->likeness, err);
    if (!status && one->likeness >= least_likeness) {
        one->found.offset_row = row + scale * before->found.offset_row;
        one->found.offset_col = col + scale * before->found.offset_col;
    }
    return status;
}

static hada_status find_depth(depth *all, int z, const hada_cli_depth *from, const hada_register_options *how,
                              int with_offset, hada_image *last, hada_error *err)
{
    pictures of = {0};
    depth *one = &all[z];
    hada_image psf = {0};
    double pitch;
    one->likeness = NAN;
    hada_registration_init(&one->found);
    hada_status status = pictures_load(&of, from, err);
    if (!status) {
        one->pairs = of.count;
        one->scene_rows = of.scenes->rows;
        one->scene_cols = of.scenes->cols;
        status = hada_register_pairs(&one->found, of.raws, of.scenes, of.count, how, err);
    }
    if (!status && with_offset)
        status = hada_register_psf(&psf, &pitch, of.raws, of.scenes, of.count, &one->found, err);
    if (!status && with_offset && z)
        status = find_offset(one, &all[z - 1], &psf, last, pitch, err);
    pictures_free(&of);
    hada_image_destroy(last);
    *last = psf;
    if (status)
        hada_cli_prefix(err, "%s: ", from->folder);
    else
        choose_applied(one);
    return status;
}

static hada_status find_all(hada_cli *cli, const settings *set, const hada_cli_dataset *data, depth *all,
                            hada_error *err)
{
    hada_register_options how;
    hada_image last = {0};
    hada_cli_progress progress;
    char *comma = NULL;
    hada_status status = HADA_OK;
    hada_register_options_init(&how);
    how.most_rotation_deg = set->rotation;
    if (set->magnification) {
        char *text = strdup(set->magnification);
        comma = text ? strchr(text, ',') : NULL;
        if (comma)
            *comma++ = 0;
        if (!comma || !hada_cli_read_real(text, &how.least_magnification) ||
            !hada_cli_read_real(comma, &how.most_magnification) || !(how.least_magnification > 0))
            status =
                hada_cli_error(err, HADA_ERROR_ARGUMENT,
                               "--magnification %s is not a range; write two numbers as in 0.5,2", set->magnification);
        free(text);
    }
    hada_cli_progress_begin(cli, &progress, "depths", data->depths);
    for (int z = 0; !status && z < data->depths; z++) {
        status = find_depth(all, z, &data->depth[z], &how, data->depths > 1 && !set->no_offset, &last, err);
        hada_cli_progress_step(cli, NULL);
        if (!status)
            status = hada_cli_check_signals(err);
    }
    hada_cli_progress_end(cli);
    hada_image_destroy(&last);
    return status;
}

/* What must be done to the scenes, in words. */
static const char *orientation(const hada_registration *r)
{
    static const char *const words[] = {"as it is", "turn left",         "half a turn", "turn right",
                                        "mirror",   "mirror, turn left", "upside down", "mirror, turn right"};
    return words[4 * r->mirrored + r->quarter_turns];
}

static json_t *depth_json(const hada_cli_depth *from, const depth *one)
{
    const hada_registration *r = &one->found, *a = &one->applied;
    json_t *entry =
        json_pack("{s:f, s:i, s:b, s:i, s:s}", "distance_mm", from->distance_mm, "pairs", one->pairs, "mirrored",
                  r->mirrored, "quarter_turns", r->quarter_turns, "orientation", orientation(r));
    json_object_set_new(entry, "magnification", hada_cli_real(r->magnification));
    json_object_set_new(entry, "rotation_deg", hada_cli_real(r->rotation_deg));
    json_object_set_new(entry, "offset", json_pack("[f, f]", r->offset_row, r->offset_col));
    json_object_set_new(entry, "likeness_to_the_depth_before", hada_cli_real(one->likeness));
    json_object_set_new(entry, "explained", hada_cli_real(r->explained));
    json_object_set_new(entry, "explained_otherwise", hada_cli_real(r->explained_otherwise));
    json_object_set_new(entry, "displacement", hada_cli_real(one->displacement));
    json_object_set_new(entry, "stands_right", json_boolean(stands_right(one)));
    json_object_set_new(entry, "applied",
                        json_pack("{s:f, s:f, s:[f, f]}", "magnification", a->magnification, "rotation_deg",
                                  a->rotation_deg, "offset", a->offset_row, a->offset_col));
    return entry;
}

static void report(hada_cli *cli, const hada_cli_dataset *data, const depth *all)
{
    int right = 0;
    json_t *depths = json_array();
    json_object_set_new(cli->document, "depths", depths);
    hada_cli_say(cli, "%9s  %-18s  %13s  %9s  %16s  %9s  %9s", "distance", "scenes", "magnification", "rotation",
                 "offset", "explained", "otherwise");
    for (int z = 0; z < data->depths; z++) {
        const depth *one = &all[z];
        const hada_registration *r = &one->found;
        char offset[48] = "-";
        if (!z || one->likeness >= least_likeness)
            snprintf(offset, sizeof offset, "%.1f, %.1f", r->offset_row, r->offset_col);
        hada_cli_say(cli, "%6g mm  %-18s  %13.4f  %8.2f\xc2\xb0  %16s  %8.1f%%  %8.1f%%", data->distances_mm[z],
                     orientation(r), r->magnification, r->rotation_deg, offset, 100 * r->explained,
                     100 * r->explained_otherwise);
        if (z && one->likeness < least_likeness)
            hada_cli_warn(cli,
                          "%s: its PSF is not like that of the depth before (%.2f), so the shift between them is "
                          "not known",
                          data->depth[z].folder, one->likeness);
        if (r->explained < 0.05)
            hada_cli_warn(cli, "%s: only %.1f %% of the frames' structure is explained, so these figures are rough",
                          data->depth[z].folder, 100 * r->explained);
        if (z && (r->mirrored != all[0].found.mirrored || r->quarter_turns != all[0].found.quarter_turns))
            hada_cli_warn(cli, "%s stands in another orientation than %s", data->depth[z].folder,
                          data->depth[0].folder);
        right += stands_right(one);
        json_array_append_new(depths, depth_json(&data->depth[z], one));
    }
    json_object_set_new(cli->document, "registered", json_boolean(right == data->depths));
    if (right == data->depths)
        hada_cli_say(cli, "The scenes stand as the sensor sees them: there is nothing to do.");
    else if (right)
        hada_cli_say(cli, "%d of %d depths stand as the sensor sees them.", right, data->depths);
}

/* The size that holds the scenes of all depths, within the frame, unless it is given. */
static hada_status choose_window(const settings *set, const hada_cli_dataset *data, const depth *all, int window[2],
                                 hada_error *err)
{
    hada_image raw, scene;
    hada_status status = hada_cli_pair_load(&data->depth[0].pair[0], &raw, &scene, err);
    if (status)
        return status;
    window[0] = window[1] = 1;
    for (int z = 0; z < data->depths; z++) {
        int rows, cols;
        hada_register_size(&all[z].applied, all[z].scene_rows, all[z].scene_cols, &rows, &cols);
        window[0] = rows > window[0] ? rows : window[0];
        window[1] = cols > window[1] ? cols : window[1];
    }
    if (set->window[0])
        memcpy(window, set->window, sizeof set->window);
    else {
        window[0] = window[0] < raw.rows ? window[0] : raw.rows;
        window[1] = window[1] < raw.cols ? window[1] : raw.cols;
    }
    if (window[0] > raw.rows || window[1] > raw.cols)
        status = hada_cli_error(err, HADA_ERROR_SIZE, "--window %dx%d is larger than the frames, %dx%d", window[0],
                                window[1], raw.rows, raw.cols);
    hada_image_destroy(&raw);
    hada_image_destroy(&scene);
    return status;
}

typedef struct writing {
    hada_cli *cli;
    const hada_cli_dataset *data;
    const hada_registration *applied;
    int window[2];
} writing;

static hada_status fill_folder(void *user, const char *folder, hada_error *err)
{
    const writing *w = user;
    hada_cli_progress progress;
    hada_cli_progress_begin(w->cli, &progress, "pairs", w->data->pairs);
    hada_status status = hada_cli_register_write(w->cli, w->data, w->applied, w->window[0], w->window[1], folder, err);
    hada_cli_progress_end(w->cli);
    return status;
}

static hada_status write_registered(hada_cli *cli, const settings *set, const hada_cli_dataset *data, const depth *all,
                                    hada_error *err)
{
    hada_registration *applied = calloc((size_t)data->depths, sizeof *applied);
    if (!applied)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    for (int z = 0; z < data->depths; z++)
        applied[z] = all[z].applied;
    writing w = {.cli = cli, .data = data, .applied = applied};
    hada_status status = choose_window(set, data, all, w.window, err);
    if (!status)
        status = hada_cli_write_folder(set->output, fill_folder, &w, err);
    free(applied);
    if (!status) {
        hada_cli_say(cli, "%s: %d %s at %d %s, scenes of %dx%d", set->output, data->pairs,
                     data->pairs == 1 ? "pair" : "pairs", data->depths, data->depths == 1 ? "distance" : "distances",
                     w.window[0], w.window[1]);
        json_object_set_new(cli->document, "output", json_string(set->output));
        json_object_set_new(cli->document, "window", json_pack("[i, i]", w.window[0], w.window[1]));
    }
    return status;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    hada_cli_dataset data;
    if (count != 1)
        return hada_cli_usage(cli, "one data set is needed, not %d", count);
    if (!(set->rotation >= 0 && set->rotation <= 45))
        return hada_cli_usage(cli, "--rotation takes 0 to 45 degrees, to either side of every quarter turn");
    if (set->output && !hada_cli_is_vacant(set->output))
        return hada_cli_usage(cli, "%s is there already; give -o the name of a new folder", set->output);
    hada_status status = hada_cli_dataset_scan(&data, arguments[0], set->skip_incomplete, &err);
    if (status)
        return hada_cli_fail(cli, &err);
    depth *all = calloc((size_t)data.depths, sizeof *all);
    status = all ? find_all(cli, set, &data, all, &err) : hada_cli_error(&err, HADA_ERROR_MEMORY, "out of memory");
    if (!status)
        report(cli, &data, all);
    if (!status && set->output)
        status = write_registered(cli, set, &data, all, &err);
    free(all);
    hada_cli_dataset_free(&data);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens register captures", "how do the scenes stand on the sensor?"},
    {"hadalens register captures -o camera && hadalens fit camera -o camera.model", "put them right, then learn."},
    {0},
};

const hada_cli_command hada_cli_register = {
    .name = "register",
    .summary = "find how scenes stand on the sensor, from the pairs alone, and put them right",
    .synopsis = "DATASET [-o DATASET2] [OPTION...]",
    .description =
        "For pairs captured from a display, whose scene files are the pictures that were shown: finds for each depth "
        "how they are turned, mirrored and magnified on the sensor, without knowing the camera's PSF, and shifts "
        "between the depths. Only with the right transform does one convolution explain all pairs; 'explained' says "
        "how much of the frames' structure it explains when learned from the other pairs, 'otherwise' how much the "
        "best transform in another orientation does.\n\n"
        "A shift that all depths share cannot be found, nor does it matter: the PSF takes it up. The first depth "
        "stays where it is; the others are moved so that their PSFs are scaled copies of its PSF about the middle of "
        "the frame. Two pairs per depth are the least, five or more are better.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
};
