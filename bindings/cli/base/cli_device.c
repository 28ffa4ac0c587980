#include "option.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void log_message(void *user, hada_log_level level, const char *message)
{
    hada_cli *cli = user;
    char words[1200];
    snprintf(words, sizeof words, "%s", message);
    hada_cli_translate(words);
    if (level == HADA_LOG_WARNING && !cli->common->quiet) {
        hada_cli_progress_hide(cli);
        hada_cli_put(stderr, "hadalens %s: note: %s\n", cli->command, words);
    } else {
        hada_cli_detail(cli, "%s", words);
    }
}

static hada_status open_one(hada_cli *cli, const char *words, hada_context **out, hada_error *err)
{
    hada_context_options options;
    hada_context_options_init(&options);
    options.device = words;
    options.binaries = cli->common->binaries;
    if (cli->common->shape)
        options.shape = strcmp(cli->common->shape, "groups") ? HADA_SHAPE_LANES : HADA_SHAPE_GROUPS;
    options.log = log_message;
    options.log_user = cli;
    options.monitor = &cli->monitor;
    options.log_level = cli->common->verbose ? HADA_LOG_INFO : HADA_LOG_WARNING;
    const hada_status status = hada_context_create(out, &options, err);
    /* LLVM, in CPU drivers, has put its own handlers before ours, which a signal takes away for a moment */
    hada_cli_catch_signals();
    return status;
}

static json_t *name_json(const hada_device_info *device)
{
    json_t *name = json_pack("{s:i, s:s, s:s}", "index", device->index, "kind",
                             hada_enum_name(HADA_ENUM_DEVICE_KIND, (int)device->kind), "name", device->name);
    if (device->parts)
        json_object_set_new(name, "part", json_pack("[i, i]", device->part, device->parts));
    return name;
}

hada_status hada_cli_open(hada_cli *cli, hada_context **out, hada_error *err)
{
    HADA_TRY(open_one(cli, cli->common->device, out, err));
    json_object_set_new(cli->document, "device", name_json(hada_context_device(*out)));
    return HADA_OK;
}

static hada_status add_device(hada_cli *cli, hada_cli_contexts *devices, const char *words, hada_error *err)
{
    if (devices->count == HADA_CLI_DEVICES)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--device names more than %d devices", HADA_CLI_DEVICES);
    hada_status status = open_one(cli, words, &devices->contexts[devices->count], err);
    devices->count += !status;
    return status;
}

/* One entry of the list; "cpu/2" stands for "cpu:1/2,cpu:2/2". */
static hada_status add_entry(hada_cli *cli, hada_cli_contexts *devices, const char *entry, hada_error *err)
{
    const char *slash = strrchr(entry, '/');
    int parts = 0;
    if (!slash || strchr(entry, ':') || !hada_cli_read_count(slash + 1, &parts))
        return add_device(cli, devices, entry, err);
    if (parts < 1)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--device %s: give the number of parts, from 1 on", entry);
    hada_status status = HADA_OK;
    for (int part = 1; part <= parts; part++) {
        char *words = hada_cli_text("%.*s:%d/%d", (int)(slash - entry), entry, part, parts);
        status = add_device(cli, devices, words, err);
        free(words);
        HADA_TRY(status);
    }
    return status;
}

hada_status hada_cli_open_all(hada_cli *cli, hada_cli_contexts *devices, hada_error *err)
{
    const char *named = cli->common->device ? cli->common->device : getenv("HADALENS_DEVICE");
    char *list = hada_cli_text("%s", named ? named : "");
    hada_status status = HADA_OK;
    for (char *entry = list, *next; entry; entry = next) {
        next = strchr(entry, ',');
        if (next)
            *next++ = '\0';
        HADA_TRY_OR_DONE(add_entry(cli, devices, entry, err));
    }
    json_object_set_new(cli->document, "device", name_json(hada_context_device(devices->contexts[0])));
    if (devices->count > 1) {
        json_t *all = json_array();
        for (int i = 0; i < devices->count; i++)
            json_array_append_new(all, name_json(hada_context_device(devices->contexts[i])));
        json_object_set_new(cli->document, "devices", all);
    }
done:
    free(list);
    return status;
}

hada_context_info hada_cli_context_info(const hada_context *context)
{
    hada_context_info info = {.size = sizeof info};
    (void)hada_context_get_info(context, &info, NULL);
    return info;
}

void hada_cli_close_all(hada_cli *cli, hada_cli_contexts *devices)
{
    int compiled = 0, loaded = 0;
    for (int i = 0; i < devices->count; i++) {
        const hada_context_info info = hada_cli_context_info(devices->contexts[i]);
        compiled += (int)info.programs_compiled;
        loaded += (int)info.programs_loaded;
        hada_context_destroy(&devices->contexts[i]);
    }
    if (devices->count)
        json_object_set_new(cli->document, "programs", json_pack("{s:i, s:i}", "compiled", compiled, "loaded", loaded));
    devices->count = 0;
}

void hada_cli_close(hada_cli *cli, hada_context **context)
{
    hada_cli_contexts one = {.contexts = {*context}, .count = *context != NULL};
    hada_cli_close_all(cli, &one);
    *context = NULL;
}

json_t *hada_cli_device_json(const hada_device_info *device)
{
    return json_pack("{s:i, s:s, s:s, s:s, s:s, s:s, s:s, s:i, s:i, s:I, s:I, s:I, s:I, s:i, s:b, s:b, s:b, s:b, s:b, "
                     "s:i, s:s}",
                     "index", device->index, "kind", hada_enum_name(HADA_ENUM_DEVICE_KIND, (int)device->kind), "name",
                     device->name, "vendor", device->vendor, "platform", device->platform, "driver", device->driver,
                     "version", device->version, "compute_units", (int)device->compute_units, "clock_mhz",
                     (int)device->clock_mhz, "memory_bytes", (json_int_t)device->memory_bytes, "max_allocation_bytes",
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
