#include "fit/trial.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "filter/bank.h"
#include "fit/fit_solve.h"
#include "refine/admm.h"

/* Steps after which a refined plane is compared; 0 is the linear filter. */
static const int steps_tried[] = {0, 4, 8, 12, 16};
enum { TRIED = sizeof steps_tried / sizeof *steps_tried, MEMBERS = 2 };

/* Weights of total variation that are tried, by what the noise says: the best of simulated cameras with 0.3 to 3 %
 * noise were about 0.1 of its standard deviation over the rms of the pairs' frames (docs/refinement.md). That and a
 * step of TV_RATIO to both sides, one more where the outermost is best; the best of all lies where a parabola through
 * three has its top. A few steps on one depth rank them as many on two do; where the sensor crops they settle later. */
enum { TV_SIDE = 2, TV_PLACES = 2 * TV_SIDE + 1, TV_STEPS = 6, TV_STEPS_CROPPED = 12 };
#define TV_RATIO     1.6
#define TV_PER_NOISE 0.1
#define TV_UNKNOWN   0.003
#define TV_LEAST     1e-5

/* Weights of colour that are tried beside HADA_REFINE_COLOUR. The heavier colour is, the less total variation is
 * needed: by this power of the weights' ratio (docs/refinement.md). */
static const double colours_tried[] = {1.0, 2.0, 3.0};
#define TV_PER_COLOUR 0.6

/* Thresholds of shrinkage that are tried, where total variation alone serves a single depth less well. */
static const double shrinks_tried[] = {1.0, HADA_REFINE_SHRINK, 2.5};

_Static_assert((int)TRIED + (int)TV_SIDE + 2 + 1 <= (int)HADA_FIT_TRIAL_ROWS, "room for rows");

/* A reconstruction stops by itself once its residual has settled, so the number of steps to keep is the largest that
 * still has most of the best gain; the sum of two whole scenes is a hard case and its curve is uneven. Gains below a
 * hundredth of a decibel are none. */
#define MOST_OF_THE_GAIN 0.8
#define LEAST_GAIN       0.01

/* Shares of refined planes that are tried, the rest being the linear filter's: where the camera is known badly, the two
 * err differently (L. Breiman, "Stacked regressions", Machine Learning 24, 1996). Less than a fifth of a decibel is not
 * worth filtering as well. */
static const double shares_tried[] = {1.0, 0.75, 0.5, 0.25};
enum { SHARES = sizeof shares_tried / sizeof *shares_tried };
#define SHARE_GAIN 0.2

/* Mean squared errors below this, 200 dB, count as this. */
#define LEAST_ERROR 1e-20

typedef struct trial_work {
    const hada_fit_trial *with;
    const hada_fit_grid *grid;
    hada_refiner *refiner;
    hada_fft *inverse;
    hada_buffer filters, otfs; /* [member][channel][count] complex */
    hada_buffer prior;
    float *raw, *planes, *linear; /* planes at hand, and those of the linear filters */
    double *scene_energy, *trust; /* per channel; without a pair, and the model's */
    double sum[2][TRIED][SHARES]; /* decibels: one depth, two depths */
    int count[2];
    hada_refine_weights weights; /* what is refined with */
    int rank_steps;              /* after which weights are compared */
    hada_fit_refine_score tv_rows[1 + TV_SIDE + 2];
    int tv_count;
} trial_work;

