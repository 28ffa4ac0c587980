/* What training begins with: options and a model. */
#include "model_words.h"
#include "train_settings.h"

#include <hadalens/folder.h>
#include <hadalens/task_fit.h>
#include <math.h>
#include <string.h>

hada_stage hada_cli_train_stage(const hada_cli_train_settings *set)
{
    return set->stage ? (hada_stage)set->stage : HADA_STAGE_ENHANCE;
}

static void take_count(int given, int *value)
{
    if (given != HADA_CLI_COUNT_DEFAULT)
        *value = given;
}

static void take_steps(int given, uint64_t *value)
{
    if (given != HADA_CLI_COUNT_DEFAULT)
        *value = (uint64_t)given;
}

static void take_real(double given, double *value)
{
    if (!isnan(given))
        *value = given;
}

/* "compact", "paper", or a file with a net and its weights. */
static hada_status choose_net(const char *text, hada_train_options *options, hada_net **net, hada_error *err)
{
    if (!text)
        return HADA_OK;
    options->new_net = 1;
    if (!strcmp(text, "compact") || !strcmp(text, "paper")) {
        options->net = text;
        return HADA_OK;
    }
    if (!hada_path_is_file(text))
        return hada_cli_error(err, HADA_ERROR_FILE_OPEN,
                              "--net takes compact, paper or the file of a net; there is no file '%s'", text);
    hada_status status = hada_net_load(net, text, err);
    options->net_given = *net;
    return status;
}

static void take_losses(const hada_cli_train_settings *set, hada_train_options *options)
{
    take_real(set->mse, &options->mse);
    take_real(set->perceptual, &options->perceptual);
    take_real(set->adversarial, &options->adversarial);
    take_real(set->variation, &options->variation);
    options->variation_squared = set->variation_squared;
    options->vgg = set->vgg;
}

static void take_changes(const hada_cli_train_settings *set, hada_augment *augment)
{
    take_count(set->shift, &augment->shift);
    take_real(set->noise, &augment->noise);
    take_real(set->exposure, &augment->exposure);
    /* the words are none, left-right, top-bottom, both */
    if (set->flips)
        augment->flips = set->flips - 1;
    if (set->plane_flips)
        augment->plane_flips = set->plane_flips - 1;
}

static void take_rates(const hada_cli_train_settings *set, hada_train_options *options)
{
    take_real(set->rate, &options->rate);
    take_real(set->filter_rate, &options->filter_rate);
    take_real(set->critic_rate, &options->critic_rate);
    take_real(set->last_rate, &options->last_rate);
    take_real(set->clip, &options->clip);
    take_real(set->decay, &options->weight_decay);
    if (set->rule)
        options->rule = (hada_rule)(set->rule - 1);
    if (set->schedule)
        options->schedule = (hada_rate)(set->schedule - 1);
    take_steps(set->period, &options->rate_period);
    take_steps(set->warmup, &options->warmup);
}

hada_status hada_cli_train_options(hada_cli *cli, const hada_cli_train_settings *set, const hada_cli_train_data *data,
                                   hada_train_options *options, hada_augment *augment, hada_net **net, hada_error *err)
{
    static const char *const critics[] = {"patch", "conditional", "paper"};
    const hada_stage stage = hada_cli_train_stage(set);
    hada_train_options_init(options, stage);
    options->seed = set->seed;
    options->form = (hada_form)set->form; /* the words are complex, split */
    options->random_start = stage == HADA_STAGE_FILTERS && (set->random || !set->model);
    options->net_rows = set->net_size[0];
    options->net_cols = set->net_size[1];
    if (set->at_once)
        options->at_once = set->at_once;
    options->recompute = set->recompute;
    if (set->critic)
        options->critic = critics[set->critic - 1];
    take_count(set->batch, &options->batch);
    take_steps(set->critic_steps, &options->critic_steps);
    take_rates(set, options);
    take_losses(set, options);
    hada_augment_init(augment);
    take_changes(set, augment);
    options->augment = augment;
    if (set->steps != HADA_CLI_COUNT_DEFAULT)
        options->steps = (uint64_t)set->steps;
    if (set->epochs != HADA_CLI_COUNT_DEFAULT && options->batch > 0)
        options->steps =
            ((uint64_t)set->epochs * (uint64_t)data->learned + (uint64_t)options->batch - 1) / (uint64_t)options->batch;
    if (!set->vgg && stage != HADA_STAGE_FILTERS && options->perceptual > 0)
        hada_cli_say(cli, "The perceptual loss is off: it needs the weights of VGG-16 (--vgg FILE).");
    return choose_net(set->net, options, net, err);
}

/* Distances must be those of the model: a depth's number means the same in both. */
static hada_status check_depths(const hada_model *model, const char *path, const hada_dataset_info *data,
                                hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    int same = info->depths == data->depths;
    for (int z = 0; same && z < info->depths; z++)
        same = fabs(info->distances_mm[z] - data->distances_mm[z]) <= 1e-6 * info->distances_mm[z];
    return same ? HADA_OK
                : hada_cli_error(err, HADA_ERROR_MODEL,
                                 "%s knows %d depths from %g to %g mm, the data set holds %d from %g to %g mm; they "
                                 "must be the same",
                                 path, info->depths, info->distances_mm[0], info->distances_mm[info->depths - 1],
                                 data->depths, data->distances_mm[0], data->distances_mm[data->depths - 1]);
}

/* The exact fit of what is not held out; filters are trained anyway, so they are not judged in the window. */
static hada_status fit_first(hada_cli *cli, hada_fit_options *fit, const hada_cli_train_data *data, int boundary,
                             hada_context *context, hada_model **model, hada_error *err)
{
    hada_fit_task task;
    hada_cli_say(cli, "No model is given (-m): the exact fit of the %d pairs to learn from comes first.",
                 data->learned);
    hada_fit_task_init(&task);
    fit->outside = 1;
    task.fit = fit;
    task.boundary = boundary;
    task.monitor = &cli->monitor;
    return hada_fit_run(model, NULL, context, data->learn, &task, err);
}

hada_status hada_cli_train_model(hada_cli *cli, const hada_cli_train_settings *set, const hada_cli_train_data *data,
                                 hada_context *context, hada_model **model, hada_error *err)
{
    const hada_stage stage = hada_cli_train_stage(set);
    hada_fit_options fit;
    hada_status status = HADA_OK;
    if (set->model) {
        HADA_TRY(hada_model_load(model, set->model, err));
        return check_depths(*model, set->model, hada_dataset_get_info(data->all), err);
    }
    hada_fit_options_init(&fit);
    if (set->form)
        fit.form = (hada_form)set->form;
    fit.window_rows = set->window[0];
    fit.window_cols = set->window[1];
    HADA_TRY(hada_cli_read_dark_level(&fit.dark, set->dark ? set->dark : "none", err));
    if (stage != HADA_STAGE_FILTERS && stage != HADA_STAGE_CONVENTIONAL)
        return fit_first(cli, &fit, data, set->boundary, context, model, err);
    HADA_TRY(hada_fit_options_from_dataset(&fit, data->all, set->boundary, &cli->monitor, err));
    HADA_TRY(hada_model_blank(model, &fit, err));
done:
    return status;
}
