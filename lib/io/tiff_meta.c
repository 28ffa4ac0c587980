#include "io/tiff_meta.h"

#include <hadalens/response.h>
#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

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

/* Micrometres in a unit as ImageJ and OME write it; 0 for pixels and what is not known. */
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

/* The value of an attribute of the element that begins at `element`, NULL where it has none. */
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
    int *linear = malloc((size_t)stack->images * 2 * sizeof *linear);
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
        /* blocks that place a plane again and again are not of a sound file, and could go on for hours */
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
