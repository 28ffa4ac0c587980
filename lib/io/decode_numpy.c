/* NumPy arrays, .npy. Source: numpy.lib.format, versions 1 to 3. */
#include "core/input.h"
#include "io/decode.h"

enum { BEFORE_LENGTH = 8, MOST_TEXT = 4096 };

static hada_status damaged(hada_error *err, const char *what)
{
    return hada_fail(err, HADA_ERROR_FILE_FORMAT, "the header of this NumPy file has no %s that can be understood",
                     what);
}

/* The text behind 'name': in the dictionary of the header, or NULL. */
static const char *value_of(const char *text, const char *name)
{
    const char *at = strstr(text, name);
    at = at ? strchr(at, ':') : NULL;
    return at ? at + 1 + strspn(at + 1, " ") : NULL;
}

/* descr: such as '<f4', '|u1', '>u2'. */
static hada_status read_kind(hada_decoded *out, const char *text, hada_error *err)
{
    const char *at = value_of(text, "'descr'");
    if (!at || *at != '\'' || !strchr("<>|=", at[1]) || !at[1] || !at[2])
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "this NumPy array has records or objects; save an array of numbers");
    const char kind = at[2];
    const int bytes = at[3] - '0';
    const int known = at[4] == '\'' && (bytes == 1 || bytes == 2 || bytes == 4 || bytes == 8) &&
                      ((kind == 'u' && bytes <= 4) || (kind == 'i' && bytes <= 4) || (kind == 'b' && bytes == 1) ||
                       (kind == 'f' && bytes >= 2));
    if (!known)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "this NumPy array has numbers of the kind %.4s, which are not read; save uint8, uint16 or "
                         "float32 (array.astype)",
                         at + 1);
    out->page.bits = 8 * bytes;
    out->page.is_float = kind == 'f';
    out->page.is_signed = kind == 'i';
    out->swapped = bytes > 1 && at[1] != '=' && (at[1] == '>') == HADA_LITTLE_ENDIAN;
    return HADA_OK;
}

enum { MOST_DIMENSIONS = 5 };

static hada_status read_shape(hada_array *array, const char *text, hada_error *err)
{
    const char *order = value_of(text, "'fortran_order'"), *at = value_of(text, "'shape'");
    if (!order || (strncmp(order, "True", 4) && strncmp(order, "False", 5)))
        return damaged(err, "order");
    array->columns_first = *order == 'T';
    if (!at || *at != '(')
        return damaged(err, "shape");
    uint64_t size[MOST_DIMENSIONS] = {0};
    int count = 0;
    for (at++; *at && *at != ')';) {
        char *end;
        const unsigned long long one = strtoull(at, &end, 10);
        if (end == at || one > UINT32_MAX)
            return damaged(err, "shape");
        if (count < MOST_DIMENSIONS)
            size[count] = one;
        count++;
        at = end + strspn(end, ", L");
    }
    const int stacks = count == MOST_DIMENSIONS && !array->columns_first; /* frames of depths: all are frames here */
    if (stacks)
        size[1] *= size[0];
    array->dimensions = count - stacks;
    for (int i = 0; i < 4; i++)
        array->size[i] = size[i + stacks];
    return HADA_OK;
}

static hada_status decode(hada_decoded *out, int fd, const unsigned char *data, size_t bytes, hada_error *err)
{
    unsigned char head[BEFORE_LENGTH + 4] = {0};
    char text[MOST_TEXT + 1] = {0};
    unsigned char *memory = NULL;
    hada_array array = {0};
    hada_status status = HADA_OK;
    (void)data;
    if (bytes < sizeof head || hada_read_at(fd, head, sizeof head, 0))
        return damaged(err, "length");
    const int wide = head[6] >= 2;
    const size_t length = wide ? head[8] | (size_t)head[9] << 8 | (size_t)head[10] << 16 | (size_t)head[11] << 24
                               : head[8] | (size_t)head[9] << 8;
    out->at = BEFORE_LENGTH + (wide ? 4 : 2) + length;
    if (length > MOST_TEXT || out->at > bytes || hada_read_at(fd, text, length, BEFORE_LENGTH + (wide ? 4 : 2)))
        return damaged(err, "length");
    HADA_TRY(read_kind(out, text, err));
    HADA_TRY(read_shape(&array, text, err));
    HADA_TRY(hada_array_frames(out, &array, bytes, err));
    const uint64_t all = hada_tiff_page_bytes(&out->page) * (uint64_t)out->frames;
    if (all > bytes - out->at)
        return hada_fail(err, HADA_ERROR_FILE_READ,
                         "the array has %llu bytes, but the file holds only %llu: it is cut off; get it again",
                         (unsigned long long)all, (unsigned long long)(bytes - out->at));
    if (!array.columns_first)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_decode_read(&memory, fd, bytes, err));
    HADA_TRY_OR_DONE(hada_array_order(out, &array, memory + out->at, err));
    out->at = 0;
done:
    free(memory);
    return status;
}

const hada_decoder hada_numpy = {.itself = 1, .decode = decode};
