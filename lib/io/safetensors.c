#include "io/safetensors.h"

#include <errno.h>
#include <hadalens/limits.h>
#include <jansson.h>
#include <unistd.h>

#include "core/input.h"
#include "core/outfile.h"

/* The limit of the reference implementation. */
#define HEADER_LIMIT ((uint64_t)100000000)
/* Bytes of a file before its header: how long this is. */
#define LENGTH_BYTES 8

struct hada_tensors {
    json_t *header;
    const json_t *meta;
    hada_stored_tensor *list;
    const hada_stored_tensor **by_name; /* the same, sorted */
    size_t count;
    unsigned char *data; /* the whole file */
    size_t bytes;
};

static const struct {
    const char *name;
    hada_dtype type;
    size_t bytes;
} types[] = {{"F32", HADA_F32, 4},  {"F64", HADA_F64, 8}, {"F16", HADA_F16, 2},   {"I32", HADA_I32, 4},
             {"I64", HADA_I64, 8},  {"U8", HADA_U8, 1},   {"BF16", HADA_BF16, 2}, {"I8", HADA_I8, 1},
             {"I16", HADA_I16, 2},  {"U16", HADA_U16, 2}, {"U32", HADA_U32, 4},   {"U64", HADA_U64, 8},
             {"BOOL", HADA_BOOL, 1}};
#define TYPES (sizeof types / sizeof types[0])

size_t hada_dtype_bytes(hada_dtype type)
{
    for (size_t i = 0; i < TYPES; i++)
        if (types[i].type == type)
            return types[i].bytes;
    return 0;
}

const char *hada_dtype_name(hada_dtype type)
{
    for (size_t i = 0; i < TYPES; i++)
        if (types[i].type == type)
            return types[i].name;
    return NULL;
}

hada_dtype hada_dtype_find(const char *name)
{
    for (size_t i = 0; i < TYPES; i++)
        if (!strcmp(types[i].name, name))
            return types[i].type;
    return (hada_dtype)0;
}

static hada_status bad(hada_error *err, const char *name, const char *why)
{
    return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                     "the safetensors header is damaged: tensor \"%.200s\" %s; get the file again", name, why);
}

/* Checks one entry and fills *tensor; `data` of `data_bytes` is what follows the header. */
static hada_status read_entry(const char *name, const json_t *entry, const unsigned char *data, uint64_t data_bytes,
                              hada_stored_tensor *tensor, hada_error *err)
{
    const json_t *dtype = json_object_get(entry, "dtype"), *shape = json_object_get(entry, "shape"),
                 *offsets = json_object_get(entry, "data_offsets");
    if (!json_is_string(dtype) || !json_is_array(shape) || !json_is_array(offsets) || json_array_size(offsets) != 2)
        return bad(err, name, "lacks its dtype, shape or data_offsets");
    tensor->name = name;
    tensor->type = hada_dtype_find(json_string_value(dtype));
    if (!tensor->type)
        return hada_fail(
            err, HADA_ERROR_FILE_FORMAT,
            "tensor \"%.200s\" has the type \"%.40s\", which is not offered; convert it to F32, F16 or BF16", name,
            json_string_value(dtype));
    if (json_array_size(shape) > HADA_TENSOR_DIMS)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "tensor \"%.200s\" has %zu dimensions; at most %d are offered",
                         name, json_array_size(shape), HADA_TENSOR_DIMS);
    tensor->dims = (int)json_array_size(shape);
    uint64_t count = 1;
    int empty = 0;
    for (int d = 0; d < tensor->dims; d++) {
        const json_t *extent = json_array_get(shape, (size_t)d);
        if (!json_is_integer(extent) || json_integer_value(extent) < 0)
            return bad(err, name, "has a shape that is not a list of sizes");
        tensor->shape[d] = json_integer_value(extent);
        empty |= !tensor->shape[d];
        if (tensor->shape[d] && count > (uint64_t)INT64_MAX / 8 / (uint64_t)tensor->shape[d])
            return bad(err, name, "has an impossibly large shape");
        count *= tensor->shape[d] ? (uint64_t)tensor->shape[d] : 1;
    }
    const json_t *first = json_array_get(offsets, 0), *last = json_array_get(offsets, 1);
    if (!json_is_integer(first) || !json_is_integer(last) || json_integer_value(first) < 0 ||
        json_integer_value(last) < json_integer_value(first))
        return bad(err, name, "has data_offsets that are not two ascending sizes");
    uint64_t begin = (uint64_t)json_integer_value(first), end = (uint64_t)json_integer_value(last);
    if (end > data_bytes)
        return hada_fail(err, HADA_ERROR_FILE_READ,
                         "tensor \"%.200s\" ends at byte %llu of the data, but there are only %llu: the file is cut "
                         "off; get it again",
                         name, (unsigned long long)end, (unsigned long long)data_bytes);
    if (end - begin != (empty ? 0 : count * hada_dtype_bytes(tensor->type)))
        return bad(err, name, "occupies another number of bytes than its shape and type need");
    tensor->data = data + begin;
    tensor->bytes = (size_t)(end - begin);
    return HADA_OK;
}

