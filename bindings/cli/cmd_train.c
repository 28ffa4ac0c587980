#include "command.h"
#include "folder.h"
#include "train_settings.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>

typedef hada_cli_train_settings settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("What to train"),
    {HADA_OPTION_TEXT, "model", 'm', "MODEL", "the model to begin with ('hadalens fit' or an earlier stage made it)",
     "Without it the exact fit comes first; filters then start at random.", AT(model)},
    {HADA_OPTION_TEXT, "output", 'o', "MODEL2", "the model file to write: at each new best, and at the end",
     "Stage conventional: the file of a net.", AT(output)},
    {HADA_OPTION_CHOICE, "stage", 0, "filters|enhance|adversarial|joint|conventional",
     "which part is trained (default: enhance)",
     "filters: the filters alone, by gradients. enhance: a net behind the filters, which stay. adversarial: the same "
     "against a discriminator. joint: net and filters together. conventional: a net from raw frame to image, without "
     "filters, to compare.",
     AT(stage)},
    {HADA_OPTION_TEXT, "net", 0, "compact|paper|FILE", "a new net instead of the model's (default: compact)",
     "compact starts by giving planes back as they are. FILE: a net with its weights.", AT(net)},
    {HADA_OPTION_SIZE, "net-size", 0, "HxW", "pixels at which the net runs (default: the window's)", NULL,
     AT(net_size)},
    {HADA_OPTION_CHOICE, "critic", 0, "patch|conditional|paper",
     "the discriminator of adversarial training (default: patch)",
     "patch: judges patches of 25 x 25 pixels. conditional: the same, beside the plane before the net. paper: the "
     "whole image, at 256 x 256.",
     AT(critic)},
    {HADA_OPTION_FLAG, "random", 0, NULL, "filters: start at random, not from the model's", NULL, AT(random)},
    {HADA_OPTION_CHOICE, "form", 0, "complex|split", "filters without a model: how they act on a frame's spectrum",
     NULL, AT(form)},

    HADA_CLI_GROUP("Pairs"),
    {HADA_OPTION_TEXT, "hold-out", 0, "N|SHARE", "pairs of each depth to validate with (default: an eighth)",
     "The last ones of each folder. A model that was fitted to them as well makes them look easier than they are.",
     AT(hold_out)},
    {HADA_OPTION_COUNT, "shift", 0, "PIXELS", "move frame and scene together by up to so many pixels",
     "Circular boundary only.", AT(shift)},
    {HADA_OPTION_CHOICE, "flips", 0, "none|left-right|top-bottom|both", "flip frame and scene together",
     "For optics that are symmetric in this way only.", AT(flips)},
    {HADA_OPTION_CHOICE, "plane-flips", 0, "none|left-right|top-bottom|both",
     "enhance, adversarial: flip the plane behind the filters and the scene (default: both)", NULL, AT(plane_flips)},
    {HADA_OPTION_REAL, "noise", 0, "SHARE", "add Gaussian noise, as a share of the frame's maximum", NULL, AT(noise)},
    {HADA_OPTION_REAL, "exposure", 0, "SHARE", "scale pairs by a factor from 1 - SHARE to 1 + SHARE", NULL,
     AT(exposure)},
    {HADA_OPTION_CHOICE, "boundary", 0, "circular|padded", "without a model: as for 'hadalens fit'", NULL,
     AT(boundary)},
    {HADA_OPTION_SIZE, "window", 0, "HxW", "without a model: field of view, as for 'hadalens fit'", NULL, AT(window)},
    {HADA_OPTION_TEXT, "dark", 0, "FILE|auto|none|LEVEL", "without a model: dark level, as for 'hadalens fit'", NULL,
     AT(dark)},
    {HADA_OPTION_FLAG, "skip-incomplete", 0, NULL, "leave out files that have no partner, instead of refusing", NULL,
     AT(skip_incomplete)},

    HADA_CLI_GROUP("Steps"),
    {HADA_OPTION_COUNT, "steps", 0, "N", "steps of the whole training (default: 1000; adversarial: 300)", NULL,
     AT(steps)},
    {HADA_OPTION_COUNT, "epochs", 0, "N", "instead: how often every pair is seen", NULL, AT(epochs)},
    {HADA_OPTION_COUNT, "batch", 0, "N", "pairs of a step (default: 4)", NULL, AT(batch)},
    {HADA_OPTION_COUNT, "at-once", 0, "N", "pairs computed together; fewer need less memory (default: as many as fit)",
     "Gradients of a step add up, so that the result hardly changes.", AT(at_once)},
    {HADA_OPTION_FLAG, "recompute", 0, NULL, "less memory still: compute what backward needs a second time", NULL,
     AT(recompute)},
    {HADA_OPTION_CHOICE, "rule", 0, "rmsprop|adam|adamw", "how gradients change parameters (default: adam)",
     "rmsprop is the paper's.", AT(rule)},
    {HADA_OPTION_REAL, "rate", 0, "R", "learning rate of the net", NULL, AT(rate)},
    {HADA_OPTION_REAL, "filter-rate", 0, "R", "of the filters", NULL, AT(filter_rate)},
    {HADA_OPTION_REAL, "critic-rate", 0, "R", "of the discriminator", NULL, AT(critic_rate)},
    {HADA_OPTION_CHOICE, "schedule", 0, "constant|step|cosine", "how rates change (default: cosine)", NULL,
     AT(schedule)},
    {HADA_OPTION_REAL, "last-rate", 0, "SHARE", "cosine: the rates at the end; step: the factor of each change", NULL,
     AT(last_rate)},
    {HADA_OPTION_COUNT, "period", 0, "N", "step: how many steps lie between two changes", NULL, AT(period)},
    {HADA_OPTION_COUNT, "warmup", 0, "N", "steps in which rates rise from a tenth", NULL, AT(warmup)},
    {HADA_OPTION_REAL, "clip", 0, "NORM", "largest norm of a step's gradient; 0: any", NULL, AT(clip)},
    {HADA_OPTION_REAL, "decay", 0, "W", "weight decay of adamw", NULL, AT(decay)},
    {HADA_OPTION_COUNT, "critic-steps", 0, "N", "first steps, of the discriminator alone", NULL, AT(critic_steps)},
    {HADA_OPTION_SEED, "seed", 0, "N", "first weights, order and changes of pairs (default: 1)", NULL, AT(seed)},

    HADA_CLI_GROUP("Weights of the losses (default: 1.5, 0.1, 0.008, 5e-7, the paper's)"),
    {HADA_OPTION_REAL, "mse", 0, "W", "mean squared error", NULL, AT(mse)},
    {HADA_OPTION_REAL, "perceptual", 0, "W", "difference of VGG-16's features (needs --vgg)", NULL, AT(perceptual)},
    {HADA_OPTION_REAL, "adversarial", 0, "W", "what the discriminator says (joint: 0 by default)", NULL,
     AT(adversarial)},
    {HADA_OPTION_REAL, "tv", 0, "W", "total variation", NULL, AT(variation)},
    {HADA_OPTION_FLAG, "tv-squared", 0, NULL, "squares in the total variation, as the paper has it", NULL,
     AT(variation_squared)},
    {HADA_OPTION_TEXT, "vgg", 0, "FILE", "weights of VGG-16 (safetensors, names as torchvision's)", NULL, AT(vgg)},

    HADA_CLI_GROUP("On the way"),
    {HADA_OPTION_TEXT, "log", 0, "FOLDER", "for log, figure, pictures, checkpoint (default: MODEL2.log)", NULL,
     AT(log)},
    {HADA_OPTION_FLAG, "resume", 0, NULL, "go on from the checkpoint in the log folder",
     "Give what the training began with; rates, losses and the number of steps may differ.", AT(resume)},
    {HADA_OPTION_FLAG, "restart", 0, NULL, "begin anew where the log folder holds a checkpoint", NULL, AT(restart)},
    {HADA_OPTION_COUNT, "validate-every", 0, "N", "steps between validations (default: a twentieth of all); 0: none",
     NULL, AT(validate_every)},
    {HADA_OPTION_COUNT, "validate-pairs", 0, "N", "pairs to validate with, evenly chosen (default: 24); 0: all", NULL,
     AT(validate_most)},
    {HADA_OPTION_COUNT, "show-every", 0, "N", "steps between pictures (default: a quarter of all); 0: none", NULL,
     AT(show_every)},
    {HADA_OPTION_COUNT, "save-every", 0, "N", "steps between checkpoints (default: a twentieth of all)", NULL,
     AT(save_every)},
    {HADA_OPTION_COUNT, "patience", 0, "N", "end after so many validations without a better one (default: never)", NULL,
     AT(patience)},
    {HADA_OPTION_CHOICE, "keep", 0, "best|last", "which parameters MODEL2 holds in the end",
     "best: by the PSNR of held-out pairs, the default; last: the default with an adversarial loss, which gives up "
     "PSNR for looks.",
     AT(keep)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    int *const counts[] = {&set->steps,  &set->epochs, &set->batch,          &set->critic_steps, &set->period,
                           &set->warmup, &set->shift,  &set->validate_every, &set->show_every,   &set->save_every};
    double *const reals[] = {&set->rate,        &set->filter_rate, &set->critic_rate, &set->last_rate,
                             &set->clip,        &set->decay,       &set->mse,         &set->perceptual,
                             &set->adversarial, &set->variation,   &set->noise,       &set->exposure};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
        *counts[i] = HADA_CLI_COUNT_DEFAULT;
    for (size_t i = 0; i < sizeof reals / sizeof *reals; i++)
        *reals[i] = NAN;
    set->validate_most = 24;
    set->seed = 1;
}

