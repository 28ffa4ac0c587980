#include "io/encode.h"

#include <hadalens/response.h>

#include "core/base.h"

static const uint16_t one = 1;

static int is_little_endian(void)
{
    return *(const unsigned char *)&one;
}

static const char *type_of(int bits)
{
    return bits == 32 ? "f4" : bits == 16 ? "u2" : "u1";
}

hada_status hada_numpy_begin(hada_numpy_writer *writer, const char *path, const uint64_t *shape, int dimensions,
                             const hada_numpy_values *values, hada_error *err)
{
    enum { BEFORE_TEXT = 10, ALIGNMENT = 64, NUMBER = 24 };
    char text[BEFORE_TEXT + 2 * ALIGNMENT + NUMBER * HADA_NUMPY_DIMENSIONS] =
        "\x93NUMPY\x01"; /* version 1.0, the second byte of which is 0 */
    char *at = text + BEFORE_TEXT;
    const char *end = text + sizeof text;
    at += snprintf(at, (size_t)(end - at), "{'descr': '%c%s', 'fortran_order': False, 'shape': (",
                   is_little_endian() ? '<' : '>', type_of(values->bits));
    for (int i = 0; i < dimensions; i++)
        at += snprintf(at, (size_t)(end - at), "%s%llu", i ? ", " : "", (unsigned long long)shape[i]);
    at += snprintf(at, (size_t)(end - at), "), }");
    while ((at - text + 1) % ALIGNMENT)
        *at++ = ' ';
    *at++ = '\n';
    const size_t length = (size_t)(at - text) - BEFORE_TEXT;
    text[8] = (char)(length & 255u);
    text[9] = (char)(length >> 8);
    *writer = (hada_numpy_writer){.values = *values};
    HADA_TRY(hada_outfile_open(&writer->file, path, err));
    writer->is_open = 1;
    return hada_outfile_write(&writer->file, text, (size_t)(at - text), err);
}

static void put(void *to, size_t at, int bits, double white, float value)
{
    if (bits == 32) {
        ((float *)to)[at] = value;
        return;
    }
    const double share = value > 0 ? fmin((double)value / white, 1.0) : 0.0; /* NaN becomes 0 */
    if (bits == 16)
        ((uint16_t *)to)[at] = (uint16_t)(share * 65535.0 + 0.5);
    else
        ((uint8_t *)to)[at] = (uint8_t)(share * 255.0 + 0.5);
}

hada_status hada_numpy_add(hada_numpy_writer *writer, const hada_image *image, int is_light, hada_error *err)
{
    const hada_numpy_values *values = &writer->values;
    const size_t plane = (size_t)image->rows * (size_t)image->cols, channels = (size_t)image->channels;
    const size_t bytes = plane * channels * (size_t)values->bits / 8;
    const int encodes = is_light && values->encoding != 0.0 && values->encoding != HADA_RESPONSE_LINEAR;
    const float *data = image->data;
    float *encoded = NULL;
    void *samples = NULL;
    hada_status status = HADA_OK;
    if (encodes) {
        HADA_TRY_OR_DONE(HADA_NEW_RAW(encoded, plane * channels, "an image", err));
        memcpy(encoded, data, plane * channels * sizeof *encoded);
        hada_response_convert(encoded, plane * channels, HADA_RESPONSE_LINEAR, values->encoding);
        data = encoded;
    }
    HADA_TRY_OR_DONE(hada_allocated(samples = hada_alloc_raw(1, bytes, "an image", err)));
    for (size_t c = 0; c < channels; c++) /* those of a pixel together */
        for (size_t i = 0; i < plane; i++)
            put(samples, i * channels + c, values->bits, values->white, data[c * plane + i]);
    HADA_TRY_OR_DONE(hada_outfile_write(&writer->file, samples, bytes, err));
done:
    HADA_FREE(samples, encoded);
    return status;
}

hada_status hada_numpy_finish(hada_numpy_writer *writer, hada_error *err)
{
    const int was_open = writer->is_open;
    writer->is_open = 0; /* the file is gone either way */
    return was_open ? hada_outfile_commit(&writer->file, err) : HADA_OK;
}

void hada_numpy_abandon(hada_numpy_writer *writer)
{
    if (writer->is_open)
        hada_outfile_abandon(&writer->file);
    writer->is_open = 0;
}

hada_status hada_numpy_save(const char *path, const hada_image *image, int bits, hada_error *err)
{
    const uint64_t shape[] = {(uint64_t)image->rows, (uint64_t)image->cols, (uint64_t)image->channels};
    const hada_numpy_values values = {.bits = bits, .white = 1.0};
    hada_numpy_writer writer = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_numpy_begin(&writer, path, shape, image->channels > 1 ? 3 : 2, &values, err));
    HADA_TRY_OR_DONE(hada_numpy_add(&writer, image, 0, err));
    HADA_TRY_OR_DONE(hada_numpy_finish(&writer, err));
done:
    hada_numpy_abandon(&writer);
    return status;
}