static int by_place(const void *a, const void *b)
{
    const hada_stored_tensor *left = a, *right = b;
    if (left->data != right->data)
        return left->data < right->data ? -1 : 1;
    if (left->bytes != right->bytes)
        return left->bytes < right->bytes ? -1 : 1;
    return strcmp(left->name, right->name);
}

static int by_name(const void *a, const void *b)
{
    const hada_stored_tensor *const *left = a, *const *right = b;
    return strcmp((*left)->name, (*right)->name);
}

static hada_status read_meta(hada_tensors *tensors, hada_error *err)
{
    tensors->meta = json_object_get(tensors->header, "__metadata__");
    if (!tensors->meta)
        return HADA_OK;
    if (!json_is_object(tensors->meta))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "the safetensors header is damaged: __metadata__ is not an object");
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)tensors->meta, key, value) if (!json_is_string(value)) return hada_fail(
        err, HADA_ERROR_FILE_FORMAT,
        "the safetensors header is damaged: the metadata value of \"%.200s\" is not a text", key);
    return HADA_OK;
}

/* From the first bytes of a file, before memory is taken for all of it. */
static hada_status read_length(const unsigned char *bytes, uint64_t *length, hada_error *err)
{
    *length = 0;
    for (int i = LENGTH_BYTES - 1; i >= 0; i--)
        *length = *length << 8 | bytes[i];
    return *length <= HEADER_LIMIT && *length >= 2 && bytes[LENGTH_BYTES] == '{'
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_FILE_FORMAT,
                           "not a safetensors file, as models and weights are (no header of a plausible length)");
}

/* The header's text, as JSON; *end: bytes of the file up to the data. */
static hada_status read_header(hada_tensors *tensors, size_t *end, hada_error *err)
{
    const unsigned char *bytes = tensors->data;
    hada_limits limits = {.size = sizeof limits};
    uint64_t length = 0;
    json_error_t why;
    HADA_TRY(hada_limits_get(&limits, err));
    HADA_TRY(read_length(bytes, &length, err));
    if (length > tensors->bytes - 8)
        return hada_fail(err, HADA_ERROR_FILE_READ,
                         "the safetensors header has %llu bytes, but the file ends before: it is cut off; get it again",
                         (unsigned long long)length);
    if (length > limits.text)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "the safetensors header has %llu bytes, more than the limits allow (options.limits text=N)",
                         (unsigned long long)length);
    if (hada_json_is_bloated((const char *)bytes + 8, (size_t)length))
        return hada_fail(
            err, HADA_ERROR_FILE_FORMAT,
            "the safetensors header is damaged: it is made of little else than brackets and commas; get the file again");
    tensors->header = json_loadb((const char *)bytes + 8, (size_t)length, JSON_REJECT_DUPLICATES, &why);
    if (!json_is_object(tensors->header))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "the safetensors header is damaged: %s at its byte %d", why.text,
                         why.position);
    *end = 8 + (size_t)length;
    return HADA_OK;
}

