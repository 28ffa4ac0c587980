/* Point spread functions that vary over the field: components from measured ones, the forward model and its transpose,
 * reconstruction, files, refusals, and simulated cameras. */
#include <unistd.h>

#include "camera_small.h"
#include "classic/classic_steps.h"
#include "dispatch/plan.h"
#include "forward_fixture.h"
#include "model/model.h"
#include "ref/ref_varying.h"

/* A frame and a window, and PSFs measured at GRID x GRID points, STEP pixels apart. */
enum { DOWN = 40, ACROSS = 44, WINDOW = 15, GRID = 3, STEP = 7, POINTS = GRID * GRID, DEPTHS = 2, PARTS = 3 };
enum { AREA = DOWN * ACROSS, LIGHT = WINDOW * WINDOW, MIDDLE = DOWN / 2 * ACROSS + ACROSS / 2 };

/* h(p) = h0 + r h1 + c h2, r and c from -1 to 1 from side to side: three components, which splines find exactly. */
typedef struct varying {
    double psf[DEPTHS][PARTS * AREA];
    double weights[PARTS * LIGHT];
    hada_image measured[DEPTHS * POINTS];
    double rows[DEPTHS * POINTS], cols[DEPTHS * POINTS];
} varying;

static double place_of(int pixel)
{
    return (pixel + (DOWN - WINDOW) / 2 - DOWN / 2) / (double)STEP;
}

static double place_across(int pixel)
{
    return (pixel + (ACROSS - WINDOW) / 2 - ACROSS / 2) / (double)STEP;
}

static varying *varying_camera(void)
{
    varying *v = calloc(1, sizeof *v);
    hada_random random;
    assert_non_null(v);
    hada_random_seed(&random, 11, 0);
    for (int z = 0; z < DEPTHS; z++) {
        double *h = v->psf[z], total = 0.0;
        for (int i = 0; i < 14; i++) { /* spots that change, and as much light where they are darker */
            const int row = DOWN / 2 - 8 + (int)hada_random_below(&random, 17),
                      col = ACROSS / 2 - 9 + (int)hada_random_below(&random, 19);
            double *spot = h + row * ACROSS + col;
            const double change[2] = {hada_random_range(&random, -0.4, 0.4), hada_random_range(&random, -0.4, 0.4)};
            spot[0] += 1.0;
            total += 1.0;
            spot[AREA] += change[0];
            spot[2 * AREA] += change[1];
            h[AREA + MIDDLE] -= 0.9 * change[0];
            h[2 * AREA + MIDDLE] -= 0.9 * change[1];
        }
        h[MIDDLE] += 4.0;
        total += 4.0;
        for (int i = 0; i < PARTS * AREA; i++)
            h[i] /= total;
        for (int n = 0; n < POINTS; n++) {
            const int down = (n / GRID - 1) * STEP, across = (n % GRID - 1) * STEP, at = z * POINTS + n;
            ASSERT_OK(hada_image_create(&v->measured[at], 1, DOWN, ACROSS, err));
            v->rows[at] = down;
            v->cols[at] = across;
            for (int i = 0; i < DOWN; i++)
                for (int j = 0; j < ACROSS; j++) {
                    const int row = i - down, col = j - across, from = row * ACROSS + col;
                    if (row >= 0 && col >= 0 && row < DOWN && col < ACROSS)
                        v->measured[at].data[i * ACROSS + j] =
                            (float)(h[from] + (n / GRID - 1) * h[AREA + from] + (n % GRID - 1) * h[2 * AREA + from]);
                }
        }
    }
    for (int i = 0; i < LIGHT; i++) {
        v->weights[i] = 1.0;
        v->weights[LIGHT + i] = place_of(i / WINDOW);
        v->weights[2 * LIGHT + i] = place_across(i % WINDOW);
    }
    return v;
}

static void free_varying(varying *v)
{
    destroy_images(v->measured, DEPTHS * POINTS);
    free(v);
}