static hada_status work_create(trial_work *work, hada_error *err)
{
    const hada_fit_grid *grid = work->grid;
    const size_t channels = (size_t)grid->info.channels;
    const size_t bytes = hada_fit_spectra_bytes(grid, MEMBERS * channels);
    hada_context *context = grid->slot->context;
    const hada_fft_desc desc = hada_fit_transform_desc(grid, HADA_FFT_INVERSE, 1);
    hada_refine_shape shape = hada_refine_shape_of(&grid->info, MEMBERS, steps_tried[TRIED - 1]);
    hada_status status = HADA_OK;
    shape.tv = work->with->tv != 0.0;
    HADA_TRY(hada_refiner_create(&work->refiner, grid->slot, NULL, &shape, err));
    HADA_TRY(hada_fft_create(&work->inverse, grid->slot, &desc, err));
    HADA_TRY(hada_buffer_create(&work->filters, context, bytes, "filters on trial", err));
    HADA_TRY(hada_buffer_create(&work->otfs, context, bytes, "transfer functions on trial", err));
    HADA_TRY(hada_bank_prior(&work->prior, grid->slot, work->with->model, &grid->layout, err));
    HADA_TRY(hada_alloc_raw((void **)&work->raw, hada_fit_raw_floats(grid), sizeof(float), "a raw frame", err));
    HADA_TRY(hada_alloc_raw((void **)&work->planes, MEMBERS * hada_fit_window_floats(grid), sizeof(float),
                            "planes on trial", err));
    HADA_TRY(hada_alloc_raw((void **)&work->linear, MEMBERS * hada_fit_window_floats(grid), sizeof(float),
                            "planes on trial", err));
    HADA_TRY(hada_alloc((void **)&work->scene_energy, channels, sizeof(double), "a fitter", err));
    HADA_TRY(hada_alloc((void **)&work->trust, channels, sizeof(double), "a fitter", err));
done:
    return status;
}

static void work_destroy(trial_work *work)
{
    hada_slot_finish(work->grid->slot, NULL);
    hada_refiner_destroy(&work->refiner);
    hada_fft_destroy(&work->inverse);
    hada_buffer_destroy(&work->filters);
    hada_buffer_destroy(&work->otfs);
    hada_buffer_destroy(&work->prior);
    free(work->raw);
    free(work->planes);
    free(work->linear);
    free(work->scene_energy);
    free(work->trust);
}

static double energy(const float *values, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += (double)values[i] * values[i];
    return sum;
}

/* Filters and transfer functions of a member's depth without its pair. The pool still counts the pair; that matters
 * only in the ratio of one pair to all pairs of the other depths. */
static hada_status hold_out(trial_work *work, const hada_fit_kept_pair *kept, int member, hada_error *err)
{
    const hada_fit_grid *grid = work->grid;
    const hada_fit_trial *with = work->with;
    const hada_fit_depth *depth = &with->sums->depth[kept->depth];
    const size_t channels = (size_t)grid->info.channels, window = hada_fit_window_floats(grid) / channels;
    const size_t first = (size_t)member * channels;
    const hada_fit_setting setting = {with->model->info.alpha, with->model->info.lambda};
    hada_status status = HADA_OK;
    HADA_TRY(hada_fit_sums_borrow(with->sums, kept->depth, err));
    HADA_TRY(hada_fit_pair_transform(with->pair, kept->raw, kept->scene, err));
    HADA_TRY(hada_fit_sums_accumulate(with->sums, with->pair, -1.0, err));
    for (size_t c = 0; c < channels; c++) {
        const hada_fit_penalty penalty = hada_fit_penalty_of(setting, depth->raw_energy[c]);
        HADA_TRY(hada_fit_solve_filter(with->sums, (int)c, penalty, work->filters.mem, first + c, err));
    }
    for (size_t c = 0; c < channels; c++) {
        const double noise = with->model->noise_power[(size_t)kept->depth * channels + c];
        work->scene_energy[c] = fmax(depth->scene_energy[c] - energy(kept->scene + c * window, window), 0.0);
        work->trust[c] = hada_nonnegative_trust(noise, depth->raw_energy[c]);
    }
    if (kept->transfers)
        return hada_buffer_write(&work->otfs, grid->slot, first * grid->layout.count * 2 * sizeof(float),
                                 kept->transfers, channels * grid->layout.count * 2 * sizeof(float), err);
    HADA_TRY(hada_fit_solve_transfers(with->sums, with->nonnegative, work->scene_energy, work->trust, work->otfs.mem,
                                      first, err));
done:
    return status;
}

