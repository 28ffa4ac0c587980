#include "fit/cropped.h"

#include "filter/bank.h"
#include "launch/fit_cropped.h"
#include "launch/fit_window.h"

/* Work-items of a group that takes the spectra of all channels. */
enum { GROUP = 64 };

/* Weights of the constraint, at the first iteration and the last, relaxation, and steps of ADMM an iteration
 * (docs/explanation/learning-a-camera.md). */
#define FIRST_WEIGHT 0.1
#define LAST_WEIGHT  0.03
#define RELAXATION   1.7
enum { STEPS = 2 };

/* Lengths of the steps of a round. */
static const double lengths[] = {1.0, 3.0, 1.0};
enum { ROUND = HADA_COUNT(lengths) };

_Static_assert(HADA_FIT_CROP_PASSES % ROUND == 0 && HADA_FIT_CROP_FURTHER % ROUND == 0, "whole rounds");

/* A round that lowers the sum of squares by less than this part is the last one. */
#define LEAST_FALL 2e-3

/* Of the degrees of freedom of the frames, at least so many are the noise's: few pairs on a large grid. */
#define LEAST_FREE 0.1

struct hada_fit_cropped {
    const hada_fit_grid *grid;
    const hada_fit_sums *sums;
    hada_fit_pair *pair;
    hada_nonnegative *nonnegative;
    hada_fft *inverse;             /* into the frame */
    hada_buffer frame;             /* what the model makes of a scene, then what it leaves of the frame; all channels */
    hada_buffer transfers, filled; /* H; G, then V: [channel][count] complex */
    hada_buffer result;            /* at the end */
    hada_buffer partial;           /* [channel][chunks] */
    size_t pixels, chunks;         /* of a channel's frame */
    float *partial_sums;
    float *often, *scenes; /* how often a frequency of the half spectrum counts; Sxx */
    double *mean, *left, *trust;
    int64_t pairs;
    int passes, done;  /* iterations wanted, and done */
    int passing;       /* pairs come */
    int further, even; /* even: all steps have the length 1 */
    double weight, factor;
    double round_left; /* sum of squares where the last round ended; 0: not known */
};

void hada_fit_cropped_destroy(hada_fit_cropped **pointer)
{
    hada_fit_cropped *own = hada_taken(pointer);
    if (!own)
        return;
    hada_slot_finish(own->grid->slot, NULL);
    hada_fft_destroy(&own->inverse);
    HADA_DESTROY_BUFFERS(&own->frame, &own->transfers, &own->filled, &own->result, &own->partial);
    HADA_FREE(own->partial_sums, own->often, own->scenes, own->mean, own->left, own->trust, own);
}

static hada_status make_room(hada_fit_cropped *own, hada_error *err)
{
    const hada_fit_grid *grid = own->grid;
    const size_t channels = (size_t)grid->info.channels, spectra = hada_fit_spectra_bytes(grid, channels);
    const size_t partial = channels * own->chunks;
    hada_context *context = grid->slot->context;
    HADA_TRY(hada_buffer_create(&own->frame, context, channels * own->pixels * sizeof(float), "a frame", err));
    HADA_TRY(hada_buffer_create(&own->transfers, context, spectra, "transfer functions", err));
    HADA_TRY(hada_buffer_create(&own->filled, context, spectra, "sums of whole frames", err));
    HADA_TRY(hada_buffer_create(&own->result, context, spectra, "transfer functions", err));
    HADA_TRY(hada_buffer_create(&own->partial, context, partial * sizeof(float), "partial sums", err));
    HADA_TRY(HADA_NEW_RAW(own->partial_sums, partial, "partial sums", err));
    HADA_TRY(HADA_NEW_RAW(own->often, grid->layout.count, "a fit", err));
    HADA_TRY(HADA_NEW_RAW(own->scenes, grid->layout.count, "the scenes' power", err));
    HADA_TRY(HADA_NEW(own->mean, channels, "a fit", err));
    HADA_TRY(HADA_NEW(own->left, channels, "a fit", err));
    HADA_TRY(HADA_NEW(own->trust, channels, "a fit", err));
    hada_layout_weights(&grid->layout, own->often);
    return HADA_OK;
}

