#include "io/tiff_meta.h"

#include <hadalens/response.h>
#include <limits.h>

#include "io/text.h"

const char *hada_text_line(const char *text, const char *key)
{
    size_t length = strlen(key);
    for (const char *line = text; line && *line; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (!strncmp(line, key, length) && line[length] == '=')
            return line + length + 1;
    }
    return NULL;
}

double hada_text_response(const char *text, const char *key)
{
    const char *value = hada_text_line(text, key);
    char name[HADA_RESPONSE_NAME] = "";
    double response;
    const size_t length = value ? strcspn(value, "\r\n") : 0;
    if (!length || length >= sizeof name)
        return 0.0;
    memcpy(name, value, length);
    return hada_response_from_name(&response, name, NULL) || !hada_response_is_known(response) ? 0.0 : response;
}

static int line_count(const char *text, const char *key, int otherwise)
{
    const char *value = hada_text_line(text, key), *end;
    double number = value ? hada_text_number(value, &end) : otherwise;
    return number >= 1 && number <= INT_MAX / 2 ? (int)number : otherwise;
}

/* Micrometres in a unit as ImageJ and OME write it; 0 for pixels and unknown units. */
static double unit_size(const char *name)
{
    static const struct {
        const char *name;
        double um;
    } units[] = {{"micron", 1},   {"microns", 1},  {"um", 1},      {"\xc2\xb5m", 1},  {"\xce\xbcm", 1}, {"\xb5m", 1},
                 {"\\u00B5m", 1}, {"&#181;m", 1},  {"&#xb5;m", 1}, {"nm", 1e-3},      {"mm", 1e3},      {"cm", 1e4},
                 {"m", 1e6},      {"inch", 25400}, {"in", 25400},  {"\xc3\x85", 1e-4}};
    for (size_t i = 0; i < sizeof units / sizeof units[0]; i++) {
        size_t length = strlen(units[i].name);
        if (!strncmp(name, units[i].name, length) && strchr("\r\n\"", name[length]))
            return units[i].um;
    }
    return 0;
}

static void parse_imagej(hada_tiff_stack *stack, const char *text)
{
    stack->imagej = 1;
    stack->images = line_count(text, "images", 1);
    stack->channels = line_count(text, "channels", 1);
    stack->times = line_count(text, "frames", 1);
    stack->slices = line_count(text, "slices", 0);
    if (!stack->slices) {
        double others = (double)stack->channels * stack->times;
        stack->slices = stack->images >= others ? (int)(stack->images / others) : 1;
    }
    stack->known = (double)stack->channels * stack->slices * stack->times == stack->images;
    /* Channels run fastest, then slices, then times. */
    stack->channel_step = 1;
    stack->slice_step = stack->channels;
    stack->time_step = stack->known ? stack->channels * stack->slices : 0;
    const char *unit = hada_text_line(text, "unit"), *depth_unit = hada_text_line(text, "zunit"),
               *spacing = hada_text_line(text, "spacing"), *end;
    stack->unit_um = unit ? unit_size(unit) : 0;
    double depth_um = depth_unit ? unit_size(depth_unit) : stack->unit_um;
    stack->spacing_um = spacing ? fabs(hada_text_number(spacing, &end)) * depth_um : 0;
}

/* The value of an attribute of the element that begins at `element`, NULL if it has none. */
static const char *attribute(const char *element, const char *name)
{
    /* up to the next element, or a text of many that do not end would be gone through for each */
    const size_t length = strlen(name), whole = 1 + strcspn(element + 1, "<>");
    if (element[whole] != '>')
        return NULL;
    for (size_t at = 1; at + length + 2 <= whole; at++)
        if (element[at] == *name && !strncmp(element + at, name, length) && strchr(" \t\r\n", element[at - 1]) &&
            element[at + length] == '=' && (element[at + length + 1] == '"' || element[at + length + 1] == '\''))
            return element + at + length + 2;
    return NULL;
}

