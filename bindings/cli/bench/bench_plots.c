/* The figures: latency per depth, kernels against the device's ceilings, run time against error. */
#include "bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { BAR = 26, LABELLED = 9 };
enum { REST_COLOUR = 0xcccccc }; /* of a frame's median beyond those of its stages */

/* A stacked bar of a mode's stages; returns where it ends. */
static double stack(hada_plot *plot, const hada_bench *bench, const hada_bench_place *place, int mode, double at)
{
    double x = 0;
    for (int s = 0; s < HADA_BENCH_STAGES; s++) {
        char name[128];
        snprintf(name, sizeof name, "%s, %s", hada_bench_mode_names[mode], hada_bench_stage_names[s]);
        const hada_bench_row *row = hada_bench_find(bench, place->device, place->workload, HADA_BENCH_STAGE, name);
        const double width = row ? row->value.median : 0;
        if (width > 0)
            hada_plot_bar(plot, x, x + width, at + 0.15, at + 0.85, hada_plot_colour(s));
        x += width;
    }
    return x;
}

static const hada_bench_row *per_depth(const hada_bench *bench, const hada_bench_place *place, int mode)
{
    char name[128];
    snprintf(name, sizeof name, "%s, depth", hada_bench_mode_names[mode]);
    return hada_bench_find(bench, place->device, place->workload, HADA_BENCH_LATENCY, name);
}

/* One panel for a workload: a bar for each device and mode. */
static double latency_panel(hada_plot *plot, const hada_bench *bench, const hada_bench_place *places, int count,
                            const char *workload, double top)
{
    double longest = 0;
    int bars = 0, one_device = 1;
    char title[400];
    for (int i = 0; i < count; i++)
        one_device &= !places[i].number;
    snprintf(title, sizeof title, one_device ? "%s on %s" : "%s", workload, places->device);
    for (int i = 0; i < count; i++)
        for (int mode = 0; !strcmp(places[i].workload, workload) && mode < HADA_BENCH_MODES; mode++) {
            const hada_bench_row *row = per_depth(bench, &places[i], mode);
            bars += row != NULL;
            longest = row && row->value.q3 > longest ? row->value.q3 : longest;
        }
    /* room behind the longest bar for its number */
    const double ends[] = {0, longest * 1.22};
    hada_plot_panel panel = {.left = 210, .top = top, .width = 520, .height = (double)bars * BAR + 8, .title = title};
    panel.across = hada_plot_axis_for(ends, 2, 0, "milliseconds per depth (median of the frame; whiskers: quartiles)");
    panel.across.high = ends[1] > 0 ? ends[1] : 1;
    panel.up = (hada_plot_axis){0, (double)bars + 0.3, 0, 1, NULL};
    hada_plot_panel_begin(plot, &panel);
    for (int i = 0; i < count; i++)
        for (int mode = 0; !strcmp(places[i].workload, workload) && mode < HADA_BENCH_MODES; mode++) {
            const hada_bench_row *row = per_depth(bench, &places[i], mode);
            if (!row)
                continue;
            char text[64];
            const double at = --bars, y = panel.top + panel.height * (1 - (at + 0.65) / panel.up.high);
            const double end = stack(plot, bench, &places[i], mode, at + 0.15);
            if (row->value.median > end)
                hada_plot_bar(plot, end, row->value.median, at + 0.3, at + 1, REST_COLOUR);
            hada_plot_whisker(plot, row->value.q1, row->value.q3, at + 0.65);
            snprintf(text, sizeof text, "%.3g", row->value.median);
            hada_plot_text(plot, panel.left + panel.width * row->value.q3 / panel.across.high + 8, y + 4, 'l', 11,
                           text);
            if (one_device)
                snprintf(text, sizeof text, "%s", hada_bench_mode_names[mode]);
            else
                snprintf(text, sizeof text, "%.24s, %s", places[i].device, hada_bench_mode_names[mode]);
            hada_plot_text(plot, panel.left - 8, y + 4, 'r', 11, text);
        }
    hada_plot_panel_end(plot);
    return top + panel.height + 76;
}

