#include <errno.h>
#include <hadalens/limits.h>
#include <hadalens/response.h>
#include <hadalens/tiff.h>
#include <limits.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/input.h"
#include "io/decode.h"
#include "io/folder.h"
#include "io/isolate.h"
#include "io/text.h"
#include "io/tiff_meta.h"
#include "io/tiff_page.h"

/* More than any single buffer that libtiff itself needs for a valid file. */
#define LIBTIFF_ALLOCATION ((tmsize_t)1 << 31)

static int keep_error(TIFF *tif, void *user, const char *module, const char *format, va_list arguments)
{
    (void)tif;
    (void)module;
    hada_tiff_handle *handle = user;
    if (!*handle->message)
        vsnprintf(handle->message, sizeof handle->message, format, arguments);
    return 1;
}

static int drop_warning(TIFF *tif, void *user, const char *module, const char *format, va_list arguments)
{
    (void)tif;
    (void)user;
    (void)module;
    (void)format;
    (void)arguments;
    return 1;
}

/* libtiff opens at the first directory that the header names. Naming another one there makes every page as quick to
 * open as the first; libtiff itself walks from the first page on. */
static void redirect(const hada_tiff_handle *handle, unsigned char *data, uint64_t begin, uint64_t end)
{
    uint64_t at = handle->big ? 8 : 4, bytes = handle->big ? 8 : 4;
    const int little = HADA_LITTLE_ENDIAN != handle->swapped;
    for (uint64_t i = 0; i < bytes; i++) {
        uint64_t place = at + i;
        if (place >= begin && place < end)
            data[place - begin] = (unsigned char)(handle->first >> 8 * (little ? i : bytes - 1 - i));
    }
}

static tmsize_t on_read(thandle_t user, void *data, tmsize_t bytes)
{
    hada_tiff_handle *handle = user;
    tmsize_t total = 0;
    while (total < bytes) {
        ssize_t done =
            pread(handle->fd, (char *)data + total, (size_t)(bytes - total), (off_t)handle->position + total);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            break;
        total += done;
    }
    if (handle->first && total > 0)
        redirect(handle, data, handle->position, handle->position + (uint64_t)total);
    handle->position += (uint64_t)total;
    return total;
}

static tmsize_t on_write(thandle_t user, void *data, tmsize_t bytes)
{
    hada_tiff_handle *handle = user;
    tmsize_t total = 0;
    while (total < bytes) {
        ssize_t done =
            pwrite(handle->fd, (char *)data + total, (size_t)(bytes - total), (off_t)handle->position + total);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0) {
            if (!handle->write_code)
                handle->write_code = done < 0 ? errno : ENOSPC;
            break;
        }
        total += done;
    }
    handle->position += (uint64_t)total;
    return total;
}

static toff_t file_size(thandle_t user)
{
    hada_tiff_handle *handle = user;
    struct stat info;
    if (!fstat(handle->fd, &info))
        return (toff_t)info.st_size;
    handle->write_code = errno; /* libtiff would write over the beginning, and not say so */
    return 0;
}

static toff_t on_seek(thandle_t user, toff_t offset, int whence)
{
    hada_tiff_handle *handle = user;
    uint64_t base = whence == SEEK_CUR ? handle->position : whence == SEEK_END ? file_size(user) : 0;
    if (base + offset > INT64_MAX)
        return (toff_t)-1;
    return handle->position = base + offset;
}

static int on_close(thandle_t user)
{
    (void)user;
    return 0;
}

TIFF *hada_tiff_attach(hada_tiff_handle *handle, const char *name, const char *mode)
{
    handle->position = 0;
    handle->message[0] = 0;
    TIFFOpenOptions *options = TIFFOpenOptionsAlloc();
    if (!options) {
        snprintf(handle->message, sizeof handle->message, "out of memory");
        return NULL;
    }
    TIFFOpenOptionsSetErrorHandlerExtR(options, keep_error, handle);
    TIFFOpenOptionsSetWarningHandlerExtR(options, drop_warning, handle);
    TIFFOpenOptionsSetMaxSingleMemAlloc(options, LIBTIFF_ALLOCATION);
    TIFF *tif =
        TIFFClientOpenExt(name, mode, handle, on_read, on_write, on_seek, on_close, file_size, NULL, NULL, options);
    TIFFOpenOptionsFree(options);
    return tif;
}

