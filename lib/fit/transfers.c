#include "fit/coarse.h"
#include "fit/cropped.h"

/* The part of the device's memory that pairs may take. */
enum { MEMORY_SHARE = 4 };

/* One pair does not settle what lies beyond the sensor: coarse transfer functions need so many. */
enum { LEAST_COARSE = 2 };

typedef struct passes {
    hada_fit_sums *sums;
    hada_fit_reader *from;
    hada_fit_kept *kept;
    hada_fit_cropped *cropped;
    hada_nonnegative *nonnegative;
    int z; /* the depth, and of its pairs: */
    int64_t count;
    hada_fit_stored *stored;      /* NULL: read again in every pass */
    hada_fit_coarse *coarse;      /* where they begin; NULL: from nothing */
    unsigned char *left_out;      /* of each pair: it has no part */
    float *start;                 /* transfer functions of all channels, in rows */
    double *scene_energy, *noise; /* per channel */
    float *blocks;
} passes;

void hada_fit_transfers_free(hada_fit_transfers *transfers)
{
    HADA_FREE(transfers->otf, transfers->noise);
    *transfers = (hada_fit_transfers){0};
}

/* Of the pair that was taken to the device with its own buffers. */
static cl_mem weights_of(const hada_fit_pair *pair)
{
    return pair->weighted ? pair->weights.mem : NULL;
}

static void release(passes *with)
{
    hada_slot_finish(with->from->pair->grid->slot, NULL);
    for (int64_t i = 0; with->stored && i < with->count; i++)
        hada_fit_stored_free(&with->stored[i]);
    HADA_FREE(with->stored, with->left_out);
    with->stored = NULL;
    with->left_out = NULL;
}

/* Room on the device for the depth's pairs, unless they are too many. */
static hada_status reserve(passes *with, hada_error *err)
{
    const hada_fit_pair *pair = with->from->pair;
    hada_context *context = pair->grid->slot->context;
    const double each = 2.0 * (double)pair->raw.bytes + (double)pair->scene_spectrum.bytes;
    if ((double)with->count * each > (double)(context->info.memory_bytes / MEMORY_SHARE))
        return HADA_OK;
    HADA_TRY(HADA_NEW(with->stored, (size_t)with->count, "pairs", err));
    for (int64_t i = 0; i < with->count; i++)
        HADA_TRY(hada_fit_stored_create(&with->stored[i], pair, err));
    return HADA_OK;
}

/* Which of the kept pairs it is, from 1; 0: none. */
static int number_kept(const passes *with, int64_t i)
{
    for (int k = 0; k < with->kept->count; k++)
        if (with->kept->pair[k].depth == with->z && with->kept->pair[k].number == i)
            return k + 1;
    return 0;
}

/* Reads every pair of a depth once. */
static hada_status open_depth(passes *with, int z, hada_error *err)
{
    hada_status status = HADA_OK;
    with->z = z;
    with->count = with->sums->depth[z].pairs;
    status = reserve(with, err);
    if (status == HADA_ERROR_DEVICE_MEMORY) { /* then they are read again */
        release(with);
        status = HADA_OK;
    }
    HADA_TRY(status);
    HADA_TRY(HADA_NEW(with->left_out, (size_t)with->count, "pairs", err));
    if (with->coarse)
        HADA_TRY(hada_fit_coarse_begin(with->coarse, with->count, err));
    hada_fit_reader_clear(with->from);
    for (int64_t i = 0; i < with->count; i++) {
        HADA_TRY(hada_fit_read(with->from, z, i, i + 1, err));
        if (with->stored)
            HADA_TRY(hada_fit_pair_upload(with->from->pair, &with->stored[i].raw, &with->stored[i].weights,
                                          &with->stored[i].spectrum, err));
        if (with->coarse)
            HADA_TRY(hada_fit_coarse_add(with->coarse, with->from->pair, err));
    }
    return hada_fit_reader_check(with->from, z, with->sums->depth[z].raw_energy, err);
}

