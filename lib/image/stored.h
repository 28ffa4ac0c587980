/* Values as few bytes, without loss: whole numbers over a full scale, as cameras and files store pixels. Internal. */
#ifndef HADA_IMAGE_STORED_H
#define HADA_IMAGE_STORED_H

#include <stddef.h>

/* A value is the float that is nearest to number / scale, with numbers of `bytes` 1 or 2; 4: floats as they are. */
typedef struct hada_stored {
    int bytes;
    float scale;
} hada_stored;

/* Stores `count` values at `out`, which has room for as many floats, as the smallest numbers that give each of them
 * back to the bit. *stored takes how; what it was is tried first (zero: nothing was). */
void hada_stored_pack(const float *values, size_t count, void *out, hada_stored *stored);

#endif
