/* Models with a net for enhancement: copies and files. */
#include "io_testing.h"

#include "model/model.h"
#include "model_rewrite.h"
#include "netlist/net_list.h"

static const double distances[] = {100.0, 200.0};

static hada_model *make_model(void)
{
    hada_model_info info = {.depths = 2,
                            .channels = 2,
                            .form = HADA_FORM_COMPLEX,
                            .boundary = HADA_BOUNDARY_CIRCULAR,
                            .has_otf = 1,
                            .distances_mm = distances};
    hada_model *model;
    hada_random random;
    ASSERT_OK(hada_model_set_sizes(&info, 10, 12, 6, 8, err));
    ASSERT_OK(hada_model_create(&model, &info, 1, err));
    hada_random_seed(&random, 1, 1);
    for (size_t i = 0; i < hada_model_plane(model) * 8; i++) {
        model->filter[i] = (float)hada_random_normal(&random);
        model->otf[i] = (float)hada_random_normal(&random);
    }
    for (size_t i = 0; i < hada_model_plane(model); i++)
        model->scene_power[i] = 1.0f;
    return model;
}

static hada_net *make_net(int channels)
{
    hada_net *net;
    DEFAULTS(hada_unet_options, options);
    options.channels = options.out_channels = channels;
    options.down = "4|5";
    options.up = "6";
    options.shared = options.last_norm = 1;
    ASSERT_OK(hada_net_create_unet(&net, &options, 2, err));
    return net;
}

static void expect_same_net(const hada_model *model, const hada_net *net, int rows, int cols)
{
    const hada_model_info *info = hada_model_get_info(model);
    const hada_net *own = hada_model_get_enhance(model);
    assert_true(info->enhance);
    assert_int_equal(info->enhance_rows, rows);
    assert_int_equal(info->enhance_cols, cols);
    assert_non_null(own);
    assert_ptr_not_equal(own, net);
    assert_int_equal(own->floats, net->floats);
    assert_memory_equal(own->values, net->values, net->floats * sizeof(float));
    assert_int_equal(own->count, net->count);
    for (int i = 0; i < net->count; i++)
        assert_memory_equal(&own->layers[i], &net->layers[i], sizeof(hada_layer));
}

TEST(the_net_goes_with_files_and_copies)
{
    char path[64];
    make_path(path);
    for (int sized = 0; sized < 2; sized++) {
        hada_model *model = make_model(), *with, *back, *half, *fixed, *without;
        SCOPED(hada_net) *net = make_net(2);
        const int rows = sized ? 16 : 0, cols = sized ? 20 : 0;
        ASSERT_OK(hada_model_with_enhance(&with, model, net, rows, cols, err));
        expect_same_net(with, net, rows, cols);
        assert_memory_equal(with->filter, model->filter, hada_model_plane(model) * 8 * sizeof(float));
        assert_null(hada_model_get_enhance(model));
        assert_false(hada_model_get_info(model)->enhance);
        ASSERT_OK(hada_model_save(with, path, err));
        ASSERT_OK(hada_model_load(&back, path, err));
        expect_same_net(back, net, rows, cols);
        ASSERT_OK(hada_model_to_half(&half, back, err));
        expect_same_net(half, net, rows, cols);
        ASSERT_OK(hada_model_save(half, path, err));
        hada_model_destroy(&back);
        ASSERT_OK(hada_model_load(&back, path, err));
        expect_same_net(back, net, rows, cols);
        ASSERT_OK(hada_model_with_form(&fixed, with, HADA_FORM_MATCHED, 0, err));
        assert_null(hada_model_get_enhance(fixed));
        assert_false(hada_model_get_info(fixed)->enhance);
        ASSERT_OK(hada_model_with_enhance(&without, back, NULL, 0, 0, err));
        assert_null(hada_model_get_enhance(without));
        assert_memory_equal(without->filter_half, half->filter_half, hada_model_plane(model) * 8 * 2);
        hada_model *all[] = {model, with, back, half, fixed, without};
        for (size_t i = 0; i < sizeof all / sizeof *all; i++)
            hada_model_destroy(&all[i]);
    }
    remove(path);
}

TEST(nets_that_do_not_fit_are_refused)
{
    SCOPED(hada_model) *model = make_model();
    hada_model *with;
    SCOPED(hada_net) *net = make_net(3);
    ASSERT_FAILS(hada_model_with_enhance(&with, model, net, 0, 0, err), HADA_ERROR_MODEL, "3 channel");
    assert_null(with);
    hada_net_destroy(&net);
    net = make_net(2);
    ASSERT_FAILS(hada_model_with_enhance(&with, model, net, 16, 0, err), HADA_ERROR_MODEL, "");
}

TEST(damaged_files_are_refused)
{
    char good[64], bad[64];
    make_path(good);
    make_path(bad);
    hada_model *model = make_model(), *with, *back;
    hada_net *net = make_net(2);
    hada_error error = {0};
    ASSERT_OK(hada_model_with_enhance(&with, model, net, 16, 20, err));
    ASSERT_OK(hada_model_save(with, good, err));
    rewrite_model(good, bad, "", NULL, "", 0);
    ASSERT_OK(hada_model_load(&back, bad, err));
    expect_same_net(back, net, 16, 20);
    hada_model_destroy(&back);
    rewrite_model(good, bad, "enhance", NULL, "", 0); /* tensors that no description names */
    ASSERT_OK(hada_model_load(&back, bad, err));
    assert_null(hada_model_get_enhance(back));
    hada_model_destroy(&back);
    rewrite_model(good, bad, "enhance_size", "16", "", 0);
    assert_int_equal(hada_model_load(&back, bad, &error), HADA_ERROR_FILE_FORMAT);
    rewrite_model(good, bad, "enhance_size", "0x4", "", 0);
    assert_int_equal(hada_model_load(&back, bad, &error), HADA_ERROR_MODEL);
    rewrite_model(good, bad, "enhance", "{}", "", 0);
    assert_int_equal(hada_model_load(&back, bad, &error), HADA_ERROR_MODEL);
    rewrite_model(good, bad, "", NULL, "enhance.up.0.0.bias", 0);
    assert_int_equal(hada_model_load(&back, bad, &error), HADA_ERROR_MODEL);
    assert_non_null(strstr(error.message, "enhance.up.0.0.bias"));
    assert_non_null(strstr(error.message, bad));
    assert_null(back);
    hada_model_destroy(&model);
    hada_model_destroy(&with);
    hada_net_destroy(&net);
    remove(good);
    remove(bad);
}
