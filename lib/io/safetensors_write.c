#include <errno.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/alloc.h"
#include "core/outfile.h"
#include "io/safetensors.h"

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
    hada_status status = not_started(w, "metadata", err);
    if (status)
        return status;
    json_t *text = json_string(value);
    if (!text || json_object_set_new(w->meta, key, text))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the metadata \"%.200s\" is not UTF-8 text (or memory ran out)",
                         key);
    return HADA_OK;
}

hada_status hada_tensors_declare(hada_tensors_writer *w, const char *name, hada_dtype type, int dims,
                                 const int64_t *shape, hada_error *err)
{
    hada_status status = not_started(w, "declarations", err);
    if (status)
        return status;
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
    hada_tensors_writer *w = writer ? *writer : NULL;
    if (!w)
        return;
    hada_outfile_abandon(&w->file);
    json_decref(w->header);
    json_decref(w->meta);
    free(w);
    *writer = NULL;
}