static hada_status make_folders(hada_cli_train_run *run, hada_error *err)
{
    const settings *set = run->set;
    char *pictures = NULL;
    run->log_folder = set->log ? hada_cli_text("%s", set->log) : hada_cli_text("%s.log", set->output);
    if (run->log_folder) {
        run->checkpoint = hada_cli_text("%s/checkpoint.safetensors", run->log_folder);
        pictures = hada_cli_text("%s/pictures", run->log_folder);
    }
    hada_status status =
        run->checkpoint && pictures ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status && hada_path_is_file(run->checkpoint) && !set->resume && !set->restart)
        status = hada_cli_error(err, HADA_ERROR_ARGUMENT,
                                "%s holds the checkpoint of an earlier training: go on with it (--resume), begin anew "
                                "(--restart), or choose another folder (--log)",
                                run->log_folder);
    if (!status)
        status = hada_folder_ensure(pictures, err);
    free(pictures);
    return status;
}

static void tell(hada_cli_train_run *run, const hada_cli_contexts *devices)
{
    static const char *const stages[] = {"", "filters", "enhance", "adversarial", "joint", "conventional"};
    const hada_train_options *use = hada_trainer_get_options(run->trainer);
    const hada_net *net = hada_trainer_get_net(run->trainer);
    hada_net_info info = {0};
    char held[16], values[48] = "no net", on[40] = "";
    if (net) {
        hada_net_get_info(net, &info);
        snprintf(values, sizeof values, "a net of %llu values", (unsigned long long)info.values);
    }
    if (devices->count > 1)
        snprintf(on, sizeof on, ", on %d devices", devices->count);
    json_t *document = run->cli->document;
    json_object_set_new(document, "stage", json_string(stages[use->stage]));
    json_object_set_new(document, "pairs", json_integer(run->data->learned));
    json_object_set_new(document, "held_out", json_integer(run->data->held));
    json_object_set_new(document, "net_values", json_integer((json_int_t)info.values));
    json_object_set_new(document, "output", json_string(run->set->output));
    json_object_set_new(document, "log", json_string(run->log_folder));
    hada_cli_say(run->cli, "Stage %s, %s; %d pairs to learn from, %d held out, %d %s", stages[use->stage], values,
                 run->data->learned, run->data->held, hada_dataset_get_info(run->data->all)->depths,
                 hada_dataset_get_info(run->data->all)->depths == 1 ? "depth" : "depths");
    hada_cli_say(run->cli, "%llu steps of %d pairs (%d at once), every pair %.3g times; %s%s",
                 (unsigned long long)run->steps, use->batch, use->at_once,
                 (double)run->steps * use->batch / run->data->learned,
                 hada_cli_bytes(held, hada_context_bytes(devices->contexts[0])), on);
}