static hada_status plot_latency(const hada_bench *bench, const hada_bench_place *places, int count, const char *folder,
                                hada_error *err)
{
    hada_plot *plot;
    int workloads = 0;
    for (int i = 0; i < count; i++)
        workloads += places[i].first_of_workload;
    double height = 46 + 84.0 * workloads + (double)count * HADA_BENCH_MODES * BAR, x = 60, top = 62;
    hada_status status = HADA_OK;
    HADA_TRY(hada_plot_create(&plot, 760, height, err));
    for (int s = 0; s < HADA_BENCH_STAGES; s++)
        x = hada_plot_legend(plot, x, 20, NULL, hada_plot_colour(s), hada_bench_stage_names[s]);
    hada_plot_legend(plot, x, 20, NULL, REST_COLOUR, "rest");
    for (int i = 0; i < count; i++)
        if (places[i].first_of_workload)
            top = latency_panel(plot, bench, places, count, places[i].workload, top);
    char *path = hada_cli_text("%s/latency.svg", folder);
    status = hada_plot_save(plot, path, err);
    hada_plot_destroy(&plot);
    free(path);
    return status;
}

static int stage_of(const hada_bench_row *row)
{
    for (int s = 0; s < HADA_BENCH_STAGES; s++) {
        char part[32];
        snprintf(part, sizeof part, ", %s, ", hada_bench_stage_names[s]);
        if (strstr(row->name, part))
            return s;
    }
    return 7;
}

static const char *kernel_of(const hada_bench_row *row)
{
    const char *comma = strrchr(row->name, ',');
    return comma ? comma + 2 : row->name;
}

static void roof(hada_plot *plot, const hada_plot_panel *panel, double copy, double flops)
{
    const double ridge = flops / copy;
    const double x[] = {panel->across.low, ridge, panel->across.high};
    const double y[] = {panel->across.low * copy, flops, flops};
    char text[96];
    hada_plot_line(plot, x, y, 3, 0x000000, 0);
    const hada_plot_axis *a = &panel->across, *u = &panel->up;
    snprintf(text, sizeof text, "arithmetic %.3g GFLOP/s", flops);
    hada_plot_note(plot, panel->left + panel->width - 6,
                   panel->top + panel->height * (1 - log(flops / u->low) / log(u->high / u->low)) - 6, 'r', text);
    snprintf(text, sizeof text, "copy %.3g GB/s", copy);
    const double at = sqrt(a->low * (ridge < a->high ? ridge : a->high));
    hada_plot_note(plot, panel->left + panel->width * log(at / a->low) / log(a->high / a->low) - 10,
                   panel->top + panel->height * (1 - log(at * copy / u->low) / log(u->high / u->low)) - 8, 'r', text);
}

/* Kernels as points: operations a byte across, operations a second upwards, the area by the share of a frame's time. */
static void roofline_points(hada_plot *plot, const hada_bench_row **list, int count)
{
    double all[HADA_BENCH_MODES] = {0};
    for (int i = 0; i < count; i++)
        for (int mode = 0; mode < HADA_BENCH_MODES; mode++)
            if (!strncmp(list[i]->name, hada_bench_mode_names[mode], strlen(hada_bench_mode_names[mode])))
                all[mode] += list[i]->value.median;
    for (int i = 0; i < count; i++) {
        const int refined = strncmp(list[i]->name, hada_bench_mode_names[0], strlen(hada_bench_mode_names[0])) != 0;
        const double share = list[i]->value.median / all[refined];
        const hada_plot_mark mark = {refined ? HADA_PLOT_DIAMOND : HADA_PLOT_DISC, hada_plot_colour(stage_of(list[i])),
                                     2.5 + 11 * sqrt(share), 0, 0};
        const double x = list[i]->flops / list[i]->bytes, y = list[i]->flops / list[i]->value.median * 1e-6;
        hada_plot_point(plot, x, y, &mark);
        if (i < LABELLED)
            hada_plot_label(plot, x, y, kernel_of(list[i]));
    }
}

