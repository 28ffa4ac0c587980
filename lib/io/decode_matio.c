/* MATLAB files of version 7.3, which are HDF5 files, by matio: the largest array of numbers. */
#include "io/decode.h"

#ifndef HADALENS_MATIO
const hada_decoder hada_matio = {
    .missing = "a MATLAB file of version 7.3, which this build cannot read; save it as -v7, or build with matio "
               "(Debian: libmatio-dev)"};
#else
#include <matio.h>

static struct {
    __typeof__(Mat_Open) *open;
    __typeof__(Mat_Close) *close;
    __typeof__(Mat_VarReadNextInfo) *next;
    __typeof__(Mat_VarReadDataAll) *read;
    __typeof__(Mat_VarFree) *free;
} api;

static const hada_symbol symbols[] = {
    HADA_SYMBOL(api.open, "Mat_Open"),
    HADA_SYMBOL(api.close, "Mat_Close"),
    HADA_SYMBOL(api.next, "Mat_VarReadNextInfo"),
    HADA_SYMBOL(api.read, "Mat_VarReadDataAll"),
    HADA_SYMBOL(api.free, "Mat_VarFree"),
};

static hada_library library = {
    HADALENS_MATIO, "MATLAB files of version 7.3 cannot be read", "libmatio11", symbols, HADA_COUNT(symbols), 0};

/* A file with more variables is none of pictures. */
enum { MOST_VARIABLES = 1000 };

static int bits_of(const matvar_t *variable)
{
    switch (variable->class_type) {
    case MAT_C_UINT8: return 8;
    case MAT_C_UINT16:
    case MAT_C_INT16: return 16;
    case MAT_C_INT8: return 8;
    case MAT_C_UINT32:
    case MAT_C_INT32:
    case MAT_C_SINGLE: return 32;
    case MAT_C_DOUBLE: return 64;
    default: return 0;
    }
}

static uint64_t values_of(const matvar_t *variable)
{
    uint64_t values = bits_of(variable) && !variable->isComplex && variable->rank >= 2 && variable->rank <= 4;
    for (int i = 0; values && i < variable->rank; i++)
        values = variable->dims[i] && values > UINT64_MAX / variable->dims[i] ? UINT64_MAX : values * variable->dims[i];
    return values;
}

static hada_status find_largest(matvar_t **largest, mat_t *file, hada_error *err)
{
    matvar_t *variable;
    uint64_t most = 1; /* a single number is no picture */
    for (int i = 0; i < MOST_VARIABLES && (variable = api.next(file)); i++) {
        const uint64_t values = values_of(variable);
        matvar_t *const less = values > most ? *largest : variable;
        if (values > most) {
            most = values;
            *largest = variable;
        }
        api.free(less);
    }
    return *largest ? HADA_OK
                    : hada_fail(err, HADA_ERROR_FILE_FORMAT,
                                "this MATLAB file holds no array of real numbers of 2 to 4 dimensions");
}

static hada_status decode(hada_decoded *out, int fd, const unsigned char *data, size_t bytes, hada_error *err)
{
    char path[32];
    mat_t *file = NULL;
    matvar_t *variable = NULL;
    hada_status status = HADA_OK;
    (void)data;
    snprintf(path, sizeof path, "/dev/fd/%d", fd);
    file = api.open(path, MAT_ACC_RDONLY);
    if (!file)
        return hada_fail(err, HADA_ERROR_FILE_READ, "this MATLAB file cannot be read; save it as -v7");
    HADA_TRY_OR_DONE(find_largest(&variable, file, err));
    hada_array array = {.dimensions = variable->rank, .columns_first = 1, .frames_last = 1};
    for (int i = 0; i < variable->rank; i++)
        array.size[i] = variable->dims[i];
    out->page.bits = bits_of(variable);
    out->page.is_float = variable->class_type == MAT_C_SINGLE || variable->class_type == MAT_C_DOUBLE;
    out->page.is_signed = variable->class_type == MAT_C_INT8 || variable->class_type == MAT_C_INT16 ||
                          variable->class_type == MAT_C_INT32;
    HADA_TRY_OR_DONE(hada_array_frames(out, &array, bytes, err));
    const uint64_t all = hada_tiff_page_bytes(&out->page) * (uint64_t)out->frames;
    if (api.read(file, variable) || !variable->data || variable->nbytes < all)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ, "this MATLAB file is damaged; get it again"));
    HADA_TRY_OR_DONE(hada_array_order(out, &array, variable->data, err));
done:
    if (variable)
        api.free(variable);
    api.close(file);
    return status;
}

const hada_decoder hada_matio = {.library = &library, .itself = 1, .decode = decode};
#endif
