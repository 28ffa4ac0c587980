#include "bench.h"
#include "option.h"

#include <hadalens/folder.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { MOST_DEVICES = 16, ROUNDS = 9, QUICK_ROUNDS = 3, MOST_ROUNDS = 200 };

typedef struct settings {
    hada_cli_common common;
    const char *model, *output, *net;
    int net_size[2];
    hada_cli_texts workloads;
    int quick, rounds, compare, first_frame, sequence, no_start, no_sweep, no_throughput;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("What to measure"),
    {HADA_OPTION_TEXTS, "workload", 0, "NAME",
     "a camera by design: sim300, sim512 or paper2022; may be given more than once",
     "Default: sim512 and paper2022; with --quick sim300.", AT(workloads)},
    {HADA_OPTION_TEXT, "model", 'm', "MODEL", "a camera of your own, with frames of it as arguments",
     "Its frames have no known truth, so errors are told against the dense run alone.", AT(model)},
    {HADA_OPTION_TEXT, "net", 0, "PRESET", "planes go through a net of this preset, paper or compact, as well",
     "Its weights are random: that takes the time of trained ones, but run time against error is left out.", AT(net)},
    {HADA_OPTION_SIZE, "net-size", 0, "HxW", "pixels at which that net runs (default: the window's)", NULL,
     AT(net_size)},
    {HADA_OPTION_FLAG, "quick", 0, NULL, "a small camera, few rounds: under a minute", NULL, AT(quick)},
    {HADA_OPTION_COUNT, "rounds", 0, "N", "how often each is measured (default: 9, with --quick 3)",
     "Measurements longer than a few seconds stop after three.", AT(rounds)},
    {HADA_OPTION_FLAG, "sequence", 0, NULL, "films alone: frames a second and PSNR, from nothing and with --warm",
     "Simulated ones of ten frames, still and drifting by a pixel a frame, without the first two. A warm start that says "
     "no less dB is of no less quality.",
     AT(sequence)},
    {HADA_OPTION_FLAG, "no-start", 0, NULL, "leave out the cold and warm starts", NULL, AT(no_start)},
    {HADA_OPTION_FLAG, "no-sweep", 0, NULL, "leave out run time against error", NULL, AT(no_sweep)},
    {HADA_OPTION_FLAG, "no-throughput", 0, NULL, "leave out many frames at a time", NULL, AT(no_throughput)},
    {HADA_OPTION_FLAG, "first-frame", 0, NULL, "open the device, make a plan, run one frame twice; nothing else",
     "With -m MODEL and one frame; --quick: with the linear filters alone. This is what the cold and warm starts run, "
     "in processes of their own.",
     AT(first_frame)},

    HADA_CLI_GROUP("Results"),
    {HADA_OPTION_TARGET, "output", 'o', "FOLDER", "where bench.json, bench.csv and the figures go; made when missing",
     NULL, AT(output)},
    {HADA_OPTION_FLAG, "compare", 0, NULL, "compare two result files, OLD.json NEW.json, row by row",
     "Two devices, or two versions: the ratio, and whether it is more than the spread of both.", AT(compare)},
    {0},
};

/* --device of this command: a list, or all. */
static hada_status choose_devices(const settings *set, hada_bench_device *devices, int *count, hada_error *err)
{
    /* what the environment says counts as if it were given */
    const char *wanted = set->common.device ? set->common.device : getenv("HADALENS_DEVICE");
    *count = 0;
    if (!wanted || !strcmp(wanted, "all")) {
        hada_device_list *list;
        hada_status status = hada_device_list_create(&list, err);
        for (size_t i = 0; !status && i < hada_device_list_count(list) && *count < MOST_DEVICES; i++)
            snprintf(devices[(*count)++].index, sizeof devices->index, "%d", hada_device_list_get(list, i)->index);
        hada_device_list_destroy(&list);
        return status;
    }
    for (const char *at = wanted; *at && *count < MOST_DEVICES;) {
        const size_t length = strcspn(at, ",");
        if (!length || length >= sizeof devices->index)
            return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                                  "--device %s is not a list of devices; write indices or kinds with commas between, "
                                  "such as 0,2, or all",
                                  wanted);
        snprintf(devices[(*count)++].index, sizeof devices->index, "%.*s", (int)length, at);
        at += length + (at[length] == ',');
    }
    return HADA_OK;
}

static hada_status open_device(hada_cli *cli, hada_bench_device *device, hada_error *err)
{
    device->common = *cli->common;
    device->common.device = device->index;
    device->cli = *cli;
    device->cli.common = &device->common;
    device->cli.document = json_object();
    HADA_TRY(hada_cli_open(&device->cli, &device->context, err));
    device->info = *hada_context_device(device->context);
    snprintf(device->index, sizeof device->index, "%d", device->info.index);
    return HADA_OK;
}

