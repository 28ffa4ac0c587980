/* Which back end serves: a table by device kind and size, and a text file that overrides it. Never a timing. */
#include <stdio.h>
#include <string.h>

#include "fft/fft_internal.h"
#include "program/program.h"

typedef struct choice_row {
    int kind;       /* hada_device_kind, 0: any */
    size_t largest; /* of rows * cols */
    hada_fft_backend backend;
} choice_row;

/* The first row that fits. Measured where perf/results has figures: on CPUs the own kernels were three to six times
 * faster than clFFT at every size; accelerators have no compiler at run time, so clFFT cannot run there. On GPUs the
 * own kernels serve until a table of measurements says otherwise: they prune, and multiply by filters as they read. */
static const choice_row table[] = {
    {HADA_DEVICE_CPU, (size_t)-1, HADA_FFT_OWN},
    {HADA_DEVICE_ACCELERATOR, (size_t)-1, HADA_FFT_OWN},
    {HADA_DEVICE_GPU, (size_t)-1, HADA_FFT_OWN},
    {0, (size_t)-1, HADA_FFT_OWN},
};

/* A line of the tuning file: "fft KIND ROWSxCOLS own|clfft", "*" for any kind or size. The last line that fits wins. */
static int read_line(const char *line, const char *kind, int rows, int cols, hada_fft_backend *backend)
{
    char word[32], size[64], name[32], wanted[64];
    if (sscanf(line, " fft %31s %63s %31s", word, size, name) != 3)
        return 0;
    snprintf(wanted, sizeof wanted, "%dx%d", rows, cols);
    if ((strcmp(word, "*") && strcmp(word, kind)) || (strcmp(size, "*") && strcmp(size, wanted)))
        return 0;
    if (!strcmp(name, "own"))
        *backend = HADA_FFT_OWN;
    else if (!strcmp(name, "clfft"))
        *backend = HADA_FFT_CLFFT;
    else
        return 0;
    return 1;
}

static int read_tuning(const hada_context *context, int rows, int cols, hada_fft_backend *backend)
{
    char line[256];
    int found = 0;
    FILE *file = context->tuning_file ? fopen(context->tuning_file, "r") : NULL;
    if (!file)
        return 0;
    while (fgets(line, sizeof line, file))
        found |= read_line(line, hada_device_kind_name(context->info.kind), rows, cols, backend);
    fclose(file);
    return found;
}

hada_fft_backend hada_fft_choose(const hada_context *context, int rows, int cols)
{
    hada_fft_backend backend = HADA_FFT_OWN;
    if (!read_tuning(context, rows, cols, &backend)) {
        const choice_row *row = table;
        while ((row->kind && row->kind != (int)context->info.kind) || (size_t)rows * (size_t)cols > row->largest)
            row++;
        backend = row->backend;
    }
    const int possible = !context->quirks.avoid_clfft && hada_program_can_compile(context) && hada_clfft_takes(rows) &&
                         hada_clfft_takes(cols);
    return backend == HADA_FFT_CLFFT && !possible ? HADA_FFT_OWN : backend;
}
