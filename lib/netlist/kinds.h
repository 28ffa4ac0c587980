/* The kinds of layers and of what they do, as the functions on tensors and the lists of nets name them both, and the
 * words for them. Internal. Needs no OpenCL. */
#ifndef HADA_NETLIST_KINDS_H
#define HADA_NETLIST_KINDS_H

#include "kernels/shared_net.h" /* hada_activation */

typedef enum hada_layer_kind {
    HADA_LAYER_INPUT = 0,
    HADA_LAYER_CONV = 1,
    HADA_LAYER_ACTIVATION = 2,
    HADA_LAYER_POOL = 3,
    HADA_LAYER_RESIZE = 4,
    HADA_LAYER_CONCAT = 5, /* channels one after the other; each is cropped or filled with zeros to the first's size */
    HADA_LAYER_NORM = 6,   /* batch norm */
    HADA_LAYER_DROPOUT = 7,
    HADA_LAYER_LINEAR = 8 /* on all values of an image, as after torch.flatten; gives 1 x 1 pixels */
} hada_layer_kind;
enum { HADA_LAYER_KINDS = 9 };

/* AUTO: by the sizes and the device. WINOGRAD4: F(4x4,3x3) (Lavin and Gray, CVPR 2016); 3 x 3, stride 1, pad 1 only.
 * TF32: in work-groups, by products of tensor cores (kernels/conv_tf32.cl); without these the same values, slowly. */
typedef enum hada_conv_method {
    HADA_CONV_AUTO = 0,
    HADA_CONV_DIRECT = 1,
    HADA_CONV_WINOGRAD4 = 3,
    HADA_CONV_PLAIN = 4,
    HADA_CONV_TF32 = 5
} hada_conv_method;
enum { HADA_CONV_METHODS = 6 };

/* What pooling takes of a window. */
typedef enum hada_pool { HADA_POOL_MAX = 0, HADA_POOL_MEAN = 1 } hada_pool;

/* How images are resized: net/layers.h. */
typedef enum hada_resize {
    HADA_RESIZE_NEAREST = 0,
    HADA_RESIZE_LINEAR = 1,
    HADA_RESIZE_LINEAR_ALIGNED = 2, /* align_corners=True */
    HADA_RESIZE_CUBIC = 3,
    HADA_RESIZE_CUBIC_ALIGNED = 4
} hada_resize;

/* Words for kinds: "conv", "relu", "max", "linear", ...; NULL for a number out of range. The find
 * functions return -1 for a word that is none. */
const char *hada_layer_kind_name(int kind);
const char *hada_activation_name(int activation);
const char *hada_pool_name(int pool);
const char *hada_resize_name(int resize);
int hada_layer_kind_find(const char *name);
int hada_activation_find(const char *name);
int hada_pool_find(const char *name);
int hada_resize_find(const char *name);

#endif
