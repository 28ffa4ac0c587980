#include "option.h"
#include "shared.h"

#include <hadalens/folder.h>
#include <hadalens/task_fit.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

typedef struct settings {
    hada_cli_common common;
    hada_fit_options fit;
    hada_fit_task task;
    hada_psf_options psf_options;
    hada_psf_task psf_task;
    const char *output, *psf, *dark, *flat, *distances, *response, *frame_encoding, *frame, *psf_distance, *colours;
    hada_cli_texts merge;
    int form;     /* 0: not given */
    int psf_sign; /* 1: nowhere negative, 0: free, -1: not given */
    int skip_incomplete, no_leave_one_out, registers;
    int window[2];
} settings;

#define AT(member)          HADA_CLI_AT(settings, member)
#define ONE_OF(member, ...) HADA_CLI_ONE_OF(settings, member, __VA_ARGS__)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("What to write"),
    {HADA_OPTION_TARGET, "output", 'o', "MODEL", "the model file to write (safetensors)", NULL, AT(output)},
    {HADA_OPTION_FLAG, "half", 0, NULL, "store the filters in half precision: half the size", NULL, AT(task.half)},

    HADA_CLI_GROUP("What to learn from"),
    {HADA_OPTION_TEXT, "psf", 0, "PSF", "make the model from point spread functions instead of pairs",
     "A file with a page per depth, near to far; files, or a folder with files or folders named such as z100mm, whose "
     "captures are averaged. The optical axis is at pixel (height/2, width/2). PSFs that vary over the field: a list "
     "(.csv) with lines 'file,x_px,y_px[,distance_mm]', or a folder with such a list, positions.csv.",
     AT(psf)},
    {HADA_OPTION_COUNT, "components", 0, "K", "of PSFs that vary over the field, 1 to 16 (default: by --explained)",
     "1: their mean, for methods that take PSFs for the same everywhere.", AT(psf_options.components)},
    {HADA_OPTION_REAL, "explained", 0, "SHARE", "of these PSFs' energy, by as few components (default: 0.99)", NULL,
     AT(psf_options.explained)},
    {HADA_OPTION_TEXT, "distances", 0, "LIST", "the distances of the depths of --psf in mm, such as 100,200,400",
     "Needed for several unless files, names or a list beside them say them. 2:0.05:40: 40, from 2 mm on, 0.05 mm apart.",
     AT(distances)},
    {HADA_OPTION_COUNT, "every", 0, "N", "take each N-th page of --psf, from the first on (default: 1)",
     "The distances are those of all pages.", AT(psf_task.every)},
    {HADA_OPTION_FLAG, "recentre", 0, NULL, "take off what a bead or stage drifted over the depths of --psf",
     "Of four depths or more: their shifts, without what an axis beside the middle explains.", AT(psf_task.recentre)},
    {HADA_OPTION_REAL, "mask-distance", 0, "MM", "from mask to sensor: --distances are made from one PSF, magnified",
     NULL, AT(psf_task.mask_distance_mm)},
    {HADA_OPTION_TEXT, "psf-distance", 0, "LIST", "where PSFs were taken, if --distances shall be made from them",
     "Two or more give the mask's distance as well.", AT(psf_distance)},
    {HADA_OPTION_TEXT, "frame", 0, "HxW|FILE", "with --psf: the size of the camera's frames (default: the PSF's)",
     "FILE: a frame, which says what it holds as well: grey, colour, or a mosaic.", AT(frame)},
    {HADA_OPTION_TARGET, "sums", 0, "FILE", "also save the sums over the pairs",
     "A later fit adds to them with --merge, without the pairs.", AT(task.save_sums)},
    {HADA_OPTION_FLAG, "resume", 0, NULL, "with --sums: go on after an interruption",
     "Pairs that FILE holds, or the files FILE.N-of-N that are saved on the way, are not added up again.",
     AT(task.resume)},
    {HADA_OPTION_REAL, "save-seconds", 0, "S", "with --sums: seconds between saves on the way (default: 60)", NULL,
     AT(task.save_seconds)},
    {HADA_OPTION_TEXTS, "merge", 0, "FILE", "add saved sums; may be given more than once",
     "They must come from the same camera and depths. So pairs can be added later, or from several machines.",
     AT(merge)},
    {HADA_OPTION_TEXT, "scene-response", 0, "auto|linear|srgb|P", "how the scenes are encoded (default: auto)",
     "Frames are linear in light, scenes often are photographs for a display: srgb, or a power P such as 2.2, light = "
     "value^P. Scenes are brought to light before anything is learned, and the model remembers it. auto: what leaves "
     "least of held-out frames unexplained; linear unless there is evidence.",
     AT(response)},
    {HADA_OPTION_CHOICE, "exposure", 0, "auto|same|each",
     "whether frames of a depth were exposed alike (default: auto)",
     "each: every pair has an exposure of its own, as with a camera that sets it by itself; it is found. auto: each "
     "where that explains most of what is unexplained otherwise.",
     ONE_OF(task.exposure, HADA_EXPOSURE_AUTO, HADA_EXPOSURE_SAME, HADA_EXPOSURE_EACH)},
    {HADA_OPTION_TEXT, "colour-matrix", 0, "auto|none|M", "what the sensor sees of the scenes' colours (default: auto)",
     "A sensor's red sees some of a display's green. M: nine numbers, the shares of red, green and blue that its red, "
     "then its green and its blue hold. auto: found, from pairs in full colour. Results have the scenes' colours.",
     AT(colours)},
    {HADA_OPTION_CHOICE, "bayer", 0, "auto|none|rggb|bggr|grbg|gbrg",
     "colour filter mosaic of raw frames of one channel (default: auto)",
     "The colours of the first two rows and columns. auto: as raw files say (DNG), else none. Each colour's transfer "
     "function is learned from the pixels that hold it. The model remembers the pattern; with --psf too.",
     ONE_OF(fit.mosaic, HADA_MOSAIC_AUTO, HADA_MOSAIC_NONE, HADA_MOSAIC_RGGB, HADA_MOSAIC_BGGR, HADA_MOSAIC_GRBG,
            HADA_MOSAIC_GBRG)},
    {HADA_OPTION_COUNT, "downsample", 0, "N", "make one pixel of N x N pixels of frames, PSFs and scenes (default: 1)",
     "Their mean; of a mosaic each colour's, N even. The model does so with frames of that size.", AT(fit.downsample)},
    {HADA_OPTION_FLAG, "register", 0, NULL, "find how scenes stand on the sensor, and put them right first",
     "For pictures that a display showed; as 'hadalens register' does, which has more options. --window is the size of "
     "the registered scenes then.",
     AT(registers)},
    {HADA_OPTION_FLAG, "all-pairs", 0, NULL, "take pairs that contradict the others, too",
     "Without it, frames that are cut off or belong to another scene are left out with a note: the others of their depth "
     "explain each other better without them. Scenes that are cut off at white are filled in from their frames.",
     AT(task.all_pairs)},
    {HADA_OPTION_FLAG, "skip-incomplete", 0, NULL, "leave out files that have no partner, instead of refusing", NULL,
     AT(skip_incomplete)},

    HADA_CLI_GROUP("How"),
    {HADA_OPTION_CHOICE, "form", 0, "complex|split|matched|wiener", "how filters act on a frame's spectrum",
     "From pairs: complex (default), or split, Eq. 3 of Tian and Yang (2022) to the letter. From --psf: wiener "
     "(default) or matched, their Eq. 2.",
     ONE_OF(form, HADA_FORM_COMPLEX, HADA_FORM_SPLIT, HADA_FORM_MATCHED, HADA_FORM_WIENER)},
    {HADA_OPTION_CHOICE, "boundary", 0, "circular|padded", "whether light beyond the sensor comes back in, or is lost",
     "Without it: circular where camera.json says so, else found from the pairs, with the smallest grid that serves. "
     "padded: on a grid that holds all light.",
     ONE_OF(task.boundary, HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED)},
    {HADA_OPTION_SIZE, "window", 0, "HxW", "field of view, where the scenes or the PSF are as large as the frame", NULL,
     AT(window)},
    {HADA_OPTION_TEXT, "dark", 0, "FILE|auto|none|LEVEL",
     "dark level of the raw frames (default: found from the pairs; none for a PSF)",
     "Taken off every pixel. FILE: a dark frame of the camera; auto: each frame's own, its darkest percent; LEVEL: a "
     "share of full scale. The model remembers it.",
     AT(dark)},
    {HADA_OPTION_TEXT, "flat", 0, "FILE", "divide raw frames by a flat frame, and PSFs that are as large",
     "A frame of the camera's sensor evenly lit, without a mask. --dark is taken off both. The model remembers it.",
     AT(flat)},
    {HADA_OPTION_TEXT, "frame-encoding", 0, "auto|linear|srgb|P",
     "how values of raw frames and PSFs stand for light (default: auto)",
     "auto: as their files say, which is sRGB for JPEG files, or as explains the pairs: sRGB or linear. The model keeps it.",
     AT(frame_encoding)},
    {HADA_OPTION_REAL, "psf-dark", 0, "LEVEL", "dark level of the PSF (default: its own background)", NULL,
     AT(psf_options.psf_dark)},
    {HADA_OPTION_REAL, "psf-gate", 0, "K", "set to 0 what is below K deviations of the PSF's noise (default: 4)", NULL,
     AT(psf_options.psf_gate)},
    {HADA_OPTION_COUNT, "psf-taper", 0, "PIXELS", "let a PSF that reaches its borders fade out towards them", NULL,
     AT(psf_options.psf_taper)},
    {HADA_OPTION_CHOICE, "turn", 0, "none|180|mirror|flip|90|270|transpose",
     "how the PSF is turned about its axis (default: none)", "90 and 270: degrees to the right.",
     ONE_OF(psf_options.turn, HADA_TURN_NONE, HADA_TURN_180, HADA_TURN_MIRROR, HADA_TURN_FLIP, HADA_TURN_90,
            HADA_TURN_270, HADA_TURN_TRANSPOSE)},
    {HADA_OPTION_FLAG, "colour", 0, NULL, "a grey PSF serves red, green and blue alike", NULL, AT(psf_task.colour)},
    {HADA_OPTION_REAL, "alpha", 0, "A", "weight of the other depths' light (default: by leave-one-out)", NULL,
     AT(fit.alpha)},
    {HADA_OPTION_REAL, "lambda", 0, "L", "regularisation (default: by leave-one-out)", NULL, AT(fit.lambda)},
    {HADA_OPTION_REAL, "outside", 0, "W",
     "weight of what a filter makes outside the window, 0.01 to 1 (default: by leave-one-out, or 1)",
     "Below 1 filters are judged in the window, which takes several looks at every pair; with 1 the fit is one pass. "
     "Without it the weight is chosen unless refinement, which does without the filters, is found to be clearly better.",
     AT(fit.outside)},
    {HADA_OPTION_PASSES, "crop-passes", 0, "N|auto|0",
     "iterations with which transfer functions are learned where the sensor crops (default: auto)",
     "With the boundary padded, light that leaves the sensor is missing in every pair; each iteration looks at all of "
     "them. auto: 15, fewer where nothing leaves. 0: one pass, without it. Merged sums cannot have it.",
     AT(fit.crop_passes)},
    {HADA_OPTION_PASSES, "refine", 0, "N|auto|0", "refinement steps that the model recommends (default: auto)",
     "auto measures by leave-one-out whether refinement pays for this camera.", AT(fit.refine_steps)},
    {HADA_OPTION_WEIGHT, "refine-tv", 0, "W|auto|0", "weight of total variation in refinement (default: auto)",
     "auto compares a few weights by leave-one-out where the steps are chosen too; otherwise none. From a PSF, auto finds "
     "the weight from each frame.",
     AT(fit.refine_tv)},
    {HADA_OPTION_WEIGHT, "refine-colour", 0, "K|auto",
     "in total variation, how much heavier differences of colour are (default: auto)",
     "1 to 16. auto compares a few by leave-one-out where the weight is chosen too, and is 1.5 otherwise.",
     ONE_OF(fit.refine_colour, 1, 16)},
    {HADA_OPTION_WEIGHT, "refine-ridge", 0, "S|auto|0",
     "with total variation: strength of the learned regulariser in the last steps (default: auto)",
     "The last steps use filters that were learned from photographs, in place of total variation. S scales the noise that "
     "they take off. auto compares none, 0.7, 1 and 1.4 by leave-one-out where the weight is chosen too, and is 1 "
     "otherwise.",
     ONE_OF(fit.refine_ridge, 0, 100)},
    {HADA_OPTION_CHOICE, "psf-sign", 0, "nonnegative|free", "what is known of the camera's point spread functions",
     "nonnegative (default): light adds up, so they are nowhere negative; this fills in frequencies of which the pairs "
     "say too little. free: from the pairs alone. Refinement and the search for occupied depths use them.",
     ONE_OF(psf_sign, 1, 0)},
    {HADA_OPTION_FLAG, "no-leave-one-out", 0, NULL,
     "do not try: alpha 0, lambda 1e-4, outside 1 and no refinement unless given", NULL, AT(no_leave_one_out)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    set->frame_encoding = "auto";
    set->response = "auto";
    hada_fit_options_init(&set->fit);
    hada_fit_task_init(&set->task);
    hada_psf_options_init(&set->psf_options);
    hada_psf_task_init(&set->psf_task);
    set->psf_sign = -1;
    set->fit.mosaic = HADA_MOSAIC_AUTO;
}

