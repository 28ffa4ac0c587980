#include "ref/ref_layers.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

size_t hada_ref_values(const hada_ref_shape *shape)
{
    return (size_t)shape->images * (size_t)shape->channels * (size_t)shape->rows * (size_t)shape->cols;
}

size_t hada_ref_at(const hada_ref_shape *shape, int image, int channel, int row, int col)
{
    return (((size_t)image * (size_t)shape->channels + (size_t)channel) * (size_t)shape->rows + (size_t)row) *
               (size_t)shape->cols +
           (size_t)col;
}

void hada_ref_leaky(size_t count, double slope, const double *x, double *y)
{
    for (size_t i = 0; i < count; i++)
        y[i] = x[i] > 0.0 ? x[i] : slope * x[i];
}

void hada_ref_leaky_backward(size_t count, double slope, const double *y, const double *dy, double *dx)
{
    for (size_t i = 0; i < count; i++)
        dx[i] += y[i] > 0.0 ? dy[i] : slope * dy[i];
}

void hada_ref_sigmoid(size_t count, const double *x, double *y)
{
    for (size_t i = 0; i < count; i++)
        y[i] = 1.0 / (1.0 + exp(-x[i]));
}

void hada_ref_sigmoid_backward(size_t count, const double *y, const double *dy, double *dx)
{
    for (size_t i = 0; i < count; i++)
        dx[i] += dy[i] * y[i] * (1.0 - y[i]);
}

hada_ref_shape hada_ref_pool_shape(const hada_ref_shape *in, int size, int stride)
{
    return (hada_ref_shape){in->images, in->channels, (in->rows - size) / stride + 1, (in->cols - size) / stride + 1};
}

/* Calls a body for every value of a shape. */
#define EACH_VALUE(shape)                                                                                              \
    for (int n = 0; n < (shape)->images; n++)                                                                          \
        for (int c = 0; c < (shape)->channels; c++)                                                                    \
            for (int row = 0; row < (shape)->rows; row++)                                                              \
                for (int col = 0; col < (shape)->cols; col++)

/* The place of a window's first largest value, row by row. */
static size_t largest(const hada_ref_shape *in, int n, int c, int top, int left, int size, const double *x)
{
    size_t best = hada_ref_at(in, n, c, top, left);
    for (int i = 0; i < size; i++)
        for (int k = 0; k < size; k++) {
            const size_t at = hada_ref_at(in, n, c, top + i, left + k);
            if (x[at] > x[best])
                best = at;
        }
    return best;
}

void hada_ref_pool(const hada_ref_shape *in, int mean, int size, int stride, const double *x, double *y)
{
    const hada_ref_shape out = hada_ref_pool_shape(in, size, stride);
    EACH_VALUE(&out)
    {
        double sum = 0.0;
        for (int i = 0; i < size; i++)
            for (int k = 0; k < size; k++)
                sum += x[hada_ref_at(in, n, c, row * stride + i, col * stride + k)];
        y[hada_ref_at(&out, n, c, row, col)] =
            mean ? sum / (size * size) : x[largest(in, n, c, row * stride, col * stride, size, x)];
    }
}

void hada_ref_pool_backward(const hada_ref_shape *in, int mean, int size, int stride, const double *x, const double *dy,
                            double *dx)
{
    const hada_ref_shape out = hada_ref_pool_shape(in, size, stride);
    EACH_VALUE(&out)
    {
        const double g = dy[hada_ref_at(&out, n, c, row, col)];
        if (!mean)
            dx[largest(in, n, c, row * stride, col * stride, size, x)] += g;
        for (int i = 0; mean && i < size; i++)
            for (int k = 0; k < size; k++)
                dx[hada_ref_at(in, n, c, row * stride + i, col * stride + k)] += g / (size * size);
    }
}

void hada_ref_place(const hada_ref_shape *in, const hada_ref_shape *out, int row0, int col0, int first, const double *x,
                    double *y)
{
    EACH_VALUE(out)
    if (c >= first && c < first + in->channels) {
        const int r = row - row0, k = col - col0, inside = r >= 0 && r < in->rows && k >= 0 && k < in->cols;
        y[hada_ref_at(out, n, c, row, col)] = inside ? x[hada_ref_at(in, n, c - first, r, k)] : 0.0;
    }
}

void hada_ref_place_backward(const hada_ref_shape *in, const hada_ref_shape *out, int row0, int col0, int first,
                             const double *dy, double *dx)
{
    EACH_VALUE(in)
    {
        const int r = row + row0, k = col + col0;
        if (r >= 0 && r < out->rows && k >= 0 && k < out->cols)
            dx[hada_ref_at(in, n, c, row, col)] += dy[hada_ref_at(out, n, first + c, r, k)];
    }
}

