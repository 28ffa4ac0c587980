/* Passes of the library's own transforms: scratch in local or global memory, and launching. */
#include "fft/fft_own.h"

#include <stdlib.h>

#include "core/alloc.h"

#define GROUP_SIZE_GPU 256
#define GROUP_SIZE_CPU 64

typedef struct scratch_plan {
    int width;
    size_t bytes; /* for a work-group */
    int local;
} scratch_plan;

static size_t group_size(const hada_context *context)
{
    if (context->shape != HADA_SHAPE_GROUPS)
        return 1;
    size_t size = context->info.kind == HADA_DEVICE_CPU ? GROUP_SIZE_CPU : GROUP_SIZE_GPU;
    while (size > 1 && size > context->info.max_work_group)
        size /= 2;
    return size;
}

/* Lanes: always eight transforms. Groups: as many as local memory takes, at most one for each item, and twice the room
 * where a stage has no butterfly of its own. */
static scratch_plan plan_scratch(const hada_context *context, int points, int odd)
{
    const int groups = context->shape == HADA_SHAPE_GROUPS;
    const uint64_t reported = context->info.local_memory_bytes;
    const uint64_t limit = reported < HADA_OWN_LOCAL_BYTES ? reported : HADA_OWN_LOCAL_BYTES;
    const size_t one = (size_t)points * 2 * sizeof(float) * (groups && odd ? 2 : 1);
    int most = HADA_FFT_BLOCK;
    while (groups && most > 1 && (size_t)most > group_size(context))
        most /= 2;
    scratch_plan plan = {.width = most, .bytes = one * (size_t)most, .local = 1};
    while (groups && plan.bytes > limit && plan.width > 1) {
        plan.width /= 2;
        plan.bytes /= 2;
    }
    if (plan.bytes > limit)
        plan = (scratch_plan){.width = most, .bytes = one * (size_t)most};
    return plan;
}

static size_t global_groups(const hada_context *context)
{
    return context->info.compute_units ? 4 * (size_t)context->info.compute_units : 4;
}

static int reads_memory_first(const hada_context *context, int columns)
{
    return columns && context->shape != HADA_SHAPE_GROUPS;
}

/* The table of a length that has a program of its own. */
static hada_status make_sized(hada_own_pass *pass, hada_slot *slot, hada_fft_pass_kind kind, hada_error *err)
{
    const size_t count = hada_fft_sized_floats(&pass->size, kind);
    float *floats = NULL;
    hada_status status = HADA_OK;
    if (slot->context->dry)
        return hada_buffer_create(&pass->table, slot->context, count * sizeof *floats, "a transform's tables", err);
    HADA_TRY_OR_DONE(hada_allocated(floats = hada_alloc(count, sizeof *floats, "a table of a transform", err)));
    hada_fft_sized_fill(&pass->size, kind, floats);
    HADA_TRY_OR_DONE(
        hada_buffer_create_from(&pass->table, slot, floats, count * sizeof *floats, "a transform's tables", err));
done:
    free(floats);
    return status;
}

hada_status hada_own_pass_make(hada_own_pass *pass, hada_slot *slot, const hada_fft_pass_desc *desc, hada_error *err)
{
    pass->sized = hada_fft_sized_find(&pass->size, slot->context, desc->n, desc->kind == HADA_PASS_COLUMNS);
    return pass->sized ? make_sized(pass, slot, desc->kind, err) : hada_own_pass_make_any(pass, slot, desc, err);
}

/* The integers of a table, then its floats. */
static hada_status write_table(hada_buffer *buffer, hada_slot *slot, const hada_fft_pass_desc *desc, hada_error *err)
{
    hada_fft_pass table = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_fft_pass_make(&table, desc, err));
    const size_t ints = table.int_count * sizeof *table.ints, floats = table.float_count * sizeof *table.floats;
    HADA_TRY_OR_DONE(hada_buffer_write(buffer, slot, 0, table.ints, ints, err));
    HADA_TRY_OR_DONE(hada_buffer_write(buffer, slot, ints, table.floats, floats, err));
done:
    hada_fft_pass_free(&table);
    return status;
}

hada_status hada_own_pass_make_any(hada_own_pass *pass, hada_slot *slot, const hada_fft_pass_desc *desc,
                                   hada_error *err)
{
    hada_context *context = slot->context;
    hada_fft_pass_desc full = *desc;
    int points, odd;
    size_t ints, floats;
    full.direct = reads_memory_first(context, desc->kind == HADA_PASS_COLUMNS);
    hada_fft_pass_sizes(desc->n, full.direct, &points, &odd, &ints, &floats);
    const scratch_plan plan = plan_scratch(context, points, odd);
    pass->width = plan.width;
    HADA_TRY(hada_buffer_create(&pass->table, context, ints * sizeof(int32_t) + floats * sizeof(float),
                                "a transform's tables", err));
    if (!context->dry)
        HADA_TRY(write_table(&pass->table, slot, &full, err));
    if (plan.local) {
        pass->local_bytes = plan.bytes;
        return HADA_OK;
    }
    pass->groups = global_groups(context);
    return hada_buffer_create(&pass->scratch, context, pass->groups * plan.bytes, "a transform's scratch", err);
}

void hada_own_pass_free(hada_own_pass *pass)
{
    hada_buffer_destroy(&pass->table);
    hada_buffer_destroy(&pass->scratch);
}

size_t hada_own_pass_local(const hada_context *context, int n, int columns)
{
    int points, odd;
    size_t ints, floats;
    hada_fft_pass_sizes(n, reads_memory_first(context, columns), &points, &odd, &ints, &floats);
    const scratch_plan plan = plan_scratch(context, points, odd);
    return plan.local ? plan.bytes : 0;
}

hada_range hada_own_pass_range(const hada_own_pass *pass, const hada_slot *slot, int tasks)
{
    size_t groups = (size_t)tasks;
    if (!pass->local_bytes && groups > pass->groups)
        groups = pass->groups;
    return hada_range_groups(groups, group_size(slot->context), 1, 1);
}

hada_either hada_own_pass_scratch(const hada_own_pass *pass)
{
    if (pass->local_bytes)
        return (hada_either){.bytes = pass->local_bytes};
    return (hada_either){.buffer = pass->scratch.mem};
}
