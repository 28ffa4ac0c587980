/* What a camera resolves: its PSFs, the report on them, and the folder that tells it. */
#include <hadalens/folder.h>
#include <hadalens/plot.h>
#include <hadalens/preview.h>
#include <hadalens/task_optics.h>
#include <hadalens/tiff.h>

#include "core/base.h"
#include "core/callers.h"
#include "io/folder.h"
#include "io/text.h"
#include "optics/mask.h"

/* Tables and pictures about a camera. */

static const struct {
    const char *name;
    size_t offset;
} columns[] = {
    {"distance_mm", offsetof(hada_optics_row, distance_mm)},
    {"magnification", offsetof(hada_optics_row, magnification)},
    {"defocus_pixels", offsetof(hada_optics_row, defocus_pixels)},
    {"airy_pixels", offsetof(hada_optics_row, airy_pixels)},
    {"object_pixel_mm", offsetof(hada_optics_row, object_pixel_mm)},
    {"light", offsetof(hada_optics_row, light)},
    {"spot_pixels", offsetof(hada_optics_row, spot_pixels)},
    {"sidelobe", offsetof(hada_optics_row, sidelobe)},
    {"cutoff_cycles_per_pixel", offsetof(hada_optics_row, cutoff)},
    {"support", offsetof(hada_optics_row, support)},
    {"lateral_mm", offsetof(hada_optics_row, lateral_mm)},
    {"axial_mm", offsetof(hada_optics_row, axial_mm)},
    {"axial_design_mm", offsetof(hada_optics_row, axial_design_mm)},
    {"occupancy", offsetof(hada_optics_row, occupancy)},
};
enum { COLUMNS = sizeof columns / sizeof *columns };

static double value_of(const hada_optics_row *row, int column)
{
    return *(const double *)(const void *)((const char *)row + columns[column].offset);
}

const char *hada_optics_column(int column, const hada_optics_row *row, double *value)
{
    const int known = column >= 0 && column < COLUMNS;
    if (value)
        *value = known && row ? value_of(row, column) : (double)NAN;
    return known ? columns[column].name : NULL;
}

/* NaN is an empty cell. */
static void put(hada_text *out, const char *before, double number)
{
    char digits[32] = "";
    if (isfinite(number))
        hada_format_number(digits, sizeof digits, "%.6g", number);
    hada_text_add(out, "%s%s", before, digits);
}

/* Empties the text. */
static hada_status save_table(hada_text *text, const char *folder, const char *name, hada_error *err)
{
    hada_path path;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/%s.csv", folder, name));
    HADA_TRY_OR_DONE(hada_text_save(text, path, err));
done:
    free(text->data);
    return status;
}

/* A quantity of each depth over some places: a table of all, and a figure with curves of some depths. */
typedef struct family {
    const char *name, *place, *title; /* place: what a line of the table begins with */
    hada_plot_axis across, up;
    const double *x, *values; /* values[depth][count] */
    int count, shown;         /* places; of these in the figure */
    double level;             /* a dashed line; NaN: none */
} family;

static hada_status write_family(const hada_optics_report *report, const family *f, const char *folder, hada_error *err)
{
    const int depths = hada_optics_report_curves(report)->depths;
    hada_text text = {0};
    hada_text_add(&text, "%s", f->place);
    for (int z = 0; z < depths; z++) {
        put(&text, ",z", hada_optics_report_row(report, z)->distance_mm);
        hada_text_add(&text, "mm");
    }
    hada_text_add(&text, "\n");
    for (int i = 0; i < f->count; i++) {
        put(&text, "", f->x[i]);
        for (int z = 0; z < depths; z++)
            put(&text, ",", f->values[(size_t)z * (size_t)f->count + (size_t)i]);
        hada_text_add(&text, "\n");
    }
    return save_table(&text, folder, f->name, err);
}

static hada_status write_depths_table(const hada_optics_report *report, const char *folder, hada_error *err)
{
    hada_text text = {0};
    for (int c = 0; c < COLUMNS; c++)
        hada_text_add(&text, "%s%s", c ? "," : "", columns[c].name);
    hada_text_add(&text, "\n");
    for (int z = 0; z < hada_optics_report_curves(report)->depths; z++) {
        for (int c = 0; c < COLUMNS; c++)
            put(&text, c ? "," : "", value_of(hada_optics_report_row(report, z), c));
        hada_text_add(&text, "\n");
    }
    return save_table(&text, folder, "depths", err);
}

