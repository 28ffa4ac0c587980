#include "io/tiff_page.h"

#include <hadalens/limits.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "io/tiff_sample.h"

#define LARGEST_SIDE   (1 << 24)
#define LARGEST_VALUES ((uint64_t)1 << 34)
/* What no limit refuses: 8 of 1 bit, compressed to an eighth. */
#define VALUES_A_BYTE 64
/* Bytes at the beginning of a file that belong to no picture: its header. */
#define HEADER_BYTES 8

static hada_status damaged(const hada_tiff_handle *handle, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_READ,
                     "the pixels cannot be read (%s): the file is cut off or damaged; get it again",
                     *handle->message ? handle->message : "too few of them");
}

/* Names of what Debian's libtiff may lack, for the message. */
static const char *codec_name(int compression)
{
    static const struct {
        int code;
        const char *name;
    } names[] = {{2, "CCITT RLE"},
                 {3, "CCITT Group 3"},
                 {4, "CCITT Group 4"},
                 {5, "LZW"},
                 {6, "old-style JPEG"},
                 {7, "JPEG"},
                 {8, "deflate"},
                 {32773, "PackBits"},
                 {32946, "deflate"},
                 {33003, "JPEG 2000 (Aperio)"},
                 {33005, "JPEG 2000 (Aperio)"},
                 {34661, "JBIG"},
                 {34676, "SGI LogLuv"},
                 {34677, "SGI LogLuv 24"},
                 {34712, "JPEG 2000"},
                 {34887, "LERC"},
                 {34892, "lossy JPEG (DNG)"},
                 {34925, "LZMA"},
                 {34926, "Zstandard"},
                 {34927, "WebP"},
                 {34934, "JPEG XR"},
                 {22610, "JPEG XR"},
                 {50000, "Zstandard"},
                 {50001, "WebP"},
                 {50002, "JPEG XL"},
                 {52546, "JPEG XL (DNG)"}};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (names[i].code == compression)
            return names[i].name;
    return "unknown";
}

/* The most pixels' bytes that a byte of the file can stand for: what the format allows, rounded up. */
static uint64_t largest_ratio(int compression)
{
    switch (compression) {
    case COMPRESSION_NONE: return 1;
    case COMPRESSION_PACKBITS: return 128;
    case COMPRESSION_LZW: return 4096;
    case COMPRESSION_DEFLATE:
    case COMPRESSION_ADOBE_DEFLATE: return 1200;
    default: return 40000;
    }
}

static hada_status check_samples(hada_tiff_page *page, int format, hada_error *err)
{
    int bits = page->bits;
    page->is_float = format == SAMPLEFORMAT_IEEEFP;
    page->is_signed = page->is_float || format == SAMPLEFORMAT_INT;
    int whole = bits == 8 || bits == 16 || bits == 32;
    if (format == SAMPLEFORMAT_COMPLEXINT || format == SAMPLEFORMAT_COMPLEXIEEEFP)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "the pixels are complex numbers; write their modulus or real part");
    if (page->is_float ? bits != 16 && bits != 32 && bits != 64 : !whole && (page->is_signed || bits > 16 || bits < 1))
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "samples of %d bits (%s) are not offered; convert to 8 or 16 bits or float", bits,
                         page->is_float    ? "float"
                         : page->is_signed ? "signed"
                                           : "unsigned");
    uint64_t levels = (uint64_t)1 << (page->is_float ? 0 : bits - page->is_signed);
    page->scale = page->is_float ? 1 : (double)(levels - 1);
    return HADA_OK;
}

