/* MATLAB files: the largest array of numbers of a file. Versions 5 to 7 are read here, and bounded by what is asked for
 * of them: cells and structures are passed over whole, however deep they are. 7.3 is left to matio. Source: MAT-File
 * Format, MathWorks, R2019b. */
#include "io/decode.h"

/* A file with more variables is none of pictures. Variables of pictures have their sizes and name at their beginning.
 */
enum { MOST_VARIABLES = 1000, HEADER = 128, BEGINNING = 4096, TAG = 8 };
enum { MI_INT8 = 1, MI_INT32 = 5, MI_UINT32 = 6, MI_SINGLE = 7, MI_DOUBLE = 9, MI_MATRIX = 14, MI_COMPRESSED = 15 };
enum { CLASS_DOUBLE = 6, CLASS_SINGLE = 7, CLASS_INT8 = 8, CLASS_UINT32 = 13, IS_COMPLEX = 0x800 };

/* Bytes of the file, or what a part of it was inflated to. */
typedef struct part {
    const unsigned char *data;
    size_t bytes;
    int swapped; /* not in the machine's byte order */
} part;

typedef struct element {
    unsigned type;
    size_t at, bytes, next; /* its data; where the next element begins */
} element;

typedef struct variable {
    size_t begin, bytes; /* of the element that holds it, in the file */
    int compressed, class;
    hada_array array;
    uint64_t values;
    element data; /* within that element, or what it is inflated to */
} variable;

static uint64_t number_at(const part *in, size_t at, size_t bytes)
{
    const int little = HADA_LITTLE_ENDIAN != in->swapped;
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++)
        value = value << 8 | in->data[at + (little ? bytes - 1 - i : i)];
    return value;
}

/* The data may lie beyond the end of `in`, the tag may not. */
static int read_element(const part *in, size_t at, element *out)
{
    if (at > in->bytes || in->bytes - at < TAG)
        return 0;
    const uint64_t first = number_at(in, at, 4), small = first >> 16;
    const size_t bytes = small ? (size_t)small : (size_t)number_at(in, at + 4, 4);
    *out = small ? (element){(unsigned)(first & 0xffff), at + 4, bytes, at + TAG}
                 : (element){(unsigned)first, at + TAG, bytes, at + TAG + (bytes + 7) / 8 * 8};
    return !small || small <= 4;
}

static size_t bytes_of_class(int class)
{
    static const unsigned char bytes[] = {8, 4, 1, 1, 2, 2, 4, 4};
    return class >= CLASS_DOUBLE && class <= CLASS_UINT32 ? bytes[class - CLASS_DOUBLE] : 0;
}

static size_t bytes_of_type(unsigned type)
{
    static const unsigned char bytes[] = {0, 1, 1, 2, 2, 4, 4, 4, 0, 8, 0, 0, 8, 8};
    return type < sizeof bytes ? bytes[type] : 0;
}

/* Whether a matrix, from its flags on, is an array of real numbers of 2 to 4 dimensions. */
static int read_matrix(const part *in, variable *out)
{
    element flags, sizes, name;
    if (!read_element(in, 0, &flags) || flags.type != MI_UINT32 || flags.bytes != 8 || in->bytes < flags.next)
        return 0;
    const unsigned word = (unsigned)number_at(in, flags.at, 4);
    out->class = (int)(word & 0xff);
    if (!bytes_of_class(out->class) || word & IS_COMPLEX || !read_element(in, flags.next, &sizes) ||
        sizes.type != MI_INT32 || sizes.bytes % 4 || sizes.bytes < 8 || sizes.bytes > 16 || in->bytes < sizes.next)
        return 0;
    out->array = (hada_array){.dimensions = (int)(sizes.bytes / 4), .columns_first = 1, .frames_last = 1};
    out->values = 1;
    for (int i = 0; i < out->array.dimensions; i++) {
        const uint64_t size = number_at(in, sizes.at + 4 * (size_t)i, 4);
        if (size > INT32_MAX || (size && out->values > UINT64_MAX / size))
            return 0;
        out->array.size[i] = size;
        out->values *= size;
    }
    return read_element(in, sizes.next, &name) && name.type == MI_INT8 && read_element(in, name.next, &out->data);
}

static hada_status damaged(hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_READ, "this MATLAB file is damaged; get it again");
}

static hada_status find_largest(const part *file, variable *largest, hada_error *err)
{
    unsigned char beginning[BEGINNING];
    size_t at = HEADER, made;
    *largest = (variable){.values = 1}; /* a single number is no picture */
    for (int i = 0; i < MOST_VARIABLES && at + TAG <= file->bytes; i++) {
        const unsigned type = (unsigned)number_at(file, at, 4);
        variable now = {at + TAG, (size_t)number_at(file, at + 4, 4), type == MI_COMPRESSED, 0, {0}, 0, {0}};
        part in = {file->data + now.begin, now.bytes, file->swapped};
        if (now.bytes > file->bytes - now.begin) /* cut off */
            return damaged(err);
        if (now.compressed) {
            HADA_TRY(hada_inflate(in.data, in.bytes, beginning, sizeof beginning, &made, err));
            in = (part){beginning, made, file->swapped};
            const int whole = made > TAG && number_at(&in, 0, 4) == MI_MATRIX;
            in = (part){beginning + TAG, whole ? made - TAG : 0, file->swapped};
        }
        if ((now.compressed || type == MI_MATRIX) && read_matrix(&in, &now) && now.values > largest->values)
            *largest = now;
        at = now.begin + now.bytes;
    }
    return largest->class ? HADA_OK
                          : hada_fail(err, HADA_ERROR_FILE_FORMAT,
                                      "this MATLAB file holds no array of real numbers of 2 to 4 dimensions");
}

