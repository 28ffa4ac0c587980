/* Held-out pairs: how good training is. */
#include <hadalens/metrics.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/options.h"
#include "train/trainer.h"

/* A held-out pair's raw frame where it is wanted, its example, and what the parameters make of it. */
typedef struct seen {
    hada_example own;
    const hada_example *example;
    hada_image raw, before, after;
} seen;

static void free_seen(seen *what)
{
    hada_example_free(&what->own);
    hada_image_destroy(&what->raw);
    hada_image_destroy(&what->before);
    hada_image_destroy(&what->after);
}

static hada_status copy_raw(hada_image *out, const hada_image *raw, hada_error *err)
{
    hada_status status = hada_image_create(out, raw->channels, raw->rows, raw->cols, err);
    if (!status)
        memcpy(out->data, raw->data, hada_image_count(raw) * sizeof(float));
    return status;
}

static hada_status find_example(hada_trainer *trainer, hada_worker *worker, int depth, int pair, int with_raw,
                                seen *what, hada_error *err)
{
    hada_image raw, scene;
    what->example = with_raw ? NULL : hada_examples_find(&trainer->held, depth, pair);
    if (what->example)
        return HADA_OK;
    pthread_mutex_lock(&trainer->reading);
    hada_status status = hada_pairs_read(&trainer->held_out, &trainer->info, depth, pair, &raw, &scene, err);
    pthread_mutex_unlock(&trainer->reading);
    if (!status && with_raw)
        status = copy_raw(&what->raw, &raw, err);
    if (!status)
        status = hada_example_make(&what->own, trainer, worker, depth, &raw, &scene, err);
    hada_image_destroy(&raw);
    hada_image_destroy(&scene);
    if (!status && !with_raw)
        what->example = hada_examples_add(&trainer->held, depth, pair, &what->own);
    if (!what->example)
        what->example = &what->own;
    return status;
}

static hada_status look(hada_trainer *trainer, int worker, uint64_t index, int with_raw, seen *what, hada_error *err)
{
    int depth, pair;
    *what = (seen){0};
    hada_pairs_find(&trainer->held_out, index, &depth, &pair);
    hada_status status = find_example(trainer, &trainer->workers[worker], depth, pair, with_raw, what, err);
    const hada_sample sample = {depth, &what->example->input, &what->example->scene, 0};
    if (!status)
        status = hada_engine_forward(trainer->workers[worker].engine, &sample, &what->before, &what->after, err);
    if (status)
        free_seen(what);
    return status;
}

typedef struct measures {
    double psnr, ssim, mae, sharpness;
} measures;

typedef struct row {
    measures before, after;
    double truth;
} row;

static hada_status measure(const hada_image *image, const hada_image *truth, measures *out, hada_error *err)
{
    *out = (measures){NAN, NAN, NAN, NAN};
    /* Values that are not finite have no distance: training goes on from the last good ones. */
    if (hada_image_count_not_finite(image))
        return HADA_OK;
    hada_status status = hada_metric_psnr(image, truth, 1.0, NULL, &out->psnr, err);
    if (!status)
        status = hada_metric_mae(image, truth, NULL, &out->mae, err);
    if (!status)
        status = hada_metric_sharpness(image, NULL, &out->sharpness, err);
    if (!status && truth->rows >= 11 && truth->cols >= 11)
        status = hada_metric_ssim(image, truth, 1.0, NULL, &out->ssim, err);
    return status;
}

typedef struct list {
    uint64_t total;
    int count;
    row *rows;
} list;

static hada_status measure_share(hada_trainer *trainer, int worker, void *user, hada_error *err)
{
    const list *all = user;
    hada_status status = HADA_OK;
    for (int i = worker; !status && i < all->count; i += trainer->worker_count) {
        row *own = &all->rows[i];
        seen what;
        status = look(trainer, worker, (uint64_t)i * all->total / (uint64_t)all->count, 0, &what, err);
        if (status)
            break;
        const hada_image *truth = &what.example->scene;
        status = measure(&what.after, truth, &own->after, err);
        own->before = (measures){NAN, NAN, NAN, NAN};
        if (!status && trainer->options.stage != HADA_STAGE_CONVENTIONAL)
            status = measure(&what.before, truth, &own->before, err);
        if (!status)
            status = hada_metric_sharpness(truth, NULL, &own->truth, err);
        free_seen(&what);
    }
    return status;
}

hada_status hada_trainer_validate(hada_trainer *trainer, int most, hada_validation *report, hada_error *err)
{
    hada_validation own_result = {0}, *out = &own_result;
    if (!trainer || !report)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_trainer_validate: trainer and out are needed");
    hada_status status = HADA_REPORT_CHECK(report, hada_validation, err);
    if (status)
        return status;
    list all = {.total = trainer->held.kept ? hada_pairs_total(&trainer->held_out) : 0};
    if (!all.total)
        return hada_fail(err, HADA_ERROR_STATE, "no pair is held out to validate with");
    all.count = most > 0 && (uint64_t)most < all.total ? most : (int)all.total;
    status = hada_alloc((void **)&all.rows, (size_t)all.count, sizeof *all.rows, "validation", err);
    if (!status)
        status = hada_workers_run(trainer, measure_share, &all, err);
    for (int i = 0; !status && i < all.count; i++) {
        const row *own = &all.rows[i];
        out->psnr += own->after.psnr / all.count;
        out->ssim += own->after.ssim / all.count;
        out->mae += own->after.mae / all.count;
        out->sharpness += own->after.sharpness / all.count;
        out->psnr_before += own->before.psnr / all.count;
        out->ssim_before += own->before.ssim / all.count;
        out->mae_before += own->before.mae / all.count;
        out->sharpness_before += own->before.sharpness / all.count;
        out->sharpness_truth += own->truth / all.count;
    }
    out->pairs = all.count;
    HADA_REPORT_GIVE(report, out);
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
    seen what;
    if (!trainer)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_trainer_show: a trainer is needed");
    const uint64_t total = trainer->held.kept ? hada_pairs_total(&trainer->held_out) : 0;
    if (pair < 0 || (uint64_t)pair >= total)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no held-out pair %d of %llu", pair,
                         (unsigned long long)total);
    hada_status status = look(trainer, 0, (uint64_t)pair, 1, &what, err);
    if (status)
        return status;
    hand_over(raw, &what.raw);
    hand_over(before, &what.before);
    hand_over(after, &what.after);
    hand_over(truth, &what.own.scene);
    free_seen(&what);
    return HADA_OK;
}
