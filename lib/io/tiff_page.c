/* Reading the structure of a TIFF file, and one page of it. */
#include "io/tiff_page.h"

#include <errno.h>
#include <hadalens/limits.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/input.h"
#include "io/safetensors.h"

#define LARGEST_SIDE   (1 << 24)
#define LARGEST_VALUES ((uint64_t)1 << 34)
/* The smallest pages, which no limit refuses: 8 samples of 1 bit, compressed to an eighth. */
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

/* Codecs that fail on damaged data by an error: not JBIG, whose library ends the process, and none that nobody tests.
 */
static int is_trusted(int compression)
{
    static const int codecs[] = {1, 2, 3, 4, 5, 7, 8, 32773, 32946, 34887, 34925, 50000, 50001};
    for (size_t i = 0; i < HADA_COUNT(codecs); i++)
        if (compression == codecs[i])
            return 1;
    return 0;
}

/* The largest number of decoded bytes for one byte of the file that the format allows, rounded up. */
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
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "the pixels are complex numbers; write their modulus or real part");
    if (page->is_float ? bits != 16 && bits != 32 && bits != 64 : !whole && (page->is_signed || bits > 16 || bits < 1))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
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
            return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                             "a palette image with %d samples of %d bits is not offered; convert to RGB", page->samples,
                             page->bits);
        if (page->palette)
            page->scale = 65535;
        return HADA_OK;
    case PHOTOMETRIC_CFA:
        return hada_fail(
            err, HADA_ERROR_FILE_FORMAT,
            "the file says that its pixels are a colour filter mosaic (Bayer); save them as grey, and name the pattern with "
            "options.mosaic");
    default: break;
    }
    return hada_fail(err, HADA_ERROR_FILE_FORMAT,
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

/* Bytes of its strips or tiles in the file, by what it says and at least as many as such pixels can have. */
static uint64_t stored_bytes(TIFF *tif, const hada_tiff_page *page, uint64_t file_bytes)
{
    const uint32_t pieces = TIFFIsTiled(tif) ? TIFFNumberOfTiles(tif) : TIFFNumberOfStrips(tif);
    uint64_t all = 0, least = hada_tiff_page_bytes(page) / largest_ratio(page->compression);
    for (uint32_t i = 0; i < pieces && all < file_bytes; i++)
        all += TIFFGetStrileByteCount(tif, i);
    all = all < file_bytes ? all : file_bytes;
    return all > least ? all : least;
}

/* The piece that is read at once lies beside the numbers (four bytes are as many as a number has). */
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
    if (!is_trusted(compression) || !TIFFIsCODECConfigured(compression))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "the compression is %s (%u), which is not read here; save without compression or with deflate",
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
    page->stored_bytes = stored_bytes(tif, page, file_bytes);
    return hada_tiff_budget((uint64_t)rows * cols * samples, chunk, file_bytes, err);
}

/* The loop is written once; each type gets its own compiled copy. 8 and 16 bits divide in float, which is correctly
 * rounded, since both numbers are exact there; 32 bits divide in double. */
#define ROW(type, work, divisor)                                                                                       \
    do {                                                                                                               \
        const type *from = (const type *)row + first;                                                                  \
        const work by = (work)(divisor);                                                                               \
        for (size_t i = 0; i < count; i++)                                                                             \
            out[i] = (float)((work)from[i * stride] / by);                                                             \
    } while (0)

/* Numbers of 1 to 7 and of 9 to 15 bits are packed, highest bit first. */
static unsigned packed(const hada_tiff_page *page, const unsigned char *row, size_t place)
{
    const size_t bits = (size_t)page->bits;
    unsigned value = 0;
    for (size_t at = place * bits; at < (place + 1) * bits; at++)
        value = value << 1 | (row[at >> 3] >> (7 - (at & 7)) & 1u);
    return value;
}

static void floats(const hada_tiff_page *page, const void *row, size_t first, size_t stride, size_t count, float *out)
{
    if (page->bits == 32) {
        const float *from = (const float *)row + first;
        if (stride == 1)
            memcpy(out, from, count * sizeof *out);
        for (size_t i = 0; stride != 1 && i < count; i++)
            out[i] = from[i * stride];
    } else if (page->bits == 64) {
        const double *from = (const double *)row + first;
        for (size_t i = 0; i < count; i++)
            out[i] = (float)from[i * stride];
    } else {
        const uint16_t *from = (const uint16_t *)row + first;
        for (size_t i = 0; i < count; i++)
            out[i] = hada_float_from_half(from[i * stride]);
    }
}

/* Converts `count` samples of a row, from sample number `first` on, every `stride`-th. Indices of a palette are
 * converted unscaled. */
