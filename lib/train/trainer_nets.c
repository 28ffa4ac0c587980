/* The nets of a stage, and what training gives: a net, a model. */
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/options.h"
#include "model/model.h"
#include "netlist/presets.h"
#include "train/identity.h"
#include "train/trainer.h"

static hada_status make_net(hada_net **out, const hada_train_options *options, const hada_model *model, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    hada_net_info net;
    hada_status status;
    if (options->net_given)
        status = hada_net_copy(out, options->net_given, err);
    else if (!options->new_net)
        status = hada_net_copy(out, hada_model_get_enhance(model), err);
    else
        status = hada_net_create_preset(out, options->net, info->channels, options->seed, err);
    /* Training then begins at the planes as they are, not at noise. */
    if (!status && !options->net_given && options->new_net && options->stage != HADA_STAGE_CONVENTIONAL)
        hada_net_start_as_identity(*out);
    if (status)
        return status;
    hada_net_get_info(*out, &net);
    if (net.channels != info->channels || net.out_channels != info->channels)
        status = hada_fail(err, HADA_ERROR_MODEL, "the net takes %d channel(s) and gives %d; the camera has %d",
                           net.channels, net.out_channels, info->channels);
    return status;
}

static hada_status make_critic(hada_net **out, const hada_train_options *options, int channels, hada_error *err)
{
    hada_status status = hada_discriminator_make(out, options->critic, channels, err);
    return status ? status : hada_net_init(*out, options->seed, err);
}

hada_status hada_train_nets_make(hada_train_nets *nets, const hada_train_options *options, const hada_model *model,
                                 hada_error *err)
{
    const int channels = hada_model_get_info(model)->channels;
    hada_status status = HADA_OK;
    *nets = (hada_train_nets){0};
    if (hada_stage_has_net(options->stage))
        status = make_net(&nets->net, options, model, err);
    if (!status && hada_stage_has_critic(options))
        status = make_critic(&nets->critic, options, channels, err);
    if (!status && options->perceptual > 0.0) {
        if (channels != 1 && channels != 3)
            status = hada_fail(err, HADA_ERROR_ARGUMENT,
                               "VGG-16 looks at grey or at red, green and blue; this camera has %d channels: leave "
                               "the perceptual term out",
                               channels);
        else
            status = hada_vgg16_load(&nets->vgg, options->vgg, err);
    }
    if (status)
        hada_train_nets_free(nets);
    return status;
}

void hada_train_nets_free(hada_train_nets *nets)
{
    hada_net_destroy(&nets->net);
    hada_net_destroy(&nets->critic);
    hada_net_destroy(&nets->vgg);
}

hada_status hada_trainer_net(hada_trainer *trainer, hada_net **out, hada_error *err)
{
    if (!trainer || !out)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_trainer_net: trainer and out are needed");
    *out = NULL;
    if (!trainer->net)
        return hada_fail(err, HADA_ERROR_STATE, "this stage trains no net");
    hada_status status = hada_net_copy(out, trainer->net, err);
    if (!status)
        status = hada_engine_read(trainer->workers->engine, HADA_GROUP_NET, HADA_CONTENT_VALUES, (*out)->values, err);
    if (status)
        hada_net_destroy(out);
    return status;
}

/* A copy of the model without its filters and net. */
static hada_status copy_camera(hada_model **out, const hada_trainer *trainer, hada_error *err)
{
    const hada_model *model = trainer->model;
    hada_model_info info = trainer->info;
    info.form = trainer->options.form;
    info.half = 0;
    info.enhance = info.enhance_rows = info.enhance_cols = 0;
    info.refine_steps = 0;
    hada_status status = hada_model_create(out, &info, model->scene_power != NULL, err);
    if (status)
        return status;
    const size_t plane = hada_model_plane(model), images = (size_t)info.depths * (size_t)info.channels;
    if (model->otf)
        memcpy((*out)->otf, model->otf, images * plane * 2 * sizeof *model->otf);
    if (model->scene_power) {
        memcpy((*out)->scene_power, model->scene_power, plane * sizeof *model->scene_power);
        memcpy((*out)->noise_power, model->noise_power, images * sizeof *model->noise_power);
        memcpy((*out)->pairs, model->pairs, (size_t)info.depths * sizeof *model->pairs);
    }
    return HADA_OK;
}

static hada_status with_filters(hada_model **out, hada_trainer *trainer, hada_error *err)
{
    hada_status status = copy_camera(out, trainer, err);
    for (int z = 0; !status && z < trainer->info.depths; z++) {
        const size_t at = (size_t)z * (size_t)trainer->info.channels * hada_model_plane(trainer->model) * 2;
        status = hada_engine_read(trainer->workers->engine, HADA_GROUP_FILTERS + z, HADA_CONTENT_VALUES,
                                  (*out)->filter + at, err);
    }
    return status;
}

hada_status hada_trainer_model(hada_trainer *trainer, hada_model **out, hada_error *err)
{
    hada_net *net = NULL;
    hada_model *filters = NULL;
    if (!trainer || !out)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_trainer_model: trainer and out are needed");
    *out = NULL;
    const hada_train_options *options = &trainer->options;
    if (options->stage == HADA_STAGE_CONVENTIONAL)
        return hada_fail(err, HADA_ERROR_STATE, "the conventional net has no filters; take it with hada_trainer_net()");
    hada_status status = HADA_OK;
    if (!hada_stage_has_planes(options->stage))
        status = with_filters(&filters, trainer, err);
    if (!status && trainer->net) {
        status = hada_trainer_net(trainer, &net, err);
        if (!status)
            status = hada_model_with_enhance(out, filters ? filters : trainer->model, net, options->net_rows,
                                             options->net_cols, err);
    } else if (!status) {
        *out = filters;
        filters = NULL;
    }
    hada_model_destroy(&filters);
    hada_net_destroy(&net);
    return status;
}

hada_status hada_model_blank(hada_model **out, const hada_fit_options *callers, hada_error *err)
{
    hada_model_info info = {0};
    hada_fit_options own, *sizes = &own;
    if (!out || !callers)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_model_blank: out and sizes are needed");
    *out = NULL;
    hada_fit_options_init(sizes);
    hada_status status = HADA_OPTIONS_TAKE(sizes, callers, hada_fit_options, err);
    if (status)
        return status;
    info.depths = sizes->depths;
    info.channels = sizes->channels;
    info.distances_mm = sizes->distances_mm;
    info.form = sizes->form;
    info.boundary = sizes->boundary;
    info.dark = sizes->dark;
    status = hada_model_set_sizes(&info, sizes->raw_rows, sizes->raw_cols, sizes->window_rows, sizes->window_cols, err);
    if (!status)
        status = hada_model_info_check(&info, err);
    return status ? status : hada_model_create(out, &info, 0, err);
}
