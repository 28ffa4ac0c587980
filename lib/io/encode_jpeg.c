#include "io/encode.h"

#ifndef HADALENS_JPEG
hada_status hada_jpeg_begin(void **encoder, hada_error *err)
{
    (void)encoder;
    return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                     "this build cannot write JPEG pictures; build with TurboJPEG (Debian: libturbojpeg0-dev), or ask "
                     "for options.stream rgb24");
}

size_t hada_jpeg_room(int rows, int cols)
{
    (void)rows, (void)cols;
    return 0;
}

hada_status hada_jpeg_encode(void *encoder, const unsigned char *rgb, int rows, int cols, unsigned char *out,
                             size_t *bytes, hada_error *err)
{
    (void)encoder, (void)rgb, (void)rows, (void)cols, (void)out, (void)bytes;
    return hada_fail(err, HADA_ERROR_UNSUPPORTED, "this build cannot write JPEG pictures");
}

void hada_jpeg_end(void *encoder)
{
    (void)encoder;
}
#else
#include <turbojpeg.h>

#include "core/library.h"

/* Of a scale to 100: what is lost is hardly seen. */
enum { QUALITY = 90 };

static struct {
    __typeof__(tjInitCompress) *create;
    __typeof__(tjCompress2) *compress;
    __typeof__(tjBufSize) *room;
    __typeof__(tjDestroy) *destroy;
    __typeof__(tjGetErrorStr2) *message;
} api;

static const hada_symbol symbols[] = {
    HADA_SYMBOL(api.create, "tjInitCompress"),  HADA_SYMBOL(api.compress, "tjCompress2"),
    HADA_SYMBOL(api.room, "tjBufSize"),         HADA_SYMBOL(api.destroy, "tjDestroy"),
    HADA_SYMBOL(api.message, "tjGetErrorStr2"),
};

static hada_library library = {
    HADALENS_JPEG, "JPEG pictures cannot be written", "libturbojpeg0", symbols, HADA_COUNT(symbols), 0};

hada_status hada_jpeg_begin(void **encoder, hada_error *err)
{
    HADA_TRY(hada_library_load(&library, err));
    *encoder = api.create();
    return *encoder ? HADA_OK : hada_fail(err, HADA_ERROR_MEMORY, "no memory to write JPEG pictures");
}

size_t hada_jpeg_room(int rows, int cols)
{
    return api.room(cols, rows, TJSAMP_444);
}

hada_status hada_jpeg_encode(void *encoder, const unsigned char *rgb, int rows, int cols, unsigned char *out,
                             size_t *bytes, hada_error *err)
{
    unsigned long room = api.room(cols, rows, TJSAMP_444);
    if (api.compress(encoder, rgb, cols, 0, rows, TJPF_RGB, &out, &room, TJSAMP_444, QUALITY, TJFLAG_NOREALLOC))
        return hada_fail(err, HADA_ERROR_FILE_WRITE, "a JPEG picture cannot be written (%s)", api.message(encoder));
    *bytes = room;
    return HADA_OK;
}

void hada_jpeg_end(void *encoder)
{
    if (encoder)
        api.destroy(encoder);
}
#endif
