/* Steps until the end, with everything that long work needs: validation, pictures, checkpoints, the best model, an
 * early end, and signals. */
#include "folder.h"
#include "train_log.h"
#include "train_settings.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct loop {
    const hada_cli_train_run *run;
    hada_cli_train_log log;
    uint64_t first, validate_every, show_every, save_every;
    double best, started, step_seconds;
    uint64_t best_step;
    int without_better; /* validations since the best */
    int rolled_back, keep_best, headed;
    hada_step_report last;
} loop;

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

static hada_status write_output(const hada_cli_train_run *run, hada_error *err)
{
    hada_model *model = NULL;
    hada_net *net = NULL;
    hada_status status;
    if (hada_cli_train_stage(run->set) == HADA_STAGE_CONVENTIONAL) {
        status = hada_trainer_net(run->trainer, &net, err);
        if (!status)
            status = hada_net_save(net, run->set->output, err);
        hada_net_destroy(&net);
        return status;
    }
    status = hada_trainer_model(run->trainer, &model, err);
    if (!status)
        status = hada_model_save(model, run->set->output, err);
    hada_model_destroy(&model);
    return status;
}

static void print_row(loop *own, uint64_t step, const hada_validation *result, int better)
{
    hada_cli *cli = own->run->cli;
    char left[32] = "", loss[32] = "-";
    if (!own->headed && own->run->set->stage != HADA_STAGE_FILTERS && isfinite(result->psnr_before))
        hada_cli_say(cli, "Held-out planes before the net: %.2f dB, SSIM %.4f, sharpness %.5f; their truth's is %.5f",
                     result->psnr_before, result->ssim_before, result->sharpness_before, result->sharpness_truth);
    if (!own->headed)
        hada_cli_say(cli, "\n  %8s  %10s  %13s  %7s  %8s  %9s  %s", "step", "loss", "held-out PSNR", "SSIM", "MAE",
                     "sharpness", "left");
    own->headed = 1;
    if (step > own->first) {
        snprintf(loss, sizeof loss, "%.3e", own->last.loss);
        duration(left, sizeof left, (double)(own->run->steps - step) * own->step_seconds);
    }
    hada_cli_say(cli, "%s %8llu  %10s  %10.2f dB  %7.4f  %8.5f  %9.5f  %s", better ? "*" : " ",
                 (unsigned long long)step, loss, result->psnr, result->ssim, result->mae, result->sharpness, left);
}

static hada_status validate(loop *own, uint64_t step, hada_error *err)
{
    const hada_cli_train_run *run = own->run;
    hada_validation result = {.size = sizeof result};
    if (!run->data->held)
        return HADA_OK;
    hada_status status = hada_trainer_validate(run->trainer, run->set->validate_most, &result, err);
    if (!status)
        status = hada_cli_train_log_validation(&own->log, step, &result, err);
    if (status)
        return status;
    const int better = result.psnr > own->best;
    own->without_better = better ? 0 : own->without_better + 1;
    if (better) {
        own->best = result.psnr;
        own->best_step = step;
    }
    print_row(own, step, &result, better);
    return better && own->keep_best ? write_output(run, err) : HADA_OK;
}

static hada_status show(loop *own, uint64_t step, hada_error *err)
{
    const hada_cli_train_run *run = own->run;
    if (!run->data->held)
        return HADA_OK;
    char *path = hada_cli_text("%s/pictures/step%08llu.png", run->log_folder, (unsigned long long)step);
    hada_status status = path ? hada_cli_train_picture(run->trainer, run->data->held, path, err)
                              : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    free(path);
    return status;
}

static hada_status save(loop *own, hada_error *err)
{
    hada_status status = hada_cli_train_log_flush(&own->log, err);
    if (!status)
        status = hada_trainer_save(own->run->trainer, own->run->checkpoint, err);
    return status || own->keep_best ? status : write_output(own->run, err);
}

static hada_status stop(loop *own, uint64_t step, hada_error *err)
{
    hada_status status = save(own, err);
    return status ? status
                  : hada_cli_error(err, HADA_ERROR_CANCELLED,
                                   "stopped after step %llu of %llu, which is saved in %s; the same command with "
                                   "--resume goes on from there",
                                   (unsigned long long)step, (unsigned long long)own->run->steps, own->run->checkpoint);
}

