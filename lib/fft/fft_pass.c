/* Tables of a pass: stages, digit-reversed order, twiddle factors, cosines of odd radices, chirps. All computed in
 * double precision and rounded once. */
#include <complex.h>

#include "core/fft_factor.h"
#include "fft/fft_own.h"
#include "kernels/shared_fft.h"
#include "kernels/shared_fft_sizes.h"
#include "kernels/shared_fft_table.h"

#define TWO_PI 6.283185307179586476925286766559

/* The points that the first stages take at a time: 16 KiB of the nearest cache. */
#define CHUNK_POINTS 256

/* Floats follow the integers at a multiple of this: vectors are aligned. */
#define WORDS_TOGETHER 16

static int has_butterfly(int radix)
{
    return radix <= 5 || radix == 7 || radix == 8;
}

static int odd_groups(int radix)
{
    return (radix / 2 + FFT_ODD_GROUP - 1) / FFT_ODD_GROUP;
}

/* exp(-2 pi i k / n), exact at the quarter turns. */
static double complex root(long long k, long long n)
{
    k %= n;
    if (4 * k % n == 0) {
        static const double complex quarters[4] = {1.0, -1.0 * I, -1.0, 1.0 * I};
        return quarters[4 * k / n];
    }
    double angle = -TWO_PI * (double)k / (double)n;
    return cos(angle) + sin(angle) * I;
}

static size_t stage_floats(int radix, int span)
{
    size_t count = 2 * (size_t)(radix - 1) * (size_t)span;
    if (!has_butterfly(radix))
        count += (size_t)odd_groups(radix) * (size_t)(radix / 2) * 2 * FFT_ODD_GROUP;
    return count;
}

static void sizes_of(int n, const hada_fft_stages *stages, size_t *int_count, size_t *float_count)
{
    *int_count = hada_round_up(FFT_HEADER + (size_t)stages->count * FFT_STAGE_INTS + 2 * (size_t)n, WORDS_TOGETHER);
    *float_count = 2; /* never empty, and a chirp never stands at 0 */
    for (int s = 0, span = 1; s < stages->count; span *= stages->radix[s++])
        *float_count += stage_floats(stages->radix[s], span);
    if (stages->chirp)
        *float_count += 2 * ((size_t)n + (size_t)stages->points);
}

void hada_fft_pass_sizes(int n, int direct, int *points, int *odd, size_t *int_count, size_t *float_count)
{
    hada_fft_stages stages;
    hada_fft_factor(n, direct, &stages);
    *points = stages.points;
    *odd = 0;
    for (int s = 0; s < stages.count; s++)
        *odd |= !has_butterfly(stages.radix[s]);
    sizes_of(n, &stages, int_count, float_count);
}

static float *put(float *out, double complex value)
{
    out[0] = (float)creal(value);
    out[1] = (float)cimag(value);
    return out + 2;
}

static float *fill_stage(float *out, int radix, int span, int across)
{
    for (int k = 1; k < radix && across; k++)
        for (int j = 0; j < span; j++)
            out = put(out, root((long long)j * k, (long long)span * radix));
    for (int j = 0; j < span && !across; j++)
        for (int k = 1; k < radix; k++)
            out = put(out, root((long long)j * k, (long long)span * radix));
    if (has_butterfly(radix))
        return out;
    for (int k = 1; k <= radix / 2 && across; k++)
        for (int m = 1; m <= radix / 2; m++)
            out = put(out, conj(root((long long)m * k, radix)));
    for (int g = 0; g < odd_groups(radix) && !across; g++)
        for (int k = 1; k <= radix / 2; k++)
            for (int part = 0; part < 2; part++)
                for (int i = 1; i <= FFT_ODD_GROUP; i++) {
                    const int m = g * FFT_ODD_GROUP + i;
                    double complex w = m <= radix / 2 ? root((long long)m * k, radix) : 0.0;
                    *out++ = (float)(part ? -cimag(w) : creal(w));
                }
    return out;
}

/* order[p]: which input the digit-reversed order has at scratch point p. */
static void fill_order(const hada_fft_stages *stages, int *order)
{
    const int points = stages->points, first = stages->radix[0], blocks = points / first;
    for (int b = 0; b < blocks; b++) {
        int rest = b, weight = blocks, base = 0;
        for (int t = 1; t < stages->count; t++) {
            weight /= stages->radix[t];
            base += rest % stages->radix[t] * weight;
            rest /= stages->radix[t];
        }
        for (int k = 0; k < first; k++)
            order[b * first + k] = base + k * blocks;
    }
}

