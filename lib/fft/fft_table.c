/* Which back end serves: a table by device kind and size, overridden by the tuning file. Never a timing. */
#include <stdio.h>
#include <stdlib.h>
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

static hada_status try_clfft(hada_slot *slot, hada_fft_direction direction, int rows, int cols, hada_error *err)
{
    const int half = cols / 2 + 1;
    hada_fft plan = {
        .slot = slot,
        .desc = {.direction = direction,
                 .backend = HADA_FFT_CLFFT,
                 .rows = rows,
                 .cols = cols,
                 .batch = 1,
                 .real_rows = rows,
                 .real_cols = cols,
                 .real_pitch = (size_t)cols,
                 .real_distance = (size_t)rows * (size_t)cols,
                 .band_rows = rows / 2,
                 .band_cols = cols / 2},
        .layout = {.rows = rows, .cols = cols, .block = half, .blocks = 1, .count = (size_t)rows * (size_t)half},
        .engine = &hada_fft_clfft_engine};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(plan.engine->create(&plan, err));
    HADA_TRY_OR_DONE(hada_fft_check(&plan, err));
done:
    plan.engine->destroy(&plan);
    return status;
}

static hada_status try_both(hada_context *context, int rows, int cols, hada_error *err)
{
    hada_slot *slot = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    HADA_TRY_OR_DONE(try_clfft(slot, HADA_FFT_FORWARD, rows, cols, err));
    HADA_TRY_OR_DONE(try_clfft(slot, HADA_FFT_INVERSE, rows, cols, err));
done:
    hada_slot_destroy(&slot);
    return status;
}

/* The list of trials only grows, at its head. */
static const hada_trial *known(hada_context *context, int rows, int cols)
{
    pthread_mutex_lock(&context->lock);
    const hada_trial *trial = context->trials;
    pthread_mutex_unlock(&context->lock);
    while (trial && (trial->rows != rows || trial->cols != cols))
        trial = trial->next;
    return trial;
}

static void remember(hada_context *context, int rows, int cols, int serves)
{
    hada_trial *trial = malloc(sizeof *trial);
    if (!trial) /* it is tried again next time */
        return;
    pthread_mutex_lock(&context->lock);
    *trial = (hada_trial){rows, cols, serves, context->trials};
    context->trials = trial;
    pthread_mutex_unlock(&context->lock);
}

/* Compilers differ, and clFFT writes its text for one of long ago: where a size does not compile, or comes out wrong,
 * the own kernels serve. Tried once for a context and size. */
static int clfft_serves(const hada_context *constant, int rows, int cols)
{
    hada_context *context = (hada_context *)(constant->dry ? constant->dry : constant); /* only its books change */
    const hada_trial *trial = known(context, rows, cols);
    if (trial)
        return trial->works;
    hada_error error = {0};
    const hada_status status = try_both(context, rows, cols, &error);
    const int no_text = status == HADA_ERROR_UNSUPPORTED || status == HADA_ERROR_SELF_TEST;
    if (no_text)
        hada_log(context, HADA_LOG_WARNING, "clFFT does not serve transforms of %d x %d, the own kernels do: %s", rows,
                 cols, error.message);
    if (no_text || status == HADA_OK) /* what else went wrong, such as memory, is for the plan to say */
        remember(context, rows, cols, !no_text);
    return !no_text;
}

hada_fft_backend hada_fft_choose(const hada_context *context, int rows, int cols)
{
    hada_fft_backend backend;
    char shape[32];
    snprintf(shape, sizeof shape, "%dx%d", rows, cols);
    const hada_tuning_row *tuned = hada_tuning_find(context, "fft", shape);
    if (tuned) {
        backend = strcmp(tuned->choice, "clfft") ? HADA_FFT_OWN : HADA_FFT_CLFFT;
    } else {
        const choice_row *row = table;
        while ((row->kind && row->kind != (int)context->info.kind) || (size_t)rows * (size_t)cols > row->largest)
            row++;
        backend = row->backend;
    }
    if (backend != HADA_FFT_CLFFT)
        return backend;
    const int possible = !context->quirks.avoid_clfft && hada_program_can_compile(context) && hada_clfft_takes(rows) &&
                         hada_clfft_takes(cols) && clfft_serves(context, rows, cols);
    return possible ? HADA_FFT_CLFFT : HADA_FFT_OWN;
}
