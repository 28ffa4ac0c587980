/* The nearest of many points, found by buckets. */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "optics/mask.h"

static int bucket_of(const hada_sites *sites, double position)
{
    const int bucket = (int)((position + sites->half) / sites->size);
    return bucket < 0 ? 0 : bucket >= sites->buckets ? sites->buckets - 1 : bucket;
}

static int bucket_at(const hada_sites *sites, int i)
{
    return bucket_of(sites, sites->y[i]) * sites->buckets + bucket_of(sites, sites->x[i]);
}

hada_status hada_sites_make(hada_sites *sites, double *x, double *y, int count, double half_width, hada_error *err)
{
    *sites = (hada_sites){.x = x, .y = y, .count = count, .half = half_width};
    sites->buckets = (int)ceil(sqrt((double)count));
    sites->size = 2.0 * half_width / sites->buckets;
    const size_t all = (size_t)sites->buckets * (size_t)sites->buckets;
    void *first, *order = NULL;
    hada_status status = hada_alloc(&first, all + 1, sizeof(int), "places of a mask", err);
    if (!status)
        status = hada_alloc(&order, (size_t)count, sizeof(int), "places of a mask", err);
    sites->first = first;
    sites->order = order;
    if (status) {
        hada_sites_free(sites);
        return status;
    }
    /* counting sort, from the last to the first, so that a bucket's sites stand in their order */
    for (int i = 0; i < count; i++)
        sites->first[bucket_at(sites, i)]++;
    for (size_t b = 1; b <= all; b++)
        sites->first[b] += sites->first[b - 1];
    for (int i = count - 1; i >= 0; i--)
        sites->order[--sites->first[bucket_at(sites, i)]] = i;
    return HADA_OK;
}

void hada_sites_free(hada_sites *sites)
{
    free(sites->x);
    free(sites->y);
    free(sites->first);
    free(sites->order);
    *sites = (hada_sites){0};
}

typedef struct search {
    double x, y, square;
    int best;
} search;

static void look(const hada_sites *sites, int row, int col, search *s)
{
    if (row < 0 || col < 0 || row >= sites->buckets || col >= sites->buckets)
        return;
    const int bucket = row * sites->buckets + col;
    for (int k = sites->first[bucket]; k < sites->first[bucket + 1]; k++) {
        const int i = sites->order[k];
        const double dx = s->x - sites->x[i], dy = s->y - sites->y[i], square = dx * dx + dy * dy;
        if (square < s->square || (square == s->square && i < s->best)) {
            s->square = square;
            s->best = i;
        }
    }
}

/* Rings of buckets round the point's own, until none nearer can be left. */
int hada_sites_nearest(const hada_sites *sites, double x, double y, double *square)
{
    search s = {x, y, HUGE_VAL, -1};
    const int row = bucket_of(sites, y), col = bucket_of(sites, x);
    for (int ring = 0; ring <= sites->buckets; ring++) {
        const double free_of_sites = (ring - 1) * sites->size;
        if (ring > 1 && free_of_sites * free_of_sites > s.square)
            break;
        for (int i = -ring; i <= ring; i++) {
            const int whole = i == -ring || i == ring;
            for (int j = -ring; j <= ring; j += whole || !ring ? 1 : 2 * ring)
                look(sites, row + i, col + j, &s);
        }
    }
    *square = s.square;
    return s.best;
}
