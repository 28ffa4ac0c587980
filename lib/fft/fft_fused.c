#include "fft/fft_fused.h"

#include "fft/fft_internal.h"
#include "kernels/shared_fft_sizes.h"

int hada_fft_fuses(const hada_context *context, int rows, int cols, int blocks)
{
    int points, odd;
    size_t ints, floats;
    hada_fft_pass_sizes(rows, 1, &points, &odd, &ints, &floats);
    const uint64_t bytes = (uint64_t)blocks * hada_own_pass_local(context, rows, 1);
    return context->shape != HADA_SHAPE_GROUPS && hada_fft_choose(context, rows, cols) == HADA_FFT_OWN &&
           points == rows && hada_own_pass_local(context, cols, 0) && bytes && bytes <= HADA_OWN_LOCAL_BYTES &&
           bytes <= context->info.local_memory_bytes;
}

/* Columns or pairs of rows that a group takes at most: a row's part of a block is a whole sector of memory (32 bytes on
 * the GPUs that we know), and small grids still make many groups. */
enum { MOST_SIDE_BY_SIDE = 4 };

/* Time of a stage for each point, in that of a stage of radix 2, as measured on a CPU with AVX-512; 0: no butterfly.
 * Radix 1 along columns is reading and writing without a butterfly. */
static double stage_cost(int radix)
{
    static const double costs[] = {[1] = 3.0, [2] = 1.0, [3] = 1.15, [4] = 1.25, [5] = 1.5, [7] = 1.9, [8] = 1.5};
    return radix < (int)(sizeof costs / sizeof *costs) ? costs[radix] : 0.0;
}

/* Whether work-groups have butterflies for all stages; *odd: but for the last one, of a radix that is taken by itself.
 */
static int groups_take(int n, int *odd)
{
    hada_fft_stages stages;
    hada_fft_factor(n, 0, &stages);
    int smooth = 1;
    for (int s = 0; s + 1 < stages.count; s++)
        smooth &= stage_cost(stages.radix[s]) > 0.0;
    const int last = stages.radix[stages.count - 1];
    *odd = last == FFT_ODD_RADIX && stages.count > 1;
    return smooth && !stages.chirp && (*odd || stage_cost(last) > 0.0);
}

int hada_fft_group_odd(int n)
{
    int odd;
    return groups_take(n, &odd) && odd;
}

/* How many transforms of length n, of each of `images`, fit in local memory, with the tree of a sum beside them. */
static int side_by_side(const hada_context *context, int n, int columns, int images, size_t group)
{
    int odd, width = MOST_SIDE_BY_SIDE;
    const uint64_t reported = context->info.local_memory_bytes, tree = group * sizeof(float);
    const uint64_t limit = reported < HADA_OWN_LOCAL_BYTES ? reported : HADA_OWN_LOCAL_BYTES;
    const uint64_t one = (uint64_t)images * (uint64_t)n * 2 * sizeof(float);
    while (width && (uint64_t)width * one + tree > limit)
        width /= 2;
    return !groups_take(n, &odd) || (columns && width < HADA_FFT_LEAST_COLUMNS) ? 0 : width;
}

int hada_fft_group_pairs(const hada_context *context, int cols, size_t group)
{
    return side_by_side(context, cols, 0, 1, group);
}

int hada_fft_group_columns(const hada_context *context, int rows, int cols, int images, size_t group)
{
    return context->shape == HADA_SHAPE_GROUPS && context->info.max_work_group >= group &&
                   hada_fft_choose(context, rows, cols) == HADA_FFT_OWN && hada_fft_group_pairs(context, cols, group)
               ? side_by_side(context, rows, 1, images, group)
               : 0;
}

/* The tables of both passes along rows in one buffer. */
static hada_status gather_rows(hada_fft_fused *fused, hada_slot *slot, hada_error *err)
{
    hada_buffer *there = &fused->rows.table, *back = &fused->rows_back.table;
    const size_t at = there->bytes;
    fused->back_table = (int)(at / sizeof(cl_int));
    HADA_TRY(hada_buffer_create(&fused->row_tables, slot->context, at + back->bytes, "the tables of a transform", err));
    HADA_TRY(hada_buffer_copy(slot, there->mem, 0, fused->row_tables.mem, 0, there->bytes, err));
    HADA_TRY(hada_buffer_copy(slot, back->mem, 0, fused->row_tables.mem, at, back->bytes, err));
    HADA_DESTROY_BUFFERS(there, back);
    return HADA_OK;
}

hada_status hada_fft_fused_make(hada_fft_fused *fused, hada_slot *slot, int rows, int cols, hada_error *err)
{
    const int groups = slot->context->shape == HADA_SHAPE_GROUPS;
    fused->odd_rows = groups && hada_fft_group_odd(cols);
    fused->odd_columns = groups && hada_fft_group_odd(rows);
    const hada_fft_pass_desc forward = {.kind = HADA_PASS_ROWS, .n = cols, .across = fused->odd_rows},
                             back = {.kind = HADA_PASS_ROWS_INVERSE, .n = cols, .inverse = 1},
                             columns = {.kind = HADA_PASS_COLUMNS, .n = rows, .across = fused->odd_columns};
    if (groups) {
        HADA_TRY(hada_own_pass_make_any(&fused->rows, slot, &forward, err));
        HADA_TRY(hada_own_pass_make_any(&fused->columns, slot, &columns, err));
        return HADA_OK;
    }
    HADA_TRY(hada_own_pass_make(&fused->rows, slot, &forward, err));
    HADA_TRY(hada_own_pass_make(&fused->rows_back, slot, &back, err));
    HADA_TRY(hada_own_pass_make(&fused->columns, slot, &columns, err));
    HADA_TRY(gather_rows(fused, slot, err));
    return HADA_OK;
}

void hada_fft_fused_free(hada_fft_fused *fused)
{
    hada_own_pass_free(&fused->rows);
    hada_own_pass_free(&fused->rows_back);
    hada_own_pass_free(&fused->columns);
    hada_buffer_destroy(&fused->row_tables);
}

/* What is done for each point beside the stages: along rows images become spectra, and there are as many columns. */
static double time_of(int n, int columns)
{
    hada_fft_stages stages;
    double sum = columns ? 1.0 : 10.0;
    hada_fft_factor(n, columns, &stages);
    for (int s = 0; s < stages.count; s++) {
        const double one = stage_cost(stages.radix[s]);
        if (stages.chirp || !(one > 0.0))
            return INFINITY;
        sum += one;
    }
    return n * sum;
}

int hada_fft_quick_size(int n, int columns)
{
    int best = hada_fft_good_size(n);
    double least = time_of(best, columns);
    for (int size = n; size <= n + n / 4; size++) {
        const double time = time_of(size, columns);
        if (time < least) {
            least = time;
            best = size;
        }
    }
    return best;
}