struct hada_tiff_reader {
    char *path, *description;
    double *distances_mm;
    int fd;
    hada_tiff_chain chain;
    hada_tiff_stack stack;
    hada_tiff_page first;
    hada_tiff_info info;
    int grouped;                /* each channel of a frame has its own page */
    uint64_t raw_bytes;         /* of one image where all stand one after the other, uncompressed; 0 else */
    uint64_t raw_at;            /* where the first one begins: in the file, or in `decoded` */
    unsigned char *decoded;     /* what a file that is not TIFF holds; NULL: it is read from the file */
    hada_headerless headerless; /* rows not 0: the file is nothing but such frames */
    unsigned char *seen;        /* pages that were read before, and the bytes that these have in the file */
    uint64_t seen_bytes;
    hada_isolated *isolated; /* the process that decodes the file; NULL: this one does */
};

/* Opens libtiff at page number `page` and checks it. */
static hada_status open_page(const hada_tiff_reader *reader, size_t page, hada_tiff_handle *handle, TIFF **tif,
                             hada_tiff_page *format, hada_error *err)
{
    *handle = (hada_tiff_handle){.fd = reader->fd,
                                 .first = reader->chain.pages[page],
                                 .swapped = reader->chain.swapped,
                                 .big = reader->chain.big};
    *tif = hada_tiff_attach(handle, reader->path, "rm");
    if (!*tif)
        return hada_fail(err, HADA_ERROR_FILE_READ,
                         "the directory cannot be read (%s): the file is damaged; get it again",
                         *handle->message ? handle->message : "no reason given");
    return format ? hada_tiff_page_check(*tif, reader->chain.bytes, reader->stack.imagej, format, err) : HADA_OK;
}

/* ImageJ writes stacks beyond 4 GiB, and tifffile any stack on request, as one directory and the images' pixels one
 * after the other. */
static hada_status find_raw_images(hada_tiff_reader *reader, TIFF *tif, hada_error *err)
{
    const hada_tiff_stack *stack = &reader->stack;
    uint64_t *offsets = NULL, bytes = hada_tiff_page_bytes(&reader->first);
    if (!stack->imagej || reader->chain.count != 1 || stack->images < 2 ||
        reader->first.compression != COMPRESSION_NONE || TIFFIsTiled(tif) || reader->first.palette ||
        !TIFFGetField(tif, TIFFTAG_STRIPOFFSETS, &offsets) || !offsets)
        return HADA_OK;
    uint32_t strips = TIFFNumberOfStrips(tif);
    for (uint32_t i = 1; i < strips; i++)
        if (offsets[i] <= offsets[i - 1] || offsets[i] - offsets[0] >= bytes)
            return HADA_OK;
    uint64_t left = reader->chain.bytes > offsets[0] ? reader->chain.bytes - offsets[0] : 0;
    if (left / bytes < (uint64_t)stack->images)
        return hada_fail(err, HADA_ERROR_FILE_READ,
                         "an ImageJ stack of %d images, but the file holds only %llu: it is cut off; get it again",
                         stack->images, (unsigned long long)(left / bytes));
    reader->raw_at = offsets[0];
    reader->raw_bytes = bytes;
    return HADA_OK;
}

static void fill_pixel_size(hada_tiff_reader *reader, TIFF *tif)
{
    hada_tiff_info *info = &reader->info;
    float across = 0, down = 0;
    uint16_t unit = RESUNIT_NONE;
    TIFFGetField(tif, TIFFTAG_XRESOLUTION, &across);
    TIFFGetField(tif, TIFFTAG_YRESOLUTION, &down);
    TIFFGetField(tif, TIFFTAG_RESOLUTIONUNIT, &unit);
    double um = unit == RESUNIT_INCH ? 25400 : unit == RESUNIT_CENTIMETER ? 10000 : reader->stack.unit_um;
    info->pixel_width_um = reader->stack.width_um > 0 ? reader->stack.width_um : across > 0 ? um / (double)across : 0;
    info->pixel_height_um = reader->stack.height_um > 0 ? reader->stack.height_um : down > 0 ? um / (double)down : 0;
    info->slice_spacing = reader->stack.spacing_um;
}

