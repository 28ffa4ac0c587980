/* libtiff with manners: messages go to this handle, never to the process's handlers or the terminal; files are read
 * and written through file descriptors of ours, so that the operating system's reason for a failure is kept. Internal.
 */
#ifndef HADA_IO_TIFF_HANDLE_H
#define HADA_IO_TIFF_HANDLE_H

#include <stdint.h>
#include <tiffio.h>

#include "core/error.h"

typedef struct hada_tiff_handle {
    int fd;
    uint64_t position;
    uint64_t first; /* reading: where libtiff shall believe the first directory to be; 0 = as in the file */
    int swapped, big;
    int write_code;    /* errno of the first failed write, 0 where none */
    char message[512]; /* first error of libtiff since it was cleared, "" where none */
} hada_tiff_handle;

/* Opens libtiff on `handle` (whose fd the caller opens and closes). `mode` as for TIFFOpen. NULL on failure: see
 * handle->message. The handle must outlive the TIFF. */
TIFF *hada_tiff_attach(hada_tiff_handle *handle, const char *name, const char *mode);

#endif
