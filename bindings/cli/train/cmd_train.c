#include "option.h"
#include "shared.h"

#include <hadalens/folder.h>
#include <hadalens/task_train.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#define NOT_GIVEN UINT64_MAX /* steps, which --epochs may stand for */

/* Options stand where the library reads them. */
typedef struct settings {
    hada_cli_common common;
    hada_train_options how;
    hada_augment augment;
    hada_fit_options fit;
    hada_train_task task;
    const char *model, *net, *hold_out, *dark;
    int random, form, window[2], net_size[2], skip_incomplete;
    uint64_t steps;
} settings;

#define AT(member)          HADA_CLI_AT(settings, member)
#define ONE_OF(member, ...) HADA_CLI_ONE_OF(settings, member, __VA_ARGS__)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("What to train"),
    {HADA_OPTION_TEXT, "model", 'm', "MODEL", "the model to begin with ('hadalens fit' or an earlier stage made it)",
     "Without it the exact fit comes first; filters then start at random.", AT(model)},
    {HADA_OPTION_TARGET, "output", 'o', "MODEL2", "the model file to write: at each new best, and at the end",
     "Stage conventional: the file of a net.", AT(task.output)},
    {HADA_OPTION_CHOICE, "stage", 0, "filters|enhance|adversarial|conventional",
     "which part is trained (default: enhance)",
     "filters: the filters alone, by gradients. enhance: a net behind the filters, which stay. adversarial: the same "
     "against a discriminator. conventional: a net from raw frame to image, without filters, to compare.",
     ONE_OF(how.stage, HADA_STAGE_FILTERS, HADA_STAGE_ENHANCE, HADA_STAGE_ADVERSARIAL, HADA_STAGE_CONVENTIONAL)},
    {HADA_OPTION_TEXT, "net", 0, "compact|paper|FILE", "a new net instead of the model's (default: compact)",
     "compact starts by giving planes back as they are. FILE: a net with its weights.", AT(net)},
    {HADA_OPTION_SIZE, "net-size", 0, "HxW", "pixels at which the net runs (default: the window's)", NULL,
     AT(net_size)},
    {HADA_OPTION_WORD, "discriminator", 0, "patch|paper", "the discriminator of adversarial training (default: patch)",
     "patch: judges patches of 25 x 25 pixels. paper: the whole image, at 256 x 256.", AT(how.discriminator)},
    {HADA_OPTION_FLAG, "random", 0, NULL, "filters: start at random, not from the model's", NULL, AT(random)},
    {HADA_OPTION_CHOICE, "form", 0, "complex|split", "filters without a model: how they act on a frame's spectrum",
     NULL, ONE_OF(form, HADA_FORM_COMPLEX, HADA_FORM_SPLIT)},

    HADA_CLI_GROUP("Pairs"),
    {HADA_OPTION_TEXT, "hold-out", 0, "N|SHARE", "pairs of each depth to validate with (default: an eighth)",
     "The last ones of each folder. A model that was fitted to them as well makes them look easier than they are.",
     AT(hold_out)},
    {HADA_OPTION_COUNT, "shift", 0, "PIXELS", "move frame and scene together by up to so many pixels",
     "Circular boundary only.", AT(augment.shift)},
    {HADA_OPTION_CHOICE, "flips", 0, "none|left-right|top-bottom|both", "flip frame and scene together",
     "For optics that are symmetric in this way only.", ONE_OF(augment.flips, 0, 1, 2, 3)},
    {HADA_OPTION_CHOICE, "plane-flips", 0, "none|left-right|top-bottom|both",
     "enhance, adversarial: flip the plane behind the filters and the scene (default: both)", NULL,
     ONE_OF(augment.plane_flips, 0, 1, 2, 3)},
    {HADA_OPTION_REAL, "noise", 0, "SHARE", "add Gaussian noise, as a share of the frame's maximum", NULL,
     AT(augment.noise)},
    {HADA_OPTION_REAL, "exposure", 0, "SHARE", "scale pairs by a factor from 1 - SHARE to 1 + SHARE", NULL,
     AT(augment.exposure)},
    {HADA_OPTION_REAL, "compose", 0, "SHARE",
     "enhance, adversarial: share of pairs that become scenes of several depths",
     "Parts of a pair's scene are moved to other depths or replaced, and its frame is changed by what the model says "
     "that this makes. 1: a net that only shares out light among depths and leaves their sum, the default where the model "
     "refines by total variation (enhance); else 0.15, and 0 where it has no transfer functions or a single depth.",
     AT(how.compose)},
    {HADA_OPTION_CHOICE, "boundary", 0, "circular|padded", "without a model: as for 'hadalens fit'", NULL,
     ONE_OF(task.boundary, HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED)},
    {HADA_OPTION_SIZE, "window", 0, "HxW", "without a model: field of view, as for 'hadalens fit'", NULL, AT(window)},
    {HADA_OPTION_TEXT, "dark", 0, "FILE|auto|none|LEVEL", "without a model: dark level, as for 'hadalens fit'", NULL,
     AT(dark)},
    {HADA_OPTION_FLAG, "skip-incomplete", 0, NULL, "leave out files that have no partner, instead of refusing", NULL,
     AT(skip_incomplete)},

    HADA_CLI_GROUP("Steps"),
    {HADA_OPTION_STEPS, "steps", 0, "N", "steps of the whole training (default: 1000; adversarial: 300)", NULL,
     AT(steps)},
    {HADA_OPTION_STEPS, "epochs", 0, "N", "instead: how often every pair is seen", NULL, AT(task.epochs)},
    {HADA_OPTION_COUNT, "batch", 0, "N", "pairs of a step (default: 4)", NULL, AT(how.batch)},
    {HADA_OPTION_COUNT, "at-once", 0, "N", "pairs computed together; fewer need less memory (default: as many as fit)",
     "Gradients of a step add up, so that the result hardly changes.", AT(how.at_once)},
    {HADA_OPTION_FLAG, "recompute", 0, NULL, "less memory still: compute what backward needs a second time", NULL,
     AT(how.recompute)},
    {HADA_OPTION_CHOICE, "rule", 0, "rmsprop|adam", "how gradients change parameters (default: adam)",
     "rmsprop is the paper's.", ONE_OF(how.rule, HADA_RULE_RMSPROP, HADA_RULE_ADAM)},
    {HADA_OPTION_REAL, "rate", 0, "R", "learning rate of the net", NULL, AT(how.rate)},
    {HADA_OPTION_REAL, "filter-rate", 0, "R", "of the filters", NULL, AT(how.filter_rate)},
    {HADA_OPTION_REAL, "discriminator-rate", 0, "R", "of the discriminator", NULL, AT(how.discriminator_rate)},
    {HADA_OPTION_CHOICE, "schedule", 0, "constant|cosine", "how rates change (default: cosine)", NULL,
     ONE_OF(how.schedule, HADA_RATE_CONSTANT, HADA_RATE_COSINE)},
    {HADA_OPTION_REAL, "last-rate", 0, "SHARE", "cosine: the rates at the end", NULL, AT(how.last_rate)},
    {HADA_OPTION_STEPS, "warmup", 0, "N", "steps in which rates rise from a tenth", NULL, AT(how.warmup)},
    {HADA_OPTION_REAL, "clip", 0, "NORM", "largest norm of a step's gradient; 0: any", NULL, AT(how.clip)},
    {HADA_OPTION_STEPS, "discriminator-steps", 0, "N", "first steps, of the discriminator alone", NULL,
     AT(how.discriminator_steps)},
    {HADA_OPTION_SEED, "seed", 0, "N", "first weights, order and changes of pairs (default: 1)", NULL, AT(how.seed)},

    HADA_CLI_GROUP("Weights of the losses (default: 1.5, 0.1, 0.008, 5e-7, the paper's)"),
    {HADA_OPTION_REAL, "mse", 0, "W", "mean squared error", NULL, AT(how.mse)},
    {HADA_OPTION_REAL, "perceptual", 0, "W", "difference of VGG-16's features (needs --vgg)", NULL, AT(how.perceptual)},
    {HADA_OPTION_REAL, "adversarial", 0, "W", "the discriminator's judgement", NULL, AT(how.adversarial)},
    {HADA_OPTION_REAL, "tv", 0, "W", "total variation", NULL, AT(how.variation)},
    {HADA_OPTION_FLAG, "tv-squared", 0, NULL, "squares in the total variation, as the paper has it", NULL,
     AT(how.variation_squared)},
    {HADA_OPTION_TEXT, "vgg", 0, "FILE", "weights of VGG-16 (safetensors, names as torchvision's)", NULL, AT(how.vgg)},

    HADA_CLI_GROUP("On the way"),
    {HADA_OPTION_TARGET, "log", 0, "FOLDER", "for log, figure, pictures, checkpoint (default: MODEL2.log)", NULL,
     AT(task.log)},
    {HADA_OPTION_FLAG, "resume", 0, NULL, "go on from the checkpoint in the log folder",
     "Give what the training began with; rates, losses and the number of steps may differ.", AT(task.resume)},
    {HADA_OPTION_FLAG, "restart", 0, NULL, "begin anew where the log folder holds a checkpoint", NULL,
     AT(task.restart)},
    {HADA_OPTION_COUNT, "validate-every", 0, "N", "steps between validations (default: a twentieth of all); 0: none",
     NULL, AT(task.validate_every)},
    {HADA_OPTION_COUNT, "validate-pairs", 0, "N", "pairs to validate with, evenly chosen (default: 24); 0: all", NULL,
     AT(task.validate_pairs)},
    {HADA_OPTION_COUNT, "show-every", 0, "N", "steps between pictures (default: a quarter of all); 0: none", NULL,
     AT(task.show_every)},
    {HADA_OPTION_COUNT, "save-every", 0, "N", "steps between checkpoints (default: a twentieth of all)", NULL,
     AT(task.save_every)},
    {HADA_OPTION_COUNT, "patience", 0, "N", "end after so many validations without a better one (default: never)", NULL,
     AT(task.patience)},
    {HADA_OPTION_CHOICE, "keep", 0, "best|last", "which parameters MODEL2 holds in the end",
     "best: by the PSNR of held-out pairs, the default; last: the default with an adversarial loss, which gives up "
     "PSNR for looks.",
     ONE_OF(task.keep, HADA_KEEP_BEST, HADA_KEEP_LAST)},
    {0},
};

