/* The tuning file: which of several ways of doing the same to use, for kinds of devices and shapes. It overrides
 * shipped tables; docs/reference/devices.md describes it. Read once, when a context opens; a row that cannot be
 * understood is an error then. Internal. */
#ifndef HADA_RUNTIME_TUNING_H
#define HADA_RUNTIME_TUNING_H

#include "runtime/context.h"

enum { HADA_TUNING_WORD = 64, HADA_TUNING_LINE = 256 };
/* A file has no more: a row a shape, thousands of shapes. */
#define HADA_TUNING_BYTES ((size_t)1 << 22)

/* "fft KIND SHAPE CHOICE". KIND and SHAPE may be "*". */
typedef struct hada_tuning_row {
    int line;
    char kind[HADA_TUNING_WORD], shape[HADA_TUNING_WORD], choice[HADA_TUNING_WORD];
} hada_tuning_row;

struct hada_tuning {
    char *path;
    hada_tuning_row *rows;
    size_t count;
};

/* A file that is not there is no tuning: *out is NULL then. HADA_ERROR_FILE_FORMAT names the line. */
hada_status hada_tuning_read(hada_tuning **out, const char *path, hada_error *err);
void hada_tuning_destroy(hada_tuning **tuning);

/* The last row that names the context's kind of device and a shape. Shapes match where they are
 * equal, or where the row's begins the shape and ends in "*". NULL: none. */
const hada_tuning_row *hada_tuning_find(const hada_context *context, const char *shape);

/* Writes rows for the context's kind of device into a file: `choices` are what follows the shapes. Lines of an existing
 * file stay, but for those about the same kind and shape; also when several processes write at once. */
hada_status hada_tuning_write(const hada_context *context, const char *path, const char *const *shapes,
                              const char *const *choices, size_t count, hada_error *err);

#endif
