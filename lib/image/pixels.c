#include "image/pixels.h"

#include "core/callers.h"

/* Most values of a row or a column: as of a TIFF file. */
#define MOST       (1 << 24)
#define MOST_REACH 0x1p47 /* bytes: of what a program can address */

static ptrdiff_t bytes_of(hada_pixel_type type)
{
    return type == HADA_PIXEL_U8 ? 1 : type == HADA_PIXEL_U16 ? 2 : 4;
}

/* Each sample has a place of its own: a step is at least as long as what the axes with shorter steps reach. */
static hada_status check_strides(const hada_pixels *p, hada_error *err)
{
    const double sizes[] = {p->cols, p->rows, p->channels};
    const ptrdiff_t strides[] = {p->col_stride, p->row_stride, p->channel_stride};
    double steps[3], reach = (double)bytes_of(p->type);
    for (int i = 0; i < 3; i++)
        steps[i] = sizes[i] > 1.0 ? fabs((double)strides[i]) : INFINITY;
    for (int done = 0; done < 3; done++) {
        int next = steps[1] < steps[0];
        next = steps[2] < steps[next] ? 2 : next;
        if (steps[next] == INFINITY)
            break;
        if (steps[next] < reach || (reach += steps[next] * (sizes[next] - 1.0)) > MOST_REACH)
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "channel_stride %td, row_stride %td and col_stride %td put samples onto each other, or "
                             "beyond the memory",
                             p->channel_stride, p->row_stride, p->col_stride);
        steps[next] = INFINITY;
    }
    return HADA_OK;
}

hada_status hada_pixels_take(hada_pixels *own, const hada_pixels *callers, hada_error *err)
{
    if (!callers)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "pixels are needed: start from hada_pixels_init()");
    HADA_TRY(HADA_OPTIONS_TAKE(own, callers, hada_pixels, err));
    if (!own->data || own->type < HADA_PIXEL_U8 || own->type > HADA_PIXEL_F32 || own->channels < 1 || own->rows < 1 ||
        own->cols < 1 || own->channels > 4096 || own->rows > MOST || own->cols > MOST)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "pixels of kind %d, %d channels of %d x %d%s cannot be read: set data, type and sizes",
                         (int)own->type, own->channels, own->rows, own->cols, own->data ? "" : ", without data");
    if (own->full_scale != HADA_AUTO && !(own->full_scale > 0.0 && isfinite(own->full_scale)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a full scale of %g is not possible; it is above 0",
                         own->full_scale);
    const ptrdiff_t align = bytes_of(own->type);
    if ((uintptr_t)own->data % (uintptr_t)align || own->channel_stride % align || own->row_stride % align ||
        own->col_stride % align)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "address and strides of pixels must be multiples of their %d bytes",
                         (int)align);
    return check_strides(own, err);
}

int hada_pixels_is_image(const hada_pixels *p)
{
    return p->type == HADA_PIXEL_F32 && p->col_stride == (ptrdiff_t)sizeof(float) &&
           p->row_stride == p->col_stride * p->cols && p->channel_stride == p->row_stride * p->rows;
}

static float scale_of(const hada_pixels *p)
{
    return p->type == HADA_PIXEL_F32    ? 1.0f
           : p->full_scale != HADA_AUTO ? (float)p->full_scale
           : p->type == HADA_PIXEL_U8   ? 255.0f
                                        : 65535.0f;
}

/* Samples of a row. Integers divide in float, where both numbers are exact (io/tiff_page.c and
 * kernels/filter_unpack.cl give the same values). The loop is written once; each type gets its own compiled copy. */
#define RUN(type, divisor)                                                                                             \
    do {                                                                                                               \
        const ptrdiff_t stride = p->col_stride / (ptrdiff_t)sizeof(type);                                              \
        const type *from = (const type *)(const void *)at;                                                             \
        for (size_t i = 0; i < count; i++)                                                                             \
            out[i] = (float)from[(ptrdiff_t)i * stride] / (divisor);                                                   \
    } while (0)