static void samples_to_float(const hada_tiff_page *page, const void *row, size_t first, size_t stride, size_t count,
                             float *out)
{
    double scale = page->palette ? 1 : page->scale;
    if (page->is_float)
        floats(page, row, first, stride, count, out);
    else if (page->bits == 8 && page->is_signed)
        ROW(int8_t, float, scale);
    else if (page->bits == 8)
        ROW(uint8_t, float, scale);
    else if (page->bits == 16 && page->is_signed)
        ROW(int16_t, float, scale);
    else if (page->bits == 16)
        ROW(uint16_t, float, scale);
    else if (page->bits == 32 && page->is_signed)
        ROW(int32_t, double, scale);
    else if (page->bits == 32)
        ROW(uint32_t, double, scale);
    else
        for (size_t i = 0; i < count; i++)
            out[i] = (float)packed(page, row, first + i * stride) / (float)scale;
    if (page->inverted)
        for (size_t i = 0; i < count; i++)
            out[i] = 1.0f - out[i];
}

hada_pixel_type hada_tiff_page_form(const hada_tiff_page *page)
{
    if (page->is_float || page->is_signed || page->inverted || page->palette || page->bits > 16)
        return HADA_PIXEL_F32;
    return page->bits > 8 ? HADA_PIXEL_U16 : HADA_PIXEL_U8;
}

#define STORED(type)                                                                                                   \
    do {                                                                                                               \
        const type *from = (const type *)row + first;                                                                  \
        type *to = out; /* NOLINT(bugprone-macro-parentheses) */                                                       \
        for (size_t i = 0; i < count; i++)                                                                             \
            to[i] = whole ? from[i * stride] : (type)packed(page, row, first + i * stride);                            \
    } while (0)

/* The same numbers as they are stored. */
static void samples_as_stored(const hada_tiff_page *page, const void *row, size_t first, size_t stride, size_t count,
                              void *out)
{
    const int whole = page->bits == 8 || page->bits == 16;
    if (page->bits > 8)
        STORED(uint16_t);
    else
        STORED(uint8_t);
}

/* A rectangle of the page, as one buffer: `plane` of a separate page, all samples else. */
typedef struct hada_tiff_chunk {
    const unsigned char *data;
    uint64_t row_bytes;
    int plane, row, col, rows, cols;
} hada_tiff_chunk;

static void place(const hada_tiff_page *page, const hada_tiff_chunk *chunk, hada_pixel_type form, void *out)
{
    const size_t bytes = form == HADA_PIXEL_U8 ? 1 : form == HADA_PIXEL_U16 ? 2 : 4;
    int rows = chunk->rows < page->rows - chunk->row ? chunk->rows : page->rows - chunk->row;
    int cols = chunk->cols < page->cols - chunk->col ? chunk->cols : page->cols - chunk->col;
    int first = page->separate ? chunk->plane : 0, last = page->separate ? chunk->plane + 1 : page->channels;
    size_t plane = (size_t)page->rows * (size_t)page->cols;
    if (page->palette)
        last = 1; /* the indices, in the first plane; looked up at the end */
    for (int channel = first; channel < last && channel < page->channels; channel++)
        for (int row = 0; row < rows; row++) {
            const unsigned char *from = chunk->data + (uint64_t)row * chunk->row_bytes;
            const size_t sample = page->separate ? 0 : (size_t)channel,
                         stride = page->separate ? 1 : (size_t)page->samples;
            void *to = (unsigned char *)out + bytes * ((size_t)channel * plane + (size_t)chunk->col +
                                                       (size_t)(chunk->row + row) * (size_t)page->cols);
            if (form == HADA_PIXEL_F32)
                samples_to_float(page, from, sample, stride, (size_t)cols, to);
            else
                samples_as_stored(page, from, sample, stride, (size_t)cols, to);
        }
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

hada_status hada_tiff_page_read(TIFF *tif, const hada_tiff_handle *handle, const hada_tiff_page *page,
                                hada_pixel_type form, void *out, hada_error *err)
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
                place(page, &chunk, form, out);
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

void hada_tiff_page_convert(const hada_tiff_page *page, void *raw, int swapped, hada_pixel_type form, void *out)
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
        place(page, &chunk, form, out);
    }
}

enum { TAG_SUBFILE = 254, TAG_OLD_SUBFILE = 255 };

/* An unsigned number of `bytes` bytes in the file's order. */
static uint64_t number(const hada_tiff_chain *chain, const unsigned char *from, int bytes)
{
    const int little = HADA_LITTLE_ENDIAN != chain->swapped;
    uint64_t value = 0;
    for (int i = 0; i < bytes; i++)
        value = value << 8 | from[little ? bytes - 1 - i : i];
    return value;
}

