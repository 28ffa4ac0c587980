/* Transforms of FFT_POINTS points along the columns of half spectra: a group takes eight columns of one image, or four,
 * from memory and back to it in one go. Two columns an item, 128 bits an access; one where a large prime needs the
 * registers. As fft_group_cols.cl otherwise. */
#include "inc_fft_product.h"
#include "inc_fft_sized.h"
#include "shared_fft.h"

/* The row of FFT_COLUMN_SIZES of this length. */
#define FFT_PARTS(n, r0, r1, r2, r3, h, g) (n == FFT_POINTS ? h : 0) +
#define FFT_GROUP(n, r0, r1, r2, r3, h, g) (n == FFT_POINTS ? g : 0) +
enum {
    R0 = FFT_COLUMN_SIZES(FFT_RADIX0) 0,
    R1 = FFT_COLUMN_SIZES(FFT_RADIX1) 0,
    R2 = FFT_COLUMN_SIZES(FFT_RADIX2) 0,
    R3 = FFT_COLUMN_SIZES(FFT_RADIX3) 0,
    PARTS = FFT_COLUMN_SIZES(FFT_PARTS) 0,
    GROUP = FFT_COLUMN_SIZES(FFT_GROUP) 0,
    ACROSS = HADA_FFT_BLOCK / PARTS, /* columns of a group */
    PAD = FFT_COLUMN_PAD(R0),
    STRIDE = PAD ? PAD : 1,
    PLACES = FFT_COLUMN_PLACES(FFT_POINTS, R0)
};

/* Columns that an item has at a time, its first one, items along a column, and its first butterfly. */
#define SIDE(radix)      ((radix) > FFT_LARGEST_BUTTERFLY ? 1 : 2)
#define COLUMN(radix)    ((int)get_local_id(0) % (ACROSS / SIDE(radix)) * SIDE(radix))
#define FFT_ITEMS(radix) (GROUP * SIDE(radix) / ACROSS)
#define FIRST(radix)     ((int)get_local_id(0) / (ACROSS / SIDE(radix)))
/* Registers of an item at a stage, for real or imaginary parts: x[radix] for each column of each round. */
#define HELD(radix) (FFT_ROUNDS(radix) * (radix)*SIDE(radix))

typedef char rounds_r0_fit[FFT_ROUNDS(R0) <= FFT_MOST_ROUNDS ? 1 : -1];
typedef char rounds_r1_fit[FFT_ROUNDS(R1) <= FFT_MOST_ROUNDS ? 1 : -1];
typedef char rounds_r2_fit[FFT_ROUNDS(R2) <= FFT_MOST_ROUNDS ? 1 : -1];

/* The place of point base + step in scratch; step is a constant. `within`: no pad lies between. */
FFT_INLINE int place_of(int base, int step, int within)
{
    if (!PAD)
        return base + step;
    if (within)
        return base + base / STRIDE + step;
    if (step % STRIDE == 0)
        return base + base / STRIDE + (step + step / STRIDE);
    return base + step + (base + step) / STRIDE;
}

/* Real or imaginary parts of a butterfly's outputs to scratch, two columns. */
FFT_INLINE void put_round(__local float *scratch, int radix, int span, int round, const float *x)
{
    const int b = FIRST(radix) + round * FFT_ITEMS(radix), base = FFT_FIRST_OUTPUT(radix, span, b);
#define PUT(k)                                                                                                         \
    if (k < radix)                                                                                                     \
        *(__local float2 *)(scratch + place_of(base, k * span, span == 1) * ACROSS) = (float2)(x[k], x[radix + k]);
    if (FFT_IS_THERE(radix, round, b)) {
        FFT_EACH_POINT(PUT)
    }
}

/* The outputs of a radix by its definition are made here: m in the place of radix - m where `imaginary`. */
FFT_INLINE void put_odd(__local float *scratch, const float *x, const float *others, int imaginary)
{
    const int base = FIRST(FFT_ODD_RADIX) * FFT_ODD_RADIX;
#pragma unroll
    for (int m = 0; m <= FFT_ODD_PAIRS; ++m) {
        const float2 v = fft_odd_part(x, others, m);
        const int mirror = m ? FFT_ODD_RADIX - m : 0;
        scratch[(base + m) * ACROSS] = imaginary ? v.y : v.x;
        scratch[(base + mirror) * ACROSS] = imaginary ? v.x : v.y;
    }
}

/* A stage's outputs; `others`: their other parts. */
FFT_INLINE void put(__local float *scratch, int radix, int span, const float *x, const float *others, int imaginary)
{
    scratch += COLUMN(radix);
    if (radix == FFT_ODD_RADIX) {
        put_odd(scratch, x, others, imaginary);
    } else {
#define PUT_ROUND(i)                                                                                                   \
    if (i < FFT_ROUNDS(radix))                                                                                         \
        put_round(scratch, radix, span, i, x + 2 * i * radix);
        FFT_EACH_ROUND(PUT_ROUND)
    }
}

