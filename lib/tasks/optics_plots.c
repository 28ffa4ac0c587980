/* Figures about a camera: the tables as curves. */
#include <hadalens/plot.h>
#include <hadalens/preview.h>

#include "io/folder.h"
#include "io/text.h"
#include "tasks/optics_files.h"

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
typedef struct family {
    const char *name, *title;
    hada_plot_axis across, up;
    const double *x, *values; /* values[depth][stride] */
    int count, stride;
    double level; /* a dashed line; NaN: none */
} family;

static hada_status plot_family(const hada_optics_report *report, const family *f, const char *folder, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_plot *plot = NULL;
    double *y = NULL, at = 70;
    int depth[CURVES];
    const int curves = chosen(report, depth);
    HADA_TRY_OR_DONE(HADA_NEW(y, (size_t)f->count, "a figure", err));
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
        const double *values = f->values + (size_t)depth[i] * (size_t)f->stride;
        for (int k = 0; k < f->count; k++)
            y[k] = fmin(fmax(values[k], f->up.low), f->up.high);
        hada_plot_line(plot, f->x, y, f->count, colour_of(i), 0);
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

hada_status hada_optics_plots(const hada_optics_report *report, const char *folder, hada_error *err)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    const int shown = curves->lags < 64 ? curves->lags : 64;
    const int longest = curves->frequencies > curves->lags ? curves->frequencies : curves->lags;
    hada_status status = HADA_OK;
    double *x = NULL;
    if (!hada_pictures_available())
        return HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(x, (size_t)(longest > curves->depths ? longest : curves->depths), "a figure", err));
    for (int i = 0; i < curves->frequencies; i++)
        x[i] = (i + 0.5) / (2.0 * curves->frequencies);
    const family mtf = {.name = "mtf",
                        .title = "Modulation transfer, mean of a ring; dashed: threshold",
                        .across = {0, 0.5, 0, 0, "cycles per pixel"},
                        .up = {1e-3, 1, 1, 0, "MTF"},
                        .x = x,
                        .values = curves->mtf,
                        .count = curves->frequencies,
                        .stride = curves->frequencies,
                        .level = curves->threshold};
    HADA_TRY_OR_DONE(plot_family(report, &mtf, folder, err));
    for (int i = 0; i < shown; i++)
        x[i] = i;
    const family self = {.name = "self_correlation",
                         .title = "Self-correlation of the PSF, largest at each distance",
                         .across = {0, shown > 1 ? shown - 1 : 1, 0, 0, "pixels"},
                         .up = {0, 1, 0, 0, "relative to the peak"},
                         .x = x,
                         .values = curves->self,
                         .count = shown,
                         .stride = curves->lags,
                         .level = NAN};
    HADA_TRY_OR_DONE(plot_family(report, &self, folder, err));
    for (int z = 0; z < curves->depths; z++)
        x[z] = hada_optics_report_row(report, z)->distance_mm;
    const family correlation = {.name = "correlation",
                                .title = "Correlation of the PSF with those of other distances",
                                .across = hada_plot_axis_for(x, curves->depths, 1, "distance, mm"),
                                .up = {0, 1, 0, 0, "correlation"},
                                .x = x,
                                .values = curves->correlation,
                                .count = curves->depths,
                                .stride = curves->depths,
                                .level = 0.5};
    HADA_TRY_OR_DONE(plot_family(report, &correlation, folder, err));
    HADA_TRY_OR_DONE(plot_depths(report, folder, err));
done:
    free(x);
    return status;
}
