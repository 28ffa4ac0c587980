/* Which back end serves: a table by device kind and size, overridden by the tuning file. Never a timing. */
#include <stdio.h>
#include <string.h>

#include "fft/fft_internal.h"
#include "runtime/program.h"
#include "runtime/tuning.h"

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

int hada_clfft_takes(int n)
{
    static const int primes[] = {2, 3, 5, 7, 11, 13};
    for (int i = 0; i < 6; i++)
        while (n > 1 && n % primes[i] == 0)
            n /= primes[i];
    return n == 1;
}

hada_fft_backend hada_fft_choose(const hada_context *context, int rows, int cols)
{
    hada_fft_backend backend;
    char shape[32];
    snprintf(shape, sizeof shape, "%dx%d", rows, cols);
    const hada_tuning_row *tuned = hada_tuning_find(context, "fft", shape, 0);
    if (tuned) {
        backend = strcmp(tuned->choice, "clfft") ? HADA_FFT_OWN : HADA_FFT_CLFFT;
    } else {
        const choice_row *row = table;
        while ((row->kind && row->kind != (int)context->info.kind) || (size_t)rows * (size_t)cols > row->largest)
            row++;
        backend = row->backend;
    }
    const int possible = !context->quirks.avoid_clfft && hada_program_can_compile(context) && hada_clfft_takes(rows) &&
                         hada_clfft_takes(cols);
    return backend == HADA_FFT_CLFFT && !possible ? HADA_FFT_OWN : backend;
}