void hada_ref_batch_norm(const hada_ref_shape *shape, const double *weight, const double *bias, const double *mean,
                         const double *variance, double eps, const double *x, double *y)
{
    EACH_VALUE(shape)
    {
        const size_t at = hada_ref_at(shape, n, c, row, col);
        y[at] = (x[at] - mean[c]) / sqrt(variance[c] + eps) * weight[c] + bias[c];
    }
}

void hada_ref_batch_statistics(const hada_ref_shape *shape, const double *x, double *mean, double *variance)
{
    const double count = (double)shape->images * shape->rows * shape->cols;
    for (int c = 0; c < shape->channels; c++)
        mean[c] = variance[c] = 0.0;
    EACH_VALUE(shape) mean[c] += x[hada_ref_at(shape, n, c, row, col)] / count;
    EACH_VALUE(shape)
    {
        const double d = x[hada_ref_at(shape, n, c, row, col)] - mean[c];
        variance[c] += d * d / count;
    }
}

/* With h = (x - mean) / s, s = sqrt(variance + eps), the chain rule gives dx = weight / s (dy - mean(dy) - h mean(dy
 * h)).
 */
hada_status hada_ref_batch_norm_backward(const hada_ref_shape *shape, const double *weight, double eps, const double *x,
                                         const double *dy, double *dx, double *dweight, double *dbias, hada_error *err)
{
    const size_t channels = (size_t)shape->channels;
    const double count = (double)shape->images * shape->rows * shape->cols;
    double *mean;
    hada_status status = hada_allocated(mean = hada_alloc(4 * channels, sizeof *mean, "batch statistics", err));
    if (status)
        return status;
    double *variance = mean + channels, *sum = variance + channels, *product = sum + channels;
    hada_ref_batch_statistics(shape, x, mean, variance);
    EACH_VALUE(shape)
    {
        const size_t at = hada_ref_at(shape, n, c, row, col);
        sum[c] += dy[at];
        product[c] += dy[at] * (x[at] - mean[c]) / sqrt(variance[c] + eps);
    }
    EACH_VALUE(shape)
    {
        const size_t at = hada_ref_at(shape, n, c, row, col);
        const double s = sqrt(variance[c] + eps), h = (x[at] - mean[c]) / s;
        dx[at] += weight[c] / s * (dy[at] - sum[c] / count - h * product[c] / count);
    }
    for (size_t c = 0; c < channels; c++) {
        dweight[c] += product[c];
        dbias[c] += sum[c];
    }
    free(mean);
    return HADA_OK;
}

void hada_ref_philox(int rounds, uint32_t counter[4], uint32_t key0, uint32_t key1)
{
    for (int i = 0; i < rounds; i++) {
        const uint64_t a = (uint64_t)counter[0] * 0xD2511F53u, b = (uint64_t)counter[2] * 0xCD9E8D57u;
        const uint32_t next[4] = {(uint32_t)(b >> 32) ^ counter[1] ^ key0, (uint32_t)b,
                                  (uint32_t)(a >> 32) ^ counter[3] ^ key1, (uint32_t)a};
        memcpy(counter, next, sizeof next);
        key0 += 0x9E3779B9u;
        key1 += 0xBB67AE85u;
    }
}

void hada_ref_dropout(const hada_ref_shape *shape, double p, uint64_t seed, uint64_t step, const double *x, double *y)
{
    const int quads = (shape->cols + 3) / 4;
    EACH_VALUE(shape)
    {
        uint32_t word[4] = {(uint32_t)(row * quads + col / 4), (uint32_t)c, (uint32_t)n, (uint32_t)step};
        hada_ref_philox(7, word, (uint32_t)seed, (uint32_t)(seed >> 32) ^ (uint32_t)(step >> 32));
        const size_t at = hada_ref_at(shape, n, c, row, col);
        y[at] = (word[col % 4] >> 8) / 16777216.0 >= p ? x[at] / (1.0 - p) : 0.0;
    }
}

void hada_ref_linear(int images, int in, int out, const double *w, const double *bias, const double *x, double *y)
{
    for (int n = 0; n < images; n++)
        for (int o = 0; o < out; o++) {
            double sum = bias ? bias[o] : 0.0;
            for (int i = 0; i < in; i++)
                sum += w[(size_t)o * (size_t)in + (size_t)i] * x[(size_t)n * (size_t)in + (size_t)i];
            y[(size_t)n * (size_t)out + (size_t)o] = sum;
        }
}

void hada_ref_linear_backward(int images, int in, int out, const double *w, const double *x, const double *dy,
                              double *dx, double *dw, double *dbias)
{
    for (int n = 0; n < images; n++)
        for (int o = 0; o < out; o++) {
            const double g = dy[(size_t)n * (size_t)out + (size_t)o];
            dbias[o] += g;
            for (int i = 0; i < in; i++) {
                dx[(size_t)n * (size_t)in + (size_t)i] += w[(size_t)o * (size_t)in + (size_t)i] * g;
                dw[(size_t)o * (size_t)in + (size_t)i] += x[(size_t)n * (size_t)in + (size_t)i] * g;
            }
        }
}