static uint64_t frame_values(const hada_tiff_info *info)
{
    return (uint64_t)info->channels * (uint64_t)info->rows * (uint64_t)info->cols;
}

static hada_status fill_info(hada_tiff_reader *reader, hada_error *err)
{
    hada_tiff_info *info = &reader->info;
    hada_tiff_stack *stack = &reader->stack;
    const hada_tiff_page *first = &reader->first;
    size_t pages = reader->raw_bytes ? (size_t)stack->images : reader->chain.count;
    if (pages > INT_MAX)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "the file has %zu pages; at most %d are offered", pages, INT_MAX);
    /* A text that speaks of other pages than are there says nothing about their order. */
    stack->known = stack->known && (size_t)stack->images == pages;
    reader->grouped = stack->known && stack->channels > 1 && first->channels == 1;
    info->frames = reader->grouped ? (int)pages / stack->channels : (int)pages;
    info->channels = reader->grouped ? stack->channels : first->channels;
    info->rows = first->rows;
    info->cols = first->cols;
    info->bits = first->bits;
    info->is_float = first->is_float;
    info->is_signed = first->is_signed;
    info->scale = first->scale;
    info->slices = stack->known && stack->slices * stack->times == info->frames ? stack->slices : 1;
    info->times = info->frames / info->slices;
    const hada_status status =
        hada_allocated(reader->seen = hada_alloc(reader->chain.count, 1, "the list of pages", err));
    return !status && reader->grouped ? hada_tiff_budget(frame_values(info), 0, reader->chain.bytes, err) : status;
}

/* Before libtiff takes memory for it. */
static hada_status check_text(const hada_tiff_reader *reader, hada_error *err)
{
    hada_limits limits = {.size = sizeof limits};
    uint64_t bytes = 0;
    const hada_status status = hada_limits_get(&limits, err);
    if (status ||
        !hada_tiff_chain_find(&reader->chain, reader->fd, reader->chain.pages[0], TIFFTAG_IMAGEDESCRIPTION, &bytes))
        return status;
    return bytes <= limits.text
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_FILE_FORMAT,
                           "the description has %llu bytes, more than the limits allow (options.limits text=N)",
                           (unsigned long long)bytes);
}

/* Reads the numbers of a line of the description; counts them where `out` is NULL. */
static int read_distances(const char *description, double *out)
{
    const char *at = hada_text_line(description, "distances_mm"), *end;
    int count = 0;
    while (at) {
        const double value = hada_text_number(at, &end);
        if (end == at)
            break;
        if (out)
            out[count] = value;
        count++;
        at = *end == ',' ? end + 1 : NULL;
    }
    return count;
}

static hada_status take_description(hada_tiff_reader *reader, hada_error *err)
{
    hada_tiff_info *info = &reader->info;
    info->description = reader->description;
    info->encoding = hada_text_response(reader->description, "encoding");
    info->distances = read_distances(reader->description, NULL);
    if (!info->distances)
        return HADA_OK;
    HADA_TRY(HADA_NEW(reader->distances_mm, (size_t)info->distances, "the distances", err));
    read_distances(reader->description, reader->distances_mm);
    info->distances_mm = reader->distances_mm;
    return HADA_OK;
}

/* Opens a file that is not TIFF; *known 0: it is none that is known. */
static hada_status open_decoded(hada_tiff_reader *reader, size_t bytes, int *known, hada_error *err)
{
    hada_decoded file;
    HADA_TRY(hada_decode(&file, reader->fd, bytes, known, err));
    if (!*known)
        return HADA_OK;
    const hada_tiff_page *page = &file.page;
    reader->first = file.page;
    reader->raw_bytes = hada_tiff_page_bytes(page);
    reader->raw_at = file.at;
    reader->decoded = file.samples;
    reader->headerless = file.headerless;
    reader->chain.swapped = file.swapped;
    reader->chain.bytes = bytes;
    reader->info = (hada_tiff_info){.frames = file.frames,
                                    .channels = page->channels,
                                    .rows = page->rows,
                                    .cols = page->cols,
                                    .bits = page->bits,
                                    .is_float = page->is_float,
                                    .is_signed = page->is_signed,
                                    .scale = page->scale,
                                    .slices = 1,
                                    .times = file.frames,
                                    .description = "",
                                    .encoding = file.encoding,
                                    .mosaic = file.mosaic};
    return HADA_OK;
}

