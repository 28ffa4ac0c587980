#include "filter/layout.h"

#include <string.h>

/* Copies `bytes` per frequency between the two orders. */
static void reorder(const hada_spectrum_layout *layout, size_t bytes, const char *rows_in, char *rows_out, char *blocks)
{
    const size_t cols = (size_t)layout->cols / 2 + 1, block = (size_t)layout->block, rows = (size_t)layout->rows;
    for (size_t b = 0; b < (size_t)layout->blocks; b++) {
        const size_t first = b * block, wide = cols - first < block ? cols - first : block;
        for (size_t row = 0; row < rows; row++) {
            char *there = blocks + (b * rows + row) * block * bytes;
            const size_t here = (row * cols + first) * bytes;
            if (rows_out) {
                memcpy(rows_out + here, there, wide * bytes);
            } else {
                memcpy(there, rows_in + here, wide * bytes);
                memset(there + wide * bytes, 0, (block - wide) * bytes);
            }
        }
    }
}

void hada_layout_pack(const hada_spectrum_layout *layout, const float *rows, float *blocks)
{
    reorder(layout, 2 * sizeof *rows, (const char *)rows, NULL, (char *)blocks);
}

void hada_layout_unpack(const hada_spectrum_layout *layout, const float *blocks, float *rows)
{
    reorder(layout, 2 * sizeof *rows, NULL, (char *)rows, (char *)(uintptr_t)blocks);
}

void hada_layout_pack_half(const hada_spectrum_layout *layout, const uint16_t *rows, uint16_t *blocks)
{
    reorder(layout, 2 * sizeof *rows, (const char *)rows, NULL, (char *)blocks);
}

void hada_layout_pack_real(const hada_spectrum_layout *layout, const float *rows, float *blocks)
{
    reorder(layout, sizeof *rows, (const char *)rows, NULL, (char *)blocks);
}

void hada_layout_unpack_real(const hada_spectrum_layout *layout, const float *blocks, float *rows)
{
    reorder(layout, sizeof *rows, NULL, (char *)rows, (char *)(uintptr_t)blocks);
}

void hada_layout_weights(const hada_spectrum_layout *layout, float *weights)
{
    memset(weights, 0, layout->count * sizeof *weights);
    for (int kx = 0; kx <= layout->cols / 2; kx++)
        for (int ky = 0; ky < layout->rows; ky++)
            weights[hada_spectrum_index(layout, ky, kx)] = kx == 0 || 2 * kx == layout->cols ? 1.0f : 2.0f;
}
