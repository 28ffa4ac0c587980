/* Models that make no sense, whether made or read: each is refused in words that say what is wrong, and leaves nothing.
 */
#include <limits.h>

#include "io_testing.h"
#include "model/model.h"

static const double distances[] = {100.0, 200.0};

static hada_model_info info_of(void)
{
    hada_model_info info = io_model_info(2, distances);
    info.lambda = info.refine_rho = 0.01;
    info.refine_steps = 3;
    info.has_otf = 1;
    return info;
}

static void assert_refused(const hada_model_info *info, const char *word)
{
    hada_error error = {0};
    hada_model *model;
    assert_int_equal(hada_model_create(&model, info, 1, &error), HADA_ERROR_MODEL);
    assert_null(model);
    if (!strstr(error.message, word))
        fail_msg("no '%s' in '%s'", word, error.message);
}

#define REFUSED(member, value, word)                                                                                   \
    do {                                                                                                               \
        hada_model_info spoilt = info_of();                                                                            \
        spoilt.member = value;                                                                                         \
        assert_refused(&spoilt, word);                                                                                 \
    } while (0)

TEST(numbers_that_no_camera_has)
{
    static const double falling[] = {200.0, 100.0}, endless[] = {100.0, INFINITY}, behind[] = {-100.0, 100.0};
    REFUSED(depths, 0, "0 depths");
    REFUSED(depths, 4097, "4097 depths");
    REFUSED(channels, 0, "0 channels");
    REFUSED(channels, 65, "65 channels");
    REFUSED(form, (hada_form)0, "form or boundary");
    REFUSED(form, (hada_form)99, "form or boundary");
    REFUSED(boundary, (hada_boundary)0, "form or boundary");
    REFUSED(boundary, (hada_boundary)99, "form or boundary");
    const double wrong[] = {NAN, INFINITY, -1.5};
    for (int i = 0; i < 3; i++) {
        REFUSED(alpha, wrong[i], "not usable numbers");
        REFUSED(lambda, wrong[i], "not usable numbers");
        REFUSED(noise, wrong[i], "not usable numbers");
        REFUSED(refine_rho, wrong[i], "not usable numbers");
        REFUSED(refine_tv, wrong[i], "not usable numbers");
        REFUSED(refine_colour, wrong[i], "not usable numbers");
        REFUSED(refine_share, wrong[i], "share of refined planes");
        REFUSED(scene_response, wrong[i], "response of the model's scenes");
    }
    const double wild[] = {NAN, INFINITY, 1e30, -1e30};
    for (int i = 0; i < 4; i++)
        REFUSED(dark, wild[i], "not usable numbers");
    REFUSED(refine_rho, 1e6, "not usable numbers");
    REFUSED(refine_steps, -1, "not usable numbers");
    REFUSED(refine_steps, INT_MAX, "not usable numbers");
    REFUSED(lambda, 1e300, "not usable numbers");
    REFUSED(refine_colour, 0.5, "not usable numbers");
    REFUSED(refine_share, 1.5, "share of refined planes");
    REFUSED(distances_mm, falling, "must ascend");
    REFUSED(distances_mm, endless, "must ascend");
    REFUSED(distances_mm, behind, "must ascend");
    REFUSED(window_rows, 0, "do not fit");
    REFUSED(window_cols, -3, "do not fit");
    REFUSED(window_rows, 7, "do not fit");
    REFUSED(window_cols, 9, "do not fit");
    REFUSED(raw_rows, 7, "do not fit");
    REFUSED(raw_cols, 9, "do not fit");
    REFUSED(grid_rows, 1 << 20, "do not fit");
    REFUSED(grid_cols, 1 << 20, "do not fit");
    REFUSED(grid_rows, 7, "circular");
    REFUSED(grid_cols, 9, "circular");
}

TEST(sizes_that_cannot_be)
{
    static const struct {
        int raw[2], window[2];
        const char *word;
    } rows[] = {
        {{0, 8}, {1, 1}, "not possible"},     {{8, 0}, {1, 1}, "not possible"}, {{65537, 8}, {1, 1}, "not possible"},
        {{8, 65537}, {1, 1}, "not possible"}, {{8, 8}, {0, 4}, "does not fit"}, {{8, 8}, {4, 0}, "does not fit"},
        {{8, 8}, {-1, -1}, "does not fit"},   {{8, 8}, {9, 8}, "does not fit"}, {{8, 8}, {8, 9}, "does not fit"}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        hada_model_info info = info_of();
        ASSERT_FAILS(
            hada_model_set_sizes(&info, rows[i].raw[0], rows[i].raw[1], rows[i].window[0], rows[i].window[1], err),
            HADA_ERROR_SIZE, rows[i].word);
    }
    hada_model_info info = info_of();
    ASSERT_OK(hada_model_set_sizes(&info, 5, 7, 0, 0, err));
    assert_true(info.window_rows == 5 && info.window_cols == 7 && info.grid_rows == 5 && info.grid_cols == 7);
    info.boundary = HADA_BOUNDARY_PADDED;
    ASSERT_OK(hada_model_set_sizes(&info, 5, 7, 3, 3, err));
    assert_true(info.grid_rows >= 7 && info.grid_cols >= 9);
}

