/* Tensors by name with text metadata, in the safetensors format (https://huggingface.co/docs/safetensors). Internal.
 * Reading takes the whole file into memory; writing streams, beside the file and renamed at the end. Little-endian. */
#ifndef HADA_IO_SAFETENSORS_H
#define HADA_IO_SAFETENSORS_H

#include "core/base.h"

/* Types that Hadalens computes with come first; the rest are read and handed on as bytes. */
typedef enum hada_dtype {
    HADA_F32 = 1,
    HADA_F64 = 2,
    HADA_F16 = 3,
    HADA_I32 = 4,
    HADA_I64 = 5,
    HADA_U8 = 6,
    HADA_BF16 = 7,
    HADA_I8 = 8,
    HADA_I16 = 9,
    HADA_U16 = 10,
    HADA_U32 = 11,
    HADA_U64 = 12,
    HADA_BOOL = 13
} hada_dtype;

/* Bytes of one value, 0 for an unknown type; the name in a file, NULL for an unknown type. */
size_t hada_dtype_bytes(hada_dtype type);
const char *hada_dtype_name(hada_dtype type);
hada_dtype hada_dtype_find(const char *name); /* 0 where unknown */

#define HADA_TENSOR_DIMS 8
typedef struct hada_stored_tensor {
    const char *name;
    hada_dtype type;
    int dims;
    int64_t shape[HADA_TENSOR_DIMS];
    const void *data; /* hada_tensor_copy_f32 reads it at any alignment */
    size_t bytes;
} hada_stored_tensor;

typedef struct hada_tensors hada_tensors;
/* Reads the file and checks the whole header (offsets inside the file, no overlap, sizes equal shapes) before anything
 * is used. Tensors are in the order of their data. Several threads may read one hada_tensors. What happens to
 * the file afterwards does not matter: it is not mapped, since one that shrinks would end the process. */
hada_status hada_tensors_open(hada_tensors **out, const char *path, hada_error *err);
void hada_tensors_close(hada_tensors **tensors);
/* Bytes of the whole file: more numbers it cannot hold. */
size_t hada_tensors_bytes(const hada_tensors *tensors);
size_t hada_tensors_count(const hada_tensors *tensors);
const hada_stored_tensor *hada_tensors_at(const hada_tensors *tensors, size_t index);
const hada_stored_tensor *hada_tensors_find(const hada_tensors *tensors, const char *name); /* NULL where absent */
/* Metadata value of a key, NULL where absent. */
const char *hada_tensors_meta(const hada_tensors *tensors, const char *key);
/* Copies `count` values from `first` as float32, converting from any float type (F64 rounds to nearest). */
hada_status hada_tensor_copy_f32(const hada_stored_tensor *tensor, size_t first, size_t count, float *out,
                                 hada_error *err);

/* Writing: declare everything, then supply the data in the order declared. The data begin at a multiple of 8 bytes and
 * tensors lie without gaps, as the format asks: declare 8-byte types first, bytes last, to keep each one aligned. */
typedef struct hada_tensors_writer hada_tensors_writer;
hada_status hada_tensors_create(hada_tensors_writer **out, const char *path, hada_error *err);
hada_status hada_tensors_put_meta(hada_tensors_writer *writer, const char *key, const char *value, hada_error *err);
hada_status hada_tensors_declare(hada_tensors_writer *writer, const char *name, hada_dtype type, int dims,
                                 const int64_t *shape, hada_error *err);
/* Appends bytes of the tensors in the order declared; may be called in pieces of any size. */
hada_status hada_tensors_write(hada_tensors_writer *writer, const void *data, size_t bytes, hada_error *err);
/* Checks that all declared bytes came, closes, renames; the writer is destroyed also on failure. */
hada_status hada_tensors_finish(hada_tensors_writer **writer, hada_error *err);
void hada_tensors_abandon(hada_tensors_writer **writer);

/* IEEE half <-> float on the host, round to nearest even. */
uint16_t hada_half_from_float(float value);
float hada_float_from_half(uint16_t half);

#endif
