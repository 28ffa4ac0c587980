#include "command.h"
#include "fit_settings.h"
#include "fit_sizes.h"
#include "folder.h"
#include "pairs.h"

#include <hadalens/fit.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Decibels by which refinement must lead so that linear filters are not worked on: more than judging them in the window
 * was seen to gain (docs/filters.md). */
#define ENOUGH_GAIN 3.0

typedef hada_cli_fit_settings settings;

#define AT(member) offsetof(settings, member)
static const hada_cli_option options[] = {
    {HADA_OPTION_GROUP, NULL, 0, NULL, "What to write", NULL, 0},
    {HADA_OPTION_TEXT, "output", 'o', "MODEL", "the model file to write (safetensors)", NULL, AT(output)},
    {HADA_OPTION_FLAG, "half", 0, NULL, "store the filters in half precision: half the size", NULL, AT(half)},

    {HADA_OPTION_GROUP, NULL, 0, NULL, "What to learn from", NULL, 0},
    {HADA_OPTION_TEXT, "psf", 0, "PSF.tif", "make the model from point spread functions instead of pairs",
     "A page per depth, near to far, the optical axis at pixel (height/2, width/2). No DATASET is needed then.",
     AT(psf)},
    {HADA_OPTION_TEXT, "distances", 0, "LIST", "the distances of the pages of --psf in mm, such as 100,200,400",
     "Needed where the file does not say them.", AT(distances)},
    {HADA_OPTION_TEXT, "sums", 0, "FILE", "also save the sums over the pairs",
     "A later fit adds to them with --merge, without the pairs.", AT(sums)},
    {HADA_OPTION_TEXTS, "merge", 0, "FILE", "add saved sums; may be given more than once",
     "They must come from the same camera and depths. So pairs can be added later, or from several machines.",
     AT(merge)},
    {HADA_OPTION_FLAG, "skip-incomplete", 0, NULL, "leave out files that have no partner, instead of refusing", NULL,
     AT(skip_incomplete)},

    {HADA_OPTION_GROUP, NULL, 0, NULL, "How", NULL, 0},
    {HADA_OPTION_CHOICE, "form", 0, "complex|split|matched|wiener", "how filters act on a frame's spectrum",
     "From pairs: complex (default), or split, Eq. 3 of Tian and Yang (2022) to the letter. From --psf: wiener "
     "(default) or matched, their Eq. 2.",
     AT(form)},
    {HADA_OPTION_CHOICE, "boundary", 0, "circular|padded", "whether light beyond the sensor comes back in, or is lost",
     "Without it: what camera.json says; without that, padded, as on a real sensor.", AT(boundary)},
    {HADA_OPTION_SIZE, "window", 0, "HxW", "field of view, where the scenes or the PSF are as large as the frame", NULL,
     AT(window)},
    {HADA_OPTION_TEXT, "dark", 0, "FILE|auto|none|LEVEL", "dark level of the raw frames (default: none)",
     "Taken off every pixel. FILE: the mean of a dark frame; auto: each frame's own, its darkest percent; LEVEL: a "
     "share of full scale. The model remembers it.",
     AT(dark)},
    {HADA_OPTION_REAL, "psf-dark", 0, "LEVEL", "dark level of the PSF (default: its own background)", NULL,
     AT(psf_dark)},
    {HADA_OPTION_FLAG, "colour", 0, NULL, "a grey PSF serves red, green and blue alike", NULL, AT(colour)},
    {HADA_OPTION_REAL, "alpha", 0, "A", "weight of the other depths' light (default: by leave-one-out)", NULL,
     AT(alpha)},
    {HADA_OPTION_REAL, "lambda", 0, "L", "regularisation (default: by leave-one-out)", NULL, AT(lambda)},
    {HADA_OPTION_REAL, "outside", 0, "W",
     "weight of what a filter makes outside the window, 0.01 to 1 (default: by leave-one-out, or 1)",
     "Below 1 filters are judged in the window, which takes several looks at every pair; with 1 the fit is one pass. "
     "Without it the weight is chosen unless refinement, which does without the filters, is found to be clearly better.",
     AT(outside)},
    {HADA_OPTION_TEXT, "refine", 0, "N|auto|0", "refinement steps that the model recommends (default: auto)",
     "auto measures by leave-one-out whether refinement pays for this camera.", AT(refine)},
    {HADA_OPTION_TEXT, "refine-tv", 0, "W|auto|0", "weight of total variation in refinement (default: auto)",
     "auto compares a few weights by leave-one-out where the steps are chosen too; otherwise, and from a PSF, none.",
     AT(refine_tv)},
    {HADA_OPTION_CHOICE, "psf-sign", 0, "nonnegative|free", "what is known of the camera's point spread functions",
     "nonnegative (default): light adds up, so they are nowhere negative; this fills in frequencies of which the pairs "
     "say too little. free: from the pairs alone. Refinement and the search for occupied depths use them.",
     AT(psf_sign)},
    {HADA_OPTION_FLAG, "no-leave-one-out", 0, NULL,
     "do not try: alpha 0, lambda 1e-4, outside 1 and no refinement unless given", NULL, AT(no_leave_one_out)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    set->dark = "none";
    set->refine = set->refine_tv = "auto";
    set->alpha = set->lambda = set->outside = set->psf_dark = -1;
}

/* Filters first, then, on a few held-out frames, whether refinement pays. */
static void print_rows(hada_cli *cli, const hada_fit_row *rows, size_t count)
{
    json_t *list = json_array();
    for (size_t i = 0; i < count; i++) {
        const hada_fit_row *row = &rows[i];
        int trial = row->refine_rho > 0;
        char steps[32] = "none", two[32] = "-";
        if (row->outside > 0 && (!i || !(rows[i - 1].outside > 0)))
            hada_cli_say(cli, "\nWeight of what filters make outside the window, on a few held-out pairs\n  %20s  %9s",
                         "outside", "one depth");
        if (!i && !trial && !(row->outside > 0))
            hada_cli_say(cli, "\nLeave-one-out, mean PSNR of held-out pairs in dB\n  %9s  %9s  %9s  %10s", "alpha",
                         "lambda", "one depth", "two depths");
        if (trial && (!i || !(rows[i - 1].refine_rho > 0)))
            hada_cli_say(cli, "\nDoes refinement pay? On a few held-out frames\n  %9s  %9s  %9s  %10s", "steps",
                         "variation", "one depth", "two depths");
        if (row->refine_steps)
            snprintf(steps, sizeof steps, "%d", row->refine_steps);
        if (isfinite(row->psnr_double))
            snprintf(two, sizeof two, "%.2f", row->psnr_double);
        const char *mark = row->chosen ? "*" : " ", *chosen = row->chosen ? "  chosen" : "";
        if (row->outside > 0)
            hada_cli_say(cli, "%s %20.3g  %9.2f%s", mark, row->outside, row->psnr_single, chosen);
        else if (trial)
            hada_cli_say(cli, "%s %9s  %9.2g  %9.2f  %10s%s", mark, steps, row->refine_tv, row->psnr_single, two,
                         chosen);
        else
            hada_cli_say(cli, "%s %9.3g  %9.3g  %9.2f  %10s%s", mark, row->alpha, row->lambda, row->psnr_single, two,
                         chosen);
        json_t *entry = json_pack("{s:f, s:f, s:i, s:b}", "alpha", row->alpha, "lambda", row->lambda, "refine_steps",
                                  row->refine_steps, "chosen", row->chosen);
        json_object_set_new(entry, "outside", row->outside > 0 ? hada_cli_real(row->outside) : json_null());
        json_object_set_new(entry, "refine_rho", hada_cli_real(row->refine_rho));
        json_object_set_new(entry, "refine_tv", hada_cli_real(row->refine_tv));
        json_object_set_new(entry, "psnr_one_depth", hada_cli_real(row->psnr_single));
        json_object_set_new(entry, "psnr_two_depths", hada_cli_real(row->psnr_double));
        json_array_append_new(list, entry);
    }
    json_object_set_new(cli->document, "leave_one_out", list);
}

/* By how much the trial of refinement found it better than the linear filters, in decibels, one depth occupied; 0 where
 * it was not tried. */
static double refinement_gain(const hada_fit_row *rows, size_t count)
{
    double none = NAN, gain = 0;
    for (size_t i = 0; i < count; i++) {
        if (!(rows[i].refine_rho > 0))
            continue;
        if (!isfinite(none))
            none = rows[i].psnr_single;
        if (rows[i].chosen)
            gain = rows[i].psnr_single - none;
    }
    return isfinite(gain) ? gain : 0;
}

/* Solves; filters are judged in the window where that is asked for, or where they are what the model will use:
 * judging them gains a decibel or two, and takes most of the time of a fit. */
static hada_status solve(hada_cli *cli, const settings *set, const hada_cli_dataset *data, hada_fitter *fitter,
                         hada_model **model, hada_fit_row **rows, size_t *row_count, hada_error *err)
{
    /* merged sums bring no pairs to look at again */
    const int can = !set->merge.count && !(set->no_leave_one_out && set->outside < 0);
    /* refinement is tried where its steps are not given; without that there is nothing to learn before judging */
    if (!can || (set->outside < 0 && !strcmp(set->refine, "auto"))) {
        hada_status status = hada_fitter_finish(fitter, model, rows, row_count, err);
        if (status || !can || refinement_gain(*rows, *row_count) > ENOUGH_GAIN)
            return status;
        hada_model_destroy(model);
        free(*rows);
        *rows = NULL;
    }
    hada_status status = hada_cli_pairs_judge(cli, fitter, data, err);
    return status ? status : hada_fitter_finish(fitter, model, rows, row_count, err);
}

static hada_status learn(hada_cli *cli, const settings *set, const hada_cli_dataset *data, hada_fitter *fitter,
                         hada_model **model, hada_error *err)
{
    hada_fit_row *rows = NULL;
    size_t row_count = 0;
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < set->merge.count; i++) {
        status = hada_fitter_load_sums(fitter, set->merge.items[i], err);
        if (status)
            hada_cli_prefix(err, "%s: ", set->merge.items[i]);
    }
    if (!status)
        status = hada_cli_pairs_add(cli, fitter, data, err);
    if (!status && set->sums)
        status = hada_fitter_save_sums(fitter, set->sums, err);
    /* One pair alone cannot be left out. */
    if (!status && !set->no_leave_one_out && (data->least_pairs > 1 || set->merge.count))
        status = hada_cli_pairs_score(cli, fitter, data, err);
    if (!status)
        status = solve(cli, set, data, fitter, model, &rows, &row_count, err);
    if (!status) {
        json_t *pairs = json_array();
        for (int z = 0; z < data->depths; z++)
            json_array_append_new(pairs, json_integer(hada_fitter_pairs(fitter, z)));
        json_object_set_new(cli->document, "pairs", pairs);
        print_rows(cli, rows, row_count);
    }
    free(rows);
    return status;
}

