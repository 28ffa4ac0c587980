/* Seeing through: a leaf stands before a picture and hides it. A single lens sees the leaf. The lensless camera has
 * many lenses, each at another place, so some of them look past the leaf at any point of the picture, and the picture
 * comes back in the refocused far plane.
 *
 *   cc -O2 see_through.c $(pkg-config --cflags --libs hadalens) -lm -o see_through
 *   ./see_through FOLDER [SEED]
 *
 * Prints PSNR in the region of the hidden picture, and writes pictures into FOLDER, which must exist. Another seed has
 * other lens places, another picture and other noise. docs/explanation/simulation.md tells how it works. */
#include <hadalens/hadalens.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NEAR, FAR, DEPTHS, PAIRS = 8, ROUNDS = 8, PICTURE = 40 /* pixels a side */ };
static const double noise = 0.01; /* of a frame's maximum */

typedef struct bench {
    uint64_t seed;
    hada_camera camera;
    hada_context *context;
    hada_simulator *simulator;
    hada_model *model;
    hada_plan *plan;
    hada_image leaf, opacity, picture; /* what there is to see */
    unsigned char *region;             /* of the picture: 1 where it is */
    hada_image raw;                    /* what the sensor records */
} bench;

/* A lens-shaped leaf with veins, lit from the front, and a picture that it hides. */
static hada_status make_scene(bench *b, hada_error *err)
{
    const int rows = b->camera.window_rows, cols = b->camera.window_cols;
    const double green[] = {0.25, 0.6, 0.15};
    const size_t pixels = (size_t)rows * (size_t)cols;
    hada_image drawn = {0}, small = {0};
    hada_status status = hada_image_create(&b->leaf, 3, rows, cols, err);
    if (!status && !(status = hada_image_create(&b->opacity, 1, rows, cols, err)) &&
        !(status = hada_scene_procedural(&drawn, b->seed + 1233, 3, rows, cols, err)) &&
        !(status = hada_image_resize(&small, &drawn, PICTURE, PICTURE, err)))
        status = hada_image_crop(&b->picture, &small, (PICTURE - rows) / 2, (PICTURE - cols) / 2, rows, cols, err);
    hada_image_destroy(&drawn);
    hada_image_destroy(&small);
    if (status)
        return status;
    if (!(b->region = calloc(pixels, 1))) {
        fprintf(stderr, "out of memory\n");
        exit(1);
    }
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++) {
            const size_t at = (size_t)r * (size_t)cols + (size_t)c;
            const double y = r - rows / 2, x = c - cols / 2, along = y / 36.0, width = 28.0 * (1.0 - along * along);
            const int on_leaf = fabs(x) < width, vein = fabs(x) < 1.0 || fmod(fabs(y + 0.6 * fabs(x)), 9.0) < 1.0;
            b->region[at] = y >= -PICTURE / 2 && y < PICTURE / 2 && x >= -PICTURE / 2 && x < PICTURE / 2;
            b->opacity.data[at] = on_leaf ? 1.0f : 0.0f;
            for (size_t k = 0; k < 3; k++)
                b->leaf.data[k * pixels + at] = on_leaf ? (float)(green[k] * (vein ? 1.5 : 1.0)) : 0.0f;
        }
    return HADA_OK;
}

/* A pair for the fit: a drawn scene at one of the distances, and what the sensor records of it. */
static hada_status draw_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    const bench *b = user;
    const uint64_t number = (uint64_t)(depth * PAIRS + pair);
    hada_status status = hada_scene_procedural(scene, number, 3, b->camera.window_rows, b->camera.window_cols, err);
    const hada_plane plane = {depth, scene};
    return status ? status : hada_simulator_render(b->simulator, &plane, 1, noise, 100 + number, raw, err);
}

/* Learns the camera from pairs at both distances, as 'hadalens fit' does. */
static hada_status learn(bench *b, hada_error *err)
{
    static const int counts[DEPTHS] = {PAIRS, PAIRS};
    hada_fit_task task;
    hada_dataset *pairs = NULL;
    hada_status status = hada_dataset_create(&pairs, DEPTHS, b->camera.distances_mm, counts, draw_pair, b, NULL, err);
    hada_fit_task_init(&task);
    task.boundary = b->camera.boundary;
    if (!status)
        status = hada_fit_run(&b->model, NULL, b->context, pairs, &task, err);
    hada_dataset_destroy(&pairs);
    return status;
}