static const char *const renamed[] = {"critic",       "discriminator",       "critic-rate", "discriminator-rate",
                                      "critic-steps", "discriminator-steps", NULL};

/* The stage, which the others go by, is there already where it was given. */
static void defaults(void *user)
{
    settings *set = user;
    hada_train_options_init(&set->how, set->how.stage ? set->how.stage : HADA_STAGE_ENHANCE);
    hada_augment_init(&set->augment);
    hada_fit_options_init(&set->fit);
    hada_train_task_init(&set->task);
    set->steps = NOT_GIVEN;
}

/* What is printed and put into the document. */

typedef struct listener {
    hada_cli *cli;
    const hada_cli_contexts *devices;
    int headed; /* the table's head is printed */
} listener;

/* "3 min 20 s" */
static const char *duration(char *text, size_t room, double seconds)
{
    const long whole = (long)(seconds + 0.5);
    if (whole < 100)
        snprintf(text, room, "%.*f s", seconds < 10 ? 1 : 0, seconds);
    else if (whole < 5400)
        snprintf(text, room, "%ld min %ld s", whole / 60, whole % 60);
    else
        snprintf(text, room, "%ld h %ld min", whole / 3600, whole / 60 % 60);
    return text;
}

static double seconds_left(const hada_train_state *state)
{
    return (double)(state->steps - state->step) * state->seconds_per_step;
}