/* lenses.csv: where the lenses or holes are; for masks that have them. */
static hada_status optics_lenses(const hada_camera *camera, const char *folder, hada_error *err)
{
    const size_t count = (size_t)camera->lenses;
    hada_status status = HADA_OK;
    hada_text text = {0};
    double *x = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(x, 2 * count + 1, "the lenses", err));
    HADA_TRY_OR_DONE(hada_camera_lenses(camera, x, x + count, err));
    hada_text_add(&text, "x_mm,y_mm\n");
    for (size_t i = 0; i < count; i++) {
        hada_text_add_number(&text, x[i]);
        hada_text_add(&text, ",");
        hada_text_add_number(&text, x[count + i]);
        hada_text_add(&text, "\n");
    }
    HADA_TRY_OR_DONE(save_table(&text, folder, "lenses", err));
done:
    free(x);
    return status;
}

/* Thickness as grey where the mask is open, from a dark grey, so that thin places are not taken for closed ones. */
static void shade(hada_image *open, const hada_image *thickness)
{
    const float darkest = 0.15f;
    const size_t count = hada_image_count(open);
    float low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < count; i++)
        if (open->data[i] > 0.5f) {
            low = fminf(low, thickness->data[i]);
            high = fmaxf(high, thickness->data[i]);
        }
    for (size_t i = 0; i < count && high > low; i++)
        open->data[i] *=
            darkest + (1.0f - darkest) * fminf(fmaxf((thickness->data[i] - low) / (high - low), 0.0f), 1.0f);
}

/* mask.png: the mask's thickness where it is open, or its openings. */
static hada_status optics_mask(const hada_camera *camera, const char *folder, const hada_monitor *monitor,
                               hada_error *err)
{
    enum { SIDE = 720 };
    hada_status status = HADA_OK;
    hada_image thickness = {0}, open = {0};
    hada_mask_design design = {.monitor = monitor};
    hada_path path;
    if (!hada_pictures_available())
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/mask.png", folder));
    HADA_TRY_OR_DONE(hada_mask_make_watched(&design, camera, monitor, err));
    HADA_TRY_OR_DONE(hada_mask_map(&design, SIDE, SIDE, &thickness, &open, err));
    shade(&open, &thickness);
    HADA_TRY_OR_DONE(hada_png_save(path, &open, 1.0, 1.0, err));
done:
    hada_mask_free(&design);
    hada_image_destroy(&thickness);
    hada_image_destroy(&open);
    return status;
}

/* Figures about a camera: the tables as curves. */

enum { CURVES = 5 };

/* Depths that figures show: near, far, and some between. */
static int chosen(const hada_optics_report *report, int out[CURVES])
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    const int count = curves->depths < CURVES ? curves->depths : CURVES;
    for (int i = 0; i < count; i++)
        out[i] = count > 1 ? (int)lrint((double)i * (curves->depths - 1) / (count - 1)) : 0;
    return count;
}

static unsigned colour_of(int curve)
{
    static const int order[CURVES] = {5, 2, 3, 1, 0}; /* of hada_plot_colour(): those that stand out on white */
    return hada_plot_colour(order[curve % CURVES]);
}

static hada_status save(const hada_plot *plot, const char *folder, const char *name, hada_error *err)
{
    hada_path path;
    HADA_TRY(hada_path_write(path, err, "%s/%s.svg", folder, name));
    return hada_plot_save(plot, path, err);
}

/* One panel with a curve for each chosen depth, and a legend above. */
static hada_status plot_family(const hada_optics_report *report, const family *f, const char *folder, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_plot *plot = NULL;
    double *y = NULL, at = 70;
    int depth[CURVES];
    const int curves = chosen(report, depth);
    HADA_TRY_OR_DONE(HADA_NEW(y, (size_t)f->shown, "a figure", err));
    HADA_TRY_OR_DONE(hada_plot_create(&plot, 640, 420, err));
    for (int i = 0; i < curves; i++) {
        char number[32], text[40];
        hada_format_number(number, sizeof number, "%.4g", hada_optics_report_row(report, depth[i])->distance_mm);
        snprintf(text, sizeof text, "%s mm", number);
        at = hada_plot_legend(plot, at, 20, NULL, colour_of(i), text);
    }
    const hada_plot_panel panel = {
        .left = 70, .top = 60, .width = 540, .height = 290, .across = f->across, .up = f->up, .title = f->title};
    hada_plot_panel_begin(plot, &panel);
    if (isfinite(f->level)) {
        const double x[] = {f->across.low, f->across.high}, level[] = {f->level, f->level};
        hada_plot_line(plot, x, level, 2, 0x777777, 1);
    }
    for (int i = 0; i < curves; i++) {
        const double *values = f->values + (size_t)depth[i] * (size_t)f->count;
        for (int k = 0; k < f->shown; k++)
            y[k] = fmin(fmax(values[k], f->up.low), f->up.high);
        hada_plot_line(plot, f->x, y, f->shown, colour_of(i), 0);
    }
    hada_plot_panel_end(plot);
    HADA_TRY_OR_DONE(save(plot, folder, f->name, err));
done:
    hada_plot_destroy(&plot);
    free(y);
    return status;
}