/* A frame on trial: of one pair, or the sum of two, whose filters stand at the places from `first` on. */
typedef struct trial_frame {
    const hada_fit_kept_pair *member[MEMBERS];
    int members, first;
} trial_frame;

/* PSNR of planes (negative light clipped, as reconstruction does), blended with linear ones where their share is below
 * 1, against the members' scenes, mean over members. */
static double compare(const trial_work *work, const trial_frame *frame, double share)
{
    const size_t count = hada_fit_window_floats(work->grid);
    double total = 0.0;
    for (int m = 0; m < frame->members; m++) {
        double sum = 0.0;
        for (size_t i = 0; i < count; i++) {
            const size_t at = (size_t)m * count + i;
            double plane = fmax((double)work->planes[at], 0.0);
            if (share < 1.0)
                plane = share * plane + (1.0 - share) * fmax((double)work->linear[at], 0.0);
            const double error = plane - frame->member[m]->scene[i];
            sum += error * error;
        }
        total -= 10.0 * log10(fmax(sum / (double)count, LEAST_ERROR));
    }
    return total / frame->members;
}

static hada_status hold_out_members(trial_work *work, const trial_frame *frame, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int m = 0; m < frame->members; m++)
        HADA_TRY(hold_out(work, frame->member[m], frame->first + m, err));
done:
    return status;
}

/* The frame's pixels and spectrum. */
static hada_status expose(trial_work *work, const trial_frame *frame, hada_error *err)
{
    const size_t raw = hada_fit_raw_floats(work->grid);
    memset(work->raw, 0, raw * sizeof *work->raw);
    for (int m = 0; m < frame->members; m++)
        for (size_t i = 0; i < raw; i++)
            work->raw[i] += frame->member[m]->raw[i];
    return hada_fit_pair_transform(work->with->pair, work->raw, NULL, err);
}

static hada_status filter(trial_work *work, const trial_frame *frame, hada_error *err)
{
    const hada_fit_grid *grid = work->grid;
    hada_fit_pair *pair = work->with->pair;
    const size_t count = hada_fit_window_floats(grid);
    hada_status status = HADA_OK;
    for (int m = 0; m < frame->members; m++) {
        const hada_fft_filter of = hada_fit_product(grid, work->filters.mem, (frame->first + m) * grid->info.channels);
        /* the scene's place on the device is free by now */
        HADA_TRY(hada_fit_pair_filter(pair, work->inverse, &of, err));
        HADA_TRY(
            hada_buffer_read(&pair->scene, grid->slot, 0, work->planes + (size_t)m * count, pair->scene.bytes, err));
    }
done:
    return status;
}

/* The refined planes of so many members, to the host. */
static hada_status read_planes(trial_work *work, int members, hada_error *err)
{
    hada_slot *slot = work->grid->slot;
    const size_t bytes = (size_t)members * hada_fit_window_floats(work->grid) * sizeof(float);
    const cl_int code = clEnqueueReadBuffer(slot->queue, hada_refiner_planes(work->refiner), CL_TRUE, 0, bytes,
                                            work->planes, 0, NULL, hada_slot_event(slot));
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueReadBuffer");
    hada_slot_moved(slot, "read", (double)bytes);
    return HADA_OK;
}

/* `steps` further steps of refinement after `before` others, or the first ones; the planes come to the host. */
static hada_status refine(trial_work *work, const trial_frame *frame, const hada_refine_weights *weights, int before,
                          int steps, hada_error *err)
{
    const hada_fit_trial *with = work->with;
    const size_t raw = hada_fit_raw_floats(work->grid);
    const int list[MEMBERS] = {frame->first, frame->first + 1};
    const hada_refine_data data = {.spectrum = with->pair->raw_spectrum.mem,
                                   .frame = with->pair->raw.mem,
                                   .otf = work->otfs.mem,
                                   .otf_depths = MEMBERS,
                                   .prior = work->prior.mem};
    hada_refine_rule rule;
    hada_refine_rule_init(&rule);
    hada_refine_rule_weigh(&rule, &with->model->info, weights, frame->members, hada_model_gain(with->model),
                           energy(work->raw, raw) / (double)raw);
    rule.stop = 0.0;
    rule.steps = steps;
    rule.start = before ? HADA_REFINE_CONTINUE : HADA_REFINE_COLD;
    rule.before = before;
    hada_status status = hada_refiner_run(work->refiner, &data, &rule, 1, frame->members, list, NULL, err);
    return status ? status : read_planes(work, frame->members, err);
}