static hada_stage stage_of(const hada_train_state *state)
{
    return state->options->stage;
}

static void tell_begin(listener *to, const hada_train_state *state)
{
    static const char *const stages[] = {"", "filters", "enhance", "adversarial", "", "conventional"};
    const hada_train_options *use = state->options;
    const hada_net *net = state->net;
    json_t *document = to->cli->document;
    uint64_t held_values = 0;
    char held[16], values[48] = "no net", on[40] = "";
    if (net) {
        held_values = hada_net_get_info(net)->values;
        snprintf(values, sizeof values, "a net of %llu values", (unsigned long long)held_values);
    }
    if (to->devices->count > 1)
        snprintf(on, sizeof on, ", on %d devices", to->devices->count);
    json_object_set_new(document, "stage", json_string(stages[use->stage]));
    json_object_set_new(document, "pairs", json_integer(state->learned));
    json_object_set_new(document, "held_out", json_integer(state->held_out));
    json_object_set_new(document, "net_values", json_integer((json_int_t)held_values));
    json_object_set_new(document, "output", hada_cli_json_text(state->output));
    json_object_set_new(document, "log", hada_cli_json_text(state->log));
    hada_cli_say(to->cli, "Stage %s, %s; %d pairs to learn from, %d held out, %d %s", stages[use->stage], values,
                 state->learned, state->held_out, state->depths, state->depths == 1 ? "depth" : "depths");
    hada_cli_say(to->cli, "%llu steps of %d pairs (%d at once), every pair %.3g times; %s%s",
                 (unsigned long long)state->steps, use->batch, use->at_once,
                 (double)state->steps * use->batch / state->learned,
                 hada_cli_bytes(held, hada_cli_context_info(to->devices->contexts[0]).bytes), on);
    hada_cli_pictures(to->cli);
}