static hada_status check_colours(TIFF *tif, int photometric, int keep_indices, hada_tiff_page *page, hada_error *err)
{
    uint16_t extras = 0, *kinds = NULL;
    TIFFGetFieldDefaulted(tif, TIFFTAG_EXTRASAMPLES, &extras, &kinds);
    int alphas = 0;
    for (int i = 0; i < extras; i++)
        alphas += kinds[i] == EXTRASAMPLE_ASSOCALPHA || kinds[i] == EXTRASAMPLE_UNASSALPHA;
    page->channels = page->samples;
    switch (photometric) {
    case PHOTOMETRIC_MINISWHITE:
    case PHOTOMETRIC_MINISBLACK:
        /* Extra samples that are not alpha are further channels. */
        page->channels = page->samples - (alphas < page->samples ? alphas : 0);
        page->inverted = photometric == PHOTOMETRIC_MINISWHITE && !page->is_signed;
        return HADA_OK;
    case PHOTOMETRIC_YCBCR:
        if (page->compression != COMPRESSION_JPEG || page->separate)
            break;
        /* libjpeg makes RGB of it, and resamples the colour planes. */
        TIFFSetField(tif, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB); /* fall through */
    case PHOTOMETRIC_RGB:
        if (page->samples < 3)
            return hada_fail(err, HADA_ERROR_FILE_FORMAT, "an RGB image with %d samples a pixel is damaged",
                             page->samples);
        page->channels = 3;
        return HADA_OK;
    case PHOTOMETRIC_PALETTE:
        page->channels = keep_indices ? 1 : 3;
        page->palette = !keep_indices;
        if (page->samples != 1 || page->is_signed || page->bits > 16)
            return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                             "a palette image with %d samples of %d bits is not offered; convert to RGB", page->samples,
                             page->bits);
        if (page->palette)
            page->scale = 65535;
        return HADA_OK;
    case PHOTOMETRIC_CFA:
        return hada_fail(
            err, HADA_ERROR_UNSUPPORTED,
            "the pixels are a colour filter mosaic (Bayer); demosaic to linear RGB, or save one colour as grey");
    default: break;
    }
    return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                     "colours of kind %d (%s) are not offered; convert to linear grey or RGB", photometric,
                     photometric == PHOTOMETRIC_SEPARATED                                     ? "CMYK"
                     : photometric == PHOTOMETRIC_YCBCR                                       ? "YCbCr without JPEG"
                     : photometric == PHOTOMETRIC_CIELAB || photometric == PHOTOMETRIC_ICCLAB ? "L*a*b*"
                     : photometric == PHOTOMETRIC_LOGL || photometric == PHOTOMETRIC_LOGLUV   ? "LogLuv"
                                                                                              : "see the TIFF tag 262");
}

uint64_t hada_tiff_page_bytes(const hada_tiff_page *page)
{
    uint64_t per_row = page->separate ? 1 : (uint64_t)page->samples;
    uint64_t row = ((uint64_t)page->cols * per_row * (uint64_t)page->bits + 7) / 8;
    return row * (uint64_t)page->rows * (page->separate ? (uint64_t)page->samples : 1);
}

uint64_t hada_tiff_page_least(const hada_tiff_page *page)
{
    return hada_tiff_page_bytes(page) / largest_ratio(page->compression);
}

/* The piece that is read at once stands beside the numbers (four bytes are as many as a number has). */
hada_status hada_tiff_budget(uint64_t values, uint64_t piece_bytes, uint64_t file_bytes, hada_error *err)
{
    hada_limits limits = {.size = sizeof limits};
    const uint64_t piece = piece_bytes / sizeof(float), larger = piece > values ? piece : values;
    const hada_status status = hada_limits_get(&limits, err);
    if (status || values + piece <= limits.pixels || larger / VALUES_A_BYTE <= file_bytes)
        return status;
    return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                     "a file of %llu bytes that claims to hold %llu numbers is beyond the limits; where it is to be "
                     "trusted, allow them (options.limits pixels=N)",
                     (unsigned long long)file_bytes, (unsigned long long)(values + piece));
}

