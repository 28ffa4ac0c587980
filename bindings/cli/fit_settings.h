/* What the two ways of fitting share: from pairs, and from point spread functions. */
#ifndef HADA_CLI_FIT_SETTINGS_H
#define HADA_CLI_FIT_SETTINGS_H

#include "option.h"

#include <hadalens/model.h>

typedef struct hada_cli_fit_settings {
    hada_cli_common common;
    const char *output, *psf, *dark, *refine, *refine_tv, *distances, *sums;
    hada_cli_texts merge;
    int form, boundary, half, skip_incomplete, no_leave_one_out, psf_sign;
    int window[2];
    double alpha, lambda, outside, psf_dark;
    int colour;
} hada_cli_fit_settings;

/* "8", "auto" (-1) or "0" of --refine. */
hada_status hada_cli_read_refine(const char *text, int *steps, hada_error *err);

/* "0.003", "auto" (-1) or "0" of --refine-tv. */
hada_status hada_cli_read_refine_tv(const char *text, double *weight, hada_error *err);

/* A model from the pages of a PSF file. */
hada_status hada_cli_fit_psf(const hada_cli_fit_settings *set, const char *path, hada_context *context,
                             hada_model **model, hada_error *err);

#endif