/* MATLAB stores numbers in the smallest type that holds them all. 0: there is no such number in the class. */
static int convert(const part *in, size_t at, unsigned type, int class, unsigned char *to)
{
    const size_t bytes = bytes_of_type(type), own = bytes_of_class(class);
    const uint64_t bits = number_at(in, at, bytes);
    const uint32_t low = (uint32_t)bits;
    const int is_signed = type == 1 || type == 3 || type == 5 || type == 12;
    float single;
    double real;
    if (type == MI_DOUBLE)
        memcpy(&real, &bits, sizeof real);
    else if (type == MI_SINGLE)
        memcpy(&single, &low, sizeof single);
    const int64_t whole =
        is_signed && bytes < 8 && bits >> (8 * bytes - 1) ? (int64_t)bits - ((int64_t)1 << 8 * bytes) : (int64_t)bits;
    if (type == MI_SINGLE)
        real = (double)single;
    else if (type != MI_DOUBLE)
        real = is_signed || whole >= 0 ? (double)whole : (double)bits;
    if (class == CLASS_DOUBLE) {
        memcpy(to, &real, own);
    } else if (class == CLASS_SINGLE) {
        single = (float)real;
        memcpy(to, &single, own);
    } else {
        const int negative = class == CLASS_INT8 || class == 10 || class == 12;
        const double most = ldexp(1.0, (int)(8 * own) - negative), least = negative ? -most : 0.0;
        if (!(real >= least && real < most))
            return 0;
        const int64_t value = (int64_t)real;
        const int8_t one = (int8_t)value;
        const int16_t two = (int16_t)value;
        const int32_t four = (int32_t)value;
        memcpy(to, own == 1 ? (const void *)&one : own == 2 ? (const void *)&two : (const void *)&four, own);
    }
    return 1;
}

/* *values: the variable's numbers in its class, in the machine's byte order. */
static hada_status read_values(const part *file, const variable *of, unsigned char **values, hada_error *err)
{
    part in = {file->data + of->begin, of->bytes, file->swapped};
    const size_t bytes = bytes_of_type(of->data.type), own = bytes_of_class(of->class), count = (size_t)of->values;
    const size_t end = of->data.at + hada_size_product(count, bytes);
    unsigned char *inflated = NULL;
    hada_status status = HADA_OK;
    *values = NULL;
    if (!bytes || of->data.bytes / bytes < count)
        HADA_TRY_OR_DONE(damaged(err));
    if (of->compressed) {
        HADA_TRY_OR_DONE(hada_allocated(inflated = hada_alloc_raw(TAG + end, 1, "the data of a MATLAB file", err)));
        HADA_TRY_OR_DONE(hada_inflate(in.data, in.bytes, inflated, TAG + end, &in.bytes, err));
        in = (part){inflated + TAG, in.bytes > TAG ? in.bytes - TAG : 0, file->swapped};
    }
    if (in.bytes < end)
        HADA_TRY_OR_DONE(damaged(err));
    HADA_TRY_OR_DONE(hada_allocated(*values = hada_alloc_raw(count, own, "an array", err)));
    for (size_t i = 0; i < count; i++)
        if (!convert(&in, of->data.at + i * bytes, of->data.type, of->class, *values + i * own))
            HADA_TRY_OR_DONE(damaged(err));
done:
    free(inflated);
    if (status) {
        free(*values);
        *values = NULL;
    }
    return status;
}

static hada_status read_five(hada_decoded *out, const part *file, hada_error *err)
{
    variable of;
    unsigned char *values = NULL;
    HADA_TRY(find_largest(file, &of, err));
    out->page.bits = 8 * (int)bytes_of_class(of.class);
    out->page.is_float = of.class <= CLASS_SINGLE;
    out->page.is_signed = !out->page.is_float && of.class % 2 == 0; /* of integers, those of even number */
    HADA_TRY(hada_array_frames(out, &of.array, file->bytes, err));
    HADA_TRY(read_values(file, &of, &values, err));
    const hada_status status = hada_array_order(out, &of.array, values, err);
    free(values);
    return status;
}

/* 0: it is none of version 5. */
static int read_head(part *head)
{
    head->swapped = 0;
    if (head->bytes < HEADER)
        return 0;
    head->swapped = number_at(head, HEADER - 2, 2) != ('M' << 8 | 'I');
    return number_at(head, HEADER - 2, 2) == ('M' << 8 | 'I') && number_at(head, HEADER - 4, 2) == 0x0100;
}

int hada_is_matlab_five(const unsigned char *head, size_t bytes)
{
    part file = {head, bytes, 0};
    return read_head(&file);
}

static hada_status decode(hada_decoded *out, int fd, const unsigned char *data, size_t bytes, hada_error *err)
{
    part file = {data, bytes, 0};
    (void)fd;
    return read_head(&file) ? read_five(out, &file, err) : damaged(err);
}

const hada_decoder hada_matlab = {.decode = decode};