static hada_ref_varying reference(const varying *v, int depth)
{
    return (hada_ref_varying){DOWN, ACROSS, WINDOW, WINDOW, PARTS, v->psf[depth], v->weights};
}

static hada_psf_options psf_options(const varying *v, int components)
{
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = WINDOW;
    options.psf_dark = options.dark = 0;
    options.positions = POINTS;
    options.position_rows = v->rows;
    options.position_cols = v->cols;
    options.components = components;
    return options;
}

/* Of colours: each sees the same PSF, some more of it. */
enum { COLOURS = 3 };
static const float colour_gain[COLOURS] = {0.5f, 1.0f, 1.5f};

static hada_model *colour_model(const varying *v)
{
    const double distances[DEPTHS] = {100.0, 200.0};
    const hada_psf_options options = psf_options(v, PARTS);
    hada_image measured[DEPTHS * POINTS];
    hada_model *model;
    for (int n = 0; n < DEPTHS * POINTS; n++) {
        ASSERT_OK(hada_image_create(&measured[n], COLOURS, DOWN, ACROSS, err));
        for (int i = 0; i < COLOURS * AREA; i++)
            measured[n].data[i] = colour_gain[i / AREA] * v->measured[n].data[i % AREA];
    }
    ASSERT_OK(hada_model_from_psf(&model, context, measured, DEPTHS, distances, &options, err));
    destroy_images(measured, DEPTHS * POINTS);
    return model;
}

static hada_model *model_of(const varying *v, int depths, int components)
{
    const double distances[DEPTHS] = {100.0, 200.0};
    const hada_psf_options options = psf_options(v, components);
    hada_model *model;
    ASSERT_OK(hada_model_from_psf(&model, context, v->measured, depths, distances, &options, err));
    return model;
}

/* Three components are all there are, whatever is allowed to be lost; a single one loses what varies. */
TEST(finds_the_components)
{
    varying *v = varying_camera();
    SCOPED(hada_model) *model = NULL, *single = model_of(v, DEPTHS, 1);
    hada_psf_options options = psf_options(v, HADA_AUTO);
    const double distances[DEPTHS] = {100.0, 200.0};
    options.explained = 1.0 - 1e-6;
    ASSERT_OK(hada_model_from_psf(&model, context, v->measured, DEPTHS, distances, &options, err));
    const hada_model_info *info = hada_model_get_info(model);
    assert_int_equal(info->components, PARTS);
    assert_int_equal(info->positions, POINTS);
    assert_true(info->lost < 1e-10 && info->lost_single > 0.01);
    assert_int_equal(hada_model_get_info(single)->components, 1);
    assert_true(hada_model_get_info(single)->lost == info->lost_single);
    assert_null(single->component_otf);
    /* no light is lost or gained: sum_k w_k H_k(0) is that of each PSF */
    double light[PARTS] = {0.0};
    for (int i = 0; i < PARTS * AREA; i++)
        light[i / AREA] += v->psf[0][i];
    for (int n = 0; n < 2; n++) {
        SCOPED(hada_model) *some = model_of(v, 1, n ? PARTS : 2);
        for (int i = 0; i < LIGHT; i++) {
            double sum = 0.0, expected = 0.0;
            for (int k = 0; k < some->info.components; k++)
                sum += (double)some->component_weights[k * LIGHT + i] *
                       some->component_otf[2 * (size_t)k * hada_model_plane(some)];
            for (int k = 0; k < PARTS; k++)
                expected += v->weights[k * LIGHT + i] * light[k];
            assert_true(fabs(sum - expected) < 1e-5);
        }
    }
    free_varying(v);
}