/* What is printed and put into the document. */

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

static void fit_tell_pairs(hada_cli *cli, const hada_dataset_info *info, const hada_model *model,
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

static void fit_tell_sums(hada_cli *cli, int files, const hada_model *model, const hada_fit_report *report)
{
    long long pairs = 0;
    for (int z = 0; z < hada_model_get_info(model)->depths; z++)
        pairs += report->pairs[z];
    hada_cli_say(cli,
                 "%lld pairs in %d file%s of sums; without pairs to leave out, alpha, lambda and refinement are those "
                 "given or the defaults",
                 pairs, files, files == 1 ? "" : "s");
}

static void fit_tell_model(hada_cli *cli, const char *path, const hada_model *model, double seconds)
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
        snprintf(dark, sizeof dark, "%.4g%s", info->dark, info->dark_frame ? " and a dark frame" : "");
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
    if (info->frame_encoding != 0.0) {
        hada_response_name(response, info->frame_encoding);
        json_object_set_new(entry, "frame_encoding", json_string(response));
    }
    json_object_set_new(entry, "mosaic", json_string(mosaic));
    if (info->colour_matrix[0] != 0.0)
        json_object_set_new(entry, "colour_matrix", hada_cli_reals(info->colour_matrix, 9));
    if (binned)
        json_object_set_new(entry, "downsample", json_integer(info->downsample));
    if (info->positions)
        json_object_update_new(entry, json_pack("{s:i, s:i, s:f, s:f}", "components", info->components, "positions",
                                                info->positions, "lost", info->lost, "lost_single", info->lost_single));
    json_object_set_new(cli->document, "model", entry);
    json_object_set_new(cli->document, "seconds", json_real(seconds));
}