static hada_status fit_pairs(hada_cli *cli, const settings *set, const char *folder, hada_context *context,
                             hada_model **model, hada_error *err)
{
    hada_cli_dataset data;
    hada_fitter *fitter = NULL;
    hada_fit_options fit;
    char held[16];
    hada_fit_options_init(&fit);
    hada_status status = hada_cli_dataset_scan(&data, folder, set->skip_incomplete, err);
    if (status)
        return status;
    if (data.incomplete)
        hada_cli_warn(cli, "left out: %s", data.incomplete_text);
    if (data.least_pairs == 1)
        hada_cli_warn(cli,
                      "a depth has a single pair: nothing can be held out there, so the model is a guess; show the "
                      "camera about eight scenes per depth");
    fit.alpha = set->alpha;
    fit.nonnegative = set->psf_sign != 2;
    fit.lambda = set->lambda;
    fit.outside = set->outside;
    fit.form = set->form == 2 ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX;
    fit.boundary = hada_cli_fit_boundary(cli, set->boundary, &data);
    status = hada_cli_read_refine(set->refine, &fit.refine_steps, err);
    if (!status)
        status = hada_cli_read_refine_tv(set->refine_tv, &fit.refine_tv, err);
    if (!status)
        status = hada_cli_fit_sizes(&fit, &data, set->window, err);
    if (!status)
        status = hada_cli_fit_dark(set->dark, &fit.dark, err);
    if (!status)
        status = hada_fitter_create(&fitter, context, &fit, err);
    if (!status) {
        hada_cli_detail(cli, "the sums take %s on the device", hada_cli_bytes(held, hada_fitter_bytes(fitter)));
        status = learn(cli, set, &data, fitter, model, err);
    }
    if (!status)
        hada_cli_say(cli, "\n%d pairs; at least %d for each of %d %s", data.pairs, data.least_pairs, data.depths,
                     data.depths == 1 ? "depth" : "depths");
    hada_fitter_destroy(&fitter);
    hada_cli_dataset_free(&data);
    return status;
}

