#include "pairs.h"
#include "folder.h"
#include "option.h"

#include <hadalens/tiff.h>
#include <math.h>
#include <string.h>

/* Mean over the pages of a file. */
static hada_status load_mean(const char *path, hada_image *mean, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_status status = hada_tiff_open(&reader, path, err);
    if (status)
        return status;
    int frames = hada_tiff_get_info(reader)->frames;
    status = hada_tiff_read(reader, 0, mean, err);
    for (int t = 1; !status && t < frames; t++) {
        hada_image page = {0};
        status = hada_tiff_read(reader, t, &page, err);
        if (!status && hada_image_count(&page) != hada_image_count(mean))
            status = hada_cli_error(err, HADA_ERROR_SIZE, "the pages have different sizes");
        for (size_t i = 0; !status && i < hada_image_count(mean); i++)
            mean->data[i] += page.data[i];
        hada_image_destroy(&page);
    }
    for (size_t i = 0; !status && i < hada_image_count(mean); i++)
        mean->data[i] /= (float)frames;
    size_t bad = status ? 0 : hada_image_count_not_finite(mean);
    if (bad)
        status = hada_cli_error(err, HADA_ERROR_NOT_FINITE, "%zu pixels are NaN or infinite", bad);
    hada_tiff_close(&reader);
    if (status)
        hada_image_destroy(mean);
    return status;
}

hada_status hada_cli_dark_read(hada_cli_dark *dark, const char *text, hada_error *err)
{
    memset(dark, 0, sizeof *dark);
    if (!strcmp(text, "none"))
        return HADA_OK;
    if (!strcmp(text, "auto")) {
        dark->kind = HADA_CLI_DARK_AUTO;
        return HADA_OK;
    }
    if (hada_cli_read_real(text, &dark->level)) {
        dark->kind = HADA_CLI_DARK_LEVEL;
        return fabs(dark->level) < 1
                   ? HADA_OK
                   : hada_cli_error(err, HADA_ERROR_ARGUMENT,
                                    "--dark %s: the level is a share of full scale, such as 0.006", text);
    }
    if (!hada_cli_is_file(text))
        return hada_cli_error(err, HADA_ERROR_FILE_OPEN,
                              "--dark takes a file, 'auto', 'none' or a level such as 0.006; "
                              "there is no file '%s'",
                              text);
    dark->kind = HADA_CLI_DARK_FILE;
    hada_status status = load_mean(text, &dark->frame, err);
    if (status) {
        hada_cli_prefix(err, "%s: ", text);
        return status;
    }
    double sum = 0;
    for (size_t i = 0; i < hada_image_count(&dark->frame); i++)
        sum += (double)dark->frame.data[i];
    dark->level = sum / (double)hada_image_count(&dark->frame);
    return HADA_OK;
}

void hada_cli_dark_free(hada_cli_dark *dark)
{
    hada_image_destroy(&dark->frame);
}

hada_status hada_cli_pair_load(const hada_cli_pair *pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    memset(raw, 0, sizeof *raw);
    memset(scene, 0, sizeof *scene);
    hada_status status = hada_tiff_load(pair->raw, 0, raw, err);
    if (status) {
        hada_cli_prefix(err, "%s: ", pair->raw);
        return status;
    }
    status = hada_tiff_load(pair->scene, 0, scene, err);
    if (status) {
        hada_cli_prefix(err, "%s: ", pair->scene);
        hada_image_destroy(raw);
    }
    return status;
}

typedef hada_status (*take_pair)(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                                 hada_error *err);

static hada_status each_pair(hada_cli *cli, hada_fitter *fitter, const hada_cli_dataset *set, int most, take_pair take,
                             hada_error *err)
{
    hada_status status = HADA_OK;
    for (int z = 0; !status && z < set->depths; z++) {
        const hada_cli_depth *depth = &set->depth[z];
        int count = depth->pairs < most ? depth->pairs : most;
        for (int i = 0; !status && i < count; i++) {
            const hada_cli_pair *pair = &depth->pair[(long)i * depth->pairs / count];
            hada_image raw, scene;
            status = hada_cli_pair_load(pair, &raw, &scene, err);
            if (status)
                break;
            status = take(fitter, z, &raw, &scene, err);
            if (status)
                hada_cli_prefix(err, "%s and %s: ", pair->raw, pair->scene);
            hada_image_destroy(&raw);
            hada_image_destroy(&scene);
            hada_cli_progress_step(cli, NULL);
            if (!status)
                status = hada_cli_check_signals(err);
        }
    }
    return status;
}

hada_status hada_cli_pairs_add(hada_cli *cli, hada_fitter *fitter, const hada_cli_dataset *set, hada_error *err)
{
    hada_cli_progress progress;
    hada_cli_progress_begin(cli, &progress, "pairs", set->pairs);
    hada_status status = each_pair(cli, fitter, set, set->pairs, hada_fitter_add, err);
    hada_cli_progress_end(cli);
    return status;
}

hada_status hada_cli_pairs_score(hada_cli *cli, hada_fitter *fitter, const hada_cli_dataset *set, hada_error *err)
{
    /* The fitter takes 8 in all, and 2 of each depth where there are many. */
    int most = (8 + set->depths - 1) / set->depths;
    hada_cli_progress progress;
    long total = 0;
    most = most < 2 ? 2 : most;
    for (int z = 0; z < set->depths; z++)
        total += set->depth[z].pairs < most ? set->depth[z].pairs : most;
    hada_cli_progress_begin(cli, &progress, "leave-one-out", total);
    hada_status status = each_pair(cli, fitter, set, most, hada_fitter_score, err);
    hada_cli_progress_end(cli);
    return status;
}

/* The pair that is shown, until the next one is. */
typedef struct shown {
    hada_cli *cli;
    const hada_cli_dataset *set;
    hada_image raw, scene;
} shown;

static hada_status show(void *user, int depth, int64_t number, const hada_image **raw, const hada_image **scene,
                        hada_error *err)
{
    shown *at = user;
    hada_image_destroy(&at->raw);
    hada_image_destroy(&at->scene);
    hada_status status = hada_cli_check_signals(err);
    if (!status)
        status = hada_cli_pair_load(&at->set->depth[depth].pair[number], &at->raw, &at->scene, err);
    hada_cli_progress_step(at->cli, NULL);
    *raw = &at->raw;
    *scene = &at->scene;
    return status;
}

hada_status hada_cli_pairs_judge(hada_cli *cli, hada_fitter *fitter, const hada_cli_dataset *set, hada_error *err)
{
    shown at = {.cli = cli, .set = set};
    hada_cli_progress progress;
    hada_cli_progress_begin(cli, &progress, "looks at pairs, to judge in the window", 0);
    hada_status status = hada_fitter_judge(fitter, show, &at, err);
    hada_cli_progress_end(cli);
    hada_image_destroy(&at.raw);
    hada_image_destroy(&at.scene);
    return status;
}