/* What files do not say. */
static hada_mosaic settled(hada_mosaic mosaic)
{
    return mosaic == HADA_MOSAIC_AUTO ? HADA_MOSAIC_NONE : mosaic;
}

/* Puts the scenes right; their window is that of the fit. */
static hada_status register_scenes(hada_cli *cli, hada_dataset *data, hada_fit_options *fit, hada_error *err)
{
    hada_register_task task;
    hada_register_report *report = NULL;
    hada_status status = HADA_OK;
    hada_register_task_init(&task);
    task.window_rows = fit->window_rows;
    task.window_cols = fit->window_cols;
    task.monitor = &cli->monitor;
    HADA_TRY_OR_DONE(hada_register_run(&report, data, &task, err));
    hada_cli_tell_registered(cli, data, report);
    HADA_TRY_OR_DONE(hada_register_place(report, data, &task, NULL, NULL, err));
    fit->window_rows = fit->window_cols = 0;
done:
    hada_register_report_destroy(&report);
    return status;
}

/* From a data set's pairs, or (folder NULL) from saved sums. */
static hada_status fit_pairs(hada_cli *cli, const settings *set, const char *folder, hada_context *context,
                             hada_model **model, hada_error *err)
{
    hada_dataset *data = NULL;
    hada_fit_report *report = NULL;
    hada_dataset_options scan;
    hada_image flat = {0}, dark = {0};
    hada_fit_options fit = set->fit;
    hada_fit_task task = set->task;
    hada_status status = HADA_OK;
    hada_dataset_options_init(&scan);
    scan.skip_incomplete = set->skip_incomplete;
    scan.mosaic = set->fit.mosaic;
    scan.downsample = set->fit.downsample;
    fit.mosaic = settled(set->fit.mosaic);
    fit.nonnegative = set->psf_sign != 0;
    fit.leave_one_out = !set->no_leave_one_out;
    fit.form = set->form ? (hada_form)set->form : HADA_FORM_COMPLEX;
    fit.window_rows = set->window[0] / set->fit.downsample;
    fit.window_cols = set->window[1] / set->fit.downsample;
    task.fit = &fit;
    task.merge = set->merge.items;
    task.merge_count = set->merge.count;
    fit.communicator = hada_cli_communicator(cli);
    task.monitor = &cli->monitor;
    HADA_TRY_OR_DONE(hada_response_from_name(&fit.scene_response, set->response, err));
    HADA_TRY_OR_DONE(hada_cli_read_colours(set->colours, fit.colour_matrix, &fit.find_colours, err));
    if (folder) {
        HADA_TRY_OR_DONE(hada_response_from_name(&scan.frame_encoding, set->frame_encoding, err));
        fit.find_dark = !set->dark;
        HADA_TRY_OR_DONE(hada_cli_read_dark_level(&fit.dark, &dark, set->dark, err));
        scan.dark_frame = dark.data ? &dark : NULL;
        HADA_TRY_OR_DONE(hada_cli_read_flat(&flat, set->flat, set->dark, err));
        scan.flat_frame = set->flat ? &flat : NULL;
        scan.flat_dark = fit.dark;
        HADA_TRY_OR_DONE(hada_dataset_scan(&data, folder, &scan, err));
        HADA_TRY_OR_DONE(hada_file_check_target(set->output, err)); /* now that the data set's own files are known */
        if (set->registers)
            HADA_TRY_OR_DONE(register_scenes(cli, data, &fit, err));
    }
    HADA_TRY_OR_DONE(hada_fit_run(model, &report, context, data, &task, err));
    if (folder)
        fit_tell_pairs(cli, hada_dataset_get_info(data), *model, report);
    else
        fit_tell_sums(cli, set->merge.count, *model, report);
done:
    hada_fit_report_destroy(&report);
    hada_dataset_destroy(&data);
    hada_image_destroy(&flat);
    hada_image_destroy(&dark);
    return status;
}