static hada_status open_here(hada_tiff_reader *reader, size_t bytes, hada_error *err)
{
    int known;
    hada_status status = HADA_OK;
    HADA_TRY(open_decoded(reader, bytes, &known, err));
    if (known)
        return HADA_OK;
    hada_tiff_handle handle;
    TIFF *tif = NULL;
    char *text = NULL;
    HADA_TRY_OR_DONE(hada_tiff_chain_read(&reader->chain, reader->fd, err));
    HADA_TRY_OR_DONE(check_text(reader, err));
    HADA_TRY_OR_DONE(open_page(reader, 0, &handle, &tif, NULL, err));
    TIFFGetField(tif, TIFFTAG_IMAGEDESCRIPTION, &text);
    reader->description = hada_string_copy(text ? text : "");
    if (!reader->description)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory for the description"));
    HADA_TRY_OR_DONE(hada_tiff_stack_parse(&reader->stack, reader->description, reader->chain.count, err));
    HADA_TRY_OR_DONE(hada_tiff_page_check(tif, reader->chain.bytes, reader->stack.imagej, &reader->first, err));
    HADA_TRY_OR_DONE(find_raw_images(reader, tif, err));
    HADA_TRY_OR_DONE(fill_info(reader, err));
    HADA_TRY_OR_DONE(take_description(reader, err));
    fill_pixel_size(reader, tif);
done:
    if (tif)
        TIFFClose(tif);
    return status;
}

static hada_status open_file(hada_tiff_reader *reader, hada_error *err)
{
    size_t bytes;
    HADA_TRY(hada_input_open(&reader->fd, &bytes, reader->path, NULL, err));
    HADA_TRY(hada_isolated_open(&reader->isolated, reader->fd, bytes, reader->path, &reader->info, err));
    reader->chain.bytes = bytes;
    return reader->isolated ? HADA_OK : open_here(reader, bytes, err);
}

/* fd -1: the file is opened by its name, and perhaps by another process. */
static hada_status open_reader(hada_tiff_reader **out, int fd, size_t bytes, const char *path, hada_error *err)
{
    hada_tiff_reader *reader = calloc(1, sizeof *reader);
    if (reader) {
        reader->fd = fd;
        reader->path = hada_string_copy(path);
    }
    hada_status status =
        reader && reader->path ? HADA_OK : hada_fail(err, HADA_ERROR_MEMORY, "no memory to open a file");
    if (status == HADA_OK)
        status = fd < 0 ? open_file(reader, err) : open_here(reader, bytes, err);
    if (status)
        hada_tiff_close(&reader);
    *out = reader;
    return status;
}

hada_status hada_tiff_open(hada_tiff_reader **out, const char *path, hada_error *err)
{
    HADA_NEED(out && path, err);
    *out = NULL;
    const hada_status status = open_reader(out, -1, 0, path, err);
    return status ? hada_named(status, path, err) : HADA_OK;
}

hada_status hada_tiff_open_here(hada_tiff_reader **out, int fd, size_t bytes, const char *path, hada_error *err)
{
    return open_reader(out, fd, bytes, path, err);
}

void hada_tiff_close(hada_tiff_reader **reader)
{
    hada_tiff_reader *r = hada_taken(reader);
    if (!r)
        return;
    hada_isolated_close(&r->isolated);
    if (r->fd >= 0)
        close(r->fd);
    hada_tiff_chain_free(&r->chain);
    hada_tiff_stack_free(&r->stack);
    HADA_FREE(r->seen, r->path, r->description, r->distances_mm, r->decoded, r);
}

const hada_tiff_info *hada_tiff_get_info(const hada_tiff_reader *reader)
{
    return reader ? &reader->info : NULL;
}

hada_status hada_tiff_check_all(const hada_tiff_reader *reader, hada_error *err)
{
    return hada_named(
        hada_tiff_budget((uint64_t)reader->info.frames * frame_values(&reader->info), 0, reader->chain.bytes, err),
        reader->path, err);
}

