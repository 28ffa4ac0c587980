/* Data sets and their parts, and what a part makes of a pair that was read. */
#include "dataset/dataset.h"

#include <hadalens/response.h>
#include <hadalens/tiff.h>

#include "core/callers.h"
#include "core/numbers.h"
#include "image/correct.h"
#include "image/statistics.h"
#include "io/folder.h"
#include "io/text.h"
#include "io/tiff_page.h"

void hada_dataset_destroy(hada_dataset **dataset)
{
    hada_dataset *set = hada_taken(dataset);
    if (!set)
        return;
    hada_pair_store_release(&set->store);
    HADA_FREE(set->first, set->counts, set->number, set->listed, set->distances_mm, set->files, set->gain, set);
}

const hada_dataset_info *hada_dataset_get_info(const hada_dataset *dataset)
{
    return dataset ? &dataset->info : NULL;
}

/* Where the pairs of a depth begin among those of this part. */
static size_t before(const hada_dataset *set, int depth)
{
    size_t count = 0;
    for (int z = 0; z < depth; z++)
        count += (size_t)set->counts[z];
    return count;
}

/* The number of a pair of this part within its depth. */
static int number_of(const hada_dataset *set, int depth, int pair)
{
    return set->number ? set->number[before(set, depth) + (size_t)pair] : set->first[depth] + pair;
}

int hada_pair_number(const hada_dataset *dataset, int depth, int pair)
{
    return dataset->store->depth[depth].before + number_of(dataset, depth, pair);
}

/* The files of pairs that do not stand one after the other. */
static hada_status list_files(hada_dataset *set, hada_error *err)
{
    size_t at = 0;
    HADA_TRY(HADA_NEW(set->listed, (size_t)set->info.pairs, "a data set", err));
    for (int z = 0; z < set->store->depths; z++) {
        set->files[z] = set->listed + at;
        for (int i = 0; i < set->counts[z]; i++)
            set->listed[at++] = set->store->depth[z].files[number_of(set, z, i)];
    }
    return HADA_OK;
}

/* Fills `info` from the pairs that belong to this part. */
static hada_status describe(hada_dataset *set, hada_error *err)
{
    const hada_pair_store *store = set->store;
    const size_t depths = (size_t)store->depths;
    hada_dataset_info *info = &set->info;
    HADA_TRY(HADA_NEW(set->distances_mm, depths, "a data set", err));
    HADA_TRY(HADA_NEW(set->files, depths, "a data set", err));
    *info = (hada_dataset_info){.depths = store->depths,
                                .distances_mm = set->distances_mm,
                                .counts = set->counts,
                                .least_pairs = set->counts[0],
                                .has_files = !store->read && !store->raws,
                                .folders = (const char *const *)store->folders,
                                .files = set->files,
                                .psf = store->psf,
                                .camera = store->camera,
                                .incomplete = store->incomplete,
                                .incomplete_text = store->incomplete_text,
                                .mosaic = store->mosaic,
                                .dark_frame = set->darkened      ? set->darkened
                                              : store->dark.data ? &store->dark
                                                                 : NULL,
                                .flat = set->mended        ? set->mended
                                        : store->flat.data ? &store->flat
                                                           : NULL,
                                .downsample = store->downsample,
                                .sensor_mosaic = store->sensor_mosaic};
    for (int z = 0; z < store->depths; z++) {
        set->distances_mm[z] = store->depth[z].distance_mm;
        set->files[z] = store->depth[z].files + set->first[z];
        info->pairs += set->counts[z];
        info->least_pairs = set->counts[z] < info->least_pairs ? set->counts[z] : info->least_pairs;
    }
    return set->number ? list_files(set, err) : HADA_OK;
}

static hada_status make(hada_dataset **out, hada_pair_store *store, hada_error *err)
{
    const size_t depths = (size_t)store->depths;
    HADA_TRY(HADA_NEW(*out, 1, "a data set", err));
    HADA_TRY(HADA_NEW((*out)->first, depths, "a data set", err));
    return HADA_NEW((*out)->counts, depths, "a data set", err);
}

