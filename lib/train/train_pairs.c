#include "train/train_pairs.h"

#include <hadalens/response.h>
#include <hadalens/scene.h>

#include "core/callers.h"
#include "core/random.h"

uint64_t hada_pairs_total(const hada_dataset *pairs)
{
    return (uint64_t)hada_dataset_get_info(pairs)->pairs;
}

void hada_pairs_find(const hada_dataset *pairs, uint64_t index, int *depth, int *pair)
{
    const int *counts = hada_dataset_get_info(pairs)->counts;
    *depth = 0;
    while (index >= (uint64_t)counts[*depth])
        index -= (uint64_t)counts[(*depth)++];
    *pair = (int)index;
}

size_t hada_pairs_number(const hada_dataset *pairs, int depth, int pair)
{
    size_t number = (size_t)pair;
    for (int z = 0; z < depth; z++)
        number += (size_t)hada_dataset_get_info(pairs)->counts[z];
    return number;
}

enum { ROUNDS = 6 };

/* A Feistel network on 2 * half bits (Luby and Rackoff, "How to construct pseudorandom permutations from pseudorandom
 * functions", 1988): a permutation, whatever the keys. */
static uint64_t scramble(uint64_t value, int half, const uint32_t *keys)
{
    const uint32_t mask = (uint32_t)((UINT64_C(1) << half) - 1);
    uint32_t left = (uint32_t)(value >> half), right = (uint32_t)value & mask;
    for (int i = 0; i < ROUNDS; i++) {
        uint32_t mix = (right + keys[i]) * UINT32_C(0x9e3779b1);
        mix = (mix ^ (mix >> 15)) * UINT32_C(0x85ebca77);
        mix ^= mix >> 13;
        const uint32_t next = left ^ (mix & mask);
        left = right;
        right = next;
    }
    return (uint64_t)left << half | right;
}

void hada_order_pair(const hada_dataset *pairs, uint64_t seed, uint64_t place, int *depth, int *pair)
{
    const uint64_t total = hada_pairs_total(pairs);
    uint32_t keys[ROUNDS];
    hada_random random;
    int half = 1;
    while (half < 32 && UINT64_C(1) << (2 * half) < total)
        half++;
    hada_random_seed(&random, seed, place / total);
    for (int i = 0; i < ROUNDS; i++)
        keys[i] = hada_random_bits(&random);
    /* Values beyond the list lead on to others until one is on it: still a permutation. */
    uint64_t index = place % total;
    do
        index = scramble(index, half, keys);
    while (index >= total);
    hada_pairs_find(pairs, index, depth, pair);
}

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

void hada_pairs_name(const hada_model_info *info, int depth, int pair, hada_error *err)
{
    if (err)
        hada_error_prefix(err, "pair %d of the depth at %d mm: ", pair + 1, (int)(info->distances_mm[depth] + 0.5));
}

hada_status hada_pairs_load(const hada_dataset *pairs, const hada_model_info *info, int depth, int pair,
                            hada_image *raw, hada_image *scene, hada_error *err)
{
    HADA_TRY(hada_dataset_read(pairs, depth, pair, raw, scene, err));
    HADA_TRY(check(info, raw, scene, err));
    hada_response_convert(scene->data, hada_image_count(scene), info->scene_response, HADA_RESPONSE_LINEAR);
    return HADA_OK;
}

/* The centre of a scene that is larger than the window. */
hada_status hada_pairs_crop(const hada_model_info *info, hada_image *scene, hada_error *err)
{
    const int rows = info->window_rows, cols = info->window_cols;
    hada_image window;
    if (scene->rows == rows && scene->cols == cols)
        return HADA_OK;
    HADA_TRY(hada_image_crop(&window, scene, (scene->rows - rows) / 2, (scene->cols - cols) / 2, rows, cols, err));
    hada_image_destroy(scene);
    *scene = window;
    return HADA_OK;
}

hada_status hada_pairs_read(const hada_dataset *pairs, const hada_model_info *info, int depth, int pair,
                            hada_image *raw, hada_image *scene, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_pairs_load(pairs, info, depth, pair, raw, scene, err));
    HADA_TRY_OR_DONE(hada_pairs_crop(info, scene, err));
done:
    if (status) {
        hada_image_destroy(raw);
        hada_image_destroy(scene);
        hada_pairs_name(info, depth, pair, err);
    }
    return status;
}
