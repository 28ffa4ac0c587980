/* Run time against error: quality against the truth on the left, the change against the dense run on the right. */
#include "bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 420, HEIGHT = 330, TOP = 56, LEFT = 76 };

static const char *const method_words[] = {"Hadamard filters", "matched filters", "Wiener filters", "refinement"};

static hada_plot_mark mark_of(const hada_bench_setting *s)
{
    static const hada_plot_shape shapes[] = {HADA_PLOT_DISC, HADA_PLOT_TRIANGLE, HADA_PLOT_SQUARE, HADA_PLOT_DIAMOND};
    return (hada_plot_mark){shapes[s->method],
                            hada_plot_colour(s->method == HADA_BENCH_REFINED   ? 2
                                             : s->method == HADA_BENCH_MATCHED ? 4
                                             : s->method == HADA_BENCH_WIENER  ? 1
                                                                               : 0),
                            4.5, s->half, s->clfft};
}

/* What tells a setting from the others, short. */
static void short_name(const hada_bench_row *row, char *text, size_t size)
{
    const hada_bench_setting *s = &row->setting;
    if (s->method == HADA_BENCH_REFINED)
        snprintf(text, size, "%d step%s, %s", s->refine, s->refine == 1 ? "" : "s", s->skip_name);
    else
        snprintf(text, size, "%s%s", s->half ? "half, " : "", s->skip_name);
}

typedef struct panel_data {
    const hada_bench_row **rows;
    int count;
    double *x, *y, *front_x, *front_y; /* room for count values each */
} panel_data;

/* `y` of a row that has none is NaN. The front is drawn, and its points named, where `with_front`. */
static void draw(hada_plot *plot, const hada_plot_panel *panel, panel_data *data, int with_front)
{
    int n = 0;
    hada_plot_panel_begin(plot, panel);
    for (int i = 0; with_front && i < data->count; i++)
        if (data->rows[i]->front && !isnan(data->y[i])) {
            data->front_x[n] = data->x[i];
            data->front_y[n++] = data->y[i];
        }
    if (n > 1)
        hada_plot_line(plot, data->front_x, data->front_y, n, 0x000000, 0);
    for (int i = 0; i < data->count; i++) {
        const hada_plot_mark mark = mark_of(&data->rows[i]->setting);
        if (!isnan(data->y[i]))
            hada_plot_point(plot, data->x[i], data->y[i], &mark);
    }
    for (int i = 0; with_front && i < data->count; i++) {
        char text[96];
        short_name(data->rows[i], text, sizeof text);
        if (data->rows[i]->front && !isnan(data->y[i]))
            hada_plot_label(plot, data->x[i], data->y[i], text);
    }
    hada_plot_panel_end(plot);
}

static void quality_panel(hada_plot *plot, panel_data *data, double left)
{
    for (int i = 0; i < data->count; i++)
        data->y[i] = data->rows[i]->psnr;
    hada_plot_panel panel = {.left = left, .top = TOP, .width = WIDTH, .height = HEIGHT, .title = "against the truth"};
    panel.across = hada_plot_axis_for(data->x, data->count, 1, "milliseconds a frame");
    panel.up = hada_plot_axis_for(data->y, data->count, 0, "PSNR of the occupied planes (dB)");
    draw(plot, &panel, data, 1);
}

/* Errors of 0 stand on a line of their own below the others. */
static void change_panel(hada_plot *plot, panel_data *data, double left, int with_front)
{
    double least = INFINITY, most = 0;
    for (int i = 0; i < data->count; i++) {
        const double error = data->rows[i]->error;
        if (error > 0 && isfinite(error)) {
            least = error < least ? error : least;
            most = error > most ? error : most;
        }
    }
    if (!(most > 0))
        least = most = 1e-6;
    const double floor_value = 0.3 * pow(10, floor(log10(least)));
    for (int i = 0; i < data->count; i++) {
        const double error = data->rows[i]->error;
        data->y[i] = isnan(error) || isinf(error) ? NAN : error > 0 ? error : floor_value;
    }
    hada_plot_panel panel = {.left = left,
                             .top = TOP,
                             .width = WIDTH,
                             .height = HEIGHT,
                             .title = "against the dense run of the same method"};
    panel.across = hada_plot_axis_for(data->x, data->count, 1, "milliseconds a frame");
    panel.up = (hada_plot_axis){floor_value / 1.6, most * 2.5, 1, 0, "relative L2 change of the stack"};
    draw(plot, &panel, data, with_front);
    const double share = log(1.6) / log(panel.up.high / panel.up.low);
    hada_plot_text(plot, left - 8, TOP + HEIGHT * (1 - share) + 4, 'r', 11, "0");
}

