/* What is done differently on which device, and why: data, in one place. Rows add up; a row applies when each of its
 * words stands in the device's platform, name or vendor and its kind fits. */
#include <stdio.h>
#include <string.h>

#include "runtime/platform.h"

typedef struct quirk_row {
    const char *platform, *name; /* NULL: any */
    int kind;                    /* hada_device_kind, 0: any */
    hada_quirks set;
    const char *reason;
} quirk_row;

static const quirk_row rows[] = {
    {NULL,
     NULL,
     HADA_DEVICE_CPU,
     {.host_pages = 1},
     "buffers in huge-page host memory: large transforms run up to 1.6 times faster"},
    {"Portable Computing Language",
     NULL,
     0,
     {.own_disk_cache = 1},
     "PoCL caches what it compiles itself, and compiles all again for a binary: our disk cache stays off"},
    {"NVIDIA",
     NULL,
     HADA_DEVICE_GPU,
     {.own_disk_cache = 1},
     "the driver caches programs itself and its binary is PTX: our disk cache stays off"},
    {"Oclgrind",
     NULL,
     0,
     {.avoid_clfft = 1, .own_disk_cache = 1},
     "clFFT shows formal races under Oclgrind and its binaries are not kept: own transforms, no cache"},
    {"rusticl", NULL, 0, {.avoid_clfft = 1}, "own transforms: clFFT is not tested on Mesa"},
    {"Clover", NULL, 0, {.avoid_clfft = 1}, "own transforms: clFFT is not tested on Mesa"},
    {NULL,
     NULL,
     HADA_DEVICE_ACCELERATOR,
     {.avoid_clfft = 1, .stated_local = 1},
     "clFFT writes source at run time, which an FPGA cannot compile: own transforms; compilers for FPGAs lay local memory "
     "out: 64 KiB of it serve at most"},
};

static int has(const char *word, const char *a, const char *b)
{
    return !word || strstr(a, word) || strstr(b, word);
}

void hada_quirks_find(hada_device_info *info, hada_quirks *quirks)
{
    size_t used = 0;
    *quirks = (hada_quirks){.build_options = ""};
    info->quirks[0] = '\0';
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const quirk_row *row = &rows[i];
        if (!has(row->platform, info->platform, info->vendor) || !has(row->name, info->name, info->name) ||
            (row->kind && row->kind != (int)info->kind))
            continue;
        quirks->own_disk_cache |= row->set.own_disk_cache;
        quirks->avoid_clfft |= row->set.avoid_clfft;
        quirks->host_pages |= row->set.host_pages;
        quirks->stated_local |= row->set.stated_local;
        if (row->set.build_options)
            quirks->build_options = row->set.build_options;
        int n = snprintf(info->quirks + used, sizeof info->quirks - used, "%s%s", used ? "; " : "", row->reason);
        used += n > 0 && (size_t)n < sizeof info->quirks - used ? (size_t)n : 0;
    }
}
