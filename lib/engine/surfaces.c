#include "engine/surfaces.h"

#include <pthread.h>
#include <stdlib.h>

#include "core/alloc.h"

/* A camera whose neighbouring depths do not predict one another this well has no optics between them. The share is that
 * of each depth's PSF, predicted from both neighbours; in between it is about a quarter (docs/surfaces.md). */
#define MOST_UNEXPLAINED 0.8

struct hada_surfaces {
    pthread_mutex_t lock;
    hada_magnification law; /* no depths: not measured yet */
    uint64_t each;          /* bytes of one */
    int made;
};

hada_status hada_surfaces_create(hada_surfaces **out, hada_error *err)
{
    HADA_TRY(hada_allocated(*out = hada_alloc(1, sizeof **out, "a plan", err)));
    pthread_mutex_init(&(*out)->lock, NULL);
    return HADA_OK;
}

void hada_surfaces_destroy(hada_surfaces **pointer)
{
    if (!*pointer)
        return;
    hada_magnification_free(&(*pointer)->law);
    pthread_mutex_destroy(&(*pointer)->lock);
    free(*pointer);
    *pointer = NULL;
}

static hada_status check_law(const hada_magnification *law, hada_error *err)
{
    const double unexplained = law->unexplained[law->kind];
    if (unexplained < MOST_UNEXPLAINED)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_MODEL,
                     "neighbouring depths of this camera have too little in common for optics between them "
                     "(%.0f %% of a PSF stays unexplained): learn more depths, or take --scene planes",
                     100 * unexplained);
}

static hada_status check_memory(const hada_context *context, const hada_surfaces_desc *desc, uint64_t bytes,
                                hada_error *err)
{
    if (bytes <= desc->most_bytes)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_DEVICE_MEMORY,
                     "a surface takes %.0f MiB of %s on each queue, and %.0f MiB are left for it: take fewer queues, "
                     "fewer depths (--depths), or --scene planes",
                     (double)bytes / 0x1p20, context->info.name, (double)desc->most_bytes / 0x1p20);
}

/* With the lock held. */
static hada_status make(hada_surfaces *surfaces, hada_surface **out, hada_slot *slot, const hada_surfaces_desc *desc,
                        hada_error *err)
{
    if (!surfaces->law.depths) {
        HADA_TRY(
            check_memory(slot->context, desc, hada_magnification_measure_bytes(slot->context, &desc->camera), err));
        HADA_TRY(hada_magnification_measure(&surfaces->law, slot, &desc->camera, desc->distances_mm, err));
    }
    HADA_TRY(check_law(&surfaces->law, err));
    surfaces->each = hada_surface_bytes(slot->context, &desc->camera, &desc->shape, &surfaces->law);
    HADA_TRY(check_memory(slot->context, desc, surfaces->each + hada_surface_making_bytes(slot->context, &desc->camera),
                          err));
    HADA_TRY(hada_surface_create(out, slot, &desc->camera, &desc->shape, &surfaces->law, err));
    surfaces->made++;
    return HADA_OK;
}

hada_status hada_surfaces_make(hada_surfaces *surfaces, hada_surface **out, hada_slot *slot,
                               const hada_surfaces_desc *desc, hada_error *err)
{
    pthread_mutex_lock(&surfaces->lock);
    const hada_status status = make(surfaces, out, slot, desc, err);
    pthread_mutex_unlock(&surfaces->lock);
    return status;
}

void hada_surfaces_unmake(hada_surfaces *surfaces, hada_surface **surface)
{
    if (!*surface)
        return;
    hada_surface_destroy(surface);
    pthread_mutex_lock(&surfaces->lock);
    surfaces->made--;
    pthread_mutex_unlock(&surfaces->lock);
}

uint64_t hada_surfaces_bytes(hada_surfaces *surfaces)
{
    pthread_mutex_lock(&surfaces->lock);
    const uint64_t bytes = (uint64_t)surfaces->made * surfaces->each;
    pthread_mutex_unlock(&surfaces->lock);
    return bytes;
}
