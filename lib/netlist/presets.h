/* The nets that the library knows, as lists. Internal. Weights are zero until hada_net_init() or a file fills them. */
#ifndef HADA_NETLIST_PRESETS_H
#define HADA_NETLIST_PRESETS_H

#include "netlist/net_list.h"

/* unet.c; hadalens/net.h says what the options mean. Names: down.<level>.<number>, lift.<level> (transposed
 * convolutions), up.<level>.<number>, norm, last. */
hada_status hada_unet_make(hada_net **out, const hada_unet_options *options, hada_error *err);

/* discriminator.c, by name; 3 x 3 convolutions with leaky ReLU 0.2.
 * patch: at the image's own size; widths 32, 64, 128, 128 with strides 1, 2, 2, 1, then one channel of logits, each of
 * a patch of 25 x 25 pixels (Isola et al., CVPR 2017, call it PatchGAN).
 *
 * paper: resizes to 256 x 256; widths 32, 64, 128, 128, 128 with stride 2, and two fully connected layers (256, 1): one
 * logit an image (Tian and Yang 2022). */
hada_status hada_discriminator_make(hada_net **out, const char *name, int channels, hada_error *err);

/* vgg.c: the convolutional part of VGG-16 (Simonyan and Zisserman 2015, configuration D) with torchvision's names,
 * behind the normalisation that its weights were trained with; takes RGB in 0 ... 1. It ends with the last pooling, so
 * that its output is what stands before the fully connected layers. */
hada_status hada_vgg16_make(hada_net **out, hada_error *err);

/* The same with the weights of a file, such as torchvision's: "features.N.weight" and so on; the normalisation, which
 * such a file does not hold, has its values already, and what else the file holds is ignored. */
hada_status hada_vgg16_load(hada_net **out, const char *path, hada_error *err);

#endif
