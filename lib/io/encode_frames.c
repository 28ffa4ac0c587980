#include "io/encode.h"

#include "core/outfile.h"
#include "io/tiff_page.h"

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
