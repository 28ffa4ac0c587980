#include "tasks/train_pictures.h"

#include <hadalens/plot.h>
#include <hadalens/preview.h>
#include <hadalens/scene.h>
#include <math.h>
#include <stdlib.h>

#include "core/error.h"
#include "io/folder.h"

enum { POINTS = 400 }; /* of a curve: as many as its width in pixels can show */

/* Means over stretches of steps: a figure shows a few hundred points, not all. */
static int thin(const hada_train_log *log, double *x, double *y)
{
    const size_t count = log->loss_count, points = count < POINTS ? count : POINTS;
    for (size_t i = 0; i < points; i++) {
        const size_t first = i * count / points, last = (i + 1) * count / points;
        x[i] = y[i] = 0;
        for (size_t k = first; k < last; k++) {
            x[i] += log->loss[k].step / (double)(last - first);
            y[i] += log->loss[k].loss / (double)(last - first);
        }
    }
    return (int)points;
}

static void draw_losses(hada_plot *plot, const hada_train_log *log, double end)
{
    double x[POINTS], y[POINTS];
    const double ends[] = {0, end};
    const int count = thin(log, x, y);
    hada_plot_panel panel = {.left = 70, .top = 34, .width = 560, .height = 200, .title = "Loss"};
    panel.across = hada_plot_axis_for(ends, 2, 0, "steps");
    panel.up = hada_plot_axis_for(y, count, 1, "sum of the weighted terms");
    hada_plot_panel_begin(plot, &panel);
    hada_plot_line(plot, x, y, count, hada_plot_colour(0), 0);
    hada_plot_panel_end(plot);
}

static void draw_validation(hada_plot *plot, const hada_train_log *log, double end)
{
    const int count = (int)log->row_count;
    const double ends[] = {0, end};
    double *room = malloc((size_t)(5 * count + 1) * sizeof *room), *x = room;
    if (!room)
        return;
    double *psnr = x + count, *before = psnr + count, *both = before + count;
    for (int i = 0; i < count; i++) {
        x[i] = (double)log->rows[i].step;
        both[i] = psnr[i] = log->rows[i].result->psnr;
        both[count + i] = before[i] = log->rows[i].result->psnr_before;
    }
    hada_plot_panel panel = {.left = 70, .top = 310, .width = 560, .height = 200, .title = "Held-out pairs"};
    panel.across = hada_plot_axis_for(ends, 2, 0, "steps");
    panel.up = hada_plot_axis_for(both, 2 * count, 0, "PSNR, dB (dashed: before the net)");
    hada_plot_panel_begin(plot, &panel);
    if (count && isfinite(before[0]))
        hada_plot_line(plot, x, before, count, hada_plot_colour(1), 1);
    hada_plot_line(plot, x, psnr, count, hada_plot_colour(0), 0);
    hada_plot_panel_end(plot);
    free(room);
}

hada_status hada_train_figure(const hada_train_log *log, hada_error *err)
{
    hada_plot *plot = NULL;
    char *path = NULL;
    hada_status status = HADA_OK;
    if (!log->loss_count || !hada_pictures_available())
        return HADA_OK;
    const double end = log->loss[log->loss_count - 1].step;
    HADA_TRY_OR_DONE(hada_path_format(&path, err, "%s/training.svg", log->folder));
    HADA_TRY_OR_DONE(hada_plot_create(&plot, 660, log->row_count ? 570 : 290, err));
    draw_losses(plot, log, end);
    if (log->row_count)
        draw_validation(plot, log, end);
    HADA_TRY_OR_DONE(hada_plot_save(plot, path, err));
done:
    hada_plot_destroy(&plot);
    free(path);
    return status;
}

enum { PANELS = 4, ROWS = 3, GAP = 4 }; /* of the sheet; pixels between panels */

static float brightest(const hada_image *image)
{
    float top = 0;
    for (size_t i = 0; i < hada_image_count(image); i++)
        top = image->data[i] > top ? image->data[i] : top;
    return top > 0 ? top : 1;
}

/* Puts a panel, scaled to 1 at `white`, at (row0, col0) of the sheet. */
static void place(hada_image *sheet, const hada_image *panel, float white, int row0, int col0)
{
    for (int c = 0; c < sheet->channels; c++)
        for (int row = 0; row < panel->rows; row++)
            for (int col = 0; col < panel->cols; col++) {
                const size_t from = ((size_t)c * (size_t)panel->rows + (size_t)row) * (size_t)panel->cols + (size_t)col;
                const size_t to = ((size_t)c * (size_t)sheet->rows + (size_t)(row0 + row)) * (size_t)sheet->cols +
                                  (size_t)(col0 + col);
                sheet->data[to] = panel->data[from] / white;
            }
}

static hada_status add_row(hada_trainer *trainer, int pair, int index, int rows, hada_image *sheet, hada_error *err)
{
    hada_image panel[PANELS] = {{0}}, raw = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_trainer_show(trainer, pair, &raw, &panel[1], &panel[2], &panel[3], err));
    HADA_TRY_OR_DONE(hada_scene_fit(&panel[0], &raw, panel[3].rows, panel[3].cols, err));
    const int height = panel[3].rows + GAP, width = panel[3].cols + GAP;
    if (!sheet->data) {
        HADA_TRY_OR_DONE(hada_image_create(sheet, panel[3].channels, rows * height - GAP, PANELS * width - GAP, err));
        for (size_t i = 0; i < hada_image_count(sheet); i++)
            sheet->data[i] = 1.0f;
    }
    const float white = brightest(&panel[3]);
    for (int k = 0; k < PANELS; k++)
        place(sheet, &panel[k], k ? white : brightest(&panel[0]), index * height, k * width);
done:
    for (int k = 0; k < PANELS; k++)
        hada_image_destroy(&panel[k]);
    hada_image_destroy(&raw);
    return status;
}

hada_status hada_train_picture(hada_trainer *trainer, int held, const char *path, hada_error *err)
{
    hada_image sheet = {0};
    hada_status status = HADA_OK;
    const int rows = held < ROWS ? held : ROWS;
    if (!hada_pictures_available())
        return HADA_OK;
    for (int i = 0; i < rows; i++)
        HADA_TRY_OR_DONE(
            add_row(trainer, rows > 1 ? (int)((long)i * (held - 1) / (rows - 1)) : 0, i, rows, &sheet, err));
    HADA_TRY_OR_DONE(hada_png_save(path, &sheet, 1, HADA_AUTO, err));
done:
    hada_image_destroy(&sheet);
    return status;
}
