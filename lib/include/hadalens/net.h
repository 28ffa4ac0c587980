/* Hadalens: nets that enhance images.
 *
 * A net is a list of layers with its weights, held on the host; docs/explanation/nets.md describes the list, the
 * presets and the names of the weights, which are PyTorch's. It may be shared by threads as long as none changes it. A
 * runner is a net made ready for images of one size on one device; it is used by one thread at a time. */
#ifndef HADALENS_NET_H
#define HADALENS_NET_H

#include <hadalens/device.h>
#include <hadalens/image.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_net hada_net;

typedef struct hada_net_info {
    int channels, out_channels; /* of the images it takes and gives */
    int shared;                 /* 1: a net of one channel, run on each channel by itself */
    int layers;
    int parameters;   /* tensors */
    uint64_t trained; /* values that training changes */
    uint64_t values;  /* with the running statistics of batch norms */
} hada_net_info;

/* A U-net of any widths. `down` names the widths of its convolutions, "16,16|32,32|64,64": levels from the top to the
 * bottom, with 2 x 2 max pooling between them. `up` names those on the way up, after the concatenation of what came
 * from below and the level's own last convolution, "32,32|16,16": one level less, from the bottom to the top; a level
 * may be empty ("32||"). A last convolution gives the channels of the image. Any image size of at least one pixel at
 * the bottom will do: what comes from below takes the size of the level. */
typedef enum hada_unet_up { HADA_UNET_LINEAR = 0, HADA_UNET_NEAREST = 1, HADA_UNET_TRANSPOSED = 2 } hada_unet_up;
typedef struct hada_unet_options {
    size_t size;                /* sizeof(hada_unet_options) */
    int channels, out_channels; /* 3, 3 by default */
    int shared;                 /* 1: one net of one channel for all of them; out_channels is channels then */
    const char *down, *up;      /* by default those of the preset "compact" */
    hada_unet_up up_by;         /* resizing, or a transposed convolution of 2 x 2 with stride 2 ("lift") */
    int last_kernel;            /* 1 by default, or 3 */
    int last_relu;              /* 1: ReLU after the last convolution as well */
    int last_norm;              /* 1: batch norm before the last convolution */
} hada_unet_options;
HADA_INIT(hada_unet_options, HADA_STRUCT_UNET_OPTIONS)

/* New nets; weights start at random by `seed` (Kaiming for layers with ReLU), biases at 0.
 * Presets: "compact" (RGB or any channels, 16-32-64-128-256, two 3 x 3 convolutions a level) and "paper" (the net of
 * Tian and Yang, Optics Express 30(19), 34479 (2022): one net of a single channel shared by all channels). */
HADA_API hada_status hada_net_create_unet(hada_net **out, const hada_unet_options *options, uint64_t seed,
                                          hada_error *err);
HADA_API hada_status hada_net_create_preset(hada_net **out, const char *preset, int channels, uint64_t seed,
                                            hada_error *err);

/* From a description (JSON, docs/explanation/nets.md), with random weights. */
HADA_API hada_status hada_net_create(hada_net **out, const char *description, uint64_t seed, hada_error *err);

/* The description, made by the call and given back by hada_memory_destroy(). */
HADA_API hada_status hada_net_describe(const hada_net *net, char **out, hada_error *err);

/* Files are safetensors: weights by PyTorch's names and layouts, the description in the metadata under `net`. */
HADA_API hada_status hada_net_load(hada_net **out, const char *path, hada_error *err);
HADA_API hada_status hada_net_save(const hada_net *net, const char *path, hada_error *err);

/* Takes over the weights of a safetensors file by their names, each with `prefix` ("" for none) in front; tensors that
 * the net does not name are ignored. The net is unchanged on failure. */
HADA_API hada_status hada_net_load_weights(hada_net *net, const char *path, const char *prefix, hada_error *err);

HADA_API void hada_net_destroy(hada_net **net);
/* Kept by the net, as long as it is there; later versions may add members at the end. */
HADA_API const hada_net_info *hada_net_get_info(const hada_net *net);

/* A net on a device for images of rows x cols. The runner copies the weights; the net must live as long as it does. */
typedef struct hada_net_runner hada_net_runner;

/* Device bytes that a runner holds. */
HADA_API hada_status hada_net_bytes(hada_context *context, const hada_net *net, int rows, int cols, uint64_t *bytes,
                                    hada_error *err);
HADA_API hada_status hada_net_runner_create(hada_net_runner **out, hada_context *context, const hada_net *net, int rows,
                                            int cols, hada_error *err);
HADA_API void hada_net_runner_destroy(hada_net_runner **runner);

/* out becomes the net's image; it may hold an image of that size already (its memory is kept), or be empty. */
HADA_API hada_status hada_net_run(hada_net_runner *runner, const hada_image *in, hada_image *out, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
