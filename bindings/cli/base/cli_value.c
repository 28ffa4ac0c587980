#include "option.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The program never calls setlocale, so strtod reads a point everywhere. */
int hada_cli_read_real(const char *text, double *value)
{
    char *end;
    double read = strtod(text, &end);
    if (end == text || *end || !isfinite(read))
        return 0;
    *value = read;
    return 1;
}

int hada_cli_read_count(const char *text, int *value)
{
    char *end;
    if (*text < '0' || *text > '9')
        return 0;
    long read = strtol(text, &end, 10);
    if (*end || read > 1000000)
        return 0;
    *value = (int)read;
    return 1;
}

int hada_cli_read_size(const char *text, int size[2])
{
    char *end;
    if (*text < '0' || *text > '9')
        return 0;
    long rows = strtol(text, &end, 10);
    if ((*end != 'x' && *end != 'X') || end[1] < '0' || end[1] > '9')
        return 0;
    long cols = strtol(end + 1, &end, 10);
    if (*end || rows < 1 || cols < 1 || rows > 65535 || cols > 65535)
        return 0;
    size[0] = (int)rows;
    size[1] = (int)cols;
    return 1;
}

static hada_status no_such_depth(const char *option, const char *text, const double *distances_mm, int count,
                                 hada_error *err)
{
    return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                          "--%s: cannot use '%s'. Give slices counted from 1 (near), such as 1,3-5, or distances such "
                          "as %gmm. The model has %d %s from %g to %g mm",
                          option, text, distances_mm[0], count, count == 1 ? "depth" : "depths", distances_mm[0],
                          distances_mm[count - 1]);
}

/* One item of a list at *text: marks its depths and moves on. 0 when it cannot be read. */
static int mark(const char **text, const double *distances_mm, int count, char *wanted)
{
    char *end;
    double first = strtod(*text, &end);
    if (end == *text || !isfinite(first))
        return 0;
    if (!strncmp(end, "mm", 2)) {
        int best = 0;
        for (int z = 1; z < count; z++)
            if (fabs(distances_mm[z] - first) < fabs(distances_mm[best] - first))
                best = z;
        if (fabs(distances_mm[best] - first) > 0.01 * fabs(first))
            return 0;
        wanted[best] = 1;
        *text = end + 2;
        return 1;
    }
    double last = first;
    if (*end == '-') {
        const char *from = end + 1;
        last = strtod(from, &end);
        if (end == from)
            return 0;
    }
    if (first != floor(first) || last != floor(last) || first < 1 || last < first || last > count)
        return 0;
    for (int z = (int)first; z <= (int)last; z++)
        wanted[z - 1] = 1;
    *text = end;
    return 1;
}

hada_status hada_cli_read_depths(const char *option, const char *text, const double *distances_mm, int count, int *out,
                                 int *found, hada_error *err)
{
    char *wanted = hada_cli_memory((size_t)count, 1);
    const char *rest = text;
    int good = 1;
    do {
        good = mark(&rest, distances_mm, count, wanted) && (*rest == ',' || !*rest);
    } while (good && *rest++ == ',');
    *found = 0;
    for (int z = 0; good && z < count; z++)
        if (wanted[z])
            out[(*found)++] = z;
    free(wanted);
    return good ? HADA_OK : no_such_depth(option, text, distances_mm, count, err);
}

hada_status hada_cli_read_colours(const char *text, double matrix[9], int *find, hada_error *err)
{
    const char *rest = text;
    char *end;
    *find = !text || !strcmp(text, "auto");
    if (*find || !strcmp(text, "none"))
        return HADA_OK;
    for (int i = 0; rest && i < 9; i++) {
        matrix[i] = strtod(rest, &end);
        rest = end != rest && *end == (i < 8 ? ',' : '\0') ? end + (i < 8) : NULL;
    }
    return rest ? HADA_OK
                : hada_cli_error(err, HADA_ERROR_ARGUMENT,
                                 "--colour-matrix takes auto, none, or nine numbers: what the sensor's red, green and "
                                 "blue see of the scenes', such as 0.8,0.2,0,0.1,0.7,0.2,0,0.3,0.7, not '%s'",
                                 text);
}

hada_status hada_cli_read_distances(const char *option, const char *text, double *out, int capacity, int *found,
                                    hada_error *err)
{
    const char *rest = text;
    char *end;
    double start, step;
    int count, read = 0;
    *found = 0;
    if (text && sscanf(text, "%lf:%lf:%d%n", &start, &step, &count, &read) == 3 && !text[read] && start > 0 &&
        step > 0 && isfinite(start + count * step) && count > 0 && count <= capacity) {
        for (; *found < count; ++*found)
            out[*found] = start + *found * step;
        return HADA_OK;
    }
    while (rest) {
        double value = strtod(rest, &end);
        if (end == rest || !isfinite(value) || value <= 0 || *found == capacity ||
            (*found > 0 && value <= out[*found - 1]))
            break;
        out[(*found)++] = value;
        rest = end + (strncmp(end, "mm", 2) ? 0 : 2);
        if (*rest && *rest != ',')
            break;
        rest = *rest ? rest + 1 : NULL;
    }
    if (!rest)
        return HADA_OK;
    return hada_cli_error(
        err, HADA_ERROR_ARGUMENT,
        "--%s takes distances in millimetres from near to far, such as 100,250.5,600 or, from 2 on, 0.05 apart, "
        "2:0.05:40, not '%s'",
        option, text);
}