/* Light that one PSF loses beyond its picture, another one sees: PSFs that are the same everywhere stay so. */
TEST(fills_what_pictures_miss)
{
    static const int spots[][2] = {{0, 0}, {-17, 3}, {16, -5}, {4, 19}, {-2, -18}};
    varying *v = varying_camera();
    SCOPED(hada_model) *model = NULL;
    const double distance = 100.0;
    const hada_psf_options options = psf_options(v, HADA_AUTO);
    for (int n = 0; n < POINTS; n++) {
        memset(v->measured[n].data, 0, AREA * sizeof(float));
        for (int i = 0; i < 5; i++) {
            const int row = DOWN / 2 + spots[i][0] + (int)v->rows[n], col = ACROSS / 2 + spots[i][1] + (int)v->cols[n];
            if (row >= 0 && col >= 0 && row < DOWN && col < ACROSS)
                v->measured[n].data[row * ACROSS + col] = 1.0f;
        }
    }
    ASSERT_OK(hada_model_from_psf(&model, context, v->measured, 1, &distance, &options, err));
    assert_int_equal(model->info.components, 1);
    assert_true(model->info.lost_single < 1e-12);
    free_varying(v);
}

/* What a method holds for one job. */
typedef struct bench {
    hada_slot *slot;
    hada_buffer otf, seen;
    hada_classic *classic;
    hada_classic_camera camera;
    hada_refine_data data;
    hada_classic_job job;
} bench;

static const int list[DEPTHS] = {1, 0};

static void begin(bench *b, const hada_model *model, hada_method method, hada_support support, const float *frame)
{
    DEFAULTS(hada_classic_options, options);
    hada_classic_shape shape;
    *b = (bench){0};
    options.method = method;
    options.support = support;
    ASSERT_OK(hada_classic_shape_of(hada_model_get_info(model), DEPTHS, &options, &shape, err));
    ASSERT_OK(hada_classic_fit_grid(&shape, context, model, NULL, DEPTHS, err));
    ASSERT_OK(hada_slot_create(&b->slot, context, err));
    ASSERT_OK(hada_buffer_create_from(&b->seen, b->slot, frame, (size_t)model->info.channels * AREA * sizeof *frame,
                                      "a frame", err));
    ASSERT_OK(hada_classic_optics(&b->otf, context, &shape, model, NULL, DEPTHS, err));
    ASSERT_OK(hada_classic_camera_of(&b->camera, model, list, DEPTHS, err));
    ASSERT_OK(hada_classic_create(&b->classic, b->slot, &shape, err));
    b->data = (hada_refine_data){.frame = b->seen.mem, .otf = b->otf.mem, .otf_depths = DEPTHS};
    b->job =
        (hada_classic_job){.data = &b->data, .camera = &b->camera, .depths = DEPTHS, .list = list, .brightness = 1.0};
    ASSERT_OK(hada_classic_ready(b->classic, &b->job, err));
}

static void end(bench *b)
{
    hada_classic_destroy(&b->classic);
    hada_classic_camera_free(&b->camera);
    HADA_DESTROY_BUFFERS(&b->otf, &b->seen);
    hada_slot_destroy(&b->slot);
}

/* The window of planes, to (write 1) or from a part of the method: [place in the list][colour]. */
static void move_planes(bench *b, hada_classic_part part, float *window, int write)
{
    const hada_classic_image *image = &b->classic->plane;
    const hada_classic_shape *shape = &b->classic->shape;
    const size_t bytes = (size_t)(DEPTHS * COLOURS) * image->pixels * sizeof(float);
    const int row0 = shape->place.window.row0 - shape->support.row0,
              col0 = shape->place.window.col0 - shape->support.col0;
    SCOPED_MEMORY float *all = calloc(1, bytes);
    if (!write)
        ASSERT_OK(hada_buffer_read(&b->classic->part[part], b->slot, 0, all, bytes, err));
    for (int i = 0; i < DEPTHS * COLOURS * LIGHT; i++) {
        float *pixel = all + (size_t)(i / LIGHT) * image->pixels +
                       (size_t)(row0 + i % LIGHT / WINDOW) * (size_t)image->pitch + (size_t)(col0 + i % WINDOW);
        *(write ? pixel : &window[i]) = write ? window[i] : *pixel;
    }
    if (write)
        ASSERT_OK(hada_buffer_write(&b->classic->part[part], b->slot, 0, all, bytes, err));
}

