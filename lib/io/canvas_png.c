#include <png.h>
#include <stdio.h>
#include <stdlib.h>

#include "io/canvas.h"
#include "io/outfile.h"

typedef struct hada_png {
    hada_outfile file;
    hada_error *err;
    hada_status status;
} hada_png;

static void on_error(png_structp png, png_const_charp message)
{
    hada_png *out = png_get_error_ptr(png);
    if (!out->status)
        out->status = hada_fail(out->err, HADA_ERROR_FILE_WRITE, "writing %s failed: %s", out->file.path, message);
    png_longjmp(png, 1);
}

static void on_warning(png_structp png, png_const_charp message)
{
    (void)png;
    (void)message;
}

static void on_write(png_structp png, png_bytep data, size_t bytes)
{
    hada_png *out = png_get_io_ptr(png);
    out->status = hada_outfile_write(&out->file, data, bytes, out->err);
    if (out->status)
        png_error(png, "");
}

static void on_flush(png_structp png)
{
    (void)png;
}

/* libpng returns here by longjmp: nothing of this frame is changed after setjmp. */
static void encode(png_structp png, png_infop info, const hada_canvas *canvas)
{
    if (setjmp(png_jmpbuf(png)))
        return;
    png_set_IHDR(png, info, (png_uint_32)canvas->width, (png_uint_32)canvas->height, 8, PNG_COLOR_TYPE_RGB,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
    png_write_info(png, info);
    for (int row = 0; row < canvas->height; row++)
        png_write_row(png, canvas->rgb + (size_t)row * (size_t)canvas->width * 3);
    png_write_end(png, info);
}

hada_status hada_canvas_save(const hada_canvas *canvas, const char *path, hada_error *err)
{
    hada_png out = {.err = err};
    hada_status status = hada_outfile_open(&out.file, path, err);
    if (status)
        return status;
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &out, on_error, on_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    if (info) {
        png_set_write_fn(png, &out, on_write, on_flush);
        encode(png, info, canvas);
    } else {
        out.status = hada_fail(err, HADA_ERROR_MEMORY, "no memory to write %s", path);
    }
    png_destroy_write_struct(&png, &info);
    if (out.status)
        hada_outfile_abandon(&out.file);
    return out.status ? out.status : hada_outfile_commit(&out.file, err);
}