/* Every number of steps. */
static hada_status try_frame(trial_work *work, const trial_frame *frame, hada_error *err)
{
    double(*sum)[SHARES] = work->sum[frame->members - 1];
    hada_status status = HADA_OK;
    HADA_TRY(expose(work, frame, err));
    HADA_TRY(filter(work, frame, err));
    memcpy(work->linear, work->planes,
           (size_t)frame->members * hada_fit_window_floats(work->grid) * sizeof *work->linear);
    for (int s = 0; s < SHARES; s++)
        sum[0][s] += compare(work, frame, 1.0);
    for (int i = 1; i < TRIED; i++) {
        HADA_TRY(refine(work, frame, &work->weights, steps_tried[i - 1], steps_tried[i] - steps_tried[i - 1], err));
        for (int s = 0; s < SHARES; s++)
            sum[i][s] += compare(work, frame, shares_tried[s]);
    }
    work->count[frame->members - 1]++;
done:
    return status;
}

/* The weight of total variation that the noise of the camera and the light of a frame suggest. */
static double guess_weight(const trial_work *work, const trial_frame *frame)
{
    const hada_model_info *info = &work->grid->info;
    const size_t images = (size_t)info->depths * (size_t)info->channels;
    const double light = energy(frame->member[0]->raw, hada_fit_raw_floats(work->grid)) / (double)info->channels;
    double noise = 0.0;
    for (size_t i = 0; i < images; i++)
        noise += work->with->model->noise_power[i] / (double)images;
    return fmax(noise > 0.0 && light > 0.0 ? TV_PER_NOISE * sqrt(noise / light) : TV_UNKNOWN, TV_LEAST);
}

/* Frames of one pair each, whose filters are held out by now. */
typedef struct trial_set {
    const trial_frame *frames;
    int count;
} trial_set;

/* Mean decibels of the frames with some weights. */
static hada_status rank(trial_work *work, const trial_set *set, const hada_refine_weights *weights, double *psnr,
                        hada_error *err)
{
    hada_status status = HADA_OK;
    *psnr = 0.0;
    for (int k = 0; k < set->count; k++) {
        HADA_TRY(expose(work, &set->frames[k], err));
        HADA_TRY(refine(work, &set->frames[k], weights, 0, work->rank_steps, err));
        *psnr += compare(work, &set->frames[k], 1.0) / set->count;
    }
done:
    return status;
}

/* The same, with a row of the table. */
static hada_status rank_tv(trial_work *work, const trial_set *set, double tv, double *psnr, hada_error *err)
{
    const hada_model_info *info = &work->with->model->info;
    const hada_refine_weights weights = {tv, work->weights.colour, 0.0};
    const hada_status status = rank(work, set, &weights, psnr, err);
    work->tv_rows[work->tv_count++] = (hada_fit_refine_score){.steps = work->rank_steps,
                                                              .rho = hada_refine_rho(info->boundary, tv),
                                                              .tv = tv,
                                                              .psnr_single = *psnr,
                                                              .psnr_double = NAN};
    return status;
}

/* The top of a parabola through three values a step apart, the middle one the largest, in steps from it. */
static double parabola_top(double left, double middle, double right)
{
    const double bend = left - 2.0 * middle + right;
    return bend < 0.0 ? 0.5 * (left - right) / bend : 0.0;
}