static void read_frame(bench *b, float *frame)
{
    const hada_classic_image *image = &b->classic->frame;
    const size_t bytes = COLOURS * image->pixels * sizeof(float);
    SCOPED_MEMORY float *all = calloc(1, bytes);
    ASSERT_OK(hada_buffer_read(&b->classic->part[HADA_CLASSIC_PREDICTION], b->slot, 0, all, bytes, err));
    for (int i = 0; i < COLOURS * DOWN; i++)
        memcpy(frame + (size_t)i * ACROSS,
               all + (size_t)(i / DOWN) * image->pixels + (size_t)(i % DOWN) * (size_t)image->pitch,
               ACROSS * sizeof *frame);
}

static void fill(float *values, double *exact, size_t count, uint64_t seed)
{
    hada_random random;
    hada_random_seed(&random, seed, 0);
    for (size_t i = 0; i < count; i++)
        exact[i] = values[i] = (float)hada_random_uniform(&random);
}

/* The forward model and its transpose are those of the plain reference, from the PSFs as they were measured, to what
 * single precision leaves; and one is the transpose of the other. */
TEST(models_and_transposes)
{
    enum { IMAGES = DEPTHS * COLOURS };
    static float x[IMAGES * LIGHT], b[COLOURS * AREA], made[COLOURS * AREA], back[IMAGES * LIGHT], none[COLOURS * AREA];
    static double x_exact[IMAGES * LIGHT], b_exact[COLOURS * AREA], frame[COLOURS * AREA], part[AREA],
        planes[IMAGES * LIGHT];
    static const hada_method methods[] = {HADA_METHOD_RL, HADA_METHOD_FISTA, HADA_METHOD_FISTA};
    static const hada_support supports[] = {HADA_SUPPORT_WINDOW, HADA_SUPPORT_WINDOW, HADA_SUPPORT_GRID};
    varying *v = varying_camera();
    SCOPED(hada_model) *model = colour_model(v);
    fill(x, x_exact, IMAGES * LIGHT, 1);
    fill(b, b_exact, COLOURS * AREA, 2);
    memset(frame, 0, sizeof frame);
    for (int n = 0; n < IMAGES; n++) {
        const int colour = n % COLOURS;
        const hada_ref_varying camera = reference(v, list[n / COLOURS]);
        hada_ref_varying_forward(&camera, x_exact + n * LIGHT, part);
        for (int i = 0; i < AREA; i++)
            frame[colour * AREA + i] += colour_gain[colour] * part[i];
        hada_ref_varying_transpose(&camera, b_exact + colour * AREA, planes + n * LIGHT);
        for (int i = 0; i < LIGHT; i++)
            planes[n * LIGHT + i] *= colour_gain[colour];
    }
    for (int i = 0; i < 3; i++) {
        double forward = 0.0, transposed = 0.0, size_x = 0.0, size_b = 0.0;
        bench now;
        begin(&now, model, methods[i], supports[i], none);
        move_planes(&now, HADA_CLASSIC_PRIMAL, x, 1);
        ASSERT_OK(hada_classic_predict(now.classic, HADA_CLASSIC_PRIMAL, err));
        ASSERT_OK(hada_classic_data_step(now.classic, HADA_CLASSIC_RESIDUAL, 0.0, 0, err));
        read_frame(&now, made);
        end(&now);
        for (int k = 0; k < COLOURS * AREA; k++)
            made[k] = -made[k]; /* what the planes leave of nothing */
        assert_true(relative_error(made, frame, COLOURS * AREA) < 1e-6);
        begin(&now, model, methods[i], supports[i], b);
        ASSERT_OK(hada_classic_predict(now.classic, HADA_CLASSIC_PRIMAL, err));
        ASSERT_OK(hada_classic_data_step(now.classic, HADA_CLASSIC_RESIDUAL, 0.0, 1, err));
        ASSERT_OK(hada_classic_transpose(now.classic, HADA_CLASSIC_EXTRAPOLATED, err));
        move_planes(&now, HADA_CLASSIC_EXTRAPOLATED, back, 0);
        end(&now);
        assert_true(relative_error(back, planes, IMAGES * LIGHT) < 1e-6);
        for (int k = 0; k < COLOURS * AREA; k++) {
            forward += (double)made[k] * b[k];
            size_b += (double)b[k] * b[k];
        }
        for (int k = 0; k < IMAGES * LIGHT; k++) {
            transposed += (double)back[k] * x[k];
            size_x += (double)x[k] * x[k];
        }
        assert_true(fabs(forward - transposed) <= 1e-6 * sqrt(size_x * size_b));
    }
    free_varying(v);
}