/* PSNR over the picture's region with the factor that fits best. */
static double psnr(const bench *b, const hada_image *image)
{
    const size_t pixels = (size_t)image->rows * (size_t)image->cols;
    double cross = 0.0, square = 0.0, error = 0.0, count = 0.0;
    for (size_t i = 0; i < 3 * pixels; i++)
        if (b->region[i % pixels]) {
            cross += (double)image->data[i] * b->picture.data[i];
            square += (double)image->data[i] * image->data[i];
        }
    const double gain = square > 0.0 ? cross / square : 0.0;
    for (size_t i = 0; i < 3 * pixels; i++)
        if (b->region[i % pixels]) {
            const double d = gain * image->data[i] - b->picture.data[i];
            error += d * d;
            count++;
        }
    return 10.0 * log10(count / error);
}

static hada_status save(const char *folder, const char *name, const hada_image *image, double white, hada_error *err)
{
    char path[1024];
    snprintf(path, sizeof path, "%s/%s.png", folder, name);
    return hada_png_save(path, image, white, HADA_AUTO, err);
}

/* What the lens nearest to the axis sees by itself, free of noise and of the other lenses' light, cut out where the far
 * plane's picture falls: what a camera with that one lens, focused on the far plane, would show. */
static hada_status single_view(const bench *b, hada_image *view, hada_error *err)
{
    const hada_camera *c = &b->camera;
    const hada_plane planes[] = {{NEAR, &b->leaf}, {FAR, &b->picture}};
    const hada_image *const opacity[] = {&b->opacity, NULL};
    double x[256], y[256]; /* the camera has 37 lenses */
    int lens = 0;
    hada_image frame;
    hada_status status = hada_camera_lenses(c, x, y, err);
    for (int i = 1; i < c->lenses; i++)
        if (hypot(x[i], y[i]) < hypot(x[lens], y[lens]))
            lens = i;
    if (status ||
        (status = hada_simulator_render_occluded(b->simulator, planes, opacity, DEPTHS, lens, 0.0, 0, &frame, err)))
        return status;
    const double scale =
        (1.0 + c->distance_mm / c->distances_mm[FAR]) / c->pixel_pitch_mm; /* times the magnification */
    status = hada_image_crop(view, &frame, hada_window_origin(c->rows, c->window_rows) + (int)lrint(y[lens] * scale),
                             hada_window_origin(c->cols, c->window_cols) + (int)lrint(x[lens] * scale), c->window_rows,
                             c->window_cols, err);
    hada_image_destroy(&frame);
    return status;
}

static int ascending(const void *a, const void *b)
{
    return (*(const float *)a > *(const float *)b) - (*(const float *)a < *(const float *)b);
}

/* Where the near plane is taken for opaque: brighter than half of its bright parts (the mean over colours and 5 x 5
 * pixels; the 98th percentile counts as bright). */
static void find_opaque(const hada_image *near, hada_image *opacity, float *sorted)
{
    const int rows = near->rows, cols = near->cols;
    const size_t pixels = (size_t)rows * (size_t)cols;
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++) {
            float sum = 0.0f, count = 0.0f;
            for (int i = r < 2 ? 0 : r - 2; i <= r + 2 && i < rows; i++)
                for (int j = c < 2 ? 0 : c - 2; j <= c + 2 && j < cols; j++, count += 3.0f)
                    for (size_t k = 0; k < 3; k++)
                        sum += near->data[k * pixels + (size_t)i * (size_t)cols + (size_t)j];
            opacity->data[(size_t)r * (size_t)cols + (size_t)c] = sum / count;
        }
    memcpy(sorted, opacity->data, pixels * sizeof *sorted);
    qsort(sorted, pixels, sizeof *sorted, ascending);
    const float half = 0.5f * sorted[pixels * 98 / 100];
    for (size_t i = 0; i < pixels; i++)
        opacity->data[i] = opacity->data[i] > half ? 1.0f : 0.0f;
}

/* Adds to the frame the light of the far plane that the near one took away: the model of the camera knows planes that
 * hide nothing, and such a frame it can explain. */
static hada_status give_back(const bench *b, const hada_result *result, const hada_image *opacity, hada_image *frame,
                             hada_error *err)
{
    hada_image dark = {0}, clear = {0}, hidden = {0};
    hada_status status = hada_image_create(&dark, 1, opacity->rows, opacity->cols, err);
    const hada_plane planes[] = {{NEAR, &dark}, {FAR, &result->planes[FAR]}};
    const hada_image *const opacities[] = {opacity, NULL};
    if (!status && !(status = hada_simulator_render(b->simulator, planes, DEPTHS, 0.0, 0, &clear, err)) &&
        !(status = hada_simulator_render_occluded(b->simulator, planes, opacities, DEPTHS, -1, 0.0, 0, &hidden, err)))
        for (size_t i = 0; i < hada_image_count(frame); i++)
            frame->data[i] = b->raw.data[i] + clear.data[i] - hidden.data[i];
    hada_image_destroy(&dark);
    hada_image_destroy(&clear);
    hada_image_destroy(&hidden);
    return status;
}