static hada_status list_tensors(hada_tensors *tensors, const unsigned char *data, uint64_t data_bytes, hada_error *err)
{
    static const char what[] = "the list of tensors";
    const size_t most = json_object_size(tensors->header);
    const char *name;
    json_t *entry;
    HADA_TRY(HADA_NEW(tensors->list, most, what, err));
    HADA_TRY(HADA_NEW(tensors->by_name, most, what, err));
    json_object_foreach(tensors->header, name, entry)
    {
        if (!strcmp(name, "__metadata__"))
            continue;
        HADA_TRY(read_entry(name, entry, data, data_bytes, &tensors->list[tensors->count], err));
        tensors->count++;
    }
    qsort(tensors->list, tensors->count, sizeof *tensors->list, by_place);
    for (size_t i = 0; i < tensors->count; i++)
        tensors->by_name[i] = &tensors->list[i];
    qsort(tensors->by_name, tensors->count, sizeof *tensors->by_name, by_name);
    return HADA_OK;
}

/* Whether the tensors fill the data, one behind the other. */
static hada_status check_places(const hada_tensors *tensors, const unsigned char *data, uint64_t data_bytes,
                                hada_error *err)
{
    const unsigned char *expected = data;
    for (size_t i = 0; i < tensors->count; i++) {
        const unsigned char *at = tensors->list[i].data;
        if (at != expected)
            return bad(err, tensors->list[i].name,
                       at < expected ? "overlaps another tensor"
                                     : "does not follow the tensor before it without a gap");
        expected = at + tensors->list[i].bytes;
    }
    if (expected != data + data_bytes)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "the safetensors file has %llu bytes after its last tensor; get the file again",
                         (unsigned long long)(data + data_bytes - expected));
    return HADA_OK;
}

static hada_status parse(hada_tensors *tensors, hada_error *err)
{
    size_t end = 0;
    HADA_TRY(read_header(tensors, &end, err));
    HADA_TRY(read_meta(tensors, err));
    HADA_TRY(list_tensors(tensors, tensors->data + end, tensors->bytes - end, err));
    return check_places(tensors, tensors->data + end, tensors->bytes - end, err);
}

static hada_status read_file(hada_tensors *tensors, const char *path, hada_error *err)
{
    int fd = -1;
    unsigned char first[LENGTH_BYTES + 1];
    uint64_t length;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_input_open(&fd, &tensors->bytes, path, NULL, err));
    if (tensors->bytes < 10)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ, "%s: not a safetensors file",
                                   tensors->bytes ? "the file has fewer than 10 bytes" : "the file is empty"));
    if (!hada_read_at(fd, first, sizeof first, 0))
        HADA_TRY_OR_DONE(read_length(first, &length, err));
    HADA_TRY_OR_DONE(hada_allocated(tensors->data = hada_alloc_raw(tensors->bytes, 1, "the file", err)));
    if (hada_read_at(fd, tensors->data, tensors->bytes, 0))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_FILE_READ, "cannot be read: it became shorter meanwhile, or the disk fails"));
done:
    if (fd >= 0)
        close(fd);
    return status;
}

hada_status hada_tensors_open(hada_tensors **out, const char *path, hada_error *err)
{
    *out = NULL;
    hada_tensors *tensors = calloc(1, sizeof *tensors);
    if (!tensors)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory to open %s", path);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(read_file(tensors, path, err));
    HADA_TRY_OR_DONE(parse(tensors, err));
done:
    if (status) {
        hada_error_prefix(err, "%s: ", path);
        hada_tensors_close(&tensors);
    }
    *out = tensors;
    return status;
}

void hada_tensors_close(hada_tensors **tensors)
{
    hada_tensors *t = hada_taken(tensors);
    if (!t)
        return;
    free(t->data);
    json_decref(t->header);
    HADA_FREE(t->list, t->by_name, t);
}

size_t hada_tensors_bytes(const hada_tensors *tensors)
{
    return tensors->bytes;
}

size_t hada_tensors_count(const hada_tensors *tensors)
{
    return tensors->count;
}

const hada_stored_tensor *hada_tensors_at(const hada_tensors *tensors, size_t index)
{
    return index < tensors->count ? &tensors->list[index] : NULL;
}

const hada_stored_tensor *hada_tensors_find(const hada_tensors *tensors, const char *name)
{
    const hada_stored_tensor key = {.name = name}, *wanted = &key;
    const hada_stored_tensor **found =
        bsearch(&wanted, tensors->by_name, tensors->count, sizeof *tensors->by_name, by_name);
    return found ? *found : NULL;
}

const char *hada_tensors_meta(const hada_tensors *tensors, const char *key)
{
    return json_string_value(json_object_get(tensors->meta, key));
}

