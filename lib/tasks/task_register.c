/* Registration of a data set: where the scenes of each depth are on the sensor, what of it is applied, and a data set
 * with registered scenes. */
#include <fcntl.h>
#include <hadalens/task_register.h>
#include <hadalens/tiff.h>
#include <unistd.h>

#include "core/callers.h"
#include "core/input.h"
#include "dataset/dataset.h"
#include "io/folder.h"
#include "io/text.h"
#include "register/register_inside.h"

/* PSFs of neighbouring depths that are less alike than this say nothing about a shift. */
#define LEAST_LIKENESS 0.3
/* Figures that explain a smaller share of the frames' structure are rough. */
#define LEAST_EXPLAINED 0.05
/* What cannot be distinguished from nothing: a pixel, or this share of the way from the middle to a corner. */
#define PRECISION 0.005

/* A depth and what it points to. */
typedef struct registered {
    hada_registered_depth depth;
    hada_registration found, applied;
} registered;

typedef struct owned_report {
    hada_register_report report;
    registered *depth;
    const hada_registered_depth **list;
} owned_report;

void hada_register_report_destroy(hada_register_report **report)
{
    owned_report *own = hada_taken(report); /* its first member */
    if (own)
        HADA_FREE(own->depth, own->list, own);
}

/* The pairs of a depth that are looked at, evenly spread; images are the pairs'. */
typedef struct pictures {
    hada_pair pair[HADA_REGISTER_PAIRS];
    hada_image raws[HADA_REGISTER_PAIRS], scenes[HADA_REGISTER_PAIRS];
    int count;
} pictures;

static hada_status pictures_take(pictures *all, const hada_dataset *data, int z, hada_error *err)
{
    const int pairs = hada_dataset_get_info(data)->counts[z];
    const int count = pairs < HADA_REGISTER_PAIRS ? pairs : HADA_REGISTER_PAIRS;
    for (; all->count < count; all->count++) {
        hada_pair *pair = &all->pair[all->count];
        HADA_TRY(hada_pair_take(pair, data, z, (int)((long)all->count * pairs / count), err));
        all->raws[all->count] = *pair->raw;
        all->scenes[all->count] = *pair->scene;
    }
    return HADA_OK;
}

/* Half of a scene's diagonal, in pixels. */
static double half_diagonal(const hada_registered_depth *one)
{
    return 0.5 * hypot(one->scene_rows, one->scene_cols);
}

/* The farthest that the transform moves a pixel of the scene, against one with flips and quarter turns alone. */
static double displacement_of(const registered *one)
{
    const hada_registration *r = &one->found;
    const double angle = r->rotation_deg * acos(-1.0) / 180.0;
    const double dy = r->magnification * cos(angle) - 1.0, dx = r->magnification * sin(angle);
    return half_diagonal(&one->depth) * hypot(dy, dx) + hypot(r->offset_row, r->offset_col) +
           hada_register_perspective(r, one->depth.scene_rows, one->depth.scene_cols);
}

static void choose_applied(registered *one, const hada_registration *first)
{
    hada_registered_depth *depth = &one->depth;
    hada_registration *r = &one->applied;
    depth->displacement = displacement_of(one);
    *r = one->found;
    if (depth->displacement < fmax(1.0, PRECISION * half_diagonal(depth))) {
        r->magnification = 1.0;
        r->rotation_deg = r->offset_row = r->offset_col = r->perspective_row = r->perspective_col = 0.0;
    }
    depth->stands_right = !r->mirrored && !r->quarter_turns && r->magnification == 1.0 && r->rotation_deg == 0.0 &&
                          r->offset_row == 0.0 && r->offset_col == 0.0 && r->perspective_row == 0.0 &&
                          r->perspective_col == 0.0;
    depth->rough = one->found.explained < LEAST_EXPLAINED;
    depth->other_orientation =
        one->found.mirrored != first->mirrored || one->found.quarter_turns != first->quarter_turns;
    depth->found = &one->found;
    depth->applied = r;
}

/* The offset of a depth from the one before, whose own offset is known: its PSF is that depth's, scaled and moved. */
static hada_status find_offset(registered *one, const hada_registration *before, const hada_image *psf,
                               const hada_image *last, double pitch, hada_error *err)
{
    double scale, row, col;
    HADA_TRY(hada_register_offset(last, psf, pitch, &scale, &row, &col, &one->depth.likeness, err));
    if (one->depth.likeness >= LEAST_LIKENESS) {
        one->found.offset_row = row + scale * before->offset_row;
        one->found.offset_col = col + scale * before->offset_col;
    }
    return HADA_OK;
}

