/* Pictures of held-out pairs on the way. */
#include "train_settings.h"

#include <hadalens/preview.h>
#include <hadalens/scene.h>
#include <math.h>
#include <string.h>

enum { PANELS = 4, ROWS = 3, GAP = 4 };

static float brightest(const hada_image *image)
{
    float top = 0;
    for (size_t i = 0; i < hada_image_count(image); i++)
        top = image->data[i] > top ? image->data[i] : top;
    return top > 0 ? top : 1;
}

/* Puts a panel, scaled to 1 at `white`, at (row0, col0) of the sheet. */
static void place(hada_image *sheet, const hada_image *panel, float white, int row0, int col0)
{
    for (int c = 0; c < sheet->channels; c++)
        for (int row = 0; row < panel->rows; row++)
            for (int col = 0; col < panel->cols; col++) {
                const size_t from = ((size_t)c * (size_t)panel->rows + (size_t)row) * (size_t)panel->cols + (size_t)col;
                const size_t to = ((size_t)c * (size_t)sheet->rows + (size_t)(row0 + row)) * (size_t)sheet->cols +
                                  (size_t)(col0 + col);
                sheet->data[to] = panel->data[from] / white;
            }
}

static hada_status add_row(hada_trainer *trainer, int pair, int index, int rows, hada_image *sheet, hada_error *err)
{
    hada_image panel[PANELS] = {{0}}, raw = {0};
    hada_status status = hada_trainer_show(trainer, pair, &raw, &panel[1], &panel[2], &panel[3], err);
    if (!status)
        status = hada_scene_fit(&panel[0], &raw, panel[3].rows, panel[3].cols, err);
    const int height = panel[3].rows + GAP, width = panel[3].cols + GAP;
    if (!status && !sheet->data) {
        status = hada_image_create(sheet, panel[3].channels, rows * height - GAP, PANELS * width - GAP, err);
        for (size_t i = 0; !status && i < hada_image_count(sheet); i++)
            sheet->data[i] = 1;
    }
    const float white = status ? 1 : brightest(&panel[3]);
    for (int k = 0; !status && k < PANELS; k++)
        place(sheet, &panel[k], k ? white : brightest(&panel[0]), index * height, k * width);
    for (int k = 0; k < PANELS; k++)
        hada_image_destroy(&panel[k]);
    hada_image_destroy(&raw);
    return status;
}

hada_status hada_cli_train_picture(hada_trainer *trainer, int held, const char *path, hada_error *err)
{
    hada_image sheet = {0};
    hada_status status = HADA_OK;
    const int rows = held < ROWS ? held : ROWS;
    if (!hada_pictures_available())
        return HADA_OK;
    for (int i = 0; !status && i < rows; i++)
        status = add_row(trainer, rows > 1 ? (int)((long)i * (held - 1) / (rows - 1)) : 0, i, rows, &sheet, err);
    if (!status)
        status = hada_png_save(path, &sheet, 1, 1 / 2.2, err);
    hada_image_destroy(&sheet);
    return status;
}
