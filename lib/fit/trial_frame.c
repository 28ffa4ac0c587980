#include "fit/trial_frame.h"

#include <hadalens/response.h>

#include "fit/fit_solve.h"

/* Mean squared errors below this, 200 dB, count as this. */
#define LEAST_ERROR 1e-20

/* Whether refinement has weights of the frames' values, as a reconstruction has. */
static int is_weighted(const hada_trial_bench *bench)
{
    for (int k = 0; k < bench->with->kept->count; k++)
        if (bench->with->kept->pair[k].weights)
            return 1;
    return 0;
}

/* Room for these, of one frame. */
static hada_status make_weights(hada_trial_bench *bench, hada_error *err)
{
    const size_t count = hada_fit_raw_floats(bench->grid);
    if (!is_weighted(bench))
        return HADA_OK;
    HADA_TRY(HADA_NEW_RAW(bench->raw_weights, count, "the weights of pixels", err));
    HADA_TRY(hada_buffer_create(&bench->weights, bench->grid->slot->context, count * sizeof(float),
                                "the weights of pixels", err));
    bench->maker.data.weights = bench->weights.mem;
    return HADA_OK;
}

/* Those of a frame: what one member does not know, or knows a bound of, the sum does not know any better. */
static hada_status weigh(hada_trial_bench *bench, const hada_trial_frame *frame, hada_error *err)
{
    const size_t count = hada_fit_raw_floats(bench->grid);
    float *to = bench->raw_weights;
    if (!to)
        return HADA_OK;
    for (size_t i = 0; i < count; i++)
        to[i] = 1.0f;
    for (int m = 0; m < frame->members; m++) {
        const float *from = frame->member[m]->weights;
        for (size_t i = 0; from && i < count; i++)
            to[i] = to[i] == 0.0f ? 0.0f : from[i] == 1.0f ? to[i] : from[i];
    }
    return hada_buffer_write(&bench->weights, bench->grid->slot, 0, to, bench->weights.bytes, err);
}

/* A frame on the host, and what its noise is compared with. */
typedef struct host_frame {
    hada_pixels pixels;
    double mean_square, largest;
} host_frame;

static host_frame look_at(const hada_fit_grid *grid, const float *raw)
{
    const hada_model_info *info = &grid->info;
    const size_t floats = hada_fit_raw_floats(grid);
    host_frame frame = {.mean_square = hada_trial_energy(raw, floats) / (double)floats};
    hada_pixels_planar(&frame.pixels, raw, HADA_PIXEL_F32, info->channels, info->raw_rows, info->raw_cols);
    for (size_t i = 0; i < floats; i++)
        frame.largest = raw[i] > frame.largest ? raw[i] : frame.largest;
    return frame;
}

/* Geometric means over the kept frames; none if one of them shows no noise. */
static hada_noise_share usual_noise(const hada_trial_bench *bench)
{
    const hada_fit_kept *kept = bench->with->kept;
    double of_light = 0.0, of_largest = 0.0; /* sums of logarithms */
    for (int k = 0; k < kept->count; k++) {
        const host_frame frame = look_at(bench->grid, kept->pair[k].raw);
        const hada_noise_share share =
            hada_noise_share_of(&frame.pixels, bench->grid->info.mosaic, frame.mean_square, frame.largest);
        if (share.of_light <= 0.0)
            return share;
        of_light += log(share.of_light) / kept->count;
        of_largest += log(share.of_largest) / kept->count;
    }
    return (hada_noise_share){exp(of_light), exp(of_largest)};
}

hada_status hada_trial_bench_create(hada_trial_bench *bench, hada_error *err)
{
    const hada_fit_grid *grid = bench->grid;
    const size_t channels = (size_t)grid->info.channels;
    const size_t bytes = hada_fit_spectra_bytes(grid, HADA_FIT_KEPT * channels);
    hada_context *context = grid->slot->context;
    const hada_fft_desc desc = hada_fit_transform_desc(grid, HADA_FFT_INVERSE, 1);
    hada_refine_shape shape = hada_refine_shape_of(&grid->info, HADA_TRIAL_MEMBERS, HADA_TRIAL_MOST_STEPS);
    shape.tv = bench->with->tv != 0.0;
    if (is_weighted(bench))
        shape.boundary = HADA_BOUNDARY_PADDED;
    shape.ridge = bench->with->ridge != 0.0;
    HADA_TRY(hada_refiner_create(&bench->maker.refiner, grid->slot, &shape, err));
    HADA_TRY(hada_fft_create(&bench->inverse, grid->slot, &desc, err));
    HADA_TRY(hada_buffer_create(&bench->filters, context, bytes, "filters on trial", err));
    HADA_TRY(hada_buffer_create(&bench->otfs, context, bytes, "transfer functions on trial", err));
    HADA_TRY(hada_bank_prior(&bench->prior, grid->slot, bench->with->model, &grid->layout, err));
    bench->maker.slot = grid->slot;
    bench->maker.model = bench->with->model;
    bench->maker.boundary = shape.boundary;
    bench->maker.noise_share = usual_noise(bench);
    bench->maker.data = (hada_refine_data){.spectrum = bench->with->pair->raw_spectrum.mem,
                                           .frame = bench->with->pair->raw.mem,
                                           .otf = bench->otfs.mem,
                                           .otf_depths = HADA_FIT_KEPT,
                                           .prior = bench->prior.mem};
    HADA_TRY(make_weights(bench, err));
    HADA_TRY(HADA_NEW_RAW(bench->raw, hada_fit_raw_floats(grid), "a raw frame", err));
    HADA_TRY(HADA_NEW_RAW(bench->planes, HADA_TRIAL_MEMBERS * hada_fit_window_floats(grid), "planes on trial", err));
    HADA_TRY(HADA_NEW_RAW(bench->linear, HADA_TRIAL_MEMBERS * hada_fit_window_floats(grid), "planes on trial", err));
    HADA_TRY(HADA_NEW(bench->scene_energy, channels, "a fitter", err));
    return HADA_NEW(bench->trust, channels, "a fitter", err);
}