/* A model from saved sums alone: nothing can be left out, so what is not given takes its stated default. */
static hada_status fit_sums(hada_cli *cli, const settings *set, hada_context *context, hada_model **model,
                            hada_error *err)
{
    hada_fitter *fitter = NULL;
    hada_fit_options choices;
    hada_fit_options_init(&choices);
    choices.alpha = set->alpha;
    choices.nonnegative = set->psf_sign != 2;
    choices.lambda = set->lambda;
    choices.form = set->form == 2 ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX;
    hada_status status = hada_cli_read_refine(set->refine, &choices.refine_steps, err);
    if (!status)
        status = hada_cli_read_refine_tv(set->refine_tv, &choices.refine_tv, err);
    if (!status)
        status = hada_fitter_create_from_sums(&fitter, context, set->merge.items[0], &choices, err);
    for (int i = 1; !status && i < set->merge.count; i++)
        status = hada_fitter_load_sums(fitter, set->merge.items[i], err);
    if (!status && set->sums)
        status = hada_fitter_save_sums(fitter, set->sums, err);
    if (!status)
        status = hada_fitter_finish(fitter, model, NULL, NULL, err);
    if (!status) {
        int64_t pairs = 0;
        for (int z = 0; z < hada_model_get_info(*model)->depths; z++)
            pairs += hada_fitter_pairs(fitter, z);
        hada_cli_say(cli,
                     "%lld pairs in %d file%s of sums; without pairs to leave out, alpha, lambda and refinement are "
                     "those given or the defaults",
                     (long long)pairs, set->merge.count, set->merge.count == 1 ? "" : "s");
    }
    hada_fitter_destroy(&fitter);
    return status;
}

