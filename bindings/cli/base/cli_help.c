#include "option.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

const char *const hada_cli_exit_texts[] = {
    "0    everything was done",
    "1    several files failed, for different reasons",
    "2    the command line cannot be followed",
    "3    a file or folder is missing, damaged or cannot be written",
    "4    the files can be read, but what they hold does not fit",
    "5    no OpenCL device, not the one asked for, or it fails",
    "6    out of memory",
    "7    a computation broke down",
    "8    reconstruct --strict: the camera does not belong to a frame",
    "130  stopped with Ctrl-C",
    NULL,
};

static int text_width(void)
{
    struct winsize window;
    int width = 80;
    if (isatty(STDOUT_FILENO) && !ioctl(STDOUT_FILENO, TIOCGWINSZ, &window) && window.ws_col >= 40)
        width = window.ws_col;
    return width > 100 ? 100 : width;
}

/* Prints text from column `at` on, with further lines indented. */
static void wrap(const char *text, int at, int indent)
{
    int width = text_width();
    int column = at;
    if (!*text)
        putchar('\n');
    while (*text) {
        size_t word = strcspn(text, " \n");
        if (column > indent && column + 1 + (int)word > width) {
            printf("\n%*s", indent, "");
            column = indent;
        } else if (column > indent) {
            putchar(' ');
            column++;
        }
        fwrite(text, 1, word, stdout);
        column += (int)word;
        text += word;
        if (!strncmp(text, "\n\n", 2)) {
            printf("\n\n%*s", indent, "");
            column = indent;
            text += 2;
        }
        text += strspn(text, " \n");
    }
    putchar('\n');
}

static void print_option(void *user, const hada_cli_option *option)
{
    enum { COLUMN = 28 };
    (void)user;
    if (option->kind == HADA_OPTION_GROUP) {
        printf("\n%s:\n", option->help);
        return;
    }
    char left[128], letter[8] = "    ";
    if (option->letter)
        snprintf(letter, sizeof letter, "-%c, ", option->letter);
    int used = snprintf(left, sizeof left, "  %s--%s%s%s", letter, option->name, option->argument ? " " : "",
                        option->argument ? option->argument : "");
    printf("%s", left);
    if (used >= COLUMN - 1)
        printf("\n%*s", COLUMN, "");
    else
        printf("%*s", COLUMN - used, "");
    wrap(option->help, COLUMN, COLUMN);
    if (option->more) {
        printf("%*s", COLUMN, "");
        wrap(option->more, COLUMN, COLUMN);
    }
}

void hada_cli_print_help(const hada_cli_command *command)
{
    printf("hadalens %s: %s\n\nUsage:\n  hadalens %s %s\n\n", command->name, command->summary, command->name,
           command->synopsis);
    wrap(command->description, 0, 0);
    hada_cli_each_option(command, print_option, NULL);
    printf("\nExamples:\n");
    for (const hada_cli_example *example = command->examples; example->line; example++) {
        printf("  %s\n      ", example->line);
        wrap(example->what, 6, 6);
    }
    printf("\nExit codes:\n");
    for (int i = 0; hada_cli_exit_texts[i]; i++)
        printf("  %s\n", hada_cli_exit_texts[i]);
}

void hada_cli_print_overview(void)
{
    printf("hadalens %s: from one raw frame of a lensless camera to a 3-D scene\n\n"
           "Usage:\n  hadalens COMMAND [OPTION...]\n\nCommands:\n",
           HADALENS_VERSION);
    for (int i = 0; hada_cli_commands[i]; i++) {
        printf("  %-12s", hada_cli_commands[i]->name);
        wrap(hada_cli_commands[i]->summary, 14, 14);
    }
    printf("\nA first walk, without a camera at hand:\n"
           "  hadalens simulate --preset sim300 --test 2 -o camera\n"
           "  hadalens fit camera -o camera.model\n"
           "  hadalens reconstruct camera/test/raw/*.tif -m camera.model -o pictures\n"
           "  hadalens evaluate pictures camera/test/truth\n\n"
           "'hadalens COMMAND --help' explains a command, 'hadalens --man COMMAND' prints its manual page (troff).\n"
           "'hadalens --version' prints the version.\n");
}