hada_status hada_dataset_open(hada_dataset **out, hada_pair_store *store, hada_error *err)
{
    hada_dataset *set = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(store->folders, (size_t)store->depths, "a data set", err));
    for (int z = 0; z < store->depths; z++) {
        store->depth[z].before = store->pairs;
        store->folders[z] = store->depth[z].folder;
        store->pairs += store->depth[z].count;
    }
    HADA_TRY_OR_DONE(HADA_NEW(store->kept, (size_t)store->pairs, "a data set", err));
    HADA_TRY_OR_DONE(make(&set, store, err));
    for (int z = 0; z < store->depths; z++)
        set->counts[z] = store->depth[z].count;
    set->store = store;
    store = NULL;
    HADA_TRY_OR_DONE(describe(set, err));
    *out = set;
    set = NULL;
done:
    hada_pair_store_release(&store);
    hada_dataset_destroy(&set);
    return status;
}

/* Takes part in the store of another part, whose pairs from `first` on it has. */
static hada_status use_store(hada_dataset *set, const hada_dataset *from, const int *first, hada_error *err)
{
    const int depths = from->info.depths;
    pthread_mutex_lock(&from->store->lock);
    set->store = from->store;
    set->store->users++;
    pthread_mutex_unlock(&from->store->lock);
    set->filled = from->filled;
    set->mended = from->mended;
    memcpy(set->unmix, from->unmix, sizeof set->unmix);
    set->encoding = from->encoding;
    set->darkened = from->darkened;
    set->light = from->light;
    set->balance = from->balance;
    set->channels = from->channels;
    if (!from->number)
        return HADA_OK;
    HADA_TRY(HADA_NEW(set->number, before(set, depths), "a data set", err));
    for (int z = 0; z < depths; z++)
        for (int i = 0; i < set->counts[z]; i++)
            set->number[before(set, z) + (size_t)i] = number_of(from, z, first[z] + i);
    return HADA_OK;
}

/* A part: of each depth, `counts` pairs from `first` on. */
static hada_status dataset_part(hada_dataset **out, const hada_dataset *from, const int *first, const int *counts,
                                hada_error *err)
{
    hada_dataset *set = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(make(&set, from->store, err));
    for (int z = 0; z < from->info.depths; z++) {
        set->first[z] = from->first[z] + first[z];
        set->counts[z] = counts[z];
    }
    HADA_TRY_OR_DONE(use_store(set, from, first, err));
    HADA_TRY_OR_DONE(describe(set, err));
    if (from->gain) {
        HADA_TRY_OR_DONE(HADA_NEW(set->gain, (size_t)set->info.pairs, "the exposures of a data set", err));
        for (int z = 0; z < set->info.depths; z++)
            for (int i = 0; i < counts[z]; i++)
                set->gain[before(set, z) + (size_t)i] = from->gain[before(from, z) + (size_t)(first[z] + i)];
        set->response = from->response;
    }
    *out = set;
    set = NULL;
done:
    hada_dataset_destroy(&set);
    return status;
}

hada_status hada_dataset_select(hada_dataset **out, const hada_dataset *from, const unsigned char *const *leave,
                                hada_error *err)
{
    const int depths = from->info.depths;
    hada_dataset view = *from; /* of all pairs, those that are kept first: a part of it are the ones that are wanted */
    int *none = NULL, *counts = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    view.number = NULL;
    view.gain = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(none, (size_t)depths, "a data set", err));
    HADA_TRY_OR_DONE(HADA_NEW(counts, (size_t)depths, "a data set", err));
    HADA_TRY_OR_DONE(HADA_NEW(view.number, (size_t)from->info.pairs, "a data set", err));
    if (from->gain)
        HADA_TRY_OR_DONE(HADA_NEW(view.gain, (size_t)from->info.pairs, "a data set", err));
    for (int z = 0; z < depths; z++)
        for (int i = 0; i < from->counts[z]; i++) {
            const size_t to = before(from, z) + (size_t)counts[z];
            if (leave[z][i])
                continue;
            view.number[to] = number_of(from, z, i);
            if (from->gain)
                view.gain[to] = from->gain[before(from, z) + (size_t)i];
            counts[z]++;
        }
    HADA_TRY_OR_DONE(dataset_part(out, &view, none, counts, err));