hada_status hada_tensor_copy_f32(const hada_stored_tensor *tensor, size_t first, size_t count, float *out,
                                 hada_error *err)
{
    size_t size = hada_dtype_bytes(tensor->type), total = size ? tensor->bytes / size : 0;
    if (first > total || count > total - first)
        return hada_fail(err, HADA_ERROR_SIZE, "tensor \"%.200s\" has %zu values; %zu from number %zu were asked for",
                         tensor->name, total, count, first);
    const unsigned char *from = (const unsigned char *)tensor->data + first * size;
    switch (tensor->type) {
    case HADA_F32: memcpy(out, from, count * sizeof *out); return HADA_OK;
    case HADA_F64:
        for (size_t i = 0; i < count; i++) {
            double value;
            memcpy(&value, from + i * 8, sizeof value);
            out[i] = (float)value;
        }
        return HADA_OK;
    case HADA_F16:
        for (size_t i = 0; i < count; i++) {
            uint16_t half;
            memcpy(&half, from + i * 2, sizeof half);
            out[i] = hada_float_from_half(half);
        }
        return HADA_OK;
    case HADA_BF16:
        for (size_t i = 0; i < count; i++) {
            uint16_t upper;
            memcpy(&upper, from + i * 2, sizeof upper);
            uint32_t bits = (uint32_t)upper << 16;
            memcpy(out + i, &bits, sizeof bits);
        }
        return HADA_OK;
    default:
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "tensor \"%.200s\" holds %s; a float type is needed here",
                         tensor->name, hada_dtype_name(tensor->type));
    }
}

/* IEEE 754 binary16 <-> binary32. */

uint16_t hada_half_from_float(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    uint32_t sign = (bits >> 16) & 0x8000u, magnitude = bits & 0x7fffffffu;
    if (magnitude > 0x7f800000u) /* NaN: keep the upper payload, stay quiet */
        return (uint16_t)(sign | 0x7e00u | ((magnitude >> 13) & 0x1ffu));
    if (magnitude >= 0x477ff000u) /* rounds to 65536 or more */
        return (uint16_t)(sign | 0x7c00u);
    if (magnitude < 0x38800000u) { /* subnormal or zero: units of 2^-24 */
        uint32_t exponent = magnitude >> 23;
        if (exponent < 102)
            return (uint16_t)sign;
        uint32_t mantissa = (magnitude & 0x7fffffu) | 0x800000u, shift = 126 - exponent;
        uint32_t whole = mantissa >> shift, rest = mantissa & ((1u << shift) - 1u), half = 1u << (shift - 1);
        whole += rest > half || (rest == half && (whole & 1u));
        return (uint16_t)(sign | whole);
    }
    uint32_t rounded = magnitude + 0xfffu + ((magnitude >> 13) & 1u);
    return (uint16_t)(sign | ((rounded - 0x38000000u) >> 13));
}

float hada_float_from_half(uint16_t half)
{
    uint32_t sign = (uint32_t)(half & 0x8000u) << 16, exponent = (half >> 10) & 31u, mantissa = half & 0x3ffu, bits;
    if (exponent == 31) {
        bits = 0x7f800000u | (mantissa << 13);
    } else if (exponent) {
        bits = ((exponent + 112u) << 23) | (mantissa << 13);
    } else { /* zero and subnormals are exact in float */
        float value = (float)mantissa * 0x1p-24f;
        memcpy(&bits, &value, sizeof bits);
    }
    bits |= sign;
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

struct hada_tensors_writer {
    hada_outfile file;
    json_t *header, *meta;
    uint64_t declared, written;
    int started; /* the header is in the file */
};

hada_status hada_tensors_create(hada_tensors_writer **out, const char *path, hada_error *err)
{
    *out = NULL;
    hada_tensors_writer *w = calloc(1, sizeof *w);
    if (!w)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory to write %s", path);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_outfile_open(&w->file, path, err));
    w->header = json_object();
    w->meta = json_object();
    if (!w->header || !w->meta || json_object_set(w->header, "__metadata__", w->meta))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory to write %s", path));
done:
    if (status)
        hada_tensors_abandon(&w);
    *out = w;
    return status;
}

static hada_status not_started(const hada_tensors_writer *w, const char *what, hada_error *err)
{
    return w->started ? hada_fail(err, HADA_ERROR_STATE, "%s must come before the first data", what) : HADA_OK;
}

hada_status hada_tensors_put_meta(hada_tensors_writer *w, const char *key, const char *value, hada_error *err)
{
    HADA_TRY(not_started(w, "metadata", err));
    json_t *text = json_string(value);
    if (!text || json_object_set_new(w->meta, key, text))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the metadata \"%.200s\" is not UTF-8 text (or memory ran out)",
                         key);
    return HADA_OK;
}

