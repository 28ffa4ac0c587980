#include "frame_outputs.h"
#include "folder.h"

#include <hadalens/preview.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

hada_status hada_cli_outputs_begin(hada_cli_outputs *out, const char *folder, const char *name, const char *model,
                                   int preview, int frames, int bits, double white, hada_error *err)
{
    static const char *const endings[] = {"stack.tif", "aif.tif", "depth.tif", "preview.png"};
    *out = (hada_cli_outputs){.frames = frames, .bits = bits, .white = white};
    for (int k = 0; k < HADA_CLI_OUTPUTS; k++) {
        if (k == HADA_CLI_PREVIEW && !preview)
            continue;
        out->path[k] = hada_cli_text("%s/%s_%s", folder, name, endings[k]);
        if (!out->path[k])
            return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    }
    const char *slash = strrchr(model, '/');
    out->title = hada_cli_text("%s, %s", name, slash ? slash + 1 : model);
    return out->title ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
}

static hada_status open_writer(hada_cli_outputs *out, int which, const hada_image *first, const hada_result *result,
                               hada_error *err)
{
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    /* Millimetres and NaN need floats. */
    options.bits = which == HADA_CLI_DEPTH ? 32 : out->bits;
    options.scale = out->white;
    options.slices = 1;
    options.times = out->frames;
    if (which == HADA_CLI_STACK) {
        options.layout = HADA_TIFF_HYPERSTACK;
        options.slices = result->depths;
        options.distances_mm = result->distances_mm;
    }
    if (which == HADA_CLI_DEPTH)
        options.description = "unit=millimetre\n";
    return hada_tiff_create(&out->writer[which], out->path[which], first->channels, first->rows, first->cols, &options,
                            err);
}

static hada_status save_preview(const hada_cli_outputs *out, const hada_image *raw, const hada_result *result,
                                hada_error *err)
{
    hada_preview preview = {.size = sizeof preview,
                            .gamma = HADA_AUTO,
                            .title = out->title,
                            .raw = raw,
                            .planes = result->planes,
                            .depths = result->depths,
                            .distances_mm = result->distances_mm,
                            .occupied = result->report.occupied,
                            .all_in_focus = &result->all_in_focus,
                            .distance_map = &result->distance_map};
    return hada_preview_save(out->path[HADA_CLI_PREVIEW], &preview, err);
}

hada_status hada_cli_outputs_add(hada_cli_outputs *out, const hada_image *raw, const hada_result *result,
                                 hada_error *err)
{
    hada_status status = HADA_OK;
    if (!out->written) {
        status = open_writer(out, HADA_CLI_STACK, &result->planes[0], result, err);
        if (!status)
            status = open_writer(out, HADA_CLI_AIF, &result->all_in_focus, result, err);
        if (!status)
            status = open_writer(out, HADA_CLI_DEPTH, &result->distance_map, result, err);
        if (!status && out->path[HADA_CLI_PREVIEW])
            status = save_preview(out, raw, result, err);
    }
    out->written++;
    for (int z = 0; !status && z < result->depths; z++)
        status = hada_tiff_write(out->writer[HADA_CLI_STACK], &result->planes[z], err);
    if (!status)
        status = hada_tiff_write(out->writer[HADA_CLI_AIF], &result->all_in_focus, err);
    if (!status)
        status = hada_tiff_write(out->writer[HADA_CLI_DEPTH], &result->distance_map, err);
    return status;
}

hada_status hada_cli_outputs_finish(hada_cli_outputs *out, hada_error *err)
{
    hada_status status = HADA_OK;
    int finished = 0;
    for (; !status && finished < HADA_CLI_PREVIEW; finished++)
        status = hada_tiff_finish(&out->writer[finished], err);
    if (status) {
        for (int k = 0; k < finished - 1; k++)
            unlink(out->path[k]);
        return status;
    }
    /* From here on the preview stays. */
    free(out->path[HADA_CLI_PREVIEW]);
    out->path[HADA_CLI_PREVIEW] = NULL;
    return HADA_OK;
}

void hada_cli_outputs_end(hada_cli_outputs *out)
{
    for (int k = 0; k < HADA_CLI_PREVIEW; k++)
        if (out->writer[k])
            hada_tiff_abandon(&out->writer[k]);
    if (out->path[HADA_CLI_PREVIEW] && out->written)
        unlink(out->path[HADA_CLI_PREVIEW]);
    for (int k = 0; k < HADA_CLI_OUTPUTS; k++)
        free(out->path[k]);
    free(out->title);
    memset(out, 0, sizeof *out);
}