static hada_status cut_off(hada_error *err, size_t page)
{
    return hada_fail(err, HADA_ERROR_FILE_READ,
                     "the file ends before the directory of page %zu: it is cut off or damaged; get it again",
                     page + 1);
}

/* Bytes of a value of each type of TIFF. */
static uint64_t type_bytes(unsigned type)
{
    static const unsigned char sizes[] = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
    return type < sizeof sizes ? sizes[type] : 0;
}

/* Whether the values of a directory's tags are more than the file holds: tags that share bytes make libtiff take memory
 * for each of them. */
static int tags_share(const hada_tiff_chain *chain, const unsigned char *entries, uint64_t count)
{
    const uint64_t wide = chain->big ? 8 : 4;
    uint64_t all = 0;
    for (uint64_t i = 0; i < count && all <= chain->bytes; i++) {
        const unsigned char *entry = entries + i * (4 + 2 * wide);
        const uint64_t values = number(chain, entry + 4, (int)wide), at = number(chain, entry + 4 + wide, (int)wide),
                       bytes = values <= chain->bytes ? values * type_bytes((unsigned)number(chain, entry + 2, 2)) : 0;
        if (at <= chain->bytes && bytes <= chain->bytes - at) /* libtiff refuses others */
            all += bytes;
    }
    return all > chain->bytes;
}

/* Reads the entries of the directory at `offset` into *entries (allocated). */
static hada_status read_directory(const hada_tiff_chain *chain, int fd, uint64_t offset, size_t page,
                                  unsigned char **entries, uint64_t *count, uint64_t *next, hada_error *err)
{
    unsigned char head[8];
    int count_bytes = chain->big ? 8 : 2, entry_bytes = chain->big ? 20 : 12, next_bytes = chain->big ? 8 : 4;
    *entries = NULL;
    if (offset > chain->bytes || chain->bytes - offset < (uint64_t)count_bytes ||
        hada_read_at(fd, head, (size_t)count_bytes, offset))
        return cut_off(err, page);
    *count = number(chain, head, count_bytes);
    if (*count > 65535 || chain->bytes - offset - (uint64_t)count_bytes < *count * (uint64_t)entry_bytes)
        return cut_off(err, page);
    size_t bytes = (size_t)*count * (size_t)entry_bytes;
    *entries = malloc(bytes + (size_t)next_bytes);
    if (!*entries)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for a TIFF directory");
    if (hada_read_at(fd, *entries, bytes, offset + (uint64_t)count_bytes))
        return cut_off(err, page);
    /* Some writers leave out the link after the last directory when it is the end of the file. */
    uint64_t link = offset + (uint64_t)count_bytes + bytes;
    *next = 0;
    if (link + (uint64_t)next_bytes > chain->bytes)
        return HADA_OK;
    if (hada_read_at(fd, *entries + bytes, (size_t)next_bytes, link))
        return cut_off(err, page);
    *next = number(chain, *entries + bytes, next_bytes);
    return HADA_OK;
}

/* Thumbnails (reduced resolution) and masks are not frames. */
static int is_frame(const hada_tiff_chain *chain, const unsigned char *entries, uint64_t count)
{
    int step = chain->big ? 20 : 12, at = chain->big ? 12 : 8;
    for (uint64_t i = 0; i < count; i++) {
        const unsigned char *entry = entries + i * (uint64_t)step;
        unsigned tag = (unsigned)number(chain, entry, 2), type = (unsigned)number(chain, entry + 2, 2);
        uint64_t value = number(chain, entry + at, type == 3 ? 2 : 4);
        if (tag == TAG_SUBFILE)
            return !(value & 5u);
        if (tag == TAG_OLD_SUBFILE)
            return value != 2;
        if (tag > TAG_OLD_SUBFILE)
            break;
    }
    return 1;
}

static hada_status append(hada_tiff_chain *chain, uint64_t offset, hada_error *err)
{
    HADA_TRY(HADA_GROW(chain->pages, chain->count, 1, "the list of pages", err));
    chain->pages[chain->count++] = offset;
    return HADA_OK;
}