static hada_status fit_psf(hada_cli *cli, const settings *set, const char **more, int count, hada_context *context,
                           hada_model **model, hada_error *err)
{
    enum { MOST_DISTANCES = 256 };
    double wanted[MOST_DISTANCES], taken[MOST_DISTANCES];
    int frame[2] = {0};
    hada_image flat = {0}, dark = {0};
    hada_status status = HADA_OK;
    hada_psf_options psf = set->psf_options;
    hada_psf_task task = set->psf_task;
    psf.form = set->form ? (hada_form)set->form : HADA_FORM_WIENER;
    psf.boundary = set->task.boundary ? (hada_boundary)set->task.boundary : HADA_BOUNDARY_PADDED;
    psf.window_rows = set->window[0] / set->fit.downsample;
    psf.window_cols = set->window[1] / set->fit.downsample;
    psf.lambda = set->fit.lambda;
    if (set->frame && !hada_cli_read_size(set->frame, frame))
        task.frame = set->frame;
    psf.frame_rows = frame[0] / set->fit.downsample;
    psf.frame_cols = frame[1] / set->fit.downsample;
    psf.mosaic = settled(set->fit.mosaic);
    psf.downsample = set->fit.downsample;
    task.psf = &psf;
    task.more = more;
    task.more_count = count;
    task.monitor = &cli->monitor;
    task.half = set->task.half;
    task.distances_mm = set->distances ? wanted : NULL;
    task.psf_distances_mm = set->psf_distance ? taken : NULL;
    HADA_TRY(hada_cli_read_distances("distances", set->distances, wanted, MOST_DISTANCES, &task.distances, err));
    HADA_TRY(
        hada_cli_read_distances("psf-distance", set->psf_distance, taken, MOST_DISTANCES, &task.psf_distances, err));
    HADA_TRY(hada_response_from_name(&task.frame_encoding, set->frame_encoding, err));
    HADA_TRY(hada_cli_read_colours(set->colours, psf.colour_matrix, &(int){0}, err));
    psf.refine_steps = set->fit.refine_steps;
    psf.refine_tv = set->fit.refine_tv;
    HADA_TRY_OR_DONE(hada_cli_read_dark_level(&psf.dark, &dark, set->dark, err));
    task.dark_frame = dark.data ? &dark : NULL;
    HADA_TRY_OR_DONE(hada_cli_read_flat(&flat, set->flat, set->dark, err));
    task.flat_frame = set->flat ? &flat : NULL;
    HADA_TRY_OR_DONE(hada_psf_run(model, context, set->psf, &task, err));
done:
    hada_image_destroy(&flat);
    hada_image_destroy(&dark);
    return status;
}

