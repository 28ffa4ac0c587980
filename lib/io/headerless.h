/* Frames without a header: one after the other, as cameras write them into files and pipes. Internal. */
#ifndef HADA_IO_HEADERLESS_H
#define HADA_IO_HEADERLESS_H

#include <hadalens/pixels.h>

#include "core/base.h"

typedef enum hada_packing {
    HADA_PACKING_NONE = 0, /* a byte for each sample, or two, the lower one first */
    HADA_PACKING_CSI10,    /* 4 samples in 5 bytes: the upper 8 bits of each, then the lower ones together */
    HADA_PACKING_CSI12     /* 2 samples in 3 bytes, likewise */
} hada_packing;

typedef struct hada_headerless {
    int rows, cols, channels; /* 3: red, green and blue of each pixel together */
    int bits;                 /* of a sample: 8 to 16 */
    hada_packing packing;
    uint64_t row_bytes; /* from row to row; 0: not known, HADA_HEADERLESS_ALIGNMENTS are tried */
} hada_headerless;

/* What hada_headerless_set() said; 0: nothing. */
int hada_headerless_get(hada_headerless *frames);

/* Bytes of a frame whose rows begin at multiples of `alignment` bytes, where row_bytes does not say it. */
uint64_t hada_headerless_bytes(const hada_headerless *frames, unsigned alignment);

/* Sets row_bytes so that a file of `bytes` holds whole frames, and *count to their number. */
hada_status hada_headerless_fit(hada_headerless *frames, uint64_t bytes, int *count, hada_error *err);

/* A frame's samples, row for row without gaps, as bytes or in the machine's 16 bits. */
void hada_headerless_unpack(const hada_headerless *frames, const unsigned char *from, void *to);

#endif