static void close_devices(hada_bench_device *devices, int count)
{
    for (int i = 0; i < count; i++) {
        hada_context_destroy(&devices[i].context);
        json_decref(devices[i].cli.document);
        devices[i].cli.document = NULL;
    }
}

/* Where all are measured, one that cannot work is left out; *count falls. */
static hada_status open_devices(hada_cli *cli, hada_bench_device *devices, int *count, hada_error *err)
{
    const int wanted = *count, named = cli->common->device && strcmp(cli->common->device, "all");
    hada_status status = HADA_OK;
    *count = 0;
    for (int i = 0; i < wanted; i++) {
        hada_bench_device *device = &devices[*count];
        memmove(device->index, devices[i].index, sizeof device->index);
        status = open_device(cli, device, err);
        if (status == HADA_OK) {
            (*count)++;
            continue;
        }
        close_devices(device, 1);
        if (named || wanted == 1)
            return status;
        hada_cli_warn(cli, "device %s is left out: %s", device->index, err->message);
    }
    return *count ? HADA_OK : status;
}

/* Of two devices with one name (two equal cards) the second gets its number. */
static void tell_apart(hada_bench_device *devices, int count)
{
    for (int i = 1; i < count; i++)
        for (int k = 0; k < i; k++)
            if (!strcmp(devices[i].info.name, devices[k].info.name)) {
                char name[sizeof devices->info.name];
                snprintf(name, sizeof name, "%.200s (%d)", devices[i].info.name, devices[i].info.index);
                memcpy(devices[i].info.name, name, sizeof name);
            }
}

static hada_status measure_workload(hada_bench *bench, const settings *set, hada_bench_device *devices, int count,
                                    const hada_bench_workload *workload, int first, hada_error *err)
{
    typedef hada_status (*part)(hada_bench *, hada_bench_device *, const hada_bench_workload *, hada_error *);
    static const part parts[] = {hada_bench_latency, hada_bench_throughput, hada_bench_sweep, hada_bench_start,
                                 hada_bench_sequence};
    static const char *const names[] = {"latency", "throughput", "run time against error", "starts", "films"};
    const int all = !set->sequence, wanted[] = {all, all && !set->no_throughput, all && !set->no_sweep && !set->net,
                                                all && first && !set->no_start, !all};
    hada_status status = HADA_OK;
    for (int d = 0; d < count; d++)
        for (int i = 0; i < 5; i++) {
            const double start = hada_cli_seconds();
            if (!wanted[i])
                continue;
            status = parts[i](bench, &devices[d], workload, err);
            if (status)
                hada_cli_prefix(err, "device %s, %s: ", devices[d].index, workload->name);
            HADA_TRY(status);
            hada_cli_detail(bench->cli, "%s, %s on device %s: %.1f s", workload->name, names[i], devices[d].index,
                            hada_cli_seconds() - start);
        }
    return status;
}

static hada_status measure_all(hada_bench *bench, const settings *set, hada_bench_device *devices, int count,
                               const char *const *files, int file_count, hada_error *err)
{
    static const char *const usual[] = {"sim512", "paper2022"}, *const quick[] = {"sim300"};
    const char *const *names = set->workloads.count ? set->workloads.items : set->quick ? quick : usual;
    const int named = set->workloads.count ? set->workloads.count : set->model ? 0 : set->quick ? 1 : 2;
    hada_status status = HADA_OK;
    hada_bench_workload workload = {0};
    for (int d = 0; d < count; d++)
        HADA_TRY_OR_DONE(hada_bench_peaks(bench, &devices[d], err));
    for (int i = set->model ? -1 : 0; i < named; i++) {
        HADA_TRY_OR_DONE(i < 0 ? hada_bench_workload_load(&workload, set->model, files, file_count, err)
                               : hada_bench_workload_make(bench, &workload, devices[0].context, names[i], err));
        if (set->net)
            HADA_TRY_OR_DONE(hada_bench_workload_enhance(&workload, set->net, set->net_size[0], set->net_size[1], err));
        HADA_TRY_OR_DONE(measure_workload(bench, set, devices, count, &workload, i == (set->model ? -1 : 0), err));
        hada_bench_workload_free(&workload);
    }
done:
    hada_bench_workload_free(&workload);
    return status;
}

static hada_status make_scratch(hada_bench *bench, hada_error *err)
{
    const char *root = getenv("TMPDIR");
    bench->scratch = hada_cli_text("%s/hadalens-bench-XXXXXX", root && *root ? root : "/tmp");
    if (mkdtemp(bench->scratch))
        return HADA_OK;
    hada_cli_error(err, HADA_ERROR_FILE_WRITE, "no folder for scratch files can be made as %s; set TMPDIR",
                   bench->scratch);
    free(bench->scratch);
    bench->scratch = NULL;
    return err->status;
}

