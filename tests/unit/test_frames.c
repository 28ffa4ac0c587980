/* Frames as people have them, and results in arrays of theirs. */
#include "core/numbers.h"
#include "learned_camera.h"

enum { MARGIN = 3 }; /* samples round each row and frame that belong to somebody else */

/* A frame of 16 bits, as its file is read, and as the numbers in the file. */
typedef struct digital {
    hada_image frame;
    uint16_t *numbers; /* planar */
} digital;

static digital digitise(const hada_image *frame)
{
    digital out;
    char path[] = "/tmp/hadalens_frames_XXXXXX";
    const size_t count = hada_image_count(frame);
    const int file = mkstemp(path);
    assert_true(file >= 0);
    close(file);
    DEFAULTS(hada_tiff_write_options, options);
    options.bits = 16;
    ASSERT_OK(hada_tiff_save(path, frame, &options, err));
    ASSERT_OK(hada_tiff_load(path, 0, &out.frame, err));
    unlink(path);
    out.numbers = malloc(count * sizeof *out.numbers);
    assert_non_null(out.numbers);
    for (size_t i = 0; i < count; i++)
        out.numbers[i] = (uint16_t)lrintf(out.frame.data[i] * 65535.0f);
    return out;
}

static void free_digital(digital *d)
{
    hada_image_destroy(&d->frame);
    free(d->numbers);
}

/* 8 and 16 bits, floats; planar, interleaved, upside down, with room between rows: the floats of the TIFF path. */
TEST(every_number_is_as_in_a_file)
{
    SCOPED(hada_image) image;
    static uint16_t words[65536];
    static uint8_t bytes[256];
    DEFAULTS(hada_pixels, pixels);
    for (int i = 0; i < 65536; i++)
        words[i] = (uint16_t)i;
    for (int i = 0; i < 256; i++)
        bytes[i] = (uint8_t)i;
    hada_pixels_planar(&pixels, words, HADA_PIXEL_U16, 1, 256, 256);
    ASSERT_OK(hada_pixels_to_image(&pixels, &image, err));
    for (int i = 0; i < 65536; i++)
        assert_true(image.data[i] == (float)(i / 65535.0));
    hada_image_destroy(&image);
    pixels.full_scale = 4095;
    ASSERT_OK(hada_pixels_to_image(&pixels, &image, err));
    assert_true(image.data[4095] == 1.0f && image.data[1] == (float)(1 / 4095.0));
    hada_image_destroy(&image);
    hada_pixels_init(&pixels);
    hada_pixels_interleaved(&pixels, bytes, HADA_PIXEL_U8, 4, 8, 8);
    ASSERT_OK(hada_pixels_to_image(&pixels, &image, err));
    for (int channel = 0; channel < 4; channel++)
        for (int i = 0; i < 64; i++)
            assert_true(image.data[channel * 64 + i] == (float)((4 * i + channel) / 255.0));
    hada_image_destroy(&image);
    /* from the last row to the first, from right to left */
    pixels.data = bytes + 255 - 3;
    pixels.row_stride = -pixels.row_stride;
    pixels.col_stride = -pixels.col_stride;
    ASSERT_OK(hada_pixels_to_image(&pixels, &image, err));
    assert_true(image.data[0] == (float)(252 / 255.0) && image.data[64 + 63] == (float)(1 / 255.0));
}

TEST(what_cannot_be_pixels_is_refused)
{
    float values[4] = {0};
    hada_image image;
    for (int kind = 0; kind < 11; kind++) {
        DEFAULTS(hada_pixels, pixels);
        hada_pixels_planar(&pixels, values, HADA_PIXEL_F32, 1, 2, 2);
        switch (kind) {
        case 0: pixels.data = NULL; break;
        case 1: pixels.type = (hada_pixel_type)9; break;
        case 2: pixels.rows = 0; break;
        case 3: pixels.full_scale = 0; break;
        case 4: pixels.col_stride = 3; break;
        case 5: pixels.data = (const char *)values + 1; break;
        case 6: pixels.size = 0; break;
        case 7: pixels.row_stride = 0; break;
        case 8: pixels.row_stride = -4; break;
        case 9: pixels.row_stride = PTRDIFF_MAX - 3; break;
        case 10: pixels.row_stride = PTRDIFF_MIN; break;
        }
        ASSERT_FAILS(hada_pixels_to_image(&pixels, &image, err), HADA_ERROR_ARGUMENT, "");
        assert_null(image.data);
    }
}