/* A quantity over the distances. */
typedef struct curve {
    const char *name;
    size_t offset;
} curve;

#define OF(member) offsetof(hada_optics_row, member)

static int collect(const hada_optics_report *report, size_t offset, double *x, double *y)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    int count = 0;
    for (int z = 0; z < curves->depths; z++) {
        const double value = *(const double *)(const void *)((const char *)hada_optics_report_row(report, z) + offset);
        if (isfinite(value) && value > 0.0) {
            x[count] = hada_optics_report_row(report, z)->distance_mm;
            y[count++] = value;
        }
    }
    return count;
}

static void plot_quantities(hada_plot *plot, const hada_optics_report *report, hada_plot_panel *panel,
                            const char *label, const curve *curves, int count)
{
    double x[HADA_CAMERA_DEPTHS], y[HADA_CAMERA_DEPTHS], all[4 * HADA_CAMERA_DEPTHS];
    int values = 0;
    for (int i = 0; i < count; i++) {
        const int found = collect(report, curves[i].offset, x, y);
        for (int k = 0; k < found; k++)
            all[values++] = y[k];
    }
    if (!values) /* a panel that stays empty */
        all[values++] = 1.0;
    panel->up = hada_plot_axis_for(all, values, 1, label);
    hada_plot_panel_begin(plot, panel);
    for (int i = 0; i < count; i++) {
        const hada_plot_mark mark = {HADA_PLOT_DISC, colour_of(i), 2.5, 0, 0};
        const int found = collect(report, curves[i].offset, x, y);
        hada_plot_line(plot, x, y, found, colour_of(i), 0);
        for (int k = 0; k < found; k++)
            hada_plot_point(plot, x[k], y[k], &mark);
        if (found)
            hada_plot_label(plot, x[found / 2], y[found / 2], curves[i].name);
    }
    hada_plot_panel_end(plot);
}

static hada_status plot_depths(const hada_optics_report *report, const char *folder, hada_error *err)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    static const curve scale[] = {{"magnification 1 + d/z", OF(magnification)}, {"occupancy N R M²", OF(occupancy)}};
    static const curve blur[] = {
        {"defocus", OF(defocus_pixels)}, {"Airy radius", OF(airy_pixels)}, {"spot, measured", OF(spot_pixels)}};
    static const curve object[] = {{"lateral", OF(lateral_mm)},
                                   {"axial, by correlation", OF(axial_mm)},
                                   {"axial, by design", OF(axial_design_mm)}};
    static const curve band[] = {{"support of the MTF", OF(support)},
                                 {"self-correlation beside the peak", OF(sidelobe)}};
    const double ends[] = {hada_optics_report_row(report, 0)->distance_mm,
                           hada_optics_report_row(report, curves->depths - 1)->distance_mm};
    hada_plot *plot = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_plot_create(&plot, 900, 660, err));
    hada_plot_panel panel = {.width = 340, .height = 210};
    panel.across = hada_plot_axis_for(ends, 2, 1, "distance, mm");
    panel.left = 80, panel.top = 50, panel.title = "Scale";
    plot_quantities(plot, report, &panel, "ratio", scale, 2);
    panel.left = 530, panel.title = "On the sensor";
    plot_quantities(plot, report, &panel, "pixels", blur, 3);
    panel.left = 80, panel.top = 370, panel.title = "Resolution at the object";
    plot_quantities(plot, report, &panel, "mm", object, 3);
    panel.left = 530, panel.title = "Frequencies and likeness";
    plot_quantities(plot, report, &panel, "share", band, 2);
    HADA_TRY_OR_DONE(save(plot, folder, "depths", err));
done:
    hada_plot_destroy(&plot);
    return status;
}

