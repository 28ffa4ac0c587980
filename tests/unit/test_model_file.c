/* Model files: what is saved comes back bit for bit, and what is damaged or inconsistent is refused. */
#include "comma.h"
#include "io_testing.h"
#include "model/model.h"
#include "model_rewrite.h"

static const double distances[] = {100.0, 133.25, 600.0 / 7.0 * 3.0};

static hada_model *make(int statistics)
{
    hada_model_info info = {.depths = 3,
                            .channels = 2,
                            .form = HADA_FORM_SPLIT,
                            .boundary = HADA_BOUNDARY_PADDED,
                            .alpha = 0.1,
                            .lambda = 1.0 / 3.0,
                            .dark = 0.0625,
                            .noise = 1e-3,
                            .refine_steps = 12,
                            .refine_rho = 3e-3,
                            .refine_tv = 2e-3,
                            .refine_colour = statistics ? 1.5 : 0.0, /* not said: 1 */
                            .has_otf = 1,
                            .distances_mm = distances,
                            .refine_share = statistics ? 0.5 : 0.0, /* 0: not said, 1 */
                            .refine_noise = 0.04,
                            .refine_noise_largest = 0.01,
                            .scene_response = statistics ? HADA_RESPONSE_SRGB : 2.2};
    hada_model *model;
    hada_random random;
    ASSERT_OK(hada_model_set_sizes(&info, 10, 13, 4, 6, err));
    ASSERT_OK(hada_model_create(&model, &info, statistics, err));
    hada_random_seed(&random, 1, 1);
    for (size_t i = 0; i < hada_model_plane(model) * 12; i++) {
        model->filter[i] = (float)hada_random_normal(&random);
        model->otf[i] = (float)hada_random_normal(&random);
    }
    for (size_t i = 0; statistics && i < hada_model_plane(model); i++)
        model->scene_power[i] = (float)i;
    for (int i = 0; statistics && i < 6; i++)
        model->noise_power[i] = i + 0.1;
    for (int i = 0; statistics && i < 3; i++)
        model->pairs[i] = i + 5;
    return model;
}

TEST(files_come_back_bit_for_bit)
{
    char path[64];
    make_path(path);
    for (int k = 0; k < 4; k++) {
        SCOPED(hada_model) *model = make(k & 1);
        hada_model *back;
        if (k & 2) {
            hada_model *half;
            ASSERT_OK(hada_model_to_half(&half, model, err));
            hada_model_destroy(&model);
            model = half;
        }
        ASSERT_OK(hada_model_save(model, path, err));
        ASSERT_OK(hada_model_load(&back, path, err));
        const hada_model_info *a = &model->info, *b = hada_model_get_info(back);
        assert_true(b->depths == 3 && b->channels == 2 && b->form == a->form && b->boundary == a->boundary);
        assert_true(b->raw_rows == 10 && b->raw_cols == 13 && b->window_rows == 4 && b->window_cols == 6);
        assert_true(b->grid_rows == a->grid_rows && b->grid_cols == a->grid_cols);
        assert_true(b->alpha == a->alpha && b->lambda == a->lambda && b->dark == a->dark && b->noise == a->noise);
        assert_true(a->refine_colour >= 1.0 && b->refine_colour == a->refine_colour);
        assert_true(b->refine_steps == 12 && b->refine_rho == a->refine_rho && b->refine_tv == a->refine_tv &&
                    b->has_otf && b->half == a->half && b->scene_response == a->scene_response &&
                    b->refine_share == (k & 1 ? 0.5 : 1.0) && b->refine_noise == 0.04 &&
                    b->refine_noise_largest == 0.01);
        assert_memory_equal(b->distances_mm, distances, sizeof distances);
        assert_string_equal(b->name, path);
        assert_int_equal(b->bytes, a->bytes);
        const size_t values = hada_model_plane(model) * 12;
        if (a->half)
            assert_memory_equal(back->filter_half, model->filter_half, values * 2);
        else
            assert_memory_equal(back->filter, model->filter, values * 4);
        assert_memory_equal(back->otf, model->otf, values * 4);
        assert_int_equal(back->scene_power != NULL, k & 1);
        if (k & 1) {
            assert_memory_equal(back->scene_power, model->scene_power, hada_model_plane(model) * 4);
            assert_memory_equal(back->noise_power, model->noise_power, 6 * sizeof(double));
            assert_memory_equal(back->pairs, model->pairs, 3 * sizeof(double));
        }
        /* what was loaded can be saved again, to another place */
        char second[70];
        snprintf(second, sizeof second, "%s-2", path);
        ASSERT_OK(hada_model_save(back, second, err));
        unlink(second);
        hada_model_destroy(&back);
        assert_null(back);
    }
    unlink(path);
}