static hada_status look_through(const bench *b, const char *folder, hada_error *err)
{
    hada_result result = {0};
    hada_image frame = {0}, opacity = {0};
    const size_t pixels = (size_t)b->camera.window_rows * (size_t)b->camera.window_cols;
    float *sorted = malloc(pixels * sizeof *sorted);
    if (!sorted)
        exit(1);
    hada_status status = hada_image_crop(&frame, &b->raw, 0, 0, b->raw.rows, b->raw.cols, err);
    if (!status)
        status = hada_image_create(&opacity, 1, b->camera.window_rows, b->camera.window_cols, err);
    for (int round = 0; round <= ROUNDS && !status; round++) {
        if (round) {
            find_opaque(&result.planes[NEAR], &opacity, sorted);
            status = give_back(b, &result, &opacity, &frame, err);
        }
        if (status || (status = hada_plan_run(b->plan, &frame, &result, err)))
            break;
        printf("%-44s %5.2f dB   residual %.3f\n",
               round ? round == 1 ? "  light that the leaf took given back, once" : "  again"
                     : "lensless, two planes refined",
               psnr(b, &result.planes[FAR]), result.report->residual);
        if (!round)
            status = save(folder, "far_plain", &result.planes[FAR], 1.0, err);
    }
    if (!status && !(status = save(folder, "far", &result.planes[FAR], 1.0, err)) &&
        !(status = save(folder, "near", &result.planes[NEAR], 1.0, err)))
        status = save(folder, "opaque", &opacity, 1.0, err);
    hada_result_destroy(&result);
    hada_image_destroy(&frame);
    hada_image_destroy(&opacity);
    free(sorted);
    return status;
}

static hada_status run(bench *b, const char *folder, hada_error *err)
{
    const int occupied[] = {NEAR, FAR};
    hada_plan_options options;
    hada_image view = {0};
    hada_status status;
    b->camera.size = sizeof b->camera;
    if ((status = hada_camera_preset(&b->camera, "sim512", err)) ||
        (status = hada_camera_set_depths(&b->camera, 100.0, 600.0, DEPTHS, err)) ||
        (status = hada_context_create(&b->context, NULL, err)))
        return status;
    b->camera.seed = b->seed;
    if ((status = hada_simulator_create(&b->simulator, b->context, &b->camera, NULL, err)) ||
        (status = make_scene(b, err)) || (status = learn(b, err)))
        return status;
    const hada_plane planes[] = {{NEAR, &b->leaf}, {FAR, &b->picture}};
    const hada_image *const opacity[] = {&b->opacity, NULL};
    hada_plan_options_init(&options);
    options.occupied = HADA_OCCUPIED_LIST;
    options.occupied_list = occupied;
    options.occupied_count = DEPTHS;
    options.refine = 16;
    if ((status =
             hada_simulator_render_occluded(b->simulator, planes, opacity, DEPTHS, -1, noise, b->seed, &b->raw, err)) ||
        (status = hada_plan_create(&b->plan, b->context, b->model, &options, err)) ||
        (status = single_view(b, &view, err)))
        return status;
    printf("%-44s %5.2f dB\n", "the view of the lens nearest to the axis", psnr(b, &view));
    if (!(status = save(folder, "picture", &b->picture, 1.0, err)) &&
        !(status = save(folder, "raw", &b->raw, HADA_AUTO, err)))
        status = save(folder, "single_view", &view, HADA_AUTO, err);
    hada_image_destroy(&view);
    return status ? status : look_through(b, folder, err);
}

int main(int argc, char **argv)
{
    bench b = {0};
    hada_error err = {0};
    if (argc != 2 && argc != 3) {
        fprintf(stderr, "usage: %s FOLDER [SEED]\n", argv[0]);
        return 2;
    }
    b.seed = argc == 3 ? strtoull(argv[2], NULL, 10) : 1;
    const hada_status status = run(&b, argv[1], &err);
    if (status)
        fprintf(stderr, "%s\n", err.message);
    hada_plan_destroy(&b.plan);
    hada_model_destroy(&b.model);
    hada_simulator_destroy(&b.simulator);
    hada_context_destroy(&b.context);
    hada_image_destroy(&b.leaf);
    hada_image_destroy(&b.opacity);
    hada_image_destroy(&b.picture);
    hada_image_destroy(&b.raw);
    free(b.region);
    return status ? 1 : 0;
}
