/* Plans whose model holds a net: its planes are the net's of the planes without it, on every path; the rest of the plan
 * knows of it. */
#include "camera_small.h"

#include "net/enhance.h"

enum { ROWS = 24, COLS = 32, WINDOW_ROWS = 14, WINDOW_COLS = 18, DEPTHS = 5, CHANNELS = 3 };

typedef struct fixture {
    hada_context *context;
    hada_slot *slot;
    hada_model *plain, *model;
    hada_net *net;
    hada_image frame;
} fixture;

static int setup(void **state)
{
    static fixture f;
    hada_image psf[DEPTHS], scene;
    double distances[DEPTHS];
    ASSERT_OK(hada_context_create(&f.context, NULL, err));
    ASSERT_OK(hada_slot_create(&f.slot, f.context, err));
    DEFAULTS(hada_psf_options, options);
    options.window_rows = WINDOW_ROWS;
    options.window_cols = WINDOW_COLS;
    options.boundary = HADA_BOUNDARY_CIRCULAR;
    for (int z = 0; z < DEPTHS; z++) {
        distances[z] = 100.0 * (z + 1);
        psf[z] = small_psf(CHANNELS, ROWS, COLS, 12, (uint64_t)z + 1);
    }
    scene = small_scene(CHANNELS, WINDOW_ROWS, WINDOW_COLS, 1);
    f.frame = small_frame(&psf[2], &scene, 0, 0.003, 1);
    ASSERT_OK(hada_model_from_psf(&f.plain, f.context, psf, DEPTHS, distances, &options, err));
    DEFAULTS(hada_unet_options, unet);
    unet.down = "8|10";
    unet.up = "7";
    unet.shared = unet.last_norm = 1;
    ASSERT_OK(hada_net_create_unet(&f.net, &unet, 3, err));
    ASSERT_OK(hada_model_with_enhance(&f.model, f.plain, f.net, 0, 0, err));
    destroy_images(psf, DEPTHS);
    hada_image_destroy(&scene);
    *state = &f;
    return 0;
}

static int teardown(void **state)
{
    fixture *f = *state;
    hada_image_destroy(&f->frame);
    hada_model_destroy(&f->plain);
    hada_model_destroy(&f->model);
    hada_net_destroy(&f->net);
    hada_slot_destroy(&f->slot);
    close_context(&f->context);
    return 0;
}

/* The paths: linear filters in batches, a list of depths, refined, refined with the depths found. */
enum { PATHS = 4 };
static hada_plan_options options_of(int path)
{
    static const int listed[] = {1, 2, 4};
    DEFAULTS(hada_plan_options, options);
    options.dark = HADA_DARK_NONE;
    options.batch = 2;
    options.refine = path >= 2 ? 3 : 0;
    options.occupied = path == 0 ? HADA_OCCUPIED_ALL : path == 3 ? HADA_OCCUPIED_AUTO : HADA_OCCUPIED_LIST;
    options.occupied_list = options.occupied == HADA_OCCUPIED_LIST ? listed : NULL;
    options.occupied_count = options.occupied_list ? 3 : 0;
    return options;
}

/* Runs a frame; making the plan takes the bytes that were stated. */
static hada_result run(const fixture *f, const hada_model *model, const hada_plan_options *options,
                       const hada_image *frame)
{
    SCOPED(hada_plan) * plan;
    hada_result result = {0};
    uint64_t device, host;
    const uint64_t before = hada_context_bytes(f->context);
    ASSERT_OK(hada_plan_estimate(f->context, model, options, &device, &host, err));
    hada_context_reset_peak(f->context);
    ASSERT_OK(hada_plan_create(&plan, f->context, model, options, err));
    assert_int_equal(hada_context_peak_bytes(f->context) - before, device);
    ASSERT_OK(hada_plan_run(plan, frame, &result, err));
    return result;
}

static void apply_net(const fixture *f, int rows, int cols, hada_image *plane)
{
    const hada_enhance_desc desc = {.net = f->net,
                                    .channels = CHANNELS,
                                    .rows = WINDOW_ROWS,
                                    .cols = WINDOW_COLS,
                                    .net_rows = rows,
                                    .net_cols = cols};
    const size_t bytes = hada_image_count(plane) * sizeof(float);
    SCOPED(hada_enhance) * enhance;
    SCOPED(hada_buffer) buffer;
    ASSERT_OK(hada_enhance_create(&enhance, f->slot, &desc, err));
    ASSERT_OK(hada_buffer_create_from(&buffer, f->slot, plane->data, bytes, "a plane", err));
    ASSERT_OK(hada_enhance_run(enhance, buffer.mem, 0, 1, 1, err));
    ASSERT_OK(hada_buffer_read(&buffer, f->slot, 0, plane->data, bytes, err));
}

