#include "option.h"

#include <hadalens/limits.h>
#include <hadalens/reconstruct.h>
#include <popt.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const hada_cli_option hada_cli_device_options[] = {
    HADA_CLI_GROUP("Device"),
    {HADA_OPTION_TEXT, "device", 'd', "D", "OpenCL device to work on",
     "An index as 'hadalens devices' shows it, a kind (cpu, gpu, accelerator) or a part of the name; 0:1/2 is the "
     "first half of device 0. reconstruct takes a list, such as 0,1 or cpu/2 (the CPU in two halves). Without it the "
     "environment variable HADALENS_DEVICE decides, else the first GPU, else the first accelerator with binaries, "
     "else the first CPU.",
     HADA_CLI_AT(hada_cli_common, device)},
    {HADA_OPTION_TEXT, "binaries", 0, "FOLDER", "take compiled kernels from here",
     "A folder made by 'hadalens devices --save-binaries'. Nothing is compiled then, as FPGAs need it.",
     HADA_CLI_AT(hada_cli_common, binaries)},
    {HADA_OPTION_WORD, "shape", 0, "lanes|groups", "the shape of kernels, whatever the device prefers",
     "lanes: vectors in one work-item, as CPUs and FPGAs like it; groups: work-groups with local memory, as GPUs do. "
     "Without it the environment variable HADALENS_SHAPE decides, else the kind of device. Results agree to rounding.",
     HADA_CLI_AT(hada_cli_common, shape)},
    {0},
};

const hada_cli_option hada_cli_common_options[] = {
    HADA_CLI_GROUP("Output"),
    {HADA_OPTION_FLAG, "json", 0, NULL, "print one JSON document on stdout, and nothing else there", NULL,
     HADA_CLI_AT(hada_cli_common, json)},
    {HADA_OPTION_FLAG, "quiet", 'q', NULL, "print errors only", NULL, HADA_CLI_AT(hada_cli_common, quiet)},
    {HADA_OPTION_FLAG, "verbose", 'v', NULL, "say more on stderr", NULL, HADA_CLI_AT(hada_cli_common, verbose)},
    {HADA_OPTION_TEXT, "limits", 0, "NAME=N,...",
     "how much a file may claim: pixels, pages, text, parameters, seconds; isolate=all",
     "A small file can claim to be a large picture or net; beyond these budgets it is refused. With isolate=all pictures "
     "are decoded in processes without rights. The environment variable "
     "HADALENS_LIMITS says the same. Default: " HADA_LIMITS_DEFAULTS ", " HADA_LIMITS_READER_DEFAULTS ".",
     HADA_CLI_AT(hada_cli_common, limits)},
    {HADA_OPTION_TEXT, "headerless", 0, "HxW:PIXELS", "how files without a header are read, such as 1520x2028:csi12",
     "For what cameras write without a header (rpicam-raw, V4L2, GStreamer), frame after frame. PIXELS: u8; u10, u12, u14, "
     "u16 in two bytes, the lower one first; csi10, csi12 packed as MIPI CSI-2 has it; rgb8. HxW:PIXELS:N where rows begin "
     "every N bytes.",
     HADA_CLI_AT(hada_cli_common, headerless)},
    {HADA_OPTION_FLAG, "help", 'h', NULL, "print this help", NULL, HADA_CLI_AT(hada_cli_common, help)},
    {0},
};

const hada_cli_command *hada_cli_find_command(const char *name)
{
    for (int i = 0; hada_cli_commands[i]; i++)
        if (!strcmp(hada_cli_commands[i]->name, name))
            return hada_cli_commands[i];
    return NULL;
}

void hada_cli_each_option(const hada_cli_command *command, void (*visit)(void *user, const hada_cli_option *option),
                          void *user)
{
    const hada_cli_option *tables[] = {command->options, command->designs_camera ? hada_cli_camera_options : NULL,
                                       command->records_frames ? hada_cli_sensor_options : NULL,
                                       command->uses_device ? hada_cli_device_options : NULL, hada_cli_common_options};
    for (size_t t = 0; t < sizeof tables / sizeof *tables; t++)
        for (const hada_cli_option *option = tables[t]; option && option->help; option++)
            visit(user, option);
}