static int attribute_count(const char *element, const char *name, int otherwise)
{
    const char *value = attribute(element, name), *end;
    double number = value ? hada_text_number(value, &end) : otherwise;
    return number >= 0 && number <= INT_MAX / 2 ? (int)number : otherwise;
}

static double attribute_um(const char *element, const char *name, const char *unit_name)
{
    const char *value = attribute(element, name), *unit = attribute(element, unit_name), *end;
    return value ? hada_text_number(value, &end) * (unit ? unit_size(unit) : 1) : 0;
}

/* Blocks of planes that the file places explicitly. Planes advance in the declared order from where a block begins. */
static hada_status place_planes(hada_tiff_stack *stack, const char *pixels, int samples, hada_error *err)
{
    const char *end = strstr(pixels, "</Pixels>"), *block = strstr(pixels, "<TiffData");
    if (!block || (end && block > end))
        return HADA_OK;
    int *linear = calloc((size_t)stack->images * 2, sizeof *linear);
    if (!linear)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the order of %d pages", stack->images);
    stack->pages = linear + stack->images; /* kept at the front below */
    for (int i = 0; i < 2 * stack->images; i++)
        linear[i] = -1;
    int page = 0, sound = 1, placed = 0;
    for (; block && (!end || block < end); block = strstr(block + 1, "<TiffData")) {
        int64_t first = (int64_t)(attribute_count(block, "FirstC", 0) / samples) * stack->channel_step +
                        (int64_t)attribute_count(block, "FirstZ", 0) * stack->slice_step +
                        (int64_t)attribute_count(block, "FirstT", 0) * stack->time_step;
        int has_page = attribute(block, "IFD") != NULL;
        page = attribute_count(block, "IFD", page);
        int planes = attribute_count(block, "PlaneCount", has_page ? 1 : stack->images);
        for (int i = 0; i < planes && first >= 0 && first < stack->images && page < stack->images; i++, placed++)
            linear[first++] = page++;
        /* blocks that place a plane again and again occur in hostile files only, and could take hours */
        sound &= placed <= stack->images;
        if (!sound)
            break;
    }
    for (int i = 0; i < stack->images; i++)
        sound &= linear[i] >= 0;
    if (sound) {
        int *to = stack->pages;
        for (int t = 0; t < stack->times; t++)
            for (int z = 0; z < stack->slices; z++)
                for (int c = 0; c < stack->channels; c++)
                    *to++ = linear[c * stack->channel_step + z * stack->slice_step + t * stack->time_step];
        memmove(linear, stack->pages, (size_t)stack->images * sizeof *linear);
    }
    stack->pages = linear;
    if (!sound) {
        free(linear);
        stack->pages = NULL;
        stack->known = 0;
    }
    return HADA_OK;
}

static hada_status parse_ome(hada_tiff_stack *stack, const char *text, size_t pages, hada_error *err)
{
    const char *pixels = strstr(text, "<Pixels");
    const char *order = pixels ? attribute(pixels, "DimensionOrder") : NULL;
    if (!order || strncmp(order, "XY", 2))
        return HADA_OK;
    const char *channel = strstr(pixels, "<Channel");
    int samples = channel ? attribute_count(channel, "SamplesPerPixel", 1) : 1;
    samples = samples < 1 ? 1 : samples;
    stack->channels = attribute_count(pixels, "SizeC", 1) / samples;
    stack->slices = attribute_count(pixels, "SizeZ", 1);
    stack->times = attribute_count(pixels, "SizeT", 1);
    double images = (double)stack->channels * stack->slices * stack->times;
    if (images < 1 || images != (double)pages || images > INT_MAX)
        return HADA_OK;
    stack->images = (int)images;
    int step = 1;
    for (int i = 2; i < 5; i++) {
        if (order[i] == 'C' && !stack->channel_step) {
            stack->channel_step = step;
            step *= stack->channels;
        } else if (order[i] == 'Z' && !stack->slice_step) {
            stack->slice_step = step;
            step *= stack->slices;
        } else if (order[i] == 'T' && !stack->time_step) {
            stack->time_step = step;
            step *= stack->times;
        } else {
            return HADA_OK;
        }
    }
    stack->known = 1;
    stack->width_um = attribute_um(pixels, "PhysicalSizeX", "PhysicalSizeXUnit");
    stack->height_um = attribute_um(pixels, "PhysicalSizeY", "PhysicalSizeYUnit");
    stack->spacing_um = attribute_um(pixels, "PhysicalSizeZ", "PhysicalSizeZUnit");
    return place_planes(stack, pixels, samples, err);
}