/* Whether a pair is left out: `out` is one of the kept pairs from 1, 0: none, -1: all of them. */
static int is_left_out(const passes *with, int64_t i, int out)
{
    return out && (out < 0 ? number_kept(with, i) > 0 : number_kept(with, i) == out);
}

/* The depth's sums without the pairs that are left out; *left: how many remain. */
static hada_status hold_out(passes *with, int out, int64_t *left, hada_error *err)
{
    const int channels = with->sums->grid->info.channels;
    hada_fit_pair *pair = with->from->pair;
    *left = with->count;
    for (int c = 0; c < channels; c++)
        with->scene_energy[c] = with->sums->depth[with->z].scene_energy[c];
    if (!out)
        return hada_fit_sums_select(with->sums, with->z, err);
    HADA_TRY(hada_fit_sums_borrow(with->sums, with->z, err));
    for (int64_t i = 0; i < with->count; i++) {
        if (!is_left_out(with, i, out))
            continue;
        HADA_TRY(hada_fit_read(with->from, with->z, i, -1, err));
        HADA_TRY(hada_fit_pair_transform(pair, pair->raw_pixels, pair->scene_pixels, err));
        HADA_TRY(hada_fit_sums_accumulate(with->sums, pair, -1.0, err));
        for (int c = 0; c < channels; c++)
            with->scene_energy[c] = fmax(with->scene_energy[c] - pair->scene_energy[c], 0.0);
        --*left;
    }
    return HADA_OK;
}

static hada_status pass(passes *with, int out, hada_error *err)
{
    hada_fit_pair *pair = with->from->pair;
    for (int64_t i = 0; i < with->count; i++) {
        if (is_left_out(with, i, out))
            continue;
        if (with->stored) {
            const hada_fit_stored *at = &with->stored[i];
            HADA_TRY(hada_fit_cropped_pair(with->cropped, at->raw.mem, at->weights.mem, at->spectrum.mem, err));
            continue;
        }
        HADA_TRY(hada_fit_read(with->from, with->z, i, i + 1, err));
        HADA_TRY(hada_fit_pair_upload(pair, &pair->raw, &pair->weights, &pair->scene_spectrum, err));
        HADA_TRY(hada_fit_cropped_pair(with->cropped, pair->raw.mem, weights_of(pair), pair->scene_spectrum.mem, err));
    }
    return HADA_OK;
}

/* The transfer functions of the depth without some pairs. */
static hada_status solve(passes *with, int out, int count, int further, const hada_buffer **transfers, hada_error *err)
{
    int64_t left;
    int more = 0;
    HADA_TRY(hold_out(with, out, &left, err));
    const int coarse = with->coarse && left >= LEAST_COARSE;
    if (coarse && !further) {
        for (int64_t i = 0; i < with->count; i++)
            with->left_out[i] = (unsigned char)is_left_out(with, i, out);
        HADA_TRY(hada_fit_coarse_solve(with->coarse, with->left_out, with->start, err));
    }
    HADA_TRY(hada_fit_cropped_begin(with->cropped, left, with->scene_energy, count, further,
                                    coarse ? with->start : NULL, err));
    HADA_TRY(hada_fit_cropped_next(with->cropped, &more, err));
    while (more) {
        HADA_TRY(pass(with, out, err));
        HADA_TRY(hada_fit_cropped_next(with->cropped, &more, err));
    }
    return hada_fit_cropped_end(with->cropped, with->sums->depth[with->z].raw_energy, with->noise, transfers, err);
}

/* What was solved without a kept pair, for the trial. */
static hada_status keep(const passes *with, hada_fit_kept_pair *kept, const hada_buffer *transfers, hada_error *err)
{
    free(kept->transfers);
    kept->transfers = NULL;
    HADA_TRY(hada_allocated(kept->transfers = hada_alloc_raw(transfers->bytes, 1, "transfer functions on trial", err)));
    return hada_buffer_read(transfers, with->from->pair->grid->slot, 0, kept->transfers, transfers->bytes, err);
}