void hada_trial_bench_destroy(hada_trial_bench *bench)
{
    hada_slot_finish(bench->grid->slot, NULL);
    hada_refiner_destroy(&bench->maker.refiner);
    hada_fft_destroy(&bench->inverse);
    HADA_DESTROY_BUFFERS(&bench->filters, &bench->otfs, &bench->prior, &bench->weights);
    HADA_FREE(bench->raw, bench->raw_weights, bench->planes, bench->linear, bench->scene_energy, bench->trust);
}

double hada_trial_energy(const float *values, size_t count)
{
    return hada_product(values, values, count);
}

/* Filters and transfer functions of a member's depth without its pair. The pool still counts the pair; that matters
 * only in the ratio of one pair to all pairs of the other depths. */
static hada_status hold_out(hada_trial_bench *bench, const hada_fit_kept_pair *kept, int member, hada_error *err)
{
    const hada_fit_grid *grid = bench->grid;
    const hada_fit_trial *with = bench->with;
    const hada_fit_depth *depth = &with->sums->depth[kept->depth];
    const size_t channels = (size_t)grid->info.channels, window = hada_fit_window_floats(grid) / channels;
    const size_t first = (size_t)member * channels;
    const hada_fit_setting setting = {with->model->info.alpha, with->model->info.lambda};
    HADA_TRY(hada_fit_sums_borrow(with->sums, kept->depth, err));
    HADA_TRY(hada_fit_pair_transform(with->pair, kept->raw, kept->scene, err));
    HADA_TRY(hada_fit_sums_accumulate(with->sums, with->pair, -1.0, err));
    for (size_t c = 0; c < channels; c++) {
        const hada_fit_penalty penalty = hada_fit_penalty_of(setting, depth->raw_energy[c]);
        HADA_TRY(hada_fit_solve_filter(with->sums, (int)c, penalty, bench->filters.mem, first + c, err));
    }
    for (size_t c = 0; c < channels; c++) {
        const double noise = with->model->noise_power[(size_t)kept->depth * channels + c];
        bench->scene_energy[c] =
            fmax(depth->scene_energy[c] - hada_trial_energy(kept->scene + c * window, window), 0.0);
        bench->trust[c] = hada_nonnegative_trust(noise, depth->raw_energy[c]);
    }
    if (kept->transfers)
        return hada_buffer_write(&bench->otfs, grid->slot, first * grid->layout.count * 2 * sizeof(float),
                                 kept->transfers, channels * grid->layout.count * 2 * sizeof(float), err);
    return hada_fit_solve_transfers(with->sums, with->nonnegative, bench->scene_energy, bench->trust, bench->otfs.mem,
                                    first, err);
}

/* Negative light is none. */
static double light_of(float value)
{
    return value > 0.0f ? value : 0.0;
}

/* Means of squared errors of blends in linear light: sums of products of the errors of both give those of all shares.
 */
static void compare_light(const float *planes, const float *linear, const float *scene, size_t floats,
                          const double *shares, int count, double *error)
{
    double both = 0.0, refined = 0.0, filtered = 0.0;
    for (size_t i = 0; i < floats; i++) {
        const double of_planes = light_of(planes[i]) - scene[i], of_linear = light_of(linear[i]) - scene[i];
        refined += of_planes * of_planes;
        both += of_planes * of_linear;
        filtered += of_linear * of_linear;
    }
    for (int k = 0; k < count; k++) {
        const double s = shares[k], t = 1.0 - s;
        error[k] = (s * s * refined + 2.0 * s * t * both + t * t * filtered) / (double)floats;
    }
}

/* The same of encoded scenes, in their encoding, in which results are written: it is the dark parts that count more
 * there. Values are compared at equal distances, some thousand in all. */