hada_status hada_tiff_stack_parse(hada_tiff_stack *stack, const char *text, size_t pages, hada_error *err)
{
    *stack = (hada_tiff_stack){.images = 1, .channels = 1, .slices = 1, .times = 1};
    hada_status status = HADA_OK;
    if (!strncmp(text, "ImageJ=", 7)) {
        parse_imagej(stack, text);
    } else if (strstr(text, "<OME") || strstr(text, "<ome:OME")) {
        stack->channel_step = stack->slice_step = stack->time_step = 0;
        status = parse_ome(stack, text, pages, err);
    }
    return status;
}

void hada_tiff_stack_free(hada_tiff_stack *stack)
{
    free(stack->pages);
    *stack = (hada_tiff_stack){0};
}

/* Beyond this, labels and planes would outweigh small images. */
#define MOST_LABELS 20000

static const char *channel_name(int channels, int channel)
{
    static const char *const names[] = {"red", "green", "blue"};
    return channels == 3 ? names[channel] : "intensity";
}

/* Mean distance between slices; ImageJ and OME's PhysicalSizeZ know equal steps only. */
static double mean_step(const hada_tiff_write_options *options)
{
    int slices = options->slices;
    return options->distances_mm && slices > 1
               ? fabs(options->distances_mm[slices - 1] - options->distances_mm[0]) / (slices - 1)
               : 0;
}

static void add_imagej(hada_text *text, int channels, const hada_tiff_write_options *options, const double *range)
{
    int images = channels * options->slices * options->times;
    /* The version makes ImageJ read spacing and units the present way. */
    hada_text_add(text, "ImageJ=1.53t\nimages=%d\nchannels=%d\nslices=%d\n", images, channels, options->slices);
    if (options->times > 1)
        hada_text_add(text, "frames=%d\n", options->times);
    hada_text_add(text, "hyperstack=true\nmode=%s\nloop=false\n", channels > 1 ? "composite" : "grayscale");
    double step = mean_step(options);
    /* Without the pixel's size only the depth axis has a unit. */
    hada_text_add(text, "unit=%s\n", options->pixel_um > 0 ? "mm" : "pixel");
    if (step > 0) {
        if (options->pixel_um <= 0)
            hada_text_add(text, "zunit=mm\n");
        hada_text_add(text, "spacing=");
        hada_text_add_number(text, step);
        hada_text_add(text, "\n");
    }
    if (range) {
        char low[40], high[40];
        hada_format_number(low, sizeof low, "%.9e", range[0]);
        hada_format_number(high, sizeof high, "%.9e", range[1]);
        hada_text_add(text, "min=%16s\nmax=%16s\n", low, high);
    }
}

static void add_own(hada_text *text, int distances, const hada_tiff_write_options *options)
{
    hada_text_add(text, "Hadalens=%s\n", HADALENS_VERSION);
    if (options->distances_mm) {
        hada_text_add(text, "distances_mm=");
        for (int i = 0; i < distances; i++) {
            hada_text_add(text, "%s", i ? "," : "");
            hada_text_add_number(text, options->distances_mm[i]);
        }
        hada_text_add(text, "\n");
    }
    if (options->bits < 32) {
        hada_text_add(text, "value_scale=");
        hada_text_add_number(text, options->scale);
        hada_text_add(text, "\nfull_scale=%d\n", options->bits == 8 ? 255 : 65535);
    }
    if (options->encoding != 0.0) {
        char name[HADA_RESPONSE_NAME];
        hada_response_name(name, options->encoding);
        hada_text_add(text, "encoding=%s\n", name);
    }
    if (options->description)
        hada_text_add(text, "%s", options->description);
}

