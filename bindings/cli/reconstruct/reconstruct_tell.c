#include "reconstruct.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

typedef hada_cli_files_listener listener;

/* In the order of hada_method. */
static const char *const methods[] = {"model", "wiener", "rl", "fista", "admm"};
/* In the order of hada_scene. */
static const char *const scenes[] = {"auto", "planes", "surface", "volume"};

static const struct {
    const char *word;
    unsigned kind;
} kinds[] = {{"prune", HADA_SKIP_PRUNE}, {"depths", HADA_SKIP_DEPTHS},     {"frequencies", HADA_SKIP_FREQUENCIES},
             {"half", HADA_SKIP_HALF},   {"channels", HADA_SKIP_CHANNELS}, {"frames", HADA_SKIP_FRAMES},
             {"tiles", HADA_SKIP_TILES}};
enum { KINDS = sizeof kinds / sizeof *kinds };

static unsigned find(const char *word, size_t length)
{
    for (int i = 0; i < KINDS; i++)
        if (strlen(kinds[i].word) == length && !strncmp(kinds[i].word, word, length))
            return kinds[i].kind;
    return 0;
}

hada_status hada_cli_read_skip(const char *text, unsigned *skip, hada_error *err)
{
    *skip = !strcmp(text, "all") ? HADA_SKIP_ALL : 0;
    if (*skip || !strcmp(text, "none"))
        return HADA_OK;
    for (const char *word = text;; word++) {
        const size_t length = strcspn(word, ",");
        const unsigned kind = find(word, length);
        if (!kind)
            return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                                  "--skip takes all, none, or a list of prune, depths, frequencies, half, channels, "
                                  "frames and tiles; not '%.*s'",
                                  (int)length, word);
        *skip |= kind;
        word += length;
        if (!*word)
            return HADA_OK;
    }
}

static json_t *skip_json(const hada_result *result)
{
    const hada_skip_report *skipped = result->report->skipped;
    json_t *list = json_array();
    for (int i = 0; i < KINDS; i++)
        if (skipped->kinds & kinds[i].kind)
            json_array_append_new(list, json_string(kinds[i].word));
    const int depths = result->depths, channels = result->depths ? result->planes[0].channels : 0;
    const double computed =
        depths && channels && !skipped->frame
            ? (double)(depths - skipped->depths) * (channels - skipped->channels) / ((double)depths * channels)
            : 0.0;
    return json_pack("{s:o, s:o, s:f, s:i, s:i, s:b, s:f, s:f, s:b}", "kinds", list, "bound",
                     hada_cli_real(skipped->bound), "planes", 1.0 - computed, "depths", skipped->depths, "channels",
                     skipped->channels, "frame", skipped->frame, "frequencies", skipped->frequencies, "tiles",
                     skipped->tiles, "again", skipped->recomputed);
}

static void skip_words(const hada_result *result, char *text, size_t size)
{
    const hada_skip_report *skipped = result->report->skipped;
    if (skipped->frame)
        hada_cli_append(text, size, "; the result of the frame before");
    if (skipped->channels)
        hada_cli_append(text, size, "; %d channel%s black or copied", skipped->channels,
                        skipped->channels == 1 ? "" : "s");
    if (skipped->frequencies > 0)
        hada_cli_append(text, size, "; %.0f %% of the frequencies left out", 100 * skipped->frequencies);
    if (skipped->kinds & HADA_SKIP_HALF)
        hada_cli_append(text, size, "; half filters");
    if (skipped->bound > 0 && isfinite(skipped->bound))
        hada_cli_append(text, size, "; at most %.2g %% change", 100 * skipped->bound);
    if (skipped->recomputed)
        hada_cli_append(text, size, "; done again in full");
}

static json_t *frame_json(const hada_result *result)
{
    const hada_report *report = result->report;
    json_t *occupied = json_array();
    for (int z = 0; report->occupied && z < result->depths; z++)
        if (report->occupied[z])
            json_array_append_new(occupied, hada_cli_real(result->distances_mm[z]));
    return json_pack(
        "{s:o, s:s, s:s, s:i, s:o, s:o, s:b, s:o, s:o, s:o, s:o, s:i, s:I, s:I, s:I, s:o, s:{s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f}}",
        "occupied_mm", occupied, "scene", scenes[report->scene], "method", methods[report->method], "refine_steps",
        report->refine_steps, "refine_tv", hada_cli_real(report->refine_tv), "refine_tv_factor",
        hada_cli_real(report->refine_tv_factor), "refine_tv_kept", report->refine_tv_kept, "residual_linear",
        hada_cli_real(report->residual_linear), "residual", hada_cli_real(report->residual), "dark",
        hada_cli_real(report->dark), "stray_light", hada_cli_real(report->stray_light), "enhanced", report->enhanced,
        "repaired_pixels", (json_int_t)report->repaired_pixels, "bad_pixels", (json_int_t)report->bad_pixels,
        "saturated_pixels", (json_int_t)report->saturated_pixels, "skipped", skip_json(result), "seconds", "total",
        report->seconds_total, "upload", report->seconds_upload, "linear", report->seconds_linear, "pursuit",
        report->seconds_pursuit, "refine", report->seconds_refine, "enhance", report->seconds_enhance, "focus",
        report->seconds_focus, "download", report->seconds_download);
}

