/* The commands, each in its own cmd_*.c. */
#ifndef HADA_CLI_COMMAND_H
#define HADA_CLI_COMMAND_H

#include "option.h"

extern const hada_cli_command hada_cli_devices;
extern const hada_cli_command hada_cli_simulate;
extern const hada_cli_command hada_cli_optics;
extern const hada_cli_command hada_cli_register;
extern const hada_cli_command hada_cli_fit;
extern const hada_cli_command hada_cli_train;
extern const hada_cli_command hada_cli_reconstruct;
extern const hada_cli_command hada_cli_evaluate;
extern const hada_cli_command hada_cli_tune;
extern const hada_cli_command hada_cli_bench;

#endif