done:
    HADA_FREE(none, counts, view.number, view.gain);
    return status;
}

/* All pairs of another part. */
static hada_status whole_part(hada_dataset **out, const hada_dataset *from, hada_error *err)
{
    int *none = NULL;
    HADA_TRY(HADA_NEW(none, (size_t)from->info.depths, "a data set", err));
    const hada_status status = dataset_part(out, from, none, from->counts, err);
    free(none);
    return status;
}

hada_status hada_dataset_fill(hada_dataset **out, const hada_dataset *from, const hada_filled_scenes *filled,
                              hada_error *err)
{
    *out = NULL;
    HADA_TRY(whole_part(out, from, err));
    (*out)->filled = filled;
    return HADA_OK;
}

hada_status hada_dataset_mend(hada_dataset **out, const hada_dataset *from, const hada_image *flat,
                              const hada_image *dark, hada_error *err)
{
    *out = NULL;
    HADA_TRY(whole_part(out, from, err));
    hada_dataset *set = *out;
    if (flat)
        set->mended = set->info.flat = flat;
    if (dark)
        set->darkened = set->info.dark_frame = dark;
    return HADA_OK;
}

hada_status hada_dataset_brighten(hada_dataset **out, const hada_dataset *from, const double *const *gains,
                                  double response, hada_error *err)
{
    const int depths = from->info.depths;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(whole_part(out, from, err));
    hada_dataset *set = *out;
    if (gains && !set->gain)
        HADA_TRY_OR_DONE(HADA_NEW(set->gain, (size_t)set->info.pairs, "the exposures of a data set", err));
    for (int z = 0; gains && z < depths; z++)
        for (int i = 0; i < set->counts[z]; i++) {
            double *gain = &set->gain[before(set, z) + (size_t)i];
            *gain = (from->gain ? *gain : 1.0) * gains[z][i];
        }
    set->response = response;
done:
    if (status)
        hada_dataset_destroy(out);
    return status;
}

hada_status hada_dataset_unmix(hada_dataset **out, const hada_dataset *from, const double m[HADA_COLOUR_MATRIX],
                               hada_error *err)
{
    HADA_TRY(whole_part(out, from, err));
    if (hada_colours_known(m))
        hada_colours_invert(m, (*out)->unmix);
    return HADA_OK;
}

hada_status hada_dataset_unlit(hada_dataset **out, const hada_dataset *from, const double *light, int channels,
                               hada_error *err)
{
    HADA_TRY(whole_part(out, from, err));
    (*out)->light = light;
    (*out)->channels = channels;
    return HADA_OK;
}

hada_status hada_dataset_balance(hada_dataset **out, const hada_dataset *from, const double *balance, int channels,
                                 hada_error *err)
{
    HADA_TRY(whole_part(out, from, err));
    (*out)->balance = balance;
    (*out)->channels = channels;
    return HADA_OK;
}

hada_status hada_dataset_decode(hada_dataset **out, const hada_dataset *from, double encoding, hada_error *err)
{
    HADA_TRY(whole_part(out, from, err));
    (*out)->encoding = encoding;
    return HADA_OK;
}

static hada_status count_held(const hada_dataset *set, double hold_out, int *held, hada_error *err)
{
    for (int z = 0; z < set->info.depths; z++) {
        const int pairs = set->counts[z];
        held[z] = hold_out >= 1.0 ? (int)hold_out : (int)floor(hold_out * pairs + 0.5);
        if (hold_out > 0.0 && !held[z] && pairs >= 3)
            held[z] = 1;
        if (held[z] >= pairs)
            return hada_fail(err, HADA_ERROR_DATASET,
                             "%s has %d pair%s: nothing would be left to learn from with %d held out; give "
                             "options.hold_out a smaller number",
                             set->info.folders[z], pairs, pairs == 1 ? "" : "s", held[z]);
    }
    return HADA_OK;
}

