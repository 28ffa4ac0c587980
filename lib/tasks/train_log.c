/* The log of a training: its lines, and its pictures. */
#include "tasks/train_log.h"

#include <errno.h>
#include <hadalens/plot.h>
#include <hadalens/preview.h>
#include <hadalens/scene.h>
#include <limits.h>
#include <unistd.h>

#include "core/input.h"
#include "core/outfile.h"
#include "image/pixels.h"
#include "io/folder.h"
#include "io/text.h"

static const char losses_head[] =
    "step,loss,mse,perceptual,adversarial,variation,discriminator,gradient_norm,rate,discriminator_only,rolled_back,seconds\n";
static const char validation_head[] = "step,pairs,psnr,ssim,mae,sharpness,psnr_before,ssim_before,mae_before,"
                                      "sharpness_before,sharpness_truth\n";
/* The first number of a line is the step. */
enum { LOSS_NUMBERS = 12, VALIDATION_NUMBERS = 11, MOST_NUMBERS = 12 };

#define MOST_STEPS 9007199254740992.0 /* 2^53 */

static const char what[] = "the log of a training";

static hada_status remember_loss(hada_train_log *log, double step, double loss, hada_error *err)
{
    HADA_TRY(HADA_GROW(log->loss, log->loss_count, 1, what, err));
    log->loss[log->loss_count++] = (hada_loss_row){step, loss};
    return HADA_OK;
}

static hada_status remember_row(hada_train_log *log, uint64_t step, const hada_validation *result, hada_error *err)
{
    hada_validation *copy = NULL;
    HADA_TRY(HADA_GROW(log->rows, log->row_count, 1, what, err));
    HADA_TRY(HADA_NEW(copy, 1, what, err));
    *copy = *result;
    log->rows[log->row_count++] = (hada_train_row){step, copy};
    return HADA_OK;
}

static void forget_rows(hada_train_log *log, size_t first)
{
    for (size_t i = first; i < log->row_count; i++)
        free((void *)(uintptr_t)log->rows[i].result);
    log->row_count = first;
}

/* Numbers of a line, whatever the locale is; 0 where there are not `count` of them. */
static int read_line(const char *line, double *numbers, int count)
{
    for (int i = 0; i < count; i++) {
        const char *end;
        const size_t sign = *line == '-';
        numbers[i] = hada_text_number(line, &end);
        if (end == line && (!strncmp(line + sign, "nan", 3) || !strncmp(line + sign, "inf", 3))) {
            numbers[i] = line[sign] == 'n' ? (double)NAN : sign ? -(double)INFINITY : (double)INFINITY;
            end = line + sign + 3;
        }
        if (end == line || *end != (i + 1 < count ? ',' : '\n'))
            return 0;
        line = end + 1;
    }
    return 1;
}

/* The step at the head of a line; UINT64_MAX for one that no double counts up to. */
static uint64_t step_of(double number)
{
    return number >= 0.0 && number <= MOST_STEPS ? (uint64_t)number : UINT64_MAX;
}

/* Both give UINT64_MAX for a line that is none of theirs. */
static hada_status take_loss(hada_train_log *log, const char *line, uint64_t *step, hada_error *err)
{
    double n[MOST_NUMBERS];
    *step = UINT64_MAX;
    if (!read_line(line, n, LOSS_NUMBERS))
        return HADA_OK;
    *step = step_of(n[0]);
    if (*step == UINT64_MAX)
        return HADA_OK;
    const int discriminator_only = n[9] != 0.0, rolled_back = n[10] != 0.0;
    return discriminator_only || rolled_back ? HADA_OK : remember_loss(log, n[0], n[1], err);
}

static hada_status take_validation(hada_train_log *log, const char *line, uint64_t *step, hada_error *err)
{
    double n[MOST_NUMBERS];
    *step = UINT64_MAX;
    if (!read_line(line, n, VALIDATION_NUMBERS))
        return HADA_OK;
    *step = step_of(n[0]);
    if (*step == UINT64_MAX || !(n[1] >= 0.0 && n[1] <= INT_MAX))
        return HADA_OK;
    const hada_validation r = {.size = sizeof r,
                               .pairs = (int)n[1],
                               .psnr = n[2],
                               .ssim = n[3],
                               .mae = n[4],
                               .sharpness = n[5],
                               .psnr_before = n[6],
                               .ssim_before = n[7],
                               .mae_before = n[8],
                               .sharpness_before = n[9],
                               .sharpness_truth = n[10]};
    return remember_row(log, *step, &r, err);
}

typedef hada_status (*take_line)(hada_train_log *log, const char *line, uint64_t *step, hada_error *err);

/* The lines of an old file up to a step; those that were cut off are left out. */
static hada_status keep_lines(hada_train_log *log, const char *path, uint64_t from, take_line take, hada_text *kept,
                              hada_error *err)
{
    char line[1024];
    hada_status status = HADA_OK;
    int fd;
    size_t bytes;
    if (hada_input_open(&fd, &bytes, path, NULL, NULL))
        return HADA_OK; /* there is none */
    FILE *old = fdopen(fd, "r");
    if (!old) {
        status = hada_fail(err, HADA_ERROR_FILE_READ, "%s cannot be read: %s", path, strerror(errno));
        close(fd);
        return status;
    }
    while (fgets(line, sizeof line, old) && strchr(line, '\n')) {
        const size_t losses = log->loss_count, rows = log->row_count;
        uint64_t step;
        HADA_TRY_OR_DONE(take(log, line, &step, err));
        if (step <= from) {
            hada_text_add(kept, "%s", line);
        } else {
            log->loss_count = losses;
            forget_rows(log, rows);
        }
    }
    if (ferror(old))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ, "%s cannot be read: %s", path, strerror(errno)));