hada_status hada_fit_cropped_create(hada_fit_cropped **out, const hada_fit_sums *sums, hada_fit_pair *pair,
                                    hada_nonnegative *nonnegative, hada_error *err)
{
    const hada_model_info *info = &sums->grid->info;
    const hada_fft_desc desc = hada_fit_transform_desc(sums->grid, HADA_FFT_INVERSE, 0);
    hada_fit_cropped *own = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(own, 1, "transfer functions", err));
    own->grid = sums->grid;
    own->sums = sums;
    own->pair = pair;
    own->nonnegative = nonnegative;
    own->pixels = (size_t)info->raw_rows * (size_t)info->raw_cols;
    own->chunks = hada_divide_up(own->pixels, (size_t)HADA_FIT_VECTOR * HADA_FIT_CHUNK);
    HADA_TRY_OR_DONE(hada_fft_create(&own->inverse, sums->grid->slot, &desc, err));
    HADA_TRY_OR_DONE(make_room(own, err));
    HADA_TRY_OR_DONE(hada_prepare_fit_cropped(sums->grid->slot, HADA_PROGRAM_FIT_CROPPED_DEFAULT, err));
done:
    if (status)
        hada_fit_cropped_destroy(&own);
    *out = own;
    return status;
}

static hada_nonnegative_data data_of(const hada_fit_cropped *own, int filled)
{
    return (hada_nonnegative_data){own->sums->sums, own->grid->stride, own->mean, filled ? own->filled.mem : NULL};
}

/* The steps of an iteration; filled 0: on the cross sums as they are. */
static hada_status iterate(hada_fit_cropped *own, int filled, hada_error *err)
{
    const hada_nonnegative_data data = data_of(own, filled);
    for (int i = 0; i < STEPS; i++) {
        const hada_nonnegative_weights at = {.weight = own->weight,
                                             .relaxation = RELAXATION,
                                             .dual_scale = i + 1 < STEPS ? 1.0 : 1.0 / own->factor,
                                             .start = !own->further && own->done == 0 && i == 0};
        HADA_TRY(
            hada_nonnegative_step(own->nonnegative, own->grid->info.channels, &data, &at, own->transfers.mem, err));
    }
    own->weight *= own->factor;
    own->done++;
    return HADA_OK;
}

/* The first iteration is done: these are its transfer functions, and their image without negative values the guess. */
static hada_status start_from(hada_fit_cropped *own, const float *start, hada_error *err)
{
    const hada_fit_grid *grid = own->grid;
    const size_t plane = hada_model_info_plane(&grid->info), bytes = grid->layout.count * 2 * sizeof(float);
    float *blocks;
    hada_status status = HADA_OK;
    HADA_TRY(HADA_NEW_RAW(blocks, grid->layout.count * 2, "transfer functions", err));
    for (size_t c = 0; c < (size_t)grid->info.channels; c++) {
        hada_layout_pack(&grid->layout, start + 2 * c * plane, blocks);
        HADA_TRY_OR_DONE(hada_buffer_write(&own->transfers, grid->slot, c * bytes, blocks, bytes, err));
    }
    HADA_TRY_OR_DONE(hada_nonnegative_begin(own->nonnegative, grid->info.channels, own->transfers.mem, err));
    own->done = 1;
done:
    free(blocks);
    return status;
}

hada_status hada_fit_cropped_begin(hada_fit_cropped *own, int64_t pairs, const double *scene_energy, int passes,
                                   int further, const float *start, hada_error *err)
{
    own->pairs = pairs;
    own->passes = passes;
    own->done = own->passing = 0;
    own->further = further;
    own->even = start != NULL;
    own->round_left = 0.0;
    for (int c = 0; c < own->grid->info.channels; c++) {
        own->mean[c] = scene_energy[c];
        own->left[c] = 0.0;
    }
    own->factor = further || passes < 2 ? 1.0 : pow(LAST_WEIGHT / FIRST_WEIGHT, 1.0 / (passes - 1));
    if (further)
        return HADA_OK;
    own->weight = FIRST_WEIGHT;
    return start ? start_from(own, start, err) : iterate(own, 0, err);
}

/* What the pass left, in own->left; returns the sum over channels. */
static hada_status read_left(hada_fit_cropped *own, double *sum, hada_error *err)
{
    const size_t channels = (size_t)own->grid->info.channels;
    *sum = 0.0;
    HADA_TRY(hada_buffer_read(&own->partial, own->grid->slot, 0, own->partial_sums, own->partial.bytes, err));
    for (size_t c = 0; c < channels; c++) {
        own->left[c] = 0.0;
        for (size_t i = 0; i < own->chunks; i++)
            own->left[c] += own->partial_sums[c * own->chunks + i];
        *sum += own->left[c];
    }
    if (!isfinite(*sum))
        return hada_fail(err, HADA_ERROR_NUMERIC,
                         "the fit of transfer functions with the crop in the model left single precision; set "
                         "crop_passes to 0");
    return HADA_OK;
}