static void legend(hada_plot *plot, const panel_data *data)
{
    double x = LEFT;
    const double y = TOP + HEIGHT + 64;
    for (int m = 0; m < 4; m++) {
        int there = 0;
        for (int i = 0; i < data->count; i++)
            there |= (int)data->rows[i]->setting.method == m;
        const hada_bench_setting setting = {.method = (hada_bench_method)m};
        const hada_plot_mark mark = mark_of(&setting);
        if (there)
            x = hada_plot_legend(plot, x, y, &mark, HADA_PLOT_NO_COLOUR, method_words[m]);
    }
    const hada_plot_mark hollow = {HADA_PLOT_DISC, 0x555555, 4.5, 1, 0},
                         crossed = {HADA_PLOT_DISC, 0x555555, 4.5, 0, 1};
    int half = 0, clfft = 0;
    for (int i = 0; i < data->count; i++) {
        half |= data->rows[i]->setting.half;
        clfft |= data->rows[i]->setting.clfft;
    }
    if (half)
        x = hada_plot_legend(plot, x, y, &hollow, HADA_PLOT_NO_COLOUR, "half precision");
    if (clfft)
        x = hada_plot_legend(plot, x, y, &crossed, HADA_PLOT_NO_COLOUR, "clFFT");
    hada_plot_legend(plot, x, y, NULL, HADA_PLOT_NO_COLOUR, "no other is better in both");
}

static hada_status plot(const hada_bench_place *place, panel_data *data, const char *folder, hada_error *err)
{
    hada_plot *figure;
    int truth = 0;
    char title[400];
    for (int i = 0; i < data->count; i++) {
        data->x[i] = data->rows[i]->value.median;
        truth |= !isnan(data->rows[i]->psnr);
    }
    const double wide = truth ? LEFT + 2 * WIDTH + 90 + 24 : LEFT + WIDTH + 24 + 200;
    hada_status status = HADA_OK;
    HADA_TRY(hada_plot_create(&figure, wide, TOP + HEIGHT + 84, err));
    snprintf(title, sizeof title, "%s on %s", place->workload, place->device);
    hada_plot_text(figure, LEFT, 22, 'l', 13, title);
    if (truth)
        quality_panel(figure, data, LEFT);
    change_panel(figure, data, truth ? LEFT + WIDTH + 90 : LEFT, !truth);
    legend(figure, data);
    char *path = hada_cli_text("%s/time-error-%s%s.svg", folder, place->workload, place->suffix);
    status = hada_plot_save(figure, path, err);
    hada_plot_destroy(&figure);
    free(path);
    return status;
}

hada_status hada_bench_plot_error(const hada_bench *bench, const hada_bench_place *place, const char *folder,
                                  hada_error *err)
{
    const size_t room = (size_t)bench->count + 1;
    panel_data data = {.x = calloc(4 * room, sizeof *data.x)};
    data.rows = hada_bench_rows_of(bench, place->device, place->workload, HADA_BENCH_SWEEP, &data.count);
    hada_status status = HADA_OK;
    if (!data.rows || !data.x) {
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
        goto done;
    }
    data.y = data.x + room;
    data.front_x = data.y + room;
    data.front_y = data.front_x + room;
    if (data.count)
        HADA_TRY_OR_DONE(plot(place, &data, folder, err));
done:
    free(data.rows);
    free(data.x);
    return status;
}
