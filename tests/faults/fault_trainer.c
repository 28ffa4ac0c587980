/* Training as a whole: pairs read ahead, steps on a device, validation, a checkpoint and back, the trained model. */
#include "fault_job.h"

static hada_status copy(hada_image *out, const hada_image *image, hada_error *err)
{
    HADA_TRY(hada_image_create(out, image->channels, image->rows, image->cols, err));
    memcpy(out->data, image->data, hada_image_count(image) * sizeof(float));
    return HADA_OK;
}

static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    const fault_job *job = user;
    HADA_TRY(copy(raw, &job->frame[depth][pair], err));
    return copy(scene, &job->scene[depth][pair], err);
}

static hada_status use(fault_job *job, hada_trainer *trainer, const char *path, hada_error *err)
{
    hada_step_report report = {.size = sizeof report};
    hada_validation result = {.size = sizeof result};
    SCOPED(hada_model) *model = NULL;
    SCOPED(hada_image) raw = {0}, before = {0}, after = {0}, truth = {0};
    HADA_TRY(hada_trainer_step(trainer, &report, err));
    HADA_TRY(hada_trainer_save(trainer, path, err));
    HADA_TRY(hada_trainer_step(trainer, &report, err));
    HADA_TRY(hada_trainer_load(trainer, path, err));
    HADA_TRY(hada_trainer_step(trainer, &report, err));
    HADA_TRY(hada_trainer_validate(trainer, 0, &result, err));
    HADA_TRY(hada_trainer_show(trainer, 1, &raw, &before, &after, &truth, err));
    HADA_TRY(hada_trainer_model(trainer, &model, err));
    const double known[] = {report.loss, report.norm, result.psnr, result.mae, result.sharpness};
    fault_add(job, known, sizeof known);
    return HADA_OK;
}

static hada_status train(fault_job *job, hada_context *const *contexts, int count, hada_stage stage,
                         const hada_net *net, const char *path, hada_error *err)
{
    static const int counts[JOB_DEPTHS] = {JOB_PAIRS, JOB_PAIRS};
    static const double distances[JOB_DEPTHS] = {100.0, 200.0};
    SCOPED(hada_dataset) *pairs = NULL;
    hada_train_options options;
    SCOPED(hada_trainer) *trainer = NULL;
    hada_train_options_init(&options, stage);
    options.net_given = net;
    options.compose = stage == HADA_STAGE_FILTERS ? 0.0 : 0.5;
    options.batch = count == 1 ? 2 : 3;
    DEFAULTS(hada_augment, augment);
    augment.noise = stage == HADA_STAGE_FILTERS ? 0.01 : 0.0;
    options.augment = &augment;
    HADA_TRY(hada_dataset_create(&pairs, JOB_DEPTHS, distances, counts, read_pair, job, NULL, err));
    HADA_TRY(hada_trainer_create(&trainer, contexts, count, job->model, pairs, pairs, &options, err));
    return use(job, trainer, path, err);
}

static hada_status train_both(fault_job *job, hada_context *const *contexts, int count, hada_error *err)
{
    SCOPED(hada_net) *net = NULL;
    char path[160];
    snprintf(path, sizeof path, "%s/training.model", job->folder);
    DEFAULTS(hada_unet_options, unet);
    unet.channels = unet.out_channels = 1;
    unet.down = "4|4";
    unet.up = "4";
    unet.last_norm = count > 1; /* statistics, which devices average */
    HADA_TRY(hada_net_create_unet(&net, &unet, 1, err));
    HADA_TRY(train(job, contexts, count, HADA_STAGE_ENHANCE, net, path, err));
    return train(job, contexts, count, HADA_STAGE_FILTERS, net, path, err);
}

hada_status fault_stage_trainer(fault_job *job, hada_error *err)
{
    return train_both(job, &job->context, 1, err);
}

/* Gradients and values go between two devices. */
hada_status fault_stage_devices(fault_job *job, hada_error *err)
{
    hada_context *contexts[2] = {job->context, job->part};
    return train_both(job, contexts, 2, err);
}
