#include "reconstruct.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

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

json_t *hada_cli_skip_json(const hada_result *result)
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

void hada_cli_skip_words(const hada_result *result, char *text, size_t size)
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