/* depths, mtf, self_correlation, correlation: .csv, and .svg where there are pictures. */
static hada_status write_curves(const hada_optics_report *report, const char *folder, hada_error *err)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    const int bins = curves->frequencies, lags = curves->lags, depths = curves->depths, shown = hada_least(lags, 64);
    hada_status status = HADA_OK;
    double *frequency = NULL, *lag = NULL, *distance = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(frequency, (size_t)bins, "a figure", err));
    HADA_TRY_OR_DONE(HADA_NEW(lag, (size_t)lags, "a figure", err));
    HADA_TRY_OR_DONE(HADA_NEW(distance, (size_t)depths, "a figure", err));
    for (int i = 0; i < bins; i++)
        frequency[i] = (i + 0.5) / (2.0 * bins);
    for (int i = 0; i < lags; i++)
        lag[i] = i;
    for (int z = 0; z < depths; z++)
        distance[z] = hada_optics_report_row(report, z)->distance_mm;
    const family families[] = {{.name = "mtf",
                                .place = "cycles_per_pixel",
                                .title = "Modulation transfer, mean of a ring; dashed: threshold",
                                .across = {0, 0.5, 0, 0, "cycles per pixel"},
                                .up = {1e-3, 1, 1, 0, "MTF"},
                                .x = frequency,
                                .values = curves->mtf,
                                .count = bins,
                                .shown = bins,
                                .level = curves->threshold},
                               {.name = "self_correlation",
                                .place = "lag_pixels",
                                .title = "Self-correlation of the PSF, largest at each distance",
                                .across = {0, shown > 1 ? shown - 1 : 1, 0, 0, "pixels"},
                                .up = {0, 1, 0, 0, "relative to the peak"},
                                .x = lag,
                                .values = curves->self,
                                .count = lags,
                                .shown = shown,
                                .level = NAN},
                               {.name = "correlation",
                                .place = "distance_mm",
                                .title = "Correlation of the PSF with those of other distances",
                                .across = hada_plot_axis_for(distance, depths, 1, "distance, mm"),
                                .up = {0, 1, 0, 0, "correlation"},
                                .x = distance,
                                .values = curves->correlation,
                                .count = depths,
                                .shown = depths,
                                .level = 0.5}};
    HADA_TRY_OR_DONE(write_depths_table(report, folder, err));
    if (hada_pictures_available())
        HADA_TRY_OR_DONE(plot_depths(report, folder, err));
    for (size_t i = 0; i < HADA_COUNT(families); i++) {
        HADA_TRY_OR_DONE(write_family(report, &families[i], folder, err));
        if (hada_pictures_available())
            HADA_TRY_OR_DONE(plot_family(report, &families[i], folder, err));
    }
done:
    HADA_FREE(frequency, lag, distance);
    return status;
}

#define PSF_GAMMA 0.4 /* shows the light around spots */

/* Where PSFs come from: a file, waves, or (neither) rays. */
typedef struct source {
    hada_tiff_reader *reader;
    hada_wave *wave;
    const hada_monitor *monitor;
} source;

static hada_status source_open(source *from, const hada_optics_task *task, const hada_camera *camera,
                               hada_context *context, hada_error *err)
{
    if (!task->psf) {
        hada_wave_options waves;
        hada_wave_options_init(&waves);
        waves.coherent = task->coherent;
        waves.monitor = task->monitor;
        return camera->optics == HADA_OPTICS_WAVE ? hada_wave_create(&from->wave, context, camera, &waves, err)
                                                  : HADA_OK;
    }
    HADA_TRY(hada_tiff_open(&from->reader, task->psf, err));
    const hada_tiff_info *info = hada_tiff_get_info(from->reader);
    if (info->frames != camera->depths || info->rows != camera->rows || info->cols != camera->cols)
        HADA_TRY(hada_fail(err, HADA_ERROR_SIZE,
                           "%s holds %d pages of %dx%d; the camera has %d depths and %dx%d pixels: set options.depths "
                           "and options.size, or give its camera.json",
                           task->psf, info->frames, info->rows, info->cols, camera->depths, camera->rows,
                           camera->cols));
    return HADA_OK;
}

static hada_status source_get(source *from, const hada_camera *camera, int z, hada_image *psf, hada_error *err)
{
    const double distance = camera->distances_mm[z];
    if (from->reader)
        return hada_tiff_read(from->reader, z, psf, err);
    return from->wave ? hada_wave_psf(from->wave, distance, camera->rows, camera->cols, psf, err)
                      : hada_camera_psf_watched(camera, distance, camera->rows, camera->cols, from->monitor, psf, err);
}