/* A smooth transform in double, by splitting off the smallest prime; for the tables of chirps. */
static void transform(int n, const double complex *in, int stride, double complex *out, double complex *work)
{
    if (n == 1) {
        out[0] = in[0];
        return;
    }
    int p = 2;
    while (n % p)
        p++;
    const int m = n / p;
    for (int k = 0; k < p; k++)
        transform(m, in + (size_t)k * (size_t)stride, stride * p, work + (size_t)k * (size_t)m, out);
    for (int j = 0; j < m; j++)
        for (int q = 0; q < p; q++) {
            double complex sum = 0.0;
            for (int k = 0; k < p; k++)
                sum += work[k * m + j] * root((long long)k * (j + (long long)q * m), n);
            out[q * m + j] = sum;
        }
}

/* exp(-i pi j^2 / n), and the transform of its conjugate, wrapped round, over the points of the convolution. */
static hada_status fill_chirp(float *chirp, float *spectrum, int n, int points, hada_error *err)
{
    double complex *work;
    HADA_TRY(HADA_NEW(work, 3 * (size_t)points, "a table of a transform", err));
    for (int j = 0; j < n; j++) {
        double complex c = root((long long)j * j % (2LL * n), 2LL * n);
        chirp = put(chirp, c);
        work[j] = conj(c);
        if (j)
            work[points - j] = conj(c);
    }
    transform(points, work, 1, work + points, work + 2 * (size_t)points);
    for (int k = 0; k < points; k++)
        spectrum = put(spectrum, work[points + k] / (double)points);
    free(work);
    return HADA_OK;
}

/* With m = floor(2^32 / span) + 1, floor(b m / 2^32) = floor(b / span) while b span < 2^32 (T. Granlund, P. L.
 * Montgomery, PLDI 1994). */
static int32_t magic_of(int span, int points)
{
    return span > 1 && (uint64_t)span * (uint64_t)points < (uint64_t)1 << 32
               ? (int32_t)(uint32_t)(((uint64_t)1 << 32) / (uint64_t)span + 1)
               : 0;
}

static void fill_header(int32_t *ints, const hada_fft_stages *stages, int n)
{
    int chunk = 1, chunk_stages = 0;
    while (chunk_stages < stages->count && (chunk_stages == 0 || chunk * stages->radix[chunk_stages] <= CHUNK_POINTS))
        chunk *= stages->radix[chunk_stages++];
    ints[FFT_LENGTH] = n;
    ints[FFT_POINTS] = stages->points;
    ints[FFT_STAGES] = stages->count;
    ints[FFT_CHUNK] = chunk;
    ints[FFT_CHUNK_STAGES] = chunk_stages;
    ints[FFT_SOURCE] = FFT_HEADER + stages->count * FFT_STAGE_INTS;
    ints[FFT_PLACE] = ints[FFT_SOURCE] + n;
    for (int s = 0; s < stages->count; s++)
        ints[FFT_ODD] |= !has_butterfly(stages->radix[s]);
}

typedef struct tables {
    int32_t *ints;
    float *floats;
    size_t int_count, float_count;
} tables;