/* Those without the kept pairs: of all of them at once where at least as many are left, else one by one, each from
 * nothing. *tried: whether there were any. */
static hada_status solve_held(passes *with, int count, int *tried, hada_error *err)
{
    const hada_buffer *transfers = NULL;
    int64_t held = 0;
    *tried = 0;
    for (int64_t i = 0; i < with->count; i++)
        held += number_kept(with, i) > 0;
    const int together = 2 * held <= with->count;
    for (int k = 0; k < with->kept->count && held && with->count > 1; k++) {
        hada_fit_kept_pair *kept = &with->kept->pair[k];
        if (kept->depth != with->z)
            continue;
        if (!*tried || !together)
            HADA_TRY(solve(with, together ? -1 : k + 1, count, 0, &transfers, err));
        HADA_TRY(keep(with, kept, transfers, err));
        *tried = 1;
    }
    return HADA_OK;
}

static hada_status learn_depth(passes *with, int z, int count, hada_fit_transfers *out, hada_error *err)
{
    const hada_fit_grid *grid = with->sums->grid;
    const size_t plane = hada_model_info_plane(&grid->info), channels = (size_t)grid->info.channels;
    const hada_buffer *transfers = NULL;
    const int further =
        grid->info.mosaic == HADA_MOSAIC_NONE ? HADA_FIT_CROP_FURTHER : HADA_FIT_CROP_MOSAIC * HADA_FIT_CROP_FURTHER;
    int tried = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(open_depth(with, z, err));
    HADA_TRY_OR_DONE(solve_held(with, count, &tried, err));
    HADA_TRY_OR_DONE(solve(with, 0, tried && count > further ? further : count, tried, &transfers, err));
    for (size_t c = 0; c < channels; c++) {
        out->noise[(size_t)z * channels + c] = with->noise[c];
        HADA_TRY_OR_DONE(hada_fit_read_plane(grid, transfers, c * grid->layout.count, with->blocks,
                                             out->otf + ((size_t)z * channels + c) * plane * 2, "a transfer function",
                                             err));
    }
done:
    release(with);
    return status;
}

/* What the depth's owner has learned, to all ranks. */
static hada_status give_depth(passes *with, int z, hada_fit_transfers *out, hada_error *err)
{
    const hada_fit_grid *grid = with->sums->grid;
    const hada_communicator *ranks = &grid->communicator;
    const size_t channels = (size_t)grid->info.channels, floats = channels * hada_model_info_plane(&grid->info) * 2;
    const size_t trial = channels * grid->layout.count * 2 * sizeof(float);
    const int owner = hada_owner(ranks, z);
    HADA_TRY(hada_broadcast(ranks, owner, out->noise + (size_t)z * channels, channels * sizeof(double), err));
    HADA_TRY(hada_broadcast(ranks, owner, out->otf + (size_t)z * floats, floats * sizeof(float), err));
    for (int k = 0; k < with->kept->count; k++) {
        hada_fit_kept_pair *kept = &with->kept->pair[k];
        int has = kept->transfers != NULL;
        if (kept->depth != z)
            continue;
        HADA_TRY(hada_broadcast(ranks, owner, &has, sizeof has, err));
        if (has && !kept->transfers)
            HADA_TRY(hada_allocated(kept->transfers = hada_alloc_raw(trial, 1, "transfer functions on trial", err)));
        if (has)
            HADA_TRY(hada_broadcast(ranks, owner, kept->transfers, trial, err));
    }
    return HADA_OK;
}

