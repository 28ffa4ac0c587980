/* Conjugate gradients, for several shifts at once. alpha and beta are theirs here, as in the literature; the penalties
 * of a filter are window->setting. */
#include "fit/window.h"

#include "fit/fit_solve.h"
#include "launch/fit_window.h"

/* Work-items of a group that takes the spectra of all channels. */
enum { GROUP = 64 };

/* A shifted system of a channel: its residual is zeta times the residual of the first system. */
typedef struct shifted {
    double sigma; /* less that of the first */
    double zeta, old_zeta;
} shifted;

typedef struct recurrence {
    double first_rr, rr; /* <r, r> at the start and now */
    double alpha, beta;  /* of this iteration */
    double old_alpha, old_beta;
    shifted of[HADA_FIT_WEIGHTS];
} recurrence;

struct hada_fit_window {
    const hada_fit_grid *grid;
    const hada_fit_sums *sums;
    hada_fit_pair *pair;
    hada_fft *inverse;
    int most, count, iterations;
    hada_fit_setting setting;
    const double *raw_energy;
    double outside[HADA_FIT_WEIGHTS];
    hada_buffer residual, product; /* [channel][count] complex: of the first system; T times its direction */
    hada_buffer filters[HADA_FIT_WEIGHTS], directions[HADA_FIT_WEIGHTS];
    hada_buffer partial; /* [channel][chunks] */
    float *partial_sums, *planes;
    double *inner; /* per channel: an inner product */
    recurrence *channel;
};

void hada_fit_window_destroy(hada_fit_window **pointer)
{
    hada_fit_window *window = hada_taken(pointer);
    if (!window)
        return;
    hada_slot_finish(window->grid->slot, NULL);
    hada_fft_destroy(&window->inverse);
    HADA_DESTROY_BUFFERS(&window->residual, &window->product, &window->partial);
    for (int s = 0; s < window->most; s++)
        HADA_DESTROY_BUFFERS(&window->filters[s], &window->directions[s]);
    HADA_FREE(window->partial_sums, window->planes, window->inner, window->channel, window);
}

static hada_status make_buffers(hada_fit_window *window, hada_error *err)
{
    const hada_fit_grid *grid = window->grid;
    const size_t channels = (size_t)grid->info.channels, sums = channels * grid->chunks;
    const size_t bytes = hada_fit_spectra_bytes(grid, channels);
    hada_context *context = grid->slot->context;
    HADA_TRY(hada_buffer_create(&window->residual, context, bytes, "residuals of filters", err));
    HADA_TRY(hada_buffer_create(&window->product, context, bytes, "residuals of filters", err));
    for (int s = 0; s < window->most; s++) {
        HADA_TRY(hada_buffer_create(&window->filters[s], context, bytes, "filters judged in the window", err));
        HADA_TRY(hada_buffer_create(&window->directions[s], context, bytes, "directions of filters", err));
    }
    HADA_TRY(hada_buffer_create(&window->partial, context, sums * sizeof(float), "partial sums", err));
    HADA_TRY(HADA_NEW_RAW(window->partial_sums, sums, "partial sums", err));
    HADA_TRY(HADA_NEW_RAW(window->planes, hada_fit_window_floats(grid), "planes", err));
    HADA_TRY(HADA_NEW(window->inner, channels, "a fit", err));
    return HADA_NEW(window->channel, channels, "a fit", err);
}

hada_status hada_fit_window_create(hada_fit_window **out, const hada_fit_sums *sums, hada_fit_pair *pair, int most,
                                   hada_error *err)
{
    const hada_fft_desc desc = hada_fit_transform_desc(sums->grid, HADA_FFT_INVERSE, 1);
    hada_fit_window *window = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(window, 1, "filters judged in the window", err));
    window->grid = sums->grid;
    window->sums = sums;
    window->pair = pair;
    window->most = most;
    HADA_TRY_OR_DONE(hada_fft_create(&window->inverse, sums->grid->slot, &desc, err));
    HADA_TRY_OR_DONE(make_buffers(window, err));
done:
    if (status)
        hada_fit_window_destroy(&window);
    *out = window;
    return status;
}

static hada_program_fit_window program_of(const hada_fit_grid *grid)
{
    return HADA_FIT_PROGRAM(FIT_WINDOW, hada_fit_is_split(grid), hada_fit_in_groups(grid));
}

/* filter += step p, and then the next direction p = zeta r + beta p, of a channel and a system. */
static hada_status advance(hada_fit_window *window, int c, int s, double step, double zeta, double beta,
                           hada_error *err)
{
    const hada_fit_grid *grid = window->grid;
    const hada_range range = hada_fit_vectors(grid);
    const double values = (double)grid->vectors * HADA_FIT_VECTOR;
    hada_slot_cost(grid->slot, 40.0 * values, 10.0 * values);
    return hada_launch_fit_advance(grid->slot, program_of(grid), &range, err, .x = window->filters[s].mem,
                                   .p = window->directions[s].mem, .r = window->residual.mem,
                                   .image = hada_fit_image_of(grid, (size_t)c), .step = (cl_float)step,
                                   .zeta = (cl_float)zeta, .beta = (cl_float)beta);
}

