/* Does refinement pay for this camera, and which weight of total variation? Measured by leave-one-out on a few pairs,
 * alone and two depths at once. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "filter/bank.h"
#include "fit/fitter.h"
#include "refine/admm.h"

/* Steps after which a refined plane is looked at; 0 is the linear filter. */
static const int steps_tried[] = {0, 4, 8, 12, 16};
enum { TRIED = sizeof steps_tried / sizeof *steps_tried, MEMBERS = 2 };

/* Weights of total variation that are tried, by what the noise says: the best of simulated cameras with 0.3 to 3 %
 * noise were about 0.1 of its standard deviation over the rms of the pairs' frames (docs/refinement.md). 0: the prior
 * of the pairs. A few steps on one depth rank them as many on two do. */
static const double tv_tried[] = {0.0, 0.63, 1.0, 1.6};
enum { TV_TRIED = sizeof tv_tried / sizeof *tv_tried, TV_STEPS = 6 };
#define TV_PER_NOISE 0.1
#define TV_UNKNOWN   0.003
#define TV_LEAST     1e-5

#define MOST_OF_THE_GAIN 0.8

/* Depths whose pairs are kept: the first scored ones of HADA_FIT_KEPT depths spread over all. */
static int kept_depth(const hada_fitter *fitter, int k)
{
    return (k * (fitter->info.depths - 1) + (HADA_FIT_KEPT - 1) / 2) / (HADA_FIT_KEPT - 1);
}

hada_status hada_fitter_keep(hada_fitter *fitter, int depth, hada_error *err)
{
    int wanted = 0;
    for (int k = 0; k < HADA_FIT_KEPT; k++)
        wanted += kept_depth(fitter, k) == depth;
    for (int k = 0; k < fitter->kept_count; k++)
        wanted -= fitter->kept[k].depth == depth;
    if (wanted <= 0 || fitter->options.refine_steps >= 0 || fitter->kept_count == HADA_FIT_KEPT)
        return HADA_OK;
    hada_fitter_kept *kept = &fitter->kept[fitter->kept_count];
    hada_status status = hada_alloc_raw((void **)&kept->raw, fitter->raw.bytes, 1, "a raw frame", err);
    if (!status)
        status = hada_alloc_raw((void **)&kept->scene, fitter->scene.bytes, 1, "a scene", err);
    if (status) {
        free(kept->raw);
        *kept = (hada_fitter_kept){0};
        return status;
    }
    kept->depth = depth;
    memcpy(kept->raw, fitter->raw_pixels, fitter->raw.bytes);
    memcpy(kept->scene, fitter->scene_pixels, fitter->scene.bytes);
    fitter->kept_count++;
    return HADA_OK;
}

void hada_fitter_drop_kept(hada_fitter *fitter)
{
    for (int k = 0; k < fitter->kept_count; k++) {
        free(fitter->kept[k].raw);
        free(fitter->kept[k].scene);
        fitter->kept[k] = (hada_fitter_kept){0};
    }
    fitter->kept_count = 0;
}

typedef struct trial_work {
    const hada_model *model;
    hada_refiner *refiner;
    hada_fft *inverse;
    hada_buffer filters, otfs; /* [member][channel][count] complex */
    hada_buffer prior;
    float *raw, *planes;
    double *scene_energy, *trust; /* per channel; without a pair, and the model's */
    double sum[2][TRIED];         /* decibels: one depth, two depths */
    int count[2];
    double tv;            /* what is refined with */
    double tvs[TV_TRIED]; /* weights compared, and decibels after TV_STEPS steps */
    double tv_sum[TV_TRIED];
    int tv_count;
} trial_work;

static hada_status work_create(trial_work *work, hada_fitter *fitter, hada_error *err)
{
    const hada_model_info *info = &fitter->info;
    const size_t images = MEMBERS * (size_t)info->channels, bytes = images * fitter->layout.count * 8 + 64;
    hada_refine_shape shape = hada_refine_shape_of(info, MEMBERS, steps_tried[TRIED - 1]);
    shape.tv = fitter->options.refine_tv != 0.0;
    const size_t window = (size_t)info->window_rows * (size_t)info->window_cols;
    const hada_fft_desc desc = {.direction = HADA_FFT_INVERSE,
                                .rows = info->grid_rows,
                                .cols = info->grid_cols,
                                .batch = info->channels,
                                .row0 = fitter->geometry.window_row,
                                .col0 = fitter->geometry.window_col,
                                .real_rows = info->window_rows,
                                .real_cols = info->window_cols,
                                .real_pitch = (size_t)info->window_cols,
                                .real_distance = window};
    hada_status status = hada_refiner_create(&work->refiner, fitter->slot, &shape, err);
    if (!status)
        status = hada_fft_create(&work->inverse, fitter->slot, &desc, err);
    if (!status)
        status = hada_buffer_create(&work->filters, fitter->context, bytes, "filters on trial", err);
    if (!status)
        status = hada_buffer_create(&work->otfs, fitter->context, bytes, "transfer functions on trial", err);
    if (!status)
        status = hada_bank_prior(&work->prior, fitter->slot, work->model, &fitter->layout, err);
    if (!status)
        status = hada_alloc_raw((void **)&work->raw, fitter->raw.bytes, 1, "a raw frame", err);
    if (!status)
        status = hada_alloc_raw((void **)&work->planes, images * window, sizeof(float), "planes on trial", err);
    if (!status)
        status = hada_alloc((void **)&work->scene_energy, (size_t)info->channels, sizeof(double), "a fitter", err);
    if (!status)
        status = hada_alloc((void **)&work->trust, (size_t)info->channels, sizeof(double), "a fitter", err);
    return status;
}

