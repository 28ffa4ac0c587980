#include "io/decode.h"

#include "core/input.h"

/* The largest head by which a format is recognised. */
enum { HEAD = 132 };

static int begins(const unsigned char *head, size_t bytes, const char *with, size_t length)
{
    return bytes >= length && !memcmp(head, with, length);
}

static uint64_t number(const unsigned char *at, size_t bytes, int big_endian)
{
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++)
        value = value << 8 | at[big_endian ? i : bytes - 1 - i];
    return value;
}

/* Raw files of most cameras are TIFF files; their first directory has a picture for displays. DNG files have a version
 * tag there (50706); others name a maker (271) and keep the sensor's pixels in sub-directories (330). */
static int is_tiff_raw(int fd, const unsigned char *head, size_t bytes)
{
    const int big_endian = head[0] == 'M';
    enum { MAKER = 271, SUB_DIRECTORIES = 330, DNG_VERSION = 50706, ENTRY = 12, MOST = 512 };
    unsigned char entries[MOST * ENTRY];
    if (bytes < 8 || !(begins(head, bytes, "II*", 4) || begins(head, bytes, "MM\0*", 4)))
        return 0;
    if (begins(head + 8, bytes - 8, "CR", 2)) /* Canon's */
        return 1;
    const uint64_t at = number(head + 4, 4, big_endian);
    if (hada_read_at(fd, entries, 2, at))
        return 0;
    const size_t count = (size_t)number(entries, 2, big_endian);
    if (count > MOST || hada_read_at(fd, entries, count * ENTRY, at + 2))
        return 0;
    int maker = 0, parts = 0;
    for (size_t i = 0; i < count; i++) {
        const uint64_t tag = number(entries + i * ENTRY, 2, big_endian);
        if (tag == DNG_VERSION)
            return 1;
        maker |= tag == MAKER;
        parts |= tag == SUB_DIRECTORIES;
    }
    return maker && parts;
}

static const hada_decoder *recognise(int fd, const unsigned char *head, size_t bytes)
{
    /* the formats of raw files that are not TIFF: Fujifilm, Olympus, Panasonic, Canon since 2018, Minolta, Sigma */
    static const char *const raw[] = {"FUJIFILMCCD-RAW", "IIRO", "IIRS", "MMOR", "IIU", "FOVb"};
    if (begins(head, bytes, "\211PNG\r\n\032\n", 8))
        return &hada_png;
    if (begins(head, bytes, "\377\330\377", 3))
        return &hada_jpeg;
    if (begins(head, bytes, "\223NUMPY", 6))
        return &hada_numpy;
    if (begins(head, bytes, "MATLAB ", 7) || begins(head, bytes, "\211HDF\r\n\032\n", 8))
        return hada_is_matlab_five(head, bytes) ? &hada_matlab : &hada_matio;
    for (size_t i = 0; i < HADA_COUNT(raw); i++)
        if (begins(head, bytes, raw[i], strlen(raw[i])))
            return &hada_raw;
    if (bytes > 12 && begins(head + 4, bytes - 4, "ftypcrx", 7))
        return &hada_raw;
    return is_tiff_raw(fd, head, bytes) ? &hada_raw : NULL;
}

static int is_tiff(const unsigned char *head, size_t bytes)
{
    return begins(head, bytes, "II*", 4) || begins(head, bytes, "MM\0*", 4) || begins(head, bytes, "II+", 4) ||
           begins(head, bytes, "MM\0+", 4);
}

/* A file that says nothing of itself, where the caller said how to read such files. */
static hada_status take_headerless(hada_decoded *out, size_t bytes, hada_error *err)
{
    const hada_headerless *frames = &out->headerless;
    hada_tiff_page *page = &out->page;
    HADA_TRY(hada_headerless_fit(&out->headerless, bytes, &out->frames, err));
    *page = (hada_tiff_page){.rows = frames->rows,
                             .cols = frames->cols,
                             .samples = frames->channels,
                             .channels = frames->channels,
                             .bits = frames->bits > 8 ? 16 : 8,
                             .scale = ldexp(1.0, frames->bits) - 1.0};
    return hada_tiff_budget((uint64_t)page->rows * (uint64_t)page->cols * (uint64_t)page->samples, 0, bytes, err);
}

/* NULL: none, or the file cannot be read, of which the reader of TIFF files says why. */
static const hada_decoder *decoder_of(int fd, size_t bytes)
{
    unsigned char head[HEAD] = {0};
    const size_t length = bytes < HEAD ? bytes : HEAD;
    return hada_read_at(fd, head, length, 0) ? NULL : recognise(fd, head, length);
}

int hada_decode_is_headerless(int fd, size_t bytes, hada_headerless *frames)
{
    unsigned char head[HEAD] = {0};
    const size_t length = bytes < HEAD ? bytes : HEAD;
    return !hada_read_at(fd, head, length, 0) && !recognise(fd, head, length) && !is_tiff(head, length) &&
           hada_headerless_get(frames);
}

int hada_decode_is_suspect(int fd, size_t bytes)
{
    return decoder_of(fd, bytes) == &hada_matio;
}

static hada_status load(const hada_decoder *decoder, hada_error *err)
{
    if (decoder->missing)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "%s", decoder->missing);
    return decoder->library ? hada_library_load(decoder->library, err) : HADA_OK;
}

hada_status hada_decode_load(int fd, size_t bytes, int *reopens, hada_error *err)
{
    const hada_decoder *const decoder = decoder_of(fd, bytes);
    size_t made;
    *reopens = decoder == &hada_matio;
    if (decoder == &hada_matlab) /* which needs zlib only where it is compressed */
        return hada_inflate(NULL, 0, NULL, 0, &made, NULL), HADA_OK;
    return decoder ? load(decoder, err) : HADA_OK;
}

static hada_status decode(hada_decoded *out, const hada_decoder *decoder, int fd, size_t bytes, hada_error *err)
{
    unsigned char *data = NULL;
    HADA_TRY(load(decoder, err));
    if (!decoder->itself)
        HADA_TRY(hada_decode_read(&data, fd, bytes, err));
    const hada_status status = decoder->decode(out, fd, data, bytes, err);
    free(data);
    return status;
}

hada_status hada_decode(hada_decoded *out, int fd, size_t bytes, int *known, hada_error *err)
{
    *out = (hada_decoded){0};
    const hada_decoder *const decoder = decoder_of(fd, bytes);
    *known = decoder || hada_decode_is_headerless(fd, bytes, &out->headerless);
    if (!*known)
        return HADA_OK;
    hada_status status = decoder ? decode(out, decoder, fd, bytes, err) : take_headerless(out, bytes, err);
    if (!status && (out->page.rows < 1 || out->page.cols < 1 || out->frames < 1))
        status = hada_fail(err, HADA_ERROR_FILE_FORMAT, "the file holds no picture; get it again");
    if (status) {
        free(out->samples);
        *out = (hada_decoded){0};
    }
    return status;
}
