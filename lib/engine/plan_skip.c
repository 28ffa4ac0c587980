/* What a plan knows of skipping before any frame comes. */
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "engine/skip.h"
#include "filter/hadamard.h"

static int same_dark(const hada_image *dark, int a, int b)
{
    const size_t pixels = (size_t)dark->rows * (size_t)dark->cols;
    return !dark->data ||
           !memcmp(dark->data + (size_t)a * pixels, dark->data + (size_t)b * pixels, pixels * sizeof *dark->data);
}

static int same_filter(const hada_model *model, const int *depths, int count, int a, int b)
{
    const size_t channels = (size_t)model->info.channels, plane = 2 * hada_model_plane(model);
    for (int i = 0; i < count; i++) {
        const size_t at = (size_t)depths[i] * channels * plane, from = at + (size_t)a * plane,
                     to = at + (size_t)b * plane;
        if (model->filter
                ? memcmp(model->filter + from, model->filter + to, plane * sizeof *model->filter)
                : memcmp(model->filter_half + from, model->filter_half + to, plane * sizeof *model->filter_half))
            return 0;
    }
    return 1;
}

static void find_same(hada_plan_skip *skip, const hada_model *model, const hada_plan_shape *shape, const int *depths,
                      const hada_image *dark)
{
    for (int c = 0; c < model->info.channels; c++) {
        skip->same_dark[c] = skip->same_filter[c] = c;
        for (int before = c - 1; before >= 0; before--) {
            if (same_dark(dark, before, c))
                skip->same_dark[c] = before;
            if (!shape->refined && same_filter(model, depths, shape->depths, before, c))
                skip->same_filter[c] = before;
        }
    }
    hada_model_forget(model);
}

static hada_status make_gains(hada_plan_skip *skip, const hada_context *context, const hada_model *model,
                              const hada_plan_shape *shape, const int *depths, const unsigned char *listed,
                              hada_error *err)
{
    const hada_spectrum_layout layout = hada_hadamard_layout(context, hada_model_get_info(model));
    int *counted, count = 0;
    hada_status status = hada_alloc((void **)&counted, (size_t)shape->depths, sizeof *counted, "a plan", err);
    if (status)
        return status;
    for (int z = 0; z < shape->depths; z++)
        if (listed[z])
            counted[count++] = depths[z];
    status = hada_gains_create(&skip->gains, model, &layout, counted, count, shape->half_by_error, err);
    free(counted);
    return status;
}

hada_status hada_plan_skip_make(hada_plan_skip *skip, const hada_context *context, const hada_model *model,
                                const hada_plan_shape *shape, const int *depths, const unsigned char *listed,
                                const hada_image *dark, hada_error *err)
{
    const size_t channels = (size_t)model->info.channels;
    hada_status status = hada_alloc((void **)&skip->same_dark, channels, sizeof(int), "a plan", err);
    if (!status)
        status = hada_alloc((void **)&skip->same_filter, channels, sizeof(int), "a plan", err);
    if (!status)
        find_same(skip, model, shape, depths, dark);
    if (!status && shape->measured)
        status = make_gains(skip, context, model, shape, depths, listed, err);
    return status;
}

void hada_plan_skip_free(hada_plan_skip *skip)
{
    hada_gains_destroy(&skip->gains);
    free(skip->same_dark);
    free(skip->same_filter);
}
