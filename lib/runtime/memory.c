#include "runtime/memory.h"

void hada_dry_begin(hada_dry *dry, const hada_context *of)
{
    hada_context *context = &dry->context;
    *context = (hada_context){.dry = of->dry ? of->dry : of,
                              .platform = of->platform,
                              .device = of->device,
                              .cl = of->cl,
                              .info = of->info,
                              .shape = of->shape,
                              .vector_floats = of->vector_floats,
                              .tensor_cores = of->tensor_cores,
                              .quirks = of->quirks,
                              .programs = of->programs,
                              .tuning = of->tuning,
                              .log = of->log,
                              .log_user = of->log_user,
                              .log_level = of->log_level};
    atomic_init(&context->tf32, atomic_load(&of->tf32));
    pthread_mutex_init(&context->lock, NULL);
    dry->slot = (hada_slot){.context = context};
}

void hada_dry_end(hada_dry *dry)
{
    pthread_mutex_destroy(&dry->context.lock);
}

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

/* The lowest place in a buffer that is free during the steps of list[which]; list[0 .. which - 1] have their places. */
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
    HADA_TRY_OR_DONE(HADA_NEW(list, (size_t)count, "a memory plan", err));
    HADA_TRY_OR_DONE(HADA_NEW(near, (size_t)count, "a memory plan", err));
    /* at most one buffer for each piece */
    HADA_TRY_OR_DONE(HADA_NEW(arenas->bytes, (size_t)count, "a memory plan", err));
    for (int i = 0; i < count; i++) {
        const size_t bytes = pieces[i].bytes;
        list[i] = (placed){&pieces[i], i, hada_round_up(bytes, alignment)};
    }
    if (count)
        qsort(list, (size_t)count, sizeof *list, larger_first);
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(place(list, i, largest, arenas, near, err));
done:
    HADA_FREE(list, near);
    if (status)
        hada_arenas_free(arenas);
    return status;
}

void hada_arenas_free(hada_arenas *arenas)
{
    free(arenas->bytes);
    *arenas = (hada_arenas){0};
}

/* Parts begin at multiples of this where the device asks for less: whole vectors, cache lines and bursts. */
enum { LEAST_ALIGNMENT = 256 };

void hada_scratch_steps(hada_scratch *scratch, int first, int last, int result_last)
{
    if (!scratch)
        return;
    scratch->first = first;
    scratch->last = last;
    scratch->result_last = result_last;
}

/* Adds a piece to the list. */
static hada_status note(hada_scratch *scratch, hada_lifetime lifetime, size_t bytes, const char *what, hada_error *err)
{
    HADA_TRY(HADA_GROW(scratch->pieces, (size_t)scratch->count, 1, "a memory plan", err));
    scratch->pieces[scratch->count++] =
        (hada_piece){.what = what,
                     .bytes = bytes ? bytes : 4,
                     .first = scratch->first,
                     .last = lifetime == HADA_RESULT ? scratch->result_last : scratch->last};
    return HADA_OK;
}

hada_status hada_scratch_plan(hada_scratch *scratch, const hada_context *context, hada_error *err)
{
    const size_t alignment =
        context->info.alignment_bytes > LEAST_ALIGNMENT ? context->info.alignment_bytes : LEAST_ALIGNMENT;
    const uint64_t largest = context->info.max_allocation_bytes;
    hada_arenas_free(&scratch->arenas);
    return hada_lifetimes_plan(scratch->pieces, scratch->count, alignment,
                               largest < SIZE_MAX ? (size_t)largest : SIZE_MAX, &scratch->arenas, err);
}

uint64_t hada_scratch_bytes(const hada_scratch *scratch)
{
    uint64_t bytes = 0;
    for (int i = 0; i < scratch->arenas.count; i++)
        bytes += scratch->arenas.bytes[i];
    return bytes;
}

uint64_t hada_scratch_apart(const hada_scratch *scratch)
{
    uint64_t bytes = 0;
    for (int i = 0; i < scratch->count; i++)
        bytes += scratch->pieces[i].bytes;
    return bytes;
}

hada_status hada_scratch_make(hada_scratch *scratch, hada_context *context, hada_error *err)
{
    const int count = scratch->arenas.count;
    HADA_TRY(HADA_NEW(scratch->buffers, (size_t)count, "a memory plan", err));
    for (int i = 0; i < count; i++)
        HADA_TRY(
            hada_buffer_create(&scratch->buffers[i], context, scratch->arenas.bytes[i], "the working memory", err));
    return HADA_OK;
}

void hada_scratch_free(hada_scratch *scratch)
{
    for (int i = 0; scratch->buffers && i < scratch->arenas.count; i++)
        hada_buffer_destroy(&scratch->buffers[i]);
    HADA_FREE(scratch->buffers, scratch->pieces);
    hada_arenas_free(&scratch->arenas);
    *scratch = (hada_scratch){0};
}

hada_status hada_buffer_take(hada_buffer *buffer, hada_slot *slot, hada_lifetime lifetime, size_t bytes,
                             const char *what, hada_error *err)
{
    hada_scratch *scratch = slot->scratch;
    *buffer = (hada_buffer){0};
    if (!scratch || lifetime == HADA_LASTING || slot->context->quirks.no_parts)
        return hada_buffer_create(buffer, slot->context, bytes, what, err);
    if (slot->context->dry) {
        buffer->bytes = bytes ? bytes : 4;
        return note(scratch, lifetime, bytes, what, err);
    }
    const hada_piece *piece = scratch->next < scratch->count ? &scratch->pieces[scratch->next] : NULL;
    if (!piece || piece->bytes != (bytes ? bytes : 4))
        return hada_fail(err, HADA_ERROR_STATE, "%s of %zu bytes was not planned in this order", what, bytes);
    scratch->next++;
    return hada_buffer_part(buffer, &scratch->buffers[piece->arena], piece->offset, piece->bytes, what, err);
}

hada_buffer *hada_buffer_of(void *object, const hada_buffer_row *row)
{
    return (hada_buffer *)(void *)((char *)object + row->offset);
}

hada_status hada_buffer_rows_take(void *object, hada_slot *slot, const hada_buffer_row *rows, int count,
                                  hada_error *err)
{
    for (int i = 0; i < count; i++)
        if (rows[i].bytes)
            HADA_TRY(hada_buffer_take(hada_buffer_of(object, &rows[i]), slot, rows[i].lifetime, rows[i].bytes,
                                      rows[i].what, err));
    return HADA_OK;
}

void hada_buffer_rows_destroy(void *object, const hada_buffer_row *rows, int count)
{
    for (int i = 0; i < count; i++)
        hada_buffer_destroy(hada_buffer_of(object, &rows[i]));
}
