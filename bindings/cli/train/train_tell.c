#include "train_tell.h"

#include <math.h>
#include <stdio.h>

typedef hada_cli_train_listener listener;

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

void hada_cli_train_tell(void *user, const hada_train_state *state)
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