static hada_model *make(void)
{
    hada_model *model;
    const hada_model_info info = info_of();
    ASSERT_OK(hada_model_create(&model, &info, 1, err));
    for (size_t i = 0; i < 4 * hada_model_plane(model); i++) {
        model->filter[i] = 0.5f + (float)(i % 3);
        model->otf[i] = 1.0f + (float)(i % 5);
    }
    for (size_t i = 0; i < hada_model_plane(model); i++)
        model->scene_power[i] = 1.0f;
    model->noise_power[0] = model->noise_power[1] = 0.1;
    model->pairs[0] = model->pairs[1] = 3.0;
    return model;
}

TEST(forms_that_cannot_be_made)
{
    SCOPED(hada_model) *model = make();
    hada_model *out = model;
    ASSERT_FAILS(hada_model_with_form(&out, model, HADA_FORM_SPLIT, 0.0, err), HADA_ERROR_ARGUMENT, "");
    assert_null(out);
    const double wrong[] = {0.0, -1.0, NAN, INFINITY, 1e300};
    for (int i = 0; i < 5; i++)
        ASSERT_FAILS(hada_model_with_form(&out, model, HADA_FORM_WIENER, wrong[i], err), HADA_ERROR_ARGUMENT, "");
    /* a frequency that the camera loses has no filter, and an even width a Nyquist column, which counts once */
    model->otf[0] = model->otf[1] = 0.0f;
    ASSERT_OK(hada_model_with_form(&out, model, HADA_FORM_MATCHED, 0.0, err));
    assert_true(out->filter[0] == 0.0f && out->filter[1] == 0.0f && out->filter[2] == 0.0f);
    hada_model_destroy(&out);
    ASSERT_OK(hada_model_with_form(&out, model, HADA_FORM_WIENER, 0.5, err));
    assert_true(out->filter[0] == 0.0f && out->filter[2] > 0.0f && out->info.lambda == 0.5);
    hada_model_destroy(&out);
    free(model->otf);
    model->otf = NULL;
    ASSERT_FAILS(hada_model_with_form(&out, model, HADA_FORM_MATCHED, 0.0, err), HADA_ERROR_MODEL,
                 "no transfer functions");
    assert_true(hada_model_gain(model) == 1.0);
}

TEST(halves_that_lose_the_filter)
{
    hada_model *model = make(), *out = NULL, *again;
    ASSERT_OK(hada_model_to_half(&out, model, err));
    ASSERT_OK(hada_model_to_half(&again, out, err)); /* of a half the same half */
    assert_memory_equal(again->filter_half, out->filter_half, 4 * hada_model_plane(model) * sizeof(uint16_t));
    hada_model_destroy(&again);
    ASSERT_OK(hada_model_with_enhance(&again, out, NULL, 0, 0, err));
    assert_memory_equal(again->filter_half, out->filter_half, 4 * hada_model_plane(model) * sizeof(uint16_t));
    hada_model_destroy(&again);
    hada_model_destroy(&out);
    model->filter[3] = 1e6f;
    ASSERT_FAILS(hada_model_to_half(&out, model, err), HADA_ERROR_NUMERIC, "");
    assert_null(out);
    for (size_t i = 0; i < 4 * hada_model_plane(model); i++)
        model->filter[i] = 1e-8f;
    ASSERT_FAILS(hada_model_to_half(&out, model, err), HADA_ERROR_NUMERIC, "");
    assert_null(out);
    hada_model_destroy(&model);
    hada_model_destroy(&model);
    hada_model_destroy(NULL);
}

static hada_net *net_of(int in, int out)
{
    char list[200];
    hada_net *net;
    snprintf(list, sizeof list,
             "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": %d},"
             "{\"layer\": \"conv\", \"name\": \"a\", \"channels\": %d}]}",
             in, out);
    ASSERT_OK(hada_net_create(&net, list, 1, err));
    return net;
}

TEST(nets_that_do_not_fit)
{
    static const int channels[][3] = {{1, 1, 1}, {2, 1, 1}, {3, 1, 0}, {1, 2, 0}};
    static const int sizes[][3] = {{0, 0, 1},  {8, 8, 1},       {0, 8, 0},      {8, 0, 0},
                                   {-1, 8, 0}, {2 << 20, 8, 0}, {8, 2 << 20, 0}};
    SCOPED(hada_model) *model = make();
    hada_model *out;
    hada_error error = {0};
    for (int i = 0; i < 4; i++) {
        SCOPED(hada_net) *net = net_of(channels[i][0], channels[i][1]);
        assert_int_equal(hada_model_with_enhance(&out, model, net, 0, 0, &error),
                         channels[i][2] ? HADA_OK : HADA_ERROR_MODEL);
        assert_int_equal(out != NULL, channels[i][2]);
        hada_model_destroy(&out);
    }
    SCOPED(hada_net) *net = net_of(1, 1);
    for (int i = 0; i < 7; i++) {
        assert_int_equal(hada_model_with_enhance(&out, model, net, sizes[i][0], sizes[i][1], &error),
                         sizes[i][2] ? HADA_OK : HADA_ERROR_MODEL);
        hada_model_destroy(&out);
    }
}