static void tell_time(listener *to, const hada_train_state *state)
{
    char text[64];
    hada_cli_say(to->cli, "About %s for %llu steps (%.3g s each); Ctrl-C saves, --resume goes on.",
                 duration(text, sizeof text, seconds_left(state)), (unsigned long long)(state->steps - state->step),
                 state->seconds_per_step);
}

static void tell_head(listener *to, const hada_train_state *state, const hada_validation *result)
{
    if (to->headed)
        return;
    to->headed = 1;
    if (stage_of(state) != HADA_STAGE_FILTERS && isfinite(result->psnr_before))
        hada_cli_say(to->cli,
                     "Held-out planes before the net: %.2f dB, SSIM %.4f, sharpness %.5f; their truth's is %.5f",
                     result->psnr_before, result->ssim_before, result->sharpness_before, result->sharpness_truth);
    hada_cli_say(to->cli, "\n  %8s  %10s  %13s  %7s  %8s  %9s  %s", "step", "loss", "held-out PSNR", "SSIM", "MAE",
                 "sharpness", "left");
}

static void tell_validation(listener *to, const hada_train_state *state)
{
    const hada_validation *result = state->rows[state->row_count - 1].result;
    char left[32] = "", loss[32] = "-";
    tell_head(to, state, result);
    if (state->step > state->first) {
        snprintf(loss, sizeof loss, "%.3e", state->loss);
        duration(left, sizeof left, seconds_left(state));
    }
    hada_cli_say(to->cli, "%s %8llu  %10s  %10.2f dB  %7.4f  %8.5f  %9.5f  %s", state->better ? "*" : " ",
                 (unsigned long long)state->step, loss, result->psnr, result->ssim, result->mae, result->sharpness,
                 left);
}

static json_t *measures(const hada_validation *r, int before)
{
    json_t *object = json_object();
    HADA_CLI_SET(object, {"psnr", before ? r->psnr_before : r->psnr}, {"ssim", before ? r->ssim_before : r->ssim},
                 {"mae", before ? r->mae_before : r->mae}, {"sharpness", before ? r->sharpness_before : r->sharpness});
    return object;
}