/* `last`: the PSF of the depth before, which becomes that of this one. */
static hada_status find_depth(owned_report *report, int z, const hada_dataset *data,
                              const hada_register_options *search, int with_offset, hada_image *last, hada_error *err)
{
    registered *one = &report->depth[z];
    hada_registered_depth *depth = &one->depth;
    pictures of = {0};
    hada_image psf = {0};
    double pitch;
    hada_status status = HADA_OK;
    depth->likeness = NAN;
    hada_registration_init(&one->found);
    HADA_TRY_OR_DONE(pictures_take(&of, data, z, err));
    depth->pairs = of.count;
    if (of.count) {
        depth->scene_rows = of.scenes->rows;
        depth->scene_cols = of.scenes->cols;
    }
    HADA_TRY_OR_DONE(hada_register_pairs(&one->found, of.raws, of.scenes, of.count, search, err));
    if (with_offset)
        HADA_TRY_OR_DONE(hada_register_psf(&psf, &pitch, of.raws, of.scenes, of.count, &one->found, err));
    if (with_offset && z)
        HADA_TRY_OR_DONE(find_offset(one, &report->depth[z - 1].found, &psf, last, pitch, err));
    depth->offset_unknown = depth->likeness < LEAST_LIKENESS;
    choose_applied(one, &report->depth[0].found);
done:
    for (int i = 0; i < of.count; i++)
        hada_pair_return(&of.pair[i]);
    hada_image_destroy(last);
    *last = psf;
    return hada_named(status, hada_dataset_get_info(data)->folders[z], err);
}

static hada_status find_all(owned_report *report, const hada_dataset *data, const hada_register_task *task,
                            hada_error *err)
{
    const int depths = hada_dataset_get_info(data)->depths;
    const hada_register_options search = {.least_magnification = task->least_magnification,
                                          .most_magnification = task->most_magnification,
                                          .most_rotation_deg = task->most_rotation_deg,
                                          .monitor = task->monitor};
    hada_image last = {0};
    hada_status status = HADA_OK;
    hada_progress progress = hada_progress_begin(task->monitor, "depths", depths);
    for (int z = 0; z < depths; z++) {
        HADA_TRY_OR_DONE(find_depth(report, z, data, &search, depths > 1 && !task->keep_offsets, &last, err));
        report->list[z] = &report->depth[z].depth;
        HADA_TRY_OR_DONE(hada_progress_step(&progress, NULL, err));
    }
done:
    hada_progress_end(&progress);
    hada_image_destroy(&last);
    return status;
}

hada_status hada_register_run(hada_register_report **out, const hada_dataset *data, const hada_register_task *callers,
                              hada_error *err)
{
    hada_register_task task;
    owned_report *own = NULL;
    hada_status status = HADA_OK;
    HADA_NEED(out && data, err);
    *out = NULL;
    HADA_TRY(HADA_OPTIONS_TAKE(&task, callers, hada_register_task, err));
    const size_t depths = (size_t)hada_dataset_get_info(data)->depths;
    HADA_TRY(HADA_NEW(own, 1, "a report", err));
    *out = &own->report;
    HADA_TRY_OR_DONE(HADA_NEW(own->depth, depths, "a report", err));
    HADA_TRY_OR_DONE(HADA_NEW(own->list, depths + 1, "a report", err));
    own->report.depths = own->list;
    HADA_TRY_OR_DONE(find_all(own, data, &task, err));
done:
    if (status)
        hada_register_report_destroy(out);
    return status;
}

/* A data set with registered scenes. */
typedef struct writing {
    const hada_register_report *report;
    const hada_dataset *data;
    hada_register_task task;
    int rows, cols; /* of the scenes */
    hada_progress progress;
} writing;

/* The size that holds the scenes of all depths, within the frame, unless `callers` gives it. */
static hada_status choose_window(writing *w, const hada_register_task *callers, hada_error *err)
{
    const hada_register_task *task = &w->task;
    hada_pair pair;
    HADA_TRY(HADA_OPTIONS_TAKE(&w->task, callers, hada_register_task, err));
    if (!hada_dataset_get_info(w->data)->has_files)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "only a data set of files can be given registered: apply the transforms to the scenes");
    HADA_TRY(hada_pair_take(&pair, w->data, 0, 0, err));
    const int raw_rows = pair.raw->rows, raw_cols = pair.raw->cols;
    hada_pair_return(&pair);
    w->rows = w->cols = 1;
    for (int z = 0; w->report->depths[z]; z++) {
        const hada_registered_depth *one = w->report->depths[z];
        int rows, cols;
        hada_register_size(one->applied, one->scene_rows, one->scene_cols, &rows, &cols);
        w->rows = rows > w->rows ? rows : w->rows;
        w->cols = cols > w->cols ? cols : w->cols;
    }
    w->rows = task->window_rows ? task->window_rows : w->rows < raw_rows ? w->rows : raw_rows;
    w->cols = task->window_rows ? task->window_cols : w->cols < raw_cols ? w->cols : raw_cols;
    if (w->rows > raw_rows || w->cols > raw_cols)
        return hada_fail(err, HADA_ERROR_SIZE, "options.window %dx%d is larger than the frames, %dx%d", w->rows,
                         w->cols, raw_rows, raw_cols);
    return HADA_OK;
}

static void give_window(const writing *w, int *rows, int *cols)
{
    if (rows)
        *rows = w->rows;
    if (cols)
        *cols = w->cols;
}

