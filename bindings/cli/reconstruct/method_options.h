/* The options that choose and steer a classic method. */
#ifndef HADA_CLI_METHOD_OPTIONS_H
#define HADA_CLI_METHOD_OPTIONS_H

#include "option.h"

#include <hadalens/reconstruct.h>

/* Beside hada_method: the model's optics, transposed, in place of its filters. */
enum { HADA_CLI_MATCHED = -1 };

typedef struct hada_cli_method_settings {
    int method, prior, iterations, inner, levels, plain;
    double stop, seconds, weight, tv, step, lambda;
    const char *mu;
} hada_cli_method_settings;

/* What the members hold when no option is given. */
void hada_cli_method_defaults(hada_cli_method_settings *set);

/* Into the options of a plan; HADA_ERROR_ARGUMENT where options do not go together. */
hada_status hada_cli_read_method(const hada_cli_method_settings *set, hada_classic_options *out, hada_error *err);

#endif
