/* A net as data: a list of layers, the table of its parameters, and their values on the host. Internal. Needs no
 * OpenCL.
 *
 * Layer 0 is the input; each layer takes what earlier ones give, and the last one gives the net's output. Rows and
 * columns follow from the input's (hada_net_sizes), so that a list serves any image size. */
#ifndef HADA_NETLIST_NET_LIST_H
#define HADA_NETLIST_NET_LIST_H

#include <hadalens/net.h>

#include "io/safetensors.h"
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

/* The words by which lists name kinds ("conv"), activations ("relu"), pooling ("max") and resizing ("linear"); NULL for
 * a number out of range. find returns -1 for a word that is none. */
typedef enum hada_net_words {
    HADA_WORDS_KIND = 0,
    HADA_WORDS_ACTIVATION = 1,
    HADA_WORDS_POOL = 2,
    HADA_WORDS_RESIZE = 3
} hada_net_words;
const char *hada_net_word(hada_net_words list, int number);
int hada_net_word_find(hada_net_words list, const char *word);

/* Of a side of an image, a kernel, a stride, at most: products of two do not overflow. */
#define HADA_NET_MOST_PIXELS (1 << 20)

enum { HADA_LAYER_INPUTS = 8, HADA_LAYER_NAME = 64 };

typedef struct hada_layer {
    hada_layer_kind kind;
    char name[HADA_LAYER_NAME]; /* of its parameters: "down.0.0" has down.0.0.weight; "" where it has none */
    int inputs[HADA_LAYER_INPUTS], input_count;
    int channels;            /* INPUT, CONV, LINEAR: what it gives; the others: worked out */
    int kernel, stride, pad; /* CONV, POOL (no pad) */
    int transposed, output_pad;
    int bias;                   /* CONV, LINEAR */
    int in;                     /* LINEAR: values of an image that it takes */
    hada_activation activation; /* CONV, LINEAR, ACTIVATION */
    float slope;
    hada_pool pool;
    hada_resize resize;
    int like, rows, cols; /* RESIZE: to the size of layer `like`; -1: to rows x cols */
    float eps, momentum;  /* NORM */
    float p;              /* DROPOUT */
    int parameter;        /* out: its first one in the table; -1: none */
} hada_layer;

/* A parameter of the state dict. Values stand one after the other in one flat array: first all that training changes,
 * then the running statistics. */
typedef struct hada_parameter {
    char name[HADA_LAYER_NAME + 24];
    int dims;
    int64_t shape[4];
    size_t offset, count; /* floats */
    int trained;
    int layer;
} hada_parameter;

struct hada_net {
    hada_layer *layers;
    int count;
    /* Channels of an image of which each is an image of its own to the net; 1: an image is one. Batch norms then have
     * parameters for each of them (name.0.weight, name.1.weight, ...). */
    int colours;
    int shares; /* 1: of planes that explain a frame together it says whose light is whose, and leaves their sum */
    hada_parameter *parameters;
    int parameter_count;
    uint64_t most; /* of floats, for a list that others wrote; 0: what memory takes */
    size_t trained, floats;
    float *values;
    hada_net_info info; /* set where the list is finished */
};

/* An empty list; layers are added one after the other, *index (may be NULL) is the place of the new one; finish checks
 * the whole, works out what is left to be worked out, and makes the parameters (zero). */
hada_status hada_net_begin(hada_net **out, int colours, hada_error *err);
hada_status hada_net_add(hada_net *net, const hada_layer *layer, int *index, hada_error *err);
hada_status hada_net_finish(hada_net *net, hada_error *err);

/* The layer with the values that most have: kernel 3, stride 1, pad 1, a bias, no activation, one input, PyTorch's eps
 * and momentum. */
hada_layer hada_layer_of(hada_layer_kind kind, const char *name, int input);

/* First values: Kaiming for weights, PyTorch's own where no activation follows, 1 and 0 for batch norms. */
void hada_net_init(hada_net *net, uint64_t seed);

/* Pixels that each layer gives (count pairs) for an input of rows x cols; HADA_ERROR_SIZE where nothing is left. */
typedef struct hada_size {
    int rows, cols;
} hada_size;
hada_status hada_net_sizes(const hada_net *net, int rows, int cols, hada_size *sizes, hada_error *err);

/* The output's alone. */
hada_status hada_net_output_size(const hada_net *net, int rows, int cols, hada_size *out, hada_error *err);

/* As hada_net_create(), of at most `most` parameters: HADA_ERROR_MODEL before memory for more is taken. */
hada_status hada_net_create_within(hada_net **out, const char *description, uint64_t most, uint64_t seed,
                                   hada_error *err);

/* A copy with its values. */
hada_status hada_net_copy(hada_net **out, const hada_net *net, hada_error *err);

/* The parameter of a name, NULL where there is none. */
const hada_parameter *hada_net_find(const hada_net *net, const char *name);

/* A parameter of a layer: the weight (0) or the bias (1) of a convolution or linear layer; weight, bias, running mean
 * and running variance (0 to 3) of a batch norm for one colour. */
const hada_parameter *hada_net_parameter(const hada_net *net, int layer, int colour, int which);

/* The nets that the library knows, as lists. Weights are zero until hada_net_init() or a file fills them. */

/* By name; 3 x 3 convolutions with leaky ReLU 0.2.
 * patch: at the image's own size; widths 32, 64, 128, 128 with strides 1, 2, 2, 1, then one channel of logits, each of
 * a patch of 25 x 25 pixels (Isola et al., CVPR 2017, call it PatchGAN).
 *
 * paper: resizes to 256 x 256; widths 32, 64, 128, 128, 128 with stride 2, and two fully connected layers (256, 1): one
 * logit an image (Tian and Yang 2022). */
hada_status hada_discriminator_make(hada_net **out, const char *name, int channels, hada_error *err);

/* The convolutional part of VGG-16 (Simonyan and Zisserman 2015, configuration D) with torchvision's names,
 * behind the normalisation that its weights were trained with; takes RGB in 0 ... 1. It ends with the last pooling, so
 * that its output is what stands before the fully connected layers. */
hada_status hada_vgg16_make(hada_net **out, hada_error *err);

/* The same with the weights of a file, such as torchvision's: "features.N.weight" and so on; the normalisation, which
 * such a file does not hold, has its values already, and what else the file holds is ignored. */
hada_status hada_vgg16_load(hada_net **out, const char *path, hada_error *err);

/* Nets in safetensors files, by themselves or as a part of a larger file. */

/* The key of a net's description in the metadata of a file of its own. */
#define HADA_NET_META "net"

/* Fills the net's values from the tensors `prefix` + name. Parameters whose names begin with `own` (NULL: none) keep
 * their values. All others must be there, in the right shape and any float type. Tensors that the net does not name are
 * ignored. The values are unchanged on failure. */
hada_status hada_net_read_but(hada_net *net, const hada_tensors *file, const char *prefix, const char *own,
                              hada_error *err);

/* A net from its description and the tensors of a file. */
hada_status hada_net_from_file(hada_net **out, const char *description, const hada_tensors *file, const char *prefix,
                               hada_error *err);

/* Two halves of writing: the tensors in the order of the table, then their data in the same order. */
hada_status hada_net_declare(const hada_net *net, hada_tensors_writer *writer, const char *prefix, hada_error *err);
hada_status hada_net_write(const hada_net *net, hada_tensors_writer *writer, hada_error *err);

#endif
