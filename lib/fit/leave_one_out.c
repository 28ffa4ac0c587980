#include "fit/leave_one_out.h"

#include "launch/fit_score.h"

/* Work-items of a group that add up rows of the window, where the device works in groups. */
enum { ROW_GROUP = 32 };

/* Squared errors below this, 200 dB, count as this. */
#define LEAST_ERROR 1e-20

/* What is tried: the weight of the other depths makes lambda less important, so not every combination is worth its
 * time. */
static const hada_fit_setting several[] = {{0.0, 1e-6},  {0.0, 1e-5},  {0.0, 1e-4}, {0.0, 1e-3}, {0.0, 1e-2},
                                           {0.03, 1e-5}, {0.03, 1e-3}, {0.1, 1e-4}, {0.3, 1e-4}, {1.0, 1e-4}};
static const hada_fit_setting lambdas[] = {{0.0, 1e-6}, {0.0, 1e-5}, {0.0, 3e-5}, {0.0, 1e-4}, {0.0, 3e-4},
                                           {0.0, 1e-3}, {0.0, 3e-3}, {0.0, 1e-2}, {0.0, 3e-2}, {0.0, 1e-1}};
_Static_assert(HADA_COUNT(several) == HADA_FIT_SETTINGS && HADA_COUNT(lambdas) == HADA_FIT_SETTINGS, "room for rows");
static const hada_fit_setting alphas[] = {{0.0, 0.0}, {0.03, 0.0}, {0.1, 0.0}, {0.3, 0.0}, {1.0, 0.0}};
static const hada_fit_setting one[] = {{0.0, 0.0}};

/* The settings to score, less what the caller fixed. One depth has no others, so alpha means nothing there. */
static hada_status make_settings(hada_leave_one_out *scores, const hada_fit_options *options, hada_error *err)
{
    const int fixed_alpha = options->alpha >= 0.0 || options->depths == 1, fixed_lambda = options->lambda >= 0.0;
    const hada_fit_setting *list = fixed_alpha ? (fixed_lambda ? one : lambdas) : fixed_lambda ? alphas : several;
    scores->distinct = (int)(list == one ? 1 : list == alphas ? HADA_COUNT(alphas) : HADA_COUNT(several));
    scores->setting_count = (int)hada_round_up((size_t)scores->distinct, HADA_FIT_TRIALS);
    HADA_TRY(HADA_NEW(scores->settings, (size_t)scores->setting_count, "settings", err));
    for (int i = 0; i < scores->setting_count; i++) {
        const hada_fit_setting *from = &list[i < scores->distinct ? i : scores->distinct - 1];
        scores->settings[i].alpha = fixed_alpha ? fmax(options->alpha, 0.0) : from->alpha;
        scores->settings[i].lambda = fixed_lambda ? options->lambda : from->lambda;
    }
    return HADA_OK;
}

hada_status hada_leave_one_out_create(hada_leave_one_out *scores, const hada_fit_grid *grid,
                                      const hada_fit_options *options, hada_error *err)
{
    const size_t depths = (size_t)grid->info.depths;
    *scores = (hada_leave_one_out){.grid = grid,
                                   .fallback = {options->alpha >= 0.0 ? options->alpha : HADA_FIT_ALPHA,
                                                options->lambda >= 0.0 ? options->lambda : HADA_FIT_LAMBDA}};
    HADA_TRY(make_settings(scores, options, err));
    HADA_TRY(HADA_NEW(scores->depth, depths, "scores", err));
    for (size_t z = 0; z < depths; z++) {
        const size_t count = (size_t)scores->setting_count;
        HADA_TRY(HADA_NEW(scores->depth[z].single, count, "scores", err));
        HADA_TRY(HADA_NEW(scores->depth[z].twofold, count, "scores", err));
    }
    return HADA_OK;
}

void hada_leave_one_out_destroy(hada_leave_one_out *scores)
{
    hada_fft_destroy(&scores->inverse);
    HADA_DESTROY_BUFFERS(&scores->errors, &scores->planes, &scores->partial);
    for (int z = 0; scores->depth && z < scores->grid->info.depths; z++)
        HADA_FREE(scores->depth[z].single, scores->depth[z].twofold);
    HADA_FREE(scores->depth, scores->settings);
    *scores = (hada_leave_one_out){0};
}

void hada_leave_one_out_forget(hada_leave_one_out *scores)
{
    const size_t bytes = (size_t)scores->setting_count * sizeof(double);
    scores->taken = 0;
    for (int z = 0; z < scores->grid->info.depths; z++) {
        scores->depth[z].scored = 0;
        scores->depth[z].constant = 0.0;
        memset(scores->depth[z].single, 0, bytes);
        memset(scores->depth[z].twofold, 0, bytes);
    }
}

