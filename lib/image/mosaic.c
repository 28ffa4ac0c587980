#include "image/mosaic.h"

#include "core/base.h"

/* Of the pixel in an even row and an even column, then along the row, then of the next row. */
static const unsigned char channels[][4] = {[HADA_MOSAIC_RGGB] = {0, 1, 1, 2},
                                            [HADA_MOSAIC_BGGR] = {2, 1, 1, 0},
                                            [HADA_MOSAIC_GRBG] = {1, 0, 2, 1},
                                            [HADA_MOSAIC_GBRG] = {1, 2, 0, 1}};

int hada_mosaic_channel(hada_mosaic mosaic, int row, int col)
{
    return channels[mosaic][(row & 1) * 2 + (col & 1)];
}

/* The neighbours that hold a colour. */
typedef struct neighbours {
    int count;
    signed char row[8], col[8];
} neighbours;

static neighbours find(hada_mosaic mosaic, int row, int col, int channel)
{
    neighbours found = {0};
    for (int r = -1; r <= 1; r++)
        for (int c = -1; c <= 1; c++)
            if (hada_mosaic_channel(mosaic, row + r + 2, col + c + 2) == channel) {
                found.row[found.count] = (signed char)r;
                found.col[found.count++] = (signed char)c;
            }
    return found;
}

static float mean_of(const neighbours *near, const float *values, int rows, int cols, int row, int col)
{
    float sum = 0.0f;
    int count = 0;
    for (int i = 0; i < near->count; i++) {
        const int r = row + near->row[i], c = col + near->col[i];
        if (r >= 0 && r < rows && c >= 0 && c < cols) {
            sum += values[(size_t)r * (size_t)cols + (size_t)c];
            count++;
        }
    }
    return sum / (float)count;
}

void hada_mosaic_fill(hada_mosaic mosaic, const float *values, int rows, int cols, float *colours)
{
    const size_t plane = (size_t)rows * (size_t)cols;
    for (int channel = 0; channel < HADA_MOSAIC_COLOURS; channel++)
        for (int row = 0; row < rows; row++) {
            const neighbours near[] = {find(mosaic, row, 0, channel), find(mosaic, row, 1, channel)};
            const size_t first = (size_t)row * (size_t)cols;
            float *to = colours + (size_t)channel * plane + first;
            for (int col = 0; col < cols; col++)
                to[col] = hada_mosaic_channel(mosaic, row, col) == channel
                              ? values[first + (size_t)col]
                              : mean_of(&near[col & 1], values, rows, cols, row, col);
        }
}

hada_status hada_mosaic_colours(hada_mosaic mosaic, const hada_image *frame, hada_image *colours, hada_error *err)
{
    HADA_TRY(hada_image_create(colours, HADA_MOSAIC_COLOURS, frame->rows, frame->cols, err));
    hada_mosaic_fill(mosaic, frame->data, frame->rows, frame->cols, colours->data);
    return HADA_OK;
}

void hada_mosaic_take(hada_mosaic mosaic, const float *colours, int rows, int cols, float *values)
{
    const size_t plane = (size_t)rows * (size_t)cols;
    for (int row = 0; row < rows; row++)
        for (int col = 0; col < cols; col++) {
            const size_t at = (size_t)row * (size_t)cols + (size_t)col;
            values[at] = colours[(size_t)hada_mosaic_channel(mosaic, row, col) * plane + at];
        }
}

size_t hada_mosaic_own(hada_mosaic mosaic, int channel, const float *image, int rows, int cols, float *values)
{
    size_t count = 0;
    for (int row = 0; row < rows; row++)
        for (int col = 0; col < cols; col++)
            if (hada_mosaic_channel(mosaic, row, col) == channel)
                values[count++] = image[(size_t)row * (size_t)cols + (size_t)col];
    return count;
}

const float *hada_mosaic_channel_values(hada_mosaic mosaic, int channel, const hada_image *image, float *room,
                                        size_t *count)
{
    *count = (size_t)image->rows * (size_t)image->cols;
    if (mosaic == HADA_MOSAIC_NONE)
        return image->data + (size_t)channel * *count;
    *count = hada_mosaic_own(mosaic, channel, image->data, image->rows, image->cols, room);
    return room;
}