static hada_fit_penalty penalty_of(const hada_fit_window *window, int c)
{
    return hada_fit_penalty_of(window->setting, window->raw_energy[c]);
}

/* What one of the reductions over an image's frequencies moves. */
static void state_cost(const hada_fit_grid *grid)
{
    const double values = (double)grid->vectors * HADA_FIT_VECTOR;
    hada_slot_cost(grid->slot, (hada_fit_is_split(grid) ? 60.0 : 36.0) * values, 15.0 * values);
}

/* The product becomes T p + shift p; partial: <p, that>. */
static hada_status apply(hada_fit_window *window, int c, double shift, hada_error *err)
{
    const hada_fit_grid *grid = window->grid;
    const hada_range range = hada_fit_chunks(grid);
    state_cost(grid);
    return hada_launch_fit_apply(grid->slot, program_of(grid), &range, err, .p = window->directions[0].mem,
                                 .t = window->product.mem, .sums = window->sums->sums[c].mem,
                                 .pool = window->sums->pool[c].mem, .weights = window->sums->weights.mem,
                                 .out = window->partial.mem, .image = hada_fit_image_of(grid, (size_t)c),
                                 .penalty = penalty_of(window, c), .shift = (cl_float)shift);
}

/* r -= alpha times the product; partial: <r, r>. */
static hada_status reduce_residual(hada_fit_window *window, int c, double alpha, hada_error *err)
{
    const hada_fit_grid *grid = window->grid;
    const hada_range range = hada_fit_chunks(grid);
    state_cost(grid);
    return hada_launch_fit_residual(grid->slot, program_of(grid), &range, err, .r = window->residual.mem,
                                    .t = window->product.mem, .sums = window->sums->sums[c].mem,
                                    .pool = window->sums->pool[c].mem, .weights = window->sums->weights.mem,
                                    .out = window->partial.mem, .image = hada_fit_image_of(grid, (size_t)c),
                                    .penalty = penalty_of(window, c), .step = (cl_float)alpha);
}

/* The inner products that the launches of all channels left, in order. */
static hada_status read_inner(hada_fit_window *window, hada_error *err)
{
    const size_t chunks = window->grid->chunks, channels = (size_t)window->grid->info.channels;
    HADA_TRY(hada_buffer_read(&window->partial, window->grid->slot, 0, window->partial_sums,
                              channels * chunks * sizeof(float), err));
    for (size_t c = 0; c < channels; c++) {
        double sum = 0.0;
        for (size_t i = 0; i < chunks; i++)
            sum += window->partial_sums[c * chunks + i];
        window->inner[c] = sum;
        if (!isfinite(sum))
            return hada_fail(err, HADA_ERROR_NUMERIC,
                             "the fit of filters in the window left single precision; give a larger lambda, or "
                             "outside = 1");
    }
    return HADA_OK;
}

static double sigma_of(double outside)
{
    return outside / (1.0 - outside);
}

static hada_status clear(hada_fit_window *window, hada_error *err)
{
    hada_slot *slot = window->grid->slot;
    HADA_TRY(hada_buffer_clear(&window->product, slot, 0, window->product.bytes, err));
    for (int s = 0; s < window->count; s++) {
        HADA_TRY(hada_buffer_clear(&window->filters[s], slot, 0, window->filters[s].bytes, err));
        HADA_TRY(hada_buffer_clear(&window->directions[s], slot, 0, window->directions[s].bytes, err));
    }
    return HADA_OK;
}

hada_status hada_fit_window_begin(hada_fit_window *window, int z, hada_fit_setting setting, const double *outside,
                                  int count, hada_error *err)
{
    const int channels = window->grid->info.channels;
    window->setting = setting;
    window->count = count;
    window->iterations = 0;
    window->raw_energy = window->sums->depth[z].raw_energy;
    for (int s = 0; s < count; s++)
        window->outside[s] = outside[s];
    HADA_TRY(clear(window, err));
    for (int c = 0; c < channels; c++)
        HADA_TRY(hada_fit_solve_filter(window->sums, c, penalty_of(window, c), window->residual.mem, (size_t)c, err));
    for (int c = 0; c < channels; c++) {
        window->channel[c] = (recurrence){.old_alpha = 1.0};
        for (int s = 0; s < count; s++) {
            window->channel[c].of[s] = (shifted){sigma_of(outside[s]) - sigma_of(outside[0]), 1.0, 1.0};
            HADA_TRY(advance(window, c, s, 0.0, 1.0, 0.0, err));
        }
        HADA_TRY(reduce_residual(window, c, 0.0, err));
    }
    HADA_TRY(read_inner(window, err));
    for (int c = 0; c < channels; c++)
        window->channel[c].first_rr = window->channel[c].rr = window->inner[c];
    return HADA_OK;
}