static void work_destroy(trial_work *work, hada_fitter *fitter)
{
    hada_slot_finish(fitter->slot, NULL);
    hada_refiner_destroy(&work->refiner);
    hada_fft_destroy(&work->inverse);
    hada_buffer_destroy(&work->filters);
    hada_buffer_destroy(&work->otfs);
    hada_buffer_destroy(&work->prior);
    free(work->raw);
    free(work->planes);
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
static hada_status hold_out(trial_work *work, hada_fitter *fitter, const hada_fitter_kept *kept, int member,
                            hada_error *err)
{
    const hada_fitter_depth *depth = &fitter->depth[kept->depth];
    const size_t channels = (size_t)fitter->info.channels;
    const size_t window = (size_t)fitter->info.window_rows * (size_t)fitter->info.window_cols;
    hada_status status = hada_fitter_select(fitter, kept->depth, err);
    if (!status && fitter->changed)
        status = hada_fitter_put_back(fitter, err);
    if (!status)
        status = hada_fitter_transform(fitter, kept->raw, kept->scene, err);
    if (!status)
        status = hada_fitter_accumulate(fitter, -1.0, err);
    fitter->current = -1; /* the host's copy is the true one from here on */
    for (size_t c = 0; !status && c < channels; c++) {
        const size_t at = ((size_t)member * channels + c) * fitter->layout.count;
        const double ridge = work->model->info.lambda * depth->raw_energy[c];
        status = hada_fitter_solve_filter(fitter, (int)c, work->model->info.alpha, ridge, work->filters.mem, at, err);
    }
    for (size_t c = 0; !status && c < channels; c++) {
        const double noise = work->model->noise_power[(size_t)kept->depth * channels + c];
        work->scene_energy[c] = fmax(depth->scene_energy[c] - energy(kept->scene + c * window, window), 0.0);
        work->trust[c] = hada_nonnegative_trust(noise, depth->raw_energy[c]);
    }
    if (!status)
        status = hada_fitter_solve_transfers(fitter, work->scene_energy, work->trust, work->otfs.mem,
                                             (size_t)member * channels * fitter->layout.count, err);
    return status;
}

/* A frame on trial: of one pair, or the sum of two, whose filters stand at the places from `first` on. */
typedef struct trial_frame {
    const hada_fitter_kept *member[MEMBERS];
    int members, first;
} trial_frame;

/* PSNR of planes (negative light clipped, as reconstruction does) against the members' scenes, mean over members. */
static double compare(const trial_work *work, const hada_fitter *fitter, const trial_frame *frame)
{
    const size_t count = fitter->scene.bytes / sizeof(float);
    double total = 0.0;
    for (int m = 0; m < frame->members; m++) {
        double sum = 0.0;
        for (size_t i = 0; i < count; i++) {
            const double error = fmax((double)work->planes[(size_t)m * count + i], 0.0) - frame->member[m]->scene[i];
            sum += error * error;
        }
        total -= 10.0 * log10(fmax(sum / (double)count, 1e-20));
    }
    return total / frame->members;
}

static hada_status hold_out_members(trial_work *work, hada_fitter *fitter, const trial_frame *frame, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int m = 0; !status && m < frame->members; m++)
        status = hold_out(work, fitter, frame->member[m], frame->first + m, err);
    return status;
}

/* The frame's pixels and spectrum. */
static hada_status expose(trial_work *work, hada_fitter *fitter, const trial_frame *frame, hada_error *err)
{
    const size_t raw = fitter->raw.bytes / sizeof(float);
    memset(work->raw, 0, fitter->raw.bytes);
    for (int m = 0; m < frame->members; m++)
        for (size_t i = 0; i < raw; i++)
            work->raw[i] += frame->member[m]->raw[i];
    return hada_fitter_transform(fitter, work->raw, NULL, err);
}