static hada_status make_buffer(hada_leave_one_out *scores, hada_buffer *buffer, size_t bytes, const char *what,
                               hada_error *err)
{
    if (buffer->mem)
        return HADA_OK;
    hada_status status = hada_buffer_create(buffer, scores->grid->slot->context, bytes, what, err);
    scores->bytes += buffer->bytes;
    return status;
}

/* What leave-one-out needs beyond the sums, once. */
static hada_status prepare(hada_leave_one_out *scores, hada_error *err)
{
    const hada_fit_grid *grid = scores->grid;
    const size_t rows = (size_t)grid->info.window_rows, sums = grid->chunks > rows ? grid->chunks : rows;
    hada_fft_desc desc = hada_fit_transform_desc(grid, HADA_FFT_INVERSE, 1);
    desc.batch = HADA_FIT_TRIALS;
    if (!scores->inverse) {
        HADA_TRY(hada_fft_create(&scores->inverse, grid->slot, &desc, err));
        scores->bytes += hada_fft_bytes(grid->slot->context, &desc);
    }
    HADA_TRY(make_buffer(scores, &scores->errors, hada_fit_spectra_bytes(grid, HADA_FIT_TRIALS),
                         "leave-one-out spectra", err));
    HADA_TRY(make_buffer(scores, &scores->planes, HADA_FIT_TRIALS * desc.real_distance * sizeof(float),
                         "leave-one-out errors", err));
    return make_buffer(scores, &scores->partial, HADA_FIT_TRIALS * sums * sizeof(float), "partial sums", err);
}

/* Reads partial sums and adds each setting's, in order. */
static hada_status add_up(hada_leave_one_out *scores, float *partial, size_t count, double factor, double *sums,
                          hada_error *err)
{
    HADA_TRY(hada_buffer_read(&scores->partial, scores->grid->slot, 0, partial,
                              HADA_FIT_TRIALS * count * sizeof *partial, err));
    for (size_t s = 0; s < HADA_FIT_TRIALS; s++) {
        double sum = 0.0;
        for (size_t i = 0; i < count; i++)
            sum += partial[s * count + i];
        sums[s] += factor * sum;
    }
    return HADA_OK;
}

static hada_program_fit_score program_of(const hada_fit_grid *grid)
{
    return HADA_FIT_PROGRAM(FIT_SCORE, hada_fit_is_split(grid), hada_fit_in_groups(grid));
}

/* HADA_FIT_TRIALS settings from `first` on, for a channel of a depth. */
static hada_fit_trials trials_of(const hada_leave_one_out *scores, const hada_fit_sums *sums, int z, int channel,
                                 size_t first)
{
    const hada_fit_depth *depth = &sums->depth[z];
    int others = 0;
    for (int other = 0; other < scores->grid->info.depths; other++)
        others += other != z && sums->depth[other].pairs > 0;
    hada_fit_trials trials = {.per_pair = 1.0f / (float)depth->pairs,
                              .per_other = others ? 1.0f / (float)others : 0.0f};
    for (size_t i = 0; i < HADA_FIT_TRIALS; i++) {
        const hada_fit_setting *setting = &scores->settings[first + i];
        trials.penalty[i] =
            (hada_fit_penalty){(float)setting->alpha, (float)setting->lambda * (float)depth->raw_energy[channel]};
    }
    return trials;
}

/* The error spectra of these settings, and the partial sums of what the other depths' light leaves. */
static hada_status enqueue_trial(hada_leave_one_out *scores, const hada_fit_sums *sums, const hada_fit_pair *pair,
                                 int channel, hada_fit_trials trials, hada_error *err)
{
    const hada_fit_grid *grid = scores->grid;
    const hada_range range = hada_fit_chunks(grid);
    const double values = (double)grid->vectors * HADA_FIT_VECTOR;
    hada_slot_cost(grid->slot, 4.0 * values * (8.0 + 2.0 * grid->sum_count + 2.0 * HADA_FIT_TRIALS),
                   20.0 * values * HADA_FIT_TRIALS);
    return hada_launch_fit_trial(grid->slot, program_of(grid), &range, err, .x = pair->scene_spectrum.mem,
                                 .b = pair->raw_spectrum.mem, .sums = sums->sums[channel].mem,
                                 .pool = sums->pool[channel].mem, .weights = sums->weights.mem,
                                 .error = scores->errors.mem, .leak = scores->partial.mem,
                                 .image = hada_fit_image_of(grid, (size_t)channel), .trials = trials);
}

