#include "io/tiff_stack_write.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <tiff.h>
#include <unistd.h>

#include "core/alloc.h"

enum { TAG_IMAGEJ_COUNTS = 50838, TAG_IMAGEJ = 50839, MOST_ENTRIES = 20 };

typedef struct hada_entry {
    uint16_t tag, type;
    uint64_t count;
    const void *data; /* NULL: `value`, one number */
    uint64_t value;
    size_t bytes;
} hada_entry;

typedef struct hada_directory {
    hada_entry entries[MOST_ENTRIES]; /* in ascending order of tags, as TIFF asks */
    unsigned count;
    uint32_t resolution[2];
} hada_directory;

static void add_value(hada_directory *d, uint16_t tag, uint16_t type, uint64_t value)
{
    size_t bytes = type == TIFF_SHORT ? 2 : type == TIFF_LONG ? 4 : 8;
    d->entries[d->count++] = (hada_entry){tag, type, 1, NULL, value, bytes};
}

static void add_data(hada_directory *d, uint16_t tag, uint16_t type, uint64_t count, const void *data, size_t bytes)
{
    d->entries[d->count++] = (hada_entry){tag, type, count, data, 0, bytes};
}

/* The directory of image `index`; only the first one carries the texts. */
static void fill(hada_directory *d, const hada_stack_layout *layout, const hada_tiff_text *text, uint64_t index)
{
    uint16_t place = layout->big ? TIFF_LONG8 : TIFF_LONG;
    d->count = 0;
    add_value(d, TIFFTAG_SUBFILETYPE, TIFF_LONG, 0);
    add_value(d, TIFFTAG_IMAGEWIDTH, TIFF_LONG, (uint64_t)layout->cols);
    add_value(d, TIFFTAG_IMAGELENGTH, TIFF_LONG, (uint64_t)layout->rows);
    add_value(d, TIFFTAG_BITSPERSAMPLE, TIFF_SHORT, (uint64_t)layout->bits);
    add_value(d, TIFFTAG_COMPRESSION, TIFF_SHORT, COMPRESSION_NONE);
    add_value(d, TIFFTAG_PHOTOMETRIC, TIFF_SHORT, PHOTOMETRIC_MINISBLACK);
    if (!index)
        add_data(d, TIFFTAG_IMAGEDESCRIPTION, TIFF_ASCII, strlen(text->description) + 1, text->description,
                 strlen(text->description) + 1);
    add_value(d, TIFFTAG_STRIPOFFSETS, place, layout->data_at + index * layout->image_bytes);
    add_value(d, TIFFTAG_SAMPLESPERPIXEL, TIFF_SHORT, 1);
    add_value(d, TIFFTAG_ROWSPERSTRIP, TIFF_LONG, (uint64_t)layout->rows);
    add_value(d, TIFFTAG_STRIPBYTECOUNTS, place, layout->image_bytes);
    if (layout->pixel_um > 0) {
        /* Pixels per millimetre, the unit of the text, as a fraction of a million. */
        double density = 1e9 / layout->pixel_um;
        d->resolution[0] = density < 4e9 ? (uint32_t)(density + 0.5) : 4000000000u;
        d->resolution[1] = 1000000;
        add_data(d, TIFFTAG_XRESOLUTION, TIFF_RATIONAL, 1, d->resolution, 8);
        add_data(d, TIFFTAG_YRESOLUTION, TIFF_RATIONAL, 1, d->resolution, 8);
        add_value(d, TIFFTAG_RESOLUTIONUNIT, TIFF_SHORT, RESUNIT_NONE);
    }
    if (!index)
        add_data(d, TIFFTAG_SOFTWARE, TIFF_ASCII, sizeof "Hadalens " HADALENS_VERSION, "Hadalens " HADALENS_VERSION,
                 sizeof "Hadalens " HADALENS_VERSION);
    add_value(d, TIFFTAG_SAMPLEFORMAT, TIFF_SHORT, layout->bits == 32 ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT);
    if (!index && text->extra) {
        add_data(d, TAG_IMAGEJ_COUNTS, TIFF_LONG, text->count, text->counts, text->count * sizeof(uint32_t));
        add_data(d, TAG_IMAGEJ, TIFF_BYTE, text->extra_bytes, text->extra, text->extra_bytes);
    }
}

static size_t even(size_t bytes)
{
    return (bytes + 7) / 8 * 8;
}