void hada_cli_nearest_try(hada_cli_nearest *nearest, const char *candidate)
{
    /* Levenshtein distance with one row kept. */
    enum { MOST = 40 };
    int row[MOST + 1];
    int n = (int)strlen(candidate), m = (int)strlen(nearest->word);
    if (n > MOST || m > MOST)
        return;
    for (int i = 0; i <= n; i++)
        row[i] = i;
    for (int j = 1; j <= m; j++) {
        int corner = row[0];
        row[0] = j;
        for (int i = 1; i <= n; i++) {
            int change = corner + (candidate[i - 1] != nearest->word[j - 1]);
            corner = row[i];
            int least = row[i] + 1 < row[i - 1] + 1 ? row[i] + 1 : row[i - 1] + 1;
            row[i] = change < least ? change : least;
        }
    }
    int allowed = m <= 4 ? 1 : m <= 7 ? 2 : 3;
    if (row[n] <= allowed && (!nearest->best || row[n] < nearest->distance)) {
        nearest->best = candidate;
        nearest->distance = row[n];
    }
}

enum { MOST_OPTIONS = 96, MOST_RENAMED = 16 };

/* The rows that are options, in the order that popt's values count from 1. */
typedef struct rows {
    int count;
    const hada_cli_option *items[MOST_OPTIONS];
    hada_cli_nearest nearest;
} rows;

static void collect(void *user, const hada_cli_option *option)
{
    rows *all = user;
    if (option->kind != HADA_OPTION_GROUP && all->count < MOST_OPTIONS)
        all->items[all->count++] = option;
}

static int choice(const char *words, const char *text)
{
    size_t length = strlen(text);
    for (int position = 1; words && *words; position++) {
        size_t word = strcspn(words, "|");
        if (word == length && !strncmp(words, text, length))
            return position;
        words += word + (words[word] == '|');
    }
    return 0;
}

/* Puts a value where it belongs; 0 where the text is none. */
static int take(const hada_cli_option *option, void *target, const char *text)
{
    hada_cli_texts *texts = target;
    double *weight = target;
    int count = 0;
    char *end;
    switch (option->kind) {
    case HADA_OPTION_GROUP: return 1;
    case HADA_OPTION_FLAG: return *(int *)target = 1;
    case HADA_OPTION_TEXT:
    case HADA_OPTION_TARGET: *(const char **)target = text; return *text != '\0';
    case HADA_OPTION_TEXTS:
        if (texts->count < HADA_CLI_TEXTS)
            texts->items[texts->count++] = text;
        else
            return 0;
        return 1;
    case HADA_OPTION_REAL: return hada_cli_read_real(text, target) && *weight >= 0; /* -1 stands for "not given" */
    case HADA_OPTION_COUNT: return hada_cli_read_count(text, target);
    case HADA_OPTION_STEPS:
        if (!hada_cli_read_count(text, &count))
            return 0;
        *(uint64_t *)target = (uint64_t)count;
        return 1;
    case HADA_OPTION_SEED: /* the largest of all stands for "not given" */
        *(uint64_t *)target = strtoull(text, &end, 10);
        return *text >= '0' && *text <= '9' && !*end && *(uint64_t *)target != UINT64_MAX;
    case HADA_OPTION_WEIGHT:
        if (!strcmp(text, "frame") && strstr(option->argument, text)) {
            *weight = HADA_REFINE_TV_FRAME;
            return 1;
        }
        if (strcmp(text, "auto"))
            return hada_cli_read_real(text, weight) && *weight >= (option->values ? option->values[0] : 0) &&
                   (!option->values || *weight <= option->values[1]);
        *weight = HADA_AUTO;
        return 1;
    case HADA_OPTION_PASSES:
        if (strcmp(text, "auto"))
            return hada_cli_read_count(text, target);
        *(int *)target = HADA_AUTO;
        return 1;
    case HADA_OPTION_SIZE: return hada_cli_read_size(text, target);
    case HADA_OPTION_WORD: *(const char **)target = text; return choice(option->argument, text);
    case HADA_OPTION_CHOICE:
        count = choice(option->argument, text);
        if (count)
            *(int *)target = option->values ? option->values[count - 1] : count;
        return count;
    }
    return 0;
}