/* The bound of the gradient's step is one: no planes make a frame that is larger. */
TEST(bounds_the_gain)
{
    double *x = calloc(2 * LIGHT, sizeof *x), *frame = calloc(AREA, sizeof *frame), gain = 0.0;
    varying *v = varying_camera();
    SCOPED(hada_model) *model = model_of(v, 1, PARTS);
    const hada_ref_varying camera = reference(v, 0);
    hada_classic_camera own = {0};
    const int first = 0;
    ASSERT_OK(hada_classic_camera_of(&own, model, &first, 1, err));
    for (int i = 0; i < LIGHT; i++)
        x[i] = 1.0;
    for (int k = 0; k < 30; k++) { /* power iteration */
        double size = 0.0;
        hada_ref_varying_forward(&camera, x, frame);
        hada_ref_varying_transpose(&camera, frame, x);
        for (int i = 0; i < LIGHT; i++)
            size += x[i] * x[i];
        gain = sqrt(size);
        for (int i = 0; i < LIGHT; i++)
            x[i] /= gain;
    }
    assert_true(own.largest[0] >= gain * (1.0 - 1e-6) && own.largest[0] < 4.0 * gain);
    hada_classic_camera_free(&own);
    HADA_FREE(x, frame);
    free_varying(v);
}

static hada_status run(const hada_model *model, hada_method method, hada_scene scene, const hada_image *frame,
                       hada_result *result, hada_error *err)
{
    DEFAULTS(hada_plan_options, options);
    DEFAULTS(hada_classic_options, classic);
    SCOPED(hada_plan) *plan = NULL;
    classic.method = method;
    classic.iterations = 150;
    options.classic = method ? &classic : NULL;
    options.scene = scene;
    options.skip = 0;
    const hada_status status = hada_plan_create(&plan, context, model, &options, err);
    return status ? status : hada_plan_run(plan, frame, result, err);
}

/* Methods find a scene better by components than by the mean PSF; twice the same bits; a volume is one of them. */
TEST(reconstructs)
{
    static const hada_method methods[] = {HADA_METHOD_RL, HADA_METHOD_FISTA, HADA_METHOD_MODEL};
    varying *v = varying_camera();
    SCOPED(hada_model) *model = model_of(v, 1, PARTS), *single = model_of(v, 1, 1);
    SCOPED(hada_image) scene = small_scene(1, WINDOW, WINDOW, 4), frame;
    static double x[LIGHT], made[AREA];
    const hada_ref_varying camera = reference(v, 0);
    for (int i = 0; i < LIGHT; i++)
        x[i] = scene.data[i] = scene.data[i] > 0.7f ? scene.data[i] : 0.0f;
    hada_ref_varying_forward(&camera, x, made);
    ASSERT_OK(hada_image_create(&frame, 1, DOWN, ACROSS, err));
    for (int i = 0; i < AREA; i++)
        frame.data[i] = (float)made[i];
    for (int i = 0; i < 3; i++) {
        SCOPED(hada_result) exact = {0}, again = {0}, mean = {0};
        const hada_scene kind = methods[i] ? HADA_SCENE_AUTO : HADA_SCENE_VOLUME;
        ASSERT_OK(run(model, methods[i], kind, &frame, &exact, err));
        ASSERT_OK(run(model, methods[i], kind, &frame, &again, err));
        ASSERT_OK(run(single, methods[i], kind, &frame, &mean, err));
        assert_memory_equal(exact.planes[0].data, again.planes[0].data, LIGHT * sizeof(float));
        const double error = relative_change(exact.planes[0].data, scene.data, LIGHT),
                     plain = relative_change(mean.planes[0].data, scene.data, LIGHT);
        if (!(error < 0.02 && plain > 0.04))
            fail_msg("method %d: %.3g with components, %.3g with the mean PSF", (int)methods[i], error, plain);
        assert_true(exact.report->residual < 0.3 * mean.report->residual);
    }
    free_varying(v);
}

