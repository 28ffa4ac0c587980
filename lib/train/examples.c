#include "train/examples.h"

#include <hadalens/scene.h>

#include "image/colour_matrix.h"
#include "image/statistics.h"

void hada_example_free(hada_example *example)
{
    hada_image_destroy(&example->input);
    hada_image_destroy(&example->scene);
}

hada_status hada_example_copy(hada_example *out, const hada_example *example, hada_error *err)
{
    *out = (hada_example){0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_copy(&out->input, &example->input, err));
    HADA_TRY_OR_DONE(hada_image_copy(&out->scene, &example->scene, err));
done:
    if (status)
        hada_example_free(out);
    return status;
}

static hada_status take_dark_off(hada_image *raw, double level, hada_error *err)
{
    const size_t area = (size_t)raw->rows * (size_t)raw->cols;
    float *room = NULL;
    hada_status status = HADA_OK;
    if (level == HADA_AUTO)
        HADA_TRY_OR_DONE(HADA_NEW(room, area, "a frame's dark level", err));
    for (int c = 0; c < raw->channels; c++) {
        float *at = raw->data + (size_t)c * area;
        const double dark = room ? hada_dark_estimate(at, area, room) : level;
        for (size_t i = 0; dark != 0.0 && i < area; i++)
            at[i] = (float)((double)at[i] - dark);
    }
done:
    free(room);
    return status;
}

hada_status hada_example_make(hada_example *out, hada_stage stage, const hada_model_info *info, hada_planes *planes,
                              int depth, hada_image *raw, const hada_composed *composed, hada_image *scene,
                              hada_error *err)
{
    hada_status status = HADA_OK;
    *out = (hada_example){0};
    if (planes) {
        HADA_TRY_OR_DONE(hada_planes_make(planes, depth, raw, composed, &out->input, err));
    } else {
        HADA_TRY_OR_DONE(take_dark_off(raw, info->dark, err));
        if (stage == HADA_STAGE_CONVENTIONAL) {
            HADA_TRY_OR_DONE(hada_image_resize(&out->input, raw, info->window_rows, info->window_cols, err));
        } else {
            hada_colours_unmix(raw->data, (size_t)raw->rows * (size_t)raw->cols, info->colour_matrix);
            out->input = *raw;
            *raw = (hada_image){0};
        }
    }
    out->scene = *scene;
    *scene = (hada_image){0};
done:
    if (status)
        hada_example_free(out);
    return status;
}

/* A pair as it was captured, and the scenes that it becomes. */
enum { WAYS = HADA_COMPOSED_VARIANTS + 1 };

hada_status hada_examples_create(hada_examples *examples, const hada_dataset *pairs, size_t most, hada_error *err)
{
    *examples = (hada_examples){.pairs = pairs, .most = most};
    HADA_TRY(
        HADA_NEW(examples->kept, hada_size_product((size_t)hada_pairs_total(pairs), WAYS), "the list of pairs", err));
    examples->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    return HADA_OK;
}

void hada_examples_free(hada_examples *examples)
{
    if (!examples->kept)
        return;
    const uint64_t total = hada_pairs_total(examples->pairs) * WAYS;
    for (uint64_t i = 0; i < total; i++)
        hada_example_free(&examples->kept[i]);
    free(examples->kept);
    pthread_mutex_destroy(&examples->lock);
    *examples = (hada_examples){0};
}

static hada_example *place_of(hada_examples *examples, int depth, int pair, int variant)
{
    return examples->kept + hada_pairs_number(examples->pairs, depth, pair) * WAYS + (size_t)variant;
}

const hada_example *hada_examples_find(hada_examples *examples, int depth, int pair, int variant)
{
    hada_example *at = place_of(examples, depth, pair, variant);
    pthread_mutex_lock(&examples->lock);
    const int kept = at->input.data != NULL;
    pthread_mutex_unlock(&examples->lock);
    return kept ? at : NULL;
}

const hada_example *hada_examples_add(hada_examples *examples, int depth, int pair, int variant, hada_example *example)
{
    hada_example *at = place_of(examples, depth, pair, variant);
    const size_t bytes = (hada_image_count(&example->input) + hada_image_count(&example->scene)) * sizeof(float);
    pthread_mutex_lock(&examples->lock);
    if (!at->input.data && bytes <= examples->most - examples->bytes) {
        examples->bytes += bytes;
        *at = *example;
        *example = (hada_example){0};
    }
    const int kept = at->input.data != NULL;
    pthread_mutex_unlock(&examples->lock);
    return kept ? at : NULL;
}
