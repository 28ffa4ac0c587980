#include "fit_tell.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* What stands before and behind a row of a table. */
static const char *mark(int chosen)
{
    return chosen ? "*" : " ";
}

static const char *word(int chosen)
{
    return chosen ? "  chosen" : "";
}

/* An entry of the list that scripts read: each has all members, whatever was compared. */
static json_t *score_json(double alpha, double lambda, double psnr_one, double psnr_two, int chosen)
{
    json_t *entry = json_pack("{s:f, s:f, s:i, s:b, s:n, s:f, s:f}", "alpha", alpha, "lambda", lambda, "refine_steps",
                              0, "chosen", chosen, "outside", "refine_rho", 0.0, "refine_tv", 0.0);
    HADA_CLI_SET(entry, {"psnr_one_depth", psnr_one}, {"psnr_two_depths", psnr_two});
    return entry;
}

static void print_filters(hada_cli *cli, const hada_fit_scores *scores, json_t *list)
{
    const hada_fit_filter_score *row;
    for (size_t i = 0; (row = scores->filters[i]); i++) {
        hada_cli_digits two;
        if (!i)
            hada_cli_say(cli, "\nLeave-one-out, mean PSNR of held-out pairs in dB\n  %9s  %9s  %9s  %10s", "alpha",
                         "lambda", "one depth", "two depths");
        hada_cli_say(cli, "%s %9.3g  %9.3g  %9.2f  %10s%s", mark(row->chosen), row->alpha, row->lambda,
                     row->psnr_single, hada_cli_number(two, "%.2f", row->psnr_double), word(row->chosen));
        json_array_append_new(list,
                              score_json(row->alpha, row->lambda, row->psnr_single, row->psnr_double, row->chosen));
    }
}

static void print_outsides(hada_cli *cli, const hada_fit_scores *scores, const hada_model_info *info, json_t *list)
{
    const hada_fit_outside_score *row;
    for (size_t i = 0; (row = scores->outsides[i]); i++) {
        json_t *entry = score_json(info->alpha, info->lambda, row->psnr, NAN, row->chosen);
        if (!i)
            hada_cli_say(cli, "\nWeight of what filters make outside the window, on a few held-out pairs\n  %20s  %9s",
                         "outside", "one depth");
        hada_cli_say(cli, "%s %20.3g  %9.2f%s", mark(row->chosen), row->outside, row->psnr, word(row->chosen));
        json_object_set_new(entry, "outside", hada_cli_real(row->outside));
        json_array_append_new(list, entry);
    }
}

static void print_refinements(hada_cli *cli, const hada_fit_scores *scores, const hada_model_info *info, json_t *list)
{
    const hada_fit_refine_score *row;
    for (size_t i = 0; (row = scores->refinements[i]); i++) {
        json_t *entry = score_json(info->alpha, info->lambda, row->psnr_single, row->psnr_double, row->chosen);
        char steps[32] = "none";
        hada_cli_digits two;
        if (!i)
            hada_cli_say(cli, "\nDoes refinement pay? On a few held-out frames\n  %9s  %9s  %9s  %10s", "steps",
                         "variation", "one depth", "two depths");
        if (row->steps)
            snprintf(steps, sizeof steps, "%d", row->steps);
        hada_cli_say(cli, "%s %9s  %9.2g  %9.2f  %10s%s", mark(row->chosen), steps, row->tv, row->psnr_single,
                     hada_cli_number(two, "%.2f", row->psnr_double), word(row->chosen));
        json_object_set_new(entry, "refine_steps", json_integer(row->steps));
        HADA_CLI_SET(entry, {"refine_rho", row->rho}, {"refine_tv", row->tv});
        json_array_append_new(list, entry);
    }
}

static void print_scores(hada_cli *cli, const hada_fit_scores *scores, const hada_model *model)
{
    const hada_model_info *info = hada_model_get_info(model);
    json_t *list = json_array();
    print_filters(cli, scores, list);
    print_outsides(cli, scores, info, list);
    print_refinements(cli, scores, info, list);
    json_object_set_new(cli->document, "leave_one_out", list);
}

/* What the pairs said of their scenes. */
static void print_survey(hada_cli *cli, const hada_survey *survey)
{
    const int several = survey && survey->rows[0] && survey->rows[1];
    const hada_survey_row *row;
    json_t *list = json_array();
    if (several)
        hada_cli_say(cli, "Response of the scenes, unexplained share of held-out frames in %%\n  %9s  %13s  %14s",
                     "response", "exposed alike", "each by itself");
    for (size_t i = 0; survey && (row = survey->rows[i]); i++) {
        char name[HADA_RESPONSE_NAME];
        hada_response_name(name, row->response);
        if (several)
            hada_cli_say(cli, "%s %9s  %13.2f  %14.2f%s", mark(row->chosen), name, 100 * row->unexplained,
                         100 * row->unexplained_apart, word(row->chosen));
        json_array_append_new(list,
                              json_pack("{s:s, s:f, s:f, s:b}", "response", name, "unexplained", row->unexplained,
                                        "unexplained_exposed_apart", row->unexplained_apart, "chosen", row->chosen));
    }
    json_object_set_new(cli->document, "responses", list);
    json_object_set_new(cli->document, "exposed_apart", json_boolean(survey && survey->exposed));
}

