/* Manual pages from the option tables, in man(7) macros. */
#include "option.h"

#include <ctype.h>
#include <stdio.h>
#include <string.h>

/* Text with what troff would take as its own escaped: backslashes, dashes, and a dot or quote that begins a line. */
static void put(const char *text)
{
    int begins = 1;
    for (; *text; text++) {
        if (!strncmp(text, "\n\n", 2)) {
            fputs("\n.PP\n", stdout);
            text++;
            begins = 1;
            continue;
        }
        if (begins && (*text == '.' || *text == '\''))
            fputs("\\&", stdout);
        if (*text == '\\')
            fputs("\\e", stdout);
        else if (*text == '-')
            fputs("\\-", stdout);
        else
            putchar(*text);
        begins = *text == '\n';
    }
}

static void put_upper(const char *text)
{
    for (; *text; text++)
        putchar(toupper((unsigned char)*text));
}

/* Such text between marks of troff. */
static void put_between(const char *before, const char *text, const char *after)
{
    fputs(before, stdout);
    put(text);
    fputs(after, stdout);
}

static void put_option(void *user, const hada_cli_option *option)
{
    (void)user;
    if (option->kind == HADA_OPTION_GROUP) {
        put_between(".SS ", option->help, "\n");
        return;
    }
    fputs(".TP\n", stdout);
    if (option->letter)
        printf("\\fB\\-%c\\fR, ", option->letter);
    put_between("\\fB\\-\\-", option->name, "\\fR");
    if (option->argument)
        put_between(" \\fI", option->argument, "\\fR");
    put_between("\n", option->help, ".\n");
    if (option->more)
        put_between("", option->more, "\n");
}

static void put_exit_codes(void)
{
    fputs(".SH EXIT STATUS\n", stdout);
    for (int i = 0; hada_cli_exit_texts[i]; i++) {
        const char *text = hada_cli_exit_texts[i];
        size_t number = strcspn(text, " ");
        printf(".TP\n.B %.*s\n", (int)number, text);
        put_between("", text + number + strspn(text + number, " "), ".\n");
    }
}

static void put_command(const hada_cli_command *command)
{
    fputs(".TH HADALENS\\-", stdout);
    put_upper(command->name);
    printf(" 1 \"\" \"hadalens %s\" \"Hadalens\"\n.SH NAME\nhadalens\\-%s \\- ", HADALENS_VERSION, command->name);
    put(command->summary);
    printf("\n.SH SYNOPSIS\n.B hadalens %s\n", command->name);
    put(command->synopsis);
    put_between("\n.SH DESCRIPTION\n", command->description, "\n.SH OPTIONS\n");
    hada_cli_each_option(command, put_option, NULL);
    fputs(".SH EXAMPLES\n", stdout);
    for (const hada_cli_example *example = command->examples; example->line; example++) {
        put_between(".TP\n.B ", example->line, "\n");
        put_between("", example->what, "\n");
    }
    put_exit_codes();
    fputs(".SH SEE ALSO\n.BR hadalens (1)\n", stdout);
}

void hada_cli_print_man(const hada_cli_command *command)
{
    if (command) {
        put_command(command);
        return;
    }
    printf(".TH HADALENS 1 \"\" \"hadalens %s\" \"Hadalens\"\n.SH NAME\nhadalens \\- from one raw frame of a lensless "
           "camera to a 3\\-D scene\n.SH SYNOPSIS\n.B hadalens\n.I COMMAND\n[\\fIOPTION\\fR...]\n.SH DESCRIPTION\n"
           "Learns a mask\\-based lensless camera from a few pairs of raw frame and known scene per distance, and "
           "turns its raw frames into a refocused stack, an all\\-in\\-focus image and a distance map, on any OpenCL "
           "device.\n.SH COMMANDS\n",
           HADALENS_VERSION);
    for (int i = 0; hada_cli_commands[i]; i++) {
        printf(".TP\n.BR hadalens\\-%s (1)\n", hada_cli_commands[i]->name);
        put_between("", hada_cli_commands[i]->summary, ".\n");
    }
    fputs(".SH ENVIRONMENT\n.TP\n.B HADALENS_DEVICE\nThe device to work on, as \\fB\\-\\-device\\fR takes it.\n"
          ".TP\n.B HADALENS_BINARIES\nA folder of compiled kernels, as \\fB\\-\\-binaries\\fR takes it.\n"
          ".TP\n.B HADALENS_SHAPE\nThe shape of kernels, as \\fB\\-\\-shape\\fR takes it.\n"
          ".TP\n.B HADALENS_CACHE\nThe folder of the cache of compiled kernels; \"off\" for none.\n"
          ".TP\n.B HADALENS_TUNING\nA text file of tuning choices.\n",
          stdout);
    put_exit_codes();
}