hada_status hada_tensors_declare(hada_tensors_writer *w, const char *name, hada_dtype type, int dims,
                                 const int64_t *shape, hada_error *err)
{
    HADA_TRY(not_started(w, "declarations", err));
    uint64_t bytes = hada_dtype_bytes(type);
    if (!bytes || dims < 0 || dims > HADA_TENSOR_DIMS || json_object_get(w->header, name))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "tensor \"%.200s\" is declared twice, or its type or dimensions are not valid", name);
    for (int d = 0; d < dims; d++) {
        if (shape[d] < 0 || (shape[d] && bytes > (uint64_t)INT64_MAX / 2 / (uint64_t)shape[d]))
            return hada_fail(err, HADA_ERROR_ARGUMENT, "tensor \"%.200s\" has an impossible shape", name);
        bytes *= (uint64_t)shape[d];
    }
    const uint64_t end = w->declared + bytes;
    if (end > INT64_MAX)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "with tensor \"%.200s\" the file would have an impossible size",
                         name);
    json_t *extents = json_array();
    for (int d = 0; d < dims; d++)
        json_array_append_new(extents, json_integer(shape[d]));
    json_t *entry = json_pack("{s:s, s:o, s:[I, I]}", "dtype", hada_dtype_name(type), "shape", extents, "data_offsets",
                              (json_int_t)w->declared, (json_int_t)end);
    if (!entry || json_object_set_new(w->header, name, entry))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "tensor \"%.200s\" could not be declared: its name is not UTF-8 text", name);
    w->declared = end;
    return HADA_OK;
}

static hada_status start(hada_tensors_writer *w, hada_error *err)
{
    if (w->started)
        return HADA_OK;
    if (!json_object_size(w->meta))
        json_object_del(w->header, "__metadata__");
    char *text = json_dumps(w->header, JSON_COMPACT);
    if (!text)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the header of %s", w->file.path);
    size_t length = strlen(text), padded = (length + 7) / 8 * 8;
    unsigned char size[8];
    for (int i = 0; i < 8; i++)
        size[i] = (unsigned char)((uint64_t)padded >> 8 * i);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_outfile_write(&w->file, size, sizeof size, err));
    HADA_TRY_OR_DONE(hada_outfile_write(&w->file, text, length, err));
    HADA_TRY_OR_DONE(hada_outfile_write(&w->file, "       ", padded - length, err));
done:
    free(text);
    w->started = 1;
    return status;
}

hada_status hada_tensors_write(hada_tensors_writer *w, const void *data, size_t bytes, hada_error *err)
{
    if (bytes > w->declared - w->written)
        return hada_fail(err, HADA_ERROR_SIZE, "%s: more data than the declared tensors hold (%llu bytes)",
                         w->file.path, (unsigned long long)w->declared);
    HADA_TRY(start(w, err));
    HADA_TRY(hada_outfile_write(&w->file, data, bytes, err));
    w->written += bytes;
    return HADA_OK;
}

hada_status hada_tensors_finish(hada_tensors_writer **writer, hada_error *err)
{
    hada_tensors_writer *w = *writer;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(start(w, err));
    if (w->written != w->declared)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_STATE, "%s: %llu of %llu declared bytes were written", w->file.path,
                                   (unsigned long long)w->written, (unsigned long long)w->declared));
    HADA_TRY_OR_DONE(hada_outfile_commit(&w->file, err));
done:
    hada_tensors_abandon(writer);
    return status;
}

void hada_tensors_abandon(hada_tensors_writer **writer)
{
    hada_tensors_writer *w = hada_taken(writer);
    if (!w)
        return;
    hada_outfile_abandon(&w->file);
    json_decref(w->header);
    json_decref(w->meta);
    free(w);
}