TEST(a_plan_takes_them_as_they_are)
{
    const learned_camera *learned = *state;
    SCOPED(hada_image) scene = learned_scene(learned, 40);
    SCOPED(hada_image) raw = learned_frame(learned, &(hada_plane){2, &scene}, 1, 40);
    digital d = digitise(&raw);
    const int rows = raw.rows, cols = raw.cols, wide = cols + 2 * MARGIN;
    SCOPED_MEMORY uint16_t *apart = malloc((size_t)(rows + 2 * MARGIN) * (size_t)wide * sizeof *apart);
    hada_plan *plan;
    hada_result file = {0}, view = {0};
    hada_job *job;
    memset(apart, 0xa5, (size_t)(rows + 2 * MARGIN) * (size_t)wide * sizeof *apart);
    for (int r = 0; r < rows; r++)
        memcpy(apart + (r + MARGIN) * wide + MARGIN, d.numbers + r * cols, (size_t)cols * sizeof *apart);
    DEFAULTS(hada_plan_options, options);
    options.skip = 0;
    ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, &options, err));
    ASSERT_OK(hada_plan_run(plan, &d.frame, &file, err));
    DEFAULTS(hada_pixels, pixels);
    hada_pixels_planar(&pixels, apart + MARGIN * wide + MARGIN, HADA_PIXEL_U16, 1, rows, cols);
    pixels.row_stride = wide * (ptrdiff_t)sizeof *apart;
    ASSERT_OK(hada_plan_run_pixels(plan, &pixels, &view, err));
    assert_true(same_result(&file, &view));
    hada_result_destroy(&view);
    ASSERT_OK(hada_job_submit_pixels(&job, plan, &pixels, &view, err));
    ASSERT_OK(hada_job_wait(job, err));
    hada_job_destroy(&job);
    assert_true(same_result(&file, &view));
    /* floats in place */
    hada_pixels_of_image(&pixels, &d.frame);
    ASSERT_OK(hada_plan_run_pixels(plan, &pixels, &view, err));
    assert_true(same_result(&file, &view));
    pixels.rows--;
    assert_int_equal(hada_plan_run_pixels(plan, &pixels, &view, NULL), HADA_ERROR_MODEL);
    assert_true(same_result(&file, &view)); /* as it was */
    hada_result_destroy(&file);
    hada_result_destroy(&view);
    hada_plan_destroy(&plan);
    free_digital(&d);
}

TEST(results_go_into_the_callers_arrays)
{
    const learned_camera *learned = *state;
    const hada_model_info *info = hada_model_get_info(learned->model);
    const size_t map = (size_t)info->window_rows * (size_t)info->window_cols;
    const size_t plane = map * (size_t)info->channels, stack = plane * (size_t)info->depths;
    SCOPED(hada_image) scene = learned_scene(learned, 41);
    SCOPED(hada_image) raw = learned_frame(learned, &(hada_plane){1, &scene}, 1, 41);
    SCOPED(hada_plan) * plan;
    hada_result own = {0}, into = {0};
    ASSERT_OK(hada_plan_create(&plan, learned->context, learned->model, NULL, err));
    ASSERT_OK(hada_plan_run(plan, &raw, &own, err));
    for (int z = 1; z < own.depths; z++)
        assert_ptr_equal(own.planes[z].data, own.planes[0].data + (size_t)z * plane); /* one stack */
    SCOPED_MEMORY float *values = malloc((stack + plane + map) * sizeof *values);
    DEFAULTS(hada_result_arrays, arrays);
    arrays.stack = values;
    arrays.stack_count = stack;
    arrays.distance_map = values + stack;
    arrays.distance_map_count = map - 1;
    ASSERT_OK(hada_result_use(&into, &arrays, err));
    ASSERT_FAILS(hada_plan_run(plan, &raw, &into, err), HADA_ERROR_SIZE, "distance map");
    arrays.distance_map_count = map;
    arrays.all_in_focus = values + stack - 1;
    arrays.all_in_focus_count = plane;
    ASSERT_FAILS(hada_result_use(&into, &arrays, err), HADA_ERROR_ARGUMENT, "share memory");
    arrays.all_in_focus = NULL;
    ASSERT_OK(hada_result_use(&into, &arrays, err));
    const hada_image inside = {raw.channels, raw.rows, raw.cols, values + stack};
    ASSERT_FAILS(hada_plan_run(plan, &inside, &into, err), HADA_ERROR_ARGUMENT, "share memory");
    for (int again = 0; again < 2; again++) {
        for (size_t i = 0; i < stack + map; i++)
            values[i] = -1.0f;
        ASSERT_OK(hada_plan_run(plan, &raw, &into, err));
        assert_true(same_result(&own, &into));
        assert_memory_equal(values, own.planes[0].data, stack * sizeof *values);
        assert_memory_equal(values + stack, own.distance_map.data, map * sizeof *values);
        assert_ptr_equal(into.planes[0].data, values);
    }
    /* a failure empties the result, which keeps to its arrays */
    raw.data[0] = NAN;
    assert_int_equal(hada_plan_run(plan, &raw, &into, NULL), HADA_ERROR_NOT_FINITE);
    assert_true(into.depths == 0 && !into.report && !into.planes);
    raw.data[0] = 0.0f;
    ASSERT_OK(hada_plan_run(plan, &raw, &into, err));
    assert_ptr_equal(into.planes[0].data, values);
    assert_true(into.all_in_focus.data != NULL);
    hada_result_destroy(&into);
    values[0] = values[stack + map - 1]; /* still the caller's */
    hada_result_destroy(&own);
}

TEST(values_that_are_not_finite_are_counted)
{
    static const float broken[] = {NAN, INFINITY, -INFINITY};
    enum { MOST = 3000 };
    float values[MOST] = {0.0f}, largest;
    for (size_t count = 0; count <= MOST; count = count < 40 ? count + 1 : count + 37) {
        float most = 0.0f;
        size_t found = 0;
        for (size_t i = 0; i < count; i++) {
            values[i] = (float)((i * 7919 + count) % 1000) * (i % 2 ? -0.5f : 0.25f);
            if ((i + count) % 1013 == 5) /* few, so that most blocks have none */
                values[i] = broken[found++ % 3];
            else
                most = fmaxf(most, fabsf(values[i]));
        }
        assert_int_equal(hada_not_finite(values, count, &largest), found);
        assert_true(largest == most);
    }
}

FIXTURE(learned_setup, learned_teardown)
