/* The pairs of a data set as they are read, corrected and binned: from files or a caller, the cache, and the thread
 * that reads ahead. */
#include <hadalens/response.h>
#include <hadalens/tiff.h>

#include "core/callers.h"
#include "core/clock.h"
#include "dataset/dataset.h"
#include "image/correct.h"
#include "image/statistics.h"
#include "io/folder.h"
#include "io/tiff_page.h"

static hada_status take_flat(hada_pair_store *store, const hada_dataset_options *options, hada_error *err)
{
    const hada_image *flat = options->flat_frame;
    const int channels = options->mosaic != HADA_MOSAIC_NONE ? HADA_MOSAIC_COLOURS : flat ? flat->channels : 1;
    store->flat_dark = options->flat_dark;
    return flat ? hada_flat_sensitivity(&store->flat, flat, channels, options->mosaic, err) : HADA_OK;
}

hada_status hada_pair_store_create(hada_pair_store **out, const hada_dataset_options *callers, hada_error *err)
{
    hada_dataset_options options;
    *out = NULL;
    HADA_TRY(HADA_OPTIONS_TAKE(&options, callers, hada_dataset_options, err));
    if (options.mosaic == HADA_MOSAIC_AUTO) /* no file said anything */
        options.mosaic = HADA_MOSAIC_NONE;
    if (options.frame_encoding != HADA_AUTO && !hada_response_is_known(options.frame_encoding))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a frame encoding of %g is not possible (hadalens/response.h)",
                         options.frame_encoding);
    if (options.mosaic != HADA_MOSAIC_NONE && !hada_mosaic_is_pattern(options.mosaic))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the mosaic of a data set, %d, is not a pattern", options.mosaic);
    if (options.downsample < 1 ||
        (options.mosaic != HADA_MOSAIC_NONE && options.downsample > 1 && options.downsample % 2))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "pairs cannot be binned by %d: options.downsample is 1 or more, and even for a mosaic",
                         options.downsample);
    HADA_TRY(HADA_NEW(*out, 1, "a data set", err));
    hada_pair_store *store = *out;
    store->users = 1;
    store->downsample = options.downsample;
    *(options.downsample > 1 ? &store->sensor_mosaic : &store->mosaic) = options.mosaic;
    store->room = options.cache_bytes;
    store->frame_encoding = options.frame_encoding;
    store->reading = store->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    store->ahead.changed = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
    hada_status status = take_flat(store, &options, err);
    if (!status && options.dark_frame)
        status = hada_dark_of_sensor(&store->dark, options.dark_frame, 0, options.mosaic, err);
    if (status)
        hada_pair_store_release(out);
    return status;
}

void hada_pair_images_free(hada_pair_images *images)
{
    hada_image_destroy(&images->raw);
    hada_image_destroy(&images->scene);
    hada_image_destroy(&images->weights);
}

static uint64_t bytes_of(const hada_pair_images *images)
{
    const size_t weights = images->weights.data ? hada_image_count(&images->weights) : 0;
    return (uint64_t)(hada_image_count(&images->raw) + hada_image_count(&images->scene) + weights) * sizeof(float);
}

/* Ends reading ahead, and keeps nothing that was read. */
static void drop_pairs(hada_pair_store *store)
{
    pthread_mutex_lock(&store->lock);
    store->ahead.stop = 1;
    pthread_cond_broadcast(&store->ahead.changed);
    pthread_mutex_unlock(&store->lock);
    if (store->ahead.running)
        pthread_join(store->ahead.thread, NULL);
    hada_pair_images_free(&store->ahead.images);
    for (int i = 0; store->kept && i < store->pairs; i++) {
        store->room += bytes_of(&store->kept[i]);
        hada_pair_images_free(&store->kept[i]);
    }
    store->ahead.running = store->ahead.stop = 0;
    store->ahead.state = HADA_AHEAD_IDLE;
}

