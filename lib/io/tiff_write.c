#include <errno.h>
#include <float.h>
#include <hadalens/response.h>
#include <tiff.h>
#include <unistd.h>

#include "core/callers.h"
#include "io/tiff_page.h"
#include "io/tiff_write.h"

/* Classic TIFF addresses 4 GiB; the rest is room for directories and metadata. */
#define CLASSIC_LIMIT 3.9e9
#define STRIP_BYTES   ((size_t)1 << 20)

enum { TAG_IMAGEJ_COUNTS = 50838, TAG_IMAGEJ = 50839 };

struct hada_tiff_writer {
    hada_outfile file;
    hada_tiff_handle handle;
    TIFF *tif; /* NULL: an uncompressed hyperstack, written after `stack` */
    hada_stack_layout stack;
    hada_tiff_write_options options;
    double *distances;
    char *description;
    hada_tiff_text text;
    int channels, rows, cols, big;
    int frames; /* written so far */
    int strip_rows;
    void *strip;
    float *encoded;  /* a strip of light on its way to the encoding; NULL: none came so far */
    float low, high; /* of the finite values */
};

static hada_status complete_options(hada_tiff_writer *w, const hada_tiff_write_options *given, hada_error *err)
{
    hada_tiff_write_options *o = &w->options;
    HADA_TRY(HADA_OPTIONS_TAKE(o, given, hada_tiff_write_options, err));
    if (!(o->scale > 0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a full scale of %g was asked for; it is above 0", o->scale);
    if (o->encoding != 0.0 && !hada_response_is_known(o->encoding))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "an encoding of %g is none (hadalens/response.h)", o->encoding);
    if (!(o->pixel_um >= 0.0 && isfinite(o->pixel_um)) || (unsigned)o->layout > HADA_TIFF_HYPERSTACK || o->slices < 0 ||
        o->times < 0)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "options.pixel_um is %g, layout %d, slices %d and times %d: none is negative, and the layout is "
            "one of HADA_TIFF_...",
            o->pixel_um, (int)o->layout, o->slices, o->times);
    o->description = o->description ? o->description : "";
    if (o->layout == HADA_TIFF_HYPERSTACK || o->distances_mm) {
        o->slices = o->slices < 1 ? 1 : o->slices;
        o->times = o->times < 1 ? 1 : o->times;
    }
    if (o->bits != 8 && o->bits != 16 && o->bits != 32)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%d bits were asked for; 8, 16 and 32 (float) are offered", o->bits);
    if (w->channels < 1 || w->channels > 4096 || w->rows < 1 || w->cols < 1 ||
        (double)w->channels * (o->slices ? o->slices : 1) * (o->times ? o->times : 1) > 1 << 30)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%d channels of %d x %d pixels, %d slices and %d times cannot be written", w->channels,
                         w->rows, w->cols, o->slices, o->times);
    o->description = w->description = hada_string_copy(o->description);
    if (!w->description)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the description");
    if (o->distances_mm) {
        w->distances = malloc((size_t)o->slices * sizeof(double));
        if (!w->distances)
            return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the distances");
        memcpy(w->distances, o->distances_mm, (size_t)o->slices * sizeof(double));
        o->distances_mm = w->distances;
    }
    return HADA_OK;
}

static hada_status failed(hada_tiff_writer *w, hada_error *err)
{
    if (w->handle.write_code)
        return hada_fail(err, HADA_ERROR_FILE_WRITE, "writing %s failed: %s; nothing was left behind, free some space",
                         w->file.path, strerror(w->handle.write_code));
    if (strstr(w->handle.message, "Maximum TIFF file size"))
        return hada_fail(
            err, HADA_ERROR_FILE_WRITE,
            "%s outgrew the 4 GiB of classic TIFF; nothing was left behind, say beforehand how many pages come",
            w->file.path);
    return hada_fail(err, HADA_ERROR_FILE_WRITE, "writing %s failed (%s); nothing was left behind", w->file.path,
                     *w->handle.message ? w->handle.message : "libtiff gives no reason");
}

static int samples_a_page(const hada_tiff_writer *w)
{
    return w->options.layout == HADA_TIFF_HYPERSTACK ? 1 : w->channels;
}