/* Chooses the weight of total variation, 0 where the prior of the pairs is better. */
static hada_status choose_tv(trial_work *work, const trial_set *set, double *psnr, hada_error *err)
{
    const double guess = guess_weight(work, set->frames);
    double value[TV_PLACES], none;
    int best = TV_SIDE;
    hada_status status = HADA_OK;
    HADA_TRY(rank_tv(work, set, 0.0, &none, err));
    for (int i = TV_SIDE - 1; i <= TV_SIDE + 1; i++) {
        HADA_TRY(rank_tv(work, set, guess * pow(TV_RATIO, i - TV_SIDE), &value[i], err));
        if (value[i] > value[best])
            best = i;
    }
    const int outer = best < TV_SIDE ? 0 : TV_PLACES - 1;
    if (best != TV_SIDE) {
        HADA_TRY(rank_tv(work, set, guess * pow(TV_RATIO, outer - TV_SIDE), &value[outer], err));
        if (value[outer] > value[best])
            best = outer;
    }
    const double top = best == outer ? 0.0 : parabola_top(value[best - 1], value[best], value[best + 1]);
    *psnr = value[best];
    work->weights.tv = value[best] > none ? guess * pow(TV_RATIO, best - TV_SIDE + top) : 0.0;
done:
    return status;
}

/* Chooses the weight of colour; psnr: with the weights at hand. */
static hada_status choose_colour(trial_work *work, const trial_set *set, double *psnr, hada_error *err)
{
    const hada_refine_weights now = work->weights;
    hada_status status = HADA_OK;
    for (size_t i = 0; i < HADA_COUNT(colours_tried); i++) {
        const double ratio = now.colour / colours_tried[i];
        const hada_refine_weights weights = {now.tv * pow(ratio, TV_PER_COLOUR), colours_tried[i], 0.0};
        double value;
        HADA_TRY(rank(work, set, &weights, &value, err));
        if (value > *psnr) {
            *psnr = value;
            work->weights = weights;
        }
    }
done:
    return status;
}

/* Chooses the threshold of shrinkage; psnr: without it. */
static hada_status choose_shrink(trial_work *work, const trial_set *set, double psnr, hada_error *err)
{
    hada_refine_weights weights = work->weights;
    hada_status status = HADA_OK;
    work->weights.shrink = 0.0;
    for (size_t i = 0; i < HADA_COUNT(shrinks_tried); i++) {
        double value;
        weights.shrink = shrinks_tried[i];
        HADA_TRY(rank(work, set, &weights, &value, err));
        if (value > psnr) {
            psnr = value;
            work->weights = weights;
        }
    }
done:
    return status;
}

static hada_status choose_weights(trial_work *work, const trial_set *set, hada_error *err)
{
    double psnr;
    hada_status status = HADA_OK;
    HADA_TRY(choose_tv(work, set, &psnr, err));
    if (work->weights.tv > 0.0 && work->with->colour < 0.0 && work->grid->info.channels > 1)
        HADA_TRY(choose_colour(work, set, &psnr, err));
    if (work->weights.tv > 0.0 && work->with->shrink < 0.0)
        HADA_TRY(choose_shrink(work, set, psnr, err));
done:
    return status;
}

/* Frames of one pair, MEMBERS at a time: the weight is chosen on the first of them. */
static hada_status try_singles(trial_work *work, hada_error *err)
{
    const hada_fit_kept *kept = work->with->kept;
    const int step = work->grid->info.depths == 1 ? 1 : HADA_FIT_KEPT - 1;
    hada_status status = HADA_OK;
    for (int k = 0; k < kept->count;) {
        trial_frame frames[MEMBERS];
        const int choose = k == 0 && work->with->tv < 0.0;
        int count = 0;
        for (; count < MEMBERS && k < kept->count; k += step, count++) {
            frames[count] = (trial_frame){{&kept->pair[k]}, 1, count};
            HADA_TRY(hold_out_members(work, &frames[count], err));
        }
        if (choose)
            HADA_TRY(choose_weights(work, &(trial_set){frames, count}, err));
        for (int i = 0; i < count; i++)
            HADA_TRY(try_frame(work, &frames[i], err));
    }
done:
    return status;
}