/* What cannot go together; HADA_EXIT_OK where all does. */
static int check(hada_cli *cli, const settings *set, int count, const char **arguments)
{
    const int learned = set->form == HADA_FORM_COMPLEX || set->form == HADA_FORM_SPLIT;
    if (count > 1 && !set->psf)
        return hada_cli_usage(cli, "one DATASET at a time; '%s' is too many (--merge adds sums of others)",
                              arguments[1]);
    if (!count && !set->psf && !set->merge.count)
        return hada_cli_usage(cli,
                              "say what to learn from: a DATASET folder, --psf PSF.tif, or saved sums with --merge");
    if (count && set->psf && !hada_path_is_file(arguments[0]))
        return hada_cli_usage(cli, "either the pairs of %s or --psf %s, not both", arguments[0], set->psf);
    if (set->fit.downsample < 1 || (set->fit.downsample > 1 && set->merge.count))
        return hada_cli_usage(cli, "--downsample needs 1 or more, and no sums (--merge), which say it themselves");
    if (!set->output)
        return hada_cli_usage(cli, "say where the model shall be written, with -o MODEL");
    if (set->task.resume && (!set->task.save_sums || !count || set->merge.count))
        return hada_cli_usage(cli,
                              "--resume goes on with the pairs of a DATASET from what --sums FILE has of them; sums of "
                              "others (--merge) are added afterwards");
    if (set->psf && learned)
        return hada_cli_usage(cli, "forms complex and split are learned from pairs; with --psf take wiener or matched");
    if (!set->psf && set->psf_options.components != HADA_AUTO)
        return hada_cli_usage(cli, "--components are of the point spread functions of --psf");
    if (set->registers && (set->psf || !count))
        return hada_cli_usage(cli, "--register needs the pairs of a DATASET");
    if (!set->psf && set->psf_options.turn)
        return hada_cli_usage(cli, "--turn turns the point spread functions of --psf; pairs give them as they are");
    if (set->psf && (set->psf_sign >= 0 || set->fit.crop_passes != HADA_AUTO || set->fit.outside >= 0))
        return hada_cli_usage(cli, "--psf-sign, --crop-passes and --outside belong to pairs, not to --psf");
    if (set->psf && (set->fit.refine_colour != HADA_AUTO || set->fit.refine_ridge != HADA_AUTO))
        return hada_cli_usage(
            cli, "--refine-colour and --refine-ridge belong to pairs; with --psf give them to reconstruct");
    if (set->psf && (strcmp(set->response, "auto") || set->task.exposure || set->task.save_sums || set->merge.count))
        return hada_cli_usage(cli, "--scene-response, --exposure, --sums and --merge belong to pairs, not to --psf");
    if (!count && set->merge.count && (set->task.exposure || set->flat))
        return hada_cli_usage(cli, "--exposure and --flat belong to pairs, which sums (--merge) do not hold");
    if (!set->psf && set->form && !learned)
        return hada_cli_usage(cli, "forms matched and wiener need a PSF: hadalens fit --psf %s/psf.tif -o %s",
                              count ? arguments[0] : "DATASET", set->output);
    return HADA_EXIT_OK;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    hada_context *context = NULL;
    hada_model *model = NULL;
    hada_status status = HADA_OK;
    const double start = hada_cli_seconds();
    const int wrong = check(cli, set, count, arguments);
    if (wrong)
        return wrong;
    HADA_TRY_OR_DONE(hada_file_check_target(set->output, &err));
    if (set->task.save_sums)
        HADA_TRY_OR_DONE(hada_file_check_target(set->task.save_sums, &err));
    HADA_TRY_OR_DONE(hada_cli_open(cli, &context, &err));
    HADA_TRY_OR_DONE(set->psf ? fit_psf(cli, set, arguments, count, context, &model, &err)
                              : fit_pairs(cli, set, count ? arguments[0] : NULL, context, &model, &err));
    if (hada_cli_writes(cli))
        HADA_TRY_OR_DONE(hada_model_save(model, set->output, &err));
    fit_tell_model(cli, set->output, model, hada_cli_seconds() - start);
done:
    hada_model_destroy(&model);
    hada_cli_close(cli, &context);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens fit camera -o camera.model", "learns from all pairs of the folder camera."},
    {"hadalens fit --psf psf.tif --distances 250 -o hand.model", "from one measured PSF."},
    {"hadalens fit captures --register -o camera.model", "of pictures that a display showed, wherever it stood."},
    {"hadalens fit monday -o m.model --sums monday.sums", "keeps the sums,"},
    {"hadalens fit tuesday -o both.model --merge monday.sums", "and adds to them."},
    {"hadalens fit --merge a.sums --merge b.sums -o all.model", "merges what two machines have added up."},
    {0},
};

const hada_cli_command hada_cli_fit = {
    .name = "fit",
    .summary = "learn a camera from pairs of raw frame and known scene, or from its PSF",
    .synopsis =
        "DATASET -o MODEL [OPTION...] | --psf PSF... -o MODEL [OPTION...] | --merge FILE... -o MODEL [OPTION...]",
    .description =
        "Each frequency of each depth is a least-squares problem of its own: the filters are learned exactly, in one "
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
    .shared = 1,
};
