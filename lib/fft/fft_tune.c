/* Measuring the back ends against each other, on request only. */
#include <hadalens/tune.h>

#include "core/callers.h"
#include "core/clock.h"
#include "fft/fft_internal.h"
#include "runtime/tuning.h"

enum { BATCH = 4, ROUNDS = 15, MOST_ROUNDS = 1000, BACKENDS = 2, DIRECTIONS = 2 };

/* clFFT must be clearly faster: it neither prunes nor multiplies by filters while it reads. */
#define CLEARLY 0.95

typedef struct contest {
    hada_slot *slot;
    hada_fft_desc desc;
    hada_fft *plan[BACKENDS][DIRECTIONS]; /* NULL: does not take part */
    hada_buffer real, spectrum;
    double *seconds[BACKENDS][DIRECTIONS];
} contest;

static const hada_fft_backend backends[BACKENDS] = {HADA_FFT_OWN, HADA_FFT_CLFFT};

static hada_status run(contest *c, int backend, int direction, hada_error *err)
{
    hada_fft *plan = c->plan[backend][direction];
    hada_status status = direction
                             ? hada_fft_inverse(plan, c->desc.batch, c->spectrum.mem, 0, c->real.mem, 0, NULL, err)
                             : hada_fft_forward(plan, c->desc.batch, c->real.mem, 0, c->spectrum.mem, 0, err);
    return status ? status : hada_slot_finish(c->slot, err);
}

static void leave(contest *c, int backend)
{
    for (int d = 0; d < DIRECTIONS; d++)
        hada_fft_destroy(&c->plan[backend][d]);
}

/* Makes the plans of a back end, which checks them, and runs each once; whoever fails does not take part. */
static hada_status enter(contest *c, int backend, char *reason, size_t size, hada_error *err)
{
    hada_error local = {0};
    hada_status status = HADA_OK;
    for (int d = 0; d < DIRECTIONS; d++) {
        hada_fft_desc desc = c->desc;
        desc.backend = backends[backend];
        desc.direction = d ? HADA_FFT_INVERSE : HADA_FFT_FORWARD;
        HADA_TRY_OR_DONE(hada_fft_create(&c->plan[backend][d], c->slot, &desc, &local));
        HADA_TRY_OR_DONE(run(c, backend, d, &local));
    }
done:
    if (status) {
        leave(c, backend);
        snprintf(reason, size, "%.*s", (int)size - 1, local.message);
        if (err)
            *err = local;
    }
    return status;
}

static hada_status make_buffers(contest *c, hada_error *err)
{
    hada_context *context = c->slot->context;
    size_t spectrum = 0;
    for (int b = 0; b < BACKENDS; b++) {
        const hada_spectrum_layout layout = hada_fft_layout(context, c->desc.rows, c->desc.cols, backends[b]);
        spectrum = layout.count > spectrum ? layout.count : spectrum;
    }
    const size_t batch = (size_t)c->desc.batch;
    HADA_TRY(hada_buffer_create(&c->real, context, c->desc.real_distance * batch * sizeof(float),
                                "the images of a measurement", err));
    HADA_TRY(hada_buffer_create(&c->spectrum, context, spectrum * batch * 2 * sizeof(float),
                                "the spectra of a measurement", err));
    /* zeros: as fast as anything else, and free of denormals */
    HADA_TRY(hada_buffer_clear(&c->real, c->slot, 0, c->real.bytes, err));
    return hada_buffer_clear(&c->spectrum, c->slot, 0, c->spectrum.bytes, err);
}

static hada_status measure(contest *c, int rounds, hada_error *err)
{
    for (int r = 0; r < rounds; r++) {
        HADA_TRY(hada_monitor_check(c->slot->context->monitor, err));
        for (int k = 0; k < BACKENDS * DIRECTIONS; k++) {
            /* they take turns, and who goes first changes */
            const int b = (k + r) % BACKENDS, d = k / BACKENDS;
            if (!c->plan[b][d])
                continue;
            const double start = hada_seconds();
            HADA_TRY(run(c, b, d, err));
            c->seconds[b][d][r] = hada_seconds() - start;
        }
    }
    HADA_TRY(hada_monitor_check(c->slot->context->monitor, err));
    return HADA_OK;
}