static hada_status write_psf(hada_tiff_writer **writer, const hada_camera *camera, const hada_image *psf,
                             const char *folder, hada_error *err)
{
    hada_path path;
    if (!*writer) {
        hada_tiff_write_options how;
        hada_tiff_write_options_init(&how);
        how.layout = HADA_TIFF_HYPERSTACK;
        how.slices = camera->depths;
        how.times = 1;
        how.distances_mm = camera->distances_mm;
        HADA_TRY(hada_path_write(path, err, "%s/psf.tif", folder));
        HADA_TRY(hada_tiff_create(writer, path, psf->channels, psf->rows, psf->cols, &how, err));
    }
    return hada_tiff_write(*writer, psf, err);
}

static hada_status write_picture(const hada_image *psf, double distance, const char *folder, hada_error *err)
{
    char number[32];
    hada_path path;
    if (!hada_pictures_available())
        return HADA_OK;
    hada_format_exact(number, sizeof number, distance);
    HADA_TRY(hada_path_write(path, err, "%s/psf_z%smm.png", folder, number));
    return hada_png_save(path, psf, HADA_AUTO, PSF_GAMMA, err);
}

/* What one run works on. */
typedef struct run {
    const hada_optics_task *task;
    const hada_camera *camera;
    hada_context *context;
    hada_optics_report **report;
    double threshold;
} run;

static hada_status write_depths(const run *r, source *from, const char *folder, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_tiff_writer *writer = NULL;
    hada_image psf = {0};
    hada_progress progress = hada_progress_begin(r->task->monitor, "depths", r->camera->depths);
    for (int z = 0; z < r->camera->depths; z++) {
        HADA_TRY_OR_DONE(source_get(from, r->camera, z, &psf, err));
        HADA_TRY_OR_DONE(write_psf(&writer, r->camera, &psf, folder, err));
        HADA_TRY_OR_DONE(write_picture(&psf, r->camera->distances_mm[z], folder, err));
        HADA_TRY_OR_DONE(hada_optics_report_add(*r->report, &psf, err));
        hada_image_destroy(&psf);
        HADA_TRY_OR_DONE(hada_progress_step(&progress, NULL, err));
    }
    HADA_TRY_OR_DONE(hada_tiff_finish(&writer, err));
done:
    hada_progress_end(&progress);
    hada_tiff_abandon(&writer);
    hada_image_destroy(&psf);
    return status;
}

static hada_status fill_folder(void *user, const char *folder, hada_error *err)
{
    const run *r = user;
    const hada_camera *camera = r->camera;
    const int holes = camera->mask == HADA_MASK_APERTURE && !(camera->cell_mm > 0.0);
    hada_status status = HADA_OK;
    source from = {.monitor = r->task->monitor};
    hada_path path;
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/camera.json", folder));
    HADA_TRY_OR_DONE(hada_camera_save(camera, path, err));
    HADA_TRY_OR_DONE(optics_mask(camera, folder, r->task->monitor, err));
    if (camera->mask == HADA_MASK_MLA || camera->mask == HADA_MASK_GRID || holes)
        HADA_TRY_OR_DONE(optics_lenses(camera, folder, err));
    HADA_TRY_OR_DONE(source_open(&from, r->task, camera, r->context, err));
    HADA_TRY_OR_DONE(hada_optics_report_create(r->report, r->context, camera, r->threshold, err));
    HADA_TRY_OR_DONE(write_depths(r, &from, folder, err));
    HADA_TRY_OR_DONE(write_curves(*r->report, folder, err));
done:
    hada_tiff_close(&from.reader);
    hada_wave_destroy(&from.wave);
    return status;
}

hada_status hada_optics_run(hada_optics_report **report, hada_context *context, const hada_camera *camera,
                            const char *folder, const hada_optics_task *callers, hada_error *err)
{
    HADA_NEED(context && camera && folder, err);
    hada_optics_task task;
    hada_status status = HADA_OK;
    hada_optics_report *made = NULL;
    if (report)
        *report = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&task, callers, hada_optics_task, err));
    if (task.threshold != HADA_AUTO && !(task.threshold >= 0.0 && task.threshold < 1.0))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT, "options.threshold takes a number from 0 to 1"));
    run r = {&task, camera, context, &made, task.threshold};
    HADA_TRY_OR_DONE(hada_folder_create(folder, fill_folder, &r, err));
    if (report) {
        *report = made;
        made = NULL;
    }
done:
    hada_optics_report_destroy(&made);
    return status;
}