hada_status hada_dataset_split(const hada_dataset *dataset, double hold_out, hada_dataset **learn,
                               hada_dataset **held_out, hada_error *err)
{
    int *held = NULL, *left, *none;
    hada_status status = HADA_OK;
    HADA_NEED(dataset && learn && held_out, err);
    const int depths = dataset->info.depths;
    *learn = *held_out = NULL;
    if (!(hold_out >= 0.0) || (hold_out >= 1.0 && hold_out != floor(hold_out)) || hold_out > 1e6)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.hold_out is a number of pairs of each depth, or a share such as 0.2; not %g",
                         hold_out);
    HADA_TRY_OR_DONE(HADA_NEW(held, 3 * (size_t)depths, "a data set", err));
    left = held + depths;
    none = left + depths;
    HADA_TRY_OR_DONE(count_held(dataset, hold_out, held, err));
    for (int z = 0; z < depths; z++)
        left[z] = dataset->counts[z] - held[z];
    HADA_TRY_OR_DONE(dataset_part(learn, dataset, none, left, err));
    HADA_TRY_OR_DONE(dataset_part(held_out, dataset, left, held, err));
done:
    if (status)
        hada_dataset_destroy(learn);
    free(held);
    return status;
}

/* The names that files would have, for messages. */
static hada_status name_pairs(hada_dataset_depth *depth, int count, hada_error *err)
{
    char distance[32], *raw = NULL, *scene = NULL;
    hada_status status = HADA_OK;
    hada_format_exact(distance, sizeof distance, depth->distance_mm);
    HADA_TRY(hada_path_format(&depth->folder, err, "z%smm", distance));
    HADA_TRY(HADA_NEW(depth->files, (size_t)count, "a data set", err));
    while (depth->count < count) {
        HADA_TRY_OR_DONE(hada_path_format(&raw, err, "z%smm/raw/%d", distance, depth->count));
        HADA_TRY_OR_DONE(hada_path_format(&scene, err, "z%smm/scene/%d", distance, depth->count));
        depth->files[depth->count++] = (hada_pair_files){raw, scene};
        raw = scene = NULL;
    }
done:
    HADA_FREE(raw, scene);
    return status;
}

static hada_status check(int depths, const double *distances_mm, const int *counts, hada_error *err)
{
    for (int z = 0; z < depths; z++)
        if (counts[z] < 0)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "the depth at %g mm cannot have %d pairs", distances_mm[z],
                             counts[z]);
    return hada_distances_check(distances_mm, depths, err);
}

/* The depths of a data set without files, in an empty store, which it takes over. */
static hada_status open_named(hada_dataset **out, hada_pair_store *store, int depths, const double *distances_mm,
                              const int *counts, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(check(depths, distances_mm, counts, err));
    HADA_TRY_OR_DONE(HADA_NEW(store->depth, (size_t)depths, "a data set", err));
    while (store->depths < depths) {
        const int z = store->depths++;
        store->depth[z].distance_mm = distances_mm[z];
        HADA_TRY_OR_DONE(name_pairs(&store->depth[z], counts[z], err));
    }
    return hada_dataset_open(out, store, err);
done:
    hada_pair_store_release(&store);
    return status;
}

hada_status hada_dataset_create(hada_dataset **out, int depths, const double *distances_mm, const int *counts,
                                hada_dataset_read_pair read, void *user, const hada_dataset_options *options,
                                hada_error *err)
{
    hada_pair_store *store = NULL;
    HADA_NEED(out, err);
    *out = NULL;
    if (depths < 1 || !distances_mm || !counts || !read)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "hada_dataset_create: depths, their distances, counts and a function to read pairs are needed");
    HADA_TRY(hada_pair_store_create(&store, options, err));
    store->read = read;
    store->user = user;
    return open_named(out, store, depths, distances_mm, counts, err);
}

