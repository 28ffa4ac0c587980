/* Lists of pictures that were taken at positions of the field: point spread functions. Internal. */
#ifndef HADA_IO_POSITIONS_H
#define HADA_IO_POSITIONS_H

#include "core/base.h"

typedef struct hada_position {
    char *path;      /* as it can be opened */
    double x, y;     /* in pixels from the top left of the picture */
    double distance; /* mm; below 0: not said */
    int place;       /* in the file */
} hada_position;

typedef struct hada_positions {
    hada_position *list; /* by distance, near to far, then as the file has them */
    int count;
    int depths; /* distances, each with as many positions; 0: none is said */
} hada_positions;

/* Reads lines `file,x_px,y_px` or `file,x_px,y_px,distance_mm`, with commas, semicolons or blanks between; a heading,
 * empty lines and those that begin with # are passed over. Files are beside the list. HADA_ERROR_FILE_FORMAT. */
hada_status hada_positions_read(hada_positions *out, const char *path, hada_error *err);
void hada_positions_free(hada_positions *positions);

#endif
