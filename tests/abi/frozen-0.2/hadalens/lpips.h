/* Hadalens: LPIPS, the learned perceptual distance of two images.
 *
 * R. Zhang, P. Isola, A. Efros, E. Shechtman, O. Wang, "The unreasonable effectiveness of deep features as a perceptual
 * metric", CVPR 2018; version 0.1 of the authors' package `lpips`. Both images go through a classification net (VGG-16
 * or AlexNet). At five stages the features of every pixel are scaled to unit length over the channels; the squared
 * differences, weighted per channel by a linear head, are averaged over the pixels and summed over the stages.
 * docs/reference/measures.md has the formula, the names of the weights and where they come from; none come with the
 * library.
 *
 * 0 for equal images, larger for less similar ones. Computed on the device in single precision.
 * An object is used by one thread at a time; the context must live as long as it does. */
#ifndef HADALENS_LPIPS_H
#define HADALENS_LPIPS_H

#include <hadalens/device.h>
#include <hadalens/image.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_lpips hada_lpips;

/* The net that gives the features. AUTO: what the shape of the file's features.0.weight says. */
typedef enum hada_lpips_net { HADA_LPIPS_AUTO = 0, HADA_LPIPS_VGG = 1, HADA_LPIPS_ALEX = 2 } hada_lpips_net;

/* Reads the weights from safetensors files: `backbone` has torchvision's names (features.0.weight, ...), `heads` those
 * of the linear heads (lin0.model.1.weight to lin4.model.1.weight); NULL: they stand in the file of the backbone.
 * HADA_ERROR_MODEL when a tensor is missing or has another net's shape. */
HADA_API hada_status hada_lpips_create(hada_lpips **out, hada_context *context, hada_lpips_net net,
                                       const char *backbone, const char *heads, hada_error *err);
HADA_API void hada_lpips_destroy(hada_lpips **lpips);

/* Which net it is. */
HADA_API hada_lpips_net hada_lpips_get_net(const hada_lpips *lpips);

/* Device bytes that comparing images of rows x cols takes. */
HADA_API hada_status hada_lpips_bytes(const hada_lpips *lpips, int rows, int cols, uint64_t *bytes, hada_error *err);

/* The distance of two images of the same size with 1 or 3 channels (grey counts as red, green and blue alike); 0 to
 * `peak` stands for the net's -1 to 1. At least 16 x 16 pixels for VGG-16, 31 x 31 for AlexNet.
 *
 * `mask` (rows * cols; NULL: all pixels): the distances of the stages are brought to the images' size (bilinear, as
 * the package does with spatial=True) and averaged over the pixels that are not 0. Without a mask the average is over
 * each stage's own pixels, as the package does by default: near the edges the two differ a little.
 *
 * What the device needs for a size is kept for the next images of the same size. */
HADA_API hada_status hada_lpips_run(hada_lpips *lpips, const hada_image *a, const hada_image *b, double peak,
                                    const unsigned char *mask, double *out, hada_error *err);

/* The distance at every pixel (the package's spatial=True): one channel of the images' size. *map may hold an image of
 * that shape already, or be empty. */
HADA_API hada_status hada_lpips_map(hada_lpips *lpips, const hada_image *a, const hada_image *b, double peak,
                                    hada_image *map, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
