#include "train_log.h"
#include "folder.h"
#include <hadalens/plot.h>
#include <hadalens/preview.h>

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const char losses_head[] =
    "step,loss,mse,perceptual,adversarial,variation,critic,gradient_norm,rate,critic_only,rolled_back,seconds\n";
static const char validation_head[] = "step,pairs,psnr,ssim,mae,sharpness,psnr_before,ssim_before,mae_before,"
                                      "sharpness_before,sharpness_truth\n";

/* Room for one more in a growing array. */
static hada_status grow(void **items, size_t count, size_t *room, size_t size, hada_error *err)
{
    if (count < *room)
        return HADA_OK;
    const size_t more = *room ? 2 * *room : 256;
    void *wider = realloc(*items, more * size);
    if (!wider)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    *items = wider;
    *room = more;
    return HADA_OK;
}

static hada_status remember_loss(hada_cli_train_log *log, double step, double loss, hada_error *err)
{
    hada_status status = grow((void **)&log->loss, log->loss_count, &log->loss_room, sizeof *log->loss, err);
    if (!status)
        log->loss[log->loss_count++] = (hada_cli_loss_row){step, loss};
    return status;
}

static hada_status remember_row(hada_cli_train_log *log, uint64_t step, const hada_validation *result, hada_error *err)
{
    hada_status status = grow((void **)&log->rows, log->row_count, &log->row_room, sizeof *log->rows, err);
    if (!status)
        log->rows[log->row_count++] = (hada_cli_validation_row){step, *result};
    return status;
}

static hada_status take_loss(hada_cli_train_log *log, const char *line, uint64_t *step, hada_error *err)
{
    double loss, norm, rate, seconds;
    double term[5];
    int critic_only, rolled_back;
    unsigned long long at;
    *step = UINT64_MAX;
    if (sscanf(line, "%llu,%lf,%lf,%lf,%lf,%lf,%lf,%lf,%lf,%d,%d,%lf", &at, &loss, &term[0], &term[1], &term[2],
               &term[3], &term[4], &norm, &rate, &critic_only, &rolled_back, &seconds) != 12)
        return HADA_OK;
    *step = at;
    return critic_only || rolled_back ? HADA_OK : remember_loss(log, (double)at, loss, err);
}

static hada_status take_validation(hada_cli_train_log *log, const char *line, uint64_t *step, hada_error *err)
{
    hada_validation r;
    unsigned long long at;
    *step = UINT64_MAX;
    if (sscanf(line, "%llu,%d,%lf,%lf,%lf,%lf,%lf,%lf,%lf,%lf,%lf", &at, &r.pairs, &r.psnr, &r.ssim, &r.mae,
               &r.sharpness, &r.psnr_before, &r.ssim_before, &r.mae_before, &r.sharpness_before,
               &r.sharpness_truth) != 11)
        return HADA_OK;
    *step = at;
    return remember_row(log, at, &r, err);
}

typedef hada_status (*take_line)(hada_cli_train_log *log, const char *line, uint64_t *step, hada_error *err);

/* The lines of an old file up to a step; those that were cut off are left out. */
static hada_status keep_lines(hada_cli_train_log *log, const char *path, uint64_t from, take_line take, char **kept,
                              size_t *length, hada_error *err)
{
    char line[1024];
    hada_status status = HADA_OK;
    size_t room = 0;
    FILE *old = fopen(path, "r");
    if (!old)
        return HADA_OK;
    while (!status && fgets(line, sizeof line, old)) {
        const size_t size = strlen(line);
        const size_t losses = log->loss_count, rows = log->row_count;
        uint64_t step;
        if (line[size - 1] != '\n')
            break;
        status = take(log, line, &step, err);
        if (step > from) {
            log->loss_count = losses;
            log->row_count = rows;
            continue;
        }
        while (!status && room < *length + size)
            status = grow((void **)kept, *length + size, &room, 1, err);
        if (!status)
            memcpy(*kept + *length, line, size);
        *length += size;
    }
    fclose(old);
    return status;
}

