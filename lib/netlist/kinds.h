/* The kinds of things that layers do, as the functions on tensors and the lists of nets name them both. Internal. Needs
 * no OpenCL. */
#ifndef HADA_NETLIST_KINDS_H
#define HADA_NETLIST_KINDS_H

typedef enum hada_activation {
    HADA_ACTIVATION_NONE = 0,
    HADA_ACTIVATION_RELU = 1,
    HADA_ACTIVATION_LEAKY_RELU = 2, /* x < 0: slope * x */
    HADA_ACTIVATION_SIGMOID = 3
} hada_activation;

/* AUTO: by the table of the device class and the tuning file. WINOGRAD2, WINOGRAD4: F(2x2,3x3), F(4x4,3x3) (Lavin and
 * Gray, CVPR 2016); 3 x 3, stride 1, pad 1 only. */
typedef enum hada_conv_method {
    HADA_CONV_AUTO = 0,
    HADA_CONV_DIRECT = 1,
    HADA_CONV_WINOGRAD2 = 2,
    HADA_CONV_WINOGRAD4 = 3,
    HADA_CONV_PLAIN = 4
} hada_conv_method;

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

#endif
