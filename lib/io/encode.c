/* Frames in files as cameras write them, and NumPy arrays image by image. */
#include <hadalens/response.h>

#include "io/encode.h"
#include "io/tiff_page.h"

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
                   HADA_LITTLE_ENDIAN ? '<' : '>', type_of(values->bits));
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

static unsigned whole(float value, unsigned full)
{
    const double clipped = value > 0 ? fmin((double)value, 1.0) : 0.0; /* NaN becomes 0 */
    return (unsigned)(clipped * full + 0.5);
}

/* One channel, in 16 bits. */
static hada_status take_samples(const hada_image *image, uint16_t **out, size_t *bytes, hada_error *err)
{
    const size_t count = (size_t)image->rows * (size_t)image->cols;
    *bytes = count * sizeof **out;
    HADA_TRY(HADA_NEW_RAW(*out, count, "a frame", err));
    for (size_t i = 0; i < count; i++)
        (*out)[i] = (uint16_t)whole(image->data[i], 65535);
    return HADA_OK;
}

/* Sets a tag with an array, whatever libtiff wants to be told of its length. */
static int set_array(TIFF *tif, uint32_t tag, unsigned count, const void *values)
{
    const TIFFField *field = TIFFFindField(tif, tag, TIFF_ANY);
    if (!field)
        return 0;
    return TIFFFieldPassCount(field) ? TIFFSetField(tif, tag, count, values) : TIFFSetField(tif, tag, values);
}

static int set_dng(TIFF *tif, const hada_image *image, hada_mosaic mosaic, double black)
{
    static const unsigned char version[] = {1, 4, 0, 0};
    static const unsigned short square[] = {2, 2};
    static const float matrix[] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    const char *name = hada_enum_name(HADA_ENUM_MOSAIC, (int)mosaic);
    unsigned char pattern[4] = {0};
    const float level = (float)floor(black * 65535.0 + 0.5);
    const uint32_t white = 65535;
    const int has_colours = mosaic != HADA_MOSAIC_NONE;
    for (int i = 0; has_colours && i < 4; i++)
        pattern[i] = name[i] == 'r' ? 0 : name[i] == 'g' ? 1 : 2;
    return TIFFSetField(tif, TIFFTAG_SUBFILETYPE, 0) && TIFFSetField(tif, TIFFTAG_IMAGEWIDTH, (uint32_t)image->cols) &&
           TIFFSetField(tif, TIFFTAG_IMAGELENGTH, (uint32_t)image->rows) &&
           TIFFSetField(tif, TIFFTAG_BITSPERSAMPLE, 16) && TIFFSetField(tif, TIFFTAG_SAMPLESPERPIXEL, 1) &&
           TIFFSetField(tif, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT) &&
           TIFFSetField(tif, TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT) &&
           TIFFSetField(tif, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) &&
           TIFFSetField(tif, TIFFTAG_ROWSPERSTRIP, (uint32_t)image->rows) &&
           TIFFSetField(tif, TIFFTAG_PHOTOMETRIC, has_colours ? PHOTOMETRIC_CFA : 34892 /* LinearRaw */) &&
           TIFFSetField(tif, TIFFTAG_MAKE, "Hadalens") && TIFFSetField(tif, TIFFTAG_MODEL, "simulated camera") &&
           set_array(tif, TIFFTAG_DNGVERSION, 4, version) &&
           TIFFSetField(tif, TIFFTAG_UNIQUECAMERAMODEL, "Hadalens simulated camera") &&
           set_array(tif, TIFFTAG_BLACKLEVEL, 1, &level) && set_array(tif, TIFFTAG_WHITELEVEL, 1, &white) &&
           (!has_colours ||
            (set_array(tif, TIFFTAG_CFAREPEATPATTERNDIM, 2, square) && set_array(tif, TIFFTAG_CFAPATTERN, 4, pattern) &&
             set_array(tif, TIFFTAG_COLORMATRIX1, 9, matrix)));
}

hada_status hada_dng_save(const char *path, const hada_image *image, hada_mosaic mosaic, double black, hada_error *err)
{
    hada_outfile file;
    hada_tiff_handle handle = {0};
    TIFF *tif = NULL;
    uint16_t *samples = NULL;
    size_t bytes;
    HADA_TRY(hada_outfile_open(&file, path, err));
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(take_samples(image, &samples, &bytes, err));
    handle.fd = file.fd;
    tif = hada_tiff_attach(&handle, path, "wl");
    if (!tif || !set_dng(tif, image, mosaic, black) ||
        TIFFWriteEncodedStrip(tif, 0, samples, (tmsize_t)bytes) != (tmsize_t)bytes || !TIFFFlush(tif) ||
        handle.write_code)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_WRITE, "writing %s failed (%s); nothing was left behind", path,
                                   handle.write_code ? strerror(handle.write_code) : handle.message));
    TIFFClose(tif);
    tif = NULL;
    HADA_TRY_OR_DONE(hada_outfile_commit(&file, err));
done:
    free(samples);
    if (tif)
        TIFFClose(tif);
    hada_outfile_abandon(&file);
    return status;
}

hada_status hada_packed12_save(const char *path, const hada_image *image, hada_error *err)
{
    const size_t cols = (size_t)image->cols, pairs = (cols + 1) / 2,
                 row_bytes = hada_round_up(3 * pairs, HADA_PACKED_ALIGNMENT), bytes = row_bytes * (size_t)image->rows;
    unsigned char *out;
    HADA_TRY(hada_allocated(out = hada_alloc(1, bytes, "a frame", err)));
    for (size_t row = 0; row < (size_t)image->rows; row++)
        for (size_t i = 0; i < cols; i++) {
            unsigned char *group = out + row * row_bytes + i / 2 * 3;
            const unsigned value = whole(image->data[row * cols + i], 4095);
            group[i % 2] = (unsigned char)(value >> 4);
            group[2] = (unsigned char)(group[2] | (value & 15u) << 4 * (i % 2));
        }
    const hada_status status = hada_outfile_save(path, out, bytes, err);
    free(out);
    return status;
}