/* Such parts as inputs of a butterfly. */
FFT_INLINE void get_round(__local const float *scratch, int radix, int round, float *x)
{
    const int b = FIRST(radix) + round * FFT_ITEMS(radix);
#define GET(k)                                                                                                         \
    if (k < radix) {                                                                                                   \
        const float2 v = *(__local const float2 *)(scratch + place_of(b, k * FFT_BUTTERFLIES(radix), 0) * ACROSS);     \
        x[k] = v.x;                                                                                                    \
        x[radix + k] = v.y;                                                                                            \
    }
    if (FFT_IS_THERE(radix, round, b)) {
        FFT_EACH_POINT(GET)
    }
}

FFT_INLINE void get(__local const float *scratch, int radix, float *x)
{
    scratch += COLUMN(radix);
#define GET_ROUND(i)                                                                                                   \
    if (i < FFT_ROUNDS(radix))                                                                                         \
        get_round(scratch, radix, i, x + 2 * i * radix);
    FFT_EACH_ROUND(GET_ROUND)
}

/* Passes values from a stage to the next: real parts and then imaginary ones, so that half the local memory is enough.
 */
FFT_INLINE void exchange(__local float *scratch, int radix, int span, const float *re, const float *im, int next,
                         float *next_re, float *next_im)
{
    barrier(CLK_LOCAL_MEM_FENCE);
    put(scratch, radix, span, re, im, 0);
    barrier(CLK_LOCAL_MEM_FENCE);
    get(scratch, next, next_re);
    barrier(CLK_LOCAL_MEM_FENCE);
    put(scratch, radix, span, im, re, 1);
    barrier(CLK_LOCAL_MEM_FENCE);
    get(scratch, next, next_im);
}

/* The input of a group: the block's first row, and its filter. */
typedef struct sized_input {
    __global const float *in;
    __global const filter_value *filter;
    int first_row, rows, last_row;
} sized_input;

/* Whether a row is to be read: the others are zero. */
FFT_INLINE int is_read(const sized_input *input, int row)
{
    return (uint)(row - input->first_row) < (uint)input->rows || row >= input->last_row;
}

/* Two columns of a row. */
FFT_INLINE float4 load_row(const sized_input *input, int row, uint at)
{
    float4 v = (float4)0.0f;
    if (is_read(input, row)) {
        v = *(__global const float4 *)(input->in + at);
#if FFT_PRODUCT
        const float4 h = load_filter_values(input->filter + at);
        v = (float4)(filter_product(v.lo, h.lo), filter_product(v.hi, h.hi));
#endif
    }
    return FFT_INVERSE ? v.yxwz : v;
}

/* A butterfly's inputs of the first stage, two columns. */
FFT_INLINE void load_round(const sized_input *input, int radix, int round, float *x, float *y)
{
    const int b = FIRST(radix) + round * FFT_ITEMS(radix);
    const uint at = (uint)(b * 16 + 2 * COLUMN(radix));
#define LOAD(k)                                                                                                        \
    if (k < radix) {                                                                                                   \
        const float4 v =                                                                                               \
            load_row(input, b + k * FFT_BUTTERFLIES(radix), at + (uint)(k * FFT_BUTTERFLIES(radix) * 16));             \
        x[k] = v.x;                                                                                                    \
        y[k] = v.y;                                                                                                    \
        x[radix + k] = v.z;                                                                                            \
        y[radix + k] = v.w;                                                                                            \
    }
    if (FFT_IS_THERE(radix, round, b)) {
        FFT_EACH_POINT(LOAD)
    }
}

/* The inputs of a radix by its definition, one column. */
FFT_INLINE void load_odd(const sized_input *input, float *x, float *y)
{
    const int b = FIRST(FFT_ODD_RADIX);
#pragma unroll
    for (int k = 0; k < FFT_ODD_RADIX; ++k) {
        const int row = b + k * FFT_BUTTERFLIES(FFT_ODD_RADIX);
        const uint at = (uint)(row * 16 + 2 * COLUMN(FFT_ODD_RADIX));
        float2 v = (float2)0.0f;
        if (is_read(input, row)) {
            v = *(__global const float2 *)(input->in + at);
#if FFT_PRODUCT
            v = filter_product(v, load_filter_value(input->filter + at));
#endif
        }
        x[k] = FFT_INVERSE ? v.y : v.x;
        y[k] = FFT_INVERSE ? v.x : v.y;
    }
}

FFT_INLINE void load_columns(const sized_input *input, int radix, float *re, float *im)
{
    if (radix == FFT_ODD_RADIX) {
        load_odd(input, re, im);
    } else {
#define LOAD_ROUND(i)                                                                                                  \
    if (i < FFT_ROUNDS(radix))                                                                                         \
        load_round(input, radix, i, re + 2 * i * radix, im + 2 * i * radix);
        FFT_EACH_ROUND(LOAD_ROUND)
    }
}

