/* Held-out pairs: how good training is. */
#include <hadalens/metrics.h>

#include "core/callers.h"
#include "image/pixels.h"
#include "train/trainer.h"

/* A held-out pair's raw frame where it is wanted, its example, and what the parameters make of it. */
typedef struct prediction {
    hada_example own;
    const hada_example *example;
    hada_image raw, before, after;
} prediction;

static void free_prediction(prediction *what)
{
    hada_example_free(&what->own);
    hada_image_destroy(&what->raw);
    hada_image_destroy(&what->before);
    hada_image_destroy(&what->after);
}

/* Scenes of several depths that each held-out pair becomes, where training composes them; they are the same for any
 * seed of the training. */
enum { COMPOSED_WAYS = 2, COMPOSED_SEED = 0 };

/* A held-out pair in one of its variants. */
typedef struct held_pair {
    int depth, pair, variant;
} held_pair;

static hada_status read_pair(hada_trainer *trainer, const held_pair *which, hada_image *raw, hada_composed *composed,
                             hada_image *scene, hada_error *err)
{
    hada_held_out *held = &trainer->held_out;
    hada_status status = HADA_OK;
    pthread_mutex_lock(&held->reading);
    HADA_TRY_OR_DONE(hada_pairs_read(held->pairs, &trainer->info, which->depth, which->pair, raw, scene, err));
    if (which->variant)
        HADA_TRY_OR_DONE(hada_compose(composed, held->pairs, &trainer->info, COMPOSED_SEED, which->depth, which->pair,
                                      which->variant, hada_trainer_shares(trainer), scene, err));
done:
    pthread_mutex_unlock(&held->reading);
    return status;
}

static hada_status find_example(hada_trainer *trainer, const hada_worker *worker, const held_pair *which, int with_raw,
                                prediction *what, hada_error *err)
{
    hada_image raw = {0}, scene = {0};
    hada_composed composed = {0};
    hada_examples *examples = &trainer->held_out.examples;
    hada_status status = HADA_OK;
    what->example = with_raw ? NULL : hada_examples_find(examples, which->depth, which->pair, which->variant);
    if (what->example)
        return HADA_OK;
    HADA_TRY_OR_DONE(read_pair(trainer, which, &raw, &composed, &scene, err));
    if (with_raw)
        HADA_TRY_OR_DONE(hada_image_copy(&what->raw, &raw, err));
    HADA_TRY_OR_DONE(hada_example_make(&what->own, trainer->options.stage, &trainer->info, worker->planes, which->depth,
                                       &raw, &composed, &scene, err));
    if (!with_raw)
        what->example = hada_examples_add(examples, which->depth, which->pair, which->variant, &what->own);
    if (!what->example)
        what->example = &what->own;
done:
    hada_image_destroy(&raw);
    hada_image_destroy(&scene);
    hada_composed_free(&composed);
    return status;
}

/* All pairs as they were captured come first where the net changes these, then all in their first variant, and so on.
 */
static hada_status predict(hada_trainer *trainer, const hada_worker *worker, uint64_t index, int with_raw,
                           prediction *what, hada_error *err)
{
    const hada_dataset *pairs = trainer->held_out.pairs;
    const uint64_t total = hada_pairs_total(pairs);
    held_pair which = {.variant = (int)(index / total) + hada_trainer_shares(trainer)};
    hada_status status = HADA_OK;
    *what = (prediction){0};
    hada_pairs_find(pairs, index % total, &which.depth, &which.pair);
    HADA_TRY_OR_DONE(find_example(trainer, worker, &which, with_raw, what, err));
    const hada_sample sample = {.depth = which.depth, .input = &what->example->input, .scene = &what->example->scene};
    HADA_TRY_OR_DONE(hada_replica_forward(worker->replica, &sample, &what->before, &what->after, err));
done:
    if (status)
        free_prediction(what);
    return status;
}

typedef struct measures {
    double psnr, ssim, mae, sharpness;
} measures;

typedef struct row {
    measures before, after;
    double truth;
} row;

/* SSIM's window has so many rows and columns (docs/reference/measures.md). */
enum { SSIM_WINDOW = 11 };

static hada_status measure(const hada_image *image, const hada_image *truth, measures *out, hada_error *err)
{
    *out = (measures){NAN, NAN, NAN, NAN};
    /* Values that are not finite have no distance: training goes on from the last good ones. */
    if (hada_image_count_not_finite(image))
        return HADA_OK;
    HADA_TRY(hada_metric_compare(HADA_METRIC_PSNR, image, truth, 1.0, NULL, &out->psnr, err));
    HADA_TRY(hada_metric_compare(HADA_METRIC_MAE, image, truth, 1.0, NULL, &out->mae, err));
    HADA_TRY(hada_metric_sharpness(image, NULL, &out->sharpness, err));
    if (truth->rows >= SSIM_WINDOW && truth->cols >= SSIM_WINDOW)
        HADA_TRY(hada_metric_compare(HADA_METRIC_SSIM, image, truth, 1.0, NULL, &out->ssim, err));
    return HADA_OK;
}