/* A hyperstack whose pixels are written straight into the file; all offsets are known beforehand. */
static hada_status open_stack(hada_tiff_writer *w, const char *path, hada_error *err)
{
    static const double unknown[2] = {0, 1};
    HADA_TRY(hada_tiff_text_build(&w->text, w->channels, w->rows, w->cols, &w->options, unknown, err));
    w->stack =
        (hada_stack_layout){.big = w->big,
                            .rows = w->rows,
                            .cols = w->cols,
                            .bits = w->options.bits,
                            .images = (uint64_t)w->channels * (uint64_t)w->options.slices * (uint64_t)w->options.times,
                            .pixel_um = w->options.pixel_um};
    HADA_TRY(hada_stack_layout_place(&w->stack, &w->text, err));
    if (lseek(w->file.fd, (off_t)w->stack.data_at, SEEK_SET) < 0)
        HADA_TRY(hada_fail(err, HADA_ERROR_FILE_WRITE, "writing %s failed: %s", path, strerror(errno)));
    return HADA_OK;
}

/* Pages that libtiff writes. */
static hada_status open_pages(hada_tiff_writer *w, const char *path, hada_error *err)
{
    HADA_TRY(hada_tiff_text_build(&w->text, w->channels, w->rows, w->cols, &w->options, NULL, err));
    w->handle.fd = w->file.fd;
    w->tif = hada_tiff_attach(&w->handle, path, w->big ? "w8" : "w");
    if (!w->tif)
        HADA_TRY(failed(w, err));
    return HADA_OK;
}

static hada_status open_output(hada_tiff_writer *w, const char *path, hada_error *err)
{
    HADA_TRY(hada_outfile_open(&w->file, path, err));
    double frames = (double)(w->options.slices ? w->options.slices : 1) * (w->options.times ? w->options.times : 1);
    w->big = frames * w->channels * w->rows * w->cols * (w->options.bits / 8) >= CLASSIC_LIMIT;
    if (w->options.layout == HADA_TIFF_HYPERSTACK && !w->options.compress)
        HADA_TRY(open_stack(w, path, err));
    else
        HADA_TRY(open_pages(w, path, err));
    size_t row = (size_t)w->cols * (size_t)samples_a_page(w) * (size_t)(w->options.bits / 8);
    size_t rows = STRIP_BYTES / row ? STRIP_BYTES / row : 1;
    w->strip_rows = rows < (size_t)w->rows ? (int)rows : w->rows;
    return hada_allocated(w->strip = hada_alloc((size_t)w->strip_rows, row, "a piece of the TIFF file", err));
}

hada_status hada_tiff_create(hada_tiff_writer **out, const char *path, int channels, int rows, int cols,
                             const hada_tiff_write_options *options, hada_error *err)
{
    HADA_NEED(out && path, err);
    *out = NULL;
    hada_tiff_writer *w = calloc(1, sizeof *w);
    if (!w)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory to write %s", path);
    w->file.fd = -1;
    w->channels = channels;
    w->rows = rows;
    w->cols = cols;
    w->low = FLT_MAX;
    w->high = -FLT_MAX;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(complete_options(w, options, err));
    HADA_TRY_OR_DONE(open_output(w, path, err));
done:
    if (status)
        hada_tiff_abandon(&w);
    *out = w;
    return status;
}

static int set_first_page(hada_tiff_writer *w)
{
    static const TIFFFieldInfo fields[] = {
        {TAG_IMAGEJ_COUNTS, TIFF_VARIABLE2, TIFF_VARIABLE2, TIFF_LONG, FIELD_CUSTOM, 1, 1,
         (char *)"IJMetadataByteCounts"},
        {TAG_IMAGEJ, TIFF_VARIABLE2, TIFF_VARIABLE2, TIFF_BYTE, FIELD_CUSTOM, 1, 1, (char *)"IJMetadata"}};
    int fine = TIFFSetField(w->tif, TIFFTAG_IMAGEDESCRIPTION, w->text.description) &&
               TIFFSetField(w->tif, TIFFTAG_SOFTWARE, "Hadalens " HADALENS_VERSION);
    if (w->text.extra)
        fine = fine && !TIFFMergeFieldInfo(w->tif, fields, 2) &&
               TIFFSetField(w->tif, TAG_IMAGEJ_COUNTS, w->text.count, w->text.counts) &&
               TIFFSetField(w->tif, TAG_IMAGEJ, (uint32_t)w->text.extra_bytes, w->text.extra);
    return fine;
}

