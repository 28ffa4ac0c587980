/* The command line. Chooses the command, parses its options, prints the JSON document at the end. */
#include "option.h"

#include <hadalens/headerless.h>
#include <hadalens/limits.h>
#include <stdio.h>
#include <string.h>

const hada_cli_command *const hada_cli_commands[] = {
    &hada_cli_devices,     &hada_cli_optics,   &hada_cli_simulate, &hada_cli_register, &hada_cli_fit, &hada_cli_train,
    &hada_cli_reconstruct, &hada_cli_evaluate, &hada_cli_tune,     &hada_cli_bench,    NULL,
};

static int unknown_command(const char *name)
{
    hada_cli_nearest nearest = {.word = name};
    for (int i = 0; hada_cli_commands[i]; i++)
        hada_cli_nearest_try(&nearest, hada_cli_commands[i]->name);
    if (nearest.best)
        hada_cli_put(stderr, "hadalens: there is no command '%s'; did you mean '%s'?\n", name, nearest.best);
    else
        hada_cli_put(stderr, "hadalens: there is no command '%s'; 'hadalens --help' lists them\n", name);
    return HADA_EXIT_USAGE;
}

static int print_manual(const char *name)
{
    const hada_cli_command *command = name ? hada_cli_find_command(name) : NULL;
    if (name && !command)
        return unknown_command(name);
    hada_cli_print_man(command);
    return HADA_EXIT_OK;
}

/* What concerns all files: the environment's budgets, what --limits changes of them, and --headerless. */
static hada_status set_reading(const hada_cli *cli, hada_error *err)
{
    hada_limits limits;
    hada_limits_init(&limits);
    HADA_TRY(hada_limits_get(&limits, err));
    if (cli->common->limits) {
        HADA_TRY(hada_limits_parse(&limits, cli->common->limits, err));
        HADA_TRY(hada_limits_set(&limits, err));
    }
    return hada_headerless_set(cli->common->headerless, err);
}

/* Commands that ranks share; the first of them speaks, and those that fail alone. */
static hada_status join_ranks(const hada_cli_ranks *ranks, const hada_cli_command *command, hada_cli_common *common,
                              char *words, size_t size, hada_error *err)
{
    if (!ranks || ranks->communicator.count == 1)
        return HADA_OK;
    if (!command->shared)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "%s is no work for several ranks; run 'hadalens %s' alone",
                              command->name, command->name);
    hada_cli_take_device(ranks, common, words, size);
    if (ranks->communicator.rank) {
        common->quiet = 1;
        common->json = common->verbose = 0;
    }
    return HADA_OK;
}

static int run(const hada_cli_command *command, int argc, const char **argv, const hada_cli_ranks *ranks)
{
    hada_cli_parsed parsed;
    hada_error err = {0};
    char words[256] = "";
    hada_status status = hada_cli_parse(&parsed, command, argc, argv, &err);
    const hada_cli_common none = {.quiet = ranks && ranks->communicator.rank};
    if (!status)
        status = join_ranks(ranks, command, parsed.settings, words, sizeof words, &err);
    hada_cli cli = {.command = command->name,
                    .common = status ? &none : parsed.settings,
                    .document = json_object(),
                    .ranks = ranks};
    int code;
    cli.monitor = hada_cli_monitor(&cli);
    json_object_set_new(cli.document, "command", json_string(command->name));
    json_object_set_new(cli.document, "version", json_string(HADALENS_VERSION));
    if (status) {
        code = hada_cli_usage(&cli, "%s", err.message);
        cli.common = &none;
    } else if (cli.common->help) {
        if (hada_cli_writes(&cli))
            hada_cli_print_help(command);
        code = HADA_EXIT_OK;
    } else {
        hada_cli_catch_signals();
        code = set_reading(&cli, &err) ? hada_cli_fail(&cli, &err)
                                       : command->run(&cli, parsed.settings, parsed.count, parsed.arguments);
        hada_cli_progress_end(&cli);
    }
    /* A command line that could not be parsed still answers in JSON when it asks for it. */
    int json = cli.common->json;
    for (int i = 1; status && i < argc; i++)
        json |= !strcmp(argv[i], "--json");
    if (json && !cli.common->help) {
        json_object_set_new(cli.document, "exit_code", json_integer(code));
        json_dumpf(cli.document, stdout, JSON_INDENT(2) | JSON_REAL_PRECISION(9));
        putchar('\n');
    }
    json_decref(cli.document);
    hada_cli_parsed_free(&parsed);
    return code;
}

int hada_cli_program(int argc, char **argv, const hada_cli_ranks *ranks)
{
    const char *first = argc > 1 ? argv[1] : "--help";
    const char *second = argc > 2 ? argv[2] : NULL;
    int code;
    hada_cli_hold_streams();
    if (ranks && ranks->communicator.rank && !hada_cli_find_command(first)) /* the first says it for all */
        return HADA_EXIT_OK;
    if (!strcmp(first, "--version") || !strcmp(first, "-V")) {
        printf("hadalens %s\n", HADALENS_VERSION);
        code = HADA_EXIT_OK;
    } else if (!strcmp(first, "--man")) {
        code = print_manual(second);
    } else if (!strcmp(first, "--help") || !strcmp(first, "-h") || !strcmp(first, "help")) {
        const hada_cli_command *command = second ? hada_cli_find_command(second) : NULL;
        if (command)
            hada_cli_print_help(command);
        else
            hada_cli_print_overview();
        code = second && !command ? unknown_command(second) : argc > 1 ? HADA_EXIT_OK : HADA_EXIT_USAGE;
    } else {
        const hada_cli_command *command = hada_cli_find_command(first);
        code = command ? run(command, argc - 1, (const char **)argv + 1, ranks) : unknown_command(first);
    }
    const int unwritten = fflush(stdout) || ferror(stdout);
    hada_cli_end_by_pipe();
    if (unwritten && code == HADA_EXIT_OK) {
        fprintf(stderr, "hadalens: stdout could not be written\n");
        code = HADA_EXIT_FILE;
    }
    return code;
}
