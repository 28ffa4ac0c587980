#include "runtime/lifetimes.h"

#include <stdlib.h>

#include "core/alloc.h"

/* What is known of a piece while the plan is made. */
typedef struct placed {
    hada_piece *piece;
    int order;   /* in the caller's list: equal sizes keep their order */
    size_t room; /* bytes, rounded up to the alignment */
} placed;

static int larger_first(const void *a, const void *b)
{
    const placed *left = a, *right = b;
    if (left->room != right->room)
        return left->room < right->room ? 1 : -1;
    return left->order - right->order;
}

static int by_offset(const void *a, const void *b)
{
    const placed *left = *(placed *const *)a, *right = *(placed *const *)b;
    if (left->piece->offset != right->piece->offset)
        return left->piece->offset < right->piece->offset ? -1 : 1;
    return left->order - right->order;
}

static int meet(const hada_piece *a, const hada_piece *b)
{
    return a->first <= b->last && b->first <= a->last;
}

/* The lowest place in a buffer that is free during the steps of list[which]; list[0 .. which - 1] stand already. */
static size_t lowest(placed *list, int which, int arena, placed **near)
{
    const hada_piece *piece = list[which].piece;
    int count = 0;
    for (int i = 0; i < which; i++)
        if (list[i].piece->arena == arena && meet(list[i].piece, piece))
            near[count++] = &list[i];
    if (count) /* qsort takes no NULL */
        qsort(near, (size_t)count, sizeof *near, by_offset);
    size_t offset = 0;
    for (int i = 0; i < count; i++) {
        const size_t begin = near[i]->piece->offset, end = begin + near[i]->room;
        if (begin >= offset && begin - offset >= list[which].room)
            break;
        if (end > offset)
            offset = end;
    }
    return offset;
}

static hada_status place(placed *list, int which, size_t largest, hada_arenas *arenas, placed **near, hada_error *err)
{
    hada_piece *piece = list[which].piece;
    if (piece->bytes > largest)
        return hada_fail(err, HADA_ERROR_DEVICE_MEMORY,
                         "%s needs %.2f GiB in one piece; the device takes at most %.2f GiB: work on smaller images",
                         piece->what, (double)piece->bytes / 1073741824.0, (double)largest / 1073741824.0);
    for (int arena = 0;; arena++) {
        const size_t offset = arena < arenas->count ? lowest(list, which, arena, near) : 0;
        if (offset > largest || piece->bytes > largest - offset)
            continue;
        if (arena == arenas->count)
            arenas->count++;
        piece->arena = arena;
        piece->offset = offset;
        if (offset + piece->bytes > arenas->bytes[arena])
            arenas->bytes[arena] = offset + piece->bytes;
        return HADA_OK;
    }
}

hada_status hada_lifetimes_plan(hada_piece *pieces, int count, size_t alignment, size_t largest, hada_arenas *arenas,
                                hada_error *err)
{
    placed *list = NULL, **near = NULL;
    *arenas = (hada_arenas){0};
    if (count < 0 || !alignment)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "lifetimes: a negative count or no alignment");
    for (int i = 0; i < count; i++)
        if (pieces[i].first > pieces[i].last || pieces[i].bytes > SIZE_MAX / 4)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "lifetimes: %s ends before it begins, or is too large",
                             pieces[i].what);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(list = hada_alloc((size_t)count, sizeof *list, "a memory plan", err)));
    HADA_TRY_OR_DONE(hada_allocated(near = hada_alloc((size_t)count, sizeof *near, "a memory plan", err)));
    /* at most one buffer for each piece */
    HADA_TRY_OR_DONE(
        hada_allocated(arenas->bytes = hada_alloc((size_t)count, sizeof *arenas->bytes, "a memory plan", err)));
    for (int i = 0; i < count; i++) {
        const size_t bytes = pieces[i].bytes;
        list[i] = (placed){&pieces[i], i, hada_round_up(bytes, alignment)};
    }
    if (count)
        qsort(list, (size_t)count, sizeof *list, larger_first);
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(place(list, i, largest, arenas, near, err));
done:
    free(list);
    free(near);
    if (status)
        hada_arenas_free(arenas);
    return status;
}

void hada_arenas_free(hada_arenas *arenas)
{
    free(arenas->bytes);
    *arenas = (hada_arenas){0};
}

size_t hada_lifetimes_floor(const hada_piece *pieces, int count)
{
    size_t floor = 0;
    /* the need only grows at a step where a piece begins */
    for (int i = 0; i < count; i++) {
        size_t together = 0;
        for (int k = 0; k < count; k++)
            if (pieces[k].first <= pieces[i].first && pieces[i].first <= pieces[k].last)
                together += pieces[k].bytes;
        if (together > floor)
            floor = together;
    }
    return floor;
}