static hada_status linear(trial_work *work, hada_fitter *fitter, const trial_frame *frame, hada_error *err)
{
    const int channels = fitter->info.channels;
    const size_t count = fitter->scene.bytes / sizeof(float);
    hada_status status = HADA_OK;
    for (int m = 0; !status && m < frame->members; m++) {
        const hada_fft_filter filter = {.product =
                                            fitter->sum_count == HADA_FIT_SUMS ? HADA_FFT_COMPLEX : HADA_FFT_SPLIT,
                                        .filter = work->filters.mem,
                                        .spectrum_count = channels,
                                        .filter_first = (frame->first + m) * channels};
        /* the scene's place on the device is free by now */
        status = hada_fft_inverse(work->inverse, channels, fitter->b.mem, 0, fitter->scene.mem, 0, &filter, err);
        if (!status)
            status = hada_buffer_read(&fitter->scene, fitter->slot, 0, work->planes + (size_t)m * count,
                                      fitter->scene.bytes, err);
    }
    return status;
}

/* `steps` further steps of refinement with weight tv, or the first ones; the planes come to the host. */
static hada_status refine(trial_work *work, hada_fitter *fitter, const trial_frame *frame, double tv, int steps,
                          int cold, hada_error *err)
{
    const size_t raw = fitter->raw.bytes / sizeof(float), bytes = (size_t)frame->members * fitter->scene.bytes;
    const int list[MEMBERS] = {frame->first, frame->first + 1};
    const hada_refine_data data = {.spectrum = fitter->b.mem,
                                   .frame = fitter->raw.mem,
                                   .otf = work->otfs.mem,
                                   .otf_depths = MEMBERS,
                                   .prior = work->prior.mem};
    hada_refine_rule rule;
    hada_refine_rule_init(&rule);
    hada_refine_rule_weigh(&rule, &work->model->info, tv, hada_model_gain(work->model),
                           energy(work->raw, raw) / (double)raw);
    rule.stop = 0.0;
    rule.steps = steps;
    rule.start = cold ? HADA_REFINE_COLD : HADA_REFINE_ON;
    hada_status status = hada_refiner_run(work->refiner, &data, &rule, 1, frame->members, list, NULL, err);
    if (status)
        return status;
    const cl_int code = clEnqueueReadBuffer(fitter->slot->queue, hada_refiner_planes(work->refiner), CL_TRUE, 0, bytes,
                                            work->planes, 0, NULL, hada_slot_event(fitter->slot));
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueReadBuffer");
    hada_slot_moved(fitter->slot, "read", (double)bytes);
    return HADA_OK;
}

/* Every number of steps. */
static hada_status try_frame(trial_work *work, hada_fitter *fitter, const trial_frame *frame, hada_error *err)
{
    double *sum = work->sum[frame->members - 1];
    hada_status status = expose(work, fitter, frame, err);
    if (!status)
        status = linear(work, fitter, frame, err);
    if (!status)
        sum[0] += compare(work, fitter, frame);
    for (int i = 1; !status && i < TRIED; i++) {
        status = refine(work, fitter, frame, work->tv, steps_tried[i] - steps_tried[i - 1], i == 1, err);
        if (!status)
            sum[i] += compare(work, fitter, frame);
    }
    work->count[frame->members - 1] += !status;
    return status;
}

/* The weights to compare, by the noise of the camera and the light of a frame. */
static void list_weights(trial_work *work, const hada_fitter *fitter, const trial_frame *frame)
{
    const size_t raw = fitter->raw.bytes / sizeof(float);
    const size_t images = (size_t)fitter->info.depths * (size_t)fitter->info.channels;
    const double light = energy(frame->member[0]->raw, raw) / (double)fitter->info.channels;
    double noise = 0.0;
    for (size_t i = 0; i < images; i++)
        noise += work->model->noise_power[i] / (double)images;
    double guess = noise > 0.0 && light > 0.0 ? TV_PER_NOISE * sqrt(noise / light) : TV_UNKNOWN;
    guess = fmax(guess, TV_LEAST);
    for (int i = 0; i < TV_TRIED; i++)
        work->tvs[i] = tv_tried[i] * guess;
    work->tv_count = TV_TRIED;
}

/* Chooses the weight on frames of one pair each, whose filters are held out by now. */
static hada_status weigh(trial_work *work, hada_fitter *fitter, const trial_frame *frames, int count, hada_error *err)
{
    hada_status status = HADA_OK;
    int best = 0;
    list_weights(work, fitter, frames);
    for (int k = 0; !status && k < count; k++) {
        status = expose(work, fitter, &frames[k], err);
        for (int i = 0; !status && i < work->tv_count; i++) {
            status = refine(work, fitter, &frames[k], work->tvs[i], TV_STEPS, 1, err);
            if (!status)
                work->tv_sum[i] += compare(work, fitter, &frames[k]) / count;
        }
    }
    for (int i = 1; i < work->tv_count; i++)
        if (work->tv_sum[i] > work->tv_sum[best])
            best = i;
    work->tv = work->tvs[best];
    return status;
}

