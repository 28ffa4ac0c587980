/* Fully connected layers on plain arrays: y[n][o] = bias[o] + sum_i w[o][i] x[n][i], and the gradients. Four images are
 * worked on at once, so that weights are read once for them. CPUs: vectors of eight, work-groups of one; GPUs:
 * LINEAR_WIDTH 1, and LINEAR_GROUP work-items sum one output. */
#ifndef LINEAR_WIDTH
#define LINEAR_WIDTH 8
#endif
#ifndef LINEAR_GROUP
#define LINEAR_GROUP 1
#endif

#define LINEAR_IMAGES 4

#define LINEAR_INLINE static inline __attribute__((always_inline))

#if LINEAR_WIDTH == 8
typedef float8 linear_vector;

LINEAR_INLINE linear_vector linear_get(__global const float *p)
{
    return vload8(0, p);
}

LINEAR_INLINE void linear_put(linear_vector v, __global float *p)
{
    vstore8(v, 0, p);
}

LINEAR_INLINE float linear_sum(linear_vector v)
{
    const float4 a = v.lo + v.hi;
    const float2 b = a.lo + a.hi;
    return b.x + b.y;
}
#else
typedef float linear_vector;

LINEAR_INLINE linear_vector linear_get(__global const float *p)
{
    return *p;
}

LINEAR_INLINE void linear_put(linear_vector v, __global float *p)
{
    *p = v;
}

LINEAR_INLINE float linear_sum(linear_vector v)
{
    return v;
}
#endif

/* Dimensions: outputs times LINEAR_GROUP, images over LINEAR_IMAGES. Images beyond the last one repeat it. */
__kernel __attribute__((reqd_work_group_size(LINEAR_GROUP, 1, 1))) void
net_linear_forward(__global const float *w, ulong w_offset, __global const float *bias, ulong bias_offset,
                   int has_bias, __global const float *x, ulong x_offset, __global float *y, ulong y_offset,
                   int images, int in, int out)
{
    const int item = get_local_id(0), o = get_group_id(0), first = get_global_id(1) * LINEAR_IMAGES;
    __global const float *row = w + w_offset + (size_t)o * in;
    __global const float *image[LINEAR_IMAGES];
    linear_vector lanes[LINEAR_IMAGES];
    float sum[LINEAR_IMAGES];
#if LINEAR_GROUP > 1
    __local float tree[LINEAR_GROUP * LINEAR_IMAGES];
#endif
    for (int n = 0; n < LINEAR_IMAGES; n++) {
        image[n] = x + x_offset + (size_t)min(first + n, images - 1) * in;
        lanes[n] = 0.0f;
    }
    for (int i = item * LINEAR_WIDTH; i + LINEAR_WIDTH <= in; i += LINEAR_GROUP * LINEAR_WIDTH) {
        const linear_vector v = linear_get(row + i);
        for (int n = 0; n < LINEAR_IMAGES; n++)
            lanes[n] = fma(v, linear_get(image[n] + i), lanes[n]);
    }
    for (int n = 0; n < LINEAR_IMAGES; n++)
        sum[n] = linear_sum(lanes[n]);
#if LINEAR_WIDTH > 1
    for (int i = in / LINEAR_WIDTH * LINEAR_WIDTH; i < in; i++)
        for (int n = 0; n < LINEAR_IMAGES; n++)
            sum[n] = fma(row[i], image[n][i], sum[n]);
#endif
#if LINEAR_GROUP > 1
    for (int n = 0; n < LINEAR_IMAGES; n++)
        tree[n * LINEAR_GROUP + item] = sum[n];
    for (int step = LINEAR_GROUP / 2; step > 0; step /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item < step)
            for (int n = 0; n < LINEAR_IMAGES; n++)
                tree[n * LINEAR_GROUP + item] += tree[n * LINEAR_GROUP + item + step];
    }
    for (int n = 0; n < LINEAR_IMAGES; n++)
        sum[n] = tree[n * LINEAR_GROUP];
#endif
    if (item == 0)
        for (int n = 0; n < min(LINEAR_IMAGES, images - first); n++)
            y[y_offset + (size_t)(first + n) * out + o] = sum[n] + (has_bias ? bias[bias_offset + o] : 0.0f);
}

