/* The net of a model, which enhances refocused planes: giving, copying, and its place in model files. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/error.h"
#include "model/model.h"
#include "model/model_enhance.h"

#define PREFIX    "enhance."
#define META      "enhance"
#define META_SIZE "enhance_size"

hada_status hada_model_own_enhance(hada_model *model, hada_net *net, int rows, int cols, hada_error *err)
{
    hada_net_info info;
    hada_net_destroy(&model->enhance);
    model->enhance = net;
    model->info.enhance = 1;
    model->info.enhance_rows = rows;
    model->info.enhance_cols = cols;
    hada_net_get_info(net, &info);
    if (info.channels != model->info.channels || info.out_channels != model->info.channels)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the net takes images of %d channel(s) and gives %d; the model's planes have %d",
                         info.channels, info.out_channels, model->info.channels);
    if ((rows || cols) && (rows < 1 || cols < 1 || rows > 1 << 20 || cols > 1 << 20))
        return hada_fail(err, HADA_ERROR_MODEL, "the net's size %d x %d is none", rows, cols);
    return HADA_OK;
}

hada_status hada_model_copy_enhance(hada_model *copy, const hada_model *model, hada_error *err)
{
    hada_net *net;
    if (!model->enhance)
        return HADA_OK;
    hada_status status = hada_net_copy(&net, model->enhance, err);
    return status ? status : hada_model_own_enhance(copy, net, model->info.enhance_rows, model->info.enhance_cols, err);
}

static void copy_arrays(hada_model *copy, const hada_model *model)
{
    const hada_model_info *info = &model->info;
    const size_t plane = hada_model_plane(model), images = (size_t)info->depths * (size_t)info->channels;
    const size_t values = images * plane * 2;
    if (model->filter)
        memcpy(copy->filter, model->filter, values * sizeof *copy->filter);
    if (model->filter_half)
        memcpy(copy->filter_half, model->filter_half, values * sizeof *copy->filter_half);
    if (model->otf)
        memcpy(copy->otf, model->otf, values * sizeof *copy->otf);
    if (model->scene_power) {
        memcpy(copy->scene_power, model->scene_power, plane * sizeof *copy->scene_power);
        memcpy(copy->noise_power, model->noise_power, images * sizeof *copy->noise_power);
        memcpy(copy->pairs, model->pairs, (size_t)info->depths * sizeof *copy->pairs);
    }
}

hada_status hada_model_with_enhance(hada_model **out, const hada_model *model, const hada_net *net, int rows, int cols,
                                    hada_error *err)
{
    hada_net *own = NULL;
    if (!out || !model)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_model_with_enhance: out and model are needed");
    hada_status status = hada_model_create(out, &model->info, model->scene_power != NULL, err);
    if (!status)
        copy_arrays(*out, model);
    if (!status && net) {
        status = hada_net_copy(&own, net, err);
        if (!status)
            status = hada_model_own_enhance(*out, own, rows, cols, err);
    }
    if (status)
        hada_model_destroy(out);
    return status;
}

const hada_net *hada_model_get_enhance(const hada_model *model)
{
    return model->enhance;
}

hada_status hada_model_declare_enhance(const hada_model *model, hada_tensors_writer *writer, hada_error *err)
{
    char *description, size[40];
    if (!model->enhance)
        return HADA_OK;
    hada_status status = hada_net_describe(model->enhance, &description, err);
    if (status)
        return status;
    status = hada_tensors_put_meta(writer, META, description, err);
    free(description);
    snprintf(size, sizeof size, "%dx%d", model->info.enhance_rows, model->info.enhance_cols);
    if (!status && model->info.enhance_rows)
        status = hada_tensors_put_meta(writer, META_SIZE, size, err);
    return status ? status : hada_net_declare(model->enhance, writer, PREFIX, err);
}

hada_status hada_model_write_enhance(const hada_model *model, hada_tensors_writer *writer, hada_error *err)
{
    return model->enhance ? hada_net_write(model->enhance, writer, err) : HADA_OK;
}

hada_status hada_model_read_enhance(hada_model *model, const hada_tensors *file, hada_error *err)
{
    const char *description = hada_tensors_meta(file, META), *size = hada_tensors_meta(file, META_SIZE);
    int rows = 0, cols = 0;
    hada_net *net;
    char extra;
    if (!description)
        return HADA_OK;
    if (size && (strlen(size) > 15 || sscanf(size, "%dx%d%c", &rows, &cols, &extra) != 2))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "the metadata " META_SIZE " are not usable");
    hada_status status = hada_net_from_file(&net, description, file, PREFIX, err);
    return status ? status : hada_model_own_enhance(model, net, rows, cols, err);
}
