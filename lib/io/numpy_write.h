/* NumPy arrays (.npy) written image by image. Internal. */
#ifndef HADA_IO_NUMPY_WRITE_H
#define HADA_IO_NUMPY_WRITE_H

#include <hadalens/image.h>

#include "core/outfile.h"

/* How values are written: as they are in 32 bits (floats); in 8 and 16 bits, 0 to `white` becomes 0 to full scale. */
typedef struct hada_numpy_values {
    int bits;
    double white;
    double encoding; /* of what hada_numpy_add() is told is light (hadalens/response.h); 0: none */
} hada_numpy_values;

typedef struct hada_numpy_writer {
    hada_outfile file;
    hada_numpy_values values;
    int is_open;
} hada_numpy_writer;

enum { HADA_NUMPY_DIMENSIONS = 8 };

/* `shape`: of the whole array, whose images (rows, cols, channels) are added one after the other. */
hada_status hada_numpy_begin(hada_numpy_writer *writer, const char *path, const uint64_t *shape, int dimensions,
                             const hada_numpy_values *values, hada_error *err);
hada_status hada_numpy_add(hada_numpy_writer *writer, const hada_image *image, int is_light, hada_error *err);
/* Gives the file its name; nothing where none is open. */
hada_status hada_numpy_finish(hada_numpy_writer *writer, hada_error *err);
void hada_numpy_abandon(hada_numpy_writer *writer);

/* One image: (rows, cols), or (rows, cols, channels); in 16 bits, 0 to 1 is the full scale. */
hada_status hada_numpy_save(const char *path, const hada_image *image, int bits, hada_error *err);

#endif
