/* What zlib deflated. */
#include "io/decode.h"

#ifndef HADALENS_ZLIB
hada_status hada_inflate(const unsigned char *from, size_t bytes, unsigned char *to, size_t room, size_t *made,
                         hada_error *err)
{
    (void)from, (void)bytes, (void)to, (void)room;
    *made = 0;
    return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                     "a compressed MATLAB file, which this build cannot read; save it as -v6, or build with zlib "
                     "(Debian: zlib1g-dev)");
}
#else
#include <zlib.h>

#include "core/library.h"

static struct {
    __typeof__(inflateInit_) *init;
    __typeof__(inflate) *inflate;
    __typeof__(inflateEnd) *end;
} api;

static const hada_symbol symbols[] = {
    HADA_SYMBOL(api.init, "inflateInit_"),
    HADA_SYMBOL(api.inflate, "inflate"),
    HADA_SYMBOL(api.end, "inflateEnd"),
};

static hada_library library = {
    HADALENS_ZLIB, "compressed MATLAB files cannot be read", "zlib1g", symbols, HADA_COUNT(symbols), 0};

hada_status hada_inflate(const unsigned char *from, size_t bytes, unsigned char *to, size_t room, size_t *made,
                         hada_error *err)
{
    const size_t most = (size_t)1 << 30; /* zlib counts in unsigned int */
    z_stream stream = {0};
    *made = 0;
    HADA_TRY(hada_library_load(&library, err));
    if (api.init(&stream, ZLIB_VERSION, (int)sizeof stream) != Z_OK)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory to read compressed data");
    for (int more = 1; more && *made < room;) {
        const size_t out = room - *made < most ? room - *made : most, in = bytes < most ? bytes : most;
        stream.next_in = (unsigned char *)from; /* zlib does not write there */
        stream.avail_in = (unsigned)in;
        stream.next_out = to + *made;
        stream.avail_out = (unsigned)out;
        more = api.inflate(&stream, Z_NO_FLUSH) == Z_OK && (stream.avail_in < in || stream.avail_out < out);
        *made += out - stream.avail_out;
        from += in - stream.avail_in;
        bytes -= in - stream.avail_in;
    }
    api.end(&stream);
    return HADA_OK;
}
#endif
