/* The nearest of many points, found by buckets. */

#include "optics/mask.h"

#define BUCKETS_MOST 512 /* a side */

static int bucket_of(const hada_sites *sites, double position)
{
    const int bucket = (int)((position + sites->half) / sites->size);
    return bucket < 0 ? 0 : bucket >= sites->buckets ? sites->buckets - 1 : bucket;
}

static int bucket_at(const hada_sites *sites, int i)
{
    return bucket_of(sites, sites->y[i]) * sites->buckets + bucket_of(sites, sites->x[i]);
}

/* Sites by buckets: counting sort, from the last to the first, so that a bucket's keep their order. */
static hada_status sort(hada_sites *sites, hada_error *err)
{
    const size_t all = (size_t)sites->buckets * (size_t)sites->buckets;
    HADA_TRY(HADA_NEW(sites->first, all + 1, "places of a mask", err));
    HADA_TRY(HADA_NEW(sites->order, (size_t)sites->count, "places of a mask", err));
    for (int i = 0; i < sites->count; i++)
        sites->first[bucket_at(sites, i)]++;
    for (size_t k = 1; k <= all; k++)
        sites->first[k] += sites->first[k - 1];
    for (int i = sites->count - 1; i >= 0; i--)
        sites->order[--sites->first[bucket_at(sites, i)]] = i;
    return HADA_OK;
}

void hada_sites_free(hada_sites *sites)
{
    HADA_FREE(sites->x, sites->y, sites->first, sites->order);
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
static double nearest_square(const hada_sites *sites, double x, double y)
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
    return s.square;
}

/* The sites that may be nearest to a point of a bucket: none is farther from its middle than the nearest, and the
 * bucket's diagonal. Counts them, and writes them where there is room. */
static int candidates(const hada_sites *sites, int row, int col, int *to)
{
    const double x = (col + 0.5) * sites->size - sites->half, y = (row + 0.5) * sites->size - sites->half;
    const double limit = sqrt(nearest_square(sites, x, y)) + 1.4143 * sites->size;
    const int low_row = bucket_of(sites, y - limit), high_row = bucket_of(sites, y + limit),
              low_col = bucket_of(sites, x - limit), high_col = bucket_of(sites, x + limit);
    int count = 0;
    for (int r = low_row; r <= high_row; r++)
        for (int c = low_col; c <= high_col; c++)
            for (int k = sites->first[r * sites->buckets + c]; k < sites->first[r * sites->buckets + c + 1]; k++) {
                const int i = sites->order[k];
                const double dx = sites->x[i] - x, dy = sites->y[i] - y;
                if (dx * dx + dy * dy > limit * limit)
                    continue;
                if (to)
                    to[count] = i;
                count++;
            }
    return count;
}

/* From the sites in each bucket to those that matter to it, which a search then goes through. */
static hada_status replace_by_candidates(hada_sites *sites, hada_error *err)
{
    const int all = sites->buckets * sites->buckets;
    int *first = NULL, *order = NULL, *kept;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(first, (size_t)all + 1, "places of a mask", err));
    for (int b = 0; b < all; b++)
        first[b + 1] = first[b] + candidates(sites, b / sites->buckets, b % sites->buckets, NULL);
    HADA_TRY_OR_DONE(HADA_NEW(order, (size_t)first[all], "places of a mask", err));
    for (int b = 0; b < all; b++)
        candidates(sites, b / sites->buckets, b % sites->buckets, order + first[b]);
    kept = sites->first, sites->first = first, first = kept;
    kept = sites->order, sites->order = order, order = kept;
done: /* the old lists, or new ones that failed */
    HADA_FREE(first, order);
    return status;
}

hada_status hada_sites_make(hada_sites *sites, double *x, double *y, int count, double half_width, hada_error *err)
{
    /* a little wider, so that points that round to its border lie inside */
    *sites = (hada_sites){.x = x, .y = y, .count = count, .half = 1.02 * half_width};
    sites->buckets = (int)ceil(sqrt((double)count));
    sites->buckets = sites->buckets < BUCKETS_MOST ? sites->buckets : BUCKETS_MOST;
    sites->size = 2.0 * sites->half / sites->buckets;
    HADA_TRY(sort(sites, err));
    return replace_by_candidates(sites, err);
}

int hada_sites_nearest(const hada_sites *sites, double x, double y, double *square)
{
    search s = {x, y, HUGE_VAL, -1};
    if (fabs(x) <= sites->half && fabs(y) <= sites->half)
        look(sites, bucket_of(sites, y), bucket_of(sites, x), &s);
    else /* no bucket's: all of them */
        for (int b = 0; b < sites->buckets * sites->buckets; b++)
            look(sites, b / sites->buckets, b % sites->buckets, &s);
    *square = s.square;
    return s.best;
}