hada_status hada_tiff_page_check(TIFF *tif, uint64_t file_bytes, int keep_indices, hada_tiff_page *page,
                                 hada_error *err)
{
    *page = (hada_tiff_page){0};
    uint32_t cols = 0, rows = 0;
    uint16_t bits = 1, samples = 1, format = SAMPLEFORMAT_UINT, compression = COMPRESSION_NONE,
             planar = PLANARCONFIG_CONTIG, photometric = PHOTOMETRIC_MINISBLACK;
    TIFFGetField(tif, TIFFTAG_IMAGEWIDTH, &cols);
    TIFFGetField(tif, TIFFTAG_IMAGELENGTH, &rows);
    TIFFGetFieldDefaulted(tif, TIFFTAG_BITSPERSAMPLE, &bits);
    TIFFGetFieldDefaulted(tif, TIFFTAG_SAMPLESPERPIXEL, &samples);
    TIFFGetFieldDefaulted(tif, TIFFTAG_SAMPLEFORMAT, &format);
    TIFFGetFieldDefaulted(tif, TIFFTAG_COMPRESSION, &compression);
    TIFFGetFieldDefaulted(tif, TIFFTAG_PLANARCONFIG, &planar);
    TIFFGetField(tif, TIFFTAG_PHOTOMETRIC, &photometric);
    if (!TIFFIsCODECConfigured(compression))
        return hada_fail(
            err, HADA_ERROR_UNSUPPORTED,
            "the compression is %s (%u), which this libtiff cannot read; save without compression or with deflate",
            codec_name(compression), compression);
    if (!rows || !cols || !samples || rows > LARGEST_SIDE || cols > LARGEST_SIDE || samples > 4096 ||
        (uint64_t)rows * cols * samples > LARGEST_VALUES)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "an image of %u x %u pixels with %u samples each is not plausible: the file is damaged", cols,
                         rows, samples);
    page->rows = (int)rows;
    page->cols = (int)cols;
    page->samples = samples;
    page->bits = bits;
    page->compression = compression;
    page->separate = planar == PLANARCONFIG_SEPARATE && samples > 1;
    HADA_TRY(check_samples(page, format, err));
    HADA_TRY(check_colours(tif, photometric, keep_indices, page, err));
    uint64_t pixels = hada_tiff_page_bytes(page), chunk = TIFFIsTiled(tif) ? TIFFTileSize64(tif) : TIFFStripSize64(tif);
    uint64_t ratio = largest_ratio(compression),
             most = file_bytes > UINT64_MAX / ratio ? UINT64_MAX : file_bytes * ratio;
    if (pixels > most || !chunk || chunk > most || chunk > (uint64_t)1 << 40)
        return hada_fail(err, HADA_ERROR_FILE_READ,
                         "%u x %u pixels need %llu bytes, more than a file of %llu bytes can hold: it is cut off or "
                         "damaged; get it again",
                         cols, rows, (unsigned long long)pixels, (unsigned long long)file_bytes);
    return hada_tiff_budget((uint64_t)rows * cols * samples, chunk, file_bytes, err);
}

/* A rectangle of the page, as one buffer: `plane` of a separate page, all samples else. */
typedef struct hada_tiff_chunk {
    const unsigned char *data;
    uint64_t row_bytes;
    int plane, row, col, rows, cols;
} hada_tiff_chunk;

static void place(const hada_tiff_page *page, const hada_tiff_chunk *chunk, float *out)
{
    int rows = chunk->rows < page->rows - chunk->row ? chunk->rows : page->rows - chunk->row;
    int cols = chunk->cols < page->cols - chunk->col ? chunk->cols : page->cols - chunk->col;
    int first = page->separate ? chunk->plane : 0, last = page->separate ? chunk->plane + 1 : page->channels;
    size_t plane = (size_t)page->rows * (size_t)page->cols;
    if (page->palette)
        last = 1; /* the indices, in the first plane; looked up at the end */
    for (int channel = first; channel < last && channel < page->channels; channel++)
        for (int row = 0; row < rows; row++)
            hada_tiff_samples(
                page, chunk->data + (uint64_t)row * chunk->row_bytes, page->separate ? 0 : (size_t)channel,
                page->separate ? 1 : (size_t)page->samples, (size_t)cols,
                out + (size_t)channel * plane + (size_t)(chunk->row + row) * (size_t)page->cols + chunk->col);
}

static hada_status look_up(TIFF *tif, const hada_tiff_page *page, float *out, hada_error *err)
{
    uint16_t *maps[3];
    if (!TIFFGetField(tif, TIFFTAG_COLORMAP, &maps[0], &maps[1], &maps[2]))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "a palette image without its palette is damaged; get the file again");
    size_t plane = (size_t)page->rows * (size_t)page->cols;
    for (int channel = 2; channel >= 0; channel--)
        for (size_t i = 0; i < plane; i++)
            out[(size_t)channel * plane + i] = (float)maps[channel][(unsigned)out[i]] / 65535.0f;
    return HADA_OK;
}