hada_status hada_fit_window_pair(hada_fit_window *window, hada_error *err)
{
    const hada_fit_grid *grid = window->grid;
    const hada_fit_pair *pair = window->pair;
    const int channels = grid->info.channels;
    const hada_fft_filter filter = hada_fit_product(grid, window->directions[0].mem, 0);
    const size_t vectors = hada_divide_up((size_t)channels * grid->layout.count, HADA_FIT_VECTOR);
    const hada_range range = hada_range_of(vectors, GROUP, 1, 1);
    const double values = (double)vectors * HADA_FIT_VECTOR;
    HADA_TRY(hada_fit_pair_filter(window->pair, window->inverse, &filter, err));
    HADA_TRY(hada_fft_forward(pair->scene_fft, channels, pair->scene.mem, 0, pair->scene_spectrum.mem, 0, err));
    hada_slot_cost(grid->slot, 32.0 * values, 10.0 * values);
    return hada_launch_fit_gather(grid->slot, program_of(grid), &range, err, .g = pair->scene_spectrum.mem,
                                  .b = pair->raw_spectrum.mem, .sum = window->product.mem, .vectors = vectors);
}

/* The next zeta of a shifted system after an iteration (Jegerlehner, eq. 2.42 to 2.44), and its own alpha and beta. */
static void shift(const recurrence *at, shifted *of, double *alpha, double *beta)
{
    const double over = of->zeta * of->old_zeta * at->old_alpha;
    const double under = at->alpha * at->old_beta * (of->old_zeta - of->zeta) +
                         of->old_zeta * at->old_alpha * (1.0 + of->sigma * at->alpha);
    const double zeta = under > 0.0 ? over / under : 0.0, ratio = of->zeta > 0.0 ? zeta / of->zeta : 0.0;
    *alpha = at->alpha * ratio;
    *beta = at->beta * ratio * ratio;
    of->old_zeta = of->zeta;
    of->zeta = zeta;
}

/* After alpha and the residual of a channel are known: its filters and next directions. Returns in *left the largest
 * relative norm of a residual. */
static hada_status end_channel(hada_fit_window *window, int c, double *left, hada_error *err)
{
    recurrence *at = &window->channel[c];
    const double rr = window->inner[c];
    at->beta = at->rr > 0.0 ? rr / at->rr : 0.0;
    for (int s = 0; s < window->count; s++) {
        double alpha, beta;
        shift(at, &at->of[s], &alpha, &beta);
        const double zeta = at->of[s].zeta;
        *left = fmax(*left, at->first_rr > 0.0 ? zeta * sqrt(rr / at->first_rr) : 0.0);
        HADA_TRY(advance(window, c, s, alpha / (1.0 - window->outside[s]), zeta, beta, err));
    }
    at->rr = rr;
    at->old_alpha = at->alpha > 0.0 ? at->alpha : 1.0;
    at->old_beta = at->beta;
    return HADA_OK;
}

hada_status hada_fit_window_iterate(hada_fit_window *window, int *converged, hada_error *err)
{
    const int channels = window->grid->info.channels;
    double left = 0.0;
    *converged = 0;
    for (int c = 0; c < channels; c++)
        HADA_TRY(apply(window, c, sigma_of(window->outside[0]), err));
    HADA_TRY(read_inner(window, err));
    for (int c = 0; c < channels; c++) {
        recurrence *at = &window->channel[c];
        at->alpha = window->inner[c] > 0.0 ? at->rr / window->inner[c] : 0.0; /* a dark channel has no filter */
        HADA_TRY(reduce_residual(window, c, at->alpha, err));
    }
    HADA_TRY(read_inner(window, err));
    for (int c = 0; c < channels; c++)
        HADA_TRY(end_channel(window, c, &left, err));
    HADA_TRY(hada_buffer_clear(&window->product, window->grid->slot, 0, window->product.bytes, err));
    *converged = ++window->iterations == HADA_FIT_ITERATIONS || left < HADA_FIT_TOLERANCE;
    return HADA_OK;
}

const hada_buffer *hada_fit_window_filters(const hada_fit_window *window, int weight)
{
    return weight < 0 ? &window->residual : &window->filters[weight];
}

hada_status hada_fit_window_error(hada_fit_window *window, int weight, double *error, hada_error *err)
{
    const hada_fit_pair *pair = window->pair;
    const size_t count = hada_fit_window_floats(window->grid);
    const hada_fft_filter filter = hada_fit_product(window->grid, hada_fit_window_filters(window, weight)->mem, 0);
    double sum = 0.0;
    HADA_TRY(hada_fit_pair_filter(window->pair, window->inverse, &filter, err));
    HADA_TRY(hada_buffer_read(&pair->scene, window->grid->slot, 0, window->planes, pair->scene.bytes, err));
    for (size_t i = 0; i < count; i++) {
        const double difference = (double)window->planes[i] - pair->scene_pixels[i];
        sum += difference * difference;
    }
    *error = sum / (double)count;
    return HADA_OK;
}