static void add_attribute(hada_text *text, const char *name, double value, const char *unit)
{
    hada_text_add(text, " %s=\"", name);
    hada_text_add_number(text, value);
    hada_text_add(text, "\" %sUnit=\"%s\"", name, unit);
}

static void add_ome(hada_text *text, int channels, int rows, int cols, const hada_tiff_write_options *options)
{
    static const char *const colours[] = {"-16776961", "16711935", "65535"};
    const char *type = options->bits == 8 ? "uint8" : options->bits == 16 ? "uint16" : "float";
    hada_text_add(text,
                  "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
                  "<OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" "
                  "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
                  "xsi:schemaLocation=\"http://www.openmicroscopy.org/Schemas/OME/2016-06 "
                  "http://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd\" Creator=\"Hadalens %s\">\n"
                  " <Image ID=\"Image:0\">\n",
                  HADALENS_VERSION);
    hada_text_add(
        text,
        "  <Pixels ID=\"Pixels:0\" DimensionOrder=\"XYCZT\" Type=\"%s\" SizeX=\"%d\" SizeY=\"%d\" SizeC=\"%d\" "
        "SizeZ=\"%d\" SizeT=\"%d\"",
        type, cols, rows, channels, options->slices, options->times);
    if (options->pixel_um > 0) {
        add_attribute(text, "PhysicalSizeX", options->pixel_um, "\xc2\xb5m");
        add_attribute(text, "PhysicalSizeY", options->pixel_um, "\xc2\xb5m");
    }
    if (mean_step(options) > 0)
        add_attribute(text, "PhysicalSizeZ", mean_step(options), "mm");
    hada_text_add(text, ">\n");
    for (int c = 0; c < channels; c++) {
        hada_text_add(text, "   <Channel ID=\"Channel:0:%d\" Name=\"%s\" SamplesPerPixel=\"1\"", c,
                      channel_name(channels, c));
        if (channels == 3)
            hada_text_add(text, " Color=\"%s\"", colours[c]);
        hada_text_add(text, "/>\n");
    }
    hada_text_add(text, "   <TiffData IFD=\"0\" PlaneCount=\"%d\"/>\n", channels * options->slices * options->times);
    for (int t = 0; options->distances_mm && t < options->times; t++)
        for (int z = 0; z < options->slices; z++)
            for (int c = 0; c < channels; c++) {
                hada_text_add(text, "   <Plane TheZ=\"%d\" TheT=\"%d\" TheC=\"%d\"", z, t, c);
                add_attribute(text, "PositionZ", options->distances_mm[z], "mm");
                hada_text_add(text, "/>\n");
            }
    hada_text_add(text, "  </Pixels>\n </Image>\n</OME>\n");
}

/* ImageJ's private metadata: a header of (type, count) pairs, then the parts; texts are UTF-16. All in the machine's
 * byte order, which is the file's. */
typedef struct hada_parts {
    unsigned char *data;
    uint32_t *counts;
    size_t bytes, room;
    uint32_t count;
} hada_parts;

static void put(hada_parts *parts, const void *data, size_t bytes)
{
    if (parts->data && parts->bytes <= parts->room && bytes <= parts->room - parts->bytes)
        memcpy(parts->data + parts->bytes, data, bytes);
    parts->bytes += bytes;
}

static void put_number(hada_parts *parts, uint32_t number)
{
    put(parts, &number, sizeof number);
}

/* UTF-8 (at most two bytes a character is used here) as one UTF-16 part. */
static void put_text(hada_parts *parts, const char *text)
{
    size_t before = parts->bytes;
    for (const unsigned char *at = (const unsigned char *)text; *at; at++) {
        uint16_t unit = *at;
        if (*at >= 0xc0 && at[1]) {
            unit = (uint16_t)((at[0] & 0x1f) << 6 | (at[1] & 0x3f));
            at++;
        }
        put(parts, &unit, sizeof unit);
    }
    if (parts->counts)
        parts->counts[parts->count] = (uint32_t)(parts->bytes - before);
    parts->count++;
}