static void conclude(contest *c, int rounds, hada_tune_row *row)
{
    hada_tune_time *times[BACKENDS] = {&row->own, &row->clfft};
    for (int b = 0; b < BACKENDS; b++) {
        if (!c->plan[b][0])
            continue;
        times[b]->forward_ms = 1e3 * hada_median(c->seconds[b][0], (size_t)rounds);
        times[b]->inverse_ms = 1e3 * hada_median(c->seconds[b][1], (size_t)rounds);
    }
    const double own = row->own.forward_ms + row->own.inverse_ms, other = row->clfft.forward_ms + row->clfft.inverse_ms;
    row->chosen = isnan(own) || other < CLEARLY * own ? HADA_TUNE_CLFFT : HADA_TUNE_OWN;
}

static void finish(contest *c)
{
    for (int b = 0; b < BACKENDS; b++)
        leave(c, b);
    hada_slot_destroy(&c->slot);
    HADA_DESTROY_BUFFERS(&c->real, &c->spectrum);
    free(c->seconds[0][0]);
}

/* As many images at once as a quarter of the largest allocation holds. */
static int batch_for(const hada_context *context, size_t pixels)
{
    const uint64_t fit = context->info.max_allocation_bytes / 4 / (pixels * 2 * sizeof(float));
    return fit < 1 ? 1 : fit < BATCH ? (int)fit : BATCH;
}

hada_status hada_tune_fft(hada_context *context, int rows, int cols, int rounds, hada_tune_row *row, hada_error *err)
{
    HADA_NEED(context && row, err);
    if (rows < 1 || cols < 1 || rows > 1 << 24 || cols > 1 << 24 || (rounds < 1 && rounds != HADA_AUTO) ||
        rounds > MOST_ROUNDS)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "transforms of %d x %d cannot be measured in %d rounds: give a size from 1 x 1 and at most %d "
                         "rounds",
                         rows, cols, rounds, MOST_ROUNDS);
    rounds = rounds == HADA_AUTO ? ROUNDS : rounds;
    const size_t pixels = (size_t)rows * (size_t)cols;
    contest c = {.desc = hada_fft_whole(HADA_FFT_FORWARD, rows, cols, batch_for(context, pixels))};
    *row = (hada_tune_row){.rows = rows, .cols = cols, .batch = c.desc.batch};
    row->own.forward_ms = row->own.inverse_ms = row->clfft.forward_ms = row->clfft.inverse_ms = NAN;
    row->before = hada_fft_choose(context, rows, cols) == HADA_FFT_CLFFT ? HADA_TUNE_CLFFT : HADA_TUNE_OWN;
    void *seconds;
    hada_status status = HADA_OK;
    HADA_TRY(hada_allocated(
        seconds = hada_alloc((size_t)rounds * BACKENDS * DIRECTIONS, sizeof(double), "a measurement", err)));
    for (int k = 0; k < BACKENDS * DIRECTIONS; k++)
        c.seconds[k / DIRECTIONS][k % DIRECTIONS] = (double *)seconds + k * rounds;
    HADA_TRY_OR_DONE(hada_slot_create(&c.slot, context, err));
    HADA_TRY_OR_DONE(make_buffers(&c, err));
    const hada_status own = enter(&c, 0, row->own.reason, sizeof row->own.reason, err);
    const hada_status other = enter(&c, 1, row->clfft.reason, sizeof row->clfft.reason, NULL);
    HADA_TRY_OR_DONE(own && other ? own : HADA_OK);
    HADA_TRY_OR_DONE(measure(&c, rounds, err));
    conclude(&c, rounds, row);
done:
    finish(&c);
    return status;
}

hada_status hada_tune_save(const hada_context *context, const char *path, const hada_tune_row *rows, size_t count,
                           hada_error *err)
{
    enum { SHAPE = 32 };
    if (!context || !path || !*path || (count && !rows))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_tune_save: a context, a file name and rows are needed");
    char *shapes = NULL;
    const char **words = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(shapes = hada_alloc(count + 1, SHAPE, "the rows of a tuning file", err)));
    HADA_TRY_OR_DONE(HADA_NEW(words, 2 * count + 1, "the rows of a tuning file", err));
    for (size_t i = 0; i < count; i++) {
        snprintf(shapes + i * SHAPE, SHAPE, "%dx%d", rows[i].rows, rows[i].cols);
        words[i] = shapes + i * SHAPE;
        words[count + i] = hada_enum_name(HADA_ENUM_TUNE_BACKEND, (int)rows[i].chosen);
    }
    HADA_TRY_OR_DONE(hada_tuning_write(context, path, words, words + count, count, err));
done:
    HADA_FREE(shapes, words);
    return status;
}