void hada_pair_store_release(hada_pair_store **pointer)
{
    hada_pair_store *store = hada_taken(pointer);
    if (!store)
        return;
    pthread_mutex_lock(&store->lock);
    const int users = --store->users;
    pthread_mutex_unlock(&store->lock);
    if (users)
        return;
    drop_pairs(store);
    for (int z = 0; z < store->depths; z++) {
        for (int i = 0; i < store->depth[z].count; i++) {
            HADA_FREE((char *)store->depth[z].files[i].raw, (char *)store->depth[z].files[i].scene);
        }
        HADA_FREE(store->depth[z].files, store->depth[z].folder);
    }
    HADA_FREE(store->kept, store->depth, store->folders, store->placement);
    hada_image_destroy(&store->flat);
    hada_image_destroy(&store->dark);
    hada_inputs_release(&store->inputs);
    hada_names_free(&store->alone, &store->alone_count);
    HADA_FREE(store->psf, store->camera);
    pthread_cond_destroy(&store->ahead.changed);
    pthread_mutex_destroy(&store->lock);
    pthread_mutex_destroy(&store->reading);
    free(store);
}

/* Subtracts the dark frame from a raw frame, divides it by the flat frame and bins it, in the order that their sizes
 * say; weighs it before. */
static hada_status correct(const hada_pair_store *store, hada_pair_images *images, const char *name, hada_error *err)
{
    hada_image *raw = &images->raw, *weights = &images->weights;
    const hada_image *flat = &store->flat, *dark = &store->dark;
    const int bins = store->downsample > 1, first = bins && flat->rows == raw->rows && flat->cols == raw->cols;
    const int darkens = hada_dark_fits(dark, raw, bins ? store->sensor_mosaic : store->mosaic);
    HADA_TRY(hada_saturated_weigh(raw, bins ? store->sensor_mosaic : store->mosaic, weights, err));
    if (darkens)
        hada_dark_subtract(raw, bins ? store->sensor_mosaic : store->mosaic, dark);
    if (first)
        HADA_TRY(hada_named(hada_flat_correct(raw, store->sensor_mosaic, flat, store->flat_dark, err), name, err));
    if (bins)
        HADA_TRY(hada_named(hada_image_bin(raw, store->downsample, store->sensor_mosaic, 1, err), name, err));
    if (bins && weights->data) {
        HADA_TRY(hada_image_bin(weights, store->downsample, store->sensor_mosaic, 0, err));
        hada_weights_bound(weights);
    }
    if (dark->data && !darkens) {
        if (!hada_dark_fits(dark, raw, store->mosaic))
            return hada_named(hada_fail(err, HADA_ERROR_SIZE,
                                        "the frame has %d channel(s) of %d x %d pixels, and the dark frame %d of %d x "
                                        "%d",
                                        raw->channels, raw->rows, raw->cols, dark->channels, dark->rows, dark->cols),
                              name, err);
        hada_dark_subtract(raw, store->mosaic, dark);
    }
    return flat->data && !first
               ? hada_named(hada_flat_correct(raw, store->mosaic, flat, store->flat_dark, err), name, err)
               : HADA_OK;
}

hada_status hada_pair_store_call(hada_pair_store *store, int depth, int number, hada_image *raw, hada_image *scene,
                                 hada_error *err)
{
    const char *name = store->depth[depth].files[number].raw;
    hada_error own = {0};
    pthread_mutex_lock(&store->reading);
    const hada_status status = store->read(store->user, depth, number, raw, scene, &own);
    pthread_mutex_unlock(&store->reading);
    if (status && !*own.message)
        return hada_fail(err, status, "%s: the data set's function could not read this pair, and gave no reason", name);
    if (status && err)
        *err = own;
    return status || (raw->data && scene->data)
               ? status
               : hada_fail(err, HADA_ERROR_DATASET, "no images were given for %s", name);
}

/* Reads a pair, by its number over all depths, from its files or by the caller's function. */
static hada_status read_images(hada_pair_store *store, int number, hada_pair_images *images, hada_error *err)
{
    hada_status status = HADA_OK;
    int z = 0;
    while (number >= store->depth[z].before + store->depth[z].count)
        z++;
    number -= store->depth[z].before;
    const hada_pair_files *files = &store->depth[z].files[number];
    *images = (hada_pair_images){0};
    if (store->read) {
        HADA_TRY_OR_DONE(hada_pair_store_call(store, z, number, &images->raw, &images->scene, err));
    } else {
        HADA_TRY_OR_DONE(hada_tiff_load_light(files->raw, 0, store->frame_encoding, &images->raw, err));
        HADA_TRY_OR_DONE(hada_tiff_load(files->scene, 0, &images->scene, err));
    }
    HADA_TRY_OR_DONE(correct(store, images, files->raw, err));
    if (store->downsample > 1)
        HADA_TRY_OR_DONE(
            hada_named(hada_image_bin(&images->scene, store->downsample, HADA_MOSAIC_NONE, 0, err), files->scene, err));
    if (store->place)
        HADA_TRY_OR_DONE(hada_named(store->place(store->placement, z, &images->scene, err), files->scene, err));
done:
    if (status)
        hada_pair_images_free(images);
    return status;
}