static void fill_document(json_t *document, const hada_train_state *state)
{
    json_t *rows = json_array();
    for (size_t i = 0; i < state->row_count; i++) {
        json_t *entry = measures(state->rows[i].result, 0);
        json_object_set_new(entry, "step", json_integer((json_int_t)state->rows[i].step));
        json_object_set_new(entry, "before", measures(state->rows[i].result, 1));
        json_array_append_new(rows, entry);
    }
    json_object_set_new(document, "validation", rows);
    json_object_set_new(document, "steps", json_integer((json_int_t)state->step));
    HADA_CLI_SET(document, {"seconds", state->seconds}, {"seconds_per_step", state->seconds_per_step},
                 {"loss", state->loss});
    json_object_set_new(document, "rolled_back", json_integer(state->rolled_back));
    json_object_set_new(document, "kept", json_string(state->keep_best ? "best" : "last"));
    if (state->row_count) {
        json_object_set_new(document, "best_step", json_integer((json_int_t)state->best_step));
        json_object_set_new(document, "best_psnr", hada_cli_real(state->best_psnr));
    }
}

static void tell_end(listener *to, const hada_train_state *state)
{
    char text[64];
    hada_cli_say(to->cli, "\n%llu steps in %s. Log, figure and pictures: %s",
                 (unsigned long long)(state->step - state->first), duration(text, sizeof text, state->seconds),
                 state->log);
    if (!state->row_count)
        return;
    const hada_validation *start = state->rows[0].result;
    if (!isfinite(state->best_psnr)) /* the best is lost */
        hada_cli_say(to->cli, "The best on held-out pairs is lost.");
    else if (stage_of(state) == HADA_STAGE_FILTERS || !isfinite(start->psnr_before))
        hada_cli_say(to->cli, "Best on held-out pairs: %.2f dB at step %llu (%.2f dB at the start)", state->best_psnr,
                     (unsigned long long)state->best_step, start->psnr);
    else
        hada_cli_say(to->cli, "Best on held-out pairs: %.2f dB at step %llu; without the net %.2f dB", state->best_psnr,
                     (unsigned long long)state->best_step, start->psnr_before);
    hada_cli_say(to->cli, "%s holds the %s.", state->output,
                 state->keep_best ? "best of them" : "parameters of the last step");
    if (state->best_step == 0 && state->keep_best && state->step > 0)
        hada_cli_warn(to->cli,
                      "training made nothing better on held-out pairs; more pairs, a smaller rate (--rate) or more "
                      "steps may help");
}

static void train_tell(void *user, const hada_train_state *state)
{
    listener *to = user;
    switch (state->event) {
    case HADA_TRAIN_BEGINS: tell_begin(to, state); break;
    case HADA_TRAIN_TIMED: tell_time(to, state); break;
    case HADA_TRAIN_VALIDATED: tell_validation(to, state); break;
    case HADA_TRAIN_ENDS:
        fill_document(to->cli->document, state);
        if (!state->status)
            tell_end(to, state);
        break;
    }
}

/* What a run needs that outlives its options. */
typedef struct parts {
    hada_dataset *data;
    hada_model *model;
    hada_net *net;
    hada_image dark;
} parts;

static void parts_free(parts *of)
{
    hada_dataset_destroy(&of->data);
    hada_model_destroy(&of->model);
    hada_net_destroy(&of->net);
    hada_image_destroy(&of->dark);
}

/* "compact", "paper", or a file with a net and its weights. */
static hada_status choose_net(settings *set, parts *of, hada_error *err)
{
    const char *text = set->net;
    if (!text)
        return HADA_OK;
    set->how.new_net = 1;
    if (!strcmp(text, "compact") || !strcmp(text, "paper")) {
        set->how.net = text;
        return HADA_OK;
    }
    if (!hada_path_is_file(text))
        return hada_cli_error(err, HADA_ERROR_FILE_OPEN,
                              "--net takes compact, paper or the file of a net; there is no file '%s'", text);
    const hada_status status = hada_net_load(&of->net, text, err);
    set->how.net_given = of->net;
    return status;
}

/* "3": of each depth; "0.2": a share of each. */
static hada_status read_hold_out(const char *text, double *value, hada_error *err)
{
    if (!text ||
        (hada_cli_read_real(text, value) && *value >= 0 && (*value < 1 || *value == floor(*value)) && *value <= 1e6))
        return HADA_OK;
    return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                          "--hold-out takes a number of pairs of each depth, or a share such as 0.2; not '%s'", text);
}

