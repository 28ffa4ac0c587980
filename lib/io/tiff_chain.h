/* The bones of a TIFF file, read without libtiff: byte order, classic or Big, and where each directory stands.
 * One pass over the directories, so that opening a page later costs the same for the first and the last. Internal. */
#ifndef HADA_IO_TIFF_CHAIN_H
#define HADA_IO_TIFF_CHAIN_H

#include <stddef.h>
#include <stdint.h>

#include "core/error.h"

typedef struct hada_tiff_chain {
    int swapped;     /* the file's byte order is not the machine's */
    int big;         /* BigTIFF */
    uint64_t bytes;  /* of the file */
    uint64_t *pages; /* offsets of the directories, thumbnails and masks left out */
    size_t count;
} hada_tiff_chain;

/* `fd` stays the caller's. */
hada_status hada_tiff_chain_read(hada_tiff_chain *chain, int fd, hada_error *err);
void hada_tiff_chain_free(hada_tiff_chain *chain);

/* Where the value of `tag` in the directory at `directory` stands in the file, and how many bytes it has; 0 when the
 * directory has no such tag. */
uint64_t hada_tiff_chain_find(const hada_tiff_chain *chain, int fd, uint64_t directory, unsigned tag, uint64_t *bytes);

/* pread() of exactly `bytes`; 0 on success. */
int hada_read_at(int fd, void *out, size_t bytes, uint64_t offset);

#endif