hada_status hada_dataset_from_weighted(hada_dataset **out, int depths, const double *distances_mm, const int *counts,
                                       const hada_image *raws, const hada_image *scenes, const hada_image *weights,
                                       hada_error *err)
{
    hada_pair_store *store = NULL;
    HADA_NEED(out, err);
    *out = NULL;
    if (depths < 1 || !distances_mm || !counts || !raws || !scenes)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_dataset_from_images: depths, their distances, counts, raw frames and scenes are needed");
    HADA_TRY(hada_pair_store_create(&store, NULL, err));
    store->raws = raws;
    store->scenes = scenes;
    store->weights = weights;
    return open_named(out, store, depths, distances_mm, counts, err);
}

hada_status hada_dataset_from_images(hada_dataset **out, int depths, const double *distances_mm, const int *counts,
                                     const hada_image *raws, const hada_image *scenes, hada_error *err)
{
    return hada_dataset_from_weighted(out, depths, distances_mm, counts, raws, scenes, NULL, err);
}

void hada_pair_expect(const hada_dataset *dataset, int depth, int number)
{
    hada_pair_store_expect(dataset->store, hada_pair_number(dataset, depth, number));
}

/* Makes a scene so many times as bright in linear light, in its own encoding. */
static void brighten(hada_image *scene, double gain, double response)
{
    const size_t count = scene->data ? hada_image_count(scene) : 0;
    hada_response_convert(scene->data, count, response, HADA_RESPONSE_LINEAR);
    for (size_t i = 0; i < count; i++)
        scene->data[i] *= (float)gain;
    hada_response_convert(scene->data, count, HADA_RESPONSE_LINEAR, response);
}

/* The raw frame as the pair's own image, which may be changed. */
static hada_status own_raw(hada_pair *pair, hada_error *err)
{
    if (!pair->own.raw.data)
        HADA_TRY(hada_image_copy(&pair->own.raw, pair->raw, err));
    pair->raw = &pair->own.raw;
    return HADA_OK;
}

/* What this part alone mends, in the pair's own image. A pair of another size is refused by who takes it, and so is one
 * with values that are not finite, which stay. */
static hada_status mend(hada_pair *pair, const hada_dataset *dataset, hada_error *err)
{
    const hada_mosaic mosaic = dataset->store->mosaic;
    const int repairs = hada_dark_fits(dataset->mended, pair->raw, mosaic) && !hada_image_count_not_finite(pair->raw);
    const int darkens = hada_dark_fits(dataset->darkened, pair->raw, mosaic);
    if (!repairs && !darkens)
        return HADA_OK;
    HADA_TRY(own_raw(pair, err));
    if (darkens)
        hada_dark_subtract(&pair->own.raw, mosaic, dataset->darkened);
    return repairs ? hada_flat_repair(&pair->own.raw, mosaic, dataset->mended, err) : HADA_OK;
}

/* A raw frame, or its weights, of one channel with all colours of a mosaic, in the pair's own image. */
static hada_status fill_image(const hada_image **image, hada_image *own, hada_mosaic mosaic, hada_error *err)
{
    hada_image filled = {0};
    HADA_TRY(hada_mosaic_colours(mosaic, *image, &filled, err));
    hada_image_destroy(own);
    *own = filled;
    *image = own;
    return HADA_OK;
}

/* A pair with all colours of a mosaic. */
static hada_status fill(hada_pair *pair, hada_mosaic mosaic, hada_error *err)
{
    const hada_image *raw = pair->raw;
    if (raw->channels != 1 || raw->rows < 2 || raw->cols < 2)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "the raw frame has %d channels of %d x %d pixels; a colour filter mosaic has one channel and "
                         "at least 2 x 2 pixels: leave options.mosaic out if it is none",
                         raw->channels, raw->rows, raw->cols);
    HADA_TRY(fill_image(&pair->raw, &pair->own.raw, mosaic, err));
    if (!pair->weights)
        return HADA_OK;
    HADA_TRY(fill_image(&pair->weights, &pair->own.weights, mosaic, err));
    hada_weights_bound(&pair->own.weights);
    return HADA_OK;
}

