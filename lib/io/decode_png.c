/* PNG files, by libpng. */
#include "io/decode.h"

#ifndef HADALENS_PNG
const hada_decoder hada_png = {.missing =
                                   "a PNG file, which this build cannot read; build with libpng (Debian: libpng-dev)"};
#else
#include <png.h>
#include <setjmp.h>

#define FUNCTIONS(EACH)                                                                                                \
    EACH(create_read_struct)                                                                                           \
    EACH(create_info_struct)                                                                                           \
    EACH(destroy_read_struct)                                                                                          \
    EACH(get_bit_depth)                                                                                                \
    EACH(get_channels)                                                                                                 \
    EACH(get_error_ptr)                                                                                                \
    EACH(get_image_height)                                                                                             \
    EACH(get_image_width)                                                                                              \
    EACH(get_io_ptr)                                                                                                   \
    EACH(get_rowbytes)                                                                                                 \
    EACH(read_image)                                                                                                   \
    EACH(read_info)                                                                                                    \
    EACH(read_update_info)                                                                                             \
    EACH(set_chunk_malloc_max)                                                                                         \
    EACH(set_expand)                                                                                                   \
    EACH(set_interlace_handling)                                                                                       \
    EACH(set_longjmp_fn)                                                                                               \
    EACH(set_read_fn)                                                                                                  \
    EACH(set_strip_alpha)                                                                                              \
    EACH(set_user_limits)                                                                                              \
    EACH(error)

static struct {
#define MEMBER(name) __typeof__(png_##name) *name; /* NOLINT(bugprone-macro-parentheses) */
    FUNCTIONS(MEMBER)
#undef MEMBER
} api;

static const hada_symbol symbols[] = {
#define ROW(name) HADA_SYMBOL(api.name, "png_" #name),
    FUNCTIONS(ROW)
#undef ROW
};

static hada_library library = {HADALENS_PNG, "PNG files cannot be read", "libpng16-16",
                               symbols,      HADA_COUNT(symbols),        0};

/* Of a text, a profile and such. */
enum { MOST_OF_A_CHUNK = 1 << 20 };

typedef struct source {
    const unsigned char *data;
    size_t bytes, at;
    char message[128];
} source;

static void read_bytes(png_structp png, png_bytep to, size_t count)
{
    source *from = api.get_io_ptr(png);
    if (count > from->bytes - from->at)
        api.error(png, "the file is cut off");
    memcpy(to, from->data + from->at, count);
    from->at += count;
}

static void keep_error(png_structp png, png_const_charp message)
{
    source *from = api.get_error_ptr(png);
    snprintf(from->message, sizeof from->message, "%s", message);
    longjmp(*api.set_longjmp_fn(png, longjmp, sizeof(jmp_buf)), 1);
}

static void drop_warning(png_structp png, png_const_charp message)
{
    (void)png;
    (void)message;
}

static hada_status damaged(const source *from, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_READ, "this PNG file is damaged (%s); get it again", from->message);
}

/* Reads the header; the page says what the samples will be. */
static hada_status read_header(hada_decoded *out, png_structp png, png_infop info, source *from, hada_error *err)
{
    if (setjmp(*api.set_longjmp_fn(png, longjmp, sizeof(jmp_buf))))
        return damaged(from, err);
    api.set_read_fn(png, from, read_bytes);
    api.set_user_limits(png, 1 << 24, 1 << 24);
    api.set_chunk_malloc_max(png, MOST_OF_A_CHUNK);
    api.read_info(png, info);
    api.set_expand(png); /* palettes become colours, fewer than 8 bits become 8 */
    api.set_strip_alpha(png);
    api.set_interlace_handling(png);
    api.read_update_info(png, info);
    hada_tiff_page *page = &out->page;
    page->rows = (int)api.get_image_height(png, info);
    page->cols = (int)api.get_image_width(png, info);
    page->samples = page->channels = api.get_channels(png, info);
    page->bits = api.get_bit_depth(png, info);
    hada_decoded_scale(page);
    return HADA_OK;
}

static hada_status read_rows(png_structp png, unsigned char **rows, const source *from, hada_error *err)
{
    if (setjmp(*api.set_longjmp_fn(png, longjmp, sizeof(jmp_buf))))
        return damaged(from, err);
    api.read_image(png, rows);
    return HADA_OK;
}

static hada_status decode(hada_decoded *out, int fd, const unsigned char *data, size_t bytes, hada_error *err)
{
    source from = {.data = data, .bytes = bytes};
    unsigned char **rows = NULL;
    png_structp png = NULL;
    png_infop info = NULL;
    hada_status status = HADA_OK;
    (void)fd;
    png = api.create_read_struct(PNG_LIBPNG_VER_STRING, &from, keep_error, drop_warning);
    info = png ? api.create_info_struct(png) : NULL;
    if (!info)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory to read a PNG file"));
    HADA_TRY_OR_DONE(read_header(out, png, info, &from, err));
    const hada_tiff_page *page = &out->page;
    const size_t row_bytes = (size_t)(hada_tiff_page_bytes(page) / (uint64_t)page->rows);
    HADA_TRY_OR_DONE(
        hada_tiff_budget((uint64_t)page->rows * (uint64_t)page->cols * (uint64_t)page->samples, 0, bytes, err));
    if (row_bytes != api.get_rowbytes(png, info))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_FILE_FORMAT, "a PNG file of a kind that is not read; save it as RGB"));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(rows, (size_t)page->rows, "the rows of a picture", err));
    HADA_TRY_OR_DONE(hada_allocated(out->samples = hada_alloc((size_t)page->rows, row_bytes, "a picture", err)));
    for (int r = 0; r < page->rows; r++)
        rows[r] = (unsigned char *)out->samples + (size_t)r * row_bytes;
    HADA_TRY_OR_DONE(read_rows(png, rows, &from, err));
    out->frames = 1;
    out->swapped = HADA_LITTLE_ENDIAN; /* samples of 16 bits have the high byte first */
done:
    if (png)
        api.destroy_read_struct(&png, &info, NULL);
    free(rows);
    return status;
}

const hada_decoder hada_png = {.library = &library, .decode = decode};
#endif
