/* What training gives: a net, a model. */
#include <string.h>

#include "model/model.h"
#include "train/trainer.h"

hada_status hada_trainer_net(hada_trainer *trainer, hada_net **out, hada_error *err)
{
    hada_status status = HADA_OK;
    if (!trainer || !out)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_trainer_net: trainer and out are needed");
    *out = NULL;
    if (!trainer->nets.net)
        return hada_fail(err, HADA_ERROR_STATE, "this stage trains no net");
    HADA_TRY_OR_DONE(hada_net_copy(out, trainer->nets.net, err));
    HADA_TRY_OR_DONE(hada_workers_read(&trainer->workers, HADA_GROUP_NET, HADA_CONTENT_VALUES, (*out)->values, err));
done:
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
    const size_t plane = hada_model_plane(model), images = (size_t)info.depths * (size_t)info.channels;
    HADA_TRY(hada_model_create(out, &info, model->scene_power != NULL, err));
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
    HADA_TRY(copy_camera(out, trainer, err));
    for (int z = 0; z < trainer->info.depths; z++) {
        const size_t at = (size_t)z * (size_t)trainer->info.channels * hada_model_plane(trainer->model) * 2;
        HADA_TRY(hada_workers_read(&trainer->workers, HADA_GROUP_FILTERS + z, HADA_CONTENT_VALUES, (*out)->filter + at,
                                   err));
    }
    return HADA_OK;
}

hada_status hada_trainer_model(hada_trainer *trainer, hada_model **out, hada_error *err)
{
    hada_net *net = NULL;
    hada_model *filters = NULL;
    hada_status status = HADA_OK;
    if (!trainer || !out)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_trainer_model: trainer and out are needed");
    *out = NULL;
    const hada_train_options *options = &trainer->options;
    if (options->stage == HADA_STAGE_CONVENTIONAL)
        return hada_fail(err, HADA_ERROR_STATE, "the conventional net has no filters; take it with hada_trainer_net()");
    if (!hada_stage_has_planes(options->stage))
        HADA_TRY_OR_DONE(with_filters(&filters, trainer, err));
    if (trainer->nets.net) {
        HADA_TRY_OR_DONE(hada_trainer_net(trainer, &net, err));
        HADA_TRY_OR_DONE(hada_model_with_enhance(out, filters ? filters : trainer->model, net, options->net_rows,
                                                 options->net_cols, err));
    } else {
        *out = filters;
        filters = NULL;
    }
done:
    hada_model_destroy(&filters);
    hada_net_destroy(&net);
    return status;
}