void hada_cli_fit_tell_pairs(hada_cli *cli, const hada_dataset_info *info, const hada_model *model,
                             const hada_fit_report *report)
{
    json_t *pairs = json_array(), *left_out = json_array();
    for (int z = 0; z < info->depths; z++) {
        json_array_append_new(pairs, json_integer(report->pairs[z]));
        for (int i = 0; report->left_out && i < info->counts[z]; i++)
            if (report->left_out[z][i])
                json_array_append_new(left_out, hada_cli_json_text(info->files[z][i].raw));
    }
    const int spoilt = (int)json_array_size(left_out);
    json_object_set_new(cli->document, "pairs", pairs);
    json_object_set_new(cli->document, "left_out", left_out);
    print_survey(cli, report->survey);
    print_scores(cli, report->scores, model);
    char without[40] = "";
    if (spoilt)
        snprintf(without, sizeof without, ", %d of them left out", spoilt);
    hada_cli_say(cli, "\n%d pairs%s; at least %d for each of %d %s", info->pairs, without, info->least_pairs,
                 info->depths, info->depths == 1 ? "depth" : "depths");
}

void hada_cli_fit_tell_sums(hada_cli *cli, int files, const hada_model *model, const hada_fit_report *report)
{
    long long pairs = 0;
    for (int z = 0; z < hada_model_get_info(model)->depths; z++)
        pairs += report->pairs[z];
    hada_cli_say(cli,
                 "%lld pairs in %d file%s of sums; without pairs to leave out, alpha, lambda and refinement are those "
                 "given or the defaults",
                 pairs, files, files == 1 ? "" : "s");
}

void hada_cli_fit_tell_model(hada_cli *cli, const char *path, const hada_model *model, double seconds)
{
    static const char *const forms[] = {"", "complex", "split", "matched", "wiener"};
    const hada_model_info *info = hada_model_get_info(model);
    const char *boundary = info->boundary == HADA_BOUNDARY_PADDED ? "padded" : "circular";
    char size[16], dark[32] = "found per frame", refine[96] = "no refinement", response[HADA_RESPONSE_NAME];
    hada_cli_bytes(size, info->bytes);
    const int binned = info->downsample > 1, pattern = binned ? (int)info->sensor_mosaic : (int)info->mosaic;
    const char *mosaic = hada_enum_name(HADA_ENUM_MOSAIC, pattern);
    char pixels[64] = "";
    if (binned)
        hada_cli_append(pixels, sizeof pixels, " binned by %d", info->downsample);
    if (pattern)
        hada_cli_append(pixels, sizeof pixels, " of the mosaic %s", mosaic);
    hada_response_name(response, info->scene_response);
    if (info->dark != HADA_AUTO)
        snprintf(dark, sizeof dark, "%.4g", info->dark);
    if (info->refine_steps)
        snprintf(refine, sizeof refine,
                 info->refine_tv > 0 ? "%d refinement steps, total variation %.2g" : "%d refinement steps",
                 info->refine_steps, info->refine_tv);
    if (info->refine_steps && info->refine_share < 1)
        hada_cli_append(refine, sizeof refine, ", %.0f %% linear", 100 * (1 - info->refine_share));
    hada_cli_say(cli, "%s: %d %s, %dx%d frames%s, window %dx%d, %s, %s, scenes %s, dark level %s, %s, %s (%.1f s)",
                 path, info->depths, info->depths == 1 ? "depth" : "depths", info->raw_rows, info->raw_cols, pixels,
                 info->window_rows, info->window_cols, forms[info->form], boundary, response, dark, refine, size,
                 seconds);
    json_t *entry = json_pack("{s:o, s:s, s:s, s:i, s:[ii], s:[ii], s:[ii], s:i, s:b, s:I}", "file",
                              hada_cli_json_text(path), "form", forms[info->form], "boundary", boundary, "channels",
                              info->channels, "frame", info->raw_rows, info->raw_cols, "grid", info->grid_rows,
                              info->grid_cols, "window", info->window_rows, info->window_cols, "refine_steps",
                              info->refine_steps, "half", info->half, "bytes", (json_int_t)info->bytes);
    json_object_set_new(entry, "distances_mm", hada_cli_reals(info->distances_mm, info->depths));
    HADA_CLI_SET(entry, {"alpha", info->alpha}, {"lambda", info->lambda},
                 {"dark", info->dark == HADA_AUTO ? NAN : info->dark}, {"refine_tv", info->refine_tv},
                 {"refine_colour", info->refine_colour}, {"refine_ridge", info->refine_ridge},
                 {"refine_share", info->refine_share}, {"noise", info->noise});
    json_object_set_new(entry, "scene_response", json_string(response));
    json_object_set_new(entry, "mosaic", json_string(mosaic));
    if (binned)
        json_object_set_new(entry, "downsample", json_integer(info->downsample));
    if (info->positions)
        json_object_update_new(entry, json_pack("{s:i, s:i, s:f, s:f}", "components", info->components, "positions",
                                                info->positions, "lost", info->lost, "lost_single", info->lost_single));
    json_object_set_new(cli->document, "model", entry);
    json_object_set_new(cli->document, "seconds", json_real(seconds));
}