static void put_labels(hada_parts *parts, int channels, const hada_tiff_write_options *options)
{
    for (int t = 0; t < options->times; t++)
        for (int z = 0; z < options->slices; z++)
            for (int c = 0; c < channels; c++) {
                char number[40], label[80];
                hada_format_number(number, sizeof number, "%.6g", options->distances_mm[z]);
                snprintf(label, sizeof label, "%s mm%s%s", number, channels > 1 ? " " : "",
                         channels > 1 ? channel_name(channels, c) : "");
                put_text(parts, label);
            }
}

/* One pass measures (data == NULL), the next fills. */
static void put_all(hada_parts *parts, int channels, const char *info, const hada_tiff_write_options *options,
                    const double *range)
{
    uint32_t labels = options->distances_mm ? (uint32_t)(channels * options->slices * options->times) : 0;
    put_number(parts, 0x494a494a);
    const uint32_t kinds[][2] = {
        {0x696e666f, 1}, {0x6c61626c, labels}, {0x72616e67, range ? 1 : 0}}; /* info, labl, rang */
    for (int i = 0; i < 3; i++)
        if (kinds[i][1]) {
            put_number(parts, kinds[i][0]);
            put_number(parts, kinds[i][1]);
        }
    if (parts->counts)
        parts->counts[0] = (uint32_t)parts->bytes;
    parts->count = 1;
    put_text(parts, info);
    if (labels)
        put_labels(parts, channels, options);
    size_t before = parts->bytes;
    for (int c = 0; c < channels && range; c++)
        put(parts, range, 2 * sizeof *range);
    if (parts->counts && range)
        parts->counts[parts->count] = (uint32_t)(parts->bytes - before);
    parts->count += range != NULL;
}

static hada_status build_extra(hada_tiff_text *text, int channels, int rows, int cols,
                               const hada_tiff_write_options *options, const double *range, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_text info = {0};
    hada_parts parts = {0};
    void *data = NULL, *counts = NULL;
    add_ome(&info, channels, rows, cols, options);
    if (info.failed)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory for the metadata"));
    put_all(&parts, channels, info.data, options, range);
    HADA_TRY_OR_DONE(hada_allocated(data = hada_alloc(parts.bytes, 1, "the metadata", err)));
    text->extra = data;
    HADA_TRY_OR_DONE(hada_allocated(counts = hada_alloc(parts.count, sizeof(uint32_t), "the metadata", err)));
    text->counts = counts;
    parts = (hada_parts){data, counts, 0, parts.bytes, 0};
    put_all(&parts, channels, info.data, options, range);
    text->extra_bytes = parts.bytes;
    text->count = parts.count;
done:
    free(info.data);
    return status;
}

hada_status hada_tiff_text_build(hada_tiff_text *text, int channels, int rows, int cols,
                                 const hada_tiff_write_options *options, const double *range, hada_error *err)
{
    *text = (hada_tiff_text){0};
    hada_text lines = {0};
    int stack = options->layout == HADA_TIFF_HYPERSTACK;
    if (stack)
        add_imagej(&lines, channels, options, range);
    add_own(&lines, options->slices, options);
    text->description = lines.data;
    if (lines.failed) {
        hada_tiff_text_free(text);
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the metadata");
    }
    hada_status status = HADA_OK;
    if (stack && (double)channels * options->slices * options->times <= MOST_LABELS)
        status = build_extra(text, channels, rows, cols, options, range, err);
    if (status)
        hada_tiff_text_free(text);
    return status;
}

void hada_tiff_text_free(hada_tiff_text *text)
{
    HADA_FREE(text->description, text->extra, text->counts);
    *text = (hada_tiff_text){0};
}
