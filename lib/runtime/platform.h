/* All devices of all platforms, in a fixed order, and the choice among them. Internal. */
#ifndef HADA_RUNTIME_PLATFORM_H
#define HADA_RUNTIME_PLATFORM_H

#include "runtime/context.h"

typedef struct hada_platform_device {
    cl_platform_id platform;
    cl_device_id device;
} hada_platform_device;

/* *out is freed with free(). */
hada_status hada_platform_devices(hada_platform_device **out, size_t *count, hada_error *err);

/* Fills info for a device. */
hada_status hada_device_describe(cl_platform_id platform, cl_device_id device, int index, hada_device_info *info,
                                 hada_error *err);

/* Looks the device up in the table of quirks; also writes the reasons into info->quirks. */
void hada_quirks_find(hada_device_info *info, hada_quirks *quirks);

/* A part of a device as a device of its own; never released: whoever asks again gets the same. */
hada_status hada_device_divide(cl_device_id device, const hada_device_info *info, int part, int parts,
                               cl_device_id *out, hada_error *err);

/* Reads and cuts off ":PART/PARTS" at the end of words for a device; part and parts stay as they are where there is
 * none. */
hada_status hada_device_part(char *words, int *part, int *parts, hada_error *err);

/* The index in `infos` that `words` means: an index, a kind, or a part of a name; NULL or "": the first GPU, else the
 * first accelerator when binaries are at hand, else the first CPU, else the first of all. */
hada_status hada_device_choose(const hada_device_info *infos, size_t count, const char *words, int have_binaries,
                               size_t *out, hada_error *err);

#endif