/* A plan holds no more than its estimate says, which counts components. */
TEST(estimates_include_components)
{
    varying *v = varying_camera();
    uint64_t bytes[2], host, held;
    for (int i = 0; i < 2; i++) {
        SCOPED(hada_model) *model = model_of(v, DEPTHS, i ? PARTS : 1);
        SCOPED(hada_plan) *plan = NULL;
        DEFAULTS(hada_plan_options, options);
        DEFAULTS(hada_classic_options, classic);
        classic.method = HADA_METHOD_RL;
        options.classic = &classic;
        ASSERT_OK(hada_plan_estimate(context, model, &options, &bytes[i], &host, err));
        ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
        hada_plan_memory(plan, &held, NULL);
        assert_true(held <= bytes[i] && held > bytes[i] / 2);
    }
    assert_true(bytes[1] > bytes[0]);
    free_varying(v);
}

/* What takes PSFs for the same everywhere says what to do. */
TEST(refuses_the_rest)
{
    varying *v = varying_camera();
    SCOPED(hada_model) *model = model_of(v, DEPTHS, PARTS), *wiener = NULL;
    SCOPED(hada_image) frame;
    SCOPED(hada_result) result = {0};
    ASSERT_OK(hada_image_create(&frame, 1, DOWN, ACROSS, err));
    static const hada_method methods[] = {HADA_METHOD_MODEL, HADA_METHOD_WIENER, HADA_METHOD_ADMM};
    for (int i = 0; i < 3; i++)
        ASSERT_FAILS(run(model, methods[i], HADA_SCENE_AUTO, &frame, &result, err), HADA_ERROR_MODEL,
                     "options.method rl or fista");
    ASSERT_OK(hada_model_with_form(&wiener, model, HADA_FORM_WIENER, 0.1, err));
    assert_int_equal(hada_model_get_info(wiener)->components, PARTS);
    ASSERT_FAILS(run(wiener, HADA_METHOD_MODEL, HADA_SCENE_AUTO, &frame, &result, err), HADA_ERROR_MODEL, "vary");
    free_varying(v);
}

TEST(refuses_positions_that_tell_nothing)
{
    varying *v = varying_camera();
    const double distances[DEPTHS] = {100.0, 200.0};
    hada_psf_options options = psf_options(v, HADA_AUTO);
    hada_model *model;
    static double line[POINTS];
    for (int n = 0; n < POINTS; n++)
        line[n] = v->rows[n] + n;
    options.position_rows = options.position_cols = line;
    ASSERT_FAILS(hada_model_from_psf(&model, context, v->measured, 1, distances, &options, err), HADA_ERROR_ARGUMENT,
                 "line");
    options.position_rows = options.position_cols = NULL;
    ASSERT_FAILS(hada_model_from_psf(&model, context, v->measured, 1, distances, &options, err), HADA_ERROR_ARGUMENT,
                 "positions");
    options = psf_options(v, 2);
    options.positions = 3;
    ASSERT_FAILS(hada_model_from_psf(&model, context, v->measured, 1, distances, &options, err), HADA_ERROR_ARGUMENT,
                 "4 positions");
    options = psf_options(v, HADA_AUTO);
    v->rows[1] = v->rows[0];
    v->cols[1] = v->cols[0];
    ASSERT_FAILS(hada_model_from_psf(&model, context, v->measured, 1, distances, &options, err), HADA_ERROR_ARGUMENT,
                 "average");
    options = psf_options(v, 17);
    ASSERT_FAILS(hada_model_from_psf(&model, context, v->measured, 1, distances, &options, err), HADA_ERROR_ARGUMENT,
                 "components");
    options = psf_options(v, 2);
    options.boundary = HADA_BOUNDARY_CIRCULAR;
    ASSERT_FAILS(hada_model_from_psf(&model, context, v->measured, 1, distances, &options, err), HADA_ERROR_ARGUMENT,
                 "padded");
    free_varying(v);
}