static hada_status read_header(hada_tiff_chain *chain, int fd, uint64_t *first, hada_error *err)
{
    struct stat info;
    if (fstat(fd, &info) || !S_ISREG(info.st_mode))
        return hada_fail(err, HADA_ERROR_FILE_OPEN, "not an ordinary file");
    chain->bytes = (uint64_t)info.st_size;
    if (!chain->bytes)
        return hada_fail(err, HADA_ERROR_FILE_READ, "the file is empty");
    unsigned char head[16] = {0};
    if (hada_read_at(fd, head, chain->bytes < 16 ? (size_t)chain->bytes : 16, 0))
        return hada_fail(err, HADA_ERROR_FILE_READ, "the file cannot be read: %s", strerror(errno));
    chain->swapped = (head[0] == 'I') != HADA_LITTLE_ENDIAN;
    uint64_t version = number(chain, head + 2, 2);
    if (chain->bytes < 8 || head[0] != head[1] || (head[0] != 'I' && head[0] != 'M') ||
        (version != 42 && version != 43))
        return hada_fail(
            err, HADA_ERROR_FILE_FORMAT,
            "of no known format; convert it to TIFF, or, where it is a camera's pixels and nothing else, say "
            "how they lie with options.headerless HxW:PIXELS");
    chain->big = version == 43;
    if (chain->big && (chain->bytes < 16 || number(chain, head + 4, 2) != 8))
        return hada_fail(err, HADA_ERROR_FILE_READ, "the BigTIFF header is cut off or damaged; get the file again");
    *first = chain->big ? number(chain, head + 8, 8) : number(chain, head + 4, 4);
    return HADA_OK;
}

hada_status hada_tiff_chain_read(hada_tiff_chain *chain, int fd, hada_error *err)
{
    hada_status status = HADA_OK;
    unsigned char *entries = NULL;
    uint64_t offset = 0;
    *chain = (hada_tiff_chain){0};
    HADA_TRY_OR_DONE(read_header(chain, fd, &offset, err));
    /* A ring of directories is found by Brent's method: compare with a mark that moves on at powers of two. */
    uint64_t mark = 0, seen = 0;
    hada_limits limits = {.size = sizeof limits};
    HADA_TRY_OR_DONE(hada_limits_get(&limits, err));
    for (size_t step = 0, power = 1; offset; step++) {
        if (offset == mark)
            HADA_TRY_OR_DONE(
                hada_fail(err, HADA_ERROR_FILE_READ, "the pages of the file form a ring: it is damaged; get it again"));
        if (step == power) {
            mark = offset;
            power *= 2;
        }
        uint64_t count, next = 0;
        if (step == limits.pages)
            HADA_TRY_OR_DONE(
                hada_fail(err, HADA_ERROR_FILE_FORMAT,
                          "the file has more than %llu pages, more than the limits allow (options.limits pages=N)",
                          (unsigned long long)limits.pages));
        HADA_TRY_OR_DONE(read_directory(chain, fd, offset, step, &entries, &count, &next, err));
        /* those of a valid file do not overlap */
        seen += count * (chain->big ? 20u : 12u);
        if (seen > chain->bytes)
            HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ,
                                       "the directories of the pages overlap: the file is damaged; get it again"));
        if (tags_share(chain, entries, count))
            HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ,
                                       "the tags of page %zu hold more than the file: it is damaged; get it again",
                                       step + 1));
        if (is_frame(chain, entries, count))
            HADA_TRY_OR_DONE(append(chain, offset, err));
        free(entries);
        entries = NULL;
        offset = next;
    }
    if (!chain->count)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ, "the TIFF file holds no image; get it again"));
done:
    free(entries);
    if (status)
        hada_tiff_chain_free(chain);
    return status;
}

void hada_tiff_chain_free(hada_tiff_chain *chain)
{
    free(chain->pages);
    *chain = (hada_tiff_chain){0};
}

uint64_t hada_tiff_chain_find(const hada_tiff_chain *chain, int fd, uint64_t directory, unsigned tag, uint64_t *bytes)
{
    unsigned char *entries;
    uint64_t count, next, found = 0;
    const int step = chain->big ? 20 : 12, wide = chain->big ? 8 : 4;
    if (read_directory(chain, fd, directory, 0, &entries, &count, &next, NULL))
        count = 0; /* one that cannot be read has no entries */
    for (uint64_t i = 0; i < count && !found; i++) {
        const unsigned char *entry = entries + i * (uint64_t)step;
        unsigned type = (unsigned)number(chain, entry + 2, 2);
        if (number(chain, entry, 2) != tag || !type_bytes(type))
            continue;
        uint64_t values = number(chain, entry + 4, wide);
        if (values > chain->bytes)
            continue;
        *bytes = values * type_bytes(type);
        found = *bytes <= (uint64_t)wide ? directory + (chain->big ? 8u : 2u) + i * (uint64_t)step + 4 + (uint64_t)wide
                                         : number(chain, entry + 4 + wide, wide);
        if (found > chain->bytes || *bytes > chain->bytes - found)
            found = 0;
    }
    free(entries);
    return found;
}