static uint64_t every(int given, uint64_t otherwise)
{
    return given == HADA_CLI_COUNT_DEFAULT ? otherwise : given ? (uint64_t)given : UINT64_MAX;
}

static int due(uint64_t step, uint64_t interval, uint64_t end)
{
    return interval != UINT64_MAX && (step % interval == 0 || step == end);
}

/* What is due after a step. */
static hada_status after_step(loop *own, uint64_t step, hada_error *err)
{
    const uint64_t end = own->run->steps;
    hada_status status = HADA_OK;
    if (due(step, own->validate_every, end))
        status = validate(own, step, err);
    if (!status && due(step, own->show_every, end))
        status = show(own, step, err);
    if (!status && (due(step, own->save_every, end) || step == end))
        status = save(own, err);
    return status;
}

static void tell_time(loop *own, const hada_step_report *report)
{
    const uint64_t done = report->step - own->first;
    char text[64];
    /* the first step compiles kernels and fills memory */
    if (done > 1)
        own->step_seconds += (report->seconds - own->step_seconds) / (double)(done < 50 ? done - 1 : 50);
    if (done == 4)
        hada_cli_say(own->run->cli, "About %s for %llu steps (%.3g s each); Ctrl-C saves, --resume goes on.",
                     duration(text, sizeof text, own->step_seconds * (double)(own->run->steps - report->step)),
                     (unsigned long long)(own->run->steps - report->step), own->step_seconds);
}

static hada_status one_step(loop *own, hada_error *err)
{
    const hada_cli_train_run *run = own->run;
    hada_step_report report = {.size = sizeof report};
    char note[64];
    hada_status status = hada_trainer_step(run->trainer, &report, err);
    if (!status)
        status = hada_cli_train_log_step(&own->log, &report, err);
    if (status)
        return status;
    if (report.rolled_back) {
        own->rolled_back++;
        hada_cli_warn(run->cli, "loss or gradient were not finite; back to step %llu with half the rate (%.3g before)",
                      (unsigned long long)report.step, report.rate);
        return HADA_OK;
    }
    own->last = report;
    tell_time(own, &report);
    snprintf(note, sizeof note, "step %llu, loss %.3e", (unsigned long long)report.step, report.loss);
    hada_cli_progress_step(run->cli, note);
    return after_step(own, report.step, err);
}

static void set_up(loop *own)
{
    const hada_cli_train_run *run = own->run;
    const hada_cli_train_settings *set = run->set;
    const int adversarial = hada_trainer_get_options(run->trainer)->adversarial > 0;
    own->first = hada_trainer_steps(run->trainer);
    own->validate_every = every(set->validate_every, run->steps < 20 ? 1 : run->steps / 20);
    own->show_every = every(set->show_every, run->steps < 4 ? 1 : run->steps / 4);
    own->save_every = every(set->save_every, run->steps < 20 ? 1 : run->steps / 20);
    /* A discriminator trades PSNR for looks, so the best by PSNR would be the start. */
    own->keep_best =
        run->data->held && own->validate_every != UINT64_MAX && (set->keep ? set->keep == 1 : !adversarial);
    own->best = -INFINITY;
    own->started = hada_cli_seconds();
    for (size_t i = 0; i < own->log.row_count; i++) {
        const int better = own->log.rows[i].result.psnr > own->best;
        own->without_better = better ? 0 : own->without_better + 1;
        if (better) {
            own->best = own->log.rows[i].result.psnr;
            own->best_step = own->log.rows[i].step;
        }
    }
}

static json_t *measures(const hada_validation *r, int before)
{
    json_t *object = json_object();
    json_object_set_new(object, "psnr", hada_cli_real(before ? r->psnr_before : r->psnr));
    json_object_set_new(object, "ssim", hada_cli_real(before ? r->ssim_before : r->ssim));
    json_object_set_new(object, "mae", hada_cli_real(before ? r->mae_before : r->mae));
    json_object_set_new(object, "sharpness", hada_cli_real(before ? r->sharpness_before : r->sharpness));
    return object;
}

