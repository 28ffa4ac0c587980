/* hadalens: the command line, alone. */
#include "cli.h"

int main(int argc, char **argv)
{
    return hada_cli_program(argc, argv, NULL);
}