/* Both arrays are the caller's, also after a failure. */
static hada_status make_tables(tables *pass, const hada_fft_pass_desc *desc, hada_error *err)
{
    const int n = desc->n;
    hada_fft_stages stages;
    hada_status status = HADA_OK;
    int *order = NULL;
    hada_fft_factor(n, desc->direct, &stages);
    sizes_of(n, &stages, &pass->int_count, &pass->float_count);
    HADA_TRY_OR_DONE(HADA_NEW(pass->ints, pass->int_count, "a table of a transform", err));
    HADA_TRY_OR_DONE(HADA_NEW(pass->floats, pass->float_count, "a table of a transform", err));
    HADA_TRY_OR_DONE(HADA_NEW(order, (size_t)stages.points, "a table of a transform", err));

    fill_header(pass->ints, &stages, n);
    pass->ints[FFT_FLOATS] = (int32_t)pass->int_count;
    float *next = pass->floats + 2;
    for (int s = 0, span = 1; s < stages.count; span *= stages.radix[s++]) {
        int32_t *stage = pass->ints + FFT_HEADER + s * FFT_STAGE_INTS;
        stage[FFT_RADIX] = stages.radix[s];
        stage[FFT_SPAN] = span;
        stage[FFT_TWIDDLES] = (int32_t)(next - pass->floats);
        stage[FFT_MAGIC] = magic_of(span, stages.points);
        stage[FFT_COSINES] = stage[FFT_TWIDDLES] + 2 * (stages.radix[s] - 1) * span;
        next = fill_stage(next, stages.radix[s], span, desc->across && s == stages.count - 1);
    }
    if (stages.chirp) {
        pass->ints[FFT_CHIRP] = (int32_t)(next - pass->floats);
        pass->ints[FFT_CHIRP_SPECTRUM] = pass->ints[FFT_CHIRP] + 2 * n;
        status = fill_chirp(next, next + 2 * (size_t)n, n, stages.points, err);
    }

    int32_t *source = pass->ints + pass->ints[FFT_SOURCE], *place = pass->ints + pass->ints[FFT_PLACE];
    fill_order(&stages, order);
    for (int p = 0; p < stages.points; p++)
        if (order[p] < n)
            place[desc->kind == HADA_PASS_ROWS_INVERSE && order[p] ? n - order[p] : order[p]] = p;
    for (int i = 0; i < n; i++)
        source[i] = desc->inverse && i ? n - i : i;
done:
    free(order);
    return status;
}

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

/* Whether a program serves such a pass on this device. */
static int sized_find(hada_fft_sized *sized, const hada_context *context, int n, int columns)
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

static size_t sized_floats(const hada_fft_sized *sized, hada_fft_pass_kind kind)
{
    int radix[HADA_SIZED_STAGES];
    const int count = stages_of(sized, kind, radix);
    size_t pairs = 0;
    for (int s = 0, span = 1; s < count; span *= radix[s++])
        pairs += (size_t)FFT_TWIDDLE_PAIRS(radix[s], span);
    return 4 * pairs;
}

/* Floats of its table; and the table: pairs of twiddle factors, stage by stage in the order of the pass's kind. */
static void sized_fill(const hada_fft_sized *sized, hada_fft_pass_kind kind, float *floats)
{
    int radix[HADA_SIZED_STAGES];
    const int count = stages_of(sized, kind, radix);
    for (int s = 0, span = 1; s < count; span *= radix[s++])
        for (int k = 1; k <= 2 * FFT_TWIDDLE_PAIRS(radix[s], span) / span; k += 2)
            for (int j = 0; j < span; j++)
                for (int part = 0; part < 2; part++)
                    floats = put(floats, root((long long)j * (k + part), (long long)span * radix[s]));
}

/* Passes of the library's own transforms: scratch in local or global memory, and launching. */

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
    const size_t count = sized_floats(&pass->size, kind);
    float *floats = NULL;
    hada_status status = HADA_OK;
    if (slot->context->dry)
        return hada_buffer_create(&pass->table, slot->context, count * sizeof *floats, "a transform's tables", err);
    HADA_TRY_OR_DONE(HADA_NEW(floats, count, "a table of a transform", err));
    sized_fill(&pass->size, kind, floats);
    HADA_TRY_OR_DONE(
        hada_buffer_create_from(&pass->table, slot, floats, count * sizeof *floats, "a transform's tables", err));
done:
    free(floats);
    return status;
}

hada_status hada_own_pass_make(hada_own_pass *pass, hada_slot *slot, const hada_fft_pass_desc *desc, hada_error *err)
{
    pass->sized = sized_find(&pass->size, slot->context, desc->n, desc->kind == HADA_PASS_COLUMNS);
    return pass->sized ? make_sized(pass, slot, desc->kind, err) : hada_own_pass_make_any(pass, slot, desc, err);
}

/* The integers of a table, then its floats. */
static hada_status write_table(hada_buffer *buffer, hada_slot *slot, const hada_fft_pass_desc *desc, hada_error *err)
{
    tables table = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(make_tables(&table, desc, err));
    const size_t ints = table.int_count * sizeof *table.ints, floats = table.float_count * sizeof *table.floats;
    HADA_TRY_OR_DONE(hada_buffer_write(buffer, slot, 0, table.ints, ints, err));
    HADA_TRY_OR_DONE(hada_buffer_write(buffer, slot, ints, table.floats, floats, err));
done:
    HADA_FREE(table.ints, table.floats);
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
    HADA_DESTROY_BUFFERS(&pass->table, &pass->scratch);
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
