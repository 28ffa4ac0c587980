#include "reconstruct.h"

#include <stdlib.h>
#include <string.h>

enum { NOT_GIVEN = -3 }; /* which is not HADA_AUTO */

void hada_cli_method_defaults(hada_cli_method_settings *set)
{
    *set = (hada_cli_method_settings){.weight = HADA_AUTO, .tv = NOT_GIVEN, .lambda = NOT_GIVEN};
}

/* "M1,M2,M3" */
static hada_status read_mu(const char *text, hada_classic_options *out, hada_error *err)
{
    double *const to[3] = {&out->mu1, &out->mu2, &out->mu3};
    char part[64];
    for (int i = 0; i < 3; i++) {
        const size_t length = strcspn(text, ",");
        const int last = text[length] == '\0';
        if (length >= sizeof part || last != (i == 2))
            return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--mu takes three numbers, such as 1,0.03,0.003");
        memcpy(part, text, length);
        part[length] = '\0';
        if (!hada_cli_read_real(part, to[i]) || !(*to[i] > 0))
            return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--mu: '%s' is not a number above 0", part);
        text += length + !last;
    }
    return HADA_OK;
}

/* Options of methods that iterate, without one. */
static hada_status check_none(const hada_cli_method_settings *set, hada_error *err)
{
    const char *option = set->prior             ? "prior"
                         : set->iterations      ? "iterations"
                         : set->inner           ? "inner"
                         : set->levels          ? "levels"
                         : set->plain           ? "no-accelerate"
                         : set->stop > 0        ? "stop"
                         : set->seconds > 0     ? "seconds"
                         : set->weight >= 0     ? "weight"
                         : set->tv != NOT_GIVEN ? "tv"
                         : set->step > 0        ? "step"
                         : set->mu              ? "mu"
                                                : NULL;
    return option ? hada_cli_error(err, HADA_ERROR_ARGUMENT, "--%s belongs to --method rl, fista or admm", option)
                  : HADA_OK;
}

static hada_status read_prior(const hada_cli_method_settings *set, hada_classic_options *out, hada_error *err)
{
    if (set->tv != NOT_GIVEN && (set->prior || set->weight >= 0))
        return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                              "--tv W stands for --prior tv --weight W; give one or the other");
    out->prior = set->tv != NOT_GIVEN ? HADA_PRIOR_TV : (hada_prior)set->prior;
    out->weight = set->tv != NOT_GIVEN ? set->tv : set->weight;
    if (set->weight >= 0 && set->prior < HADA_PRIOR_TV && out->method != HADA_METHOD_ADMM)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--weight is that of a prior: choose one with --prior");
    return HADA_OK;
}

hada_status hada_cli_read_method(const hada_cli_method_settings *set, hada_classic_options *out, hada_error *err)
{
    out->method = set->method == HADA_CLI_MATCHED ? HADA_METHOD_MODEL : (hada_method)set->method;
    if (set->lambda != NOT_GIVEN && !(set->lambda > 0))
        return hada_cli_error(err, HADA_ERROR_ARGUMENT, "--lambda must be greater than zero");
    if (set->lambda > 0)
        out->lambda = set->lambda;
    if (out->method < HADA_METHOD_RL)
        return check_none(set, err);
    HADA_TRY(read_prior(set, out, err));
    if (set->mu)
        HADA_TRY(read_mu(set->mu, out, err));
    if (set->iterations)
        out->iterations = set->iterations;
    out->stop = set->stop;
    out->seconds = set->seconds;
    out->accelerate = !set->plain;
    if (set->step > 0)
        out->step = set->step;
    if (set->inner)
        out->inner = set->inner;
    if (set->levels)
        out->levels = set->levels;
    return HADA_OK;
}
