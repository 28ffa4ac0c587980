/* What the kernels of nets and the host agree on: kinds, layouts of tensors, numbers of launches. */
#ifndef SHARED_NET_H
#define SHARED_NET_H

#include "shared_types.h"

typedef enum hada_activation {
    HADA_ACTIVATION_NONE = 0,
    HADA_ACTIVATION_RELU = 1,
    HADA_ACTIVATION_LEAKY_RELU = 2, /* x < 0: slope * x */
    HADA_ACTIVATION_SIGMOID = 3
} hada_activation;

/* What training minimises: lib/net/loss.h has the formulas. */
typedef enum hada_loss {
    HADA_LOSS_MSE = 0,
    HADA_LOSS_L1 = 1,
    HADA_LOSS_LOGITS = 2,
    HADA_LOSS_TV = 3,
    HADA_LOSS_TV_SQUARED = 4
} hada_loss;

/* Where a pixel of an output stands on the input when resizing (net_resize.cl). */
typedef enum hada_resize_rule {
    HADA_RESIZE_HALF = 0,    /* pixel centres at half, PyTorch's align_corners=False */
    HADA_RESIZE_ALIGNED = 1, /* the corners' pixels meet, align_corners=True */
    HADA_RESIZE_FLOOR = 2    /* nearest: rounded down */
} hada_resize_rule;

/* Sizes of work that both sides count with. */
#define HADA_SUM_RUN        64   /* floats that one work-item of net_sum adds */
#define HADA_NET_GROUP      128  /* work-items of a group that makes a sum, on GPUs */
#define HADA_NORM_MERGE     32   /* parts that one work-item of net_batch_norm.cl joins */
#define HADA_OPTIMIZER_RUN  4096 /* parameters of a run of net_optimizer.cl */
#define HADA_LINEAR_IMAGES  4    /* images, and outputs, that net_linear.cl works on at once */
#define HADA_LINEAR_OUTPUTS 4
#define HADA_LINEAR_COLUMNS 256 /* inputs that a work-item of net_linear_data takes on CPUs */
#define HADA_PART_COLS      64  /* columns that a work-item of net_part copies */

/* A tensor in its buffer, in floats (lib/net/tensor.h): where it begins, and from one image to the next. */
typedef struct hada_tensor_layout {
    hada_ulong offset, image;
    int channels, rows, cols, blocks; /* blocks of channels */
} hada_tensor_layout;
HADA_SHARED_SIZE(hada_tensor_layout, 32)

/* Planar images in a buffer, in floats: where they begin, and from one image, channel and row to the next. */
typedef struct hada_planar_layout {
    hada_ulong offset, image, channel, row;
} hada_planar_layout;
HADA_SHARED_SIZE(hada_planar_layout, 32)

/* Planar images of in_rows x in_cols pixels resized to rows x cols, `tall` rows in a work-item. */
typedef struct hada_planes_sizes {
    int in_rows, in_cols, rows, cols, channels, tall;
} hada_planes_sizes;
HADA_SHARED_SIZE(hada_planes_sizes, 24)

/* Pooling: windows of size x size every `stride` pixels. */
typedef struct hada_pool_window {
    int size, stride;
} hada_pool_window;
HADA_SHARED_SIZE(hada_pool_window, 8)

/* The gradient of the largest values: the tensors' layouts; span: rows of a work-item. */
typedef struct hada_pool_gradient {
    hada_tensor_layout x, y, dy, dx;
    hada_pool_window windows;
    int span, accumulate;
} hada_pool_gradient;
HADA_SHARED_SIZE(hada_pool_gradient, 144)

/* Dropout's random numbers. */
typedef struct hada_dropout_draw {
    unsigned int key0, key1, step;
    unsigned int threshold; /* of 2^24: values whose number is below become 0 */
    float scale;            /* of those that stay */
} hada_dropout_draw;
HADA_SHARED_SIZE(hada_dropout_draw, 20)

/* Where a tensor is placed in another: see net_place.cl. */
typedef struct hada_placing {
    int row, col, x_first, y_first;
    int count; /* channels */
    int accumulate;
} hada_placing;
HADA_SHARED_SIZE(hada_placing, 24)

/* Batch normalisation: where values per channel begin in their arrays. */
typedef struct hada_norm_values {
    hada_ulong weight, bias, mean, second;
    int is_variance; /* second: the variance, else 1 / sqrt(variance + eps) */
    float eps;
    int span;
    int unused;
} hada_norm_values;
HADA_SHARED_SIZE(hada_norm_values, 48)

typedef struct hada_norm_gradient {
    hada_tensor_layout x, dy, dx;
    hada_ulong saved, weight, sums; /* where they begin */
    float per_value;                /* 1 over the values of a channel */
    int span;
} hada_norm_gradient;
HADA_SHARED_SIZE(hada_norm_gradient, 128)

/* A fully connected layer: where arrays begin (or their gradients), and sizes. */
typedef struct hada_linear_layout {
    hada_ulong w, bias, x, y;
    int images, in, out;
    int has_bias;
} hada_linear_layout;
HADA_SHARED_SIZE(hada_linear_layout, 48)

/* What a loss takes, the gradient scaled by `scale`. */
typedef struct hada_loss_term {
    int loss; /* hada_loss */
    int has_gradient, accumulate;
    float scale;
} hada_loss_term;
HADA_SHARED_SIZE(hada_loss_term, 16)

/* Parameters that an optimiser updates: where the arrays begin, and how long they are. */
typedef struct hada_update_layout {
    hada_ulong gradient, parameters, state;
    unsigned int count;
    float scale; /* of the gradient, before all else */
} hada_update_layout;
HADA_SHARED_SIZE(hada_update_layout, 32)

typedef struct hada_rmsprop {
    float rate, decay, rest, eps; /* rest: 1 - decay */
} hada_rmsprop;
HADA_SHARED_SIZE(hada_rmsprop, 16)

typedef struct hada_adam {
    float rate;         /* / (1 - beta1^t) */
    float inverse_root; /* 1 / sqrt(1 - beta2^t) */
    float beta1, rest1, beta2, rest2;
    float eps;
} hada_adam;
HADA_SHARED_SIZE(hada_adam, 28)

#endif