static int set_tags(hada_tiff_writer *w, int first)
{
    TIFF *tif = w->tif;
    int samples = samples_a_page(w), is_float = w->options.bits == 32, fine = 1;
    fine &= TIFFSetField(tif, TIFFTAG_IMAGEWIDTH, (uint32_t)w->cols);
    fine &= TIFFSetField(tif, TIFFTAG_IMAGELENGTH, (uint32_t)w->rows);
    fine &= TIFFSetField(tif, TIFFTAG_BITSPERSAMPLE, w->options.bits);
    fine &= TIFFSetField(tif, TIFFTAG_SAMPLESPERPIXEL, samples);
    fine &= TIFFSetField(tif, TIFFTAG_SAMPLEFORMAT, is_float ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT);
    fine &= TIFFSetField(tif, TIFFTAG_PHOTOMETRIC, samples == 3 ? PHOTOMETRIC_RGB : PHOTOMETRIC_MINISBLACK);
    fine &= TIFFSetField(tif, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    fine &= TIFFSetField(tif, TIFFTAG_ROWSPERSTRIP, (uint32_t)w->strip_rows);
    fine &= TIFFSetField(tif, TIFFTAG_COMPRESSION, w->options.compress ? COMPRESSION_ADOBE_DEFLATE : COMPRESSION_NONE);
    if (w->options.compress)
        fine &= TIFFSetField(tif, TIFFTAG_PREDICTOR, is_float ? PREDICTOR_FLOATINGPOINT : PREDICTOR_HORIZONTAL);
    if (samples > 1 && samples != 3) {
        uint16_t *kinds = calloc((size_t)samples - 1, sizeof *kinds); /* 0 = not alpha */
        fine &= kinds && TIFFSetField(tif, TIFFTAG_EXTRASAMPLES, samples - 1, kinds);
        free(kinds);
    }
    if (w->options.pixel_um > 0) {
        /* ImageJ takes the unit from its text, in millimetres; elsewhere the tag's centimetres hold. */
        int stack = w->options.layout == HADA_TIFF_HYPERSTACK;
        float density = (float)((stack ? 1e3 : 1e4) / w->options.pixel_um);
        fine &= TIFFSetField(tif, TIFFTAG_RESOLUTIONUNIT, stack ? RESUNIT_NONE : RESUNIT_CENTIMETER);
        fine &= TIFFSetField(tif, TIFFTAG_XRESOLUTION, density) && TIFFSetField(tif, TIFFTAG_YRESOLUTION, density);
    }
    return fine && (!first || set_first_page(w));
}

/* The range of the finite values, in many columns side by side, which compilers make vectors of. */
static void widen_range(hada_tiff_writer *w, const float *values, size_t count)
{
    enum { COLUMNS = 64 };
    float low[COLUMNS], high[COLUMNS];
    for (size_t k = 0; k < COLUMNS; k++) {
        low[k] = w->low;
        high[k] = w->high;
    }
    for (size_t i = 0; i < count; i += COLUMNS) {
        const size_t here = count - i < COLUMNS ? count - i : COLUMNS;
        for (size_t k = 0; k < here; k++) {
            const float value = values[i + k];
            const float down = value >= -FLT_MAX ? value : FLT_MAX, up = value <= FLT_MAX ? value : -FLT_MAX;
            low[k] = down < low[k] ? down : low[k];
            high[k] = up > high[k] ? up : high[k];
        }
    }
    for (size_t k = 0; k < COLUMNS; k++) {
        w->low = low[k] < w->low ? low[k] : w->low;
        w->high = high[k] > w->high ? high[k] : w->high;
    }
}

/* Light of a strip, in the file's encoding. */
static hada_status encode(hada_tiff_writer *w, const float **values, size_t count, hada_error *err)
{
    if (!w->encoded)
        HADA_TRY(HADA_NEW_RAW(w->encoded, (size_t)w->strip_rows * (size_t)w->cols, "a piece of the TIFF file", err));
    memcpy(w->encoded, *values, count * sizeof(float));
    hada_response_convert(w->encoded, count, HADA_RESPONSE_LINEAR, w->options.encoding);
    *values = w->encoded;
    return HADA_OK;
}

/* Rows [row, row + rows) of `samples` channels from `channel` on, interleaved, as they are stored. */
static hada_status convert(hada_tiff_writer *w, const hada_image *image, int light, int channel, int samples, int row,
                           int rows, hada_error *err)
{
    size_t plane = (size_t)w->rows * (size_t)w->cols, count = (size_t)rows * (size_t)w->cols;
    double full = w->options.bits == 8 ? 255 : 65535, factor = full / w->options.scale;
    for (int s = 0; s < samples; s++) {
        const float *from = image->data + (size_t)(channel + s) * plane + (size_t)row * (size_t)w->cols;
        if (light)
            HADA_TRY(encode(w, &from, count, err));
        widen_range(w, from, count);
        for (size_t i = 0; i < count; i++) {
            size_t to = i * (size_t)samples + (size_t)s;
            if (w->options.bits == 32) {
                ((float *)w->strip)[to] = from[i];
                continue;
            }
            double value = (double)from[i] * factor;
            value = value > 0 ? (value < full ? value + 0.5 : full) : 0; /* NaN fails the first comparison */
            if (w->options.bits == 8)
                ((uint8_t *)w->strip)[to] = (uint8_t)value;
            else
                ((uint16_t *)w->strip)[to] = (uint16_t)value;
        }
    }
    return HADA_OK;
}

static hada_status write_page(hada_tiff_writer *w, const hada_image *image, int light, int channel, hada_error *err)
{
    int samples = samples_a_page(w);
    const size_t pixels = (size_t)w->rows * (size_t)w->cols;
    if (!w->tif && samples == 1 && w->options.bits == 32 && !light) { /* from the image itself */
        const float *plane = image->data + (size_t)channel * pixels;
        widen_range(w, plane, pixels);
        return hada_outfile_write(&w->file, plane, pixels * sizeof(float), err);
    }
    size_t row_bytes = (size_t)w->cols * (size_t)samples * (size_t)(w->options.bits / 8);
    if (w->tif && !set_tags(w, w->frames == 0 && channel == 0))
        return failed(w, err);
    for (int row = 0, strip = 0; row < w->rows; row += w->strip_rows, strip++) {
        int rows = w->rows - row < w->strip_rows ? w->rows - row : w->strip_rows;
        HADA_TRY(convert(w, image, light, channel, samples, row, rows, err));
        size_t bytes = (size_t)rows * row_bytes;
        if (w->tif && TIFFWriteEncodedStrip(w->tif, (uint32_t)strip, w->strip, (tmsize_t)bytes) < 0)
            return failed(w, err);
        HADA_TRY(w->tif ? HADA_OK : hada_outfile_write(&w->file, w->strip, bytes, err));
    }
    return !w->tif || TIFFWriteDirectory(w->tif) ? HADA_OK : failed(w, err);
}

static hada_status write_frame(hada_tiff_writer *w, const hada_image *image, int light, hada_error *err)
{
    HADA_NEED(w, err);
    HADA_NEED_IMAGE(image, NULL, err);
    if (image->channels != w->channels || image->rows != w->rows || image->cols != w->cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "%s takes frames of %d channels, %d x %d; this one has %d channels, %d x %d", w->file.path,
                         w->channels, w->rows, w->cols, image->channels, image->rows, image->cols);
    if (w->options.layout == HADA_TIFF_HYPERSTACK && w->frames >= w->options.slices * w->options.times)
        return hada_fail(err, HADA_ERROR_STATE, "%s was declared with %d slices and %d times; all are written",
                         w->file.path, w->options.slices, w->options.times);
    int pages = w->options.layout == HADA_TIFF_HYPERSTACK ? w->channels : 1;
    for (int channel = 0; channel < pages; channel++)
        HADA_TRY(write_page(w, image, light, channel, err));
    w->frames++;
    return HADA_OK;
}

hada_status hada_tiff_write(hada_tiff_writer *w, const hada_image *image, hada_error *err)
{
    return write_frame(w, image, 0, err);
}

hada_status hada_tiff_write_light(hada_tiff_writer *w, const hada_image *image, hada_error *err)
{
    return write_frame(w, image, w->options.encoding != 0.0 && w->options.encoding != HADA_RESPONSE_LINEAR, err);
}

/* The head and the directories of a hyperstack, now that the range of its values is known. */
static hada_status finish_stack(hada_tiff_writer *w, hada_error *err)
{
    double range[2] = {0, 1};
    for (int i = 0; i < 2 && w->low <= w->high; i++) {
        double full = w->options.bits == 8 ? 255 : 65535;
        range[i] = (double)(i ? w->high : w->low);
        if (w->options.bits < 32)
            range[i] = floor(fmin(fmax(range[i] / w->options.scale, 0), 1) * full + 0.5);
    }
    hada_tiff_text_free(&w->text);
    HADA_TRY(hada_tiff_text_build(&w->text, w->channels, w->rows, w->cols, &w->options, range, err));
    return hada_stack_layout_write(&w->stack, &w->text, &w->file, err);
}

hada_status hada_tiff_finish(hada_tiff_writer **writer, hada_error *err)
{
    HADA_NEED(writer && *writer, err);
    hada_tiff_writer *w = *writer;
    hada_status status = HADA_OK;
    int expected = w->options.layout == HADA_TIFF_HYPERSTACK ? w->options.slices * w->options.times : 1;
    if (w->frames < expected)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_STATE, "%s: %d of %d frames were written; nothing was left behind",
                                   w->file.path, w->frames, expected));
    if (!w->tif) {
        HADA_TRY_OR_DONE(finish_stack(w, err));
    } else {
        w->handle.message[0] = 0;
        TIFFClose(w->tif); /* reports nothing: the handle does */
        w->tif = NULL;
        if (*w->handle.message || w->handle.write_code)
            HADA_TRY_OR_DONE(failed(w, err));
    }
    HADA_TRY_OR_DONE(hada_outfile_commit(&w->file, err));
