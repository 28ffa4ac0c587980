/* Local mean with a separable window, eight columns at a time. */

/* out[row][x] = sum of weights[k] in[row + k][x]; `vectors` of eight columns, 2 radius more rows in `in`. */
__kernel void focus_window_down(__global const float *in, __global const float *weights, const int radius,
                                const int vectors, __global float *out)
{
    const int x = get_global_id(0), row = get_global_id(1);
    if (x >= vectors)
        return;
    float8 sum = (float8)(0.0f);
    for (int k = 0; k <= 2 * radius; k++)
        sum = fma((float8)(weights[k]), vload8((size_t)(row + k) * vectors + x, in), sum);
    vstore8(sum, (size_t)row * vectors + x, out);
}

/* out[row][8 x ..] = sum of weights[k] in[row][halo + 8 x + k - radius ..]; `in` has `pitch` columns, with a halo of at
 * least `radius`, `out` has 8 * vectors. multiply: the root of the sum is multiplied into what stands in `out`. */
__kernel void focus_window_across(__global const float *in, __global const float *weights, const int radius,
                                  const int halo, const int pitch, const int vectors, const int multiply,
                                  __global float *out)
{
    const int x = get_global_id(0), row = get_global_id(1);
    if (x >= vectors)
        return;
    __global const float *from = in + (size_t)row * pitch + halo + 8 * x - radius;
    float8 sum = (float8)(0.0f);
    for (int k = 0; k <= 2 * radius; k++)
        sum = fma((float8)(weights[k]), vload8(0, from + k), sum);
    if (multiply)
        sum = sqrt(sum) * vload8((size_t)row * vectors + x, out);
    vstore8(sum, (size_t)row * vectors + x, out);
}