/* Rewrites a file with one piece of metadata or one tensor changed. */
static void rewrite(const char *path, const char *key, const char *value, const char *drop, int cut)
{
    char beside[80];
    snprintf(beside, sizeof beside, "%s-new", path);
    rewrite_model(path, beside, key, value, drop, cut);
    assert_int_equal(rename(beside, path), 0);
}

/* What test_model_refusals.c does not try: numbers out of range, tensors that are too short. */
TEST(damaged_files_are_refused)
{
    static const struct {
        const char *key, *value, *drop;
        int cut;
        hada_status status;
    } cases[] = {{"boundary", "circular", "", 0, HADA_ERROR_MODEL}, /* the grid is not the frame */
                 {"grid", "16x20", "", 0, HADA_ERROR_FILE_FORMAT},  /* not what the tensors have */
                 {"alpha", "-1", "", 0, HADA_ERROR_MODEL},
                 {"lambda", "nan", "", 0, HADA_ERROR_FILE_FORMAT},
                 {"dark", "0.1x", "", 0, HADA_ERROR_FILE_FORMAT},
                 {"refine_steps", "2.5", "", 0, HADA_ERROR_FILE_FORMAT},
                 {"refine_tv", "-1e-3", "", 0, HADA_ERROR_MODEL},
                 {"refine_tv", "much", "", 0, HADA_ERROR_FILE_FORMAT},
                 {"refine_colour", "0.5", "", 0, HADA_ERROR_MODEL},
                 {"refine_ridge", "-1", "", 0, HADA_ERROR_MODEL},
                 {"refine_colour", "red", "", 0, HADA_ERROR_FILE_FORMAT},
                 {"refine_share", "1.5", "", 0, HADA_ERROR_MODEL},
                 {"refine_noise", "-0.1", "", 0, HADA_ERROR_MODEL},
                 {"refine_share", "half", "", 0, HADA_ERROR_FILE_FORMAT},
                 {"scene_response", "bright", "", 0, HADA_ERROR_FILE_FORMAT},
                 {"scene_response", "auto", "", 0, HADA_ERROR_FILE_FORMAT},
                 {"", NULL, "otf", 1, HADA_ERROR_FILE_FORMAT},
                 {"", NULL, "filter", 1, HADA_ERROR_FILE_FORMAT},
                 {"", NULL, "scene_power", 1, HADA_ERROR_FILE_FORMAT}};
    char path[64];
    make_path(path);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        SCOPED(hada_model) *model = make(1);
        hada_model *back;
        hada_error error = {0};
        ASSERT_OK(hada_model_save(model, path, err));
        rewrite(path, cases[i].key, cases[i].value, cases[i].drop, cases[i].cut);
        const hada_status status = hada_model_load(&back, path, &error);
        if (status != cases[i].status)
            fail_msg("case %zu: status %d (%s), expected %d", i, status, error.message, cases[i].status);
        assert_null(back);
        assert_non_null(strstr(error.message, path)); /* the message names the file */
    }
    hada_model *back, *old = make(1);
    hada_error error;
    /* files of before knew no other scenes than linear ones */
    ASSERT_OK(hada_model_save(old, path, err));
    hada_model_destroy(&old);
    rewrite(path, "scene_response", NULL, "", 0);
    ASSERT_OK(hada_model_load(&back, path, err));
    assert_true(hada_model_get_info(back)->scene_response == HADA_RESPONSE_LINEAR);
    hada_model_destroy(&back);
    assert_int_equal(truncate(path, 300), 0);
    assert_int_not_equal(hada_model_load(&back, path, &error), HADA_OK);
    assert_int_equal(truncate(path, 0), 0);
    assert_int_not_equal(hada_model_load(&back, path, &error), HADA_OK);
    unlink(path);
    assert_int_equal(hada_model_load(&back, path, &error), HADA_ERROR_FILE_OPEN);
    SCOPED(hada_model) *model = make(0);
    assert_int_equal(hada_model_save(model, "/nonexistent/model", &error), HADA_ERROR_FILE_WRITE);
}

/* The first numbers of a tensor become another one, in the file; 0: all of them. */
static void poison(const char *path, const char *name, double value, size_t count)
{
    hada_tensors *file;
    ASSERT_OK(hada_tensors_open(&file, path, err));
    const hada_stored_tensor *last = hada_tensors_at(file, hada_tensors_count(file) - 1);
    const hada_stored_tensor *tensor = hada_tensors_find(file, name);
    const long back = (long)((const char *)last->data + last->bytes - (const char *)tensor->data);
    const float single = (float)value;
    FILE *out = fopen(path, "r+b");
    assert_non_null(out);
    assert_int_equal(fseek(out, -back, SEEK_END), 0);
    const int wide = tensor->type == HADA_F64;
    for (size_t i = 0; i < (count ? count : tensor->bytes / (wide ? 8 : 4)); i++)
        assert_int_equal(fwrite(wide ? (const void *)&value : (const void *)&single, wide ? 8 : 4, 1, out), 1);
    fclose(out);
    hada_tensors_close(&file);
}