/* V of the pass, in the place of G. */
static hada_status fill(hada_fit_cropped *own, double step, hada_error *err)
{
    const hada_fit_grid *grid = own->grid;
    const hada_range range = hada_fit_vectors(grid);
    const double values = (double)grid->vectors * HADA_FIT_VECTOR;
    for (int c = 0; c < grid->info.channels; c++) {
        hada_slot_cost(grid->slot, 28.0 * values, 6.0 * values);
        HADA_TRY(hada_launch_fit_fill(grid->slot, HADA_PROGRAM_FIT_CROPPED_DEFAULT, &range, err,
                                      .sums = own->sums->sums[c].mem, .h = own->transfers.mem, .g = own->filled.mem,
                                      .image = hada_fit_image_of(grid, (size_t)c), .step = (cl_float)step));
    }
    return HADA_OK;
}

/* The iteration whose pass is over. */
static hada_status end_pass(hada_fit_cropped *own, hada_error *err)
{
    const int place = own->done % ROUND;
    const double step = own->even || own->done + 1 == own->passes ? 1.0 : lengths[place];
    double left = 0.0;
    own->passing = 0;
    HADA_TRY(read_left(own, &left, err));
    HADA_TRY(fill(own, step, err));
    HADA_TRY(iterate(own, 1, err));
    if (place == 0) { /* what is left is that of the end of a round */
        if (own->round_left > 0.0 && left > (1.0 - LEAST_FALL) * own->round_left)
            own->passes = own->done;
        own->round_left = left;
    }
    return HADA_OK;
}

hada_status hada_fit_cropped_next(hada_fit_cropped *own, int *more, hada_error *err)
{
    hada_slot *slot = own->grid->slot;
    *more = 0;
    if (own->passing)
        HADA_TRY(end_pass(own, err));
    if (own->done >= own->passes)
        return HADA_OK;
    HADA_TRY(hada_buffer_clear(&own->filled, slot, 0, own->filled.bytes, err));
    HADA_TRY(hada_buffer_clear(&own->partial, slot, 0, own->partial.bytes, err));
    *more = own->passing = 1;
    return HADA_OK;
}

/* What transfer functions leave of a frame, in own->frame; its squares are added to the partial sums. */
static hada_status subtract(hada_fit_cropped *own, const hada_buffer *transfers, cl_mem raw, cl_mem weights,
                            cl_mem scene_spectrum, hada_error *err)
{
    const hada_fit_grid *grid = own->grid;
    const int channels = grid->info.channels;
    const hada_fft_filter model = {.product = HADA_FFT_COMPLEX, .filter = transfers->mem, .spectrum_count = channels};
    const size_t local = grid->slot->context->shape == HADA_SHAPE_LANES ? 1 : 32;
    const hada_range chunks = hada_range_of(own->chunks, local, (size_t)channels, 1);
    const double all = (double)channels * (double)own->pixels;
    HADA_TRY(hada_fft_inverse(own->inverse, channels, scene_spectrum, 0, own->frame.mem, 0, &model, err));
    hada_slot_cost(grid->slot, (weights ? 16.0 : 12.0) * all, 3.0 * all);
    return hada_launch_fit_remain(grid->slot, HADA_PROGRAM_FIT_CROPPED_DEFAULT, &chunks, err, .e = own->frame.mem,
                                  .b = raw, .weights = weights, .weighted = weights != NULL, .out = own->partial.mem,
                                  .pixels = own->pixels, .chunks = own->chunks);
}

hada_status hada_fit_cropped_pair(hada_fit_cropped *own, cl_mem raw, cl_mem weights, cl_mem scene_spectrum,
                                  hada_error *err)
{
    const hada_fit_grid *grid = own->grid;
    const int channels = grid->info.channels;
    const size_t vectors = hada_divide_up((size_t)channels * grid->layout.count, HADA_FIT_VECTOR);
    const hada_range range = hada_range_of(vectors, GROUP, 1, 1);
    const double values = (double)vectors * HADA_FIT_VECTOR;
    HADA_TRY(subtract(own, &own->transfers, raw, weights, scene_spectrum, err));
    HADA_TRY(hada_fft_forward(own->pair->raw_fft, channels, own->frame.mem, 0, own->pair->raw_spectrum.mem, 0, err));
    hada_slot_cost(grid->slot, 32.0 * values, 10.0 * values);
    return hada_launch_fit_gather(grid->slot, HADA_FIT_PROGRAM(FIT_WINDOW, 0, hada_fit_in_groups(grid)), &range, err,
                                  .g = own->pair->raw_spectrum.mem, .b = scene_spectrum, .sum = own->filled.mem,
                                  .vectors = vectors);
}

