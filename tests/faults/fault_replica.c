/* Training: a step of everything that a replica can do, a step of filters alone, a plane to train with. */
#include "fault_job.h"
#include "train/examples.h"
#include "train/replica.h"

/* A net, a discriminator, and a stand-in for VGG, for one channel of the window. */
typedef struct nets {
    hada_net *net, *discriminator, *vgg;
} nets;

static hada_status make_nets(nets *all, hada_error *err)
{
    static const char net[] = "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 1},"
                              "{\"layer\": \"conv\", \"name\": \"a\", \"channels\": 4, \"activation\": \"relu\"},"
                              "{\"layer\": \"norm\", \"name\": \"n\"},"
                              "{\"layer\": \"conv\", \"name\": \"b\", \"channels\": 1}]}";
    static const char discriminator[] =
        "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 1},"
        "{\"layer\": \"pool\"}, {\"layer\": \"linear\", \"name\": \"a\", \"in\": 49, \"channels\": 1}]}";
    static const char vgg[] = "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 3},"
                              "{\"layer\": \"conv\", \"name\": \"a\", \"channels\": 2, \"activation\": \"relu\"}]}";
    HADA_TRY(hada_net_create(&all->net, net, 1, err));
    HADA_TRY(hada_net_create(&all->discriminator, discriminator, 1, err));
    return hada_net_create(&all->vgg, vgg, 1, err);
}

/* Forward, backward, norm, an update of everything, and a look. */
static hada_status step(fault_job *job, hada_replica *replica, hada_stage stage, hada_error *err)
{
    static const unsigned char touched[JOB_DEPTHS] = {1, 1};
    hada_image(*inputs)[JOB_PAIRS] = stage == HADA_STAGE_FILTERS ? job->frame : job->scene; /* planes are as scenes */
    const hada_sample samples[2] = {{0, &inputs[0][0], &job->scene[0][0], 1, 0.0},
                                    {1, &inputs[1][0], &job->scene[1][0], 2, 0.5}};
    hada_terms terms;
    SCOPED(hada_image) before = {0}, after = {0};
    double norms[2];
    hada_status status = HADA_OK;
    hada_parameters_clear(hada_replica_parameters(replica));
    if (!status)
        status = hada_replica_backward(replica, samples, 2, 0.5, 1, 0, &terms, NULL, err);
    if (!status)
        status = hada_parameters_norm(hada_replica_parameters(replica), touched, &norms[0], &norms[1], err);
    for (int group = 0; !status && group < hada_replica_parameters(replica)->count; group++)
        if (hada_parameters_floats(hada_replica_parameters(replica), group, HADA_CONTENT_VALUES))
            status = hada_parameters_update(hada_replica_parameters(replica), group, 1, 1e-3, 0.5, err);
    if (!status)
        status = hada_replica_forward(replica, &samples[1], &before, &after, err);
    if (!status) {
        fault_add_image(job, &before);
        fault_add_image(job, &after);
    }
    return status;
}

static hada_status copy_filters(hada_replica *replica, fault_job *job, hada_error *err)
{
    const size_t count =
        hada_parameters_floats(hada_replica_parameters(replica), HADA_GROUP_FILTERS, HADA_CONTENT_VALUES);
    hada_image values;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(&values, 1, 1, (int)count, err));
    HADA_TRY_OR_DONE(hada_parameters_read(hada_replica_parameters(replica), HADA_GROUP_FILTERS, HADA_CONTENT_VALUES,
                                          values.data, err));
    HADA_TRY_OR_DONE(hada_parameters_write(hada_replica_parameters(replica), HADA_GROUP_FILTERS + 1,
                                           HADA_CONTENT_VALUES, values.data, err));
    fault_add(job, values.data, count * sizeof(float));
done:
    hada_image_destroy(&values);
    return status;
}

static hada_status train(fault_job *job, hada_slot *slot, hada_stage stage, const nets *all, hada_error *err)
{
    const hada_train_options options = {.size = sizeof options,
                                        .stage = stage,
                                        .random_start = stage == HADA_STAGE_FILTERS,
                                        .net_rows = 10,
                                        .net_cols = 12,
                                        .mse = 1.0,
                                        .perceptual = 0.1,
                                        .adversarial = 0.1,
                                        .variation = 1e-4};
    const hada_replica_desc desc = {.model = job->model,
                                    .options = &options,
                                    .net = all->net,
                                    .discriminator = all->discriminator,
                                    .vgg = all->vgg,
                                    .at_once = 2,
                                    .scenes = 2,
                                    .feature_bytes = 1 << 20};
    hada_replica *replica;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_replica_create(&replica, slot, &desc, err));
    HADA_TRY_OR_DONE(step(job, replica, stage, err));
    if (stage == HADA_STAGE_FILTERS)
        HADA_TRY_OR_DONE(copy_filters(replica, job, err));
done:
    hada_replica_destroy(&replica);
    return status;
}

static hada_status make_plane(fault_job *job, hada_slot *slot, hada_error *err)
{
    static const hada_composed as_captured = {0};
    SCOPED(hada_planes) *planes = NULL;
    SCOPED(hada_image) plane = {0};
    HADA_TRY(hada_planes_create(&planes, slot, job->model, 0, 0, err));
    HADA_TRY(hada_planes_make(planes, 1, &job->frame[1][1], &as_captured, &plane, err));
    fault_add_image(job, &plane);
    return HADA_OK;
}

hada_status fault_stage_training_step(fault_job *job, hada_error *err)
{
    hada_slot *slot = NULL;
    nets all = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_slot_create(&slot, job->context, err));
    HADA_TRY_OR_DONE(make_nets(&all, err));
    HADA_TRY_OR_DONE(train(job, slot, HADA_STAGE_ADVERSARIAL, &all, err));
    HADA_TRY_OR_DONE(train(job, slot, HADA_STAGE_FILTERS, &all, err));
    HADA_TRY_OR_DONE(make_plane(job, slot, err));
done:
    hada_net_destroy(&all.net);
    hada_net_destroy(&all.discriminator);
    hada_net_destroy(&all.vgg);
    hada_slot_destroy(&slot);
    return status;
}
