/* The parts of LPIPS: nets cut at the features that are compared, and the distance of features. Internal. */
#ifndef HADA_METRICS_LPIPS_STAGE_H
#define HADA_METRICS_LPIPS_STAGE_H

#include <hadalens/lpips.h>

#include "net/layers.h"
#include "netlist/net_list.h"

enum { HADA_LPIPS_STAGES = 5, HADA_LPIPS_CHANNELS = 1472 }; /* channels: of all stages, at most */

/* Which net a file of weights is for; refuses another one than *net, where that is not AUTO. */
hada_status hada_lpips_find_net(const hada_tensors *file, hada_lpips_net *net, hada_error *err);

/* The linear heads of a file: the weights of all channels, stage after stage, and where each stage's begin. */
hada_status hada_lpips_read_heads(const char *path, hada_lpips_net net, float weights[HADA_LPIPS_CHANNELS],
                                  size_t first[HADA_LPIPS_STAGES], hada_error *err);

/* What a stage does before its convolutions: maximum pooling (0: none), zeros put around (where the convolution wants
 * more of them than a tensor has). The first stage of AlexNet, 11 x 11 every 4 pixels, takes blocks of 4 x 4 pixels as
 * 48 channels: a convolution of 3 x 3 then does the same, much faster. `fold` is the side of these blocks, 1 elsewhere.
 */
typedef struct hada_lpips_entry {
    int pool, pool_stride, border, fold;
} hada_lpips_entry;
hada_lpips_entry hada_lpips_stage_entry(hada_lpips_net net, int stage);

/* Pixels that the convolutions of a stage take, after its entry, from what the stage before gives. */
hada_size hada_lpips_stage_input(hada_lpips_net net, int stage, hada_size before);

/* The convolutions of a stage as a list, with a file's weights; the output is what is compared, and what the next stage
 * takes. */
hada_status hada_lpips_stage_make(hada_net **out, hada_lpips_net net, int stage, const hada_tensors *file,
                                  hada_error *err);

/* An image, 0 ... peak, as the first stage takes it: channels, rows and columns of its input, with the colours brought
 * to what the backbone was trained with. */
void hada_lpips_fill(hada_lpips_net net, const hada_image *image, double peak, hada_size size, float *out);
int hada_lpips_fill_channels(hada_lpips_net net);

/* Channels that a stage gives; its smallest image. */
int hada_lpips_stage_channels(hada_lpips_net net, int stage);
int hada_lpips_least_size(hada_lpips_net net);

/* out[pair][row][col], plain: the weighted squared distance of the features of images p and pairs + p of x, 2 * pairs
 * of them (enqueued). `weights`: one float per channel. The reference is hada_ref_lpips(). */
hada_status hada_lpips_distance(hada_slot *slot, const hada_tensor *x, hada_floats weights, hada_floats out,
                                hada_error *err);

#endif
