/* Depth pursuit: which depths a frame contains. */
#include "dry.h"
#include "refine/pursuit.h"
#include "tiny_camera.h"

typedef struct fixture {
    tiny_camera camera;
    tiny_device device;
    hada_pursuit *pursuit;
    hada_pursuit_options options;
    double *scenes, *image;
} fixture;

static void set_up(fixture *f, int rows, int cols, int window, int depths, int padded)
{
    f->camera = tiny_make(rows, cols, window, window, depths, 1, padded);
    tiny_upload(&f->device, &f->camera);
    f->scenes = tiny_zeros((size_t)depths * f->camera.window_area);
    f->image = tiny_zeros(f->camera.pixels);
    hada_pursuit_options_init(&f->options);
    f->options.shape = f->device.shape;
    f->options.depths = depths;
    ASSERT_OK(hada_pursuit_create(&f->pursuit, f->device.slot, &f->options, err));
    ASSERT_OK(hada_pursuit_set_otf(f->pursuit, f->device.otf.mem, 0, err));
}

static void tear_down(fixture *f)
{
    hada_pursuit_destroy(&f->pursuit);
    tiny_release(&f->device);
    tiny_free(&f->camera);
    HADA_FREE(f->scenes, f->image);
}

static double *clear(fixture *f)
{
    memset(f->scenes, 0, (size_t)f->camera.depths * f->camera.window_area * sizeof *f->scenes);
    return f->scenes;
}

static hada_pursuit_result look(fixture *f, double noise, double gain)
{
    hada_pursuit_result result;
    tiny_shoot(&f->camera, f->scenes, noise, 5, f->image);
    tiny_expose(&f->device, &f->camera, f->image, gain);
    ASSERT_OK(hada_pursuit_run(f->pursuit, f->device.spectrum.mem, 1.0, &result, err));
    return result;
}

/* The prior of frames like the one of a full scene at the first depth. */
static void learn_prior(fixture *f, double noise)
{
    tiny_scene(&f->camera, 30, clear(f));
    tiny_shoot(&f->camera, f->scenes, noise, 6, f->image);
    tiny_prior(&f->device, &f->camera, f->image, noise);
    ASSERT_OK(hada_pursuit_set_prior(f->pursuit, f->device.prior.mem, err));
}

static void assert_found(const hada_pursuit_result *result, int count, const int *list, const char *what)
{
    char found[64] = "", wanted[64] = "", falls[200] = "";
    int same = result->count == count && !result->all;
    for (int i = 0; i < result->count; i++)
        snprintf(found + strlen(found), sizeof found - strlen(found), " %d", result->list[i]);
    for (int i = 0; i < count; i++)
        snprintf(wanted + strlen(wanted), sizeof wanted - strlen(wanted), " %d", list[i]);
    for (int i = 0; i < result->rounds; i++)
        snprintf(falls + strlen(falls), sizeof falls - strlen(falls), " %.2f", result->reduction[i]);
    for (int i = 0; same && i < count; i++)
        same = result->list[i] == list[i];
    print_message("%s: found%s%s, wanted%s, falls%s, residual %.3f, %zu transforms, %.0f ms\n", what, found,
                  result->all ? " (all)" : "", wanted, falls, result->residual, result->transforms,
                  1e3 * result->seconds);
    if (!same)
        fail_msg("%s: found%s, wanted%s", what, found, wanted);
}

/* One scene per given depth, each in its own share of the window's columns. */
static void share_window(fixture *f, int count, const int *list)
{
    const size_t cols = (size_t)f->camera.window.cols;
    clear(f);
    for (int k = 0; k < count; k++) {
        double *scene = f->scenes + (size_t)list[k] * f->camera.window_area;
        tiny_scene(&f->camera, 40 + (unsigned)k, scene);
        for (size_t i = 0; i < f->camera.window_area; i++)
            if (i % cols * (size_t)count / cols != (size_t)k)
                scene[i] = 0.0;
    }
}

TEST(finds_what_is_there)
{
    static const struct {
        const char *what;
        int count, list[4];
    } rows[] = {{"near", 1, {0}},          {"far", 1, {3}},
                {"two apart", 2, {0, 3}},  {"two apart", 2, {1, 3}},
                {"neighbours", 2, {1, 2}}, {"neighbours", 2, {2, 3}},
                {"three", 3, {0, 1, 3}},   {"slanted, all", 4, {0, 1, 2, 3}}};
    fixture f;
    set_up(&f, 96, 128, 36, 4, 0);
    learn_prior(&f, 0.01);
    for (size_t k = 0; k < HADA_COUNT(rows); k++) {
        share_window(&f, rows[k].count, rows[k].list);
        const hada_pursuit_result result = look(&f, 0.01, 1.0);
        assert_found(&result, rows[k].count, rows[k].list, rows[k].what);
    }
    tear_down(&f);
}