static hada_status make_room(passes *with, int coarse, hada_error *err)
{
    const hada_fit_grid *grid = with->sums->grid;
    const hada_model_info *info = &grid->info;
    const size_t channels = (size_t)info->channels;
    HADA_TRY(HADA_NEW(with->scene_energy, channels, "a fit", err));
    HADA_TRY(HADA_NEW(with->noise, channels, "a fit", err));
    HADA_TRY(HADA_NEW_RAW(with->blocks, 2 * grid->stride, "a transfer function", err));
    if (coarse)
        HADA_TRY(hada_fit_coarse_create(&with->coarse, grid, with->from->monitor, err));
    if (with->coarse)
        HADA_TRY(HADA_NEW_RAW(with->start, 2 * channels * hada_model_info_plane(info), "transfer functions", err));
    HADA_TRY(
        hada_nonnegative_create(&with->nonnegative, grid->slot, info->grid_rows, info->grid_cols, info->channels, err));
    return hada_fit_cropped_create(&with->cropped, with->sums, with->from->pair, with->nonnegative, err);
}

static void free_room(passes *with)
{
    hada_fit_cropped_destroy(&with->cropped);
    hada_nonnegative_destroy(&with->nonnegative);
    hada_fit_coarse_destroy(&with->coarse);
    HADA_FREE(with->scene_energy, with->noise, with->blocks, with->start);
}

hada_status hada_fit_transfers_learn(hada_fit_transfers *out, hada_fit_sums *sums, hada_fit_reader *from,
                                     hada_fit_kept *kept, int count, hada_error *err)
{
    const hada_model_info *info = &sums->grid->info;
    const size_t images = (size_t)info->depths * (size_t)info->channels;
    passes with = {.sums = sums, .from = from, .kept = kept};
    const hada_communicator *ranks = &sums->grid->communicator;
    hada_status status = HADA_OK;
    *out = (hada_fit_transfers){0};
    HADA_TRY_OR_DONE(make_room(&with, info->boundary == HADA_BOUNDARY_PADDED, err));
    HADA_TRY_OR_DONE(HADA_NEW(out->noise, images, "transfer functions", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(out->otf, images * hada_model_info_plane(info) * 2, "transfer functions", err));
    for (int z = 0; z < info->depths; z++)
        if (sums->depth[z].pairs && hada_is_mine(ranks, z))
            HADA_TRY_OR_DONE(learn_depth(&with, z, count, out, err));
    for (int z = 0; ranks->count > 1 && z < info->depths; z++)
        if (sums->depth[z].pairs)
            HADA_TRY_OR_DONE(give_depth(&with, z, out, err));
done:
    free_room(&with);
    if (status)
        hada_fit_transfers_free(out);
    return status;
}

hada_status hada_fit_transfers_left(hada_fit_sums *sums, hada_fit_reader *from, int count, int coarse,
                                    hada_fit_reader *held, double *left, double *light, float *rest, hada_error *err)
{
    const size_t floats = hada_fit_raw_floats(sums->grid);
    float direct[2] = {0.0f};
    hada_fit_kept none = {0};
    passes with = {.sums = sums, .from = from, .kept = &none};
    hada_fit_pair *pair = held->pair;
    const hada_buffer *transfers = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(make_room(&with, coarse, err));
    HADA_TRY_OR_DONE(open_depth(&with, 0, err));
    HADA_TRY_OR_DONE(solve(&with, 0, count, 0, &transfers, err));
    if (light) {
        HADA_TRY_OR_DONE(hada_buffer_read(transfers, pair->grid->slot, 0, direct, sizeof direct, err));
        *light = hypot(direct[0], direct[1]);
    }
    for (int k = 0; k < hada_dataset_get_info(held->pairs)->pairs; k++) {
        HADA_TRY_OR_DONE(hada_fit_read(held, 0, k, -1, err));
        HADA_TRY_OR_DONE(hada_fit_pair_upload(pair, &pair->raw, &pair->weights, &pair->scene_spectrum, err));
        HADA_TRY_OR_DONE(hada_fit_cropped_explain(with.cropped, pair->raw.mem, weights_of(pair),
                                                  pair->scene_spectrum.mem, &left[k],
                                                  rest ? rest + (size_t)k * floats : NULL, err));
    }
done:
    release(&with);
    free_room(&with);
    return status;
}