static hada_status run_bench(hada_cli *cli, const settings *set, const char *const *files, int file_count,
                             hada_error *err)
{
    hada_bench bench = {.cli = cli, .quick = set->quick, .patience = set->quick ? 2 : 6};
    hada_bench_device *devices = hada_cli_memory(MOST_DEVICES, sizeof *devices);
    int count = 0;
    bench.rounds = set->rounds ? set->rounds : set->quick ? QUICK_ROUNDS : ROUNDS;
    hada_status status = HADA_OK;
    if (set->output)
        HADA_TRY_OR_DONE(hada_folder_ensure(set->output, err));
    HADA_TRY_OR_DONE(make_scratch(&bench, err));
    HADA_TRY_OR_DONE(choose_devices(set, devices, &count, err));
    HADA_TRY_OR_DONE(open_devices(cli, devices, &count, err));
    tell_apart(devices, count);
    HADA_TRY_OR_DONE(measure_all(&bench, set, devices, count, files, file_count, err));
    json_t *list = json_array();
    for (int i = 0; i < count; i++)
        json_array_append_new(list, hada_cli_device_json(&devices[i].info));
    json_object_set_new(cli->document, "devices", list);
    HADA_TRY_OR_DONE(hada_bench_json(&bench, cli->document, err));
    hada_bench_print(&bench);
    if (set->output)
        HADA_TRY_OR_DONE(hada_bench_write(&bench, set->output, err));
    if (set->output && hada_cli_pictures(cli))
        HADA_TRY_OR_DONE(hada_bench_plots(&bench, set->output, err));
done:
    close_devices(devices, MOST_DEVICES);
    free(devices);
    if (bench.scratch)
        hada_folder_remove(bench.scratch);
    free(bench.scratch);
    free(bench.rows);
    return status;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    hada_status status;
    if (set->compare) {
        if (count != 2)
            return hada_cli_usage(cli, "--compare takes two files that 'bench' wrote: OLD.json NEW.json");
        status = hada_bench_compare(cli, arguments[0], arguments[1], &err);
    } else if (set->first_frame) {
        if (!set->model || count != 1)
            return hada_cli_usage(cli, "--first-frame needs -m MODEL and one frame of its camera");
        status = hada_bench_first_frame(cli, set->model, arguments[0], set->quick, &err);
    } else {
        if (count && !set->model)
            return hada_cli_usage(cli, "'%s' is a frame without its camera; add -m MODEL", arguments[0]);
        if (set->model && !count)
            return hada_cli_usage(cli, "add one or more raw frames of the camera %s", set->model);
        if (set->sequence && (set->model || set->net))
            return hada_cli_usage(cli, "--sequence simulates films; leave -m and --net out");
        if (set->net_size[0] && !set->net)
            return hada_cli_usage(cli, "--net-size is of a net; add --net PRESET");
        if (set->rounds > MOST_ROUNDS)
            return hada_cli_usage(cli, "--rounds takes 1 to %d", MOST_ROUNDS);
        for (int i = 0; i < set->workloads.count; i++)
            if (!hada_bench_workload_known(set->workloads.items[i]))
                return hada_cli_usage(cli, "there is no workload '%s'; there are %s", set->workloads.items[i],
                                      hada_bench_workload_names);
        status = run_bench(cli, set, arguments, count, &err);
    }
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens bench -o results", "the reference workloads on every device: tables, files, figures."},
    {"hadalens bench --quick", "a first impression, in under a minute."},
    {"hadalens bench -m camera.model frame.tif -o results --device 0", "a camera of your own, on one device."},
    {"hadalens bench --workload paper2022 --net paper --net-size 256x256 --no-start",
     "the paper's own measure: three channels at 14 depths, enhanced."},
    {"hadalens bench --sequence --quick", "what warm starts gain, in films."},
    {"hadalens bench --compare last/bench.json results/bench.json", "faster or slower than before, beyond the spread?"},
    {0},
};

const hada_cli_command hada_cli_bench = {
    .name = "bench",
    .summary = "measure speed, memory and run time against error on every device",
    .synopsis = "[-o FOLDER] [--workload NAME]... [-m MODEL FRAME.tif...] [--quick] [OPTION...] | --compare OLD.json "
                "NEW.json",
    .description =
        "For every device that --device names (a list such as 0,2, or all, the default): the latency per depth, stage "
        "by stage; frames a second with one queue and two; bytes stated and held; the start with empty caches and "
        "with full ones; run time against error over filters, precisions, steps of refinement and kinds of skipping, "
        "with the settings that no other beats marked; and each kernel against what the device could do at best.\n\n"
        "Every figure is a median with its quartiles. FOLDER gets bench.json, bench.csv and figures as SVG.\n\n"
        "The workloads are made by the library's own simulator: sim512 is a camera of 512x512 pixels learned from "
        "pairs, paper2022 one of 1376x2064 from its point spread functions.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .run = run,
    .uses_device = 1,
};
