/* Enhancing refocused planes by a net, in place. Internal.
 *
 * A plane goes to the net's size (bilinear, where that differs from the window's), through the net, and back; what
 * comes out below zero becomes zero, as intensities are. A plane without content is left alone. Where memory is too
 * short for a whole plane it is run in tiles with a halo of what they depend on: the tiles that are computed
 * hold the bits that the whole plane at once would have given by direct convolutions, and tiles that see no content at
 * all, halo included, are dark. Sizes that are no multiple of what tiles need are filled up with zeros then.
 *
 * A net that takes twice the planes' channels sees beside a plane the light of all others that explain the frame
 * together with it: their sum (before they are enhanced), 0 where there are none. Several such planes keep the shares
 * that come out, of what the net makes of their sum alone; or of the sum as it is, where the net only shares (`shares`
 * of its list): that net leaves a plane alone that stands by itself. It runs at the window's size. */
#ifndef HADA_NET_ENHANCE_H
#define HADA_NET_ENHANCE_H

#include "net/graph.h"
#include "netlist/net_list.h"

typedef struct hada_enhance_desc {
    const hada_net *net;
    int channels, rows, cols; /* of a plane: the window */
    int net_rows, net_cols;   /* size at which the net runs; 0: the window's */
    size_t memory;            /* most bytes of the net's activations; 0: a quarter of the device's memory */
    int planes;               /* that go through the net at once where memory allows and they fit whole; 0: one */
    int tile_rows, tile_cols; /* at least this many tiles, for tests; 0: one */
    float content;            /* values of at most this magnitude are no content; 0: only zeros are none */
    hada_conv_method method;
} hada_enhance_desc;

typedef struct hada_enhance hada_enhance;

/* Whether a net sees the other planes beside its own. */
static inline int hada_enhance_sees_others(const hada_net *net, int channels)
{
    return net->colours == 1 && net->layers[0].channels == 2 * channels;
}

/* HADA_ERROR_MODEL where the net cannot take and give planes like these.
 * Copies the weights to the device. The net must live as long as the object. */
hada_status hada_enhance_create(hada_enhance **out, hada_slot *slot, const hada_enhance_desc *desc, hada_error *err);
void hada_enhance_destroy(hada_enhance **enhance);

/* Enhances `count` planes [plane][channel][row][col] that begin at float `offset`, in place. together: 1 where these
 * are all that explain a frame jointly. Waits for the content of so many planes as go at once, not for the end. */
hada_status hada_enhance_run(hada_enhance *enhance, cl_mem planes, size_t offset, int count, int together,
                             hada_error *err);

/* Whether such a run changes anything, whatever the planes hold. */
int hada_enhance_acts(const hada_enhance *enhance, int count, int together);

/* How many tiles the last run computed and left out; a plane that is run at once is a tile. */
void hada_enhance_counts(const hada_enhance *enhance, int *computed, int *left_out);

/* The receptive field of a net, on which a pixel of its output depends: whether and how images can be run in tiles. */
typedef struct hada_receptive_field {
    int tiles;    /* 1: the output has the input's size and its pixels depend on their surroundings alone */
    int multiple; /* tiles begin at multiples of this many pixels, and images have multiples of it */
    int halo;     /* pixels around a tile that its output depends on, a multiple of `multiple` */
} hada_receptive_field;

/* For convolutions whose pixels do not depend on the place in the image (every method but Winograd). */
hada_status hada_net_receptive_field(const hada_net *net, hada_receptive_field *field, hada_error *err);

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

#endif