done:
    fclose(old);
    return status;
}

static hada_status open_file(hada_train_log *log, const char *name, const char *head, uint64_t from, int go_on,
                             take_line take, FILE **out, hada_error *err)
{
    hada_path path;
    hada_text text = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/%s", log->folder, name));
    hada_text_add(&text, "%s", head);
    if (go_on)
        HADA_TRY_OR_DONE(keep_lines(log, path, from, take, &text, err));
    HADA_TRY_OR_DONE(hada_text_save(&text, path, err));
    *out = fopen(path, "a");
    if (!*out)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: %s", path, strerror(errno)));
done:
    free(text.data);
    return status;
}

hada_status hada_train_log_open(hada_train_log *log, const char *folder, int go_on, uint64_t from, hada_error *err)
{
    hada_status status = HADA_OK;
    *log = (hada_train_log){0};
    HADA_TRY_OR_DONE(hada_path_format(&log->folder, err, "%s", folder));
    HADA_TRY_OR_DONE(open_file(log, "losses.csv", losses_head, from, go_on, take_loss, &log->losses, err));
    HADA_TRY_OR_DONE(
        open_file(log, "validation.csv", validation_head, from, go_on, take_validation, &log->validation, err));
done:
    if (status)
        hada_train_log_close(log);
    return status;
}

static hada_status check(FILE *file, const char *folder, hada_error *err)
{
    return ferror(file)
               ? hada_fail(err, HADA_ERROR_FILE_WRITE, "the log in %s cannot be written; is the disk full?", folder)
               : HADA_OK;
}

static void put_numbers(FILE *file, const char *format, const double *numbers, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        char text[64];
        hada_format_number(text, sizeof text, format, numbers[i]);
        fprintf(file, ",%s", text);
    }
}

hada_status hada_train_log_step(hada_train_log *log, const hada_step_report *r, hada_error *err)
{
    const double numbers[] = {r->loss,      r->mse,           r->perceptual, r->adversarial,
                              r->variation, r->discriminator, r->norm,       r->rate};
    fprintf(log->losses, "%llu", (unsigned long long)r->step);
    put_numbers(log->losses, "%.9g", numbers, sizeof numbers / sizeof *numbers);
    fprintf(log->losses, ",%d,%d", r->discriminator_only, r->rolled_back);
    put_numbers(log->losses, "%.4f", &r->seconds, 1);
    fputc('\n', log->losses);
    HADA_TRY(check(log->losses, log->folder, err));
    return r->discriminator_only || r->rolled_back ? HADA_OK : remember_loss(log, (double)r->step, r->loss, err);
}

hada_status hada_train_log_validation(hada_train_log *log, uint64_t step, const hada_validation *r, hada_error *err)
{
    const double numbers[] = {r->psnr,           r->ssim,        r->mae,        r->sharpness,
                              r->psnr_before,    r->ssim_before, r->mae_before, r->sharpness_before,
                              r->sharpness_truth};
    fprintf(log->validation, "%llu,%d", (unsigned long long)step, r->pairs);
    put_numbers(log->validation, "%.6f", numbers, sizeof numbers / sizeof *numbers);
    fputc('\n', log->validation);
    const hada_status status = check(log->validation, log->folder, err);
    return status ? status : remember_row(log, step, r, err);
}

hada_status hada_train_log_flush(hada_train_log *log, hada_error *err)
{
    /* on the disk before the checkpoint that stands for these steps */
    if (fflush(log->losses) || hada_sync(fileno(log->losses)) || fflush(log->validation) ||
        hada_sync(fileno(log->validation)))
        return hada_fail(err, HADA_ERROR_FILE_WRITE, "the log in %s cannot be written: %s", log->folder,
                         strerror(errno));
    const hada_status status = check(log->losses, log->folder, err);
    return status ? status : check(log->validation, log->folder, err);
}

void hada_train_log_close(hada_train_log *log)
{
    if (log->losses)
        fclose(log->losses);
    if (log->validation)
        fclose(log->validation);
    forget_rows(log, 0);
    HADA_FREE(log->folder, log->loss, log->rows);
    *log = (hada_train_log){0};
}

/* Pictures. */

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
    hada_path path;
    hada_status status = HADA_OK;
    if (!log->loss_count || !hada_pictures_available())
        return HADA_OK;
    const double end = log->loss[log->loss_count - 1].step;
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/training.svg", log->folder));
    HADA_TRY_OR_DONE(hada_plot_create(&plot, 660, log->row_count ? 570 : 290, err));
    draw_losses(plot, log, end);
    if (log->row_count)
        draw_validation(plot, log, end);
    HADA_TRY_OR_DONE(hada_plot_save(plot, path, err));
done:
    hada_plot_destroy(&plot);
    return status;
}

enum { PANELS = 4, ROWS = 3, GAP = 4 }; /* of the sheet; pixels between panels */

static float white_of(const hada_image *image)
{
    const float brightest = hada_image_brightest(image);
    return brightest > 0.0f ? brightest : 1.0f;
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
    const float white = white_of(&panel[3]);
    for (int k = 0; k < PANELS; k++)
        place(sheet, &panel[k], k ? white : white_of(&panel[0]), index * height, k * width);
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
