/* Data sets whose pairs the caller reads. */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "dataset/dataset.h"
#include "io/folder.h"
#include "io/text.h"

/* Names as of a folder's files, for messages. */
static hada_status name_pairs(hada_dataset_depth *depth, int count, hada_error *err)
{
    char distance[32];
    hada_status status = HADA_OK;
    hada_format_exact(distance, sizeof distance, depth->distance_mm);
    HADA_TRY(hada_path_format(&depth->folder, err, "z%smm", distance));
    HADA_TRY(hada_allocated(depth->pair = hada_alloc((size_t)count, sizeof *depth->pair, "a data set", err)));
    for (; depth->count < count; depth->count++) {
        hada_dataset_pair *pair = &depth->pair[depth->count];
        pair->number = depth->count;
        HADA_TRY(hada_path_format(&pair->raw, err, "z%smm/raw/%d", distance, pair->number));
        status = hada_path_format(&pair->scene, err, "z%smm/scene/%d", distance, pair->number);
        if (status)
            free(pair->raw);
        HADA_TRY(status);
    }
    return status;
}

static hada_status check(int depths, const double *distances_mm, const int *counts, hada_error *err)
{
    for (int z = 0; z < depths; z++) {
        if (!(isfinite(distances_mm[z]) && distances_mm[z] > (z ? distances_mm[z - 1] : 0.0)))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "distance %d is %g mm: distances are above 0 and stand near to far, no two equal", z,
                             distances_mm[z]);
        if (counts[z] < 1)
            return hada_fail(err, HADA_ERROR_DATASET, "the depth at %g mm has no pair: leave it out, or add some",
                             distances_mm[z]);
    }
    return HADA_OK;
}

hada_status hada_dataset_create(hada_dataset **out, int depths, const double *distances_mm, const int *counts,
                                hada_dataset_read_pair read, void *user, hada_error *err)
{
    hada_dataset *set = NULL;
    hada_status status = HADA_OK;
    if (!out)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_dataset_create: out is needed");
    *out = NULL;
    if (depths < 1 || !distances_mm || !counts || !read)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "hada_dataset_create: depths, their distances, counts and a function to read pairs are needed");
    HADA_TRY_OR_DONE(check(depths, distances_mm, counts, err));
    HADA_TRY_OR_DONE(hada_allocated(set = hada_alloc(1, sizeof *set, "a data set", err)));
    HADA_TRY_OR_DONE(hada_allocated(set->depth = hada_alloc((size_t)depths, sizeof *set->depth, "a data set", err)));
    set->info.depths = depths;
    set->read = read;
    set->user = user;
    for (int z = 0; z < depths; z++) {
        set->depth[z].distance_mm = distances_mm[z];
        HADA_TRY_OR_DONE(name_pairs(&set->depth[z], counts[z], err));
    }
    HADA_TRY_OR_DONE(hada_dataset_count(set, err));
    *out = set;
done:
    if (status && set)
        hada_dataset_destroy(&set);
    return status;
}