/* A file keeps all of it; copies do. A plain camera's file does not know of it. */
TEST(files_and_copies_keep_components)
{
    char path[] = "/tmp/hadalens-varying-XXXXXX";
    varying *v = varying_camera();
    SCOPED(hada_model) *model = model_of(v, DEPTHS, PARTS), *loaded = NULL, *half = NULL;
    const size_t spectra = hada_model_component_images(&model->info) * hada_model_plane(model) * 2,
                 weights = hada_model_component_weights(&model->info);
    assert_true(close(mkstemp(path)) == 0);
    ASSERT_OK(hada_model_save(model, path, err));
    ASSERT_OK(hada_model_load(&loaded, path, err));
    ASSERT_OK(hada_model_to_half(&half, loaded, err));
    unlink(path);
    hada_model *const copies[] = {loaded, half};
    for (int i = 0; i < 2; i++) {
        hada_model_arrays arrays = {.size = sizeof arrays};
        const hada_model_info *info = hada_model_get_info(copies[i]);
        ASSERT_OK(hada_model_get_arrays(copies[i], &arrays, err));
        assert_int_equal(info->components, PARTS);
        assert_int_equal(info->positions, POINTS);
        assert_true(info->lost == model->info.lost && info->lost_single == model->info.lost_single);
        assert_memory_equal(arrays.component_otf, model->component_otf, spectra * sizeof(float));
        assert_memory_equal(arrays.component_weights, model->component_weights, weights * sizeof(float));
        assert_memory_equal(arrays.singular_values, model->singular_values, DEPTHS * POINTS * sizeof(double));
    }
    free_varying(v);
}

/* Turned images give the turned camera. */
TEST(turns_with_the_images)
{
    static const hada_turn turns[] = {HADA_TURN_MIRROR, HADA_TURN_FLIP, HADA_TURN_180};
    varying *v = varying_camera();
    SCOPED(hada_model) *plain = model_of(v, 1, PARTS);
    const double distance = 100.0;
    for (int i = 0; i < 3; i++) {
        SCOPED(hada_model) *turned = NULL;
        hada_psf_options options = psf_options(v, PARTS);
        options.turn = turns[i];
        ASSERT_OK(hada_model_from_psf(&turned, context, v->measured, 1, &distance, &options, err));
        for (int k = 0; k < PARTS; k++)
            for (int p = 0; p < LIGHT; p++) { /* pixels -8 to 6 from the axis, to 8 to -6 */
                const int row = turns[i] & HADA_TURN_FLIP ? WINDOW + 1 - p / WINDOW : p / WINDOW,
                          col = turns[i] & HADA_TURN_MIRROR ? WINDOW + 1 - p % WINDOW : p % WINDOW;
                if (row >= WINDOW || col >= WINDOW)
                    continue;
                const float here = turned->component_weights[k * LIGHT + p],
                            there = plain->component_weights[k * LIGHT + row * WINDOW + col];
                assert_true(fabsf(here - there) < 1e-4f);
            }
    }
    free_varying(v);
}