static hada_status store(const hada_cli_option *option, char *settings, const char *text, hada_error *err)
{
    static const char *const takes[] = {[HADA_OPTION_REAL] = "a number from 0 on, such as 0.5",
                                        [HADA_OPTION_COUNT] = "a whole number such as 8",
                                        [HADA_OPTION_STEPS] = "a whole number such as 8",
                                        [HADA_OPTION_SEED] = "a whole number below 2^64 - 1",
                                        [HADA_OPTION_WEIGHT] = "a number from 0 on, or 'auto'",
                                        [HADA_OPTION_PASSES] = "a whole number such as 8, or 'auto'",
                                        [HADA_OPTION_SIZE] = "HEIGHTxWIDTH in pixels, such as 300x400 (rows first)"};
    if (take(option, settings + option->offset, text))
        return HADA_OK;
    if (option->kind == HADA_OPTION_TEXT || option->kind == HADA_OPTION_TARGET)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--%s needs a value, and got an empty one", option->name);
    if (option->kind == HADA_OPTION_TEXTS)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--%s can be given %d times at most", option->name,
                              HADA_CLI_TEXTS);
    if (option->kind == HADA_OPTION_WORD || option->kind == HADA_OPTION_CHOICE)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--%s takes one of %s, not '%s'", option->name,
                              option->argument, text);
    if (option->kind == HADA_OPTION_WEIGHT && option->values)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--%s takes a number from %d to %d, or 'auto', not '%s'",
                              option->name, option->values[0], option->values[1], text);
    return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--%s takes %s, not '%s'", option->name, takes[option->kind], text);
}

static hada_status bad_option(poptContext context, int code, rows *all, hada_error *err)
{
    const char *word = poptBadOption(context, POPT_BADOPTION_NOALIAS);
    if (code == POPT_ERROR_BADOPT) {
        char plain[64];
        snprintf(plain, sizeof plain, "%s", word + strspn(word, "-"));
        plain[strcspn(plain, "=")] = '\0';
        all->nearest = (hada_cli_nearest){.word = plain};
        for (int i = 0; i < all->count; i++)
            hada_cli_nearest_try(&all->nearest, all->items[i]->name);
        if (all->nearest.best && strlen(plain) > 1)
            return hada_cli_error(err, HADA_ERROR_ARGUMENT, "there is no option %s; did you mean --%s?", word,
                                  all->nearest.best);
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "there is no option %s", word);
    }
    if (code == POPT_ERROR_NOARG)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "%s needs a value", word);
    return hada_cli_error(err, HADA_ERROR_ARGUMENT, "%s: %s", word, poptStrerror(code));
}

/* Whatever names a file that is there and is not an option's to write. */
static hada_status protect_inputs(hada_cli_parsed *parsed, const char **named, int count, hada_error *err)
{
    const char **all = hada_cli_memory((size_t)(count + parsed->count), sizeof *all);
    for (int i = 0; i < count; i++)
        all[i] = named[i];
    for (int i = 0; i < parsed->count; i++)
        all[count + i] = parsed->arguments[i];
    const hada_status status = hada_inputs_protect(&parsed->inputs, all, (size_t)(count + parsed->count), err);
    free(all);
    return status;
}

/* A value that the command line gives. */
typedef struct given {
    const hada_cli_option *option;
    const char *text;
} given;

/* The defaults, then what is given; first the option that defaults go by. */
static hada_status store_all(const hada_cli_command *command, void *settings, const given *list, int count,
                             hada_error *err)
{
    for (int i = 0; command->decides && i < count; i++)
        if (!strcmp(list[i].option->name, command->decides))
            HADA_TRY(store(list[i].option, settings, list[i].text, err));
    if (command->defaults)
        command->defaults(settings);
    for (int i = 0; i < count; i++)
        HADA_TRY(store(list[i].option, settings, list[i].text, err));
    return HADA_OK;
}