/* A grey scene as the screen showed it, for a frame in colours. */
static hada_status colour_scene(hada_pair *pair, hada_error *err)
{
    hada_image coloured = {0};
    HADA_TRY(hada_image_repeat(&coloured, pair->scene, HADA_COLOURS, err));
    hada_image_destroy(&pair->own.scene);
    pair->own.scene = coloured;
    pair->scene = &pair->own.scene;
    return HADA_OK;
}

/* A pair whose frame is brought to the scene's colours. */
static hada_status unmix(hada_pair *pair, const double inverse[HADA_COLOUR_MATRIX], hada_error *err)
{
    HADA_TRY(own_raw(pair, err));
    hada_colours_mix(pair->own.raw.data, hada_image_count(pair->raw) / HADA_COLOURS, inverse);
    if (!pair->weights)
        return HADA_OK;
    if (!pair->own.weights.data)
        HADA_TRY(hada_image_copy(&pair->own.weights, pair->weights, err));
    pair->weights = &pair->own.weights;
    hada_colours_weigh(pair->own.weights.data, pair->raw->rows, pair->raw->cols, HADA_MOSAIC_NONE);
    return HADA_OK;
}

/* A frame without light of its own, and of the white balance that all have. */
static hada_status correct(hada_pair *pair, const hada_dataset *dataset, int number, hada_error *err)
{
    const size_t first = (size_t)(number * dataset->channels);
    HADA_TRY(own_raw(pair, err));
    hada_image *raw = &pair->own.raw;
    if (dataset->light)
        hada_smooth_add(dataset->light + first * HADA_SMOOTH_TERMS, -1.0, raw);
    const size_t area = hada_image_count(raw) / (size_t)raw->channels;
    for (size_t i = 0; dataset->balance && i < hada_image_count(raw); i++)
        raw->data[i] *= (float)dataset->balance[first + i / area];
    return HADA_OK;
}

/* Puts the scene that is in place of the pair's, where there is one. */
static void replace_scene(hada_pair *pair, const hada_filled_scenes *filled, int number)
{
    for (int i = 0; filled && i < filled->count; i++)
        if (filled->list[i].number == number) {
            hada_image_destroy(&pair->own.scene);
            pair->scene = &filled->list[i].scene;
        }
}

static hada_status take(hada_pair *pair, const hada_dataset *dataset, int depth, int number, int keep, hada_error *err)
{
    hada_pair_store *store = dataset->store;
    const int index = hada_pair_number(dataset, depth, number);
    const double gain = dataset->gain ? dataset->gain[before(dataset, depth) + (size_t)number] : 1.0;
    const hada_pair_images *found = NULL;
    hada_status status = HADA_OK;
    *pair = (hada_pair){0};
    if (store->raws) {
        pair->raw = &store->raws[index];
        pair->scene = &store->scenes[index];
        HADA_TRY(hada_image_check(pair->raw, NULL, "a data set", "a raw frame", err));
        HADA_TRY(hada_image_check(pair->scene, NULL, "a data set", "a scene", err));
        pair->weights = store->weights ? &store->weights[index] : &pair->own.weights;
        if (!store->weights)
            HADA_TRY(hada_saturated_weigh(pair->raw, store->mosaic, &pair->own.weights, err));
    } else {
        HADA_TRY(hada_pair_store_find(store, index, keep, &pair->own, &found, err));
        pair->raw = &found->raw;
        pair->scene = &found->scene;
        pair->weights = &found->weights;
    }
    if (!pair->weights->data)
        pair->weights = NULL;
    replace_scene(pair, dataset->filled, index);
    if (dataset->encoding != 0.0) {
        HADA_TRY_OR_DONE(own_raw(pair, err));
        hada_response_convert(pair->own.raw.data, hada_image_count(pair->raw), dataset->encoding, HADA_RESPONSE_LINEAR);
    }
    HADA_TRY_OR_DONE(mend(pair, dataset, err));
    if (store->mosaic != HADA_MOSAIC_NONE && (status = fill(pair, store->mosaic, err)) != HADA_OK) {
        hada_pair_name(dataset, depth, number, err);
        goto done;
    }
    if (pair->scene->channels == 1 && pair->raw->channels == HADA_COLOURS)
        HADA_TRY_OR_DONE(colour_scene(pair, err));
    if ((dataset->light || dataset->balance) && pair->raw->channels == dataset->channels)
        HADA_TRY_OR_DONE(correct(pair, dataset, index, err));
    if (hada_colours_known(dataset->unmix) && pair->raw->channels == HADA_COLOURS)
        HADA_TRY_OR_DONE(unmix(pair, dataset->unmix, err));
    if (gain != 1.0) {
        if (!pair->own.scene.data)
            HADA_TRY_OR_DONE(hada_image_copy(&pair->own.scene, pair->scene, err));
        brighten(&pair->own.scene, gain, dataset->response);
        pair->scene = &pair->own.scene;
    }
done:
    if (status)
        hada_pair_return(pair);
    return status;
}

