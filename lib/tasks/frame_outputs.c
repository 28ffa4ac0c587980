#include "tasks/frame_outputs.h"

#include <hadalens/preview.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "io/folder.h"

hada_status hada_outputs_begin(hada_outputs *out, const hada_files_task *task, const char *name, const char *model,
                               int frames, hada_error *err)
{
    static const char *const endings[HADA_OUTPUTS] = {"stack.tif", "aif.tif", "depth.tif", "preview.png"};
    const char *slash = strrchr(model, '/');
    const int preview = task->preview && hada_pictures_available();
    hada_status status = HADA_OK;
    *out = (hada_outputs){.frames = frames, .bits = task->bits, .white = task->white};
    for (int k = 0; k < HADA_OUTPUTS; k++)
        if (k != HADA_OUTPUT_PREVIEW || preview)
            HADA_TRY(hada_path_format(&out->path[k], err, "%s/%s_%s", task->output, name, endings[k]));
    HADA_TRY(hada_path_format(&out->title, err, "%s, %s", name, slash ? slash + 1 : model));
done:
    return status;
}

static hada_status open_writer(hada_outputs *out, hada_output which, const hada_image *first, const hada_result *result,
                               hada_error *err)
{
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    /* millimetres and NaN need floats */
    options.bits = which == HADA_OUTPUT_DISTANCE_MAP ? 32 : out->bits;
    options.scale = out->white;
    options.slices = 1;
    options.times = out->frames;
    if (which == HADA_OUTPUT_STACK) {
        options.layout = HADA_TIFF_HYPERSTACK;
        options.slices = result->depths;
        options.distances_mm = result->distances_mm;
    }
    if (which == HADA_OUTPUT_DISTANCE_MAP)
        options.description = "unit=millimetre\n";
    return hada_tiff_create(&out->writer[which], out->path[which], first->channels, first->rows, first->cols, &options,
                            err);
}

static hada_status save_preview(const hada_outputs *out, const hada_image *raw, const hada_result *result,
                                hada_error *err)
{
    hada_preview preview;
    hada_preview_init(&preview);
    preview.title = out->title;
    preview.raw = raw;
    preview.planes = result->planes;
    preview.depths = result->depths;
    preview.distances_mm = result->distances_mm;
    preview.occupied = result->report->occupied;
    preview.all_in_focus = &result->all_in_focus;
    preview.distance_map = &result->distance_map;
    return hada_preview_save(out->path[HADA_OUTPUT_PREVIEW], &preview, err);
}

static hada_status open_all(hada_outputs *out, const hada_image *raw, const hada_result *result, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(open_writer(out, HADA_OUTPUT_STACK, &result->planes[0], result, err));
    HADA_TRY(open_writer(out, HADA_OUTPUT_ALL_IN_FOCUS, &result->all_in_focus, result, err));
    HADA_TRY(open_writer(out, HADA_OUTPUT_DISTANCE_MAP, &result->distance_map, result, err));
    if (out->path[HADA_OUTPUT_PREVIEW])
        HADA_TRY(save_preview(out, raw, result, err));
done:
    return status;
}

hada_status hada_outputs_add(hada_outputs *out, const hada_image *raw, const hada_result *result, hada_error *err)
{
    hada_status status = HADA_OK;
    if (!out->written++)
        HADA_TRY(open_all(out, raw, result, err));
    for (int z = 0; z < result->depths; z++)
        HADA_TRY(hada_tiff_write(out->writer[HADA_OUTPUT_STACK], &result->planes[z], err));
    HADA_TRY(hada_tiff_write(out->writer[HADA_OUTPUT_ALL_IN_FOCUS], &result->all_in_focus, err));
    HADA_TRY(hada_tiff_write(out->writer[HADA_OUTPUT_DISTANCE_MAP], &result->distance_map, err));
done:
    return status;
}

hada_status hada_outputs_finish(hada_outputs *out, hada_error *err)
{
    hada_status status = HADA_OK;
    int finished = 0;
    for (; finished < HADA_OUTPUT_PREVIEW; finished++)
        HADA_TRY(hada_tiff_finish(&out->writer[finished], err));
    out->finished = 1;
done:
    for (int k = 0; status && k < finished; k++)
        unlink(out->path[k]);
    return status;
}

void hada_outputs_end(hada_outputs *out)
{
    for (int k = 0; k < HADA_OUTPUT_PREVIEW; k++)
        if (out->writer[k])
            hada_tiff_abandon(&out->writer[k]);
    if (out->path[HADA_OUTPUT_PREVIEW] && out->written && !out->finished)
        unlink(out->path[HADA_OUTPUT_PREVIEW]);
    for (int k = 0; k < HADA_OUTPUTS; k++)
        free(out->path[k]);
    free(out->title);
    *out = (hada_outputs){0};
}
