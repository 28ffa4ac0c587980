/* Which device the user's words mean. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "runtime/platform.h"

static int contains(const char *text, const char *part)
{
    size_t n = strlen(part);
    for (; *text; text++) {
        size_t i = 0;
        while (i < n && text[i] && tolower((unsigned char)text[i]) == tolower((unsigned char)part[i]))
            i++;
        if (i == n)
            return 1;
    }
    return 0;
}

static int first_of_kind(const hada_device_info *infos, size_t count, hada_device_kind kind, size_t *out)
{
    for (size_t i = 0; i < count; i++)
        if (infos[i].kind == kind) {
            *out = i;
            return 1;
        }
    return 0;
}

static hada_status unknown_device(const hada_device_info *infos, size_t count, const char *words, hada_error *err)
{
    char list[700] = "";
    size_t used = 0;
    for (size_t i = 0; i < count && used < sizeof list; i++) {
        int n = snprintf(list + used, sizeof list - used, "%s%zu (%s, %s)", i ? "; " : "", i,
                         hada_device_kind_name(infos[i].kind), infos[i].name);
        used += n > 0 ? (size_t)n : 0;
    }
    return hada_fail(err, HADA_ERROR_DEVICE_CHOICE,
                     "no device matches '%s'; give an index, cpu, gpu, accelerator, or a part of a name. There are: %s",
                     words, list);
}

hada_status hada_device_choose(const hada_device_info *infos, size_t count, const char *words, int have_binaries,
                               size_t *out, hada_error *err)
{
    if (!words || !*words) {
        if (first_of_kind(infos, count, HADA_DEVICE_GPU, out) ||
            (have_binaries && first_of_kind(infos, count, HADA_DEVICE_ACCELERATOR, out)) ||
            first_of_kind(infos, count, HADA_DEVICE_CPU, out))
            return HADA_OK;
        *out = 0;
        return HADA_OK;
    }
    char *end;
    long index = strtol(words, &end, 10);
    if (!*end) {
        if (index < 0 || (size_t)index >= count)
            return unknown_device(infos, count, words, err);
        *out = (size_t)index;
        return HADA_OK;
    }
    for (int kind = HADA_DEVICE_CPU; kind <= HADA_DEVICE_OTHER; kind++)
        if (strlen(words) == strlen(hada_device_kind_name((hada_device_kind)kind)) &&
            contains(words, hada_device_kind_name((hada_device_kind)kind)))
            return first_of_kind(infos, count, (hada_device_kind)kind, out) ? HADA_OK
                                                                            : unknown_device(infos, count, words, err);
    for (size_t i = 0; i < count; i++)
        if (contains(infos[i].name, words) || contains(infos[i].platform, words) || contains(infos[i].vendor, words)) {
            *out = i;
            return HADA_OK;
        }
    return unknown_device(infos, count, words, err);
}