static void fill_document(const loop *own, uint64_t step, double seconds)
{
    json_t *document = own->run->cli->document, *rows = json_array();
    for (size_t i = 0; i < own->log.row_count; i++) {
        const hada_cli_validation_row *row = &own->log.rows[i];
        json_t *entry = measures(&row->result, 0);
        json_object_set_new(entry, "step", json_integer((json_int_t)row->step));
        json_object_set_new(entry, "before", measures(&row->result, 1));
        json_array_append_new(rows, entry);
    }
    json_object_set_new(document, "validation", rows);
    json_object_set_new(document, "steps", json_integer((json_int_t)step));
    json_object_set_new(document, "seconds", json_real(seconds));
    json_object_set_new(document, "seconds_per_step", json_real(own->step_seconds));
    json_object_set_new(document, "loss", hada_cli_real(own->last.loss));
    json_object_set_new(document, "rolled_back", json_integer(own->rolled_back));
    json_object_set_new(document, "kept", json_string(own->keep_best ? "best" : "last"));
    if (own->log.row_count) {
        json_object_set_new(document, "best_step", json_integer((json_int_t)own->best_step));
        json_object_set_new(document, "best_psnr", hada_cli_real(own->best));
    }
}

static void sum_up(const loop *own, uint64_t step)
{
    const hada_cli_train_run *run = own->run;
    const double seconds = hada_cli_seconds() - own->started;
    char text[64];
    fill_document(own, step, seconds);
    hada_cli_say(run->cli, "\n%llu steps in %s. Log, figure and pictures: %s", (unsigned long long)(step - own->first),
                 duration(text, sizeof text, seconds), run->log_folder);
    if (!own->log.row_count)
        return;
    const hada_validation *start = &own->log.rows[0].result;
    const double before = isfinite(start->psnr_before) ? start->psnr_before : -INFINITY;
    if (hada_cli_train_stage(run->set) == HADA_STAGE_FILTERS || !isfinite(before))
        hada_cli_say(run->cli, "Best on held-out pairs: %.2f dB at step %llu (%.2f dB at the start)", own->best,
                     (unsigned long long)own->best_step, start->psnr);
    else
        hada_cli_say(run->cli, "Best on held-out pairs: %.2f dB at step %llu; without the net %.2f dB", own->best,
                     (unsigned long long)own->best_step, before);
    hada_cli_say(run->cli, "%s holds the %s.", run->set->output,
                 own->keep_best ? "best of them" : "parameters of the last step");
    if (own->best_step == 0 && own->keep_best && step > 0)
        hada_cli_warn(run->cli,
                      "training made nothing better on held-out pairs; more pairs, a smaller rate (--rate) or "
                      "more steps may help");
}

static hada_status steps(loop *own, hada_error *err)
{
    const hada_cli_train_run *run = own->run;
    hada_status status = HADA_OK;
    if (!own->first && own->validate_every != UINT64_MAX)
        status = validate(own, 0, err);
    if (!status && !own->first && own->show_every != UINT64_MAX)
        status = show(own, 0, err);
    uint64_t step = own->first;
    while (!status && step < run->steps) {
        if (hada_cli_interrupted())
            return stop(own, step, err);
        status = one_step(own, err);
        step = hada_trainer_steps(run->trainer);
        if (!status && run->set->patience > 0 && own->without_better >= run->set->patience) {
            hada_cli_say(run->cli, "Stopped early: %d validations without a better one.", own->without_better);
            status = save(own, err);
            break;
        }
    }
    return status;
}

hada_status hada_cli_train_loop(hada_cli_train_run *run, hada_error *err)
{
    loop own = {.run = run};
    hada_cli_progress progress;
    const uint64_t first = hada_trainer_steps(run->trainer);
    hada_cli_pictures(run->cli);
    hada_status status = hada_cli_train_log_open(&own.log, run->log_folder, first > 0, first, err);
    if (status)
        return status;
    set_up(&own);
    hada_cli_progress_begin(run->cli, &progress, "steps", (long)(run->steps > first ? run->steps - first : 0));
    status = steps(&own, err);
    hada_cli_progress_end(run->cli);
    if (!status && !hada_path_is_file(run->set->output))
        status = write_output(run, err);
    const uint64_t step = hada_trainer_steps(run->trainer);
    if (!status)
        sum_up(&own, step);
    else
        fill_document(&own, step, hada_cli_seconds() - own.started);
    hada_cli_train_log_close(&own.log);
    return status;
}
