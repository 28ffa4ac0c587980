#include "fft/fft_sized.h"

#include "kernels/shared_fft.h"
#include "kernels/shared_fft_sizes.h"

typedef struct size_row {
    int n, radix[HADA_SIZED_STAGES], a, b; /* a, b: columns: parts, group; rows: items, width */
} size_row;

#define ROW(n, r0, r1, r2, r3, a, b) {n, {r0, r1, r2, r3}, a, b},
static const size_row columns_of[] = {FFT_COLUMN_SIZES(ROW)};
static const size_row rows_of[] = {FFT_ROW_SIZES(ROW)};

static const size_row *find(const size_row *rows, size_t count, int n)
{
    for (size_t i = 0; i < count; i++)
        if (rows[i].n == n)
            return &rows[i];
    return NULL;
}

int hada_fft_sized_find(hada_fft_sized *sized, const hada_context *context, int n, int columns)
{
    const size_row *row = columns ? find(columns_of, sizeof columns_of / sizeof *columns_of, n)
                                  : find(rows_of, sizeof rows_of / sizeof *rows_of, n);
    if (!row || context->shape != HADA_SHAPE_GROUPS)
        return 0;
    *sized = (hada_fft_sized){.parts = 1, .pairs = 1};
    for (int s = 0; s < HADA_SIZED_STAGES; s++)
        sized->radix[s] = row->radix[s];
    if (columns) {
        sized->parts = row->a;
        sized->group = row->b;
        sized->local_bytes =
            (size_t)FFT_COLUMN_PLACES(n, row->radix[0]) * (size_t)(HADA_FFT_BLOCK / row->a) * sizeof(float);
    } else {
        sized->pairs = row->b;
        sized->group = row->a * row->b;
        sized->local_bytes = (size_t)FFT_ROW_PLACES(n) * (size_t)row->b * 2 * sizeof(float);
    }
    return sized->local_bytes <= context->info.local_memory_bytes &&
           (size_t)sized->group <= context->info.max_work_group;
}

/* The stages in the order in which they run; back along rows it is the other way round. */
static int stages_of(const hada_fft_sized *sized, hada_fft_pass_kind kind, int *radix)
{
    int count = 0;
    for (int s = 0; s < HADA_SIZED_STAGES; s++) {
        const int r = sized->radix[kind == HADA_PASS_ROWS_INVERSE ? HADA_SIZED_STAGES - 1 - s : s];
        if (r > 1)
            radix[count++] = r;
    }
    return count;
}

size_t hada_fft_sized_floats(const hada_fft_sized *sized, hada_fft_pass_kind kind)
{
    int radix[HADA_SIZED_STAGES];
    const int count = stages_of(sized, kind, radix);
    size_t pairs = 0;
    for (int s = 0, span = 1; s < count; span *= radix[s++])
        pairs += (size_t)FFT_TWIDDLE_PAIRS(radix[s], span);
    return 4 * pairs;
}

void hada_fft_sized_fill(const hada_fft_sized *sized, hada_fft_pass_kind kind, float *floats)
{
    int radix[HADA_SIZED_STAGES];
    const int count = stages_of(sized, kind, radix);
    for (int s = 0, span = 1; s < count; span *= radix[s++])
        for (int k = 1; k <= 2 * FFT_TWIDDLE_PAIRS(radix[s], span) / span; k += 2)
            for (int j = 0; j < span; j++)
                for (int part = 0; part < 2; part++, floats += 2)
                    hada_fft_root((long long)j * (k + part), (long long)span * radix[s], floats);
}
