#include "shared.h"

#include <hadalens/dataset.h>
#include <hadalens/folder.h>
#include <string.h>

hada_status hada_cli_read_dark(hada_cli_dark *dark, const char *text, hada_error *err)
{
    *dark = (hada_cli_dark){.kind = HADA_DARK_NONE};
    if (!strcmp(text, "none"))
        return HADA_OK;
    if (!strcmp(text, "auto")) {
        dark->kind = HADA_DARK_AUTO;
        return HADA_OK;
    }
    if (hada_cli_read_real(text, &dark->level)) {
        dark->kind = HADA_DARK_LEVEL;
        return dark->level >= 0 && dark->level < 1
                   ? HADA_OK
                   : hada_cli_error(err, HADA_ERROR_ARGUMENT,
                                    "--dark %s: the level is a share of full scale, such as 0.006", text);
    }
    if (!hada_path_is_file(text))
        return hada_cli_error(err, HADA_ERROR_FILE_OPEN,
                              "--dark takes a file, 'auto', 'none' or a level such as 0.006; there is no file '%s'",
                              text);
    dark->kind = HADA_DARK_FRAME;
    return hada_dark_frame_load(&dark->frame, NULL, text, err);
}

void hada_cli_dark_free(hada_cli_dark *dark)
{
    hada_image_destroy(&dark->frame);
}

hada_status hada_cli_read_dark_level(double *level, hada_image *frame, const char *text, hada_error *err)
{
    hada_cli_dark dark;
    if (!text)
        return HADA_OK;
    HADA_TRY(hada_cli_read_dark(&dark, text, err));
    *level = dark.kind == HADA_DARK_AUTO ? HADA_AUTO : dark.level;
    *frame = dark.frame;
    return HADA_OK;
}

hada_status hada_cli_read_flat(hada_image *flat, const char *path, const char *dark_text, hada_error *err)
{
    hada_cli_dark dark = {0};
    hada_status status = HADA_OK;
    if (!path)
        return HADA_OK;
    HADA_TRY(hada_dark_frame_load(flat, NULL, path, err));
    if (dark_text)
        HADA_TRY_OR_DONE(hada_cli_read_dark(&dark, dark_text, err));
    const size_t count = dark.frame.data ? hada_image_count(&dark.frame) : 1;
    for (size_t i = 0; i < hada_image_count(flat); i++)
        flat->data[i] -= dark.frame.data ? dark.frame.data[i % count] : (float)dark.level;
done:
    hada_cli_dark_free(&dark);
    return status;
}