TEST(finds_nothing_in_the_dark)
{
    fixture f;
    set_up(&f, 96, 128, 36, 4, 0);
    learn_prior(&f, 0.01);
    clear(&f);
    hada_pursuit_result result = look(&f, 0.0, 1.0);
    assert_found(&result, 0, NULL, "black");
    hada_random random;
    hada_random_seed(&random, 3, 3);
    for (size_t i = 0; i < f.camera.pixels; i++)
        f.image[i] = 0.002 * hada_random_normal(&random);
    tiny_expose(&f.device, &f.camera, f.image, 1.0);
    ASSERT_OK(hada_pursuit_run(f.pursuit, f.device.spectrum.mem, 1.0, &result, err));
    assert_found(&result, 0, NULL, "noise");
    /* a constant frame cannot come from a window: anything but a failure will do */
    for (size_t i = 0; i < f.camera.pixels; i++)
        f.image[i] = 0.5;
    tiny_expose(&f.device, &f.camera, f.image, 1.0);
    ASSERT_OK(hada_pursuit_run(f.pursuit, f.device.spectrum.mem, 1.0, &result, err));
    assert_true(result.count >= 0 && result.count <= 4 && result.residual >= 0.0 && result.residual <= 1.0);
    tear_down(&f);
}

TEST(says_that_a_scene_fills_all_depths)
{
    static const int all[] = {0, 1, 2, 3, 4, 5, 6, 7};
    fixture f;
    set_up(&f, 128, 160, 48, 8, 0);
    learn_prior(&f, 0.005);
    share_window(&f, 8, all);
    hada_pursuit_result result = look(&f, 0.005, 1.0);
    print_message("slanted over 8 depths: all %d, %zu transforms, %.0f ms\n", result.all, result.transforms,
                  1e3 * result.seconds);
    assert_true(result.all || result.count >= 3);
    assert_true(result.transforms < 8000);
    static const int two[] = {1, 6};
    share_window(&f, 2, two);
    result = look(&f, 0.005, 1.0);
    assert_found(&result, 2, two, "two of 8");
    tear_down(&f);
}

TEST(ignores_brightness_and_repetition)
{
    static const int list[] = {1, 3};
    fixture f;
    set_up(&f, 96, 128, 36, 4, 0);
    learn_prior(&f, 0.01);
    share_window(&f, 2, list);
    const hada_pursuit_result first = look(&f, 0.01, 1.0), again = look(&f, 0.01, 1.0), bright = look(&f, 0.01, 1024.0);
    assert_found(&first, 2, list, "once");
    assert_int_equal(first.rounds, again.rounds);
    for (int i = 0; i < first.rounds; i++) {
        assert_true(first.reduction[i] == again.reduction[i]);
        assert_true(fabs(first.reduction[i] - bright.reduction[i]) < 1e-6);
    }
    assert_found(&bright, 2, list, "bright");
    tear_down(&f);
}

TEST(works_where_the_sensor_crops)
{
    static const int lists[][2] = {{2, 2}, {0, 2}};
    fixture f;
    set_up(&f, 80, 96, 48, 3, 1);
    learn_prior(&f, 0.005);
    for (int k = 0; k < 2; k++) {
        share_window(&f, k + 1, lists[k]);
        const hada_pursuit_result result = look(&f, 0.005, 1.0);
        assert_found(&result, k + 1, lists[k], "cropped");
    }
    tear_down(&f);
}

TEST(holds_the_bytes_it_states)
{
    for (int padded = 0; padded < 2; padded++) {
        fixture f;
        hada_pursuit *none;
        set_up(&f, 48, 64, 24, 3, padded);
        const uint64_t with = hada_context_bytes(f.device.context);
        hada_pursuit_destroy(&f.pursuit);
        const uint64_t without = hada_context_bytes(f.device.context);
        ASSERT_DRY(with - without, f.device.context, hada_pursuit,
                   hada_pursuit_create(&object, &dry.slot, &f.options, NULL), hada_pursuit_destroy);
        f.options.depths = 0;
        ASSERT_FAILS(hada_pursuit_create(&none, f.device.slot, &f.options, err), HADA_ERROR_ARGUMENT, "");
        assert_null(none);
        tear_down(&f);
    }
}