/* Frames that are the sum of two depths' pairs. */
static hada_status try_doubles(trial_work *work, hada_error *err)
{
    const hada_fit_kept *kept = work->with->kept;
    hada_status status = HADA_OK;
    for (int k = 0; k + 2 < kept->count; k++) {
        const trial_frame two = {{&kept->pair[k], &kept->pair[k + 2]}, 2, 0};
        if (two.member[0]->depth == two.member[1]->depth)
            continue;
        HADA_TRY(hold_out_members(work, &two, err));
        HADA_TRY(try_frame(work, &two, err));
    }
done:
    return status;
}

static double mean(const trial_work *work, int occupied, int i, int share)
{
    return work->count[occupied] ? work->sum[occupied][i][share] / work->count[occupied] : 0.0;
}

static double blend_score(const trial_work *work, int i, int share)
{
    return mean(work, 0, i, share) + mean(work, 1, i, share);
}

/* The share after so many steps: refined planes alone, unless another one is clearly better. */
static int share_of(const trial_work *work, int i)
{
    int best = 0;
    for (int s = 1; s < SHARES; s++)
        if (blend_score(work, i, s) > blend_score(work, i, best))
            best = s;
    return blend_score(work, i, best) - blend_score(work, i, 0) > SHARE_GAIN ? best : 0;
}

static double score(const trial_work *work, int i)
{
    return blend_score(work, i, share_of(work, i));
}

/* Which number of steps to keep. */
static int best_of(const trial_work *work)
{
    int best = 0, chosen = 0;
    for (int i = 1; i < TRIED; i++)
        if (score(work, i) > score(work, best))
            best = i;
    const double gain = score(work, best) - score(work, 0);
    for (int i = 1; gain > LEAST_GAIN && i < TRIED; i++)
        if (score(work, i) - score(work, 0) >= MOST_OF_THE_GAIN * gain)
            chosen = i;
    return chosen;
}

/* The numbers of steps, then the weights that were compared. */
static void fill_rows(const trial_work *work, int best, hada_fit_trial_result *result)
{
    const hada_model_info *info = &work->with->model->info;
    result->row_count = TRIED + work->tv_count;
    for (int k = 0; k < TRIED; k++) {
        const double tv = k ? work->weights.tv : 0.0;
        result->rows[k] =
            (hada_fit_refine_score){.steps = steps_tried[k],
                                    .rho = hada_refine_rho(info->boundary, tv),
                                    .tv = tv,
                                    .psnr_single = work->count[0] ? mean(work, 0, k, share_of(work, k)) : NAN,
                                    .psnr_double = work->count[1] ? mean(work, 1, k, share_of(work, k)) : NAN,
                                    .chosen = k == best};
    }
    memcpy(result->rows + TRIED, work->tv_rows, (size_t)work->tv_count * sizeof *work->tv_rows);
}

hada_status hada_fit_trial_run(const hada_fit_trial *trial, hada_fit_trial_result *result, hada_error *err)
{
    const int cropped = trial->sums->grid->info.boundary == HADA_BOUNDARY_PADDED;
    trial_work work = {.with = trial,
                       .grid = trial->sums->grid,
                       .weights = {fmax(trial->tv, 0.0), trial->colour >= 0.0 ? trial->colour : HADA_REFINE_COLOUR,
                                   trial->shrink >= 0.0 ? trial->shrink : HADA_REFINE_SHRINK},
                       .rank_steps = cropped ? TV_STEPS_CROPPED : TV_STEPS};
    hada_status status = HADA_OK;
    HADA_TRY(work_create(&work, err));
    HADA_TRY(try_singles(&work, err));
    HADA_TRY(try_doubles(&work, err));
    const int best = best_of(&work);
    *result = (hada_fit_trial_result){.steps = steps_tried[best],
                                      .share = best ? shares_tried[share_of(&work, best)] : 1.0,
                                      .weights = work.weights,
                                      .gain = score(&work, best) - score(&work, 0)};
    if (!best)
        result->weights.tv = 0.0;
    fill_rows(&work, best, result);
done:
    work_destroy(&work);
    return status;
}
