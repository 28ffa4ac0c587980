/* The receptive field of a net, what a pixel of its output depends on: whether and how images can be run in tiles.
 * Internal. */
#ifndef HADA_NET_RECEPTIVE_FIELD_H
#define HADA_NET_RECEPTIVE_FIELD_H

#include "netlist/net_list.h"

typedef struct hada_receptive_field {
    int tiles;    /* 1: the output has the input's size and its pixels depend on their surroundings alone */
    int multiple; /* tiles begin at multiples of this many pixels, and images have multiples of it */
    int halo;     /* pixels around a tile that its output depends on, a multiple of `multiple` */
} hada_receptive_field;

/* For convolutions whose pixels do not depend on the place in the image (every method but Winograd). */
hada_status hada_net_receptive_field(const hada_net *net, hada_receptive_field *field, hada_error *err);

#endif
