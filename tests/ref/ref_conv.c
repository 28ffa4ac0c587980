#include "ref/ref_conv.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* What meets: calls `visit` for every pair of a coarse and a fine pixel and the weight between them. */
typedef void (*visit)(void *user, size_t weight, size_t coarse, size_t fine);

static void each_pair(const hada_ref_conv *s, visit call, void *user)
{
    for (int a = 0; a < s->coarse_channels; a++)
        for (int b = 0; b < s->fine_channels; b++)
            for (int u = 0; u < s->kernel_rows; u++)
                for (int v = 0; v < s->kernel_cols; v++)
                    for (int r = 0; r < s->coarse_rows; r++)
                        for (int c = 0; c < s->coarse_cols; c++) {
                            const int row = r * s->stride + u - s->pad_rows, col = c * s->stride + v - s->pad_cols;
                            if (row < 0 || row >= s->fine_rows || col < 0 || col >= s->fine_cols)
                                continue;
                            call(user,
                                 (((size_t)a * (size_t)s->fine_channels + (size_t)b) * (size_t)s->kernel_rows +
                                  (size_t)u) *
                                         (size_t)s->kernel_cols +
                                     (size_t)v,
                                 ((size_t)a * (size_t)s->coarse_rows + (size_t)r) * (size_t)s->coarse_cols + (size_t)c,
                                 ((size_t)b * (size_t)s->fine_rows + (size_t)row) * (size_t)s->fine_cols + (size_t)col);
                        }
}

typedef struct arrays {
    const float *w, *in;
    double *out;
} arrays;

static void gather(void *user, size_t weight, size_t coarse, size_t fine)
{
    const arrays *a = user;
    a->out[coarse] += (double)a->w[weight] * (double)a->in[fine];
}

static void spread(void *user, size_t weight, size_t coarse, size_t fine)
{
    const arrays *a = user;
    a->out[fine] += (double)a->w[weight] * (double)a->in[coarse];
}

static void correlate(void *user, size_t weight, size_t coarse, size_t fine)
{
    const arrays *a = user;
    a->out[weight] += (double)a->w[coarse] * (double)a->in[fine];
}

void hada_ref_conv_to_coarse(const hada_ref_conv *shape, const float *w, const float *fine, double *coarse)
{
    const size_t pixels = (size_t)shape->coarse_rows * (size_t)shape->coarse_cols;
    memset(coarse, 0, (size_t)shape->coarse_channels * pixels * sizeof *coarse);
    each_pair(shape, gather, &(arrays){w, fine, coarse});
}

void hada_ref_conv_to_fine(const hada_ref_conv *shape, const float *w, const float *coarse, double *fine)
{
    const size_t pixels = (size_t)shape->fine_rows * (size_t)shape->fine_cols;
    memset(fine, 0, (size_t)shape->fine_channels * pixels * sizeof *fine);
    each_pair(shape, spread, &(arrays){w, coarse, fine});
}

void hada_ref_conv_weights(const hada_ref_conv *shape, const float *coarse, const float *fine, double *dw)
{
    each_pair(shape, correlate, &(arrays){coarse, fine, dw});
}

void hada_ref_conv_bias(const float *dy, int channels, int pixels, double *db)
{
    for (int c = 0; c < channels; c++)
        for (int i = 0; i < pixels; i++)
            db[c] += (double)dy[(size_t)c * (size_t)pixels + (size_t)i];
}

double hada_ref_activation(int activation, double slope, double x)
{
    switch (activation) {
    case 1: return x > 0.0 ? x : 0.0;
    case 2: return x > 0.0 ? x : slope * x;
    case 3: return 1.0 / (1.0 + exp(-x));
    default: return x;
    }
}