/* Squared errors within the window, per row, into the partial sums. */
static hada_status enqueue_energy(hada_leave_one_out *scores, hada_error *err)
{
    hada_slot *slot = scores->grid->slot;
    const int rows = scores->grid->info.window_rows, cols = scores->grid->info.window_cols;
    const size_t group = slot->context->shape == HADA_SHAPE_LANES ? 1 : ROW_GROUP;
    const hada_range range = hada_range_of((size_t)rows, group, HADA_FIT_TRIALS, 1);
    HADA_TRY(
        hada_fft_inverse(scores->inverse, HADA_FIT_TRIALS, scores->errors.mem, 0, scores->planes.mem, 0, NULL, err));
    hada_slot_cost(slot, 4.0 * rows * cols * HADA_FIT_TRIALS, 2.0 * rows * cols * HADA_FIT_TRIALS);
    return hada_launch_fit_energy(slot, program_of(scores->grid), &range, err, .planes = scores->planes.mem,
                                  .rows = rows, .cols = cols, .out = scores->partial.mem);
}

/* Squared errors of all settings, summed over channels: in the window, and of the other depths' light. */
static hada_status score_pair(hada_leave_one_out *scores, const hada_fit_sums *sums, const hada_fit_pair *pair, int z,
                              float *partial, double *own, double *others, hada_error *err)
{
    const hada_model_info *info = &scores->grid->info;
    const double per_pixel = 1.0 / ((double)info->grid_rows * info->grid_cols);
    for (int c = 0; c < info->channels; c++)
        for (size_t s = 0; s < (size_t)scores->setting_count; s += HADA_FIT_TRIALS) {
            HADA_TRY(enqueue_trial(scores, sums, pair, c, trials_of(scores, sums, z, c, s), err));
            HADA_TRY(add_up(scores, partial, scores->grid->chunks, per_pixel, others + s, err));
            HADA_TRY(enqueue_energy(scores, err));
            HADA_TRY(add_up(scores, partial, (size_t)info->window_rows, 1.0, own + s, err));
        }
    return HADA_OK;
}

/* PSNR of a squared error summed over the window and its channels, for a peak of 1. */
static double decibels(const hada_fit_grid *grid, double sum)
{
    return -10.0 * log10(fmax(sum / (double)hada_fit_window_floats(grid), LEAST_ERROR));
}

/* Squared deviations of a scene from the mean of each channel. */
static double spread(const hada_fit_grid *grid, const float *scene)
{
    const size_t area = hada_fit_window_floats(grid) / (size_t)grid->info.channels;
    double total = 0.0;
    for (int c = 0; c < grid->info.channels; c++, scene += area) {
        double sum = 0.0, square = 0.0;
        for (size_t i = 0; i < area; i++) {
            sum += scene[i];
            square += (double)scene[i] * scene[i];
        }
        total += fmax(square - sum * sum / (double)area, 0.0);
    }
    return total;
}

hada_status hada_leave_one_out_share(hada_leave_one_out *scores, hada_error *err)
{
    const hada_communicator *ranks = &scores->grid->communicator;
    for (int z = 0; z < scores->grid->info.depths; z++) {
        if (!scores->depth[z].scored)
            continue;
        HADA_TRY(hada_reduce(ranks, &scores->depth[z].constant, 1, err));
        HADA_TRY(hada_reduce(ranks, scores->depth[z].single, (size_t)scores->setting_count, err));
        HADA_TRY(hada_reduce(ranks, scores->depth[z].twofold, (size_t)scores->setting_count, err));
    }
    return HADA_OK;
}

hada_status hada_leave_one_out_add(hada_leave_one_out *scores, const hada_fit_sums *sums, const hada_fit_pair *pair,
                                   int depth, hada_error *err)
{
    const size_t count = (size_t)scores->setting_count;
    hada_fit_score *to = &scores->depth[depth];
    float *partial = NULL;
    double *own = NULL;
    hada_status status = HADA_OK;
    to->scored++;
    if (!hada_is_mine(&scores->grid->communicator, scores->taken++))
        return HADA_OK;
    HADA_TRY_OR_DONE(prepare(scores, err));
    HADA_TRY_OR_DONE(hada_allocated(partial = hada_alloc_raw(scores->partial.bytes, 1, "scores", err)));
    HADA_TRY_OR_DONE(HADA_NEW(own, 2 * count, "scores", err));
    to->constant += decibels(scores->grid, spread(scores->grid, pair->scene_pixels));
    HADA_TRY_OR_DONE(score_pair(scores, sums, pair, depth, partial, own, own + count, err));
    for (size_t s = 0; s < count; s++) {
        to->single[s] += decibels(scores->grid, own[s]);
        to->twofold[s] += decibels(scores->grid, own[s] + own[count + s]);
    }
done:
    HADA_FREE(partial, own);
    return status;
}

