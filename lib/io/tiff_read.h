/* What the other rooms ask of a reader beyond its public side. Internal. */
#ifndef HADA_IO_TIFF_READ_H
#define HADA_IO_TIFF_READ_H

#include <hadalens/tiff.h>

/* For whoever holds all frames of a file at once: whether the limits allow them. */
hada_status hada_tiff_check_all(const hada_tiff_reader *reader, hada_error *err);

#endif