static void compare_encoded(double response, const float *planes, const float *linear, const float *scene,
                            size_t floats, const double *shares, int count, double *error)
{
    enum { VALUES = 16384, CHUNK = 256 };
    const size_t step = floats / VALUES | 1, compared = (floats + step - 1) / step;
    for (int k = 0; k < count; k++)
        error[k] = 0.0;
    for (size_t done = 0; done < compared; done += CHUNK) {
        const size_t n = compared - done < CHUNK ? compared - done : CHUNK;
        float truth[CHUNK], blend[CHUNK];
        for (size_t i = 0; i < n; i++)
            truth[i] = scene[(done + i) * step];
        hada_response_convert(truth, n, HADA_RESPONSE_LINEAR, response);
        for (int k = 0; k < count; k++) {
            const float s = (float)shares[k];
            for (size_t i = 0; i < n; i++) {
                const size_t at = (done + i) * step;
                blend[i] = s * fmaxf(planes[at], 0.0f) + (1.0f - s) * fmaxf(linear[at], 0.0f);
            }
            hada_response_convert(blend, n, HADA_RESPONSE_LINEAR, response);
            for (size_t i = 0; i < n; i++) {
                const double difference = (double)blend[i] - truth[i];
                error[k] += difference * difference / (double)compared;
            }
        }
    }
}

void hada_trial_compare(const hada_trial_bench *bench, const hada_trial_frame *frame, const double *shares, int count,
                        double *psnr)
{
    const size_t floats = hada_fit_window_floats(bench->grid);
    const double response = bench->grid->info.scene_response;
    for (int m = 0; m < frame->members; m++) {
        const float *planes = bench->planes + (size_t)m * floats, *linear = bench->linear + (size_t)m * floats;
        const float *scene = frame->member[m]->scene;
        double error[HADA_TRIAL_SHARES];
        if (response != HADA_RESPONSE_LINEAR)
            compare_encoded(response, planes, linear, scene, floats, shares, count, error);
        else
            compare_light(planes, linear, scene, floats, shares, count, error);
        for (int k = 0; k < count; k++)
            psnr[k] -= 10.0 * log10(fmax(error[k], LEAST_ERROR)) / frame->members;
    }
}

hada_status hada_trial_hold_out(hada_trial_bench *bench, const hada_trial_frame *frame, hada_error *err)
{
    for (int m = 0; m < frame->members; m++)
        HADA_TRY(hold_out(bench, frame->member[m], frame->first + m, err));
    return HADA_OK;
}

hada_status hada_trial_expose(hada_trial_bench *bench, const hada_trial_frame *frame, hada_error *err)
{
    const size_t raw = hada_fit_raw_floats(bench->grid);
    memset(bench->raw, 0, raw * sizeof *bench->raw);
    for (int m = 0; m < frame->members; m++)
        for (size_t i = 0; i < raw; i++)
            bench->raw[i] += frame->member[m]->raw[i];
    const host_frame on_host = look_at(bench->grid, bench->raw);
    bench->noise_unit = hada_noise_unit(&on_host.pixels, bench->grid->info.mosaic, &bench->maker.noise_share,
                                        on_host.mean_square, on_host.largest);
    HADA_TRY(weigh(bench, frame, err));
    return hada_fit_pair_transform(bench->with->pair, bench->raw, NULL, err);
}

hada_status hada_trial_filter(hada_trial_bench *bench, const hada_trial_frame *frame, hada_error *err)
{
    const hada_fit_grid *grid = bench->grid;
    hada_fit_pair *pair = bench->with->pair;
    const size_t count = hada_fit_window_floats(grid);
    for (int m = 0; m < frame->members; m++) {
        const hada_fft_filter of = hada_fit_product(grid, bench->filters.mem, (frame->first + m) * grid->info.channels);
        /* the scene's place on the device is free by now */
        HADA_TRY(hada_fit_pair_filter(pair, bench->inverse, &of, err));
        HADA_TRY(
            hada_buffer_read(&pair->scene, grid->slot, 0, bench->planes + (size_t)m * count, pair->scene.bytes, err));
    }
    return HADA_OK;
}

hada_status hada_trial_refine(hada_trial_bench *bench, const hada_trial_frame *frame,
                              const hada_refine_weights *weights, const hada_maker_steps *steps, int ends,
                              hada_error *err)
{
    const int list[HADA_TRIAL_MEMBERS] = {frame->first, frame->first + 1};
    hada_plane_maker *maker = &bench->maker;
    maker->weights = *weights;
    const int last = ends ? hada_maker_ridge_steps(maker, steps->before + steps->steps) : 0;
    int done;
    HADA_TRY(hada_maker_refine(maker, steps, bench->noise_unit, frame->members, list, &done, err));
    HADA_TRY(hada_maker_regularise(maker, last, 0.0, frame->members, list, &done, err));
    return hada_maker_read(maker, hada_refiner_planes(maker->refiner), 0, frame->members, bench->planes, err);
}
