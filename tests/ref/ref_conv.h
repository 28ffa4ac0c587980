/* Convolutions of nets in double precision: definitions as loops (Dumoulin and Visin 2016, "A guide to convolution
 * arithmetic for deep learning"; torch.nn.functional.conv2d and conv_transpose2d). Internal, for tests.
 *
 * Planar arrays [channel][row][column]. A convolution takes the fine image to the coarse one; a transposed convolution
 * is its transpose, with the same weights w[coarse channel][fine channel][kernel row][kernel column], and takes the
 * coarse image to the fine one. Coarse pixel (r, c) and kernel place (u, v) meet fine pixel
 * (r * stride + u - pad_rows, c * stride + v - pad_cols); what lies outside counts as zero. */
#ifndef HADA_REF_CONV_H
#define HADA_REF_CONV_H

typedef struct hada_ref_conv {
    int coarse_channels, coarse_rows, coarse_cols;
    int fine_channels, fine_rows, fine_cols;
    int kernel_rows, kernel_cols, stride, pad_rows, pad_cols;
} hada_ref_conv;

/* coarse = w * fine: a convolution's forward pass; a transposed convolution's gradient of its input. */
void hada_ref_conv_to_coarse(const hada_ref_conv *shape, const float *w, const float *fine, double *coarse);

/* fine = w^T coarse: a transposed convolution's forward pass; a convolution's gradient of its input. */
void hada_ref_conv_to_fine(const hada_ref_conv *shape, const float *w, const float *coarse, double *fine);

/* dw += the sum over pixels of coarse times fine: the gradient of the weights, of either kind. */
void hada_ref_conv_weights(const hada_ref_conv *shape, const float *coarse, const float *fine, double *dw);

/* db[c] += the sum over the pixels of channel c: the gradient of a bias. */
void hada_ref_conv_bias(const float *dy, int channels, int pixels, double *db);

/* Activations as net/conv.h numbers them. */
double hada_ref_activation(int activation, double slope, double x);

#endif
