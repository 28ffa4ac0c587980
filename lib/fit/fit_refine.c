/* Does refinement pay for this camera? Measured by leave-one-out on a few pairs, alone and two depths at once. */
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

/* Relative to the largest |OTF(0)|^2; flat between 1e-3 and 3e-3 in trials (docs/filters.md). */
#define RHO 1e-3

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
} trial_work;

static hada_status work_create(trial_work *work, hada_fitter *fitter, hada_error *err)
{
    const hada_model_info *info = &fitter->info;
    const size_t images = MEMBERS * (size_t)info->channels, bytes = images * fitter->layout.count * 8 + 64;
    const hada_refine_shape shape = hada_refine_shape_of(info, MEMBERS, steps_tried[TRIED - 1]);
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

/* PSNR of planes (negative light clipped, as reconstruction does) against the members' scenes, mean over members. */
static double compare(const trial_work *work, const hada_fitter *fitter, const hada_fitter_kept *const *member,
                      int members)
{
    const size_t count = fitter->scene.bytes / sizeof(float);
    double total = 0.0;
    for (int m = 0; m < members; m++) {
        double sum = 0.0;
        for (size_t i = 0; i < count; i++) {
            const double error = fmax((double)work->planes[(size_t)m * count + i], 0.0) - member[m]->scene[i];
            sum += error * error;
        }
        total -= 10.0 * log10(fmax(sum / (double)count, 1e-20));
    }
    return total / members;
}

static hada_status linear(trial_work *work, hada_fitter *fitter, int members, hada_error *err)
{
    const int channels = fitter->info.channels;
    const size_t count = fitter->scene.bytes / sizeof(float);
    hada_status status = HADA_OK;
    for (int m = 0; !status && m < members; m++) {
        const hada_fft_filter filter = {.product =
                                            fitter->sum_count == HADA_FIT_SUMS ? HADA_FFT_COMPLEX : HADA_FFT_SPLIT,
                                        .filter = work->filters.mem,
                                        .spectrum_count = channels,
                                        .filter_first = m * channels};
        /* the scene's place on the device is free by now */
        status = hada_fft_inverse(work->inverse, channels, fitter->b.mem, 0, fitter->scene.mem, 0, &filter, err);
        if (!status)
            status = hada_buffer_read(&fitter->scene, fitter->slot, 0, work->planes + (size_t)m * count,
                                      fitter->scene.bytes, err);
    }
    return status;
}

/* One frame, of one pair or the sum of two: every number of steps. */
static hada_status try_frame(trial_work *work, hada_fitter *fitter, const hada_fitter_kept *const *member, int members,
                             hada_error *err)
{
    static const int list[MEMBERS] = {0, 1};
    const size_t raw = fitter->raw.bytes / sizeof(float), bytes = (size_t)members * fitter->scene.bytes;
    double *sum = work->sum[members - 1];
    hada_status status = HADA_OK;
    memset(work->raw, 0, fitter->raw.bytes);
    for (int m = 0; !status && m < members; m++) {
        for (size_t i = 0; i < raw; i++)
            work->raw[i] += member[m]->raw[i];
        status = hold_out(work, fitter, member[m], m, err);
    }
    if (!status)
        status = hada_fitter_transform(fitter, work->raw, NULL, err);
    if (!status)
        status = linear(work, fitter, members, err);
    if (!status)
        sum[0] += compare(work, fitter, member, members);
    const hada_refine_data data = {.spectrum = fitter->b.mem,
                                   .frame = fitter->raw.mem,
                                   .otf = work->otfs.mem,
                                   .otf_depths = MEMBERS,
                                   .prior = work->prior.mem};
    hada_refine_rule rule;
    hada_refine_rule_init(&rule);
    rule.rho = RHO * hada_model_gain(work->model);
    rule.stop = 0.0;
    for (int i = 1; !status && i < TRIED; i++) {
        rule.steps = steps_tried[i] - steps_tried[i - 1];
        rule.start = i == 1 ? HADA_REFINE_COLD : HADA_REFINE_ON;
        status = hada_refiner_run(work->refiner, &data, &rule, 1, members, list, NULL, err);
        if (status)
            break;
        const cl_int code = clEnqueueReadBuffer(fitter->slot->queue, hada_refiner_planes(work->refiner), CL_TRUE, 0,
                                                bytes, work->planes, 0, NULL, hada_slot_event(fitter->slot));
        if (code != CL_SUCCESS) {
            status = hada_fail_cl(err, code, "clEnqueueReadBuffer");
            break;
        }
        hada_slot_moved(fitter->slot, "read", (double)bytes);
        sum[i] += compare(work, fitter, member, members);
    }
    work->count[members - 1] += !status;
    return status;
}

static hada_status try_all(trial_work *work, hada_fitter *fitter, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int k = 0; !status && k < fitter->kept_count; k++) {
        const hada_fitter_kept *one = &fitter->kept[k];
        if (fitter->info.depths == 1 || k % (HADA_FIT_KEPT - 1) == 0)
            status = try_frame(work, fitter, &one, 1, err);
    }
    for (int k = 0; !status && k + 2 < fitter->kept_count; k++) {
        const hada_fitter_kept *two[] = {&fitter->kept[k], &fitter->kept[k + 2]};
        if (two[0]->depth != two[1]->depth)
            status = try_frame(work, fitter, two, 2, err);
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

static hada_status append_rows(const trial_work *work, int best, hada_fit_row **rows, size_t *row_count,
                               hada_error *err)
{
    hada_fit_row *all = realloc(*rows, (*row_count + TRIED) * sizeof *all);
    if (!all)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the leave-one-out table");
    *rows = all;
    for (int i = 0; i < TRIED; i++)
        all[(*row_count)++] = (hada_fit_row){.alpha = work->model->info.alpha,
                                             .lambda = work->model->info.lambda,
                                             .refine_steps = steps_tried[i],
                                             .refine_rho = RHO,
                                             .psnr_single = work->count[0] ? mean(work, 0, i) : NAN,
                                             .psnr_double = work->count[1] ? mean(work, 1, i) : NAN,
                                             .chosen = i == best};
    return HADA_OK;
}

hada_status hada_fit_choose_refinement(hada_fitter *fitter, hada_model *model, hada_fit_row **rows, size_t *row_count,
                                       hada_error *err)
{
    trial_work work = {.model = model};
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
    model->info.refine_rho = RHO;
    return rows ? append_rows(&work, best, rows, row_count, err) : HADA_OK;
}
