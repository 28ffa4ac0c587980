/* The parts of LPIPS: nets cut at the features that are compared, and the distance of features. Internal. */
#ifndef HADA_METRICS_LPIPS_STAGE_H
#define HADA_METRICS_LPIPS_STAGE_H

#include <hadalens/lpips.h>

#include "net/layers.h"
#include "netlist/net_list.h"

enum { HADA_LPIPS_STAGES = 5, HADA_LPIPS_CHANNELS = 1472 }; /* channels: of all stages, at most */

/* What a stage does before its convolutions: maximum pooling (0: none), zeros put around (where the convolution wants
 * more of them than a tensor has). The first stage of AlexNet, 11 x 11 every 4 pixels, takes blocks of 4 x 4 pixels as
 * 48 channels: a convolution of 3 x 3 then does the same, much faster. `fold` is the side of these blocks, 1 elsewhere.
 */
typedef struct hada_lpips_entry {
    int pool, pool_stride, border, fold;
} hada_lpips_entry;

/* out[pair][row][col], plain: the weighted squared distance of the features of images p and pairs + p of x, 2 * pairs
 * of them (enqueued). `weights`: one float per channel. The reference is hada_ref_lpips(). */
hada_status hada_lpips_distance(hada_slot *slot, const hada_tensor *x, hada_floats weights, hada_floats out,
                                hada_error *err);

#endif