/* Bytes of a directory with its data. */
static size_t directory_bytes(const hada_directory *d, int big)
{
    size_t bytes = even(big ? 8 + d->count * 20u + 8 : 2 + d->count * 12u + 4);
    for (unsigned i = 0; i < d->count; i++)
        if (d->entries[i].bytes > (big ? 8u : 4u))
            bytes += even(d->entries[i].bytes);
    return bytes;
}

static unsigned char *put(unsigned char *to, uint64_t value, int bytes)
{
    const uint16_t v2 = (uint16_t)value;
    const uint32_t v4 = (uint32_t)value;
    memcpy(to, bytes == 2 ? (const void *)&v2 : bytes == 4 ? (const void *)&v4 : (const void *)&value, (size_t)bytes);
    return to + bytes;
}

/* Lays the directory out at `to`, which will stand at `at` in the file; `next` is the link to the one after it. */
static void lay_out(const hada_directory *d, int big, uint64_t at, uint64_t next, unsigned char *to)
{
    int wide = big ? 8 : 4;
    unsigned char *entry = put(to, d->count, big ? 8 : 2);
    size_t data = even(big ? 8 + d->count * 20u + 8 : 2 + d->count * 12u + 4);
    for (unsigned i = 0; i < d->count; i++) {
        const hada_entry *e = &d->entries[i];
        entry = put(put(put(entry, e->tag, 2), e->type, 2), e->count, wide);
        if (!e->data) {
            put(entry, e->value, (int)e->bytes);
        } else if (e->bytes <= (size_t)wide) {
            memcpy(entry, e->data, e->bytes);
        } else {
            put(entry, at + data, wide);
            memcpy(to + data, e->data, e->bytes);
            data += even(e->bytes);
        }
        entry += wide;
    }
    put(entry, next, wide);
}

hada_status hada_stack_layout_place(hada_stack_layout *layout, const hada_tiff_text *text, hada_error *err)
{
    hada_directory first;
    layout->image_bytes = (uint64_t)layout->rows * (uint64_t)layout->cols * (uint64_t)(layout->bits / 8);
    fill(&first, layout, text, 0);
    layout->data_at = (16 + directory_bytes(&first, layout->big) + 63) / 64 * 64;
    if (layout->big || layout->data_at + layout->images * (layout->image_bytes + 256) < UINT32_MAX)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_SIZE,
                     "the metadata are too long for a TIFF file of this size; shorten the description");
}

static hada_status write_at(hada_outfile *file, const void *data, size_t bytes, uint64_t at, hada_error *err)
{
    if (lseek(file->fd, (off_t)at, SEEK_SET) < 0)
        return hada_fail(err, HADA_ERROR_FILE_WRITE, "writing %s failed: %s", file->path, strerror(errno));
    return hada_outfile_write(file, data, bytes, err);
}

hada_status hada_stack_layout_write(const hada_stack_layout *layout, const hada_tiff_text *text, hada_outfile *file,
                                    hada_error *err)
{
    hada_status status = HADA_OK;
    const uint16_t one = 1;
    int little = *(const unsigned char *)&one;
    uint64_t tail = (layout->data_at + layout->images * layout->image_bytes + 7) / 8 * 8;
    hada_directory d;
    fill(&d, layout, text, 0);
    void *head;
    HADA_TRY_OR_DONE(hada_allocated(head = hada_alloc((size_t)layout->data_at, 1, "the head of a TIFF file", err)));
    unsigned char *at = head;
    at[0] = at[1] = little ? 'I' : 'M';
    if (layout->big)
        put(put(put(put(at + 2, 43, 2), 8, 2), 0, 2), 16, 8);
    else
        put(put(at + 2, 42, 2), 16, 4);
    lay_out(&d, layout->big, 16, layout->images > 1 ? tail : 0, at + 16);
    HADA_TRY_OR_DONE(write_at(file, head, (size_t)layout->data_at, 0, err));
    /* The others all have one size. A few hundred at a time. */
    unsigned char block[256 * 512];
    size_t used = 0;
    uint64_t block_at = tail;
    for (uint64_t i = 1; i < layout->images; i++) {
        fill(&d, layout, text, i);
        size_t bytes = directory_bytes(&d, layout->big);
        memset(block + used, 0, bytes);
        uint64_t here = block_at + used;
        lay_out(&d, layout->big, here, i + 1 < layout->images ? here + bytes : 0, block + used);
        used += bytes;
        if (sizeof block - used < 512 || i + 1 == layout->images) {
            HADA_TRY_OR_DONE(write_at(file, block, used, block_at, err));
            block_at += used;
            used = 0;
        }
    }
done:
    free(head);
    return status;
}