TEST(planes_are_the_nets_on_every_path)
{
    const fixture *f = *state;
    for (int path = 0; path < PATHS; path++)
        for (int sized = 0; sized < 2; sized++) {
            SCOPED(hada_model) * model;
            hada_plan_options options = options_of(path);
            ASSERT_OK(hada_model_with_enhance(&model, f->plain, f->net, sized * 12, sized * 20, err));
            SCOPED(hada_result) with = run(f, model, &options, &f->frame);
            options.enhance = 0;
            SCOPED(hada_result) without = run(f, model, &options, &f->frame);
            assert_int_equal(with.report->enhanced, with.report->occupied_count);
            assert_int_equal(without.report->enhanced, 0);
            assert_true(with.report->occupied_count > 0);
            assert_memory_equal(with.report->occupied, without.report->occupied, DEPTHS);
            for (int z = 0; z < DEPTHS; z++) {
                if (with.report->occupied[z]) {
                    assert_false(same_image(&with.planes[z], &without.planes[z]));
                    apply_net(f, sized * 12, sized * 20, &without.planes[z]);
                }
                assert_true(same_image(&with.planes[z], &without.planes[z]));
            }
            assert_false(same_image(&with.all_in_focus, &without.all_in_focus));
        }
}

TEST(models_without_a_net_are_as_before)
{
    const fixture *f = *state;
    for (int path = 0; path < PATHS; path++) {
        hada_plan_options options = options_of(path);
        SCOPED(hada_result) asked = run(f, f->plain, &options, &f->frame);
        options.enhance = 0;
        SCOPED(hada_result) left_out = run(f, f->model, &options, &f->frame);
        assert_int_equal(asked.report->enhanced, 0);
        assert_true(same_result(&asked, &left_out));
    }
}

TEST(black_planes_are_left_out)
{
    const fixture *f = *state;
    SCOPED(hada_image) black;
    hada_plan_options options = options_of(0);
    ASSERT_OK(hada_image_create(&black, CHANNELS, ROWS, COLS, err));
    options.skip = HADA_SKIP_ALL;
    hada_result skipped = run(f, f->model, &options, &black);
    assert_true(skipped.report->skipped->tiles == 1.0);
    assert_true(skipped.report->skipped->kinds & HADA_SKIP_TILES);
    for (size_t i = 0; i < hada_image_count(&skipped.planes[1]); i++)
        assert_true(skipped.planes[1].data[i] == 0.0f);
    options.skip = 0;
    hada_result dense = run(f, f->model, &options, &black);
    assert_true(dense.report->skipped->tiles == 0.0);
    assert_false(dense.report->skipped->kinds & HADA_SKIP_TILES);
    /* light: everything is computed either way */
    options.skip = HADA_SKIP_TILES;
    hada_result some = run(f, f->model, &options, &f->frame);
    options.skip = 0;
    hada_result all = run(f, f->model, &options, &f->frame);
    assert_true(same_result(&some, &all));
    hada_result *results[] = {&skipped, &dense, &some, &all};
    for (int i = 0; i < 4; i++)
        hada_result_destroy(results[i]);
}

/* Nothing is known of what a net makes of a small change, so there is none. */
TEST(only_what_is_exact_is_skipped_before_a_net)
{
    const fixture *f = *state;
    hada_plan_options options = options_of(0);
    SCOPED(hada_result) exact = run(f, f->model, &options, &f->frame);
    options.max_error = 0.5;
    SCOPED(hada_result) allowed = run(f, f->model, &options, &f->frame);
    assert_true(same_result(&exact, &allowed));
    assert_true(allowed.report->skipped->bound == 0.0);
}

/* Frames in flight on two queues, with helpers, give the same bits. */
TEST(queues_give_the_same)
{
    const fixture *f = *state;
    for (int path = 0; path < PATHS; path++) {
        hada_plan_options options = options_of(path);
        SCOPED(hada_result) one = run(f, f->model, &options, &f->frame);
        options.queues = 2;
        SCOPED(hada_result) two = run(f, f->model, &options, &f->frame);
        assert_true(same_result(&one, &two));
    }
}

FIXTURE(setup, teardown)