static void convert(const hada_pixels *p, const unsigned char *at, size_t count, float *out)
{
    const float scale = scale_of(p);
    if (p->type == HADA_PIXEL_U8)
        RUN(uint8_t, scale);
    else if (p->type == HADA_PIXEL_U16)
        RUN(uint16_t, scale);
    else
        RUN(float, 1.0f);
}

const float *hada_pixels_floats(const hada_pixels *p, int channel, size_t first, size_t count, float *room)
{
    const size_t cols = (size_t)p->cols;
    if (hada_pixels_is_image(p))
        return (const float *)p->data + (size_t)channel * (size_t)p->rows * cols + first;
    for (size_t done = 0, here; done < count; done += here) {
        const size_t row = (first + done) / cols, col = (first + done) % cols;
        const unsigned char *at = (const unsigned char *)p->data + channel * p->channel_stride +
                                  (ptrdiff_t)row * p->row_stride + (ptrdiff_t)col * p->col_stride;
        here = count - done < cols - col ? count - done : cols - col;
        convert(p, at, here, room + done);
    }
    return room;
}

hada_stored hada_pixels_stored(const hada_pixels *p)
{
    const ptrdiff_t bytes = bytes_of(p->type), strides[] = {p->channel_stride, p->row_stride, p->col_stride};
    const int sizes[] = {p->channels, p->rows, p->cols};
    ptrdiff_t lowest = 0, highest = 0; /* bytes from the first sample to the first and last of the memory */
    for (int i = 0; i < 3; i++) {
        const ptrdiff_t reach = strides[i] * (sizes[i] - 1);
        *(reach < 0 ? &lowest : &highest) += reach;
    }
    return (hada_stored){.data = (const unsigned char *)p->data + lowest,
                         .bytes = (size_t)(highest - lowest + bytes),
                         .dense = p->col_stride == bytes && p->row_stride == bytes * p->cols &&
                                  p->channel_stride == p->row_stride * p->rows,
                         .form = {.first = (hada_ulong)(-lowest / bytes),
                                  .channel_stride = (hada_ulong)(p->channel_stride / bytes),
                                  .row_stride = (hada_ulong)(p->row_stride / bytes),
                                  .col_stride = (hada_ulong)(p->col_stride / bytes),
                                  .channels = p->channels,
                                  .rows = p->rows,
                                  .cols = p->cols,
                                  .bytes = (int)bytes,
                                  .scale = scale_of(p),
                                  .inverse = 1.0f / scale_of(p)}};
}

int hada_pixels_uploads(const hada_pixels *p)
{
    const float scale = scale_of(p);
    const hada_stored stored = hada_pixels_stored(p);
    return scale >= 1.0f && scale <= 65535.0f && scale == (float)(int)scale &&
           stored.bytes <= (size_t)p->channels * (size_t)p->rows * (size_t)p->cols * sizeof(float);
}

hada_status hada_pixels_copy(const hada_pixels *p, hada_image *image, hada_error *err)
{
    const size_t plane = (size_t)p->rows * (size_t)p->cols;
    HADA_TRY(hada_image_create(image, p->channels, p->rows, p->cols, err));
    for (int c = 0; c < p->channels; c++) {
        float *to = image->data + (size_t)c * plane;
        const float *from = hada_pixels_floats(p, c, 0, plane, to);
        if (from != to)
            memcpy(to, from, plane * sizeof *to);
    }
    return HADA_OK;
}

hada_status hada_pixels_to_image(const hada_pixels *pixels, hada_image *image, hada_error *err)
{
    HADA_NEED(image, err);
    hada_pixels own;
    *image = (hada_image){0};
    HADA_TRY(hada_pixels_take(&own, pixels, err));
    return hada_pixels_copy(&own, image, err);
}
