#include "folder.h"

#include <dirent.h>
#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

char *hada_cli_text(const char *format, ...)
{
    char *text = NULL;
    va_list arguments;
    va_start(arguments, format);
    int length = vasprintf(&text, format, arguments);
    va_end(arguments);
    return length < 0 ? NULL : text;
}

char *hada_cli_stem(const char *path)
{
    const char *slash = strrchr(path, '/');
    const char *base = slash ? slash + 1 : path;
    const char *dot = strrchr(base, '.');
    return strndup(base, dot && dot > base ? (size_t)(dot - base) : strlen(base));
}

static int by_name(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static int is_tiff(const char *name)
{
    const char *dot = strrchr(name, '.');
    return name[0] != '.' && dot && (!strcasecmp(dot, ".tif") || !strcasecmp(dot, ".tiff"));
}

hada_status hada_cli_list_tiffs(const char *folder, char ***names, int *count, hada_error *err)
{
    *names = NULL;
    *count = 0;
    DIR *open = opendir(folder);
    if (!open)
        return hada_cli_error(err, HADA_ERROR_FILE_OPEN, "the folder %s cannot be read: %s", folder, strerror(errno));
    struct dirent *entry;
    int room = 0, failed = 0;
    while (!failed && (entry = readdir(open))) {
        if (!is_tiff(entry->d_name))
            continue;
        if (*count == room) {
            room = room ? 2 * room : 32;
            char **more = realloc(*names, (size_t)room * sizeof *more);
            failed = !more;
            *names = more ? more : *names;
        }
        if (!failed && !((*names)[(*count)++] = strdup(entry->d_name)))
            failed = 1;
    }
    closedir(open);
    if (failed) {
        hada_cli_free_names(names, count);
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    }
    if (*count)
        qsort(*names, (size_t)*count, sizeof **names, by_name);
    return HADA_OK;
}

void hada_cli_free_names(char ***names, int *count)
{
    for (int i = 0; i < *count; i++)
        free((*names)[i]);
    free(*names);
    *names = NULL;
    *count = 0;
}