/* The samples of a frame without a header, as raw_bytes holds them. */
static hada_status read_headerless(const hada_tiff_reader *reader, size_t number, void *out, hada_error *err)
{
    const hada_headerless *frames = &reader->headerless;
    const uint64_t bytes = hada_headerless_bytes(frames, 1);
    unsigned char *packed = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(packed = hada_alloc_raw(1, (size_t)bytes, "a frame", err)));
    if (hada_read_at(reader->fd, packed, (size_t)bytes, number * bytes))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ,
                                   "frame %zu cannot be read: the file has become shorter; get it again", number + 1));
    hada_headerless_unpack(frames, packed, out);
done:
    free(packed);
    return status;
}

static hada_status read_raw_image(const hada_tiff_reader *reader, size_t number, hada_pixel_type form, void *out,
                                  hada_error *err)
{
    const uint64_t at = reader->raw_at + number * reader->raw_bytes;
    void *buffer = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(
        hada_allocated(buffer = hada_alloc_raw(1, (size_t)reader->raw_bytes, "an image of the stack", err)));
    if (reader->headerless.rows)
        HADA_TRY_OR_DONE(read_headerless(reader, number, buffer, err));
    else if (reader->decoded)
        memcpy(buffer, (const unsigned char *)reader->decoded + at, (size_t)reader->raw_bytes);
    else if (hada_read_at(reader->fd, buffer, (size_t)reader->raw_bytes, at))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_READ,
                                   "image %zu cannot be read: the file is cut off; get it again", number + 1));
    hada_tiff_page_convert(&reader->first, buffer, reader->chain.swapped, form, out);
done:
    free(buffer);
    return status;
}

/* Pages must not share pixels: a small file whose pages do could keep a reader busy for hours. */
static hada_status note_page(hada_tiff_reader *reader, size_t number, const hada_tiff_page *page, hada_error *err)
{
    if (reader->seen[number])
        return HADA_OK;
    reader->seen[number] = 1;
    reader->seen_bytes += page->stored_bytes;
    return reader->seen_bytes <= reader->chain.bytes
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_FILE_READ,
                           "the pages hold more pixels than the file has bytes for: it is damaged; get it again");
}

/* Memory for a frame of pages like this one. */
static hada_status make_frame(const hada_tiff_reader *reader, const hada_tiff_page *page, int stored,
                              hada_pixels *frame, hada_error *err)
{
    const hada_pixel_type form = stored ? hada_tiff_page_form(page) : HADA_PIXEL_F32;
    const size_t bytes = form == HADA_PIXEL_U8 ? 1 : form == HADA_PIXEL_U16 ? 2 : 4;
    const int channels = reader->grouped ? reader->info.channels : page->channels;
    void *data;
    HADA_TRY(
        hada_allocated(data = hada_alloc(hada_size_product((size_t)channels * (size_t)page->rows, (size_t)page->cols),
                                         bytes, "an image", err)));
    hada_pixels_planar(frame, data, form, channels, page->rows, page->cols);
    if (form != HADA_PIXEL_F32)
        frame->full_scale = page->scale;
    return HADA_OK;
}

/* Whether the frame takes a page in the form that it has. */
static int takes(const hada_pixels *frame, const hada_tiff_page *page)
{
    return frame->type == HADA_PIXEL_F32 ||
           (frame->type == hada_tiff_page_form(page) && frame->full_scale == page->scale);
}

/* Reads a page into *frame, whose memory is made for its first page; stored: in the form of that page. *mixed: 1: this
 * page has another form, and was not read. */
static hada_status read_page(hada_tiff_reader *reader, size_t number, int channel, int stored, hada_pixels *frame,
                             int *mixed, hada_error *err)
{
    hada_tiff_handle handle;
    TIFF *tif = NULL;
    hada_tiff_page page = reader->first;
    hada_status status = HADA_OK;
    if (!reader->raw_bytes) {
        HADA_TRY_OR_DONE(open_page(reader, number, &handle, &tif, &page, err));
        HADA_TRY_OR_DONE(note_page(reader, number, &page, err));
    }
    if (channel == 0)
        HADA_TRY_OR_DONE(make_frame(reader, &page, stored, frame, err));
    if (page.rows != frame->rows || page.cols != frame->cols || (reader->grouped && page.channels != 1))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_FORMAT,
                                   "page %zu has another size (%d x %d) than the first channel (%d x %d)", number + 1,
                                   page.rows, page.cols, frame->rows, frame->cols));
    *mixed = !takes(frame, &page);
    if (*mixed)
        goto done;
    void *out = (unsigned char *)frame->data + (ptrdiff_t)channel * frame->channel_stride;
    if (reader->raw_bytes)
        HADA_TRY_OR_DONE(read_raw_image(reader, number, frame->type, out, err));
    else
        HADA_TRY_OR_DONE(hada_tiff_page_read(tif, &handle, &page, frame->type, out, err));