static hada_status copy_file(const char *from, const char *to, hada_error *err)
{
    char *bytes = NULL;
    size_t size;
    hada_status status = hada_input_read(&bytes, &size, from, SIZE_MAX / 2, NULL, err);
    if (status)
        hada_error_prefix(err, "%s ", from);
    else
        status = hada_file_write(to, bytes, size, err);
    free(bytes);
    return status;
}

static hada_status write_scene(const writing *w, const char *from, const char *to,
                               const hada_registration *registration, hada_error *err)
{
    hada_image scene = {0}, out = {0};
    hada_tiff_write_options options;
    hada_status status = HADA_OK;
    hada_tiff_write_options_init(&options);
    options.bits = 32;
    HADA_TRY_OR_DONE(hada_tiff_load(from, 0, &scene, err));
    HADA_TRY_OR_DONE(hada_register_apply(&out, &scene, registration, w->rows, w->cols, err));
    HADA_TRY_OR_DONE(hada_tiff_save(to, &out, &options, err));
done:
    hada_image_destroy(&scene);
    hada_image_destroy(&out);
    return status;
}

static hada_status write_pair(const writing *w, int z, int i, const char *raws, const char *scenes, hada_error *err)
{
    const hada_pair_files *from = &hada_dataset_get_info(w->data)->files[z][i];
    hada_path raw, scene;
    HADA_TRY(hada_path_write(raw, err, "%s/%s", raws, hada_name_of(from->raw)));
    HADA_TRY(hada_path_write(scene, err, "%s/%s", scenes, hada_name_of(from->scene)));
    /* a link to what a link leads to: one that is relative would lead elsewhere from here */
    if (linkat(AT_FDCWD, from->raw, AT_FDCWD, raw, AT_SYMLINK_FOLLOW))
        HADA_TRY(copy_file(from->raw, raw, err));
    return write_scene(w, from->scene, scene, w->report->depths[z]->applied, err);
}

static hada_status write_depth(writing *w, int z, const char *folder, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(w->data);
    char distance[32];
    hada_path raws, scenes;
    hada_format_exact(distance, sizeof distance, info->distances_mm[z]);
    HADA_TRY(hada_path_write(raws, err, "%s/z%smm/raw", folder, distance));
    HADA_TRY(hada_path_write(scenes, err, "%s/z%smm/scene", folder, distance));
    HADA_TRY(hada_folder_ensure(raws, err));
    HADA_TRY(hada_folder_ensure(scenes, err));
    for (int i = 0; i < info->counts[z]; i++) {
        HADA_TRY(write_pair(w, z, i, raws, scenes, err));
        HADA_TRY(hada_progress_step(&w->progress, NULL, err));
    }
    return HADA_OK;
}

static hada_status write_all(void *user, const char *folder, hada_error *err)
{
    writing *w = user;
    const hada_dataset_info *info = hada_dataset_get_info(w->data);
    hada_status status = HADA_OK;
    w->progress = hada_progress_begin(w->task.monitor, "pairs", info->pairs);
    for (int z = 0; z < info->depths; z++)
        HADA_TRY_OR_DONE(write_depth(w, z, folder, err));
done:
    hada_progress_end(&w->progress);
    return status;
}

hada_status hada_register_write(const hada_register_report *report, const hada_dataset *data, const char *folder,
                                const hada_register_task *task, int *rows, int *cols, hada_error *err)
{
    writing w = {.report = report, .data = data};
    HADA_NEED(report && data && folder, err);
    HADA_TRY(choose_window(&w, task, err));
    HADA_TRY(hada_folder_create(folder, write_all, &w, err));
    give_window(&w, rows, cols);
    return HADA_OK;
}

/* How the scenes of a data set are placed as they are read. */
typedef struct placement {
    int rows, cols;
    hada_registration depth[];
} placement;

static hada_status place_scene(const void *of, int depth, hada_image *scene, hada_error *err)
{
    const placement *all = of;
    hada_image placed = {0};
    HADA_TRY(hada_register_apply(&placed, scene, &all->depth[depth], all->rows, all->cols, err));
    hada_image_destroy(scene);
    *scene = placed;
    return HADA_OK;
}

hada_status hada_register_place(const hada_register_report *report, hada_dataset *data, const hada_register_task *task,
                                int *rows, int *cols, hada_error *err)
{
    writing w = {.report = report, .data = data};
    placement *all = NULL;
    HADA_NEED(report && data, err);
    HADA_TRY(choose_window(&w, task, err));
    const size_t depths = (size_t)hada_dataset_get_info(data)->depths;
    HADA_TRY(hada_allocated(all = hada_alloc(1, sizeof *all + depths * sizeof *all->depth, "placed scenes", err)));
    all->rows = w.rows;
    all->cols = w.cols;
    for (size_t z = 0; z < depths; z++)
        all->depth[z] = *report->depths[z]->applied;
    hada_pair_store_place(data->store, place_scene, all);
    give_window(&w, rows, cols);
    return HADA_OK;
}
