/* How the scenes of each depth stand on the sensor, and what of it is applied. */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "core/callers.h"
#include "io/folder.h"
#include "tasks/registered.h"

/* PSFs of neighbouring depths that are less alike than this say nothing about a shift. */
#define LEAST_LIKENESS 0.3
/* Figures that explain a smaller share of the frames' structure are rough. */
#define LEAST_EXPLAINED 0.05
/* What cannot be told from nothing: a pixel, or this share of the way from the middle to a corner. */
#define PRECISION 0.005

const hada_registered_depth *hada_register_report_depth(const hada_register_report *report, int depth)
{
    if (!report)
        return NULL;
    return &report->depth[depth].depth;
}

void hada_register_report_destroy(hada_register_report **report)
{
    if (!report)
        return;
    if (*report)
        free((*report)->depth);
    free(*report);
    *report = NULL;
}

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
}

static hada_status pictures_load(pictures *all, const hada_dataset *data, int z, hada_error *err)
{
    const int pairs = hada_dataset_get_info(data)->counts[z];
    const int count = pairs < HADA_REGISTER_PAIRS ? pairs : HADA_REGISTER_PAIRS;
    for (all->count = 0; all->count < count; all->count++)
        HADA_TRY(hada_dataset_read(data, z, (int)((long)all->count * pairs / count), &all->raws[all->count],
                                   &all->scenes[all->count], err));
    return HADA_OK;
}

/* Half of a scene's diagonal, in pixels. */
static double half_diagonal(const hada_registered_depth *one)
{
    return 0.5 * hypot(one->scene_rows, one->scene_cols);
}

/* The farthest that the transform moves a pixel of the scene, against one with flips and quarter turns alone. */
static double displacement_of(const hada_registered *one)
{
    const hada_registration *r = &one->found;
    const double angle = r->rotation_deg * acos(-1.0) / 180.0;
    const double dy = r->magnification * cos(angle) - 1.0, dx = r->magnification * sin(angle);
    return half_diagonal(&one->depth) * hypot(dy, dx) + hypot(r->offset_row, r->offset_col);
}

static void choose_applied(hada_registered *one, const hada_registration *first)
{
    hada_registered_depth *depth = &one->depth;
    hada_registration *r = &one->applied;
    depth->displacement = displacement_of(one);
    *r = one->found;
    if (depth->displacement < fmax(1.0, PRECISION * half_diagonal(depth))) {
        r->magnification = 1.0;
        r->rotation_deg = r->offset_row = r->offset_col = 0.0;
    }
    depth->stands_right = !r->mirrored && !r->quarter_turns && r->magnification == 1.0 && r->rotation_deg == 0.0 &&
                          r->offset_row == 0.0 && r->offset_col == 0.0;
    depth->rough = one->found.explained < LEAST_EXPLAINED;
    depth->other_orientation =
        one->found.mirrored != first->mirrored || one->found.quarter_turns != first->quarter_turns;
    depth->found = &one->found;
    depth->applied = r;
}

/* The offset of a depth from the one before, whose own offset is known: its PSF is that depth's, scaled and moved. */
static hada_status find_offset(hada_registered *one, const hada_registration *before, const hada_image *psf,
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
static hada_status find_depth(hada_register_report *report, int z, const hada_dataset *data,
                              const hada_register_options *search, int with_offset, hada_image *last, hada_error *err)
{
    hada_registered *one = &report->depth[z];
    hada_registered_depth *depth = &one->depth;
    pictures of = {0};
    hada_image psf = {0};
    double pitch;
    hada_status status = HADA_OK;
    depth->likeness = NAN;
    hada_registration_init(&one->found);
    HADA_TRY_OR_DONE(pictures_load(&of, data, z, err));
    depth->pairs = of.count;
    depth->scene_rows = of.scenes->rows;
    depth->scene_cols = of.scenes->cols;
    HADA_TRY_OR_DONE(hada_register_pairs(&one->found, of.raws, of.scenes, of.count, search, err));
    if (with_offset)
        HADA_TRY_OR_DONE(hada_register_psf(&psf, &pitch, of.raws, of.scenes, of.count, &one->found, err));
    if (with_offset && z)
        HADA_TRY_OR_DONE(find_offset(one, &report->depth[z - 1].found, &psf, last, pitch, err));
    depth->offset_unknown = depth->likeness < LEAST_LIKENESS;
    choose_applied(one, &report->depth[0].found);
done:
    pictures_free(&of);
    hada_image_destroy(last);
    *last = psf;
    if (status)
        hada_error_prefix_path(err, hada_dataset_folder(data, z));
    return status;
}

static hada_status find_all(hada_register_report *report, const hada_dataset *data, const hada_register_task *task,
                            hada_error *err)
{
    const int depths = hada_dataset_get_info(data)->depths;
    hada_register_options search;
    hada_image last = {0};
    hada_status status = HADA_OK;
    status = HADA_OPTIONS_TAKE(&search, task->search, hada_register_options, err);
    if (status)
        return status;
    if (!search.monitor)
        search.monitor = task->monitor;
    hada_progress progress = hada_progress_begin(task->monitor, "depths", depths);
    for (int z = 0; z < depths; z++) {
        HADA_TRY_OR_DONE(find_depth(report, z, data, &search, depths > 1 && !task->keep_offsets, &last, err));
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
    HADA_NEED(out && data, err);
    hada_register_task task;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&task, callers, hada_register_task, err));
    HADA_TRY_OR_DONE(hada_allocated(*out = hada_alloc(1, sizeof **out, "a report", err)));
    HADA_TRY_OR_DONE(hada_allocated((*out)->depth = hada_alloc((size_t)hada_dataset_get_info(data)->depths,
                                                               sizeof *(*out)->depth, "a report", err)));
    HADA_TRY_OR_DONE(find_all(*out, data, &task, err));
done:
    if (status)
        hada_register_report_destroy(out);
    return status;
}
