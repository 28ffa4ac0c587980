/* Reading ahead: one thread fills a ring in order, one takes from it. */

#include "train/feed.h"
#include "core/base.h"
#include "core/clock.h"
#include "core/random.h"
#include "image/pixels.h"

/* One sequence of random numbers for each purpose and place; those of the order are small numbers (rounds). */
enum { PAIR = 1, PLANE = 2 };
static void begin(hada_random *random, uint64_t seed, int purpose, uint64_t place)
{
    hada_random_seed(random, seed, (uint64_t)purpose << 60 | place);
}

static int from_to(hada_random *random, int most)
{
    return (int)hada_random_below(random, 2u * (uint32_t)most + 1u) - most;
}

static int wrap(int index, int size)
{
    return (index % size + size) % size;
}

/* image[r][c] = image[r - rows][c - cols]; what enters is what left on the other side, or zero. */
static hada_status shift(hada_image *image, int rows, int cols, int circular, hada_error *err)
{
    const size_t area = (size_t)image->rows * (size_t)image->cols;
    float *old = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(old, area, "a shifted image", err));
    for (int c = 0; c < image->channels; c++) {
        float *at = image->data + (size_t)c * area;
        memcpy(old, at, area * sizeof *old);
        for (int row = 0; row < image->rows; row++)
            for (int col = 0; col < image->cols; col++) {
                const int r = row - rows, k = col - cols;
                const int inside = r >= 0 && r < image->rows && k >= 0 && k < image->cols;
                const size_t from = (size_t)wrap(r, image->rows) * (size_t)image->cols + (size_t)wrap(k, image->cols);
                at[(size_t)row * (size_t)image->cols + (size_t)col] = inside || circular ? old[from] : 0.0f;
            }
    }
done:
    free(old);
    return status;
}

static void swap(float *a, float *b)
{
    const float keep = *a;
    *a = *b;
    *b = keep;
}

static void flip(hada_image *image, int sides)
{
    const size_t cols = (size_t)image->cols, rows = (size_t)image->rows;
    for (size_t c = 0; c < (size_t)image->channels; c++) {
        float *at = image->data + c * rows * cols;
        for (size_t row = 0; (sides & 1) && row < rows; row++)
            for (size_t col = 0; col < cols / 2; col++)
                swap(&at[row * cols + col], &at[row * cols + cols - 1 - col]);
        for (size_t row = 0; (sides & 2) && row < rows / 2; row++)
            for (size_t col = 0; col < cols; col++)
                swap(&at[row * cols + col], &at[(rows - 1 - row) * cols + col]);
    }
}

/* Each allowed side by the toss of a coin. */
static int toss(hada_random *random, int allowed)
{
    return (int)(hada_random_bits(random) >> 30) & allowed;
}

static void scale(hada_image *image, double dark, double factor)
{
    const size_t count = hada_image_count(image);
    for (size_t i = 0; i < count; i++)
        image->data[i] = (float)(((double)image->data[i] - dark) * factor + dark);
}

static void add_noise(hada_image *raw, double share, hada_random *random)
{
    const double scale = share * (double)hada_image_brightest(raw);
    for (size_t i = 0; i < hada_image_count(raw); i++)
        raw->data[i] = (float)((double)raw->data[i] + scale * hada_random_normal(random));
}

hada_status hada_augment_pair(const hada_augment *augment, double dark, uint64_t seed, uint64_t place, hada_image *raw,
                              hada_image *scene, hada_error *err)
{
    hada_random random;
    begin(&random, seed, PAIR, place);
    const int rows = from_to(&random, augment->shift), cols = from_to(&random, augment->shift);
    const int sides = toss(&random, augment->flips);
    const double exposure = hada_random_range(&random, 1.0 - augment->exposure, 1.0 + augment->exposure);
    const int whole = scene->rows == raw->rows && scene->cols == raw->cols;
    if (rows || cols) {
        HADA_TRY(shift(raw, rows, cols, 1, err));
        HADA_TRY(shift(scene, rows, cols, whole, err));
    }
    flip(raw, sides);
    flip(scene, sides);
    if (augment->exposure > 0.0) {
        scale(raw, dark == HADA_AUTO ? 0.0 : dark, exposure);
        scale(scene, 0.0, exposure);
    }
    if (augment->noise > 0.0)
        add_noise(raw, augment->noise, &random);
    return HADA_OK;
}

int hada_augment_plane(const hada_augment *augment, uint64_t seed, uint64_t place, hada_image *plane, hada_image *scene)
{
    hada_random random;
    begin(&random, seed, PLANE, place);
    const int sides = toss(&random, augment->plane_flips);
    flip(plane, sides);
    flip(scene, sides);
    return sides;
}

hada_status hada_augment_check(const hada_augment *augment, const hada_model_info *info, hada_error *err)
{
    const int least = info->window_rows < info->window_cols ? info->window_rows : info->window_cols;
    const int uneven = ((augment->flips & 1) && (info->raw_cols - info->window_cols) % 2) ||
                       ((augment->flips & 2) && (info->raw_rows - info->window_rows) % 2);
    if (augment->shift < 0 || augment->shift >= least)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "shifts of up to %d pixels are not possible; take 0 to %d",
                         augment->shift, least - 1);
    if (augment->shift && info->boundary != HADA_BOUNDARY_CIRCULAR)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "shifts need a circular boundary: what leaves this camera's sensor is lost; set shift to 0");
    if (augment->flips < 0 || augment->flips > 3 || augment->plane_flips < 0 || augment->plane_flips > 3)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "flips are 0 (none), 1 (left and right), 2 (top and bottom) or 3");
    if (uneven)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "pairs of this camera cannot be flipped: between the window and the frame's edge lie half "
                         "pixels; set flips to 0 or choose a window that differs from the frame by an even number");
    if (!(augment->noise >= 0.0 && augment->noise <= 1.0) || !(augment->exposure >= 0.0 && augment->exposure < 1.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "noise and exposure are shares from 0 to 1, not %g and %g",
                         augment->noise, augment->exposure);
    return HADA_OK;
}

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

hada_status hada_feed_create(hada_feed **out, const hada_feed_desc *desc, hada_error *err)
{
    hada_feed *feed = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(feed, 1, "the pairs to read", err));
    feed->desc = *desc;
    feed->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    feed->changed = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
    HADA_TRY_OR_DONE(HADA_NEW(feed->ring, (size_t)desc->ahead, "the pairs to read", err));
    feed->running = hada_thread_start(&feed->thread, fill, feed);
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
