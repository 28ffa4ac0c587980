#include "train/train_nets.h"

#include "core/error.h"
#include "netlist/presets.h"
#include "train/identity.h"
#include "train/train_options.h"

/* The net that the caller gives, the model's own, or a new one. */
static hada_status begin_net(hada_net **out, const hada_train_options *options, const hada_model *model,
                             hada_error *err)
{
    const int channels = hada_model_get_info(model)->channels;
    hada_status status = HADA_OK;
    if (options->net_given)
        return hada_net_copy(out, options->net_given, err);
    if (!options->new_net)
        return hada_net_copy(out, hada_model_get_enhance(model), err);
    HADA_TRY(hada_net_create_preset(out, options->net, channels, options->seed, err));
    /* Training then begins at the planes as they are, not at noise. */
    if (options->stage != HADA_STAGE_CONVENTIONAL)
        hada_net_start_as_identity(*out);
done:
    return status;
}

static hada_status make_net(hada_net **out, const hada_train_options *options, const hada_model *model, hada_error *err)
{
    const int channels = hada_model_get_info(model)->channels;
    hada_net_info net;
    hada_status status = HADA_OK;
    HADA_TRY(begin_net(out, options, model, err));
    hada_net_get_info(*out, &net);
    if (net.channels != channels || net.out_channels != channels)
        return hada_fail(err, HADA_ERROR_MODEL, "the net takes %d channel(s) and gives %d; the camera has %d",
                         net.channels, net.out_channels, channels);
done:
    return status;
}

/* The discriminator that the options name. */
static hada_status make_critic(hada_net **out, const hada_train_options *options, int channels, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(hada_discriminator_make(out, options->critic, channels, err));
    HADA_TRY(hada_net_init(*out, options->seed, err));
done:
    return status;
}

static hada_status load_vgg(hada_net **out, const hada_train_options *options, int channels, hada_error *err)
{
    if (channels != 1 && channels != 3)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "VGG-16 looks at grey or at red, green and blue; this camera has %d channels: leave the "
                         "perceptual term out",
                         channels);
    return hada_vgg16_load(out, options->vgg, err);
}

hada_status hada_train_nets_make(hada_train_nets *nets, const hada_train_options *options, const hada_model *model,
                                 hada_error *err)
{
    const int channels = hada_model_get_info(model)->channels;
    hada_status status = HADA_OK;
    *nets = (hada_train_nets){0};
    if (hada_stage_has_net(options->stage))
        HADA_TRY(make_net(&nets->net, options, model, err));
    if (hada_stage_has_critic(options))
        HADA_TRY(make_critic(&nets->critic, options, channels, err));
    if (options->perceptual > 0.0)
        HADA_TRY(load_vgg(&nets->vgg, options, channels, err));
done:
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
