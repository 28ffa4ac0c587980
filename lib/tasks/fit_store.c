#include "tasks/fit_store.h"

#include <hadalens/scene.h>
#include <stdlib.h>

#include "core/alloc.h"

/* For pairs that are kept: some hundred of a small camera. Beyond it they are read anew, so that memory does not grow
 * with their number. */
#define ROOM ((size_t)256 << 20)

hada_status hada_fit_store_create(hada_fit_store *store, const hada_dataset *data, hada_error *err)
{
    *store = (hada_fit_store){.count = hada_dataset_get_info(data)->pairs, .room = ROOM};
    return hada_allocated(store->pairs = hada_alloc((size_t)store->count, sizeof *store->pairs, "pairs", err));
}

static void images_free(hada_fit_pair_images *images)
{
    hada_image_destroy(&images->raw);
    hada_image_destroy(&images->scene);
}

void hada_fit_store_free(hada_fit_store *store)
{
    for (int i = 0; store->pairs && i < store->count; i++)
        images_free(&store->pairs[i]);
    free(store->pairs);
    *store = (hada_fit_store){0};
}

static hada_fit_pair_images *place_of(hada_fit_store *store, const hada_dataset *data, int z, int i)
{
    int before = 0;
    for (int k = 0; k < z; k++)
        before += hada_dataset_get_info(data)->counts[k];
    return store && store->pairs ? &store->pairs[before + i] : NULL;
}

/* What was read goes into its place, where there is room. */
static void keep(hada_fit_loan *loan, hada_fit_store *store, hada_fit_pair_images *place)
{
    const size_t bytes = (hada_image_count(&loan->own.raw) + hada_image_count(&loan->own.scene)) * sizeof(float);
    if (bytes > store->room)
        return;
    store->room -= bytes;
    *place = loan->own;
    loan->own = (hada_fit_pair_images){0};
}

hada_status hada_fit_loan_take(hada_fit_loan *loan, hada_fit_store *store, const hada_dataset *data,
                               const hada_survey *survey, int z, int i, hada_error *err)
{
    hada_fit_pair_images *place = place_of(store, data, z, i);
    *loan = (hada_fit_loan){0};
    if (!place || !place->raw.data) {
        HADA_TRY(hada_dataset_read(data, z, i, &loan->own.raw, &loan->own.scene, err));
        if (place)
            keep(loan, store, place);
    }
    const hada_fit_pair_images *from = place && place->raw.data ? place : &loan->own;
    loan->raw = &from->raw;
    loan->scene = &from->scene;
    if (survey && hada_survey_gain(survey, z, i) != 1.0) {
        if (from == place)
            HADA_TRY(hada_image_crop(&loan->own.scene, &from->scene, 0, 0, from->scene.rows, from->scene.cols, err));
        hada_survey_even(survey, z, i, &loan->own.scene);
        loan->scene = &loan->own.scene;
    }
    return HADA_OK;
}

void hada_fit_loan_return(hada_fit_loan *loan)
{
    images_free(&loan->own);
    *loan = (hada_fit_loan){0};
}
