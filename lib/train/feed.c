/* Reading ahead: one thread fills a ring in order, one takes from it. */
#include "train/feed.h"

#include <pthread.h>
#include <signal.h>

#include "core/base.h"

struct hada_feed {
    hada_feed_desc desc;
    pthread_t thread;
    int running, stop;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    hada_fed *ring; /* `ready` of them from `first` on; `taken` of those are with the caller */
    uint64_t next;  /* how many have been begun */
    int first, ready, taken;
    hada_status status; /* of the pair behind the last ready one */
    hada_error error;
};

static void drop(hada_fed *fed)
{
    hada_image_destroy(&fed->raw);
    hada_image_destroy(&fed->scene);
    hada_composed_free(&fed->composed);
}

static hada_status make(const hada_feed_desc *desc, hada_fed *fed, hada_error *err)
{
    hada_order_pair(desc->pairs, desc->seed, fed->place, &fed->depth, &fed->pair);
    fed->variant = hada_compose_variant(desc->pairs, desc->seed, fed->place, desc->compose);
    if (desc->known && desc->known(desc->user, fed->depth, fed->pair, fed->variant))
        return HADA_OK;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_pairs_load(desc->pairs, desc->info, fed->depth, fed->pair, &fed->raw, &fed->scene, err));
    HADA_TRY_OR_DONE(
        hada_augment_pair(&desc->augment, desc->info->dark, desc->seed, fed->place, &fed->raw, &fed->scene, err));
    HADA_TRY_OR_DONE(hada_pairs_crop(desc->info, &fed->scene, err));
    if (fed->variant)
        HADA_TRY_OR_DONE(hada_compose(&fed->composed, desc->pairs, desc->info, desc->seed, fed->depth, fed->pair,
                                      fed->variant, desc->planes_only, &fed->scene, err));
done:
    if (status) {
        drop(fed);
        hada_pairs_name(desc->info, fed->depth, fed->pair, err);
    }
    return status;
}

/* Where the n-th pair stands. */
static uint64_t place_of(const hada_feed_desc *desc, uint64_t n)
{
    if (!desc->batch)
        return desc->first + n;
    const uint64_t batch = (uint64_t)desc->batch, take = (uint64_t)desc->take;
    return desc->first + n / take * batch + (uint64_t)desc->skip + n % take;
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
        hada_fed fed = {.place = place_of(&feed->desc, feed->next++)};
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
    hada_feed *feed = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    if (desc->ahead < 1 || !hada_pairs_total(desc->pairs))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "training needs at least one pair, and room for it");
    HADA_TRY_OR_DONE(hada_augment_check(&desc->augment, desc->info, err));
    HADA_TRY_OR_DONE(HADA_NEW(feed, 1, "the pairs to read", err));
    feed->desc = *desc;
    feed->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    feed->changed = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
    HADA_TRY_OR_DONE(HADA_NEW(feed->ring, (size_t)desc->ahead, "the pairs to read", err));
    feed->running = !start(feed);
    if (!feed->running)
        status = hada_fail(err, HADA_ERROR_MEMORY, "no thread could be started to read pairs");
done:
    if (status)
        hada_feed_destroy(&feed);
    *out = feed;
    return status;
}

static void release(hada_feed *feed)
{
    for (; feed->taken; feed->taken--, feed->ready--) {
        hada_fed *fed = &feed->ring[feed->first];
        drop(fed);
        feed->first = (feed->first + 1) % feed->desc.ahead;
    }
}

void hada_feed_destroy(hada_feed **pointer)
{
    hada_feed *feed = hada_taken(pointer);
    if (!feed)
        return;
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
    HADA_FREE(feed->ring, feed);
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