hada_status hada_fit_cropped_gather(hada_fit_cropped *own, const float *transfers, hada_error *err)
{
    const hada_fit_grid *grid = own->grid;
    const size_t bytes = (size_t)grid->info.channels * grid->layout.count * 2 * sizeof(float);
    HADA_TRY(hada_buffer_write(&own->transfers, grid->slot, 0, transfers, bytes, err));
    HADA_TRY(hada_buffer_clear(&own->partial, grid->slot, 0, own->partial.bytes, err));
    return hada_buffer_clear(&own->filled, grid->slot, 0, own->filled.bytes, err);
}

hada_status hada_fit_cropped_gathered(hada_fit_cropped *own, float *sums, hada_error *err)
{
    const hada_fit_grid *grid = own->grid;
    const size_t bytes = (size_t)grid->info.channels * grid->layout.count * 2 * sizeof(float);
    return hada_buffer_read(&own->filled, grid->slot, 0, sums, bytes, err);
}

hada_status hada_fit_cropped_explain(hada_fit_cropped *own, cl_mem raw, cl_mem weights, cl_mem scene_spectrum,
                                     double *left, float *rest, hada_error *err)
{
    HADA_TRY(hada_buffer_clear(&own->partial, own->grid->slot, 0, own->partial.bytes, err));
    HADA_TRY(subtract(own, &own->result, raw, weights, scene_spectrum, err));
    if (rest)
        HADA_TRY(hada_buffer_read(&own->frame, own->grid->slot, 0, rest, own->frame.bytes, err));
    return read_left(own, left, err);
}

/* Pixels of a frame that hold a channel. */
static double seen_of(const hada_model_info *info, int channel)
{
    double seen = 0.0;
    if (info->mosaic == HADA_MOSAIC_NONE)
        return (double)info->raw_rows * info->raw_cols;
    for (int row = 0; row < 2; row++)
        for (int col = 0; col < 2; col++)
            if (hada_mosaic_channel(info->mosaic, row, col) == channel)
                seen += (double)((info->raw_rows + 1 - row) / 2) * ((info->raw_cols + 1 - col) / 2);
    return seen;
}

/* The noise of a channel: what is left, per degree of freedom that the fit did not use, over the frequencies where
 * scenes outweigh the constraint. */
static hada_status noise_of(hada_fit_cropped *own, int c, double *noise, hada_error *err)
{
    const hada_fit_grid *grid = own->grid;
    const size_t count = grid->layout.count;
    double used = 0.0;
    *noise = 0.0;
    if (own->pairs < 2 || !(own->mean[c] > 0.0))
        return HADA_OK;
    HADA_TRY(hada_buffer_read(&own->sums->sums[c], grid->slot, 6 * grid->stride * sizeof(float), own->scenes,
                              count * sizeof(float), err));
    for (size_t i = 0; i < count; i++)
        if (own->often[i] > 0.0f && own->scenes[i] > 0.0f)
            used += own->often[i] * own->scenes[i] / (own->scenes[i] + LAST_WEIGHT * own->mean[c]);
    const double seen = seen_of(&grid->info, c), all = (double)own->pairs * seen;
    *noise = own->left[c] / (double)own->pairs * ((double)own->pixels / seen) / fmax(1.0 - used / all, LEAST_FREE);
    return HADA_OK;
}

hada_status hada_fit_cropped_end(hada_fit_cropped *own, const double *raw_energy, double *noise,
                                 const hada_buffer **transfers, hada_error *err)
{
    const int channels = own->grid->info.channels;
    const hada_nonnegative_data data = data_of(own, 1);
    for (int c = 0; c < channels; c++) {
        HADA_TRY(noise_of(own, c, &noise[c], err));
        own->trust[c] = hada_nonnegative_trust(noise[c], raw_energy[c]);
    }
    HADA_TRY(hada_nonnegative_end(own->nonnegative, channels, &data, own->trust, own->result.mem, err));
    *transfers = &own->result;
    return HADA_OK;
}

const double *hada_fit_cropped_left(const hada_fit_cropped *own)
{
    return own->left;
}
