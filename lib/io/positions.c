/* Lists of pictures that were taken at positions of the field. */
#include "io/positions.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/input.h"
#include "io/folder.h"
#include "io/text.h"

/* Of a list, at most. */
#define BYTES ((size_t)1 << 24)

static const char *const separators = " \t\r,;";

/* A line `file,x,y[,distance]` in place; *good 0: it is none. */
static hada_status read_line(hada_positions *of, char *line, const char *folder, int *good, hada_error *err)
{
    double number[3] = {0.0, 0.0, -1.0};
    int numbers = 0;
    char *end = line + strcspn(line, separators), *at = end + strspn(end, separators);
    const int last = !*end;
    *end = '\0';
    *good = 0;
    while (!last && *at && numbers < 3) {
        const char *after;
        number[numbers++] = hada_text_number(at, &after);
        after += strncmp(after, "mm", 2) ? 0 : 2;
        if (after == at || (*after && !strchr(separators, *after)))
            return HADA_OK;
        at = (char *)(uintptr_t)after + strspn(after, separators);
    }
    if (numbers < 2 || (!last && *at) || !isfinite(number[0]) || !isfinite(number[1]) ||
        (numbers == 3 && !(number[2] >= 0.0 && isfinite(number[2]))))
        return HADA_OK;
    HADA_TRY(HADA_GROW(of->list, (size_t)of->count, 1, "the positions of point spread functions", err));
    hada_position *more = &of->list[of->count];
    *more = (hada_position){.x = number[0], .y = number[1], .distance = number[2], .place = of->count};
    HADA_TRY(hada_path_format(&more->path, err, *line == '/' ? "%s%s" : "%s/%s", *line == '/' ? "" : folder, line));
    of->count++;
    *good = 1;
    return HADA_OK;
}

/* The first line may be a heading. */
static hada_status read_lines(hada_positions *of, const char *list, hada_error *err)
{
    const char *slash = strrchr(list, '/');
    char *text = NULL, *folder = NULL;
    size_t bytes;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_path_format(&folder, err, "%.*s", slash ? (int)(slash - list) : 1, slash ? list : "."));
    HADA_TRY_OR_DONE(hada_named(hada_input_read(&text, &bytes, list, BYTES, NULL, err), list, err));
    int number = 0, lines = 0, good;
    for (char *line = text, *next; line && *line; line = next) {
        next = strchr(line, '\n');
        if (next)
            *next++ = '\0';
        number++;
        line += strspn(line, separators);
        if (!*line || *line == '#')
            continue;
        HADA_TRY_OR_DONE(read_line(of, line, folder, &good, err));
        if (!good && lines++)
            HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_FORMAT,
                                       "%s: line %d is not 'file,x_px,y_px' or 'file,x_px,y_px,distance_mm'", list,
                                       number));
        lines += good;
    }
    if (!of->count)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_FILE_FORMAT,
                                   "%s names no point spread functions: its lines are 'file,x_px,y_px[,distance_mm]'",
                                   list));
done:
    HADA_FREE(text, folder);
    return status;
}

static int by_distance(const void *a, const void *b)
{
    const hada_position *one = a, *two = b;
    const int order = (one->distance > two->distance) - (one->distance < two->distance);
    return order ? order : one->place - two->place;
}

/* How many depths and positions there are: files of each distance, or as many pages in each file. */
static hada_status sort_lines(hada_positions *of, const char *list, hada_error *err)
{
    int said = 0;
    for (int i = 0; i < of->count; i++)
        said += of->list[i].distance >= 0.0;
    if (said && said < of->count)
        return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                         "%s: some lines say a distance and some do not; say it in all of them, or in none and let the "
                         "pages of each file be depths",
                         list);
    if (!said)
        return HADA_OK;
    qsort(of->list, (size_t)of->count, sizeof *of->list, by_distance);
    for (int i = 0, first = 0, each = 0; i < of->count; i++) {
        if (i + 1 < of->count && of->list[i + 1].distance == of->list[i].distance)
            continue;
        if (of->depths++ && i + 1 - first != each)
            return hada_fail(err, HADA_ERROR_FILE_FORMAT,
                             "%s: %d positions at %g mm and %d at others; every distance has as many", list,
                             i + 1 - first, of->list[i].distance, each);
        each = i + 1 - first;
        first = i + 1;
    }
    return HADA_OK;
}

hada_status hada_positions_read(hada_positions *out, const char *path, hada_error *err)
{
    hada_status status = HADA_OK;
    *out = (hada_positions){0};
    HADA_TRY_OR_DONE(read_lines(out, path, err));
    HADA_TRY_OR_DONE(sort_lines(out, path, err));
done:
    if (status)
        hada_positions_free(out);
    return status;
}

void hada_positions_free(hada_positions *positions)
{
    for (int i = 0; i < positions->count; i++)
        free(positions->list[i].path);
    free(positions->list);
    *positions = (hada_positions){0};
}
