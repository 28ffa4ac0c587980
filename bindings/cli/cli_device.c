#include "cli.h"

#include <stdio.h>
#include <string.h>

static void log_message(void *user, hada_log_level level, const char *message)
{
    hada_cli *cli = user;
    if (level == HADA_LOG_WARNING && !cli->common->quiet) {
        hada_cli_progress_hide(cli);
        fprintf(stderr, "hadalens %s: note: %s\n", cli->command, message);
    } else {
        hada_cli_detail(cli, "%s", message);
    }
}

hada_status hada_cli_open(hada_cli *cli, hada_context **out, hada_error *err)
{
    hada_context_options options;
    hada_context_options_init(&options);
    options.device = cli->common->device;
    options.binaries = cli->common->binaries;
    options.log = log_message;
    options.log_user = cli;
    options.log_level = cli->common->verbose ? HADA_LOG_INFO : HADA_LOG_WARNING;
    hada_status status = hada_context_create(out, &options, err);
    if (status)
        return status;
    const hada_device_info *device = hada_context_device(*out);
    json_object_set_new(cli->document, "device",
                        json_pack("{s:i, s:s, s:s}", "index", device->index, "kind",
                                  hada_device_kind_name(device->kind), "name", device->name));
    return HADA_OK;
}

void hada_cli_close(hada_cli *cli, hada_context **context)
{
    if (!*context)
        return;
    json_object_set_new(cli->document, "programs",
                        json_pack("{s:i, s:i}", "compiled", (int)hada_context_programs_compiled(*context), "loaded",
                                  (int)hada_context_programs_loaded(*context)));
    hada_context_destroy(context);
}

json_t *hada_cli_device_json(const hada_device_info *device)
{
    return json_pack("{s:i, s:s, s:s, s:s, s:s, s:s, s:s, s:i, s:i, s:I, s:I, s:I, s:I, s:i, s:b, s:b, s:b, s:b, s:b, "
                     "s:i, s:s}",
                     "index", device->index, "kind", hada_device_kind_name(device->kind), "name", device->name,
                     "vendor", device->vendor, "platform", device->platform, "driver", device->driver, "version",
                     device->version, "compute_units", (int)device->compute_units, "clock_mhz", (int)device->clock_mhz,
                     "memory_bytes", (json_int_t)device->memory_bytes, "max_allocation_bytes",
                     (json_int_t)device->max_allocation_bytes, "local_memory_bytes",
                     (json_int_t)device->local_memory_bytes, "max_work_group", (json_int_t)device->max_work_group,
                     "alignment_bytes", (int)device->alignment_bytes, "compiler", device->has_compiler, "local_memory",
                     device->has_local_memory, "double", device->has_double, "half", device->has_half_arithmetic,
                     "unified_memory", device->unified_memory, "max_sub_devices", (int)device->max_sub_devices,
                     "quirks", device->quirks);
}

const char *hada_cli_bytes(char *text, uint64_t bytes)
{
    static const char *const units[] = {"B", "KiB", "MiB", "GiB", "TiB"};
    double value = (double)bytes;
    int unit = 0;
    while (value >= 1024 && unit < 4) {
        value /= 1024;
        unit++;
    }
    snprintf(text, 16, value < 10 && unit ? "%.1f %s" : "%.0f %s", value, units[unit]);
    return text;
}