/* Vectors of inputs that a work-item takes. */
#if LINEAR_WIDTH > 1
#define LINEAR_ACROSS 4
#else
#define LINEAR_ACROSS 1
#endif
#define LINEAR_COLUMNS (LINEAR_ACROSS * LINEAR_WIDTH)

/* dx[n][i] = sum_o w[o][i] dy[n][o]. Dimensions: inputs over LINEAR_COLUMNS, images over LINEAR_IMAGES. */
__kernel void net_linear_data(__global const float *w, ulong w_offset, __global const float *dy, ulong dy_offset,
                              __global float *dx, ulong dx_offset, int images, int in, int out)
{
    const int i = get_global_id(0) * LINEAR_COLUMNS, first = get_global_id(1) * LINEAR_IMAGES;
    const int here = min(LINEAR_IMAGES, images - first);
    __global const float *column = w + w_offset + i;
    __global float *to = dx + dx_offset + (size_t)first * in + i;
    __global const float *from[LINEAR_IMAGES];
    if (i >= in)
        return;
    for (int n = 0; n < LINEAR_IMAGES; n++)
        from[n] = dy + dy_offset + (size_t)min(first + n, images - 1) * out;
    if (i + LINEAR_COLUMNS <= in) {
        linear_vector sum[LINEAR_IMAGES][LINEAR_ACROSS];
        for (int n = 0; n < LINEAR_IMAGES; n++)
            for (int k = 0; k < LINEAR_ACROSS; k++)
                sum[n][k] = 0.0f;
        for (int o = 0; o < out; o++, column += in)
            for (int k = 0; k < LINEAR_ACROSS; k++) {
                const linear_vector v = linear_get(column + k * LINEAR_WIDTH);
                for (int n = 0; n < LINEAR_IMAGES; n++)
                    sum[n][k] = fma((linear_vector)from[n][o], v, sum[n][k]);
            }
        for (int n = 0; n < here; n++)
            for (int k = 0; k < LINEAR_ACROSS; k++)
                linear_put(sum[n][k], to + (size_t)n * in + k * LINEAR_WIDTH);
    } else {
        for (int n = 0; n < here; n++)
            for (int k = 0; k < in - i; k++) {
                float sum = 0.0f;
                for (int o = 0; o < out; o++)
                    sum = fma(from[n][o], column[(size_t)o * in + k], sum);
                to[(size_t)n * in + k] = sum;
            }
    }
}

/* dw[o][i] = sum_n dy[n][o] x[n][i]. Dimensions: inputs over `run`, a multiple of LINEAR_WIDTH, and outputs. */
__kernel void net_linear_weights(__global const float *x, ulong x_offset, __global const float *dy, ulong dy_offset,
                                 __global float *dw, ulong dw_offset, int images, int in, int out, int run,
                                 int accumulate)
{
    const int o = get_global_id(1), end = min((int)(get_global_id(0) + 1) * run, in);
    __global float *to = dw + dw_offset + (size_t)o * in;
    int i = get_global_id(0) * run;
    for (; i + LINEAR_WIDTH <= end; i += LINEAR_WIDTH) {
        linear_vector sum = accumulate ? linear_get(to + i) : 0.0f;
        for (int n = 0; n < images; n++)
            sum = fma((linear_vector)dy[dy_offset + (size_t)n * out + o], linear_get(x + x_offset + (size_t)n * in + i),
                      sum);
        linear_put(sum, to + i);
    }
#if LINEAR_WIDTH > 1
    for (; i < end; i++) {
        float sum = accumulate ? to[i] : 0.0f;
        for (int n = 0; n < images; n++)
            sum = fma(dy[dy_offset + (size_t)n * out + o], x[x_offset + (size_t)n * in + i], sum);
        to[i] = sum;
    }
#endif
}

/* dbias[o] = sum_n dy[n][o]. */
__kernel void net_linear_bias(__global const float *dy, ulong dy_offset, __global float *dbias, ulong dbias_offset,
                              int images, int out, int accumulate)
{
    const int o = get_global_id(0);
    if (o >= out)
        return;
    float sum = accumulate ? dbias[dbias_offset + o] : 0.0f;
    for (int n = 0; n < images; n++)
        sum += dy[dy_offset + (size_t)n * out + o];
    dbias[dbias_offset + o] = sum;
}