/* Frames of one pair, MEMBERS at a time: the weight is chosen on the first of them. */
static hada_status try_singles(trial_work *work, hada_fitter *fitter, hada_error *err)
{
    const int step = fitter->info.depths == 1 ? 1 : HADA_FIT_KEPT - 1;
    hada_status status = HADA_OK;
    for (int k = 0; !status && k < fitter->kept_count;) {
        trial_frame frames[MEMBERS];
        const int first = k == 0;
        int count = 0;
        for (; !status && count < MEMBERS && k < fitter->kept_count; k += step, count++) {
            frames[count] = (trial_frame){{&fitter->kept[k]}, 1, count};
            status = hold_out_members(work, fitter, &frames[count], err);
        }
        if (!status && first && fitter->options.refine_tv < 0.0)
            status = weigh(work, fitter, frames, count, err);
        for (int i = 0; !status && i < count; i++)
            status = try_frame(work, fitter, &frames[i], err);
    }
    return status;
}

static hada_status try_all(trial_work *work, hada_fitter *fitter, hada_error *err)
{
    hada_status status = try_singles(work, fitter, err);
    for (int k = 0; !status && k + 2 < fitter->kept_count; k++) {
        const trial_frame two = {{&fitter->kept[k], &fitter->kept[k + 2]}, 2, 0};
        if (two.member[0]->depth == two.member[1]->depth)
            continue;
        status = hold_out_members(work, fitter, &two, err);
        if (!status)
            status = try_frame(work, fitter, &two, err);
    }
    return status;
}

static double mean(const trial_work *work, int occupied, int i)
{
    return work->count[occupied] ? work->sum[occupied][i] / work->count[occupied] : 0.0;
}

static double score(const trial_work *work, int i)
{
    return mean(work, 0, i) + mean(work, 1, i);
}

/* A reconstruction stops by itself once its residual has settled, so the number to keep is the largest that still has
 * most of the best gain over the linear filter; the sum of two whole scenes is a hard case and its curve is uneven.
 * Where nothing gains more than a hundredth of a decibel, none. */
static int best_of(const trial_work *work)
{
    int best = 0, chosen = 0;
    for (int i = 1; i < TRIED; i++)
        if (score(work, i) > score(work, best))
            best = i;
    const double gain = score(work, best) - score(work, 0);
    for (int i = 1; gain > 0.01 && i < TRIED; i++)
        if (score(work, i) - score(work, 0) >= MOST_OF_THE_GAIN * gain)
            chosen = i;
    return chosen;
}

/* The numbers of steps, then the weights that were compared. */
static hada_status append_rows(const trial_work *work, int best, hada_fit_row **rows, size_t *row_count,
                               hada_error *err)
{
    hada_fit_row *all = realloc(*rows, (*row_count + TRIED + TV_TRIED) * sizeof *all);
    if (!all)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the leave-one-out table");
    *rows = all;
    for (int i = 0; i < TRIED + work->tv_count; i++) {
        const int weights = i >= TRIED, k = weights ? i - TRIED : i;
        const double tv = weights ? work->tvs[k] : k ? work->tv : 0.0;
        const double alone = weights ? work->tv_sum[k] : work->count[0] ? mean(work, 0, k) : NAN;
        all[(*row_count)++] = (hada_fit_row){.alpha = work->model->info.alpha,
                                             .lambda = work->model->info.lambda,
                                             .refine_steps = weights ? TV_STEPS : steps_tried[k],
                                             .refine_rho = hada_refine_rho(tv),
                                             .refine_tv = tv,
                                             .psnr_single = alone,
                                             .psnr_double = !weights && work->count[1] ? mean(work, 1, k) : NAN,
                                             .chosen = !weights && k == best};
    }
    return HADA_OK;
}

hada_status hada_fit_choose_refinement(hada_fitter *fitter, hada_model *model, hada_fit_row **rows, size_t *row_count,
                                       hada_error *err)
{
    trial_work work = {.model = model, .tv = fmax(fitter->options.refine_tv, 0.0)};
    if (!fitter->kept_count)
        return HADA_OK;
    hada_status status = work_create(&work, fitter, err);
    if (!status)
        status = try_all(&work, fitter, err);
    work_destroy(&work, fitter);
    if (status)
        return status;
    const int best = best_of(&work);
    model->info.refine_steps = steps_tried[best];
    model->info.refine_tv = best ? work.tv : 0.0;
    model->info.refine_rho = hada_refine_rho(model->info.refine_tv);
    return rows ? append_rows(&work, best, rows, row_count, err) : HADA_OK;
}
