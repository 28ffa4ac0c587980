/* Planes in training, as plain floats: the squared error with its gradient, and the gradient of clipping at zero. */

#define TRAIN_RUN 1024

/* A work-item's values: TRAIN_RUN of them, the last one what is left of `count`. */
#define TRAIN_EACH(i, count)                                                                                           \
    for (size_t i = get_global_id(0) * TRAIN_RUN,                                                                      \
                train_end = min(i + TRAIN_RUN, (size_t)(count));                                                       \
         i < train_end; i += 8)

inline float8 train_get(__global const float *p, size_t i, ulong count)
{
    if (i + 8 <= count)
        return vload8(0, p + i);
    float lanes[8] = {0.0f};
    for (size_t k = 0; i + k < count; k++)
        lanes[k] = p[i + k];
    return vload8(0, lanes);
}

inline void train_put(float8 v, __global float *p, size_t i, ulong count)
{
    if (i + 8 <= count) {
        vstore8(v, 0, p + i);
        return;
    }
    float lanes[8];
    vstore8(v, 0, lanes);
    for (size_t k = 0; i + k < count; k++)
        p[i + k] = lanes[k];
}

/* x becomes scale (x - target); sums[work-item] = the sum of (x - target)^2 over its values. */
__kernel void train_error(__global float *x, __global const float *target, ulong count, float scale,
                          __global float *sums)
{
    float8 sum = 0.0f;
    if (get_global_id(0) * TRAIN_RUN >= count)
        return;
    TRAIN_EACH (i, count) {
        const float8 d = train_get(x, i, count) - train_get(target, i, count);
        sum = fma(d, d, sum);
        train_put(scale * d, x, i, count);
    }
    const float4 a = sum.lo + sum.hi;
    sums[get_global_id(0)] = (a.x + a.z) + (a.y + a.w);
}

/* The gradient of max(plane, 0): nothing flows where the clipped plane is 0. */
__kernel void train_mask(__global const float *plane, __global float *gradient, ulong count)
{
    TRAIN_EACH (i, count) {
        const float8 g = train_get(gradient, i, count);
        train_put(select((float8)0.0f, g, train_get(plane, i, count) > 0.0f), gradient, i, count);
    }
}