static double correlation(const hada_image *a, const hada_image *b, int down, int across)
{
    double both = 0.0, one = 0.0, other = 0.0;
    for (int i = 0; i < a->rows; i++)
        for (int j = 0; j < a->cols; j++) {
            const int row = i + down, col = j + across;
            const double x = a->data[i * a->cols + j], y = row >= 0 && col >= 0 && row < b->rows && col < b->cols
                                                               ? b->data[row * b->cols + col]
                                                               : 0.0;
            both += x * y;
            one += x * x;
            other += y * y;
        }
    return both / sqrt(one * other);
}

/* PSFs of the corners have the wanted correlation with that of the middle, which is the camera's; a frame is the sum of
 * the PSFs of its points. */
TEST(simulates_what_was_asked_for)
{
    hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    DEFAULTS(hada_simulator_options, options);
    hada_simulator *simulator, *plain = simulator_of(&camera, 0, 0, 0, 0);
    SCOPED(hada_image) middle, own, scene, frame;
    double mean = 0.0;
    options.field_varying = 0.6;
    ASSERT_OK(hada_simulator_create(&simulator, context, &camera, &options, err));
    ASSERT_OK(hada_simulator_psf_at(simulator, 0, 0, 0, &middle, err));
    ASSERT_OK(hada_simulator_psf(plain, 0, &own, err));
    assert_true(relative_change(middle.data, own.data, PIXELS) < 1e-6);
    for (int k = 0; k < 4; k++) {
        const int down = k / 2 ? HIGH / 2 : -HIGH / 2, across = k % 2 ? WIDE / 2 : -WIDE / 2;
        SCOPED(hada_image) corner;
        ASSERT_OK(hada_simulator_psf_at(simulator, 0, down, across, &corner, err));
        mean += correlation(&middle, &corner, down, across) / 4.0;
    }
    assert_true(fabs(mean - 0.6) < 0.02); /* a corner's PSF may leave the sensor */
    ASSERT_OK(hada_image_create(&scene, 1, HIGH, WIDE, err));
    static float sum[PIXELS];
    for (int i = 0; i < 6; i++) {
        const int row = (5 * i + 1) % HIGH, col = (7 * i + 3) % WIDE;
        SCOPED(hada_image) psf;
        scene.data[row * WIDE + col] = 1.0f + 0.5f * (float)i;
        ASSERT_OK(hada_simulator_psf_at(simulator, 1, row + (ROWS - HIGH) / 2 - ROWS / 2,
                                        col + (COLS - WIDE) / 2 - COLS / 2, &psf, err));
        for (int q = 0; q < PIXELS; q++)
            sum[q] += (1.0f + 0.5f * (float)i) * psf.data[q];
    }
    const hada_plane plane = {1, &scene};
    ASSERT_OK(hada_simulator_render(simulator, &plane, 1, 0.0, 0, &frame, err));
    for (int c = 0; c < frame.channels; c++)
        assert_true(relative_change(frame.data + (size_t)c * PIXELS, sum, PIXELS) < 1e-6);
    const hada_image *opacity[] = {NULL};
    SCOPED(hada_image) hidden;
    ASSERT_FAILS(hada_simulator_render_occluded(simulator, &plane, opacity, 1, -1, 0.0, 0, &hidden, err),
                 HADA_ERROR_UNSUPPORTED, "field_varying");
    hada_simulator_destroy(&simulator);
    hada_simulator_destroy(&plain);
    options.field_varying = 1.5;
    ASSERT_FAILS(hada_simulator_create(&simulator, context, &camera, &options, err), HADA_ERROR_ARGUMENT,
                 "field_varying");
    camera.boundary = HADA_BOUNDARY_CIRCULAR;
    options.field_varying = 0.6;
    ASSERT_FAILS(hada_simulator_create(&simulator, context, &camera, &options, err), HADA_ERROR_ARGUMENT, "padded");
}

FIXTURE(open_device, close_device)