static void tell_frame(listener *to, const hada_files_state *state)
{
    static const char *const verdicts[] = {"unknown", "belongs", "turned", "magnified", "unrelated"};
    static const char *const turns[] = {"none", "mirror", "flip", "180"};
    const hada_match *match = state->match;
    json_t *frame = frame_json(state->result);
    if (state->emitters)
        json_object_set_new(frame, "emitters", json_integer(state->emitters->count));
    json_array_append_new(to->frames, frame);
    if (state->result->report->warm_started) {
        json_object_set_new(frame, "warm_started", json_true());
        json_object_set_new(frame, "gain", json_real(state->result->report->gain));
    }
    if (!match)
        return;
    to->strange += match->verdict > HADA_MATCH_BELONGS;
    json_object_set_new(frame, "camera",
                        json_pack("{s:s, s:s, s:f, s:o, s:o}", "verdict", verdicts[match->verdict], "turn",
                                  turns[match->turn], "magnification", match->magnification, "factor",
                                  hada_cli_real(match->factor), "unexplained", hada_cli_real(match->unexplained)));
}

/* "a surface, 120 to 340 mm" */
static void surface_words(const hada_result *result, char *text, size_t size)
{
    const hada_image *map = &result->distance_map;
    const size_t count = (size_t)map->rows * (size_t)map->cols;
    double least = INFINITY, most = 0;
    for (size_t i = 0; i < count; i++) {
        least = fmin(least, map->data[i]);
        most = fmax(most, map->data[i]);
    }
    hada_cli_append(text, size, "a surface");
    if (most > 0)
        hada_cli_append(text, size, ", %.4g to %.4g mm", least, most);
}

static void weight_words(const hada_report *report, char *text, size_t size)
{
    if (report->refine_tv_factor > 0)
        hada_cli_append(text, size, ", total variation %.2g found from the frame (within a factor of %.2g)",
                        report->refine_tv, report->refine_tv_factor);
    else if (report->refine_tv_kept)
        hada_cli_append(text, size, ", total variation %.2g kept from an earlier frame", report->refine_tv);
    else if (report->method != HADA_METHOD_MODEL && report->refine_tv > 0)
        hada_cli_append(text, size, ", total variation %.2g", report->refine_tv);
}

/* "100 and 250 mm; 8 refinement steps; 2.1 % unexplained" into `text` of `size` bytes. */
static void frame_words(const hada_result *result, char *text, size_t size)
{
    const hada_report *report = result->report;
    int count = 0, shown = 0;
    *text = '\0';
    for (int z = 0; report->occupied && z < result->depths; z++)
        count += report->occupied[z] != 0;
    if (report->scene == HADA_SCENE_SURFACE) {
        surface_words(result, text, size);
    } else if (!report->refine_steps && report->method == HADA_METHOD_MODEL && count == result->depths) {
        hada_cli_append(text, size, "linear filters alone");
    } else if (count == result->depths && count > 1) {
        hada_cli_append(text, size, "%sall %d depths", report->scene == HADA_SCENE_VOLUME ? "volume, " : "", count);
    } else if (count > 8) {
        hada_cli_append(text, size, "%d of %d depths", count, result->depths);
    } else if (!count || !result->distances_mm[0]) {
        hada_cli_append(text, size, count ? "one depth" : "no depth occupied");
    } else {
        for (int z = 0; z < result->depths; z++)
            if (report->occupied[z]) {
                hada_cli_append(text, size, "%s%.4g",
                                !shown               ? ""
                                : shown == count - 1 ? " and "
                                                     : ", ",
                                result->distances_mm[z]);
                shown++;
            }
        hada_cli_append(text, size, " mm");
    }
    if (report->method != HADA_METHOD_MODEL) {
        hada_cli_append(text, size, "; %s", methods[report->method]);
        if (report->refine_steps)
            hada_cli_append(text, size, ", %d iteration%s", report->refine_steps, report->refine_steps == 1 ? "" : "s");
        weight_words(report, text, size);
    } else if (report->refine_steps && report->scene != HADA_SCENE_SURFACE) {
        hada_cli_append(text, size, "; %d refinement step%s", report->refine_steps,
                        report->refine_steps == 1 ? "" : "s");
        weight_words(report, text, size);
    }
    double residual = isfinite(report->residual) ? report->residual : report->residual_linear;
    if (isfinite(residual))
        hada_cli_append(text, size, "; %.2g %% unexplained", 100 * residual);
    if (report->stray_light != 0.0)
        hada_cli_append(text, size, "; stray light of %.2g of full scale taken off", report->stray_light);
    if (report->enhanced)
        hada_cli_append(text, size, "; %d plane%s enhanced", report->enhanced, report->enhanced == 1 ? "" : "s");
    if (report->repaired_pixels)
        hada_cli_append(text, size, "; %lld pixels repaired", (long long)report->repaired_pixels);
    if (report->bad_pixels)
        hada_cli_append(text, size, "; %lld bad pixel%s left out", (long long)report->bad_pixels,
                        report->bad_pixels == 1 ? "" : "s");
    if (report->saturated_pixels)
        hada_cli_append(text, size, "; %lld saturated pixels count as \"at least this\"",
                        (long long)report->saturated_pixels);
    skip_words(result, text, size);
}