done:
    if (tif)
        TIFFClose(tif);
    return status;
}

static void drop(hada_pixels *frame)
{
    free((void *)frame->data);
    frame->data = NULL;
}

static hada_status read_frame(hada_tiff_reader *reader, int index, int stored, hada_pixels *frame, hada_error *err)
{
    const hada_tiff_stack *stack = &reader->stack;
    hada_pixels_init(frame);
    if (index < 0 || index >= reader->info.frames)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%s: frame %d was asked for; the file has %d", reader->path, index,
                         reader->info.frames);
    if (reader->isolated)
        return hada_isolated_read(reader->isolated, index, stored, frame, err);
    const int channels = reader->grouped ? stack->channels : 1;
    hada_status status = HADA_OK;
    size_t page = (size_t)index;
    int mixed = 0;
    for (int c = 0; !mixed && c < channels; c++) {
        int z = index % reader->info.slices, t = index / reader->info.slices;
        if (stack->known && (reader->grouped || stack->channels == 1))
            page = stack->pages ? (size_t)stack->pages[index * channels + c]
                                : (size_t)(c * stack->channel_step + z * stack->slice_step + t * stack->time_step);
        HADA_TRY_OR_DONE(read_page(reader, page, c, stored, frame, &mixed, err));
    }
done:
    if (status)
        hada_error_prefix(err, "%s, page %zu: ", reader->path, page + 1);
    if (status || mixed)
        drop(frame);
    return mixed ? read_frame(reader, index, 0, frame, err) : status;
}

void hada_tiff_presume(hada_tiff_reader *reader, double encoding)
{
    if (reader->info.encoding == 0.0 && !reader->info.is_float)
        reader->info.encoding = encoding;
}

/* 1: it is linear, or nothing is said. */
static int is_linear(const hada_tiff_reader *reader, double *encoding)
{
    if (*encoding == HADA_AUTO)
        *encoding = reader->info.encoding != 0.0 ? reader->info.encoding : HADA_RESPONSE_LINEAR;
    return *encoding == HADA_RESPONSE_LINEAR;
}

hada_status hada_tiff_read_stored(hada_tiff_reader *reader, int index, double encoding, hada_pixels *pixels,
                                  hada_error *err)
{
    if (is_linear(reader, &encoding))
        return read_frame(reader, index, 1, pixels, err);
    hada_image image;
    hada_pixels_init(pixels);
    HADA_TRY(hada_tiff_read_light(reader, index, encoding, &image, err));
    hada_pixels_of_image(pixels, &image);
    return HADA_OK;
}

hada_status hada_tiff_read_light(hada_tiff_reader *reader, int index, double encoding, hada_image *image,
                                 hada_error *err)
{
    HADA_TRY(hada_tiff_read(reader, index, image, err));
    if (!is_linear(reader, &encoding))
        hada_response_convert(image->data, hada_image_count(image), encoding, HADA_RESPONSE_LINEAR);
    return HADA_OK;
}

hada_status hada_tiff_read(hada_tiff_reader *reader, int index, hada_image *image, hada_error *err)
{
    hada_pixels frame;
    HADA_NEED(reader && image, err);
    *image = (hada_image){0};
    HADA_TRY(read_frame(reader, index, 0, &frame, err));
    *image = (hada_image){frame.channels, frame.rows, frame.cols, (float *)frame.data};
    return HADA_OK;
}

hada_status hada_tiff_load_light(const char *path, int index, double encoding, hada_image *image, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    *image = (hada_image){0};
    HADA_TRY(hada_tiff_open(&reader, path, err));
    const hada_status status = hada_tiff_read_light(reader, index, encoding, image, err);
    hada_tiff_close(&reader);
    return status;
}

hada_status hada_tiff_load(const char *path, int index, hada_image *image, hada_error *err)
{
    HADA_NEED(path && image, err);
    return hada_tiff_load_light(path, index, HADA_RESPONSE_LINEAR, image, err);
}
