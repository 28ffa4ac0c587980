/* What an enhancement comes to: sizes, tiles, bytes. Internal to lib/net. */
#ifndef HADA_NET_ENHANCE_SHAPE_H
#define HADA_NET_ENHANCE_SHAPE_H

#include "net/enhance.h"

/* Columns to a cell of the map of content. */
#define HADA_CONTENT_CELL 32

typedef struct hada_enhance_shape {
    int rows, cols;           /* at which the net runs */
    int resized;              /* they are not the window's */
    int inputs;               /* 2: the net sees the other planes beside its own; else 1 */
    int tiled;                /* several tiles; the rest of this is only then */
    int full_rows, full_cols; /* rows and cols, filled up to multiples */
    int core_rows, core_cols; /* of a tile's own */
    int tile_rows, tile_cols; /* with halo */
    int tiles_down, tiles_right;
    int planes;               /* that are looked at at once, and go through the net where there is one tile */
    hada_graph_options graph; /* images: planes at once */
    size_t graph_bytes;
    int content_cells; /* in a row of the map of content */
} hada_enhance_shape;

hada_status hada_enhance_shape_of(const hada_context *context, const hada_enhance_desc *desc, hada_enhance_shape *shape,
                                  hada_error *err);

/* Where a tile of one axis begins: its own pixels, and those with halo. */
int hada_enhance_core_at(int tile, int core, int full);
int hada_enhance_tile_at(int tile, int core, int tile_size, int full);

#endif
