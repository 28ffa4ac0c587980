#include "fit/kept.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

/* The k-th depth of which a pair is kept. */
static int kept_depth(const hada_fit_grid *grid, int k)
{
    return (k * (grid->info.depths - 1) + (HADA_FIT_KEPT - 1) / 2) / (HADA_FIT_KEPT - 1);
}

hada_status hada_fit_keep(hada_fit_kept *kept, const hada_fit_pair *pair, int depth, hada_error *err)
{
    hada_fit_kept_pair own = {.depth = depth};
    int wanted = 0;
    hada_status status = HADA_OK;
    for (int k = 0; k < HADA_FIT_KEPT; k++)
        wanted += kept_depth(pair->grid, k) == depth;
    for (int k = 0; k < kept->count; k++)
        wanted -= kept->pair[k].depth == depth;
    if (wanted <= 0 || kept->count == HADA_FIT_KEPT)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(own.raw = hada_alloc_raw(pair->raw.bytes, 1, "a raw frame", err)));
    HADA_TRY_OR_DONE(hada_allocated(own.scene = hada_alloc_raw(pair->scene.bytes, 1, "a scene", err)));
    memcpy(own.raw, pair->raw_pixels, pair->raw.bytes);
    memcpy(own.scene, pair->scene_pixels, pair->scene.bytes);
    kept->pair[kept->count++] = own;
done:
    if (status)
        free(own.raw);
    return status;
}

void hada_fit_kept_free(hada_fit_kept *kept)
{
    for (int k = 0; k < kept->count; k++) {
        free(kept->pair[k].raw);
        free(kept->pair[k].scene);
        free(kept->pair[k].transfers);
    }
    *kept = (hada_fit_kept){0};
}