static hada_status plot_roofline(const hada_bench *bench, const hada_bench_place *place, const char *folder,
                                 hada_error *err)
{
    const hada_bench_row *copy = hada_bench_find(bench, place->device, "", HADA_BENCH_PEAK, "copy"),
                         *flops = hada_bench_find(bench, place->device, "", HADA_BENCH_PEAK, "float32 arithmetic");
    int all, count = 0, n = 0;
    const hada_bench_row **list = hada_bench_rows_of(bench, place->device, place->workload, HADA_BENCH_KERNEL, &all);
    double *x = hada_cli_memory(2 * (size_t)bench->count + 8, sizeof *x), *y = x + bench->count + 4;
    hada_plot *plot = NULL;
    hada_status status = HADA_OK;
    for (int i = 0; i < all; i++) /* what has operations and traffic has a place on a roofline */
        if (list[i]->flops > 0 && list[i]->bytes > 0 && list[i]->value.median > 0)
            list[count++] = list[i];
    if (count && copy && flops) {
        const double bandwidth = copy->value.q3, arithmetic = flops->value.q3, ridge = arithmetic / bandwidth;
        for (; n < count; n++) {
            x[n] = list[n]->flops / list[n]->bytes;
            y[n] = list[n]->flops / list[n]->value.median * 1e-6;
        }
        x[n] = ridge * 2;
        y[n] = arithmetic * 1.6;
        hada_plot_panel panel = {.left = 76, .top = 56, .width = 600, .height = 390};
        panel.across = hada_plot_axis_for(x, n + 1, 1, "operations per byte of memory traffic (least of both)");
        panel.up = hada_plot_axis_for(y, n + 1, 1, "GFLOP/s (event times)");
        char title[400];
        snprintf(title, sizeof title, "%s on %s", place->workload, place->device);
        panel.title = title;
        HADA_TRY_OR_DONE(hada_plot_create(&plot, 700, 540, err));
        hada_plot_panel_begin(plot, &panel);
        roof(plot, &panel, bandwidth, arithmetic);
        roofline_points(plot, list, count);
        hada_plot_panel_end(plot);
        double at = 76;
        for (int s = 0; s < HADA_BENCH_STAGES; s++)
            at = hada_plot_legend(plot, at, 508, NULL, hada_plot_colour(s), hada_bench_stage_names[s]);
        const hada_plot_mark marks[] = {{HADA_PLOT_DISC, 0x555555, 5, 0, 0}, {HADA_PLOT_DIAMOND, 0x555555, 5, 0, 0}};
        at = hada_plot_legend(plot, 76, 528, &marks[0], HADA_PLOT_NO_COLOUR, "linear");
        at = hada_plot_legend(plot, at, 528, &marks[1], HADA_PLOT_NO_COLOUR, "refined");
        hada_plot_text(plot, at, 532, 'l', 11, "area: share of the frame's time on the device");
        char *path = hada_cli_text("%s/roofline-%s%s.svg", folder, place->workload, place->suffix);
        status = hada_plot_save(plot, path, err);
        hada_plot_destroy(&plot);
        free(path);
    }
done:
    free(list);
    free(x);
    return status;
}

/* Run time against error: quality against the truth on the left, the change against the dense run on the right. */

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
static void draw_points(hada_plot *plot, const hada_plot_panel *panel, panel_data *data, int with_front)
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
    draw_points(plot, &panel, data, 1);
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
    draw_points(plot, &panel, data, with_front);
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

static hada_status draw_figure(const hada_bench_place *place, panel_data *data, const char *folder, hada_error *err)
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

static hada_status plot_error(const hada_bench *bench, const hada_bench_place *place, const char *folder,
                              hada_error *err)
{
    const size_t room = (size_t)bench->count + 1;
    panel_data data = {.x = hada_cli_memory(4 * room, sizeof *data.x)};
    data.rows = hada_bench_rows_of(bench, place->device, place->workload, HADA_BENCH_SWEEP, &data.count);
    data.y = data.x + room;
    data.front_x = data.y + room;
    data.front_y = data.front_x + room;
    const hada_status status = data.count ? draw_figure(place, &data, folder, err) : HADA_OK;
    free(data.rows);
    free(data.x);
    return status;
}

hada_status hada_bench_plots(const hada_bench *bench, const char *folder, hada_error *err)
{
    hada_bench_place places[HADA_BENCH_PLACES];
    const int count = hada_bench_places(bench, places);
    if (count)
        HADA_TRY(plot_latency(bench, places, count, folder, err));
    for (int i = 0; i < count; i++) {
        HADA_TRY(plot_roofline(bench, &places[i], folder, err));
        HADA_TRY(plot_error(bench, &places[i], folder, err));
    }
    hada_cli_say(bench->cli, "Figures: %s/latency.svg, roofline-*.svg, time-error-*.svg.", folder);
    return HADA_OK;
}
