#include "option.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct settings {
    hada_cli_common common;
    const char *save_binaries;
    int check;
} settings;

static const hada_cli_option options[] = {
    HADA_CLI_GROUP("Work"),
    {HADA_OPTION_TARGET, "save-binaries", 0, "FOLDER", "compile every kernel and write the binaries here",
     "For the device that --device chooses. Other runs take them with --binaries, and compile nothing.",
     HADA_CLI_AT(settings, save_binaries)},
    {HADA_OPTION_FLAG, "check", 0, NULL, "open the device and compare its first results with known answers",
     "The device is the one --device chooses, or the one that would be used without it.", HADA_CLI_AT(settings, check)},
    {0},
};

static void print_table(hada_cli *cli, const hada_device_list *list)
{
    const size_t count = hada_device_list_count(list);
    size_t name = 4, platform = 8;
    for (size_t i = 0; i < count; i++) {
        const hada_device_info *info = hada_device_list_get(list, i);
        name = strlen(info->name) > name ? strlen(info->name) : name;
        platform = strlen(info->platform) > platform ? strlen(info->platform) : platform;
    }
    hada_cli_say(cli, "%5s  %-11s  %-*s  %-*s  %5s  %8s  %8s  %s", "index", "kind", (int)name, "name", (int)platform,
                 "platform", "units", "memory", "largest", "compiler");
    for (size_t i = 0; i < count; i++) {
        const hada_device_info *info = hada_device_list_get(list, i);
        char memory[16], largest[16];
        hada_cli_say(cli, "%5d  %-11s  %-*s  %-*s  %5u  %8s  %8s  %s", info->index,
                     hada_enum_name(HADA_ENUM_DEVICE_KIND, (int)info->kind), (int)name, info->name, (int)platform,
                     info->platform, info->compute_units, hada_cli_bytes(memory, info->memory_bytes),
                     hada_cli_bytes(largest, info->max_allocation_bytes), info->has_compiler ? "yes" : "no");
    }
    for (size_t i = 0; i < count; i++) {
        const hada_device_info *info = hada_device_list_get(list, i);
        if (info->quirks[0])
            hada_cli_say(cli, "\nOn device %d: %s", info->index, info->quirks);
    }
    hada_cli_say(cli, "\n'largest' is the largest single piece of memory. --device takes an index, a kind or a part of "
                      "a name.");
}

static int open_device(hada_cli *cli, const settings *set)
{
    hada_error err = {0};
    hada_context *context = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_cli_open(cli, &context, &err));
    const char *shape = hada_enum_name(HADA_ENUM_KERNEL_SHAPE, (int)hada_cli_context_info(context).shape);
    hada_cli_say(cli, "\nDevice %d gives the known answers; it takes kernels as %s.",
                 hada_context_device(context)->index, shape);
    json_object_set_new(cli->document, "checked", json_true());
    json_object_set_new(cli->document, "shape", json_string(shape));
    if (set->save_binaries) {
        HADA_TRY_OR_DONE(hada_programs_save(context, set->save_binaries, &cli->monitor, &err));
        hada_cli_say(cli, "Wrote the binaries to %s; use them with --binaries %s.", set->save_binaries,
                     set->save_binaries);
        json_object_set_new(cli->document, "binaries", hada_cli_json_text(set->save_binaries));
    }
done:
    hada_cli_close(cli, &context);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_device_list *list;
    hada_error err = {0};
    if (count)
        return hada_cli_usage(cli, "'%s' is one word too many; this command takes options only", arguments[0]);
    if (hada_device_list_create(&list, &err))
        return hada_cli_fail(cli, &err);
    json_t *all = json_array();
    for (size_t i = 0; i < hada_device_list_count(list); i++)
        json_array_append_new(all, hada_cli_device_json(hada_device_list_get(list, i)));
    json_object_set_new(cli->document, "devices", all);
    print_table(cli, list);
    hada_device_list_destroy(&list);
    return set->check || set->save_binaries ? open_device(cli, set) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens devices", "lists what there is."},
    {"hadalens devices --check --device gpu", "tries the first GPU."},
    {"hadalens devices --device 0 --save-binaries kernels", "makes the kernels for a machine without a compiler."},
    {0},
};

const hada_cli_command hada_cli_devices = {
    .name = "devices",
    .summary = "list the OpenCL devices, and what is special about them",
    .synopsis = "[--check] [--save-binaries FOLDER] [OPTION...]",
    .description = "Prints every OpenCL device of this machine with what matters here: its kind, its memory, the "
                   "largest piece of it that one buffer can have, and whether it can compile. Below the table stands "
                   "what Hadalens does differently on a device, and why.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .run = run,
    .uses_device = 1,
};
