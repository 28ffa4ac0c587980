#include "folder.h"
#include "optics_files.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include <hadalens/preview.h>

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

static double value(const hada_optics_row *row, int column)
{
    return *(const double *)(const void *)((const char *)row + columns[column].offset);
}

json_t *hada_cli_optics_json(const hada_optics_report *report)
{
    json_t *rows = json_array();
    for (int z = 0; z < report->depths; z++) {
        json_t *row = json_object();
        for (int c = 0; c < COLUMNS; c++)
            json_object_set_new(row, columns[c].name, hada_cli_real(value(&report->row[z], c)));
        json_array_append_new(rows, row);
    }
    return rows;
}

/* NaN is an empty cell. */
static void put(FILE *out, const char *before, double number)
{
    if (isfinite(number))
        fprintf(out, "%s%.6g", before, number);
    else
        fprintf(out, "%s", before);
}

static void put_depths(FILE *out, const hada_optics_report *report)
{
    for (int c = 0; c < COLUMNS; c++)
        fprintf(out, "%s%s", c ? "," : "", columns[c].name);
    fprintf(out, "\n");
    for (int z = 0; z < report->depths; z++) {
        for (int c = 0; c < COLUMNS; c++)
            put(out, c ? "," : "", value(&report->row[z], c));
        fprintf(out, "\n");
    }
}

static void put_heads(FILE *out, const char *first, const hada_optics_report *report)
{
    fprintf(out, "%s", first);
    for (int z = 0; z < report->depths; z++)
        fprintf(out, ",z%gmm", report->row[z].distance_mm);
    fprintf(out, "\n");
}

static void put_mtf(FILE *out, const hada_optics_report *report)
{
    put_heads(out, "cycles_per_pixel", report);
    for (int i = 0; i < report->frequencies; i++) {
        put(out, "", (i + 0.5) / (2.0 * report->frequencies));
        for (int z = 0; z < report->depths; z++)
            put(out, ",", report->mtf[(size_t)z * (size_t)report->frequencies + (size_t)i]);
        fprintf(out, "\n");
    }
}

static void put_self(FILE *out, const hada_optics_report *report)
{
    put_heads(out, "lag_pixels", report);
    for (int i = 0; i < report->lags; i++) {
        put(out, "", i);
        for (int z = 0; z < report->depths; z++)
            put(out, ",", report->self[(size_t)z * (size_t)report->lags + (size_t)i]);
        fprintf(out, "\n");
    }
}

static void put_correlation(FILE *out, const hada_optics_report *report)
{
    put_heads(out, "distance_mm", report);
    for (int i = 0; i < report->depths; i++) {
        put(out, "", report->row[i].distance_mm);
        for (int z = 0; z < report->depths; z++)
            put(out, ",", report->correlation[(size_t)i * (size_t)report->depths + (size_t)z]);
        fprintf(out, "\n");
    }
}

hada_status hada_cli_optics_tables(const hada_optics_report *report, const char *folder, hada_error *err)
{
    static const struct {
        const char *name;
        void (*write)(FILE *out, const hada_optics_report *report);
    } tables[] = {
        {"depths", put_depths}, {"mtf", put_mtf}, {"self_correlation", put_self}, {"correlation", put_correlation}};
    hada_status status = HADA_OK;
    for (size_t i = 0; i < sizeof tables / sizeof *tables && !status; i++) {
        char *text = NULL, *path = hada_cli_text("%s/%s.csv", folder, tables[i].name);
        size_t size = 0;
        FILE *out = open_memstream(&text, &size);
        if (out)
            tables[i].write(out, report);
        if (!out || fclose(out) || !path)
            status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
        else
            status = hada_cli_write_text(path, text, size, err);
        free(text);
        free(path);
    }
    return status;
}

hada_status hada_cli_optics_lenses(const hada_camera *camera, const char *folder, hada_error *err)
{
    const size_t count = (size_t)camera->lenses, size = 64 * (count + 1);
    double *x = calloc(2 * count + 1, sizeof *x);
    char *text = malloc(size), *path = hada_cli_text("%s/lenses.csv", folder);
    hada_status status = x && text && path ? hada_camera_lenses(camera, x, x + count, err)
                                           : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status) {
        size_t end = (size_t)snprintf(text, size, "x_mm,y_mm\n");
        for (size_t i = 0; i < count; i++)
            end += (size_t)snprintf(text + end, size - end, "%.15g,%.15g\n", x[i], x[count + i]);
        status = hada_cli_write_text(path, text, end, err);
    }
    free(x);
    free(text);
    free(path);
    return status;
}

hada_status hada_cli_optics_mask(const hada_camera *camera, const char *folder, hada_error *err)
{
    enum { SIDE = 720 };
    hada_image thickness = {0}, open = {0};
    char *path = hada_cli_text("%s/mask.png", folder);
    hada_status status = path ? hada_camera_mask_map(camera, SIDE, SIDE, &thickness, &open, err)
                              : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    float low = INFINITY, high = -INFINITY;
    const size_t count = hada_image_count(&open);
    for (size_t i = 0; i < count && !status; i++)
        if (open.data[i] > 0.5f) {
            low = fminf(low, thickness.data[i]);
            high = fmaxf(high, thickness.data[i]);
        }
    /* from a dark grey, so that thin places are not taken for closed ones */
    for (size_t i = 0; i < count && !status && high > low; i++)
        open.data[i] *= 0.15f + 0.85f * fminf(fmaxf((thickness.data[i] - low) / (high - low), 0.0f), 1.0f);
    if (!status && hada_pictures_available())
        status = hada_png_save(path, &open, 1.0, 1.0, err);
    hada_image_destroy(&thickness);
    hada_image_destroy(&open);
    free(path);
    return status;
}