done:
    hada_tiff_abandon(writer);
    return status;
}

void hada_tiff_abandon(hada_tiff_writer **writer)
{
    hada_tiff_writer *w = hada_taken(writer);
    if (!w)
        return;
    if (w->tif)
        TIFFClose(w->tif);
    hada_outfile_abandon(&w->file);
    hada_tiff_text_free(&w->text);
    HADA_FREE(w->distances, w->description, w->strip, w->encoded, w);
}

hada_status hada_tiff_save(const char *path, const hada_image *image, const hada_tiff_write_options *options,
                           hada_error *err)
{
    HADA_NEED(path, err);
    HADA_NEED_IMAGE(image, NULL, err);
    hada_status status = HADA_OK;
    hada_tiff_writer *writer = NULL;
    HADA_TRY_OR_DONE(hada_tiff_create(&writer, path, image->channels, image->rows, image->cols, options, err));
    HADA_TRY_OR_DONE(hada_tiff_write(writer, image, err));
    HADA_TRY_OR_DONE(hada_tiff_finish(&writer, err));
done:
    hada_tiff_abandon(&writer);
    return status;
}

enum { MOST_ENTRIES = 20 };

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

/* Lays the directory out at `to`, for the offset `at` of the file; `next` is the link to the one after it. */
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
    uint64_t tail = (layout->data_at + layout->images * layout->image_bytes + 7) / 8 * 8;
    hada_directory d;
    fill(&d, layout, text, 0);
    void *head;
    HADA_TRY_OR_DONE(hada_allocated(head = hada_alloc((size_t)layout->data_at, 1, "the head of a TIFF file", err)));
    unsigned char *at = head;
    at[0] = at[1] = HADA_LITTLE_ENDIAN ? 'I' : 'M';
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