/* letters: of the whole command line, each of which may be an option. */
static hada_status parse_all(hada_cli_parsed *parsed, const hada_cli_command *command, rows *all, size_t letters,
                             hada_error *err)
{
    given *list = hada_cli_memory(letters, sizeof *list);
    const char **named = hada_cli_memory(letters, sizeof *named);
    hada_status status = HADA_OK;
    int value, count = 0, names = 0;
    while ((value = poptGetNextOpt(parsed->popt)) > 0) {
        char *text = poptGetOptArg(parsed->popt);
        list[count] = (given){all->items[value - 1], text ? text : ""};
        if (text)
            parsed->texts[parsed->text_count++] = text;
        if (text && list[count].option->kind != HADA_OPTION_TARGET)
            named[names++] = text;
        for (int i = 0; text && i < count; i++) /* outputs are protected against each other */
            if (list[i].option->kind == HADA_OPTION_TARGET && list[count].option->kind == HADA_OPTION_TARGET &&
                list[i].option != list[count].option && hada_path_is_same(list[i].text, text))
                HADA_TRY_OR_DONE(hada_cli_error(err, HADA_ERROR_ARGUMENT, "--%s and --%s both name %s",
                                                list[i].option->name, list[count].option->name, text));
        count++;
    }
    HADA_TRY_OR_DONE(store_all(command, parsed->settings, list, count, err));
    if (value < -1)
        HADA_TRY_OR_DONE(bad_option(parsed->popt, value, all, err));
    parsed->arguments = poptGetArgs(parsed->popt);
    while (parsed->arguments && parsed->arguments[parsed->count])
        parsed->count++;
    HADA_TRY_OR_DONE(protect_inputs(parsed, named, names, err));
done:
    free(list);
    free(named);
    return status;
}

/* popt's table: the options, and those that have had another name. */
static void fill_table(struct poptOption *table, const rows *all, const char *const *renamed)
{
    int count = all->count;
    memset(table, 0, (MOST_OPTIONS + MOST_RENAMED + 1) * sizeof *table);
    for (int i = 0; i < all->count; i++) {
        table[i].longName = all->items[i]->name;
        table[i].shortName = all->items[i]->letter;
        table[i].argInfo = all->items[i]->kind == HADA_OPTION_FLAG ? POPT_ARG_NONE : POPT_ARG_STRING;
        table[i].val = i + 1;
    }
    for (; renamed && *renamed && count < all->count + MOST_RENAMED; renamed += 2)
        for (int i = 0; i < all->count; i++)
            if (!strcmp(all->items[i]->name, renamed[1])) {
                table[count] = table[i];
                table[count].longName = renamed[0];
                table[count++].shortName = 0;
            }
}

hada_status hada_cli_parse(hada_cli_parsed *parsed, const hada_cli_command *command, int argc, const char **argv,
                           hada_error *err)
{
    rows all = {0};
    struct poptOption table[MOST_OPTIONS + MOST_RENAMED + 1];
    size_t letters = 0;
    for (int i = 0; i < argc; i++)
        letters += strlen(argv[i]) + 1;
    hada_cli_each_option(command, collect, &all);
    fill_table(table, &all, command->renamed);
    memset(parsed, 0, sizeof *parsed);
    parsed->settings = hada_cli_memory(1, command->settings_size);
    parsed->texts = hada_cli_memory((size_t)argc, sizeof *parsed->texts);
    parsed->popt = poptGetContext("hadalens", argc, argv, table, 0);
    return parse_all(parsed, command, &all, letters, err);
}

void hada_cli_parsed_free(hada_cli_parsed *parsed)
{
    for (int i = 0; i < parsed->text_count; i++)
        free(parsed->texts[i]);
    hada_inputs_release(&parsed->inputs);
    free(parsed->texts);
    free(parsed->settings);
    if (parsed->popt)
        poptFreeContext(parsed->popt);
    memset(parsed, 0, sizeof *parsed);
}