/* Mean PSNR of a setting's held-out pairs, over depths; returns the number of depths with any. */
static int mean_psnr(const hada_leave_one_out *scores, int setting, double *single, double *twofold)
{
    int depths = 0;
    *single = *twofold = 0.0;
    for (int z = 0; z < scores->grid->info.depths; z++) {
        const hada_fit_score *depth = &scores->depth[z];
        if (!depth->scored)
            continue;
        depths++;
        *single += depth->single[setting] / (double)depth->scored;
        *twofold += depth->twofold[setting] / (double)depth->scored;
    }
    if (depths) {
        *single /= depths;
        *twofold /= depths;
    }
    return depths;
}

double hada_leave_one_out_gain(const hada_leave_one_out *scores)
{
    double most = -INFINITY, constant = 0.0, single, twofold;
    int depths = 0;
    for (int s = 0; s < scores->distinct; s++)
        if ((depths = mean_psnr(scores, s, &single, &twofold)) > 0)
            most = fmax(most, single);
    for (int z = 0; z < scores->grid->info.depths; z++)
        if (scores->depth[z].scored)
            constant += scores->depth[z].constant / (double)scores->depth[z].scored / depths;
    return depths ? most - constant : NAN;
}

/* The setting with the highest score; -1 without any. */
static int find_best(const hada_leave_one_out *scores)
{
    int best = -1;
    double most = -INFINITY;
    for (int s = 0; s < scores->distinct; s++) {
        double single, twofold;
        if (!mean_psnr(scores, s, &single, &twofold))
            return -1;
        if (best < 0)
            best = 0;
        if (single + twofold > most) {
            most = single + twofold;
            best = s;
        }
    }
    return best;
}

hada_fit_setting hada_leave_one_out_best(const hada_leave_one_out *scores)
{
    const int best = find_best(scores);
    return best < 0 ? scores->fallback : scores->settings[best];
}

int hada_leave_one_out_row_count(const hada_leave_one_out *scores)
{
    return find_best(scores) < 0 ? 0 : scores->distinct;
}

void hada_leave_one_out_rows(const hada_leave_one_out *scores, hada_fit_filter_score *rows)
{
    const int best = find_best(scores);
    for (int s = 0; best >= 0 && s < scores->distinct; s++) {
        hada_fit_filter_score *row = &rows[s];
        *row = (hada_fit_filter_score){
            .alpha = scores->settings[s].alpha, .lambda = scores->settings[s].lambda, .chosen = s == best};
        mean_psnr(scores, s, &row->psnr_single, &row->psnr_double);
        if (scores->grid->info.depths == 1)
            row->psnr_double = NAN;
    }
}

/* The k-th depth of which a pair is kept. */
static int kept_depth(const hada_fit_grid *grid, int k)
{
    return (k * (grid->info.depths - 1) + (HADA_FIT_KEPT - 1) / 2) / (HADA_FIT_KEPT - 1);
}

hada_status hada_fit_keep(hada_fit_kept *kept, const hada_fit_pair *pair, int depth, int number, hada_error *err)
{
    hada_fit_kept_pair own = {.depth = depth, .number = number};
    int wanted = 0;
    hada_status status = HADA_OK;
    for (int k = 0; k < HADA_FIT_KEPT; k++)
        wanted += kept_depth(pair->grid, k) == depth;
    for (int k = 0; k < kept->count; k++)
        wanted -= kept->pair[k].depth == depth;
    if (wanted <= 0 || kept->count == HADA_FIT_KEPT)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(own.raw = hada_alloc_raw(pair->raw.bytes, 1, "a raw frame", err)));
    HADA_TRY_OR_DONE(hada_allocated(own.scene = hada_alloc_raw(pair->scene.bytes, 1, "a scene", err)));
    if (pair->weighted) {
        HADA_TRY_OR_DONE(
            hada_allocated(own.weights = hada_alloc_raw(pair->raw.bytes, 1, "the weights of pixels", err)));
        memcpy(own.weights, pair->raw_weights, pair->raw.bytes);
    }
    memcpy(own.raw, pair->raw_pixels, pair->raw.bytes);
    memcpy(own.scene, pair->scene_pixels, pair->scene.bytes);
    kept->pair[kept->count++] = own;
done:
    if (status)
        HADA_FREE(own.raw, own.scene, own.weights);
    return status;
}

void hada_fit_kept_free(hada_fit_kept *kept)
{
    for (int k = 0; k < kept->count; k++)
        HADA_FREE(kept->pair[k].raw, kept->pair[k].scene, kept->pair[k].weights, kept->pair[k].transfers);
    *kept = (hada_fit_kept){0};
}
