/* Manual pages from the option tables, in man(7) macros. */
#include "option.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

/* Text with what troff would take as its own escaped: backslashes, dashes, and a dot or quote that begins a line. */
static void put(FILE *out, const char *text)
{
    int begins = 1;
    for (; *text; text++) {
        if (!strncmp(text, "\n\n", 2)) {
            fputs("\n.PP\n", out);
            text++;
            begins = 1;
            continue;
        }
        if (begins && (*text == '.' || *text == '\''))
            fputs("\\&", out);
        if (*text == '\\')
            fputs("\\e", out);
        else if (*text == '-')
            fputs("\\-", out);
        else
            fputc(*text, out);
        begins = *text == '\n';
    }
}

static void put_upper(FILE *out, const char *text)
{
    for (; *text; text++)
        fputc(toupper((unsigned char)*text), out);
}

static void put_option(void *user, const hada_cli_option *option)
{
    FILE *out = user;
    if (option->kind == HADA_OPTION_GROUP) {
        fputs(".SS ", out);
        put(out, option->help);
        fputc('\n', out);
        return;
    }
    fputs(".TP\n", out);
    if (option->letter)
        fprintf(out, "\\fB\\-%c\\fR, ", option->letter);
    fputs("\\fB\\-\\-", out);
    put(out, option->name);
    fputs("\\fR", out);
    if (option->argument) {
        fputs(" \\fI", out);
        put(out, option->argument);
        fputs("\\fR", out);
    }
    fputc('\n', out);
    put(out, option->help);
    fputs(".\n", out);
    if (option->more) {
        put(out, option->more);
        fputc('\n', out);
    }
}

static void put_exit_codes(FILE *out)
{
    fputs(".SH EXIT STATUS\n", out);
    for (int i = 0; hada_cli_exit_texts[i]; i++) {
        const char *text = hada_cli_exit_texts[i];
        size_t number = strcspn(text, " ");
        fprintf(out, ".TP\n.B %.*s\n", (int)number, text);
        put(out, text + number + strspn(text + number, " "));
        fputs(".\n", out);
    }
}

static void put_command(const hada_cli_command *command, FILE *out)
{
    fputs(".TH HADALENS\\-", out);
    put_upper(out, command->name);
    fprintf(out, " 1 \"\" \"hadalens %s\" \"Hadalens\"\n.SH NAME\nhadalens\\-%s \\- ", HADALENS_VERSION, command->name);
    put(out, command->summary);
    fprintf(out, "\n.SH SYNOPSIS\n.B hadalens %s\n", command->name);
    put(out, command->synopsis);
    fputs("\n.SH DESCRIPTION\n", out);
    put(out, command->description);
    fputs("\n.SH OPTIONS\n", out);
    hada_cli_each_option(command, put_option, out);
    fputs(".SH EXAMPLES\n", out);
    for (const hada_cli_example *example = command->examples; example->line; example++) {
        fputs(".TP\n.B ", out);
        put(out, example->line);
        fputc('\n', out);
        put(out, example->what);
        fputc('\n', out);
    }
    put_exit_codes(out);
    fputs(".SH SEE ALSO\n.BR hadalens (1)\n", out);
}

void hada_cli_print_man(const hada_cli_command *command, FILE *out)
{
    if (command) {
        put_command(command, out);
        return;
    }
    fprintf(out,
            ".TH HADALENS 1 \"\" \"hadalens %s\" \"Hadalens\"\n.SH NAME\nhadalens \\- from one raw frame of a lensless "
            "camera to a 3\\-D scene\n.SH SYNOPSIS\n.B hadalens\n.I COMMAND\n[\\fIOPTION\\fR...]\n.SH DESCRIPTION\n"
            "Learns a mask\\-based lensless camera from a few pairs of raw frame and known scene per distance, and "
            "turns its raw frames into a refocused stack, an all\\-in\\-focus image and a distance map, on any OpenCL "
            "device.\n.SH COMMANDS\n",
            HADALENS_VERSION);
    for (int i = 0; hada_cli_commands[i]; i++) {
        fprintf(out, ".TP\n.BR hadalens\\-%s (1)\n", hada_cli_commands[i]->name);
        put(out, hada_cli_commands[i]->summary);
        fputs(".\n", out);
    }
    fputs(".SH ENVIRONMENT\n.TP\n.B HADALENS_DEVICE\nThe device to work on, as \\fB\\-\\-device\\fR takes it.\n"
          ".TP\n.B HADALENS_BINARIES\nA folder of compiled kernels, as \\fB\\-\\-binaries\\fR takes it.\n"
          ".TP\n.B HADALENS_SHAPE\nThe shape of kernels, as \\fB\\-\\-shape\\fR takes it.\n"
          ".TP\n.B HADALENS_CACHE\nThe folder of the cache of compiled kernels; \"off\" for none.\n"
          ".TP\n.B HADALENS_TUNING\nA text file of tuning choices.\n",
          out);
    put_exit_codes(out);
}