/* Two butterflies side by side, times their twiddle factors first. */
FFT_INLINE void transform_round(int radix, int span, int round, __global const float4 *twiddles, float *x, float *y)
{
    const int b = FIRST(radix) + round * FFT_ITEMS(radix);
    twiddles += (uint)(b % span);
#define TWIDDLE(k)                                                                                                     \
    if (k && k < radix && span > 1) {                                                                                  \
        const float4 pair = twiddles[(k - 1) / 2 * span];                                                              \
        const float2 w = k % 2 ? pair.lo : pair.hi;                                                                    \
        fft_times_twiddle(&x[k], &y[k], w.x, w.y);                                                                     \
        fft_times_twiddle(&x[radix + k], &y[radix + k], w.x, w.y);                                                     \
    }
    if (FFT_IS_THERE(radix, round, b)) {
        FFT_EACH_POINT(TWIDDLE)
        fft_butterfly(radix, x, y);
        fft_butterfly(radix, x + radix, y + radix);
    }
}

/* The butterflies of a stage. */
FFT_INLINE void transform(int radix, int span, __global const float4 *twiddles, float *re, float *im)
{
    if (radix == FFT_ODD_RADIX) {
        fft_odd_fold(re, im);
    } else {
#define TRANSFORM_ROUND(i)                                                                                             \
    if (i < FFT_ROUNDS(radix))                                                                                         \
        transform_round(radix, span, i, twiddles, re + 2 * i * radix, im + 2 * i * radix);
        FFT_EACH_ROUND(TRANSFORM_ROUND)
    }
}

/* The last stage's outputs to the rows row0 ... of memory. */
FFT_INLINE void store_round(__global float *out, int row0, int rows, int radix, int round, const float *x,
                            const float *y)
{
    const int b = FIRST(radix) + round * FFT_ITEMS(radix);
    out += 16 * (long)(b - row0) + 2 * COLUMN(radix);
#define STORE(k)                                                                                                       \
    if (k < radix && (uint)(b - row0 + k * FFT_BUTTERFLIES(radix)) < (uint)rows) {                                     \
        const float4 v = (float4)(x[k], y[k], x[radix + k], y[radix + k]);                                             \
        *(__global float4 *)(out + k * FFT_BUTTERFLIES(radix) * 16) = FFT_INVERSE ? v.yxwz : v;                        \
    }
    if (FFT_IS_THERE(radix, round, b)) {
        FFT_EACH_POINT(STORE)
    }
}

FFT_INLINE void store_columns(__global float *out, int row0, int rows, int radix, const float *re, const float *im)
{
#define STORE_ROUND(i)                                                                                                 \
    if (i < FFT_ROUNDS(radix))                                                                                         \
        store_round(out, row0, rows, radix, i, re + 2 * i * radix, im + 2 * i * radix);
    FFT_EACH_ROUND(STORE_ROUND)
}

__kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void
fft_sized_cols(__global const float *in, hada_fft_columns_in from, __global const void *filter, __global float *out,
               hada_fft_columns_out to, __global const float4 *twiddles)
{
    __local float scratch[PLACES * ACROSS] __attribute__((aligned(8))); /* read and written by twos */
    const int images = to.images, task = (int)get_group_id(0) / PARTS, image = task % images, block = task / images;
    const int part = (int)get_group_id(0) % PARTS * ACROSS;
    const ulong at = (ulong)block * FFT_POINTS * 8 + (ulong)part;
    sized_input input;
    input.in = in + 2 * (from.offset + (ulong)((from.first + image) % from.count) * from.distance + at);
    input.filter = (__global const filter_value *)filter;
#if FFT_PRODUCT
    input.filter += 2 * (from.filter_offset + (ulong)image * from.filter_distance + at);
#endif
    input.first_row = from.first_row;
    input.rows = from.rows;
    input.last_row = from.last_row;
    out += 2 * (to.offset + (ulong)image * to.distance + (ulong)block * (ulong)to.rows * 8 + (ulong)part);

    float re0[HELD(R0)], im0[HELD(R0)], re1[HELD(R1)], im1[HELD(R1)], re2[HELD(R2)], im2[HELD(R2)];
    load_columns(&input, R0, re0, im0);
    transform(R0, 1, twiddles, re0, im0);
    exchange(scratch, R0, 1, re0, im0, R1, re1, im1);
    transform(R1, R0, twiddles, re1, im1);
    exchange(scratch, R1, R0, re1, im1, R2, re2, im2);
    twiddles += FFT_TWIDDLE_PAIRS(R1, R0);
    transform(R2, R0 * R1, twiddles, re2, im2);
#if FFT_COLUMN_SIZES(FFT_RADIX3) 0 > 1
    float re3[HELD(R3)], im3[HELD(R3)];
    exchange(scratch, R2, R0 * R1, re2, im2, R3, re3, im3);
    twiddles += FFT_TWIDDLE_PAIRS(R2, R0 * R1);
    transform(R3, R0 * R1 * R2, twiddles, re3, im3);
    store_columns(out, to.row0, to.rows, R3, re3, im3);
#else
    store_columns(out, to.row0, to.rows, R2, re2, im2);
#endif
}
