#include "engine/setup.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "filter/hadamard.h"

static int is_in(const int *list, int count, int depth)
{
    for (int i = 0; i < count; i++)
        if (list[i] == depth)
            return 1;
    return 0;
}

static hada_status make_lists(hada_setup *setup, const hada_plan_options *options, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(setup->model);
    const size_t depths = (size_t)setup->config.depths;
    HADA_TRY(hada_allocated(setup->depths = hada_alloc(depths, sizeof(int), "a plan", err)));
    HADA_TRY(hada_allocated(setup->distances = hada_alloc(depths, sizeof(double), "a plan", err)));
    HADA_TRY(hada_allocated(setup->listed = hada_alloc(depths, 1, "a plan", err)));
    int found = 0;
    for (int i = 0; i < setup->config.depths; i++) {
        setup->depths[i] = options->depths ? options->depths[i] : i;
        setup->distances[i] = info->distances_mm[setup->depths[i]];
        setup->listed[i] = options->occupied != HADA_OCCUPIED_LIST ||
                           is_in(options->occupied_list, options->occupied_count, setup->depths[i]);
        found += setup->listed[i];
    }
    if (!found)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "none of the occupied depths is among the depths to compute"));
    return HADA_OK;
}

/* The listed depths as indices into the model; to be freed. */
static hada_status list_depths(const hada_setup *setup, int **list, int *count, hada_error *err)
{
    *count = 0;
    HADA_TRY(hada_allocated(*list = hada_alloc((size_t)setup->config.depths, sizeof **list, "a plan", err)));
    for (int z = 0; z < setup->config.depths; z++)
        if (setup->listed[z])
            (*list)[(*count)++] = setup->depths[z];
    return HADA_OK;
}

static hada_status make_camera(hada_setup *setup, hada_error *err)
{
    int *list = NULL, count;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(list_depths(setup, &list, &count, err));
    HADA_TRY_OR_DONE(hada_classic_camera_of(&setup->camera, setup->model, list, count, err));
done:
    free(list);
    return status;
}

static hada_status copy_dark(hada_setup *setup, const hada_image *dark, hada_error *err)
{
    const size_t broken = hada_image_count_not_finite(dark);
    HADA_TRY(hada_image_create(&setup->dark_frame, dark->channels, dark->rows, dark->cols, err));
    memcpy(setup->dark_frame.data, dark->data, hada_image_count(dark) * sizeof(float));
    if (broken)
        HADA_TRY(hada_fail(err, HADA_ERROR_NOT_FINITE, "the dark frame holds %zu values that are not finite", broken));
    return HADA_OK;
}

static int is_dark_same(const hada_image *dark, int a, int b)
{
    const size_t pixels = (size_t)dark->rows * (size_t)dark->cols;
    return !dark->data ||
           !memcmp(dark->data + (size_t)a * pixels, dark->data + (size_t)b * pixels, pixels * sizeof *dark->data);
}

static int is_filter_same(const hada_setup *setup, int a, int b)
{
    const hada_model *model = setup->model;
    const size_t channels = (size_t)model->info.channels, plane = 2 * hada_model_plane(model);
    for (int i = 0; i < setup->config.depths; i++) {
        const size_t at = (size_t)setup->depths[i] * channels * plane, from = at + (size_t)a * plane,
                     to = at + (size_t)b * plane;
        if (model->filter
                ? memcmp(model->filter + from, model->filter + to, plane * sizeof *model->filter)
                : memcmp(model->filter_half + from, model->filter_half + to, plane * sizeof *model->filter_half))
            return 0;
    }
    return 1;
}

static hada_status find_same_channels(hada_setup *setup, hada_error *err)
{
    const size_t channels = (size_t)setup->model->info.channels;
    HADA_TRY(hada_allocated(setup->same_dark = hada_alloc(channels, sizeof(int), "a plan", err)));
    HADA_TRY(hada_allocated(setup->same_filter = hada_alloc(channels, sizeof(int), "a plan", err)));
    for (int c = 0; c < setup->model->info.channels; c++) {
        setup->same_dark[c] = setup->same_filter[c] = c;
        for (int before = c - 1; before >= 0; before--) {
            if (is_dark_same(&setup->dark_frame, before, c))
                setup->same_dark[c] = before;
            if (!setup->config.joint && is_filter_same(setup, before, c))
                setup->same_filter[c] = before;
        }
    }
    return HADA_OK;
}

static hada_status make_gains(hada_setup *setup, const hada_context *context, hada_error *err)
{
    const hada_spectrum_layout layout = hada_hadamard_layout(context, hada_model_get_info(setup->model));
    int *list = NULL, count;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(list_depths(setup, &list, &count, err));
    HADA_TRY_OR_DONE(
        hada_gains_create(&setup->gains, setup->model, &layout, list, count, setup->config.half_by_error, err));
done:
    free(list);
    return status;
}

hada_status hada_setup_make(hada_setup *setup, hada_context *context, const hada_model *model,
                            const hada_plan_options *options, hada_error *err)
{
    *setup = (hada_setup){.model = model, .options = *options};
    setup->options.depths = setup->options.occupied_list = NULL;
    setup->options.dark_frame = NULL;
    setup->options.classic = NULL;
    HADA_TRY(hada_config_of(model, options, &setup->config, err));
    if (setup->config.joint && !setup->config.classic && setup->config.weights.tv > 0 && options->refine_tv < 0)
        setup->noise_share = hada_model_noise_share(model);
    HADA_TRY(make_lists(setup, options, err));
    if (setup->config.classic)
        HADA_TRY(make_camera(setup, err));
    HADA_TRY(hada_config_fit_grid(&setup->config, context, model, setup->depths, err));
    if (setup->config.dark)
        HADA_TRY(copy_dark(setup, options->dark_frame, err));
    HADA_TRY(find_same_channels(setup, err));
    if (setup->config.measured)
        HADA_TRY(make_gains(setup, context, err));
    return HADA_OK;
}

void hada_setup_free(hada_setup *setup)
{
    hada_gains_destroy(&setup->gains);
    free(setup->same_dark);
    free(setup->same_filter);
    hada_image_destroy(&setup->dark_frame);
    hada_classic_camera_free(&setup->camera);
    free(setup->depths);
    free(setup->distances);
    free(setup->listed);
    *setup = (hada_setup){0};
}
