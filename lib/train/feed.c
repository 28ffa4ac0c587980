/* Reading ahead: one thread fills a ring in order, one takes from it. */
#include "train/feed.h"

#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

struct hada_feed {
    hada_feed_desc desc;
    pthread_t thread;
    int running, stop;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    hada_fed *ring; /* `ready` of them from `first` on; `taken` of those are with the caller */
    uint64_t next;  /* place of the next to read */
    int first, ready, taken;
    hada_status status; /* of the pair behind the last ready one */
    hada_error error;
};

static hada_status check(const hada_model_info *info, hada_image *raw, hada_image *scene, hada_error *err)
{
    if (raw->channels != info->channels || raw->rows != info->raw_rows || raw->cols != info->raw_cols)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the raw frame has %d channel(s) and %d x %d pixels, the model wants %d and %d x %d",
                         raw->channels, raw->rows, raw->cols, info->channels, info->raw_rows, info->raw_cols);
    const int whole = scene->rows == info->raw_rows && scene->cols == info->raw_cols;
    if (scene->channels != info->channels ||
        (!whole && (scene->rows != info->window_rows || scene->cols != info->window_cols)))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the scene has %d channel(s) and %d x %d pixels; the model wants %d and its window's, %d x %d "
                         "(or the frame's)",
                         scene->channels, scene->rows, scene->cols, info->channels, info->window_rows,
                         info->window_cols);
    const size_t bad = hada_image_count_not_finite(raw) + hada_image_count_not_finite(scene);
    return bad ? hada_fail(err, HADA_ERROR_NOT_FINITE,
                           "%zu pixels are NaN or infinite; mend the file, or leave the "
                           "pair out",
                           bad)
               : HADA_OK;
}

static void name_pair(const hada_model_info *info, int depth, int pair, hada_error *err)
{
    if (err)
        hada_error_prefix(err, "pair %d of the depth at %d mm: ", pair + 1, (int)(info->distances_mm[depth] + 0.5));
}

static hada_status load(const hada_pairs *pairs, const hada_model_info *info, int depth, int pair, hada_image *raw,
                        hada_image *scene, hada_error *err)
{
    *raw = *scene = (hada_image){0};
    hada_status status = pairs->read(pairs->user, depth, pair, raw, scene, err);
    return status ? status : check(info, raw, scene, err);
}

/* The centre of a scene that is larger than the window. */
static hada_status crop(const hada_model_info *info, hada_image *scene, hada_error *err)
{
    const int rows = info->window_rows, cols = info->window_cols;
    hada_image window;
    if (scene->rows == rows && scene->cols == cols)
        return HADA_OK;
    hada_status status = hada_image_create(&window, scene->channels, rows, cols, err);
    if (status)
        return status;
    const size_t row0 = (size_t)(scene->rows - rows) / 2, col0 = (size_t)(scene->cols - cols) / 2;
    for (size_t c = 0; c < (size_t)scene->channels; c++)
        for (size_t row = 0; row < (size_t)rows; row++)
            memcpy(window.data + (c * (size_t)rows + row) * (size_t)cols,
                   scene->data + (c * (size_t)scene->rows + row0 + row) * (size_t)scene->cols + col0,
                   (size_t)cols * sizeof(float));
    hada_image_destroy(scene);
    *scene = window;
    return HADA_OK;
}

static void drop(hada_image *raw, hada_image *scene)
{
    hada_image_destroy(raw);
    hada_image_destroy(scene);
}

hada_status hada_pairs_read(const hada_pairs *pairs, const hada_model_info *info, int depth, int pair, hada_image *raw,
                            hada_image *scene, hada_error *err)
{
    hada_status status = load(pairs, info, depth, pair, raw, scene, err);
    if (!status)
        status = crop(info, scene, err);
    if (status) {
        drop(raw, scene);
        name_pair(info, depth, pair, err);
    }
    return status;
}

static hada_status make(const hada_feed_desc *desc, hada_fed *fed, hada_error *err)
{
    hada_order_pair(desc->pairs, desc->seed, fed->place, &fed->depth, &fed->pair);
    if (desc->known && desc->known(desc->user, fed->depth, fed->pair))
        return HADA_OK;
    hada_status status = load(desc->pairs, desc->info, fed->depth, fed->pair, &fed->raw, &fed->scene, err);
    if (!status)
        status =
            hada_augment_pair(&desc->augment, desc->info->dark, desc->seed, fed->place, &fed->raw, &fed->scene, err);
    if (!status)
        status = crop(desc->info, &fed->scene, err);
    if (status) {
        drop(&fed->raw, &fed->scene);
        name_pair(desc->info, fed->depth, fed->pair, err);
    }
    return status;
}

