/* Place of the value (ky, kx) of a half spectrum, counted in complex numbers from the start of its image: columns are
 * stored in blocks of `block`, so that a pass along columns reads memory in order. The host's form is
 * hada_spectrum_index(). */
#ifndef INC_SPECTRUM_H
#define INC_SPECTRUM_H

static inline size_t spectrum_index(int rows, int block, int ky, int kx)
{
    return ((size_t)(kx / block) * (size_t)rows + (size_t)ky) * (size_t)block + (size_t)(kx % block);
}

#endif