static hada_status to_half(hada_model **model, hada_error *err)
{
    hada_model *half = NULL;
    hada_status status = hada_model_to_half(&half, *model, err);
    if (status)
        return status;
    hada_model_destroy(model);
    *model = half;
    return HADA_OK;
}

static void print_model(hada_cli *cli, const settings *set, const hada_model *model, double seconds)
{
    static const char *const forms[] = {"", "complex", "split", "matched", "wiener"};
    const hada_model_info *info = hada_model_get_info(model);
    const char *boundary = info->boundary == HADA_BOUNDARY_PADDED ? "padded" : "circular";
    char size[16], dark[32] = "found per frame", refine[64] = "no refinement";
    hada_cli_bytes(size, info->bytes);
    if (info->dark >= 0)
        snprintf(dark, sizeof dark, "%.4g", info->dark);
    if (info->refine_steps)
        snprintf(refine, sizeof refine,
                 info->refine_tv > 0 ? "%d refinement steps, total variation %.2g" : "%d refinement steps",
                 info->refine_steps, info->refine_tv);
    hada_cli_say(cli, "%s: %d %s, %dx%d frames, window %dx%d, %s, %s, dark level %s, %s, %s (%.1f s)", set->output,
                 info->depths, info->depths == 1 ? "depth" : "depths", info->raw_rows, info->raw_cols,
                 info->window_rows, info->window_cols, forms[info->form], boundary, dark, refine, size, seconds);
    json_t *entry = json_pack("{s:s, s:s, s:s, s:i, s:[ii], s:[ii], s:[ii], s:i, s:b, s:I}", "file", set->output,
                              "form", forms[info->form], "boundary", boundary, "channels", info->channels, "frame",
                              info->raw_rows, info->raw_cols, "grid", info->grid_rows, info->grid_cols, "window",
                              info->window_rows, info->window_cols, "refine_steps", info->refine_steps, "half",
                              info->half, "bytes", (json_int_t)info->bytes);
    json_object_set_new(entry, "distances_mm", hada_cli_reals(info->distances_mm, info->depths));
    json_object_set_new(entry, "alpha", hada_cli_real(info->alpha));
    json_object_set_new(entry, "lambda", hada_cli_real(info->lambda));
    json_object_set_new(entry, "dark", info->dark >= 0 ? hada_cli_real(info->dark) : json_null());
    json_object_set_new(entry, "refine_tv", hada_cli_real(info->refine_tv));
    json_object_set_new(entry, "noise", hada_cli_real(info->noise));
    json_object_set_new(cli->document, "model", entry);
    json_object_set_new(cli->document, "seconds", json_real(seconds));
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    hada_context *context = NULL;
    hada_model *model = NULL;
    double start = hada_cli_seconds();
    if (count > 1)
        return hada_cli_usage(cli, "one DATASET at a time; '%s' is too many (--merge adds sums of others)",
                              arguments[1]);
    if (!count && !set->psf && !set->merge.count)
        return hada_cli_usage(cli,
                              "say what to learn from: a DATASET folder, --psf PSF.tif, or saved sums with --merge");
    if (count && set->psf)
        return hada_cli_usage(cli, "either the pairs of %s or --psf %s, not both", arguments[0], set->psf);
    if (!set->output)
        return hada_cli_usage(cli, "say where the model shall be written, with -o MODEL");
    if (set->psf && (set->form == 1 || set->form == 2))
        return hada_cli_usage(cli, "forms complex and split are learned from pairs; with --psf take wiener or matched");
    if (set->psf && set->psf_sign)
        return hada_cli_usage(cli, "--psf-sign belongs to pairs; what --psf gives is made non-negative anyway");
    if (set->outside >= 0 && set->psf)
        return hada_cli_usage(cli, "--outside belongs to pairs, not to --psf");
    if (set->outside >= 0 && set->outside < 1 && set->merge.count)
        return hada_cli_usage(cli, "--outside below 1 looks at every pair several times, and sums (--merge) have none; "
                                   "give all pairs in one DATASET");
    if (set->psf && (set->sums || set->merge.count))
        return hada_cli_usage(cli, "--sums and --merge belong to pairs, not to --psf");
    hada_status status = hada_cli_check_output(set->output, &err);
    if (!status && set->sums)
        status = hada_cli_check_output(set->sums, &err);
    if (!status && !set->psf && set->form >= 3)
        return hada_cli_usage(cli, "forms matched and wiener need a PSF: hadalens fit --psf %s/psf.tif -o %s",
                              count ? arguments[0] : "DATASET", set->output);
    if (!status)
        status = hada_cli_open(cli, &context, &err);
    if (!status)
        status = set->psf ? hada_cli_fit_psf(set, set->psf, context, &model, &err)
                 : count  ? fit_pairs(cli, set, arguments[0], context, &model, &err)
                          : fit_sums(cli, set, context, &model, &err);
    if (!status && set->half)
        status = to_half(&model, &err);
    if (!status)
        status = hada_model_save(model, set->output, &err);
    if (!status)
        print_model(cli, set, model, hada_cli_seconds() - start);
    hada_model_destroy(&model);
    hada_cli_close(cli, &context);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens fit camera -o camera.model", "learns from all pairs of the folder camera."},
    {"hadalens fit --psf psf.tif --distances 250 --dark auto -o hand.model", "from one measured PSF."},
    {"hadalens fit monday -o m.model --sums monday.sums", "keeps the sums,"},
    {"hadalens fit tuesday -o both.model --merge monday.sums", "and adds to them."},
    {"hadalens fit --merge a.sums --merge b.sums -o all.model", "merges what two machines have added up."},
    {0},
};

const hada_cli_command hada_cli_fit = {
    .name = "fit",
    .summary = "learn a camera from pairs of raw frame and known scene, or from its PSF",
    .synopsis =
        "DATASET -o MODEL [OPTION...] | --psf PSF.tif -o MODEL [OPTION...] | --merge FILE... -o MODEL [OPTION...]",
    .description =
        "Each frequency of each depth is a least-squares problem of its own, so the filters are learned exactly, in "
        "one "
        "pass, without random numbers. Memory does not grow with the number of pairs.\n\n"
        "DATASET is a folder with a folder per depth named z<distance>mm, each with raw/NAME.tif and scene/NAME.tif of "
        "the same names ('hadalens simulate' writes one). About eight pairs per depth do.\n\n"
        "A second pass leaves out one pair after the other, and so chooses alpha, lambda and whether refinement pays; "
        "the table that is printed shows it.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
};