/* Reads until it is told to stop or a pair fails. */
static void *fill(void *user)
{
    hada_feed *feed = user;
    pthread_mutex_lock(&feed->lock);
    while (!feed->stop && !feed->status) {
        if (feed->ready == feed->desc.ahead) {
            pthread_cond_wait(&feed->changed, &feed->lock);
            continue;
        }
        hada_fed fed = {.place = feed->next++};
        hada_error error = {0};
        pthread_mutex_unlock(&feed->lock);
        hada_status status = make(&feed->desc, &fed, &error);
        pthread_mutex_lock(&feed->lock);
        if (status) {
            feed->status = status;
            feed->error = error;
        } else {
            feed->ring[(feed->first + feed->ready++) % feed->desc.ahead] = fed;
        }
        pthread_cond_broadcast(&feed->changed);
    }
    pthread_mutex_unlock(&feed->lock);
    return NULL;
}

/* Signals are for the program's own threads. */
static int start(hada_feed *feed)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    const int failed = pthread_create(&feed->thread, NULL, fill, feed);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return failed;
}

hada_status hada_feed_create(hada_feed **out, const hada_feed_desc *desc, hada_error *err)
{
    hada_feed *feed;
    *out = NULL;
    if (desc->ahead < 1 || !hada_pairs_total(desc->pairs))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "training needs at least one pair, and room for it");
    hada_status status = hada_augment_check(&desc->augment, desc->info, err);
    if (!status)
        status = hada_alloc((void **)&feed, 1, sizeof *feed, "the pairs to read", err);
    if (status)
        return status;
    feed->desc = *desc;
    feed->next = desc->first;
    pthread_mutex_init(&feed->lock, NULL);
    pthread_cond_init(&feed->changed, NULL);
    status = hada_alloc((void **)&feed->ring, (size_t)desc->ahead, sizeof *feed->ring, "the pairs to read", err);
    if (!status) {
        feed->running = !start(feed);
        if (!feed->running)
            status = hada_fail(err, HADA_ERROR_MEMORY, "no thread could be started to read pairs");
    }
    if (status)
        hada_feed_destroy(&feed);
    *out = feed;
    return status;
}

static void release(hada_feed *feed)
{
    for (; feed->taken; feed->taken--, feed->ready--) {
        hada_fed *fed = &feed->ring[feed->first];
        drop(&fed->raw, &fed->scene);
        feed->first = (feed->first + 1) % feed->desc.ahead;
    }
}

void hada_feed_destroy(hada_feed **pointer)
{
    hada_feed *feed = pointer ? *pointer : NULL;
    if (!feed)
        return;
    *pointer = NULL;
    pthread_mutex_lock(&feed->lock);
    feed->stop = 1;
    pthread_cond_broadcast(&feed->changed);
    pthread_mutex_unlock(&feed->lock);
    if (feed->running)
        pthread_join(feed->thread, NULL);
    feed->taken = feed->ready;
    if (feed->ring)
        release(feed);
    pthread_cond_destroy(&feed->changed);
    pthread_mutex_destroy(&feed->lock);
    free(feed->ring);
    free(feed);
}

hada_status hada_feed_take(hada_feed *feed, int count, hada_fed **out, hada_error *err)
{
    if (count < 1 || count > feed->desc.ahead)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%d pairs at once; the feed keeps %d", count, feed->desc.ahead);
    hada_status status = HADA_OK;
    pthread_mutex_lock(&feed->lock);
    release(feed);
    pthread_cond_broadcast(&feed->changed);
    while (feed->ready < count && !feed->status)
        pthread_cond_wait(&feed->changed, &feed->lock);
    if (feed->ready < count) {
        status = feed->status;
        if (err)
            *err = feed->error;
    } else {
        for (int i = 0; i < count; i++)
            out[i] = &feed->ring[(feed->first + i) % feed->desc.ahead];
        feed->taken = count;
    }
    pthread_mutex_unlock(&feed->lock);
    return status;
}