/* Reads the pairs that are expected, one after the other. */
static void *read_ahead(void *user)
{
    hada_pair_store *store = user;
    pthread_mutex_lock(&store->lock);
    while (!store->ahead.stop) {
        if (store->ahead.state != HADA_AHEAD_WANTED) {
            pthread_cond_wait(&store->ahead.changed, &store->lock);
            continue;
        }
        const int number = store->ahead.number;
        hada_pair_images images;
        hada_error error = {0};
        store->ahead.state = HADA_AHEAD_READING;
        pthread_mutex_unlock(&store->lock);
        const hada_status status = read_images(store, number, &images, &error);
        pthread_mutex_lock(&store->lock);
        store->ahead.images = images;
        store->ahead.status = status;
        store->ahead.error = error;
        store->ahead.state = HADA_AHEAD_READY;
        pthread_cond_broadcast(&store->ahead.changed);
    }
    pthread_mutex_unlock(&store->lock);
    return NULL;
}

void hada_pair_store_expect(hada_pair_store *store, int wanted)
{
    if (store->raws)
        return;
    pthread_mutex_lock(&store->lock);
    if (!store->ahead.running)
        /* without one, pairs are read when they are taken */
        store->ahead.running = hada_thread_start(&store->ahead.thread, read_ahead, store);
    const int busy = store->ahead.state == HADA_AHEAD_READING ||
                     (store->ahead.state != HADA_AHEAD_IDLE && store->ahead.number == wanted);
    if (store->ahead.running && !busy && !store->kept[wanted].raw.data) {
        hada_pair_images_free(&store->ahead.images);
        store->ahead.number = wanted;
        store->ahead.state = HADA_AHEAD_WANTED;
        pthread_cond_broadcast(&store->ahead.changed);
    }
    pthread_mutex_unlock(&store->lock);
}

/* Takes what was read ahead, where that is the pair. The lock is held. */
static int take_ahead(hada_pair_store *store, int number, hada_pair_images *images, hada_status *status,
                      hada_error *err)
{
    while (store->ahead.number == number && store->ahead.state == HADA_AHEAD_READING)
        pthread_cond_wait(&store->ahead.changed, &store->lock);
    if (store->ahead.number != number || store->ahead.state == HADA_AHEAD_IDLE)
        return 0;
    const int ready = store->ahead.state == HADA_AHEAD_READY; /* else it was not begun yet, and need not be */
    store->ahead.state = HADA_AHEAD_IDLE;
    if (!ready)
        return 0;
    *images = store->ahead.images;
    store->ahead.images = (hada_pair_images){0};
    *status = store->ahead.status;
    if (*status && err)
        *err = store->ahead.error;
    return 1;
}

hada_status hada_pair_store_find(hada_pair_store *store, int number, int keep, hada_pair_images *own,
                                 const hada_pair_images **found, hada_error *err)
{
    hada_pair_images *kept = &store->kept[number], read = {0};
    hada_status status = HADA_OK;
    *own = (hada_pair_images){0};
    pthread_mutex_lock(&store->lock);
    const int there = kept->raw.data != NULL;
    const int was_ahead = !there && take_ahead(store, number, &read, &status, err);
    pthread_mutex_unlock(&store->lock);
    *found = kept;
    if (there)
        return HADA_OK;
    if (!was_ahead)
        status = read_images(store, number, &read, err);
    HADA_TRY(status);
    pthread_mutex_lock(&store->lock);
    keep = keep && !kept->raw.data && bytes_of(&read) <= store->room;
    if (keep) {
        store->room -= bytes_of(&read);
        *kept = read;
    }
    pthread_mutex_unlock(&store->lock);
    if (!keep) {
        *own = read;
        *found = own;
    }
    return HADA_OK;
}

void hada_pair_store_place(hada_pair_store *store, hada_place_scene place, void *placement)
{
    drop_pairs(store);
    free(store->placement);
    store->place = place;
    store->placement = placement;
}
