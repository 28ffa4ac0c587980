/* Tables and pictures about a camera. */
#include <hadalens/folder.h>
#include <hadalens/preview.h>

#include "io/folder.h"
#include "io/text.h"
#include "optics/mask.h"
#include "tasks/optics_files.h"

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

static void put_depths(hada_text *out, const hada_optics_report *report)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    for (int c = 0; c < COLUMNS; c++)
        hada_text_add(out, "%s%s", c ? "," : "", columns[c].name);
    hada_text_add(out, "\n");
    for (int z = 0; z < curves->depths; z++) {
        for (int c = 0; c < COLUMNS; c++)
            put(out, c ? "," : "", value_of(hada_optics_report_row(report, z), c));
        hada_text_add(out, "\n");
    }
}

static void put_heads(hada_text *out, const char *first, const hada_optics_report *report)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    hada_text_add(out, "%s", first);
    for (int z = 0; z < curves->depths; z++) {
        put(out, ",z", hada_optics_report_row(report, z)->distance_mm);
        hada_text_add(out, "mm");
    }
    hada_text_add(out, "\n");
}

static void put_mtf(hada_text *out, const hada_optics_report *report)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    put_heads(out, "cycles_per_pixel", report);
    for (int i = 0; i < curves->frequencies; i++) {
        put(out, "", (i + 0.5) / (2.0 * curves->frequencies));
        for (int z = 0; z < curves->depths; z++)
            put(out, ",", curves->mtf[(size_t)z * (size_t)curves->frequencies + (size_t)i]);
        hada_text_add(out, "\n");
    }
}

static void put_self(hada_text *out, const hada_optics_report *report)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    put_heads(out, "lag_pixels", report);
    for (int i = 0; i < curves->lags; i++) {
        put(out, "", i);
        for (int z = 0; z < curves->depths; z++)
            put(out, ",", curves->self[(size_t)z * (size_t)curves->lags + (size_t)i]);
        hada_text_add(out, "\n");
    }
}

static void put_correlation(hada_text *out, const hada_optics_report *report)
{
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    put_heads(out, "distance_mm", report);
    for (int i = 0; i < curves->depths; i++) {
        put(out, "", hada_optics_report_row(report, i)->distance_mm);
        for (int z = 0; z < curves->depths; z++)
            put(out, ",", curves->correlation[(size_t)i * (size_t)curves->depths + (size_t)z]);
        hada_text_add(out, "\n");
    }
}

static hada_status write_text(hada_text *text, const char *folder, const char *name, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_path path;
    if (text->failed)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory for %s", name));
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/%s", folder, name));
    HADA_TRY_OR_DONE(hada_file_write(path, text->data, text->length, err));
done:
    free(text->data);
    *text = (hada_text){0};
    return status;
}

hada_status hada_optics_tables(const hada_optics_report *report, const char *folder, hada_error *err)
{
    static const struct {
        const char *name;
        void (*write)(hada_text *out, const hada_optics_report *report);
    } tables[] = {{"depths.csv", put_depths},
                  {"mtf.csv", put_mtf},
                  {"self_correlation.csv", put_self},
                  {"correlation.csv", put_correlation}};
    for (size_t i = 0; i < sizeof tables / sizeof *tables; i++) {
        hada_text text = {0};
        tables[i].write(&text, report);
        HADA_TRY(write_text(&text, folder, tables[i].name, err));
    }
    return HADA_OK;
}

hada_status hada_optics_lenses(const hada_camera *camera, const char *folder, hada_error *err)
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
    HADA_TRY_OR_DONE(write_text(&text, folder, "lenses.csv", err));
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

hada_status hada_optics_mask(const hada_camera *camera, const char *folder, const hada_monitor *monitor,
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