typedef struct list {
    hada_trainer *trainer;
    uint64_t total;
    int count, first; /* first: of those that are measured now */
    row *rows;
} list;

static hada_status measure_one(const list *all, const hada_worker *worker, int number, hada_error *err)
{
    hada_trainer *trainer = all->trainer;
    row *own = &all->rows[number];
    prediction what = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(predict(trainer, worker, (uint64_t)number * all->total / (uint64_t)all->count, 0, &what, err));
    const hada_image *truth = &what.example->scene;
    HADA_TRY_OR_DONE(measure(&what.after, truth, &own->after, err));
    own->before = (measures){NAN, NAN, NAN, NAN};
    if (trainer->options.stage != HADA_STAGE_CONVENTIONAL)
        HADA_TRY_OR_DONE(measure(&what.before, truth, &own->before, err));
    HADA_TRY_OR_DONE(hada_metric_sharpness(truth, NULL, &own->truth, err));
done:
    free_prediction(&what);
    return status;
}

static hada_status measure_next(hada_workers *workers, int number, void *user, hada_error *err)
{
    const list *all = user;
    const int i = all->first + hada_rank(workers->ranks) * workers->count + number;
    return i < all->count ? measure_one(all, &workers->worker[number], i, err) : HADA_OK;
}

/* The rows of this rank; those of others stay zero. HADA_ERROR_CANCELLED on all ranks where one of them wants to stop.
 */
static hada_status measure_all(list *all, hada_error *err)
{
    hada_trainer *trainer = all->trainer;
    double wishes = 0.0;
    for (; all->first < all->count && wishes == 0.0;
         all->first += hada_ranks(&trainer->ranks) * trainer->workers.count) {
        HADA_TRY(hada_workers_run(&trainer->workers, measure_next, all, err));
        wishes = hada_monitor_check(trainer->monitor, NULL) != HADA_OK;
    }
    HADA_TRY(hada_reduce(&trainer->ranks, &wishes, 1, err));
    return wishes > 0.0 ? hada_fail(err, HADA_ERROR_CANCELLED, "the validation was stopped") : HADA_OK;
}

/* Means over the rows. */
static void add_up(const list *all, hada_validation *out)
{
    for (int i = 0; i < all->count; i++) {
        const row *own = &all->rows[i];
        out->psnr += own->after.psnr / all->count;
        out->ssim += own->after.ssim / all->count;
        out->mae += own->after.mae / all->count;
        out->sharpness += own->after.sharpness / all->count;
        out->psnr_before += own->before.psnr / all->count;
        out->ssim_before += own->before.ssim / all->count;
        out->mae_before += own->before.mae / all->count;
        out->sharpness_before += own->before.sharpness / all->count;
        out->sharpness_truth += own->truth / all->count;
    }
    out->pairs = all->count;
}

static uint64_t count_held_out(const hada_trainer *trainer)
{
    return trainer->held_out.examples.kept ? hada_pairs_total(trainer->held_out.pairs) : 0;
}

hada_status hada_trainer_validate(hada_trainer *trainer, int most, hada_validation *report, hada_error *err)
{
    hada_validation result = {0};
    list all = {.trainer = trainer};
    hada_status status = HADA_OK;
    HADA_NEED(trainer && report, err);
    HADA_TRY_OR_DONE(HADA_REPORT_CHECK(report, hada_validation, err));
    all.total = count_held_out(trainer);
    if (!all.total)
        return hada_fail(err, HADA_ERROR_STATE, "no pair is held out to validate with");
    if (trainer->options.compose > 0.0)
        all.total *= COMPOSED_WAYS + !hada_trainer_shares(trainer);
    all.count = most > 0 && (uint64_t)most < all.total ? most : (int)all.total;
    HADA_TRY_OR_DONE(HADA_NEW(all.rows, (size_t)all.count, "validation", err));
    HADA_TRY_OR_DONE(measure_all(&all, err));
    /* rows are doubles */
    HADA_TRY_OR_DONE(
        hada_reduce(&trainer->ranks, (double *)all.rows, (size_t)all.count * (sizeof(row) / sizeof(double)), err));
    add_up(&all, &result);
    HADA_REPORT_GIVE(report, &result);
done:
    free(all.rows);
    return status;
}

static void hand_over(hada_image *out, hada_image *image)
{
    if (out) {
        *out = *image;
        *image = (hada_image){0};
    }
}

hada_status hada_trainer_show(hada_trainer *trainer, int pair, hada_image *raw, hada_image *before, hada_image *after,
                              hada_image *truth, hada_error *err)
{
    prediction what = {0};
    hada_status status = HADA_OK;
    HADA_NEED(trainer, err);
    const uint64_t total = count_held_out(trainer);
    if (pair < 0 || (uint64_t)pair >= total)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no held-out pair %d of %llu", pair,
                         (unsigned long long)total);
    HADA_TRY_OR_DONE(predict(trainer, trainer->workers.worker, (uint64_t)pair, 1, &what, err));
    hand_over(raw, &what.raw);
    hand_over(before, &what.before);
    hand_over(after, &what.after);
    hand_over(truth, &what.own.scene);
done:
    free_prediction(&what);
    return status;
}