/* The model's file with `from` replaced once by `to`, which is as long; NULL: it is read all the same. */
static void assert_file(const char *whole, const char *from, const char *to, const char *word)
{
    size_t bytes;
    hada_error error = {0};
    hada_model *model;
    unsigned char *data = io_read_bytes(whole, &bytes);
    unsigned char *at = memmem(data, bytes, from, strlen(from));
    if (!at || strlen(from) != strlen(to))
        fail_msg("no '%s' in the file, or '%s' is longer", from, to);
    memcpy(at, to, strlen(to));
    io_write_bytes(io_path("wrong.model"), data, bytes);
    free(data);
    const hada_status status = hada_model_load(&model, io_path("wrong.model"), &error);
    if (!word) {
        if (status)
            fail_msg("'%s' for '%s': %s", to, from, error.message);
        hada_model_destroy(&model);
        return;
    }
    if (status != HADA_ERROR_FILE_FORMAT && status != HADA_ERROR_MODEL)
        fail_msg("'%s' for '%s': %s '%s'", to, from, hada_status_name(status), error.message);
    assert_null(model);
    if (!strstr(error.message, word) || !strstr(error.message, "wrong.model"))
        fail_msg("no '%s' in '%s'", word, error.message);
}

TEST(files_that_lack_or_misstate)
{
    static const char *const rows[][3] = {
        {"\"hadalens-model\"", "\"hadalens-modex\"", "not a hadalens model"},
        {"\"format\"", "\"formax\"", "not a hadalens model"},
        {"\"version\":\"1\"", "\"version\":\"3\"", "version 3"},
        {"\"version\":\"1\"", "\"version\":\"2\"", "components is missing"},
        {"\"version\":\"1\"", "\"versiox\":\"1\"", "version is missing"},
        {"\"version\":\"1\"", "\"version\":\"x\"", "version is missing"},
        {"\"form\":", "\"forx\":", "form is missing"},
        {"\"complex\"", "\"complez\"", "form is missing"},
        {"\"boundary\":", "\"boundarx\":", "boundary is missing"},
        {"\"circular\"", "\"circulax\"", "boundary is missing"},
        {"\"raw\":", "\"rax\":", "raw is missing"},
        {"\"raw\":\"6x8\"", "\"raw\":\"6y8\"", "raw is missing"},
        {"\"raw\":\"6x8\"", "\"raw\":\"9x8\"", "do not fit"},
        {"\"grid\":", "\"grix\":", "grid is missing"},
        {"\"window\":", "\"windox\":", "window is missing"},
        {"\"window\":\"4x4\"", "\"window\":\"0x4\"", "do not fit"},
        {"\"alpha\":", "\"alphx\":", "alpha is missing"},
        {"\"lambda\":", "\"lambdx\":", "lambda is missing"},
        {"\"dark\":", "\"darx\":", "dark is missing"},
        {"\"noise\":", "\"noisx\":", "noise is missing"},
        {"\"refine_rho\":", "\"refine_rhx\":", "refine_rho is missing"},
        {"\"refine_steps\":\"3\"", "\"refine_stepx\":\"3\"", "refine_steps is missing"},
        {"\"refine_steps\":\"3\"", "\"refine_steps\":\"e\"", "refine_steps is missing"},
        {"\"refine_tv\":", "\"refine_tx\":", NULL},
        {"\"refine_share\":", "\"refine_sharx\":", NULL},
        {"\"refine_colour\":", "\"refine_coloux\":", NULL},
        {"\"scene_response\":\"linear\"", "\"scene_responsx\":\"linear\"", NULL},
        {"\"scene_response\":\"linear\"", "\"scene_response\":\"lineax\"", "scene_response is missing"},
        {"\"filter\":{", "\"filtex\":{", "filter"},
        {"\"distances_mm\":{", "\"distances_mx\":{", "distances_mm"},
        {"\"noise_power\":{", "\"noise_powex\":{", "noise_power"},
        {"\"pairs\":{", "\"pairx\":{", "pairs"},
        {"\"shape\":[2,1,6,5,2]", "\"shape\":[2,1,5,6,2]", "shape or type"},
        {"\"pairs\":{\"dtype\":\"F64\"", "\"pairs\":{\"dtype\":\"U64\"", "shape or type"},
    };
    char whole[300];
    hada_model *model = make();
    snprintf(whole, sizeof whole, "%s", io_path("whole.model"));
    ASSERT_OK(hada_model_save(model, whole, err));
    hada_model_destroy(&model);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        assert_file(whole, rows[i][0], rows[i][1], rows[i][2]);
}

FIXTURE(io_setup, io_teardown)