hada_status hada_pair_take(hada_pair *pair, const hada_dataset *dataset, int depth, int number, hada_error *err)
{
    return take(pair, dataset, depth, number, 1, err);
}

hada_status hada_pair_load_raw(const hada_dataset *dataset, int depth, int pair, hada_image *image, hada_error *err)
{
    hada_pair_store *store = dataset->store;
    const int number = number_of(dataset, depth, pair);
    hada_image scene = {0};
    hada_status status = HADA_OK;
    *image = (hada_image){0};
    if (store->raws) {
        const hada_image *raw = &store->raws[hada_pair_number(dataset, depth, pair)];
        HADA_TRY(hada_image_check(raw, NULL, "a data set", "a raw frame", err));
        status = hada_image_copy(image, raw, err);
    } else if (store->read) {
        status = hada_pair_store_call(store, depth, number, image, &scene, err);
        hada_image_destroy(&scene);
    } else {
        status = hada_tiff_load_light(store->depth[depth].files[number].raw, 0, store->frame_encoding, image, err);
    }
    HADA_TRY(status);
    if (dataset->encoding != 0.0)
        hada_response_convert(image->data, hada_image_count(image), dataset->encoding, HADA_RESPONSE_LINEAR);
    return HADA_OK;
}

void hada_pair_return(hada_pair *pair)
{
    hada_pair_images_free(&pair->own);
    *pair = (hada_pair){0};
}

void hada_pair_name(const hada_dataset *dataset, int depth, int number, hada_error *err)
{
    const hada_pair_files *files = &dataset->files[depth][number];
    if (err)
        hada_error_prefix(err, "%s and %s: ", files->raw, files->scene);
}

hada_status hada_dataset_read(const hada_dataset *dataset, int depth, int pair, hada_image *raw, hada_image *scene,
                              hada_error *err)
{
    hada_pair taken = {0};
    hada_status status = HADA_OK;
    HADA_NEED(raw && scene, err);
    *raw = *scene = (hada_image){0};
    if (!dataset || depth < 0 || depth >= dataset->info.depths || pair < 0 || pair >= dataset->counts[depth])
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the data set has no pair %d of depth %d", pair, depth);
    HADA_TRY_OR_DONE(take(&taken, dataset, depth, pair, 0, err));
    HADA_TRY_OR_DONE(own_raw(&taken, err));
    if (!taken.own.scene.data)
        HADA_TRY_OR_DONE(hada_image_copy(&taken.own.scene, taken.scene, err));
    *raw = taken.own.raw;
    *scene = taken.own.scene;
    taken.own = (hada_pair_images){0};
done:
    hada_pair_return(&taken);
    return status;
}