static hada_status open_file(hada_cli_train_log *log, const char *name, const char *head, uint64_t from, int go_on,
                             take_line take, FILE **out, hada_error *err)
{
    char *path = hada_cli_text("%s/%s", log->folder, name), *kept = NULL, *text = NULL;
    size_t length = 0;
    hada_status status = path ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status && go_on)
        status = keep_lines(log, path, from, take, &kept, &length, err);
    if (!status) {
        text = hada_cli_text("%s%.*s", head, (int)length, kept ? kept : "");
        status = text ? hada_cli_write_text(path, text, strlen(text), err)
                      : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    }
    if (!status) {
        *out = fopen(path, "a");
        if (!*out)
            status = hada_cli_error(err, HADA_ERROR_FILE_WRITE, "%s cannot be written: %s", path, strerror(errno));
    }
    free(path);
    free(kept);
    free(text);
    return status;
}

hada_status hada_cli_train_log_open(hada_cli_train_log *log, const char *folder, int go_on, uint64_t from,
                                    hada_error *err)
{
    *log = (hada_cli_train_log){.folder = hada_cli_text("%s", folder)};
    hada_status status = log->folder ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status)
        status = open_file(log, "losses.csv", losses_head, from, go_on, take_loss, &log->losses, err);
    if (!status)
        status = open_file(log, "validation.csv", validation_head, from, go_on, take_validation, &log->validation, err);
    if (status)
        hada_cli_train_log_close(log);
    return status;
}

static hada_status check(FILE *file, const char *folder, hada_error *err)
{
    return ferror(file) ? hada_cli_error(err, HADA_ERROR_FILE_WRITE,
                                         "the log in %s cannot be written; is the disk full?", folder)
                        : HADA_OK;
}

hada_status hada_cli_train_log_step(hada_cli_train_log *log, const hada_step_report *r, hada_error *err)
{
    fprintf(log->losses, "%llu,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%d,%d,%.4f\n", (unsigned long long)r->step,
            r->loss, r->mse, r->perceptual, r->adversarial, r->variation, r->critic, r->norm, r->rate, r->critic_only,
            r->rolled_back, r->seconds);
    hada_status status = check(log->losses, log->folder, err);
    if (!status && !r->critic_only && !r->rolled_back)
        status = remember_loss(log, (double)r->step, r->loss, err);
    return status;
}

hada_status hada_cli_train_log_validation(hada_cli_train_log *log, uint64_t step, const hada_validation *r,
                                          hada_error *err)
{
    fprintf(log->validation, "%llu,%d,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f\n", (unsigned long long)step,
            r->pairs, r->psnr, r->ssim, r->mae, r->sharpness, r->psnr_before, r->ssim_before, r->mae_before,
            r->sharpness_before, r->sharpness_truth);
    hada_status status = check(log->validation, log->folder, err);
    return status ? status : remember_row(log, step, r, err);
}

enum { POINTS = 400 };

/* Means over stretches of steps: a figure shows a few hundred points, not all. */
static int thin(const hada_cli_train_log *log, double *x, double *y)
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

static void draw_losses(hada_plot *plot, const hada_cli_train_log *log, double end)
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

static void draw_validation(hada_plot *plot, const hada_cli_train_log *log, double end)
{
    const int count = (int)log->row_count;
    const double ends[] = {0, end};
    double *room = malloc((size_t)(5 * count + 1) * sizeof *room), *x = room;
    if (!room)
        return;
    double *psnr = x + count, *before = psnr + count, *both = before + count;
    for (int i = 0; i < count; i++) {
        x[i] = (double)log->rows[i].step;
        both[i] = psnr[i] = log->rows[i].result.psnr;
        both[count + i] = before[i] = log->rows[i].result.psnr_before;
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

hada_status hada_cli_train_log_flush(hada_cli_train_log *log, hada_error *err)
{
    hada_plot *plot = NULL;
    fflush(log->losses);
    fflush(log->validation);
    hada_status status = check(log->losses, log->folder, err);
    if (!status)
        status = check(log->validation, log->folder, err);
    if (status || !log->loss_count || !hada_pictures_available())
        return status;
    double end = log->loss[log->loss_count - 1].step;
    char *path = hada_cli_text("%s/training.svg", log->folder);
    status = hada_plot_begin(&plot, 660, log->row_count ? 570 : 290, err);
    if (!status) {
        draw_losses(plot, log, end);
        if (log->row_count)
            draw_validation(plot, log, end);
        status = hada_plot_save(&plot, path, err);
    }
    free(path);
    return status;
}

void hada_cli_train_log_close(hada_cli_train_log *log)
{
    if (log->losses)
        fclose(log->losses);
    if (log->validation)
        fclose(log->validation);
    free(log->folder);
    free(log->loss);
    free(log->rows);
    *log = (hada_cli_train_log){0};
}