TEST(numbers_without_a_picture_are_refused)
{
    static const struct {
        const char *name;
        double value;
        size_t count;     /* of numbers, from the first; 0: all */
        const char *word; /* of the message */
    } cases[] = {{"scene_power", (double)NAN, 1, "NaN"},
                 {"scene_power", -1, 1, "negative"},
                 {"scene_power", 0, 0, "nothing but 0"},
                 {"scene_power", 1e32, 1, "can be"},
                 {"noise_power", (double)INFINITY, 1, "infinite"},
                 {"noise_power", -1, 1, "negative"},
                 {"noise_power", 1e30, 1, "can be"},
                 {"pairs", -2, 1, "negative"},
                 {"pairs", (double)NAN, 1, "NaN"},
                 {"otf", (double)NAN, 1, "NaN"},
                 {"otf", 1e30, 1, "otf of depth 0 is 1e+30"},
                 {"otf", -1e30, 0, "otf of depth 0 is 1e+30"},
                 {"otf", 1e-30, 0, "otf of depth 0 is 1e-30"},
                 {"otf", 0, 0, "otf of depth 0 holds nothing but 0"},
                 {"filter", (double)INFINITY, 1, "infinite"},
                 {"filter", 1e30, 1, "filter of depth 0 is 1e+30"},
                 {"filter", 0, 0, "filter of depth 0 holds nothing but 0"}};
    char path[64];
    make_path(path);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        SCOPED(hada_model) *model = make(1);
        hada_model *back;
        hada_error error = {0};
        ASSERT_OK(hada_model_save(model, path, err));
        poison(path, cases[i].name, cases[i].value, cases[i].count);
        if (hada_model_load(&back, path, &error) != HADA_ERROR_MODEL || !strstr(error.message, cases[i].name) ||
            !strstr(error.message, cases[i].word))
            fail_msg("%s %g: %s", cases[i].name, cases[i].value, error.message);
        assert_null(back);
    }
    unlink(path);
}

/* A program that uses a locale with a decimal comma reads and writes the same files. */
TEST(numbers_do_not_depend_on_the_locale)
{
    if (!decimal_comma())
        skip();
    char path[64];
    make_path(path);
    hada_model *model = make(0), *back;
    ASSERT_OK(hada_model_save(model, path, err));
    assert_string_equal(localeconv()->decimal_point, ","); /* the program's locale is left alone */
    hada_tensors *file;
    ASSERT_OK(hada_tensors_open(&file, path, err));
    assert_string_equal(hada_tensors_meta(file, "alpha"), "0.10000000000000001");
    hada_tensors_close(&file);
    ASSERT_OK(hada_model_load(&back, path, err));
    assert_true(back->info.lambda == 1.0 / 3.0);
    setlocale(LC_NUMERIC, "C");
    hada_model_destroy(&back);
    hada_model_destroy(&model);
    unlink(path);
}

/* A camera that others have learned: filters and transfer functions go in, and come out as they were. */
TEST(arrays_make_a_model)
{
    SCOPED(hada_model) *model = make(0);
    hada_model *made, *half;
    DEFAULTS(hada_fit_options, sizes);
    sizes.depths = 3;
    sizes.channels = 2;
    sizes.distances_mm = distances;
    sizes.raw_rows = 10;
    sizes.raw_cols = 13;
    sizes.window_rows = 4;
    sizes.window_cols = 6;
    sizes.boundary = HADA_BOUNDARY_PADDED;
    sizes.form = HADA_FORM_SPLIT;
    const size_t bytes = hada_model_plane(model) * 12 * sizeof(float);
    ASSERT_OK(hada_model_from_filters(&made, &sizes, model->filter, model->otf, err));
    assert_memory_equal(made->filter, model->filter, bytes);
    assert_memory_equal(made->otf, model->otf, bytes);
    assert_null(made->filter_half);
    assert_int_equal(hada_model_get_info(made)->has_otf, 1);
    hada_model_destroy(&made);

    ASSERT_OK(hada_model_from_filters(&made, &sizes, model->filter, NULL, err));
    assert_null(made->otf);
    ASSERT_OK(hada_model_to_half(&half, made, err));
    assert_null(half->filter);
    assert_non_null(half->filter_half);
    hada_model_destroy(&half);
    hada_model_destroy(&made);

    model->otf[5] = NAN;
    ASSERT_FAILS(hada_model_from_filters(&made, &sizes, model->filter, model->otf, err), HADA_ERROR_NOT_FINITE, "");
    assert_null(made);
    ASSERT_FAILS(hada_model_from_filters(&made, NULL, NULL, NULL, err), HADA_ERROR_ARGUMENT, "");
}
