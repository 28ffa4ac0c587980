/* Raw files of cameras (DNG and others), by LibRaw: the sensor's values above the black level, 1 at white. A sensor
 * with a colour filter mosaic gives one channel. */
#include "io/decode.h"

#ifndef HADALENS_RAW
const hada_decoder hada_raw = {
    .missing = "a camera's raw file, which this build cannot read; build with LibRaw (Debian: libraw-dev)"};
#else
#include <hadalens/response.h>
#include <libraw/libraw.h>

static struct {
    __typeof__(libraw_init) *create;
    __typeof__(libraw_open_buffer) *open;
    __typeof__(libraw_unpack) *unpack;
    __typeof__(libraw_close) *destroy;
    __typeof__(libraw_strerror) *message;
    __typeof__(libraw_COLOR) *colour;
    __typeof__(libraw_set_dataerror_handler) *on_error;
} api;

static const hada_symbol symbols[] = {
    HADA_SYMBOL(api.create, "libraw_init"),
    HADA_SYMBOL(api.open, "libraw_open_buffer"),
    HADA_SYMBOL(api.unpack, "libraw_unpack"),
    HADA_SYMBOL(api.destroy, "libraw_close"),
    HADA_SYMBOL(api.message, "libraw_strerror"),
    HADA_SYMBOL(api.colour, "libraw_COLOR"),
    HADA_SYMBOL(api.on_error, "libraw_set_dataerror_handler"),
};

static hada_library library = {
    HADALENS_RAW, "cameras' raw files cannot be read", "libraw20", symbols, HADA_COUNT(symbols), 0};

static hada_status failed(int code, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_READ, "this raw file cannot be read (%s)", api.message(code));
}

/* The black level of a pixel: of all, of its colour, and of its place in a small pattern. */
static double black_of(const libraw_data_t *raw, int row, int col)
{
    const libraw_colordata_t *colour = &raw->color;
    const unsigned rows = colour->cblack[4], cols = colour->cblack[5];
    const int which = api.colour((libraw_data_t *)raw, row, col);
    double black = colour->black;
    if (which >= 0 && which < 4)
        black += colour->cblack[which];
    if (rows && cols && rows <= 64 && cols <= 64)
        black += colour->cblack[6 + (unsigned)row % rows * cols + (unsigned)col % cols];
    return black;
}

/* The pattern of the filters, where it is one of red, two greens, blue. */
static hada_mosaic mosaic_of(libraw_data_t *raw)
{
    static const struct {
        char colours[5];
        hada_mosaic mosaic;
    } known[] = {
        {"RGGB", HADA_MOSAIC_RGGB}, {"BGGR", HADA_MOSAIC_BGGR}, {"GRBG", HADA_MOSAIC_GRBG}, {"GBRG", HADA_MOSAIC_GBRG}};
    char colours[5] = "";
    for (int i = 0; i < 4; i++) {
        const int which = api.colour(raw, i / 2, i % 2);
        colours[i] = '?';
        if (which >= 0 && which < 4)
            colours[i] = raw->idata.cdesc[which];
    }
    for (size_t i = 0; raw->idata.filters > 1000 && i < HADA_COUNT(known); i++) /* less: other patterns */
        if (!strcmp(colours, known[i].colours))
            return known[i].mosaic;
    return HADA_MOSAIC_NONE;
}

static hada_status take_values(hada_decoded *out, const libraw_data_t *raw, hada_error *err)
{
    const libraw_image_sizes_t *sizes = &raw->sizes;
    hada_tiff_page *page = &out->page;
    enum { PATTERN = 64 };
    if (!raw->rawdata.raw_image)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "this raw file does not hold one value for each pixel of the sensor; save it as TIFF");
    if (sizes->top_margin + sizes->height > sizes->raw_height || sizes->left_margin + sizes->width > sizes->raw_width ||
        !sizes->height || !sizes->width)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "this raw file is damaged; get it again");
    page->rows = sizes->height;
    page->cols = sizes->width;
    float *to;
    HADA_TRY(HADA_NEW_RAW(to, (size_t)page->rows * (size_t)page->cols, "a raw frame", err));
    out->samples = to;
    for (int row = 0; row < page->rows; row++) {
        const ushort *from = raw->rawdata.raw_image +
                             (size_t)(row + sizes->top_margin) * (sizes->raw_pitch / sizeof(ushort)) +
                             sizes->left_margin;
        for (int col = 0; col < page->cols; col++) {
            const double black = black_of(raw, row, col);
            *to++ = (float)((from[col] - black) / fmax(raw->color.maximum - black, 1.0));
        }
    }
    return HADA_OK;
}

static hada_status decode(hada_decoded *out, int fd, const unsigned char *data, size_t bytes, hada_error *err)
{
    hada_tiff_page *page = &out->page;
    hada_status status = HADA_OK;
    (void)fd;
    libraw_data_t *raw = api.create(0);
    if (!raw)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory to read a raw file");
    api.on_error(raw, NULL, NULL); /* which would print */
    int code = api.open(raw, (void *)(uintptr_t)data, bytes);
    if (code)
        HADA_TRY_OR_DONE(failed(code, err));
    HADA_TRY_OR_DONE(hada_tiff_budget((uint64_t)raw->sizes.raw_height * raw->sizes.raw_width, 0, bytes, err));
    code = api.unpack(raw);
    if (code)
        HADA_TRY_OR_DONE(failed(code, err));
    HADA_TRY_OR_DONE(take_values(out, raw, err));
    page->samples = page->channels = 1;
    page->bits = 32;
    page->is_float = 1;
    page->scale = 1.0;
    out->frames = 1;
    out->encoding = HADA_RESPONSE_LINEAR;
    out->mosaic = mosaic_of(raw);
done:
    api.destroy(raw);
    return status;
}

const hada_decoder hada_raw = {.library = &library, .decode = decode};
#endif
