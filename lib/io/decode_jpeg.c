/* JPEG files, by TurboJPEG. */
#include "io/decode.h"

#ifndef HADALENS_JPEG
const hada_decoder hada_jpeg = {
    .missing = "a JPEG file, which this build cannot read; build with TurboJPEG (Debian: libturbojpeg0-dev)"};
#else
#include <hadalens/response.h>
#include <turbojpeg.h>

static struct {
    __typeof__(tjInitDecompress) *create;
    __typeof__(tjDecompressHeader3) *header;
    __typeof__(tjDecompress2) *decompress;
    __typeof__(tjDestroy) *destroy;
    __typeof__(tjGetErrorStr2) *message;
    __typeof__(tjGetErrorCode) *code;
} api;

static const hada_symbol symbols[] = {
    HADA_SYMBOL(api.create, "tjInitDecompress"),  HADA_SYMBOL(api.header, "tjDecompressHeader3"),
    HADA_SYMBOL(api.decompress, "tjDecompress2"), HADA_SYMBOL(api.destroy, "tjDestroy"),
    HADA_SYMBOL(api.message, "tjGetErrorStr2"),   HADA_SYMBOL(api.code, "tjGetErrorCode"),
};

static hada_library library = {HADALENS_JPEG, "JPEG files cannot be read", "libturbojpeg0",
                               symbols,       HADA_COUNT(symbols),         0};

static hada_status decode(hada_decoded *out, int fd, const unsigned char *data, size_t bytes, hada_error *err)
{
    hada_tiff_page *page = &out->page;
    int subsampling, colours;
    tjhandle jpeg = NULL;
    hada_status status = HADA_OK;
    (void)fd;
    jpeg = api.create();
    if (!jpeg)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory to read a JPEG file"));
    if (api.header(jpeg, data, (unsigned long)bytes, &page->cols, &page->rows, &subsampling, &colours))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ, "this JPEG file cannot be read (%s); get it again",
                                   api.message(jpeg)));
    if (colours == TJCS_CMYK || colours == TJCS_YCCK)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_FORMAT, "a JPEG file for printers (CMYK); save it as RGB"));
    page->samples = page->channels = colours == TJCS_GRAY ? 1 : 3;
    page->bits = 8;
    hada_decoded_scale(page);
    out->frames = 1;
    out->encoding = HADA_RESPONSE_SRGB; /* JFIF says so */
    HADA_TRY_OR_DONE(
        hada_tiff_budget((uint64_t)page->rows * (uint64_t)page->cols * (uint64_t)page->samples, 0, bytes, err));
    HADA_TRY_OR_DONE(
        hada_allocated(out->samples = hada_alloc((size_t)hada_tiff_page_bytes(page), 1, "a picture", err)));
    if (api.decompress(jpeg, data, (unsigned long)bytes, out->samples, page->cols, 0, page->rows,
                       page->samples == 1 ? TJPF_GRAY : TJPF_RGB, TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS) &&
        (api.code(jpeg) == TJERR_FATAL || strstr(api.message(jpeg), "Premature end"))) /* others do not lose pixels */
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_FILE_READ, "this JPEG file is damaged (%s); get it again", api.message(jpeg)));
done:
    if (jpeg)
        api.destroy(jpeg);
    return status;
}

const hada_decoder hada_jpeg = {.library = &library, .decode = decode};
#endif