static hada_status resume(hada_cli_train_run *run, hada_error *err)
{
    if (!run->set->resume)
        return HADA_OK;
    if (!hada_path_is_file(run->checkpoint)) {
        hada_cli_warn(run->cli, "there is no checkpoint in %s yet: training begins at step 0", run->log_folder);
        return HADA_OK;
    }
    hada_status status = hada_trainer_load(run->trainer, run->checkpoint, err);
    if (!status)
        hada_cli_say(run->cli, "Going on from step %llu.", (unsigned long long)hada_trainer_steps(run->trainer));
    return status;
}

/* The planes of these stages are linear, in training and afterwards. */
static void warn_linear(hada_cli_train_run *run, const hada_model *model)
{
    const hada_stage stage = hada_cli_train_stage(run->set);
    const int steps = hada_model_get_info(model)->refine_steps;
    if (steps > 0 && (stage == HADA_STAGE_JOINT || (stage == HADA_STAGE_FILTERS && !run->set->random)))
        hada_cli_warn(
            run->cli,
            "the model refines its planes (%d steps); this stage trains linear filters and leaves that out, so "
            "its pictures may be worse than the model's own",
            steps);
}

static hada_status train(hada_cli_train_run *run, const hada_cli_contexts *devices, hada_error *err)
{
    hada_train_options use;
    hada_augment augment;
    hada_model *model = NULL;
    hada_net *net = NULL;
    hada_status status = hada_cli_train_options(run->cli, run->set, run->data, &use, &augment, &net, err);
    if (!status)
        status = hada_cli_train_model(run->cli, run->set, run->data, devices->contexts[0], &model, err);
    if (!status)
        status = hada_trainer_create_on(&run->trainer, devices->contexts, devices->count, model, &run->data->pairs,
                                        run->data->held ? &run->data->held_pairs : NULL, &use, err);
    if (status == HADA_ERROR_DEVICE_MEMORY)
        hada_cli_prefix(err,
                        "training needs more memory than the device has; try --at-once 1, --recompute or a smaller "
                        "--net-size: ");
    if (!status)
        warn_linear(run, model);
    run->steps = use.steps;
    if (!status)
        tell(run, devices);
    if (!status)
        status = resume(run, err);
    if (!status)
        status = hada_cli_train_loop(run, err);
    hada_trainer_destroy(&run->trainer);
    hada_model_destroy(&model);
    hada_net_destroy(&net);
    return status;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    hada_cli_contexts devices = {.count = 0};
    hada_cli_train_data data;
    hada_cli_train_run work = {.cli = cli, .set = set, .data = &data};
    if (count != 1)
        return hada_cli_usage(cli, count ? "one DATASET at a time" : "say what to learn from: a DATASET folder");
    if (!set->output)
        return hada_cli_usage(cli, "say where the trained model shall be written, with -o MODEL2");
    if (set->steps != HADA_CLI_COUNT_DEFAULT && set->epochs != HADA_CLI_COUNT_DEFAULT)
        return hada_cli_usage(cli, "either --steps or --epochs, not both");
    if (set->resume && set->restart)
        return hada_cli_usage(cli, "either --resume or --restart, not both");
    if (set->save_every == 0)
        return hada_cli_usage(cli, "--save-every needs at least one step");
    hada_status status = hada_file_check_target(set->output, &err);
    if (!status)
        status = hada_cli_train_data_make(cli, set, arguments[0], &data, &err);
    if (status)
        return hada_cli_fail(cli, &err);
    status = make_folders(&work, &err);
    if (!status)
        status = hada_cli_open_all(cli, &devices, &err);
    if (!status)
        status = train(&work, &devices, &err);
    hada_cli_close_all(cli, &devices);
    hada_cli_train_data_free(&data);
    free(work.log_folder);
    free(work.checkpoint);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens train camera -m camera.model -o trained.model", "a net that enhances what the model reconstructs."},
    {"hadalens train camera -m camera.model -o trained.model --resume", "goes on after Ctrl-C, or a loss of power."},
    {"hadalens train camera -m trained.model -o sharp.model --stage adversarial --vgg vgg16.safetensors",
     "the next stage, with the perceptual loss."},
    {"hadalens train camera --stage filters -o filters.model", "filters by gradients, from a random start."},
    {"hadalens train camera -m camera.model -o trained.model --device 0,1", "on two devices, which share each step."},
    {0},
};

const hada_cli_command hada_cli_train = {
    .name = "train",
    .summary = "train filters and nets by gradients, beyond the exact fit",
    .synopsis = "DATASET [-m MODEL] -o MODEL2 [OPTION...]",
    .description =
        "The exact fit ('hadalens fit') gives the filters in seconds. Training goes on from there: it learns a net "
        "that "
        "takes away what linear filters leave (noise, the pattern of the mask), shared by all depths.\n\n"
        "Some pairs are held out, and tell how good training is: PSNR, SSIM, mean absolute error and sharpness are "
        "printed and logged, with pictures now and then. The best parameters are kept. The same command with --resume "
        "goes on after any interruption, with the same bits.\n\n"
        "Numbers that are no longer finite take training back to the last good parameters, with half the rate.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
};
