/* What the decoders share: reading a file whole, and arrays as frames. */
#include "core/input.h"
#include "io/decode.h"

/* Beyond it, a size is that of a damaged file. */
#define MOST_OF_A_SIDE (UINT64_C(1) << 24)

hada_status hada_decode_read(unsigned char **data, int fd, size_t bytes, hada_error *err)
{
    HADA_TRY(hada_allocated(*data = hada_alloc_raw(bytes, 1, "a file", err)));
    if (!hada_read_at(fd, *data, bytes, 0))
        return HADA_OK;
    free(*data);
    *data = NULL;
    return hada_fail(err, HADA_ERROR_FILE_READ, "the file cannot be read whole; get it again");
}

void hada_decoded_scale(hada_tiff_page *page)
{
    page->scale = page->is_float ? 1.0 : ldexp(1.0, page->bits - page->is_signed) - 1.0;
}

/* Which dimension of an array is which; -1: none is. */
typedef struct axes {
    int frame, channel, row, col;
} axes;

static int are_channels(const hada_array *array, int dimension)
{
    const uint64_t count = array->size[dimension];
    return count == 1 || count == 3 || (count == 4 && dimension == array->dimensions - 1 && !array->frames_last);
}

static axes axes_of(const hada_array *array)
{
    const int n = array->dimensions;
    if (array->frames_last) {
        const int channels = n == 4 || (n == 3 && are_channels(array, 2));
        return (axes){n == 4 ? 3 : n == 3 && !channels ? 2 : -1, channels ? 2 : -1, 0, 1};
    }
    if (n == 2)
        return (axes){-1, -1, 0, 1};
    const int last = are_channels(array, n - 1), first = !last && are_channels(array, n - 3);
    if (last)
        return (axes){n == 4 ? 0 : -1, n - 1, n - 3, n - 2};
    return (axes){first && n == 3 ? -1 : 0, first ? n - 3 : -1, n - 2, n - 1};
}

static uint64_t size_of(const hada_array *array, int dimension)
{
    return dimension < 0 ? 1 : array->size[dimension];
}

hada_status hada_array_frames(hada_decoded *out, const hada_array *array, size_t file_bytes, hada_error *err)
{
    const int n = array->dimensions;
    const axes of = n >= 2 && n <= 4 ? axes_of(array) : (axes){0};
    hada_tiff_page *page = &out->page;
    if (n < 2 || n > 4 || (n == 4 && (of.channel < 0 || !are_channels(array, of.channel))))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "an array of %d dimensions with these sizes is no picture; save rows x cols, with 1 or 3 "
                         "channels as a third dimension, or several frames of these (docs/reference/files.md)",
                         n);
    const uint64_t rows = array->size[of.row], cols = array->size[of.col], samples = size_of(array, of.channel),
                   frames = size_of(array, of.frame);
    if (!rows || !cols || !frames || rows > MOST_OF_A_SIDE || cols > MOST_OF_A_SIDE || frames > MOST_OF_A_SIDE)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "an array of %llu images of %llu x %llu is not plausible",
                         (unsigned long long)frames, (unsigned long long)rows, (unsigned long long)cols);
    page->rows = (int)rows;
    page->cols = (int)cols;
    page->samples = (int)samples;
    page->channels = samples == 4 ? 3 : (int)samples;
    page->separate = samples > 1 && (array->columns_first || of.channel < of.row);
    hada_decoded_scale(page);
    out->frames = (int)frames;
    HADA_TRY(hada_tiff_budget(rows * cols * samples, 0, file_bytes, err));
    return array->columns_first ? hada_tiff_budget(frames * rows * cols * samples, 0, file_bytes, err) : HADA_OK;
}

hada_status hada_array_order(hada_decoded *out, const hada_array *array, const unsigned char *from, hada_error *err)
{
    const axes of = axes_of(array);
    const hada_tiff_page *page = &out->page;
    const size_t bytes = (size_t)page->bits / 8, rows = (size_t)page->rows, cols = (size_t)page->cols,
                 frames = (size_t)out->frames, samples = (size_t)page->samples;
    size_t step[5] = {0}; /* of each dimension, in samples; the last one is that of none */
    for (int i = 0; i < array->dimensions; i++)
        step[i] = i ? step[i - 1] * (size_t)array->size[i - 1] : 1;
    const size_t frame = step[of.frame < 0 ? 4 : of.frame], sample = step[of.channel < 0 ? 4 : of.channel],
                 row = step[of.row], col = step[of.col];
    HADA_TRY(hada_allocated(
        out->samples = hada_alloc_raw(hada_size_product(frames * samples, rows * cols), bytes, "an array", err)));
    unsigned char *to = out->samples;
    for (size_t f = 0; f < frames; f++)
        for (size_t s = 0; s < samples; s++)
            for (size_t r = 0; r < rows; r++)
                for (size_t c = 0; c < cols; c++, to += bytes)
                    memcpy(to, from + bytes * (f * frame + s * sample + r * row + c * col), bytes);
    return HADA_OK;
}