hada_status hada_tiff_page_read(TIFF *tif, const hada_tiff_handle *handle, const hada_tiff_page *page, float *out,
                                hada_error *err)
{
    int tiled = TIFFIsTiled(tif);
    uint32_t width = (uint32_t)page->cols, height = (uint32_t)page->rows;
    if (tiled) {
        TIFFGetField(tif, TIFFTAG_TILEWIDTH, &width);
        TIFFGetField(tif, TIFFTAG_TILELENGTH, &height);
    } else {
        TIFFGetFieldDefaulted(tif, TIFFTAG_ROWSPERSTRIP, &height);
        if (!height || height > (uint32_t)page->rows)
            height = (uint32_t)page->rows;
    }
    if (!width || !height || width > LARGEST_SIDE || height > LARGEST_SIDE)
        return damaged(handle, err);
    uint64_t size = tiled ? TIFFTileSize64(tif) : TIFFStripSize64(tif);
    uint64_t row_bytes = tiled ? TIFFTileRowSize64(tif) : TIFFScanlineSize64(tif);
    uint64_t needed = ((uint64_t)width * (uint64_t)(page->separate ? 1 : page->samples) * (uint64_t)page->bits + 7) / 8;
    if (row_bytes < needed || size / height < row_bytes)
        return damaged(handle, err);
    hada_status status = HADA_OK;
    void *buffer;
    HADA_TRY_OR_DONE(hada_allocated(buffer = hada_alloc(1, size, "a piece of the TIFF file", err)));
    int planes = page->separate ? page->channels : 1;
    uint32_t number = 0, across = ((uint32_t)page->cols - 1) / width + 1,
             down = ((uint32_t)page->rows - 1) / height + 1;
    for (int plane = 0; plane < planes; plane++)
        for (uint32_t y = 0; y < down; y++)
            for (uint32_t x = 0; x < across; x++, number++) {
                hada_tiff_chunk chunk = {buffer,           row_bytes,   plane,     (int)(y * height),
                                         (int)(x * width), (int)height, (int)width};
                if (TIFFGetStrileOffset(tif, number) < HEADER_BYTES) /* a damaged list, read as zeros */
                    HADA_TRY_OR_DONE(damaged(handle, err));
                tmsize_t got = tiled ? TIFFReadEncodedTile(tif, number, buffer, (tmsize_t)size)
                                     : TIFFReadEncodedStrip(tif, number, buffer, (tmsize_t)size);
                uint64_t rows =
                    (uint64_t)page->rows - y * height < height && !tiled ? (uint64_t)page->rows - y * height : height;
                if (got < 0 || (uint64_t)got < rows * row_bytes)
                    HADA_TRY_OR_DONE(damaged(handle, err));
                place(page, &chunk, out);
            }
    if (page->palette)
        HADA_TRY_OR_DONE(look_up(tif, page, out, err));
done:
    free(buffer);
    return status;
}

static void swap_bytes(unsigned char *data, uint64_t count, int bytes)
{
    for (uint64_t i = 0; i < count; i++, data += bytes)
        for (int b = 0; b < bytes / 2; b++) {
            unsigned char keep = data[b];
            data[b] = data[bytes - 1 - b];
            data[bytes - 1 - b] = keep;
        }
}

void hada_tiff_page_convert(const hada_tiff_page *page, void *raw, int swapped, float *out)
{
    uint64_t bytes = hada_tiff_page_bytes(page), planes = page->separate ? (uint64_t)page->samples : 1;
    if (swapped && page->bits > 8 && page->bits % 8 == 0)
        swap_bytes(raw, bytes / (uint64_t)(page->bits / 8), page->bits / 8);
    for (uint64_t plane = 0; plane < planes; plane++) {
        hada_tiff_chunk chunk = {(unsigned char *)raw + bytes / planes * plane,
                                 bytes / planes / (uint64_t)page->rows,
                                 (int)plane,
                                 0,
                                 0,
                                 page->rows,
                                 page->cols};
        place(page, &chunk, out);
    }
}