static void begin_file(listener *to, const hada_files_state *state)
{
    to->entry = json_object();
    to->frames = json_array();
    json_object_set_new(to->entry, "input", hada_cli_json_text(state->path));
    json_array_append_new(json_object_get(to->cli->document, "files"), to->entry);
}

static json_t *outputs_json(const hada_files_state *state)
{
    static const char *const keys[HADA_OUTPUTS] = {"stack", "all_in_focus", "distance_map", "preview"};
    json_t *outputs = json_object();
    for (int k = 0; k < HADA_OUTPUTS; k++)
        if (state->outputs[k])
            json_object_set_new(outputs, keys[k], hada_cli_json_text(state->outputs[k]));
    if (state->confidence)
        json_object_set_new(outputs, "confidence", hada_cli_json_text(state->confidence));
    if (state->picture)
        json_object_set_new(outputs, "picture", hada_cli_json_text(state->picture));
    if (state->emitters_table)
        json_object_set_new(outputs, "emitters", hada_cli_json_text(state->emitters_table));
    if (state->tracks_table)
        json_object_set_new(outputs, "tracks", hada_cli_json_text(state->tracks_table));
    return outputs;
}

static void tell_file(listener *to, const hada_files_state *state)
{
    char words[400];
    const double now = hada_cli_seconds(), seconds = now - to->before;
    frame_words(state->result, words, sizeof words);
    if (state->emitters)
        hada_cli_append(words, sizeof words, "; %d emitter%s", state->emitters->count,
                        state->emitters->count == 1 ? "" : "s");
    if (state->tracks_table) {
        hada_cli_append(words, sizeof words, "; %d track%s in all", state->tracks, state->tracks == 1 ? "" : "s");
        json_object_set_new(to->entry, "tracks", json_integer(state->tracks));
    }
    if (state->frames > 1)
        hada_cli_say(to->cli, "%s: %d frames, %.2f s each; the last: %s", state->name, state->frames,
                     seconds / state->frames, words);
    else
        hada_cli_say(to->cli, "%s: %s; %.2f s", state->name, words, seconds);
    json_object_set_new(to->entry, "outputs", outputs_json(state));
    json_object_set_new(to->entry, "frames", to->frames);
    json_object_set_new(to->entry, "seconds", json_real(seconds));
    json_object_set_new(to->entry, "ok", json_true());
    to->before = now;
}

static void fail_file(listener *to, const hada_files_state *state)
{
    hada_error err = *state->error;
    const int code = hada_cli_exit_code(err.status);
    json_decref(to->frames);
    if (err.status != HADA_ERROR_CANCELLED) {
        hada_cli_print_error(to->cli, &err);
        to->code = !to->failed || to->code == code ? code : HADA_EXIT_SOME;
        to->failed++;
    }
    json_object_set_new(to->entry, "ok", json_false());
    json_object_set_new(to->entry, "error", hada_cli_error_json(&err));
    to->before = hada_cli_seconds();
}

static void pass_over(listener *to, const hada_files_state *state)
{
    hada_cli_say(to->cli, "%s: there already", state->name);
    json_array_append_new(json_object_get(to->cli->document, "files"),
                          json_pack("{s:o, s:b, s:b}", "input", hada_cli_json_text(state->path), "ok", 1, "there", 1));
}

void hada_cli_files_tell(void *user, const hada_files_state *state)
{
    listener *to = user;
    switch (state->event) {
    case HADA_FILES_BEGINS: begin_file(to, state); break;
    case HADA_FILES_FRAME: tell_frame(to, state); break;
    case HADA_FILES_DONE: tell_file(to, state); break;
    case HADA_FILES_FAILED: fail_file(to, state); break;
    case HADA_FILES_THERE: pass_over(to, state); break;
    }
}
