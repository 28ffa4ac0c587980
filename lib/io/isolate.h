/* Files that are decoded by a process of their own (bindings/reader), which can open no file and no connection, and
 * whose memory and time are bounded. One process for each open file: what one file does to it no other sees. Internal.
 */
#ifndef HADA_IO_ISOLATE_H
#define HADA_IO_ISOLATE_H

#include <hadalens/limits.h>
#include <hadalens/pixels.h>
#include <hadalens/tiff.h>

#include "core/base.h"

typedef struct hada_isolated hada_isolated;

/* Starts the process for an open file, which stays the caller's; *out is NULL where this file is to be read here. Fills
 * in *info, whose texts belong to *out. Messages do not name the file. */
hada_status hada_isolated_open(hada_isolated **out, int fd, size_t bytes, const char *path, hada_tiff_info *info,
                               hada_error *err);
/* A frame, as hada_tiff_read_stored() gives it. Here messages do name the file. */
hada_status hada_isolated_read(hada_isolated *isolated, int frame, int stored, hada_pixels *pixels, hada_error *err);
void hada_isolated_close(hada_isolated **isolated);

/* For that process: the same as hada_tiff_open() of an open file, which is taken over; never in another process. */
hada_status hada_tiff_open_here(hada_tiff_reader **out, int fd, size_t bytes, const char *path, hada_error *err);

/* Its open files: the one to read, a socket for these messages, and memory for what is longer. */
enum { HADA_READER_FILE = 3, HADA_READER_CONTROL = 4, HADA_READER_DATA = 5 };

typedef struct hada_reader_request {
    int frame, stored; /* frame -1: opens the file */
    int seconds;       /* of the processor, at most */
} hada_reader_request;

typedef struct hada_reader_reply {
    int status, sealed; /* sealed 0: this kernel cannot take the rights away */
    char message[1024];
    /* opened; its pointers mean nothing here: the distances are the beginning of the data, the description follows */
    hada_tiff_info info;
    uint64_t text_bytes;
    /* read: samples, channel by channel and row by row */
    int type, channels, rows, cols;
    double full_scale;
} hada_reader_reply;

#endif