/* What options say of others, and what is read from files. */
static hada_status complete(hada_cli *cli, settings *set, parts *of, hada_error *err)
{
    hada_train_options *how = &set->how;
    hada_train_task *task = &set->task;
    how->form = (hada_form)set->form;
    how->random_start = how->stage == HADA_STAGE_FILTERS && (set->random || !set->model);
    how->net_rows = set->net_size[0];
    how->net_cols = set->net_size[1];
    how->at_once = how->at_once ? how->at_once : (int)HADA_AUTO;
    how->steps = set->steps != NOT_GIVEN ? set->steps : how->steps;
    how->augment = &set->augment;
    how->communicator = hada_cli_communicator(cli);
    if (set->form)
        set->fit.form = (hada_form)set->form;
    set->fit.window_rows = set->window[0];
    set->fit.window_cols = set->window[1];
    task->options = how;
    task->fit = &set->fit;
    task->monitor = &cli->monitor;
    HADA_TRY(choose_net(set, of, err));
    HADA_TRY(read_hold_out(set->hold_out, &task->hold_out, err));
    set->fit.find_dark = !set->dark;
    HADA_TRY(hada_cli_read_dark_level(&set->fit.dark, &of->dark, set->dark, err));
    if (set->model)
        HADA_TRY(hada_model_load(&of->model, set->model, err));
    task->model = of->model;
    return HADA_OK;
}

static int check(hada_cli *cli, const settings *set, int count)
{
    if (count != 1)
        return hada_cli_usage(cli, count ? "one DATASET at a time" : "say what to learn from: a DATASET folder");
    if (!set->task.output)
        return hada_cli_usage(cli, "say where the trained model shall be written, with -o MODEL2");
    if (set->steps != NOT_GIVEN && set->task.epochs)
        return hada_cli_usage(cli, "either --steps or --epochs, not both");
    if (set->task.resume && set->task.restart)
        return hada_cli_usage(cli, "either --resume or --restart, not both");
    if (!set->task.save_every)
        return hada_cli_usage(cli, "--save-every needs at least one step");
    return HADA_EXIT_OK;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    settings *set = user;
    hada_error err = {0};
    hada_cli_contexts devices = {.count = 0};
    hada_dataset_options scan;
    parts of = {0};
    hada_status status = HADA_OK;
    const int wrong = check(cli, set, count);
    if (wrong)
        return wrong;
    hada_dataset_options_init(&scan);
    scan.skip_incomplete = set->skip_incomplete;
    HADA_TRY_OR_DONE(hada_file_check_target(set->task.output, &err));
    HADA_TRY_OR_DONE(complete(cli, set, &of, &err));
    scan.dark_frame = of.dark.data ? &of.dark : NULL;
    if (of.model) {
        const hada_model_info *info = hada_model_get_info(of.model);
        scan.dark_frame = info->dark_frame;
        scan.flat_frame = info->flat;
        scan.flat_dark = info->dark;
        scan.downsample = info->downsample;
        scan.mosaic = info->sensor_mosaic;
        scan.frame_encoding = info->frame_encoding == 0.0 ? HADA_AUTO : info->frame_encoding;
    }
    HADA_TRY_OR_DONE(hada_dataset_scan(&of.data, arguments[0], &scan, &err));
    HADA_TRY_OR_DONE(hada_cli_open_all(cli, &devices, &err));
    listener to = {.cli = cli, .devices = &devices};
    set->task.tell = train_tell;
    set->task.user = &to;
    HADA_TRY_OR_DONE(hada_train_run(devices.contexts, devices.count, of.data, &set->task, &err));
done:
    hada_cli_close_all(cli, &devices);
    parts_free(&of);
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
    .renamed = renamed,
    .examples = examples,
    .settings_size = sizeof(settings),
    .decides = "stage",
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
    .shared = 1,
};
